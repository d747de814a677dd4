"""The paper's evaluation on spheres: many placed balls, several sensors, what they say together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import FitError, MeasuredCloud, read_measured
from recon.validation.curves import N_REPLICATES, TABLE_THRESHOLD, table_measures
from recon.validation.sphere.exclusion import Finding, Parts, examine_parts, findings, missing_remark, usual_parts
from recon.validation.sphere.methods import METHODS, SphereSettings
from recon.validation.sphere.model import SphereFit, SphereParameters, surface_share
from recon.validation.sphere.tables import sphere_table
from recon.validation.sphere.visibility import meets_sphere, missing_share
from recon.workers import Progress, no_progress


@dataclass(frozen=True, eq=False)
class _Measured:
    """One reconstruction after its fit; without one, `failure` says why.

    `missing` is the share of the ball's picture without points, None where nobody says where the sensor stands.
    """

    cloud: MeasuredCloud
    n_points: int
    fit: SphereFit | None = None
    parts: Parts | None = None
    errors: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    missing: float | None = None
    failure: str = ""


def measure_spheres(
    clouds: Sequence[MeasuredCloud], settings: SphereSettings, progress: Progress = no_progress
) -> dict[str, Any]:
    """Fit every reconstruction, apply the exclusion rule, and tabulate errors; the content of report.json.

    Raises
    ------
    ValueError
        If a cloud cannot be read, a setting is wrong, or no sphere is found in any cloud.
    """
    _check(clouds, settings)
    measured: list[_Measured] = []
    for cloud in sorted(clouds, key=lambda cloud: cloud.sample):
        progress("spheres", len(measured), len(clouds))
        measured.append(_measure(cloud, settings))
    progress("spheres", len(clouds), len(clouds))
    errors = {one.cloud.name: one.errors for one in measured if one.fit is not None}
    if not errors:
        raise FitError(f"no sphere was found in any of {len(clouds)} clouds; the first: {measured[0].failure}")
    rows = _rows(measured, settings)
    table = sphere_table(rows, errors, settings, [TABLE_THRESHOLD])
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
        "flagged": [{"name": row["name"], "remarks": row["remarks"]} for row in rows if row["remarks"]],
        "table": table,
        "curve": sphere_table(rows, errors, settings, settings.thresholds),
        "measures": table_measures("sphere", table, settings.subject),
    }


def _check(clouds: Sequence[MeasuredCloud], settings: SphereSettings) -> None:
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


def _measure(cloud: MeasuredCloud, settings: SphereSettings) -> _Measured:
    try:
        points = read_measured(cloud.path, settings.unit)
        fit = METHODS[settings.method](points, settings.radius, settings.seed)
        viewpoint = settings.viewpoints.get(cloud.sensor)
        missing = None
        if viewpoint is not None:
            points = points[meets_sphere(points, np.asarray(viewpoint), fit.centre, fit.radius)]
            fit = replace(fit, surface_share=surface_share(points, fit))
            missing = missing_share(points, np.asarray(viewpoint), fit.centre, fit.radius)
        parts = examine_parts(points, fit, SphereParameters(seed=settings.seed))
        return _Measured(cloud, len(points), fit, parts, fit.errors(points), missing)
    except FitError as error:
        return _Measured(cloud, len(points), failure=str(error))
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith(str(cloud.path)) else f"{cloud.path}: {text}") from error


def _rows(measured: Sequence[_Measured], settings: SphereSettings) -> list[dict[str, Any]]:
    """One row per reconstruction, in the order of the samples."""
    by_sensor: dict[str, list[Parts]] = {}
    for one in measured:
        if one.parts is not None:
            by_sensor.setdefault(one.cloud.sensor, []).append(one.parts)
    usual = {sensor: own for sensor, samples in by_sensor.items() if (own := usual_parts(samples)) is not None}
    rows = []
    for _, group in groupby(measured, key=lambda one: one.cloud.sample):
        sample = list(group)
        fits = {one.cloud.sensor: one.fit for one in sample if one.fit is not None}
        parts = {one.cloud.sensor: one.parts for one in sample if one.parts is not None}
        found = findings(fits, parts, usual)
        rows += [
            _row(one, [*found.get(one.cloud.sensor, []), *missing_remark(one.missing)], settings) for one in sample
        ]
    return rows


def _row(one: _Measured, found: Sequence[Finding], settings: SphereSettings) -> dict[str, Any]:
    name = one.cloud.name
    reasons = [finding.sentence for finding in found if not finding.is_remark]
    row: dict[str, Any] = {
        "name": name,
        "sample": one.cloud.sample,
        "sensor": one.cloud.sensor,
        "file": str(one.cloud.path),
        "n_points": one.n_points,
        "failure": one.failure,
        "is_excluded": bool(one.failure) or name in settings.drop or (bool(reasons) and name not in settings.keep),
        "reasons": [*reasons, *(["left out on request"] if name in settings.drop else [])],
        "remarks": [finding.sentence for finding in found if finding.is_remark],
    }
    if one.fit is None or one.parts is None:
        return row
    parts, errors = one.parts, one.errors
    return row | {
        "centre_mm": [round(float(value), 4) for value in one.fit.centre],
        "free_radius_mm": one.fit.free_radius,
        "scale_mm": one.fit.scale,
        "coverage": one.fit.coverage,
        "surface_share": one.fit.surface_share,
        "missing_share": one.missing,
        "sector_shift_mm": parts.sector_shift,
        "ring_shift_mm": parts.ring_shift,
        "coherent_error_mm": parts.coherent_error,
        "median_error_mm": float(np.median(errors)),
        "rms_inliers_mm": _rms(errors[np.abs(errors) <= TABLE_THRESHOLD]),
        "inliers": float(np.mean(np.abs(errors) <= TABLE_THRESHOLD)),
    }


def _rms(errors: NDArray[np.float32]) -> float | None:
    return float(np.sqrt(np.mean(errors.astype(np.float64) ** 2))) if len(errors) else None
