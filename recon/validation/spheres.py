"""The paper's evaluation on spheres: many placed balls, several sensors, what they say together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.execute import Progress, silent
from recon.validation.exclusion import exclusion_reasons, part_shifts
from recon.validation.measured import read_measured
from recon.validation.sphere import (
    FitError,
    SphereFit,
    SphereParameters,
    checked_points,
    fibonacci_sphere,
    fit_sphere,
    inlier_curve,
    refine_sphere,
    subsample,
)
from recon.validation.super4pcs import Super4PCSParameters, super4pcs

TABLE_THRESHOLD = 12.5  # mm, table 4 of the paper
N_REPLICATES = 1000
MODEL_POINTS = 3000
COMBINED = "combined"


@dataclass(frozen=True)
class SphereCloud:
    """A file with one sensor's reconstruction of one placed ball."""

    path: Path
    sample: int
    sensor: str

    @property
    def name(self) -> str:
        """How reports and options call it, for example "3/S1"."""
        return f"{self.sample}/{self.sensor}"


@dataclass(frozen=True)
class SphereSettings:
    """What is measured, and how.

    Parameters
    ----------
    radius : mm
    thresholds : mm, of the inlier curve
    method : a key of METHODS
    unit : of the clouds' coordinates
    viewpoints : by sensor, where it stands, mm; then only points on lines of sight that meet the ball are counted
    keep : names of reconstructions that stay in whatever the rule says
    drop : names of reconstructions that are left out whatever it says
    seed : of the fit and the bootstrap
    """

    radius: float
    thresholds: tuple[float, ...]
    method: str = "robust"
    unit: str = "mm"
    viewpoints: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    keep: tuple[str, ...] = ()
    drop: tuple[str, ...] = ()
    seed: int = 1


@dataclass(frozen=True, eq=False)
class _Measured:
    cloud: SphereCloud
    points: NDArray[np.float32]
    fit: SphereFit | None = None
    failure: str = ""


def fit_robust(points: NDArray[np.float32], radius: float, seed: int) -> SphereFit:
    """Consensus of spheres through three points, then robust refinement."""
    return fit_sphere(points, radius, SphereParameters(seed=seed))


def fit_super4pcs(points: NDArray[np.float32], radius: float, seed: int) -> SphereFit:
    """The ideal sphere's points registered by Super4PCS as in the paper, then the same refinement.

    Raises
    ------
    ValueError
        As `fit_sphere`.
    """
    points, parameters = checked_points(points, radius), SphereParameters(seed=seed)
    try:
        found = super4pcs(
            radius * fibonacci_sphere(MODEL_POINTS), points, Super4PCSParameters(delta=radius / 12, seed=seed)
        )
    except ValueError as error:
        raise FitError(str(error)) from error
    return refine_sphere(points, found.cloud_from_model[:3, 3], radius, parameters)


METHODS: dict[str, Callable[[NDArray[np.float32], float, int], SphereFit]] = {
    "robust": fit_robust,
    "super4pcs": fit_super4pcs,
}


def sphere_clouds(paths: Sequence[Path], sensors: Sequence[str]) -> tuple[SphereCloud, ...]:
    """Which sample and sensor each file is of.

    The names of the sensors belong to the files in order and repeat if they are fewer; the n-th file of each sensor
    is of sample n. Without names every file is a sample of its own.

    Raises
    ------
    ValueError
        If the files are no whole number of times as many as the names.
    """
    if not paths:
        raise ValueError("there is no cloud to measure")
    if sensors and len(paths) % len(sensors):
        raise ValueError(f"{len(paths)} clouds cannot be shared among {len(sensors)} sensors: {', '.join(sensors)}")
    names = [sensors[index % len(sensors)] if sensors else "S1" for index in range(len(paths))]
    seen: Counter[str] = Counter()
    clouds = []
    for path, name in zip(paths, names, strict=True):
        seen[name] += 1
        clouds.append(SphereCloud(path, seen[name], name))
    return tuple(clouds)


def measure_spheres(
    clouds: Sequence[SphereCloud], settings: SphereSettings, progress: Progress = silent
) -> dict[str, Any]:
    """Fit every reconstruction, apply the exclusion rule, and tabulate errors; the content of report.json.

    Raises
    ------
    ValueError
        If a cloud cannot be read, a setting is wrong, or no sphere is found in any cloud.
    """
    _check(clouds, settings)
    names = [cloud.name for cloud in clouds]
    rows: list[dict[str, Any]] = []
    errors: dict[str, NDArray[np.float32]] = {}
    for number in sorted({cloud.sample for cloud in clouds}):
        progress("spheres", len(rows), len(names))
        measured = [_measure(cloud, settings) for cloud in clouds if cloud.sample == number]
        sample_rows, sample_errors = _sample_rows(measured, settings)
        rows += sample_rows
        errors |= sample_errors
    progress("spheres", len(names), len(names))
    if not errors:
        raise FitError(f"no sphere was found in any of {len(names)} clouds; the first: {rows[0]['failure']}")
    return {
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
        "table": _table(rows, errors, settings, [TABLE_THRESHOLD]),
        "curve": _table(rows, errors, settings, settings.thresholds),
    }


def _check(clouds: Sequence[SphereCloud], settings: SphereSettings) -> None:
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


def _measure(cloud: SphereCloud, settings: SphereSettings) -> _Measured:
    try:
        points = read_measured(cloud.path, settings.unit)
        measured = _Measured(cloud, points, METHODS[settings.method](points, settings.radius, settings.seed))
        return _on_the_ball(measured, settings)
    except FitError as error:
        return _Measured(cloud, points, failure=str(error))
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith(str(cloud.path)) else f"{cloud.path}: {text}") from error


def _on_the_ball(measured: _Measured, settings: SphereSettings) -> _Measured:
    """Only those points whose line of sight meets the ball, if it is known where the sensor stands."""
    viewpoint, fit = settings.viewpoints.get(measured.cloud.sensor), measured.fit
    if viewpoint is None or fit is None:
        return measured
    return replace(
        measured, points=measured.points[meets_sphere(measured.points, np.asarray(viewpoint), fit.centre, fit.radius)]
    )


def meets_sphere(
    points: NDArray[np.floating], viewpoint: NDArray[np.floating], centre: NDArray[np.float64], radius: float
) -> NDArray[np.bool_]:
    """Whether the line of sight through each of points (N, 3) meets a sphere.

    Raises
    ------
    ValueError
        If the viewpoint lies inside the sphere.
    """
    towards = centre - viewpoint
    distance = float(np.linalg.norm(towards))
    if distance <= radius:
        raise ValueError(f"the viewpoint {np.round(viewpoint, 1).tolist()} mm lies inside the fitted sphere")
    rays = points - viewpoint
    cosine = (rays @ towards) / (np.linalg.norm(rays, axis=1) * distance + 1e-12)
    return np.asarray(cosine >= np.sqrt(1 - (radius / distance) ** 2))


def _sample_rows(
    measured: Sequence[_Measured], settings: SphereSettings
) -> tuple[list[dict[str, Any]], dict[str, NDArray[np.float32]]]:
    """One row per reconstruction and the signed errors by name, of one placed ball."""
    fits = {one.cloud.sensor: one.fit for one in measured if one.fit is not None}
    shifts = {
        one.cloud.sensor: part_shifts(one.points, one.fit, SphereParameters(seed=settings.seed))
        for one in measured
        if one.fit is not None
    }
    reasons = exclusion_reasons(fits, shifts)
    rows, errors = [], {}
    for one in measured:
        name, why = one.cloud.name, reasons.get(one.cloud.sensor, [])
        is_excluded = bool(one.failure) or name in settings.drop or (bool(why) and name not in settings.keep)
        if name in settings.drop:
            why = [*why, "left out on request"]
        rows.append(_row(one, why, is_excluded, shifts.get(one.cloud.sensor)))
        if one.fit is not None:
            errors[name] = one.fit.errors(one.points)
    return rows, errors


def _row(
    one: _Measured, reasons: Sequence[str], is_excluded: bool, shifts: tuple[float, float] | None
) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": one.cloud.name,
        "sample": one.cloud.sample,
        "sensor": one.cloud.sensor,
        "file": str(one.cloud.path),
        "n_points": len(one.points),
        "failure": one.failure,
        "is_excluded": is_excluded,
        "reasons": list(reasons),
    }
    if one.fit is None or shifts is None:
        return row
    errors = one.fit.errors(one.points)
    return row | {
        "centre_mm": [round(float(value), 4) for value in one.fit.centre],
        "free_radius_mm": one.fit.free_radius,
        "scale_mm": one.fit.scale,
        "coverage": one.fit.coverage,
        "surface_share": one.fit.surface_share,
        "sector_shift_mm": shifts[0],
        "ring_shift_mm": shifts[1],
        "median_error_mm": float(np.median(errors)),
        "rms_inliers_mm": _rms(errors[np.abs(errors) <= TABLE_THRESHOLD]),
        "inliers": float(np.mean(np.abs(errors) <= TABLE_THRESHOLD)),
    }


def _rms(errors: NDArray[np.float32]) -> float | None:
    return float(np.sqrt(np.mean(errors.astype(np.float64) ** 2))) if len(errors) else None


def _table(
    rows: Sequence[Mapping[str, Any]],
    errors: Mapping[str, NDArray[np.float32]],
    settings: SphereSettings,
    thresholds: Sequence[float],
) -> list[dict[str, Any]]:
    """Inlier and outlier ratios per sensor and combined, of all reconstructions and without the excluded ones.

    Combined are the errors of all sensors' points to the sphere that suits them together, so that sensors that do
    not agree on the ball's place count as errors. The ratio is the mean over samples, each counting alike; its
    interval is the percentile bootstrap over samples.
    """
    curves = {name: inlier_curve(values, thresholds) for name, values in errors.items()}
    joined = _combined(rows, errors, settings)
    table = []
    for subset in ("used", "all"):
        used = [row for row in rows if row["name"] in curves and (subset == "all" or not row["is_excluded"])]
        groups = {sensor: [row for row in used if row["sensor"] == sensor] for sensor in {r["sensor"]: 0 for r in rows}}
        per_group = {sensor: [curves[row["name"]] for row in group] for sensor, group in groups.items()}
        per_group[COMBINED] = [inlier_curve(values, thresholds) for values in joined[subset]]
        for group, ratios in per_group.items():
            table += _group_rows(subset, group, ratios, thresholds, settings.seed)
    return table


def _combined(
    rows: Sequence[Mapping[str, Any]], errors: Mapping[str, NDArray[np.float32]], settings: SphereSettings
) -> dict[str, list[NDArray[np.float32]]]:
    """Per subset, the errors of each sample's points to one sphere."""
    joined: dict[str, list[NDArray[np.float32]]] = {"used": [], "all": []}
    for number in sorted({row["sample"] for row in rows}):
        fitted = [row for row in rows if row["sample"] == number and row["name"] in errors]
        used = [row for row in fitted if not row["is_excluded"]]
        of_all = _joint_errors(fitted, errors, settings)
        joined["all"] += of_all
        joined["used"] += of_all if len(used) == len(fitted) else _joint_errors(used, errors, settings)
    return joined


def _joint_errors(
    rows: Sequence[Mapping[str, Any]], errors: Mapping[str, NDArray[np.float32]], settings: SphereSettings
) -> list[NDArray[np.float32]]:
    if len(rows) < 2:
        return [errors[row["name"]] for row in rows]
    points = [_counted(row, settings) for row in rows]
    parameters = SphereParameters(seed=settings.seed)
    start = np.median([row["centre_mm"] for row in rows], axis=0)
    even = np.concatenate([subsample(cloud, settings.seed) for cloud in points])
    try:
        fit = refine_sphere(even, start, settings.radius, parameters)
    except FitError:  # the sensors do not agree on one sphere: their points are judged from the middle of their centres
        centred = [cloud - start.astype(np.float32) for cloud in points]
        return [np.concatenate([np.linalg.norm(c, axis=1) - np.float32(settings.radius) for c in centred])]
    return [np.concatenate([fit.errors(cloud) for cloud in points])]


def _counted(row: Mapping[str, Any], settings: SphereSettings) -> NDArray[np.float32]:
    """The points of a reconstruction that its errors are of."""
    points, viewpoint = read_measured(Path(row["file"]), settings.unit), settings.viewpoints.get(row["sensor"])
    if viewpoint is None:
        return points
    return points[meets_sphere(points, np.asarray(viewpoint), np.asarray(row["centre_mm"]), settings.radius)]


def _group_rows(
    subset: str, group: str, ratios: Sequence[NDArray[np.float64]], thresholds: Sequence[float], seed: int
) -> list[dict[str, Any]]:
    if not ratios:
        return []
    curves = np.stack(ratios)  # (samples, thresholds)
    drawn = np.random.default_rng(seed).integers(0, len(curves), (N_REPLICATES, len(curves)))
    low, high = np.percentile(curves[drawn].mean(axis=1), (2.5, 97.5), axis=0)
    has_interval = len(curves) > 1
    return [
        {
            "subset": subset,
            "sensor": group,
            "threshold_mm": float(threshold),
            "n_samples": len(curves),
            "inliers": float(curves[:, t].mean()),
            "outliers": 1 - float(curves[:, t].mean()),
            "ci_low": float(low[t]) if has_interval else None,
            "ci_high": float(high[t]) if has_interval else None,
        }
        for t, threshold in enumerate(thresholds)
    ]
