"""Tables of an evaluation on spheres: inlier ratios per sensor and of all sensors against one sphere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import FitError, read_measured
from recon.validation.curves import COMBINED, group_rows, inlier_curve
from recon.validation.sampling import subsample
from recon.validation.sphere.methods import SphereSettings
from recon.validation.sphere.model import SphereParameters
from recon.validation.sphere.refinement import refine_sphere
from recon.validation.sphere.visibility import meets_sphere


def sphere_table(
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
            table += group_rows(subset, group, ratios, thresholds, settings.seed)
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
