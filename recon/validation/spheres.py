"""The paper's evaluation on spheres: many placed balls, several sensors, what they say together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.execute import Progress, silent
from recon.validation.curves import N_REPLICATES, TABLE_THRESHOLD, table_measures
from recon.validation.exclusion import Parts, examine_parts, exclusion_reasons
from recon.validation.measured import FitError, MeasuredCloud, read_measured
from recon.validation.sphere import SphereFit, SphereParameters
from recon.validation.sphere_methods import METHODS, SphereSettings
from recon.validation.sphere_tables import meets_sphere, sphere_table


@dataclass(frozen=True, eq=False)
class _Measured:
    cloud: MeasuredCloud
    points: NDArray[np.float32]
    fit: SphereFit | None = None
    failure: str = ""


def measure_spheres(
    clouds: Sequence[MeasuredCloud], settings: SphereSettings, progress: Progress = silent
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


def _sample_rows(
    measured: Sequence[_Measured], settings: SphereSettings
) -> tuple[list[dict[str, Any]], dict[str, NDArray[np.float32]]]:
    """One row per reconstruction and the signed errors by name, of one placed ball."""
    fits = {one.cloud.sensor: one.fit for one in measured if one.fit is not None}
    parts = {
        one.cloud.sensor: examine_parts(one.points, one.fit, SphereParameters(seed=settings.seed))
        for one in measured
        if one.fit is not None
    }
    reasons = exclusion_reasons(fits, parts)
    rows, errors = [], {}
    for one in measured:
        name, why = one.cloud.name, reasons.get(one.cloud.sensor, [])
        is_excluded = bool(one.failure) or name in settings.drop or (bool(why) and name not in settings.keep)
        if name in settings.drop:
            why = [*why, "left out on request"]
        rows.append(_row(one, why, is_excluded, parts.get(one.cloud.sensor)))
        if one.fit is not None:
            errors[name] = one.fit.errors(one.points)
    return rows, errors


def _row(one: _Measured, reasons: Sequence[str], is_excluded: bool, parts: Parts | None) -> dict[str, Any]:
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
    if one.fit is None or parts is None:
        return row
    errors = one.fit.errors(one.points)
    return row | {
        "centre_mm": [round(float(value), 4) for value in one.fit.centre],
        "free_radius_mm": one.fit.free_radius,
        "scale_mm": one.fit.scale,
        "coverage": one.fit.coverage,
        "surface_share": one.fit.surface_share,
        "sector_shift_mm": parts.sector_shift,
        "ring_shift_mm": parts.ring_shift,
        "coherent_error_mm": parts.coherent_error,
        "median_error_mm": float(np.median(errors)),
        "rms_inliers_mm": _rms(errors[np.abs(errors) <= TABLE_THRESHOLD]),
        "inliers": float(np.mean(np.abs(errors) <= TABLE_THRESHOLD)),
    }


def _rms(errors: NDArray[np.float32]) -> float | None:
    return float(np.sqrt(np.mean(errors.astype(np.float64) ** 2))) if len(errors) else None
