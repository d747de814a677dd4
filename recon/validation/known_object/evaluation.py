"""The evaluation on an object of any known shape: its mesh is registered to a cloud, and distances to it measured."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import transformed
from recon.runtime.files import naming
from recon.validation.clouds import read_measured, read_shape, unit_mm
from recon.validation.known_object.registration import Placement, RegistrationParameters, place_model
from recon.validation.measures import (
    COMBINED,
    LESS,
    TABLE_THRESHOLD,
    Subject,
    check_thresholds,
    inlier_measures,
    inlier_ratios,
    inlier_rms,
    inlier_tables,
    measure_rows,
)
from recon.validation.triangles import TriangleTree

PERCENTILES = (5, 25, 50, 75, 95)


@dataclass(frozen=True)
class ObjectSettings:
    """What is measured, and how.

    Parameters
    ----------
    thresholds : mm, of the inlier curve
    registration : how the model is looked for
    unit, model_unit : of the cloud's and of the model's coordinates
    subject : what the cloud shows, in a study's words
    """

    thresholds: tuple[float, ...]
    registration: RegistrationParameters = field(default_factory=RegistrationParameters)
    unit: str = "mm"
    model_unit: str = "mm"
    subject: Subject = field(default_factory=Subject)


@dataclass(frozen=True, eq=False)
class MeasuredObject:
    """A cloud in the model's frame, for the report's pictures.

    Parameters
    ----------
    points : float64 (N, 3), mm
    errors : float64 (N,), mm, signed, to the model's surface
    """

    points: NDArray[np.float64]
    errors: NDArray[np.float64]


def measure_object(model: Path, cloud: Path, settings: ObjectSettings) -> tuple[dict[str, Any], MeasuredObject]:
    """Register a mesh to a cloud and measure the cloud's distances to it.

    Parameters
    ----------
    model, cloud : files of the mesh and of its reconstruction
    settings : what is measured

    Returns
    -------
    report : content of report.json
    measured : what the report's pictures show

    Raises
    ------
    ValueError
        If a file cannot be read, or the model is not found in the cloud.
    """
    check_thresholds(settings.thresholds)
    to_mm = unit_mm(model, settings.model_unit)
    shape = read_shape(model)
    if not len(shape.faces):
        raise ValueError(f"{model}: has no triangles, expected the mesh of the known object")
    vertices = shape.points.astype(np.float64) * to_mm
    with naming(model):
        tree = TriangleTree(vertices, shape.faces)
    points = read_measured(cloud, settings.unit)
    try:
        placement = place_model(vertices, shape.faces, points, settings.registration)
    except ValueError as error:
        raise type(error)(f"{cloud}: {error}") from error
    moved = transformed(points, np.linalg.inv(placement.cloud_from_model))
    errors = tree.nearest(moved).signed
    return _report(model, cloud, placement, errors, settings), MeasuredObject(moved, errors)


def _report(
    model: Path, cloud: Path, placement: Placement, errors: NDArray[np.float64], settings: ObjectSettings
) -> dict[str, Any]:
    groups = {("all", COMBINED): [inlier_ratios(errors, settings.thresholds)]}
    table, curve = inlier_tables(groups, settings.thresholds, settings.registration.seed)
    rms = inlier_rms(errors)
    return {
        "schema_version": 1,
        "kind": "object",
        "settings": {
            "model": str(model),
            "cloud": str(cloud),
            "thresholds_mm": list(settings.thresholds),
            "table_threshold_mm": TABLE_THRESHOLD,
            "unit": settings.unit,
            "model_unit": settings.model_unit,
            "trim": settings.registration.trim,
            "seed": settings.registration.seed,
        },
        "registration": {
            "cloud_from_model": placement.cloud_from_model.tolist(),
            "overlap": placement.overlap,
            "delta_mm": placement.delta,
            "rms_mm": placement.rms,
            "steps": placement.steps,
            "is_ambiguous": bool(placement.rivals),
            "rivals": [rival.tolist() for rival in placement.rivals],
        },
        "n_points": len(errors),
        "errors": {
            "mean_mm": float(errors.mean()),
            "rms_inliers_mm": rms,
            **{f"p{share}_mm": float(np.percentile(errors, share)) for share in PERCENTILES},
        },
        "table": table,
        "curve": curve,
        "measures": [
            *inlier_measures("object", table, settings.subject),
            *measure_rows(settings.subject, "object error", rms, direction=LESS, unit="mm"),
        ],
    }
