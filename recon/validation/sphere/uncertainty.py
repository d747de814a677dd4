"""Standard uncertainties of a fitted sphere's numbers, by a bootstrap over the sectors of its cap.

Errors of neighbouring pixels are alike, so single points must not be drawn: sectors are. On simulated caps whose errors
are alike over 3 to 15 degrees, 85 to 98 % of the 95 % intervals of centre and free radius hold the truth.

What is the same in all sectors is not in it: the calibration, the ball's own form and radius.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit  # scipy.stats takes half a second to import

from recon.validation.measures import TABLE_THRESHOLD, inlier_rms
from recon.validation.sphere.cells import N_SECTORS, Cap, sector_at
from recon.validation.sphere.fit.kernels import tukey_sums
from recon.validation.sphere.fit.model import CUTOFF, SphereFit, band_of
from recon.validation.sphere.fit.refinement import normal_matrix

N_DRAWS = 200  # of sectors; they tell a standard uncertainty to a twentieth of it
MIN_SECTORS = 4
CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard uncertainties of one fit's numbers.

    Parameters
    ----------
    centre_covariance : float64 (3, 3), mm^2
    free_radius, median_error, scale, rms_inliers : mm
    inliers : share
    n_sectors : that hold points
    """

    centre_covariance: NDArray[np.float64]
    free_radius: float
    median_error: float
    scale: float
    rms_inliers: float
    inliers: float
    n_sectors: int

    def columns(self) -> dict[str, object]:
        """Return the numbers in the report's words."""
        return {
            "u_centre_mm": [round(float(u), 4) for u in np.sqrt(np.diag(self.centre_covariance))],
            "u_free_radius_mm": self.free_radius,
            "u_median_error_mm": self.median_error,
            "u_scale_mm": self.scale,
            "u_rms_inliers_mm": self.rms_inliers,
            "u_inliers": self.inliers,
            "coverage_factor": coverage_factor(self.n_sectors - 1),
        }


def coverage_factor(degrees_of_freedom: int) -> float:
    """Return what a standard uncertainty is multiplied by for a 95 % interval: Student's t."""
    return float(stdtrit(degrees_of_freedom, (1 + CONFIDENCE) / 2))


def fit_uncertainty(points: NDArray[np.float32], fit: SphereFit, cap: Cap, seed: int) -> Uncertainty | None:
    """Draw the sectors of a cap with replacement, and let the fit take one Newton step each time.

    Parameters
    ----------
    points : float32 (N, 3), mm, all that count
    fit : the sphere
    cap : the points on and around its surface
    seed : of the draws

    Returns
    -------
    uncertainty : None where points lie in fewer than four sectors
    """
    sector = cap.sector
    errors = [group for k in range(N_SECTORS) if len(group := cap.errors[sector == k])]
    if (n := len(errors)) < MIN_SECTORS:
        return None
    sums = [tukey_sums(cap.points[sector == k], fit.centre, fit.radius, CUTOFF * fit.scale) for k in np.unique(sector)]
    draws = np.random.default_rng(seed).integers(0, n, (N_DRAWS, n))
    moved, radii = _steps(np.stack(sums)[draws].sum(axis=1), _newton_factor(cap.errors, fit))
    spread = np.sqrt(n / (n - 1))
    sector_of_all = sector_at((points - fit.centre) @ cap.axes.T)
    is_inlier = np.abs(fit.errors(points)) <= TABLE_THRESHOLD
    counts = np.bincount(sector_of_all, minlength=N_SECTORS)[np.unique(sector)]
    within = np.bincount(sector_of_all, is_inlier, N_SECTORS)[np.unique(sector)]

    def spread_of(number: Callable[[NDArray[np.float32]], float]) -> float:
        return float(spread * np.std([number(np.concatenate([errors[k] for k in draw])) for draw in draws]))

    return Uncertainty(
        centre_covariance=spread**2 * np.cov(moved.T),
        free_radius=float(spread * np.std(radii)),
        median_error=spread_of(lambda drawn: float(np.median(drawn))),
        scale=spread_of(lambda drawn: _scale(drawn, fit.radius)),
        rms_inliers=spread_of(lambda drawn: inlier_rms(drawn) or 0.0),
        inliers=float(spread * np.std(within[draws].sum(axis=1) / counts[draws].sum(axis=1))),
        n_sectors=n,
    )


def _steps(sums: NDArray[np.float64], factor: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far each draw moves the centre (D, 3) and the free radius (D,), from `tukey_sums` (D, 15)."""
    matrices, right = np.stack([normal_matrix(row) for row in sums]), sums[:, 10:14, None]
    centres = factor * np.linalg.solve(matrices[:, :3, :3], right[:, :3])[..., 0]
    radii = factor * np.linalg.solve(matrices, right)[:, 3, 0]
    return np.asarray(centres, dtype=np.float64), np.asarray(radii, dtype=np.float64)


def _newton_factor(errors: NDArray[np.float32], fit: SphereFit) -> float:
    """Return how much longer a Newton step is than a reweighted one: mean weight over mean slope of Tukey's psi."""
    inside = (errors / (CUTOFF * fit.scale)) ** 2
    inside = inside[inside < 1]
    return float(np.sum((1 - inside) ** 2) / max(np.sum((1 - inside) * (1 - 5 * inside)), 0.1 * len(inside)))


def _scale(errors: NDArray[np.float32], radius: float) -> float:
    sizes = np.abs(errors)
    return 1.4826 * float(np.median(sizes[sizes < 2 * band_of(radius)]))
