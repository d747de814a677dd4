"""The search for a sphere of known radius in a cloud that may hold anything else besides.

Source: the paper, section 3.1 (signed error to the known radius, outlier ratio against a threshold). The fit is a
consensus of spheres through three points, then Gauss-Newton steps with Tukey's weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import UNITS_MM, FitError, checked_points
from recon.validation.sampling import first_in_cells, subsample, thinned
from recon.validation.sphere.kernels import local_consensus
from recon.validation.sphere.model import SphereFit, SphereParameters, band_of
from recon.validation.sphere.refinement import refine_sphere

CELL_SHARE = 1 / 12  # of the radius: one point a cell is searched, so that dense walls count by their area
SEED_SHARE = 0.6  # of the radius: spacing of the points that spheres are tried through
N_CANDIDATES = 8
RIVAL = 0.5  # of the best sphere's score: from there on another one counts as a second ball
APART = 1.5  # times the radius: centres farther apart are two balls, which cannot be nearer than twice the radius
WIDE = 2.2  # radii; a ball by itself extends over two


class TwoSpheresError(FitError):
    """A cloud holds more than one sphere of the radius."""


def fit_sphere(points: NDArray[np.floating], radius: float, parameters: SphereParameters | None = None) -> SphereFit:
    """Find the one sphere of a known radius in a cloud.

    Parameters
    ----------
    points : floating (N, 3), mm; anything else may be in the cloud besides the sphere
    radius : mm

    Raises
    ------
    ValueError
        If the radius is not positive, there are too few points, or a coordinate is not a number.
    FitError
        If no sphere of this radius is there, or two are. The message says what was found instead.
    """
    points, parameters = checked_points(points, radius, "radius"), parameters or SphereParameters()
    sample = subsample(points, parameters.seed)
    try:
        return _fit(points, sample, radius, parameters)
    except TwoSpheresError:
        raise
    except FitError as error:
        raise with_fitting_unit(error, points, radius, parameters) from error


def check_alone(points: NDArray[np.float32], fit: SphereFit, parameters: SphereParameters) -> None:
    """Refuse a sphere if the cloud holds another one that is about as good.

    Parameters
    ----------
    points : float32 (N, 3), mm
    fit : the sphere
    parameters : of the search for others

    Raises
    ------
    TwoSpheresError
        If there is another one.
    """
    even = thinned(subsample(points, parameters.seed), CELL_SHARE * fit.radius)
    spheres, _ = _good_spheres(even, fit.radius, parameters)
    _check_single([fit, *(other for other in spheres if _are_apart(fit, other))])


def with_fitting_unit(
    error: FitError, points: NDArray[np.float32], radius: float, parameters: SphereParameters
) -> FitError:
    """Return the error that no sphere was found, with the unit in which there would be one, if there is such a unit.

    Parameters
    ----------
    error : of the search
    points : float32 (N, 3), mm
    radius : mm
    parameters : of the search
    """
    unit = _fitting_unit(subsample(points, parameters.seed), radius, parameters)
    return FitError(f"{error}; it would fit if the cloud were in {unit}: say so with --unit {unit}") if unit else error


def _fit(
    points: NDArray[np.float32], sample: NDArray[np.float32], radius: float, parameters: SphereParameters
) -> SphereFit:
    spheres, reasons = _good_spheres(thinned(sample, CELL_SHARE * radius), radius, parameters)
    if not spheres:
        extent = " x ".join(f"{length:.3g}" for length in np.ptp(sample, axis=0))
        best = f"; the best candidate: {reasons[0]}" if reasons else ""
        raise FitError(f"no sphere of radius {radius:g} mm in a cloud of {extent} mm{best}")
    _check_single(spheres)
    return refine_sphere(points, spheres[0].centre, radius, parameters, sample)


def _check_single(spheres: Sequence[SphereFit]) -> None:
    if len(spheres) > 1:
        places = " and ".join(str(np.round(fit.centre, 1).tolist()) for fit in spheres[:2])
        raise TwoSpheresError(
            f"two spheres of radius {spheres[0].radius:g} mm, at {places} mm: cut the cloud so that it holds one"
        )


def _are_apart(fit: SphereFit, other: SphereFit) -> bool:
    return bool(np.linalg.norm(fit.centre - other.centre) > APART * fit.radius)


def _good_spheres(
    even: NDArray[np.float32], radius: float, parameters: SphereParameters
) -> tuple[list[SphereFit], list[str]]:
    """Return the spheres in an even cloud that are about as good as the best, and why other candidates are none."""
    spheres: list[SphereFit] = []
    reasons: list[str] = []
    least = 0.0
    for centre, score in _candidates(even, radius, parameters):
        if score < least or any(np.linalg.norm(centre - fit.centre) < APART * radius for fit in spheres):
            continue
        try:
            fit = refine_sphere(even, centre, radius, parameters, even)
        except FitError as error:
            reasons.append(str(error))
            continue
        if all(_are_apart(fit, other) for other in spheres):
            least = least or RIVAL * score
            spheres.append(fit)
    return spheres, reasons


def _candidates(
    even: NDArray[np.float32], radius: float, parameters: SphereParameters
) -> list[tuple[NDArray[np.float64], float]]:
    """Return the centres and scores of the most promising spheres, best first, from points that are evenly spread."""
    even = even.astype(np.float64)
    seeds = first_in_cells(even, SEED_SHARE * radius)
    band = band_of(radius, parameters)
    centres, scores = local_consensus(even, seeds, radius, band, parameters.n_trials, parameters.seed)
    chosen: list[tuple[NDArray[np.float64], float]] = []
    for index in np.argsort(-scores, kind="stable"):
        if not scores[index] > 0 or len(chosen) == N_CANDIDATES:
            break
        if all(np.linalg.norm(centres[index] - other) > radius / 2 for other, _ in chosen):
            chosen.append((centres[index], float(scores[index])))
    return chosen


def _fitting_unit(sample: NDArray[np.float32], radius: float, parameters: SphereParameters) -> str | None:
    """Return the unit in which the cloud would hold a sphere of the radius, if there is one."""
    if np.ptp(sample, axis=0).min() > WIDE * radius:  # larger than a ball already
        return None
    for unit, length in UNITS_MM.items():
        if length == 1.0:
            continue
        scaled = sample * np.float32(length)
        try:
            _fit(scaled, scaled, radius, replace(parameters, n_trials=32))
        except FitError:
            continue
        return unit
    return None
