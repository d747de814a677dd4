"""The evaluation on cuboids: placed boxes seen by several sensors, each by itself and all together.

Each file is read once, and fitted once by itself and once with the others of its sample; only those that the report
pictures keep their points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.runtime.workers import Progress, no_progress
from recon.validation.clouds import CloudFile, FitError, read_measured
from recon.validation.cuboid.fit import check_size, fit_cuboid
from recon.validation.cuboid.model import AXIS_NAMES, CuboidFit, Face, band_of
from recon.validation.measures import (
    COMBINED,
    LESS,
    N_REPLICATES,
    TABLE_THRESHOLD,
    Subject,
    check_thresholds,
    inlier_measures,
    inlier_ratios,
    inlier_tables,
    measure_rows,
)

MOST_PICTURES = 12
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
    subject : what the clouds show, in a study's words
    seed : of the fits and the bootstrap
    """

    size: tuple[float, float, float]
    thresholds: tuple[float, ...]
    unit: str = "mm"
    positions: tuple[tuple[float, float, float], ...] = ()
    subject: Subject = field(default_factory=Subject)
    seed: int = 1


@dataclass(frozen=True, eq=False)
class MeasuredFace:
    """A visible face with the points on it.

    Parameters
    ----------
    face : measured by itself
    places : float64 (N, 2), mm, of its points along its two edges from its middle
    errors : float64 (N,), mm, signed, of its points to its plane
    """

    face: Face
    places: NDArray[np.float64]
    errors: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MeasuredCuboid:
    """One reconstruction of a placed box, or all sensors' points of it.

    Parameters
    ----------
    sample, sensor, file : as in the report; the file is empty for all sensors together
    points : float32 (N, 3), mm
    fit : the box; None where there is none, and `failure` says why
    errors : float64 (N,), mm, signed, of the points to the box; empty without one
    faces : those that are visible
    """

    sample: int
    sensor: str
    file: str
    points: NDArray[np.float32]
    fit: CuboidFit | None = None
    errors: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    faces: tuple[MeasuredFace, ...] = ()
    failure: str = ""

    @property
    def name(self) -> str:
        """The name in the report, for example "3/S1"."""
        return f"{self.sample}/{self.sensor}"


def measure_cuboids(
    clouds: Sequence[CloudFile], settings: CuboidSettings, progress: Progress = no_progress
) -> tuple[dict[str, Any], list[MeasuredCuboid]]:
    """Fit every reconstruction and tabulate it.

    Parameters
    ----------
    clouds : files of any number of samples and sensors
    settings : what is measured
    progress : told before each sample

    Returns
    -------
    report : content of report.json
    pictured : reconstructions for the report's pictures

    Raises
    ------
    ValueError
        If a cloud cannot be read, a setting is wrong, or no cuboid is found in any cloud.
    """
    _check(clouds, settings)
    rows: dict[str, list[dict[str, Any]]] = {"reconstructions": [], "faces": [], "angles": [], "edges": []}
    ratios: list[tuple[str, NDArray[np.float64]]] = []
    pictured: list[MeasuredCuboid] = []
    samples = sorted({cloud.sample for cloud in clouds})
    for done, number in enumerate(samples):
        progress("cuboids", done, len(samples))
        sample = _sample([cloud for cloud in clouds if cloud.sample == number], settings)
        fitted = [cuboid for cuboid in sample if cuboid.fit is not None]
        position = settings.positions[done] if settings.positions else None
        rows["reconstructions"] += [_row(cuboid, sample, position) for cuboid in sample]
        rows["faces"] += [_face_row(cuboid, face) for cuboid in fitted for face in cuboid.faces]
        rows["angles"] += [row for cuboid in fitted for row in _angle_rows(cuboid)]
        rows["edges"] += [row for cuboid in fitted for row in _edge_rows(cuboid, settings)]
        ratios += [(cuboid.sensor, inlier_ratios(cuboid.errors, settings.thresholds)) for cuboid in fitted]
        pictured += fitted[: MOST_PICTURES - len(pictured)]
    progress("cuboids", len(samples), len(samples))
    if not ratios:
        reason = rows["reconstructions"][0]["failure"]
        raise FitError(f"no cuboid was found in any of {len(clouds)} clouds; the first: {reason}")
    table, curve = inlier_tables(_groups(ratios), settings.thresholds, settings.seed)
    report = {
        "schema_version": 1,
        "kind": "cuboid",
        "settings": _described(settings),
        "reconstructions": rows["reconstructions"],
        "failed": [row["name"] for row in rows["reconstructions"] if row["failure"]],
        "faces": rows["faces"],
        "angles": rows["angles"],
        "edges": rows["edges"],
        "table": table,
        "curve": curve,
    }
    return report | {"measures": _measures(report, settings)}, pictured


def _described(settings: CuboidSettings) -> dict[str, Any]:
    """Return the settings in the report's words."""
    return {
        "size_mm": list(settings.size),
        "thresholds_mm": list(settings.thresholds),
        "table_threshold_mm": TABLE_THRESHOLD,
        "unit": settings.unit,
        "seed": settings.seed,
        "replicates": N_REPLICATES,
    }


def _check(clouds: Sequence[CloudFile], settings: CuboidSettings) -> None:
    check_size(settings.size)
    check_thresholds(settings.thresholds)
    n_samples = len({cloud.sample for cloud in clouds})
    if settings.positions and len(settings.positions) != n_samples:
        raise ValueError(f"{len(settings.positions)} positions are given for {n_samples} samples, expected as many")


def _sample(files: Sequence[CloudFile], settings: CuboidSettings) -> list[MeasuredCuboid]:
    """Read and fit the reconstructions of one placed box, and, if there are several, all of them together."""
    cuboids = []
    for file in files:
        points = read_measured(file.path, settings.unit)
        cuboids.append(_measured(MeasuredCuboid(file.sample, file.sensor, str(file.path), points), settings))
    if len(cuboids) > 1:
        together = np.concatenate([cuboid.points for cuboid in cuboids])
        cuboids.append(_measured(MeasuredCuboid(files[0].sample, COMBINED, "", together), settings))
    return cuboids


def _measured(cuboid: MeasuredCuboid, settings: CuboidSettings) -> MeasuredCuboid:
    points = cuboid.points
    try:
        fit = fit_cuboid(points, settings.size, settings.seed)
    except FitError as error:
        return replace(cuboid, failure=str(error))
    except ValueError as error:
        raise ValueError(f"{cuboid.file}: {error}") from error
    faces = tuple(_measured_face(fit, face, points) for face in fit.faces)
    return replace(cuboid, fit=fit, errors=fit.errors(points), faces=faces)


def _measured_face(fit: CuboidFit, face: Face, points: NDArray[np.float32]) -> MeasuredFace:
    on_face = points[fit.on_face(face, points, band_of(fit.size))]
    along = [axis for axis in range(3) if axis != face.axis]
    return MeasuredFace(face, fit.in_box(on_face)[:, along], face.plane.errors(on_face))


def _fit(cuboid: MeasuredCuboid) -> CuboidFit:
    assert cuboid.fit is not None, "only those with a fit are tabulated"
    return cuboid.fit


def _row(
    cuboid: MeasuredCuboid, sample: Sequence[MeasuredCuboid], position: tuple[float, float, float] | None
) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": cuboid.name,
        "sample": cuboid.sample,
        "sensor": cuboid.sensor,
        "file": cuboid.file,
        "n_points": len(cuboid.points),
        "failure": cuboid.failure,
    }
    if cuboid.fit is None:
        return row
    centre = cuboid.fit.centre
    together = sample[-1].fit if sample[-1].sensor == COMBINED else None
    row |= {
        "faces": [face.name for face in cuboid.fit.faces],
        "centre_mm": [round(float(value), 4) for value in centre],
        "axes": np.round(cuboid.fit.axes, 6).tolist(),
        "from_combined_mm": None if together is None else float(np.linalg.norm(centre - together.centre)),
        "median_error_mm": float(np.median(cuboid.errors)),
        "inliers": float(np.mean(np.abs(cuboid.errors) <= TABLE_THRESHOLD)),
    }
    if position is not None:
        row["position_error_mm"] = float(np.linalg.norm(centre - np.array(position)))
    return row


def _face_row(cuboid: MeasuredCuboid, measured: MeasuredFace) -> dict[str, Any]:
    face, errors = measured.face, measured.errors
    cut = FLATNESS_CUT * face.plane.scale
    inside = errors[np.abs(errors) <= cut]
    return {
        "name": cuboid.name,
        "face": face.name,
        "n_points": len(errors),
        "flatness_rms_mm": float(np.sqrt(np.mean(inside**2))),
        "scale_mm": face.plane.scale,
        "beyond": float(np.mean(np.abs(errors) > cut)),
        "tilt_deg": float(np.degrees(np.arccos(min(1.0, abs(face.plane.normal @ _fit(cuboid).axes[face.axis]))))),
    }


def _angle_rows(cuboid: MeasuredCuboid) -> list[dict[str, Any]]:
    return [
        {"name": cuboid.name, "faces": f"{a.name} {b.name}", "angle_deg": angle, "error_deg": angle - 90.0}
        for a, b, angle in _fit(cuboid).dihedral_angles()
    ]


def _edge_rows(cuboid: MeasuredCuboid, settings: CuboidSettings) -> list[dict[str, Any]]:
    return [
        {
            "name": cuboid.name,
            "edge": AXIS_NAMES[edge.axis],
            "known_mm": settings.size[edge.axis],
            "length_mm": edge.length,
            "error_mm": edge.length - settings.size[edge.axis],
            "ends": " to ".join(edge.ends),
        }
        for edge in _fit(cuboid).edges
    ]


def _groups(
    ratios: Sequence[tuple[str, NDArray[np.float64]]],
) -> dict[tuple[str, str], list[NDArray[np.float64]]]:
    """Return inlier ratios by subset and sensor; without any combined fit all reconstructions count as combined."""
    has_combined = any(sensor == COMBINED for sensor, _ in ratios)
    groups: dict[tuple[str, str], list[NDArray[np.float64]]] = {}
    for sensor, values in ratios:
        groups.setdefault(("all", sensor), []).append(values)
        if not has_combined:
            groups.setdefault(("all", COMBINED), []).append(values)
    return groups


def _measures(report: Mapping[str, Any], settings: CuboidSettings) -> list[dict[str, Any]]:
    """Return the measures of all sensors together, or of each reconstruction where there is but one sensor."""
    names = [row["name"] for row in report["reconstructions"]]
    chosen = {name for name in names if name.endswith(f"/{COMBINED}")} or set(names)

    def mean(rows: str, column: str) -> float | None:
        values = [abs(row[column]) for row in report[rows] if row["name"] in chosen]
        return float(np.mean(values)) if values else None

    subject = settings.subject
    return [
        *inlier_measures("cuboid", report["table"], subject),
        *measure_rows(subject, "cuboid flatness", mean("faces", "flatness_rms_mm"), direction=LESS, unit="mm"),
        *measure_rows(subject, "cuboid angle error", mean("angles", "error_deg"), direction=LESS, unit="degrees"),
        *measure_rows(subject, "cuboid edge error", mean("edges", "error_mm"), direction=LESS, unit="mm"),
    ]
