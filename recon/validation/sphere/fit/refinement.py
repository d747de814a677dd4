"""The refinement of a sphere of known radius: Gauss-Newton steps with Tukey's weights from a centre that is near."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recon.validation.clouds import MIN_POINTS, FitError
from recon.validation.sphere.fit.kernels import signed_errors, tukey_sums
from recon.validation.sphere.fit.model import CUTOFF, SphereFit, band_of
from recon.validation.sphere.fit.plausibility import check_bending, check_fit, coverage

FINAL_STEPS = 1  # over all points
MAX_STEPS = 60
STEP_MM = 1e-3
SMALL_SHARE = 0.05  # of the points' scatter; a last step that is shorter moves the centre by nothing that matters
SMALLEST_SCALE = 1e-6  # of the radius: a perfect cloud still gets a cutoff
NEAR = 1.5  # times the radius: what lies around a sphere


def refine_sphere(
    points: NDArray[np.float32], centre: NDArray[np.float64], radius: float, sample: NDArray[np.float32]
) -> SphereFit:
    """Return the sphere near `centre` that suits the points best, checked for plausibility.

    Parameters
    ----------
    points : float32 (N, 3), mm
    centre : float64 (3,), mm, to start from
    radius : mm
    sample : float32 (M, 3), mm, of the points; most steps use it

    Raises
    ------
    FitError
        If the steps do not converge or what they reach is not a sphere of this radius.
    """
    band = band_of(radius)
    centre, scale = _converged(sample, centre, radius)
    if len(points) > len(sample):
        for _ in range(FINAL_STEPS):
            centre = _step(points, centre, radius, CUTOFF * scale)
    errors = signed_errors(sample, centre, radius)
    on_surface = np.abs(errors) < max(band, CUTOFF * scale)
    near = errors < (NEAR - 1) * radius
    if np.count_nonzero(on_surface) < MIN_POINTS:
        raise FitError(f"only {np.count_nonzero(on_surface)} points lie on it, expected at least {MIN_POINTS}")
    fit = SphereFit(
        centre=centre,
        radius=radius,
        free_radius=_free_radius(sample, centre, radius, scale),
        scale=scale,
        coverage=coverage(sample[on_surface] - centre),
        surface_share=float(np.count_nonzero(on_surface) / np.count_nonzero(near)),
    )
    check_fit(fit)
    check_bending(sample[np.abs(errors) < 2 * band] - centre, fit)
    return fit


def moved_centre(points: NDArray[np.float32], fit: SphereFit) -> NDArray[np.float64]:
    """Return the centre (3,), mm, to which other points (N, 3), mm, move a fit that keeps its cutoff.

    A FitError says that the points do not determine it.
    """
    centre = fit.centre
    for _ in range(MAX_STEPS):
        moved = _step(points, centre, fit.radius, CUTOFF * fit.scale)
        change, centre = float(np.linalg.norm(moved - centre)), moved
        if change < STEP_MM:
            break
    return centre


def _converged(
    sample: NDArray[np.float32], centre: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], float]:
    """Return the centre and the inliers' scale; each step estimates the scale anew."""
    band = band_of(radius)
    for step in range(1, MAX_STEPS + 1):
        errors = np.abs(signed_errors(sample, centre, radius))
        inliers = errors[errors < 2 * band]
        if len(inliers) < MIN_POINTS:
            raise FitError(f"only {len(inliers)} points lie near it, expected at least {MIN_POINTS}")
        scale = max(1.4826 * float(np.median(inliers)), SMALLEST_SCALE * radius)
        cutoff = max(CUTOFF * scale, band if step <= 3 else 0.0)
        moved = _step(sample, centre, radius, cutoff)
        change = float(np.linalg.norm(moved - centre))
        centre = moved
        if change < STEP_MM and step > 3:
            return centre, scale
    if change < SMALL_SHARE * scale:  # the scale, estimated anew, keeps it from standing still
        return centre, scale
    raise FitError(f"the fit did not converge in {MAX_STEPS} steps; the last moved it by {change:.3g} mm")


def _step(
    points: NDArray[np.float32], centre: NDArray[np.float64], radius: float, cutoff: float
) -> NDArray[np.float64]:
    """Take one Gauss-Newton step of the centre."""
    matrix, right, n = _system(points, centre, radius, cutoff)
    return centre + _solved(matrix[:3, :3], right[:3], n)


def _free_radius(points: NDArray[np.float32], centre: NDArray[np.float64], radius: float, scale: float) -> float:
    """Return the radius that, with its centre, suits the points best; NaN where there is none."""
    free, cutoff = radius, max(CUTOFF * scale, 0.25 * band_of(radius))
    for _ in range(MAX_STEPS):
        matrix, right, n = _system(points, centre, free, cutoff)
        try:
            change = _solved(matrix, right, n)
        except FitError:
            return float("nan")
        centre, free = centre + change[:3], free + float(change[3])
        if not 0.2 * radius < free < 5 * radius:
            return free
        if np.abs(change).max() < 1e-3:
            break
    return free


def _system(
    points: NDArray[np.float32], centre: NDArray[np.float64], radius: float, cutoff: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    sums = tukey_sums(points, centre, radius, cutoff)
    return normal_matrix(sums), sums[10:14], int(sums[14])


def normal_matrix(sums: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normal matrix, float64 (4, 4), of x, y, z and radius from the sums (15,) of `tukey_sums`."""
    matrix = np.zeros((4, 4))
    matrix[np.triu_indices(4)] = sums[:10]
    return matrix + np.triu(matrix, 1).T


def _solved(matrix: NDArray[np.float64], right: NDArray[np.float64], n: int) -> NDArray[np.float64]:
    if n < MIN_POINTS // 2 or np.linalg.cond(matrix) > 1e9:
        raise FitError(f"the {n} points near its surface do not determine where it is")
    return np.asarray(np.linalg.solve(matrix, right))
