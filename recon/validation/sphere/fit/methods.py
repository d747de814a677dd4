"""The two ways to find a sphere in a cloud."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import FitError, checked_points
from recon.validation.registration.super4pcs import Super4PCSParameters, super4pcs
from recon.validation.sampling import fibonacci_sphere, subsample
from recon.validation.sphere.fit.consensus import check_alone, fit_sphere, hint_at_sphere
from recon.validation.sphere.fit.model import SphereFit
from recon.validation.sphere.fit.plausibility import check_precision
from recon.validation.sphere.fit.refinement import refine_sphere

MODEL_POINTS = 3000


def fit_super4pcs(points: NDArray[np.float32], radius: float, seed: int) -> SphereFit:
    """Register the ideal sphere's points by Super4PCS as in the paper, then refine and raise as `fit_sphere` does.

    Parameters
    ----------
    points : float32 (N, 3), mm
    radius : mm
    seed : of samples and trials
    """
    points = checked_points(points, radius, "radius")
    try:
        fit = refine_sphere(points, _registered(points, radius, seed), radius, subsample(points, seed))
    except FitError as error:
        advice = hint_at_sphere(points, radius, seed) or "; --method robust finds a ball among more else"
        raise FitError(f"{error}{advice}") from error
    check_precision(fit)
    check_alone(points, fit, seed)
    return fit


def _registered(points: NDArray[np.float32], radius: float, seed: int) -> NDArray[np.float64]:
    """Return where Super4PCS puts the middle of the ideal sphere, float64 (3,), mm."""
    model, parameters = radius * fibonacci_sphere(MODEL_POINTS), Super4PCSParameters(delta=radius / 12, seed=seed)
    try:
        return super4pcs(model, points, parameters)[0, :3, 3]
    except ValueError as error:
        raise FitError(str(error)) from error


METHODS: dict[str, Callable[[NDArray[np.float32], float, int], SphereFit]] = {
    "robust": fit_sphere,
    "super4pcs": fit_super4pcs,
}
