"""Where a sensor's errors come from: its calibration, single shots, or the matching of pixels.

The mean error of a cell of the cap that comes back in every shot is calibration: it bends every ball alike. What
differs from shot to shot is the shot's own, such as a highlight. What scatters within a cell is matching.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.validation.sphere.cells import N_RINGS, N_SECTORS, Cap
from recon.validation.sphere.fit.model import SphereFit
from recon.validation.sphere.uncertainty import MIN_SECTORS, coverage_factor

N_DRAWS = 200  # of sectors, for the uncertainties
MIN_SHOTS = 2
MIN_CELL_POINTS = 10


@dataclass(frozen=True, eq=False)
class CellErrors:
    """The errors of the points on the surface, by cell.

    Parameters
    ----------
    means, variances : float64 (N_SECTORS N_RINGS,), mm and mm^2; NaN in cells with fewer than ten points
    """

    means: NDArray[np.float64]
    variances: NDArray[np.float64]


def cell_errors(cap: Cap, fit: SphereFit) -> CellErrors:
    """Return the errors of a cap's points that lie on the surface, by cell."""
    on_surface = np.abs(cap.errors) < fit.band
    cell, errors = cap.cell[on_surface], cap.errors[on_surface].astype(np.float64)
    counts, sums, squares = (np.bincount(cell, weights, N_SECTORS * N_RINGS) for weights in (None, errors, errors**2))
    n = np.where(counts >= MIN_CELL_POINTS, counts, np.nan)
    return CellErrors(sums / n, squares / n - (sums / n) ** 2)


def error_sources(shots: Sequence[CellErrors], seed: int) -> dict[str, float | int | None]:
    """Separate one sensor's errors into root mean squares, mm, with standard uncertainties over sectors.

    Parameters
    ----------
    shots : of the reconstructions used
    seed : of the draws

    Returns
    -------
    row : n_shots; calibration_mm, shot_mm and matching_mm with u_...; the first two are None with a single shot, where
        smooth_mm is both together; coverage_factor for 95 % intervals. This and u_... are None where fewer than four
        sectors have a cell that every shot shows
    """
    means, variances = (np.stack([getattr(shot, name) for shot in shots]) for name in ("means", "variances"))
    n_shots = len(shots)
    values = _sources(means, variances)
    by_sector = [part.reshape(n_shots, N_SECTORS, N_RINGS) for part in (means, variances)]
    shown = np.flatnonzero(np.isfinite(by_sector[0]).all(axis=0).any(axis=1))  # by every shot, in a cell at least
    spreads, factor = np.full(len(values), np.nan), None
    if (n := len(shown)) >= MIN_SECTORS:
        draws = shown[np.random.default_rng(seed).integers(0, n, (N_DRAWS, n))]
        drawn = [_sources(*(part[:, draw].reshape(n_shots, -1) for part in by_sector)) for draw in draws]
        spreads, factor = np.std(drawn, axis=0) * np.sqrt(n / (n - 1)), coverage_factor(n - 1)
    row: dict[str, float | int | None] = {"n_shots": n_shots, "coverage_factor": factor}
    for name, value, spread in zip(("calibration", "shot", "matching", "smooth"), values, spreads, strict=True):
        row |= {
            key: float(mm) if np.isfinite(mm) else None for key, mm in ((f"{name}_mm", value), (f"u_{name}_mm", spread))
        }
    return row


def _sources(means: NDArray[np.float64], variances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return calibration, shot, matching and smooth errors (4,), mm, of cells (shots, C)."""
    n_shots, known = len(means), np.isfinite(means).all(axis=0)
    if not known.any():
        return np.full(4, np.nan)
    cells = means[:, known]
    smooth = float(np.mean(cells**2))
    matching = float(np.mean(variances[np.isfinite(variances)]))
    if n_shots < MIN_SHOTS:
        return np.sqrt([np.nan, np.nan, matching, smooth])
    shot = float(np.mean(cells.var(axis=0, ddof=1)))
    calibration = max(float(np.mean(cells.mean(axis=0) ** 2) - shot / n_shots), 0.0)
    return np.sqrt([calibration, shot, matching, smooth])
