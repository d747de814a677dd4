"""Which reconstructions of a ball are spoilt by clusters of wrong depth, by a rule with numbers behind it.

A cluster that pulls a fit betrays itself when the part of the surface that it lies on is left out: the centre moves.
One that is too far off to pull it still leaves a part of the surface off together, where noise would average out. A cap
whose depth is wrong as a whole does not, only the other sensors' centres can tell. The limits were set on simulated
caps with seeds other than those that `bench/validation.py` reports caught and dropped shares of.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recon.validation.sampling import subsample
from recon.validation.sphere import SphereFit, SphereParameters, moved_centre

N_SECTORS = 8
MAX_SECTOR_SHIFT = 1.0  # mm for a radius of 150 mm, the centre's shift when one of eight sectors is left out
MAX_RING_SHIFT = 1.5  # likewise for the inner or outer half of the cap
MAX_SENSOR_SHIFT = 2.5  # likewise from the middle of the sensors' centres
REFERENCE_RADIUS = 150.0
N_RINGS = 3  # with the sectors, cells of equal numbers of points
COHERENT_CELLS = 4  # a sixth of the cells
MAX_COHERENT_ERROR = 2.2  # likewise of that many cells' median errors; of 95 % of good caps it is below 1.8
COHERENT_SCALE = 0.4  # of the points' scatter, beyond which that error must lie as well
MIN_SURFACE_SHARE = 0.55  # of the points around a ball; less and clusters of wrong depth outweigh its surface


@dataclass(frozen=True)
class Parts:
    """What the parts of a cap say about its fit, mm.

    Parameters
    ----------
    sector_shift, ring_shift : how far the centre moves when the worst of eight sectors, or the worse of the inner and
        the outer half, is left out
    coherent_error : by how much the worst sixth of its surface is off together: the fourth largest of the median errors
        of 24 cells
    """

    sector_shift: float
    ring_shift: float
    coherent_error: float


def examine_parts(points: NDArray[np.float32], fit: SphereFit, parameters: SphereParameters | None = None) -> Parts:
    """Leave out parts of a cap (N, 3) in turn, and look at the errors of each."""
    parameters = parameters or SphereParameters()
    sample = subsample(points, parameters.seed)
    near = sample[np.abs(fit.errors(sample)) < 0.25 * fit.radius]
    offsets = (near - fit.centre) / np.linalg.norm(near - fit.centre, axis=1, keepdims=True)
    axis = offsets.mean(axis=0) / np.linalg.norm(offsets.mean(axis=0))
    across = np.linalg.svd(axis[None])[2][1:]
    turn = np.arctan2(offsets @ across[1], offsets @ across[0])
    sector = np.minimum(((turn + np.pi) / (2 * np.pi) * N_SECTORS).astype(int), N_SECTORS - 1)
    polar = offsets @ axis
    is_outer = polar < np.median(polar)
    reference = moved_centre(near, fit, parameters)
    sectors = [moved_centre(near[sector != k], fit, parameters) for k in range(N_SECTORS)]
    rings = [moved_centre(near[is_outer], fit, parameters), moved_centre(near[~is_outer], fit, parameters)]
    return Parts(
        max(float(np.linalg.norm(centre - reference)) for centre in sectors),
        max(float(np.linalg.norm(centre - reference)) for centre in rings),
        _coherent_error(fit.errors(near), sector, polar),
    )


def _coherent_error(errors: NDArray[np.float32], sector: NDArray[np.int64], polar: NDArray[np.floating]) -> float:
    ring = np.searchsorted(np.quantile(polar, np.arange(1, N_RINGS) / N_RINGS), polar)
    cells = sector * N_RINGS + ring
    medians = [np.median(errors[cells == cell]) for cell in range(N_SECTORS * N_RINGS) if (cells == cell).any()]
    return float(np.sort(np.abs(medians))[-COHERENT_CELLS]) if len(medians) >= COHERENT_CELLS else 0.0


def exclusion_reasons(fits: Mapping[str, SphereFit], parts: Mapping[str, Parts]) -> dict[str, list[str]]:
    """Why each sensor's reconstruction of one placed ball is to be left out; empty lists for the good ones.

    Parameters
    ----------
    fits, parts : per sensor; `parts` from `examine_parts`
    """
    reasons: dict[str, list[str]] = {sensor: [] for sensor in fits}
    for sensor, found in parts.items():
        by_sector, by_ring = found.sector_shift, found.ring_shift
        unit, share = fits[sensor].radius / REFERENCE_RADIUS, fits[sensor].surface_share
        if share < MIN_SURFACE_SHARE:
            reasons[sensor].append(
                f"only {share:.0%} of the points around the ball lie on it, under {MIN_SURFACE_SHARE:.0%}"
            )
        if by_sector > MAX_SECTOR_SHIFT * unit:
            limit = MAX_SECTOR_SHIFT * unit
            reasons[sensor].append(
                f"without its worst sector the centre moves by {by_sector:.2f} mm, over {limit:g} mm"
            )
        if by_ring > MAX_RING_SHIFT * unit:
            limit = MAX_RING_SHIFT * unit
            reasons[sensor].append(
                f"without its inner or outer half the centre moves by {by_ring:.2f} mm, over {limit:g}"
            )
        limit = max(MAX_COHERENT_ERROR * unit, COHERENT_SCALE * fits[sensor].scale)
        if found.coherent_error > limit:
            reasons[sensor].append(
                f"a sixth of its surface is off together by {found.coherent_error:.2f} mm or more, over {limit:.3g} mm"
            )
    for sensor, apart in sensor_shifts(fits).items():
        limit = MAX_SENSOR_SHIFT * fits[sensor].radius / REFERENCE_RADIUS
        if apart > limit:
            reasons[sensor].append(f"its centre is {apart:.2f} mm from that of the other sensors, over {limit:g} mm")
    return reasons


def sensor_shifts(fits: Mapping[str, SphereFit]) -> dict[str, float]:
    """Distance of each sensor's centre from the sensors' middle, mm: the one that is nearest to most of them.

    With two sensors nobody can say which is wrong: both get the distance between them. With one there is none.
    """
    if len(fits) < 2:
        return {}
    centres = np.stack([fit.centre for fit in fits.values()])
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    if len(fits) == 2:
        return dict.fromkeys(fits, float(apart[0, 1]))
    others = np.sort(apart, axis=1)[:, 1 : 1 + len(fits) // 2]  # the nearer half of the others
    return dict(zip(fits, map(float, others.mean(axis=1)), strict=True))
