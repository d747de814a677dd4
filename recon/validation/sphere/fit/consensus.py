"""The search for a sphere of known radius in a cloud that may hold anything else besides.

Source: the paper, section 3.1 (signed error to the known radius, outlier ratio against a threshold). The fit is a
consensus of spheres through three points, then Gauss-Newton steps with Tukey's weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import FitError, checked_points, hint_at_unit
from recon.validation.sampling import first_in_cells, subsample, thinned
from recon.validation.sphere.fit.kernels import local_consensus
from recon.validation.sphere.fit.model import SphereFit, band_of
from recon.validation.sphere.fit.plausibility import check_precision
from recon.validation.sphere.fit.refinement import refine_sphere

CELL_SHARE = 1 / 12  # of the radius: one point a cell is searched, so that dense walls count by their area
SEED_SHARE = 0.6  # of the radius: spacing of the points that spheres are tried through
N_CANDIDATES = 8
N_TRIALS, N_TRIALS_PER_UNIT = 16, 32  # spheres tried through every seed point
RIVAL = 0.5  # of the best sphere's score: from there on another one counts as a second ball
APART = 1.5  # times the radius: centres farther apart are two balls, which cannot be nearer than twice the radius
OTHER_RADII = (4 / 3, 3 / 4, 3 / 2, 2 / 3, 2, 1 / 2)  # as shares of the radius given; a diameter is twice as long
WIDE = 2.2  # radii; a ball by itself extends over two


class TwoSpheresError(FitError):
    """A cloud holds more than one sphere of the radius."""


def fit_sphere(points: NDArray[np.floating], radius: float, seed: int = 1) -> SphereFit:
    """Find the one sphere of a known radius in a cloud.

    Parameters
    ----------
    points : floating (N, 3), mm; anything else may be in the cloud besides the sphere
    radius : mm
    seed : of the sample and the trials

    Raises
    ------
    ValueError
        If the radius is not positive, there are too few points, or a coordinate is not a number.
    FitError
        If no sphere of this radius is there, or two are. The message says what was found instead.
    """
    points = checked_points(points, radius, "radius")
    try:
        return _fit(points, subsample(points, seed), radius, seed)
    except TwoSpheresError:
        raise
    except FitError as error:
        raise FitError(f"{error}{hint_at_sphere(points, radius, seed)}") from error


def check_alone(points: NDArray[np.float32], fit: SphereFit, seed: int) -> None:
    """Refuse, by a TwoSpheresError, a sphere if the cloud holds another one that is about as good.

    Parameters
    ----------
    points : float32 (N, 3), mm
    fit : the sphere
    seed : of the search for others
    """
    even = thinned(subsample(points, seed), CELL_SHARE * fit.radius)
    spheres, _ = _good_spheres(even, fit.radius, seed)
    _check_single([fit, *(other for other in spheres if _are_apart(fit, other))])


def hint_at_sphere(points: NDArray[np.float32], radius: float, seed: int) -> str:
    """Return the end of the sentence that no sphere was found: the unit, or the radius, of one that is; "" if none is.

    Parameters
    ----------
    points : float32 (N, 3), mm
    radius : mm, that was asked for
    seed : of the search
    """
    sample = subsample(points, seed)
    if np.ptp(sample, axis=0).min() <= WIDE * radius:  # not larger than a ball already
        unit = hint_at_unit(sample, lambda scaled: _fit(scaled, scaled, radius, seed, N_TRIALS_PER_UNIT))
        if unit:
            return unit
    for factor in OTHER_RADII:
        with suppress(FitError):
            fit = _fit(sample, sample, factor * radius, seed, N_TRIALS_PER_UNIT)
            return f"; radius {fit.free_radius:.4g} mm fits, {radius:g} mm was given"
    return ""


def _fit(
    points: NDArray[np.float32], sample: NDArray[np.float32], radius: float, seed: int, n_trials: int = N_TRIALS
) -> SphereFit:
    spheres, reasons = _good_spheres(thinned(sample, CELL_SHARE * radius), radius, seed, n_trials)
    if not spheres:
        extent = " x ".join(f"{length:.3g}" for length in np.ptp(sample, axis=0))
        best = f"; the best candidate: {reasons[0]}" if reasons else ""
        raise FitError(f"no sphere of radius {radius:g} mm in a cloud of {extent} mm{best}")
    _check_single(spheres)
    fit = refine_sphere(points, spheres[0].centre, radius, sample)
    check_precision(fit)
    return fit


def _check_single(spheres: Sequence[SphereFit]) -> None:
    if len(spheres) > 1:
        places = " and ".join(str(np.round(fit.centre, 1).tolist()) for fit in spheres[:2])
        raise TwoSpheresError(
            f"two spheres of radius {spheres[0].radius:g} mm, at {places} mm: cut the cloud so that it holds one"
        )


def _are_apart(fit: SphereFit, other: SphereFit) -> bool:
    return bool(np.linalg.norm(fit.centre - other.centre) > APART * fit.radius)


def _good_spheres(
    even: NDArray[np.float32], radius: float, seed: int, n_trials: int = N_TRIALS
) -> tuple[list[SphereFit], list[str]]:
    """Return the spheres in an even cloud that are about as good as the best, and why other candidates are none."""
    spheres: list[SphereFit] = []
    reasons: list[str] = []
    least = 0.0
    for centre, score in _candidates(even, radius, seed, n_trials):
        if score < least or any(np.linalg.norm(centre - fit.centre) < APART * radius for fit in spheres):
            continue
        try:
            fit = refine_sphere(even, centre, radius, even)
        except FitError as error:
            reasons.append(str(error))
            continue
        if all(_are_apart(fit, other) for other in spheres):
            least = least or RIVAL * score
            spheres.append(fit)
    return spheres, reasons


def _candidates(
    even: NDArray[np.float32], radius: float, seed: int, n_trials: int
) -> list[tuple[NDArray[np.float64], float]]:
    """Return the centres and scores of the most promising spheres, best first, from points that are evenly spread."""
    even = even.astype(np.float64)
    seeds = first_in_cells(even, SEED_SHARE * radius)
    centres, scores = local_consensus(even, seeds, radius, band_of(radius), n_trials, seed)
    chosen: list[tuple[NDArray[np.float64], float]] = []
    for index in np.argsort(-scores, kind="stable"):
        if not scores[index] > 0 or len(chosen) == N_CANDIDATES:
            break
        if all(np.linalg.norm(centres[index] - other) > radius / 2 for other, _ in chosen):
            chosen.append((centres[index], float(scores[index])))
    return chosen
