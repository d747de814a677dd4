"""Reconstructions of a placed ball: each read and fitted once, then all of them against one sphere."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import CloudFile, FitError, read_measured
from recon.validation.measures import TABLE_THRESHOLD, inlier_ratios, inlier_rms
from recon.validation.sampling import subsample
from recon.validation.sphere.cells import cap_of
from recon.validation.sphere.error_sources import CellErrors, cell_errors
from recon.validation.sphere.exclusion import Parts, examine_parts, part_limits
from recon.validation.sphere.fit.methods import METHODS
from recon.validation.sphere.fit.model import SphereFit, SphereSettings, surface_share
from recon.validation.sphere.fit.refinement import refine_sphere
from recon.validation.sphere.uncertainty import Uncertainty, fit_uncertainty
from recon.validation.sphere.visibility import meets_sphere, missing_share


def _no_points() -> NDArray[np.float32]:
    return np.zeros((0, 3), np.float32)


@dataclass(frozen=True, eq=False)
class MeasuredSphere:
    """One reconstruction of a placed ball, and what its fit says of it.

    Parameters
    ----------
    file : where it comes from
    n_points : how many of its points count
    fit : the sphere; None where there is none, and `failure` says why
    parts : what the parts of its surface say about the fit
    ratios : float64 (1 + T,), from `inlier_ratios`
    uncertainty : of the fit's numbers; None where there are too few points to tell
    errors_by_cell : to tell calibration from matching
    columns : numbers of the fit in the report
    points : float32 (N, 3), mm, all that the file holds; empty once nothing needs them
    counted : float32 (M, 3), mm, those whose errors count; empty once nothing needs them
    """

    file: CloudFile
    n_points: int
    fit: SphereFit | None = None
    parts: Parts | None = None
    ratios: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    uncertainty: Uncertainty | None = None
    errors_by_cell: CellErrors | None = None
    columns: Mapping[str, Any] = field(default_factory=dict)
    points: NDArray[np.float32] = field(default_factory=_no_points)
    counted: NDArray[np.float32] = field(default_factory=_no_points)
    failure: str = ""

    def without_points(self) -> MeasuredSphere:
        return replace(self, points=_no_points(), counted=_no_points())

    def with_points(self, settings: SphereSettings) -> MeasuredSphere:
        """Return the reconstruction with its points, read again if they were let go."""
        if self.fit is None or len(self.points):
            return self
        points = read_measured(self.file.path, settings.unit)
        return replace(self, points=points, counted=_counted(points, self.fit, self.file, settings))


def fitted(results: Iterable[MeasuredSphere]) -> list[MeasuredSphere]:
    """Return the reconstructions in which a sphere was found."""
    return [result for result in results if result.fit is not None]


def measure_reconstruction(file: CloudFile, settings: SphereSettings) -> MeasuredSphere:
    """Read a cloud, fit its sphere, and examine the parts of its surface.

    A ValueError says that the file cannot be read or measured; that it holds no sphere is a result.
    """
    try:
        points = counted = read_measured(file.path, settings.unit)
        fit, missing = METHODS[settings.method](points, settings.radius, settings.seed), None
        if file.sensor in settings.viewpoints:
            counted = _counted(points, fit, file, settings)
            fit = replace(fit, surface_share=surface_share(counted, fit))
            viewpoint = np.asarray(settings.viewpoints[file.sensor])
            missing = missing_share(counted, viewpoint, fit.centre, fit.radius)
        sample = subsample(counted, settings.seed)
        cap = cap_of(sample, fit)
        parts, uncertainty = examine_parts(cap, fit), fit_uncertainty(sample, fit, cap, settings.seed)
    except FitError as error:
        return MeasuredSphere(file, len(counted), failure=str(error))
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith(str(file.path)) else f"{file.path}: {text}") from error
    errors = fit.errors(counted)
    return MeasuredSphere(
        file,
        len(counted),
        fit,
        parts,
        ratios=inlier_ratios(errors, settings.thresholds),
        uncertainty=uncertainty,
        errors_by_cell=cell_errors(cap, fit),
        columns=_columns(fit, parts, errors, missing) | ({} if uncertainty is None else uncertainty.columns()),
        points=points,
        counted=counted,
    )


def _counted(
    points: NDArray[np.float32], fit: SphereFit, file: CloudFile, settings: SphereSettings
) -> NDArray[np.float32]:
    """Return the points (M, 3) whose errors count: all, or those on lines of sight that meet the ball."""
    if file.sensor not in settings.viewpoints:
        return points
    return points[meets_sphere(points, np.asarray(settings.viewpoints[file.sensor]), fit.centre, fit.radius)]


def combined_ratios(spheres: Sequence[MeasuredSphere], settings: SphereSettings) -> list[NDArray[np.float64]]:
    """Return the inlier ratios (1 + T,) of all points of one placed ball against one sphere; none without a sphere.

    Sensors that do not agree on the ball's place count as errors.
    """
    if len(spheres) < 2:
        return [sphere.ratios for sphere in spheres]
    return [inlier_ratios(_combined_errors(spheres, settings), settings.thresholds)]


def _combined_errors(spheres: Sequence[MeasuredSphere], settings: SphereSettings) -> NDArray[np.float32]:
    """Return the errors (N,) of all points to the sphere that suits them together; each sensor weighs about as much.

    Where no sphere suits them, the errors are to the one in the middle of the sensors' centres.
    """
    clouds = [sphere.counted for sphere in spheres]
    middle = np.median([sphere.columns["centre_mm"] for sphere in spheres], axis=0)
    even = np.concatenate([subsample(cloud, settings.seed) for cloud in clouds])
    try:
        fit = refine_sphere(even, middle, settings.radius, subsample(even, settings.seed))
    except FitError:
        offsets = [cloud - middle.astype(np.float32) for cloud in clouds]
        return np.concatenate([np.linalg.norm(offset, axis=1) - np.float32(settings.radius) for offset in offsets])
    return np.concatenate([fit.errors(cloud) for cloud in clouds])


def _columns(fit: SphereFit, parts: Parts, errors: NDArray[np.float32], missing: float | None) -> dict[str, Any]:
    """Return the numbers of a fit in the report's words."""
    is_inlier = np.abs(errors) <= TABLE_THRESHOLD
    return {
        "centre_mm": [round(float(value), 4) for value in fit.centre],
        "free_radius_mm": fit.free_radius,
        "scale_mm": fit.scale,
        "coverage": fit.coverage,
        "surface_share": fit.surface_share,
        "missing_share": missing,
        **{f"{name}_limit_mm": limit for name, limit in part_limits(fit).items()},
        "sector_shift_mm": parts.sector_shift,
        "ring_shift_mm": parts.ring_shift,
        "coherent_error_mm": parts.coherent_error,
        "median_error_mm": float(np.median(errors)),
        "rms_inliers_mm": inlier_rms(errors),
        "inliers": float(np.mean(is_inlier)),
    }
