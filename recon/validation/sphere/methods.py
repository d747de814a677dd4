"""The two ways in which a sphere is found in a cloud, and what is asked of an evaluation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import FitError, checked_points
from recon.validation.measures import Subject
from recon.validation.sampling import fibonacci_sphere
from recon.validation.sphere.consensus import check_alone, fit_sphere, with_fitting_unit
from recon.validation.sphere.model import SphereFit, SphereParameters
from recon.validation.sphere.refinement import refine_sphere
from recon.validation.super4pcs import Super4PCSParameters, super4pcs

MODEL_POINTS = 3000


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
    points, parameters = checked_points(points, radius, "radius"), SphereParameters(seed=seed)
    try:
        fit = refine_sphere(points, _registered(points, radius, seed), radius, parameters)
    except FitError as error:
        raise with_fitting_unit(error, points, radius, parameters) from error
    check_alone(points, fit, parameters)
    return fit


def _registered(points: NDArray[np.float32], radius: float, seed: int) -> NDArray[np.float64]:
    """Where Super4PCS puts the middle of the ideal sphere."""
    model, parameters = radius * fibonacci_sphere(MODEL_POINTS), Super4PCSParameters(delta=radius / 12, seed=seed)
    try:
        return super4pcs(model, points, parameters).cloud_from_model[:3, 3]
    except ValueError as error:
        raise FitError(str(error)) from error


METHODS: dict[str, Callable[[NDArray[np.float32], float, int], SphereFit]] = {
    "robust": fit_robust,
    "super4pcs": fit_super4pcs,
}


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
    subject : what the clouds are of, in a study's words
    seed : of the fit and the bootstrap
    """

    radius: float
    thresholds: tuple[float, ...]
    method: str = "robust"
    unit: str = "mm"
    viewpoints: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    keep: tuple[str, ...] = ()
    drop: tuple[str, ...] = ()
    subject: Subject = field(default_factory=Subject)
    seed: int = 1
