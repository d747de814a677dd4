"""Checks that a fit is a sphere of the known radius: a wrong one is never a result."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import FINEST
from recon.validation.clouds import FitError
from recon.validation.sampling import fibonacci_sphere
from recon.validation.sphere.fit.model import SphereFit

MIN_SHARE = 0.3  # of the points around a sphere; in evenly filled space 0.15 of them would lie on it
MIN_COVERAGE = 0.04  # of the whole sphere's directions: a cap of 46 degrees
MIN_DEPTH = 6.0  # of the cap, in standard deviations of its points; walls and clutter reach 3.5, balls 10
MAX_RADIUS_ERROR = 0.12  # share by which the radius that suits the points best may differ
MAX_STRETCH = 0.12  # of the radius, for bending more along one direction than another; cylinders reach 0.25 to 0.5
ONE_SIDED = 0.4  # length of the mean direction, 0.5 for a hemisphere; below, bending is tested along all three axes
MAX_SCALE = 0.07  # of the radius, for the points' scatter; points that follow no surface reach 0.12
N_DIRECTIONS = 400


def check_fit(fit: SphereFit) -> None:
    """Refuse, by a FitError with the number that is off, a fit whose numbers are not those of a ball."""
    at = f"at {np.round(fit.centre, 1).tolist()} mm"
    if fit.surface_share < MIN_SHARE:
        raise FitError(f"{at} only {fit.surface_share:.0%} of the points around it lie on it, not {MIN_SHARE:.0%}")
    if fit.coverage < MIN_COVERAGE:
        raise FitError(f"{at} the points cover {fit.coverage:.1%} of the sphere, expected at least {MIN_COVERAGE:.0%}")
    if fit.scale > MAX_SCALE * fit.radius:
        raise FitError(f"{at} the points scatter by {fit.scale:.3g} mm, as if there were no surface")
    depth = 2 * fit.coverage * fit.radius  # of a cap that covers this share of a sphere
    if depth < MIN_DEPTH * fit.scale:
        raise FitError(f"{at} the points scatter by {fit.scale:.3g} mm, too much for a cap {depth:.3g} mm deep")
    if not abs(fit.free_radius / fit.radius - 1) <= MAX_RADIUS_ERROR:
        raise FitError(f"{at} the surface has a radius of about {fit.free_radius:.4g} mm, not {fit.radius:g} mm")


def check_precision(fit: SphereFit) -> None:
    """Refuse, by a ValueError, a ball so far from the origin that single precision blurs its surface."""
    step = float(np.spacing(np.float32(np.abs(fit.centre).max())))
    if step * FINEST > fit.radius:
        raise ValueError(
            f"the ball is at {np.round(fit.centre, 1).tolist()} mm, where single precision has steps of {step:.3g} mm: "
            "too far away to be measured; move the cloud near the origin"
        )


def check_bending(offsets: NDArray[np.floating], fit: SphereFit) -> None:
    """Refuse, by a FitError, a fit whose surface bends more along one direction than another.

    The surface's points have offsets (N, 3) from the centre.
    """
    stretch = _stretch(offsets, fit.radius)
    if stretch > MAX_STRETCH * fit.radius:
        raise FitError(
            f"at {np.round(fit.centre, 1).tolist()} mm the surface bends by {stretch:.3g} mm more along one direction "
            "than along another: a cylinder or an edge, no sphere"
        )


def coverage(offsets: NDArray[np.floating]) -> float:
    """Return the share of the directions from a sphere's centre in which offsets (N, 3) lie."""
    from scipy.spatial import cKDTree

    offsets = offsets[:: max(1, len(offsets) // 8000)]
    unit = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    _, cells = cKDTree(fibonacci_sphere(N_DIRECTIONS)).query(unit)
    counts = np.bincount(cells, minlength=N_DIRECTIONS)
    return float(np.mean(counts > 0.1 * counts[counts > 0].mean()))


def _stretch(offsets: NDArray[np.floating], radius: float) -> float:
    """Return how much more the surface at offsets (N, 3) from the centre bends along one direction than another, mm.

    The errors are explained by another radius, a moved centre and quadratic forms of the direction; the result is the
    largest coefficient of these forms. On a cap only the two forms across it can be told from radius and centre.
    """
    offsets = offsets[:: max(1, len(offsets) // 4000)].astype(np.float64)
    distances = np.linalg.norm(offsets, axis=1)
    directions, errors = offsets / distances[:, None], distances - radius
    x, y, z = (directions @ np.linalg.eigh(_moments(directions))[1]).T
    forms = [x * x - y * y, 2 * x * y] + (
        [2 * x * z, 2 * y * z, z * z] if np.linalg.norm(directions.mean(axis=0)) < ONE_SIDED else []
    )
    terms = np.column_stack([np.ones_like(x), x, y, z, *forms])
    weights = np.ones(len(errors))
    for _ in range(5):
        weighted = terms * weights[:, None]
        solution = np.linalg.lstsq(weighted.T @ weighted, weighted.T @ (errors * weights), rcond=None)[0]
        left = np.abs(errors - terms @ solution)
        weights = np.sqrt(np.clip(1 - (left / max(4.0 * float(np.median(left)), 1e-6)) ** 2, 0, None))
    return float(np.abs(solution[4:]).max())


def _moments(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return minus the scatter (3, 3) across the mean direction, whose last eigenvector is a cap's axis."""
    mean = directions.mean(axis=0)
    across = directions - np.outer(directions @ mean, mean) / max(float(mean @ mean), 1e-12)
    return np.asarray(-across.T @ across)
