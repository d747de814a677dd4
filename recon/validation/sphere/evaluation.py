"""The paper's evaluation on spheres: balls placed one after the other, each seen by several sensors.

Each file is read once and fitted once, then once more together with the others of its sample, and a second time if the
exclusion rule leaves some of them out. Points are kept only as long as that second fit or a picture may need them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import CloudFile, FitError
from recon.validation.measures import COMBINED, N_REPLICATES, TABLE_THRESHOLD, inlier_measures, inlier_tables
from recon.validation.sphere.exclusion import Finding, Parts, findings, missing_remark, usual_parts
from recon.validation.sphere.methods import METHODS
from recon.validation.sphere.model import SphereSettings
from recon.validation.sphere.reconstruction import MeasuredSphere, combined_ratios, fitted, measure_reconstruction
from recon.workers import Progress, no_progress

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
    samples = _samples(_results(clouds, settings, progress), settings)
    spheres = [sphere for sample in samples for sphere in sample.spheres]
    if not spheres:
        reason = samples[0].results[0].failure
        raise FitError(f"no sphere was found in any of {len(clouds)} clouds; the first: {reason}")
    usual = _usual_by_sensor(spheres)
    rows = [row for sample in samples for row in _rows(sample.results, settings, usual)]
    left_out = {row["name"] for row in rows if row["is_excluded"]}
    table, curve = inlier_tables(_groups(samples, left_out, settings), settings.thresholds, settings.seed)
    report = {
        "schema_version": 1,
        "kind": "sphere",
        "settings": {
            "radius_mm": settings.radius,
            "thresholds_mm": list(settings.thresholds),
            "table_threshold_mm": TABLE_THRESHOLD,
            "method": settings.method,
            "unit": settings.unit,
            "viewpoints_mm": {sensor: list(place) for sensor, place in settings.viewpoints.items()},
            "seed": settings.seed,
            "replicates": N_REPLICATES,
        },
        "reconstructions": rows,
        "failed": [row["name"] for row in rows if row["failure"]],
        "excluded": [
            {"name": row["name"], "reasons": row["reasons"]}
            for row in rows
            if row["is_excluded"] and not row["failure"]
        ],
        "flagged": [{"name": row["name"], "remarks": row["remarks"]} for row in rows if row["remarks"]],
        "table": table,
        "curve": curve,
        "measures": inlier_measures("sphere", table, settings.subject),
    }
    return report, sorted(spheres, key=lambda sphere: sphere.file.name not in left_out)[:MOST_PICTURES]


def _check(clouds: Sequence[CloudFile], settings: SphereSettings) -> None:
    if settings.method not in METHODS:
        raise ValueError(f"there is no method {settings.method!r}; expected one of {', '.join(METHODS)}")
    if not (np.isfinite(settings.radius) and settings.radius > 0):
        raise ValueError(f"the radius is {settings.radius:g} mm, expected a positive number")
    if not settings.thresholds or min(settings.thresholds) <= 0:
        raise ValueError(f"thresholds are {settings.thresholds}, expected positive lengths in mm")
    strangers = set(settings.viewpoints) - {cloud.sensor for cloud in clouds}
    if strangers:
        raise ValueError(f"viewpoints are given for {', '.join(sorted(strangers))}, of which there is no cloud")
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
    """Combine each sample's sensors, and let go of points that neither a second fit nor a picture can need."""
    samples, n_spheres = [], 0
    for _, group in groupby(results, key=lambda result: result.file.sample):
        sample = list(group)
        ratios = combined_ratios(fitted(sample), settings)
        if n_spheres >= MOST_PICTURES and not _may_lose(sample, settings):
            sample = [result.without_points() for result in sample]
        samples.append(_Sample(sample, ratios))
        n_spheres += len(fitted(sample))
    return samples


def _may_lose(results: Sequence[MeasuredSphere], settings: SphereSettings) -> bool:
    """Whether the rule may leave out a sphere; what is usual for a sensor, known at the end, only makes it milder."""
    return any(row["is_excluded"] and not row["failure"] for row in _rows(results, settings, {}))


def _usual_by_sensor(spheres: Sequence[MeasuredSphere]) -> dict[str, Parts]:
    samples: dict[str, list[Parts]] = {}
    for sphere in spheres:
        if sphere.parts is not None:
            samples.setdefault(sphere.file.sensor, []).append(sphere.parts)
    return {sensor: usual for sensor, parts in samples.items() if (usual := usual_parts(parts)) is not None}


def _groups(
    samples: Sequence[_Sample], left_out: set[str], settings: SphereSettings
) -> dict[tuple[str, str], list[NDArray[np.float64]]]:
    """Return the inlier ratios of each sample by subset and sensor, without those left out and with them."""
    used = []
    for sample in samples:
        kept = [result for result in sample.results if result.file.name not in left_out]
        is_whole = len(kept) == len(sample.spheres)
        used.append(_Sample(kept, sample.ratios if is_whole else combined_ratios(kept, settings)))
    sensors = dict.fromkeys(result.file.sensor for sample in samples for result in sample.results)
    groups = {}
    for subset, members in (("used", used), ("all", samples)):
        spheres = [sphere for sample in members for sphere in sample.spheres]
        for sensor in sensors:
            groups[subset, sensor] = [sphere.ratios for sphere in spheres if sphere.file.sensor == sensor]
        groups[subset, COMBINED] = [ratios for sample in members for ratios in sample.ratios]
    return groups


def _rows(
    results: Sequence[MeasuredSphere], settings: SphereSettings, usual: Mapping[str, Parts]
) -> list[dict[str, Any]]:
    """Return the rows of one sample, judged by what is usual for each sensor."""
    fits = {result.file.sensor: result.fit for result in results if result.fit is not None}
    parts = {result.file.sensor: result.parts for result in results if result.parts is not None}
    by_sensor = findings(fits, parts, usual)
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
