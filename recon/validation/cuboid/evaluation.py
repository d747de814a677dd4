"""The evaluation on cuboids: placed boxes seen by several sensors, each by itself and all together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import FitError, MeasuredCloud, read_measured
from recon.validation.cuboid.fit import fit_cuboid
from recon.validation.cuboid.model import AXIS_NAMES, CuboidFit, Face, band_of
from recon.validation.curves import COMBINED, N_REPLICATES, TABLE_THRESHOLD, group_rows, inlier_curve, table_measures
from recon.validation.measures import LESS, Subject, joined, measure_rows
from recon.workers import Progress, no_progress

FLATNESS_CUT = 4.0  # standard deviations; points beyond are no roughness but outliers


@dataclass(frozen=True)
class CuboidSettings:
    """What is measured, and how.

    Parameters
    ----------
    size : mm, three edges in any order
    thresholds : mm, of the inlier curve
    unit : of the clouds' coordinates
    positions : mm, where the middle of the box is known to be, one for each sample; empty where it is not known
    subject : what the clouds are of, in a study's words
    seed : of the fits and the bootstrap
    """

    size: tuple[float, float, float]
    thresholds: tuple[float, ...]
    unit: str = "mm"
    positions: tuple[tuple[float, float, float], ...] = ()
    subject: Subject = field(default_factory=Subject)
    seed: int = 1


@dataclass(frozen=True, eq=False)
class MeasuredCuboid:
    """One reconstruction of a placed box, or all sensors' points of it, and the fit if there is one."""

    sample: int
    sensor: str
    file: str
    points: NDArray[np.float32]
    fit: CuboidFit | None = None
    failure: str = ""

    @property
    def name(self) -> str:
        """How the report calls it, for example "3/S1"."""
        return f"{self.sample}/{self.sensor}"


def measure_cuboids(
    clouds: Sequence[MeasuredCloud], settings: CuboidSettings, progress: Progress = no_progress
) -> tuple[dict[str, Any], list[MeasuredCuboid]]:
    """Fit every reconstruction and tabulate it; the content of report.json, and the fits for figures.

    Raises
    ------
    ValueError
        If a cloud cannot be read, a setting is wrong, or no cuboid is found in any cloud.
    """
    _check(clouds, settings)
    measured: list[MeasuredCuboid] = []
    samples = sorted({cloud.sample for cloud in clouds})
    for done, number in enumerate(samples):
        progress("cuboids", done, len(samples))
        measured += _sample([cloud for cloud in clouds if cloud.sample == number], settings)
    progress("cuboids", len(samples), len(samples))
    fitted = [one for one in measured if one.fit is not None]
    if not fitted:
        raise FitError(f"no cuboid was found in any of {len(clouds)} clouds; the first: {measured[0].failure}")
    table = _table(fitted, settings, [TABLE_THRESHOLD])
    report = {
        "schema_version": 1,
        "kind": "cuboid",
        "settings": {
            "size_mm": list(settings.size),
            "thresholds_mm": list(settings.thresholds),
            "table_threshold_mm": TABLE_THRESHOLD,
            "unit": settings.unit,
            "seed": settings.seed,
            "replicates": N_REPLICATES,
        },
        "reconstructions": [_row(one, measured, settings) for one in measured],
        "failed": [one.name for one in measured if one.fit is None],
        "faces": [_face_row(one, face) for one in fitted for face in _fit(one).faces],
        "angles": _angle_rows(fitted),
        "edges": _edge_rows(fitted, settings),
        "table": table,
        "curve": _table(fitted, settings, settings.thresholds),
    }
    return report | {"measures": _measures(report, settings)}, measured


def face_errors(one: MeasuredCuboid, face: Face) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (N, 2) on a face along its two edges from its middle, and signed errors (N,) to its own plane, mm."""
    fit = _fit(one)
    own = one.points[fit.on_face(face, one.points, band_of(fit.size))]
    return fit.in_box(own)[:, [axis for axis in range(3) if axis != face.axis]], face.plane.errors(own)


def _check(clouds: Sequence[MeasuredCloud], settings: CuboidSettings) -> None:
    if np.shape(settings.size) != (3,) or not min(settings.size) > 0:
        raise ValueError(f"the size is {settings.size}, expected three positive lengths in mm")
    if not settings.thresholds or min(settings.thresholds) <= 0:
        raise ValueError(f"thresholds are {settings.thresholds}, expected positive lengths in mm")
    n_samples = len({cloud.sample for cloud in clouds})
    if settings.positions and len(settings.positions) != n_samples:
        raise ValueError(f"{len(settings.positions)} positions are given for {n_samples} samples, expected as many")


def _sample(clouds: Sequence[MeasuredCloud], settings: CuboidSettings) -> list[MeasuredCuboid]:
    """The reconstructions of one placed box, and, if there are several, all of them together."""
    found = []
    for cloud in clouds:
        points = read_measured(cloud.path, settings.unit)
        found.append(_fitted(MeasuredCuboid(cloud.sample, cloud.sensor, str(cloud.path), points), settings))
    if len(found) > 1:
        together = np.concatenate([one.points for one in found])
        found.append(_fitted(MeasuredCuboid(found[0].sample, COMBINED, "", together), settings))
    return found


def _fitted(one: MeasuredCuboid, settings: CuboidSettings) -> MeasuredCuboid:
    try:
        fit, failure = fit_cuboid(one.points, settings.size, settings.seed), ""
    except FitError as error:
        fit, failure = None, str(error)
    except ValueError as error:
        raise ValueError(f"{one.file}: {error}") from error
    return MeasuredCuboid(one.sample, one.sensor, one.file, one.points, fit, failure)


def _fit(one: MeasuredCuboid) -> CuboidFit:
    assert one.fit is not None, "only those that were fitted are tabulated"
    return one.fit


def _row(one: MeasuredCuboid, measured: Sequence[MeasuredCuboid], settings: CuboidSettings) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": one.name,
        "sample": one.sample,
        "sensor": one.sensor,
        "file": one.file,
        "n_points": len(one.points),
        "failure": one.failure,
    }
    if one.fit is None:
        return row
    errors = one.fit.errors(one.points)
    together = next((o.fit for o in measured if (o.sample, o.sensor) == (one.sample, COMBINED)), None)
    row |= {
        "faces": [face.name for face in one.fit.faces],
        "centre_mm": [round(float(value), 4) for value in one.fit.centre],
        "axes": np.round(one.fit.axes, 6).tolist(),
        "from_combined_mm": None if together is None else float(np.linalg.norm(one.fit.centre - together.centre)),
        "median_error_mm": float(np.median(errors)),
        "inliers": float(np.mean(np.abs(errors) <= TABLE_THRESHOLD)),
    }
    if settings.positions:
        at = settings.positions[sorted({o.sample for o in measured}).index(one.sample)]
        row["position_error_mm"] = float(np.linalg.norm(one.fit.centre - np.array(at)))
    return row


def _face_row(one: MeasuredCuboid, face: Face) -> dict[str, Any]:
    places, errors = face_errors(one, face)
    cut = FLATNESS_CUT * face.plane.scale
    inside = errors[np.abs(errors) <= cut]
    return {
        "name": one.name,
        "face": face.name,
        "n_points": len(places),
        "flatness_rms_mm": float(np.sqrt(np.mean(inside**2))),
        "scale_mm": face.plane.scale,
        "beyond": float(np.mean(np.abs(errors) > cut)),
        "tilt_deg": float(np.degrees(np.arccos(min(1.0, abs(face.plane.normal @ _fit(one).axes[face.axis]))))),
    }


def _angle_rows(fitted: Sequence[MeasuredCuboid]) -> list[dict[str, Any]]:
    return [
        {"name": one.name, "faces": f"{a.name} {b.name}", "angle_deg": angle, "error_deg": angle - 90.0}
        for one in fitted
        for a, b, angle in _fit(one).dihedral_angles()
    ]


def _edge_rows(fitted: Sequence[MeasuredCuboid], settings: CuboidSettings) -> list[dict[str, Any]]:
    return [
        {
            "name": one.name,
            "edge": AXIS_NAMES[edge.axis],
            "known_mm": settings.size[edge.axis],
            "length_mm": edge.length,
            "error_mm": edge.length - settings.size[edge.axis],
            "ends": " to ".join(edge.ends),
        }
        for one in fitted
        for edge in _fit(one).edges
    ]


def _table(
    fitted: Sequence[MeasuredCuboid], settings: CuboidSettings, thresholds: Sequence[float]
) -> list[dict[str, Any]]:
    """Inlier and outlier ratios per sensor, and of all sensors' points against one box."""
    has_combined = any(one.sensor == COMBINED for one in fitted)
    groups: dict[str, list[NDArray[np.float64]]] = {}
    for one in fitted:
        ratios = inlier_curve(_fit(one).errors(one.points), thresholds)
        groups.setdefault(one.sensor, []).append(ratios)
        if not has_combined:
            groups.setdefault(COMBINED, []).append(ratios)
    return [
        row for name, ratios in groups.items() for row in group_rows("all", name, ratios, thresholds, settings.seed)
    ]


def _measures(report: Mapping[str, Any], settings: CuboidSettings) -> list[dict[str, Any]]:
    """Of all sensors together, or of each reconstruction where there is but one sensor."""
    names = [row["name"] for row in report["reconstructions"]]
    chosen = {name for name in names if name.endswith(f"/{COMBINED}")} or set(names)

    def mean(rows: str, column: str) -> float | None:
        values = [abs(row[column]) for row in report[rows] if row["name"] in chosen]
        return float(np.mean(values)) if values else None

    subject = settings.subject
    return joined(
        [
            table_measures("cuboid", report["table"], subject),
            measure_rows(subject, "cuboid flatness", mean("faces", "flatness_rms_mm"), direction=LESS, unit="mm"),
            measure_rows(subject, "cuboid angle error", mean("angles", "error_deg"), direction=LESS, unit="degrees"),
            measure_rows(subject, "cuboid edge error", mean("edges", "error_mm"), direction=LESS, unit="mm"),
        ]
    )
