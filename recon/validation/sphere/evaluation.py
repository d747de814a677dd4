"""The paper's evaluation on spheres: balls placed one after the other, each seen by several sensors.

Each file is read once and fitted once, then once more together with the others of its sample, and a second time if the
exclusion rule leaves some of them out. Only the points of the first pictures are kept; a file whose points are needed
later is read again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.runtime.workers import Progress, no_progress
from recon.validation.clouds import CloudFile, FitError
from recon.validation.measures import (
    COMBINED,
    N_REPLICATES,
    TABLE_THRESHOLD,
    check_thresholds,
    inlier_measures,
    inlier_tables,
)
from recon.validation.sphere.error_sources import CellErrors, error_sources
from recon.validation.sphere.exclusion import (
    Finding,
    findings,
    missing_remark,
    sensor_offsets,
    sensor_remarks,
)
from recon.validation.sphere.fit.methods import METHODS
from recon.validation.sphere.fit.model import SphereSettings
from recon.validation.sphere.reconstruction import MeasuredSphere, combined_ratios, fitted, measure_reconstruction
from recon.validation.sphere.reference import Centre, agreement, check_unit, mean_centre, read_references
from recon.validation.sphere.uncertainty import N_DRAWS

MOST_PICTURES = 12


@dataclass(frozen=True, eq=False)
class _Sample:
    """All reconstructions of one placed ball.

    Parameters
    ----------
    results : in the order of their files
    ratios : one float64 (1 + T,) of all sensors' points together; none where no sphere was found
    """

    results: Sequence[MeasuredSphere]
    ratios: Sequence[NDArray[np.float64]]

    @property
    def spheres(self) -> list[MeasuredSphere]:
        return fitted(self.results)


def measure_spheres(
    clouds: Sequence[CloudFile], settings: SphereSettings, progress: Progress = no_progress
) -> tuple[dict[str, Any], list[MeasuredSphere]]:
    """Fit every reconstruction, apply the exclusion rule, and tabulate errors.

    Parameters
    ----------
    clouds : files of any number of samples and sensors
    settings : what is measured
    progress : told before each file

    Returns
    -------
    report : content of report.json
    pictured : reconstructions for the report's pictures, with their points; first those that were left out

    Raises
    ------
    ValueError
        If a cloud cannot be read, a setting is wrong, or no sphere is found in any cloud.
    """
    _check(clouds, settings)
    references = _references(clouds, settings)
    samples = _samples(_results(clouds, settings, progress), settings)
    spheres = [sphere for sample in samples for sphere in sample.spheres]
    if not spheres:
        reason = samples[0].results[0].failure
        raise FitError(f"no sphere was found in any of {len(clouds)} clouds; the first: {reason}")
    offsets = sensor_offsets([_centres(sample.spheres) for sample in samples])
    rows = [row for sample in samples for row in _rows(sample.results, settings, offsets)]
    left_out = {row["name"] for row in rows if row["is_excluded"]}
    used = [sphere for sphere in spheres if sphere.file.name not in left_out]
    table, curve = inlier_tables(_groups(samples, left_out, settings), settings.thresholds, settings.seed)
    report = {
        "schema_version": 1,
        "kind": "sphere",
        "settings": _described(settings),
        "reconstructions": rows,
        "failed": [row["name"] for row in rows if row["failure"]],
        "excluded": [
            {"name": row["name"], "reasons": row["reasons"]}
            for row in rows
            if row["is_excluded"] and not row["failure"]
        ],
        "sensor_remarks": sensor_remarks(_left_out(rows)),
        "flagged": [{"name": row["name"], "remarks": row["remarks"]} for row in rows if row["remarks"]],
        "table": table,
        "curve": curve,
        "error_sources": _sources(used or spheres, offsets, settings.seed),
        "reference": _agreement(used, references, settings),
        "measures": inlier_measures("sphere", table, settings.subject),
    }
    pictured = sorted(spheres, key=lambda sphere: sphere.file.name not in left_out)[:MOST_PICTURES]
    return report, [sphere.with_points(settings) for sphere in pictured]


def _described(settings: SphereSettings) -> dict[str, Any]:
    """Return the settings in the report's words."""
    described = {
        "radius_mm": settings.radius,
        "thresholds_mm": list(settings.thresholds),
        "table_threshold_mm": TABLE_THRESHOLD,
        "method": settings.method,
        "unit": settings.unit,
        "viewpoints_mm": {sensor: list(place) for sensor, place in settings.viewpoints.items()},
        "seed": settings.seed,
        "replicates": N_REPLICATES,
        "draws": N_DRAWS,
    }
    if settings.reference is not None:
        files = [str(path) for path in settings.reference.files]
        described["reference"] = {"files": files, "unit": settings.reference.unit, "frame": settings.reference.frame}
    return described


def _check(clouds: Sequence[CloudFile], settings: SphereSettings) -> None:
    if settings.method not in METHODS:
        raise ValueError(f"there is no method {settings.method!r}; expected one of {', '.join(METHODS)}")
    if not (np.isfinite(settings.radius) and settings.radius > 0):
        raise ValueError(f"the radius is {settings.radius:g} mm, expected a positive number")
    check_thresholds(settings.thresholds)
    strangers = set(settings.viewpoints) - {cloud.sensor for cloud in clouds}
    if strangers:
        raise ValueError(f"viewpoints are given for {', '.join(sorted(strangers))}, of which there is no cloud")
    both = sorted({*settings.keep} & {*settings.drop})
    if both:
        raise ValueError(f"{', '.join(both)}: is both to be kept and to be left out; say one of the two")
    unknown = {*settings.keep, *settings.drop} - {cloud.name for cloud in clouds}
    if unknown:
        known = ", ".join(cloud.name for cloud in clouds)
        raise ValueError(f"there is no reconstruction {', '.join(sorted(unknown))}; there are {known}")


def _results(clouds: Sequence[CloudFile], settings: SphereSettings, progress: Progress) -> Iterator[MeasuredSphere]:
    """Measure reconstruction after reconstruction, in the order of the samples."""
    for n_done, file in enumerate(sorted(clouds, key=lambda cloud: cloud.sample)):
        progress("spheres", n_done, len(clouds))
        yield measure_reconstruction(file, settings)
    progress("spheres", len(clouds), len(clouds))


def _samples(results: Iterable[MeasuredSphere], settings: SphereSettings) -> list[_Sample]:
    """Combine each sample's sensors, and let go of points that no picture needs as far as is known by then."""
    samples, n_spheres = [], 0
    for _, group in groupby(results, key=lambda result: result.file.sample):
        sample = list(group)
        ratios = combined_ratios(fitted(sample), settings)
        if n_spheres >= MOST_PICTURES:
            sample = [result.without_points() for result in sample]
        samples.append(_Sample(sample, ratios))
        n_spheres += len(fitted(sample))
    return samples


def _left_out(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[bool]]:
    """Return by sensor whether each of its reconstructions is left out."""
    by_sensor: dict[str, list[bool]] = {}
    for row in rows:
        by_sensor.setdefault(row["sensor"], []).append(bool(row["reasons"]))
    return by_sensor


def _centres(spheres: Iterable[MeasuredSphere]) -> dict[str, NDArray[np.float64]]:
    return {sphere.file.sensor: sphere.fit.centre for sphere in spheres if sphere.fit is not None}


def _sources(
    spheres: Sequence[MeasuredSphere], offsets: Mapping[str, NDArray[np.float64]], seed: int
) -> list[dict[str, Any]]:
    """Return a row per sensor: its errors by their source, and how far its calibration shifts the balls."""
    by_sensor: dict[str, list[CellErrors]] = {}
    for sphere in spheres:
        if sphere.errors_by_cell is not None:
            by_sensor.setdefault(sphere.file.sensor, []).append(sphere.errors_by_cell)
    return [
        {
            "sensor": sensor,
            **error_sources(shots, seed),
            "offset_mm": [round(float(part), 4) for part in offsets[sensor]] if sensor in offsets else None,
        }
        for sensor, shots in by_sensor.items()
    ]


def _references(clouds: Sequence[CloudFile], settings: SphereSettings) -> list[Centre]:
    """Read the reference centres before anything is fitted; none where none are given."""
    if settings.reference is None:
        return []
    n_samples = max(cloud.sample for cloud in clouds)
    return read_references(settings.reference, settings.radius, n_samples, settings.seed)


def _agreement(
    used: Sequence[MeasuredSphere], references: Sequence[Centre], settings: SphereSettings
) -> dict[str, Any] | None:
    """Compare each sample's centre, the mean over the sensors used, with its reference."""
    if settings.reference is None:
        return None
    by_sample: dict[int, list[Centre]] = {}
    for sphere in used:
        if sphere.fit is not None:
            known = np.zeros((3, 3)) if sphere.uncertainty is None else sphere.uncertainty.centre_covariance
            by_sample.setdefault(sphere.file.sample, []).append(Centre(sphere.fit.centre, known))
    means = {sample: mean_centre(centres) for sample, centres in by_sample.items()}
    if means:
        check_unit(references, means, settings.radius)
    return agreement(references, means, settings.reference.frame)


def _groups(
    samples: Sequence[_Sample], left_out: set[str], settings: SphereSettings
) -> dict[tuple[str, str], list[NDArray[np.float64]]]:
    """Return the inlier ratios of each sample by subset and sensor, without those left out and with them."""
    used = []
    for sample in samples:
        kept = [result for result in sample.results if result.file.name not in left_out]
        if len(fitted(kept)) < len(sample.spheres):
            kept = [result.with_points(settings) for result in kept]
            used.append(_Sample([result.without_points() for result in kept], combined_ratios(kept, settings)))
        else:
            used.append(_Sample(kept, sample.ratios))
    sensors = dict.fromkeys(result.file.sensor for sample in samples for result in sample.results)
    groups = {}
    for subset, members in (("used", used), ("all", samples)):
        spheres = [sphere for sample in members for sphere in sample.spheres]
        for sensor in sensors:
            groups[subset, sensor] = [sphere.ratios for sphere in spheres if sphere.file.sensor == sensor]
        groups[subset, COMBINED] = [ratios for sample in members for ratios in sample.ratios]
    return groups


def _rows(
    results: Sequence[MeasuredSphere], settings: SphereSettings, offsets: Mapping[str, NDArray[np.float64]]
) -> list[dict[str, Any]]:
    """Return the rows of one sample, judged with the sensors' constant offsets."""
    fits = {result.file.sensor: result.fit for result in results if result.fit is not None}
    parts = {result.file.sensor: result.parts for result in results if result.parts is not None}
    by_sensor = findings(fits, parts, offsets)
    return [_row(result, by_sensor.get(result.file.sensor, []), settings) for result in results]


def _row(result: MeasuredSphere, judged: Sequence[Finding], settings: SphereSettings) -> dict[str, Any]:
    name = result.file.name
    judged = [*judged, *missing_remark(result.columns.get("missing_share"))]
    reasons = [finding.sentence for finding in judged if not finding.is_remark]
    return {
        "name": name,
        "sample": result.file.sample,
        "sensor": result.file.sensor,
        "file": str(result.file.path),
        "n_points": result.n_points,
        "failure": result.failure,
        "is_excluded": bool(result.failure) or name in settings.drop or (bool(reasons) and name not in settings.keep),
        "reasons": [*reasons, *(["left out on request"] if name in settings.drop else [])],
        "remarks": [finding.sentence for finding in judged if finding.is_remark],
        **result.columns,
    }
