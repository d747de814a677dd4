"""The signed distance field of an algebraic point set surface (APSS) at the samples of a band.

Around every sample an algebraic sphere is fitted to the points and normals nearby; its signed distance at the sample
is the field, its gradient there the normal, and powers of the same weights blend the colours.

Source
------
Guennebaud and Gross, Algebraic Point Set Surfaces, SIGGRAPH 2007; the closed form of the fit with normals from
Guennebaud, Germann and Gross, Dynamic Sampling and Rendering of Algebraic Point Set Surfaces, 2008, section 2.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.runtime.workers import in_bands
from recon.surface.band import Band, neighbours_of
from recon.surface.cells import Cells

SMALLEST_SPREAD = 1e-3  # voxels squared; points in one place have no curvature


def signed_field(
    cells: Cells, band: Band, *, overhang: float, agreement: float, min_points: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Fit a sphere to the points around every sample of the band.

    Parameters
    ----------
    cells : the points
    band : the samples
    overhang : how far the mean of the weighted points may lie beside a sample, along the surface, as a share of
        their radius; beyond it the sample is past the data's edge and has no value
    agreement : shortest mean normal that counts as one surface
    min_points : least number of points, each counted by the weight of its nearness alone, that supports a value

    Returns
    -------
    field (B, 8, 8, 8), voxels, negative inside, NaN where points do not support it; gradient (B, 3, 8, 8, 8), unit;
    colour (B, 3, 8, 8, 8), 0 to 255; all float32, the latter two without meaning where the field is NaN
    """
    neighbours = neighbours_of(band, cells)
    field = np.empty((len(neighbours), 8, 8, 8), np.float32)
    gradient, colour = (np.empty((len(neighbours), 3, 8, 8, 8), np.float32) for _ in range(2))
    support = _Support(np.float32(overhang), np.float32(agreement), np.float32(min_points))
    fit = partial(_fit_spheres, cells.moments, cells.starts, neighbours, support)
    in_bands(len(neighbours), partial(fit, field, gradient, colour))
    return field, gradient, colour


class _Support(NamedTuple):
    """What a sample needs to have a value, as of `signed_field`."""

    overhang: np.float32
    agreement: np.float32
    min_points: np.float32


@njit(cache=True)
def _moments_about(moment: NDArray[np.float32], x: float, y: float, z: float, sums: NDArray[np.float32]) -> None:
    """Write the sums (15,) of a cell at weight 1 whose mean point lies at `x, y, z`, in the order of `_spread_cell`."""
    weight, nx, ny, nz = moment[3], moment[4], moment[5], moment[6]
    sums[0] = weight
    sums[1], sums[2], sums[3] = weight * x, weight * y, weight * z
    sums[4], sums[5], sums[6] = weight * nx, weight * ny, weight * nz
    sums[7] = weight * (x * nx + y * ny + z * nz + moment[7])
    sums[8] = weight * (x * x + y * y + z * z + moment[8])
    sums[9] = weight * moment[12]
    sums[10] = weight
    sums[11], sums[12], sums[13] = weight * moment[9], weight * moment[10], weight * moment[11]
    sums[14] = moment[13]


@njit(cache=True)
def _spread_cell(
    cell: NDArray[np.float32], x: float, y: float, z: float, radius: float, sums: NDArray[np.float32]
) -> None:
    """Add a cell's weighted sums (15,) to those of each sample it reaches, flat from (8, 8, 15, 8): x, y, sum, z.

    `x, y, z` is the cell's mean point from the corner of the block of samples. The weight is (1 - r^2 / h^2)^4
    (Guennebaud and Gross 2007, equation 1); colours take its fourth power, half as wide, because a picture bears less
    smoothing than a shape.

    The sums are written out and indexed without a sign because only then are eight samples added at once: four
    times faster, measured in bench/surface.py.
    """
    c0, c1, c2, c3, c4, c5, c6 = cell[0], cell[1], cell[2], cell[3], cell[4], cell[5], cell[6]
    c7, c8, c9, c10, c11, c12, c13, c14 = cell[7], cell[8], cell[9], cell[10], cell[11], cell[12], cell[13], cell[14]
    unit, zero = np.float32(1), np.float32(0)
    inverse = unit / (radius * radius)
    for i in range(max(int(np.ceil(x - radius)), 0), min(int(np.floor(x + radius)) + 1, 8)):
        dx = np.float32(x - np.float32(i))
        for j in range(max(int(np.ceil(y - radius)), 0), min(int(np.floor(y + radius)) + 1, 8)):
            dy = np.float32(y - np.float32(j))
            left = unit - (dx * dx + dy * dy) * inverse
            if left <= zero:
                continue
            line = np.uint64((i * 8 + j) * 120)
            for k in range(np.uint64(8)):
                dz = np.float32(z - np.float32(k))
                t = max(left - dz * dz * inverse, zero)
                t = t * t
                t = t * t
                at = line + k
                sums[at] += t * c0
                sums[at + np.uint64(8)] += t * c1
                sums[at + np.uint64(16)] += t * c2
                sums[at + np.uint64(24)] += t * c3
                sums[at + np.uint64(32)] += t * c4
                sums[at + np.uint64(40)] += t * c5
                sums[at + np.uint64(48)] += t * c6
                sums[at + np.uint64(56)] += t * c7
                sums[at + np.uint64(64)] += t * c8
                sums[at + np.uint64(72)] += t * c9
                sums[at + np.uint64(112)] += t * c14
                t = t * t
                t = t * t
                sums[at + np.uint64(80)] += t * c10
                sums[at + np.uint64(88)] += t * c11
                sums[at + np.uint64(96)] += t * c12
                sums[at + np.uint64(104)] += t * c13


@njit(cache=True, error_model="numpy")
def _solve_line(
    s: NDArray[np.float32],
    x: float,
    y: float,
    support: _Support,
    field: NDArray[np.float32],
    gradient: NDArray[np.float32],
    colour: NDArray[np.float32],
) -> None:
    """Fit the spheres of eight samples at `x, y, 0 .. 7` to their sums `s` (15, 8).

    Writes the signed distances `field` (8,), `gradient` (3, 8) and `colour` (3, 8). With the sample as origin the
    sphere is u0 + u . p + u4 |p|^2 = 0, and 2 u0 / (|u| + sqrt(|u|^2 - 4 u0 u4)) its signed distance without
    cancellation, for a plane too. Without branches, so that all eight are solved at once.
    """
    zero, half, two, four = np.float32(0), np.float32(0.5), np.float32(2), np.float32(4)
    smallest_spread, nan = np.float32(SMALLEST_SPREAD), np.float32(np.nan)
    for k in range(8):
        z = np.float32(k)
        total = s[0, k]
        inverse = np.float32(1) / total
        px, py, pz = s[1, k] * inverse - x, s[2, k] * inverse - y, s[3, k] * inverse - z
        nx, ny, nz = s[4, k] * inverse, s[5, k] * inverse, s[6, k] * inverse
        # About the samples instead of the block's corner, and less the product of the means.
        mean2 = px * px + py * py + pz * pz
        qx, qy, qz = px + x, py + y, pz + z
        spread = s[8, k] * inverse - (qx * qx + qy * qy + qz * qz)
        along = s[7, k] * inverse - (qx * nx + qy * ny + qz * nz)
        u4 = half * along / spread if spread > smallest_spread else zero
        ux, uy, uz = nx - two * u4 * px, ny - two * u4 * py, nz - two * u4 * pz
        u0 = -(ux * px + uy * py + uz * pz) - u4 * (spread + mean2)
        length2 = ux * ux + uy * uy + uz * uz
        length = np.sqrt(length2)
        distance = two * u0 / (length + np.sqrt(max(length2 - four * u0 * u4, zero)))
        gx, gy, gz = ux / length, uy / length, uz / length
        across = px * gx + py * gy + pz * gz
        reach = support.overhang * s[9, k] * inverse
        supported = (
            (s[14, k] >= support.min_points)
            & (nx * nx + ny * ny + nz * nz >= support.agreement * support.agreement)
            & (mean2 - across * across <= reach * reach)
        )
        field[k] = distance if supported else nan
        gradient[0, k] = gx
        gradient[1, k] = gy
        gradient[2, k] = gz
        inverse = np.float32(1) / s[10, k]
        colour[0, k] = s[11, k] * inverse
        colour[1, k] = s[12, k] * inverse
        colour[2, k] = s[13, k] * inverse


@njit(cache=True)
def _sum_block(
    moments: NDArray[np.float32], starts: NDArray[np.int64], around: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Sum the cells of the blocks `around` a block (27,) for each of its samples, (8, 8, 15, 8)."""
    flat = np.zeros(15 * 512, np.float32)
    cell_sums = np.empty(15, np.float32)
    for side in range(27):
        other = around[side]
        if other < 0:
            continue
        di, dj, dk = 8 * (side // 9 - 1), 8 * (side // 3 % 3 - 1), 8 * (side % 3 - 1)
        for cell in range(starts[other], starts[other + 1]):
            moment = moments[cell]
            radius = moment[12]
            x = np.float32(moment[0] + np.float32(di))
            y = np.float32(moment[1] + np.float32(dj))
            z = np.float32(moment[2] + np.float32(dk))
            if min(x, y, z) > -radius and max(x, y, z) < np.float32(7) + radius:
                _moments_about(moment, x, y, z, cell_sums)
                _spread_cell(cell_sums, x, y, z, radius, flat)
    return flat.reshape((8, 8, 15, 8))


@njit(cache=True, nogil=True)
def _fit_spheres(
    moments: NDArray[np.float32],
    starts: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    support: _Support,
    field: NDArray[np.float32],
    gradient: NDArray[np.float32],
    colour: NDArray[np.float32],
    start: int,
    stop: int,
) -> None:
    """Fit as `signed_field` does; `neighbours` (B, 27) holds the index of each surrounding block's cells.

    One thread computes a block from its cells in a fixed order, so that the result does not depend on the threads.
    """
    for block in range(start, stop):
        sums = _sum_block(moments, starts, neighbours[block])
        for i in range(8):
            for j in range(8):
                _solve_line(
                    sums[i, j], np.float32(i), np.float32(j), support,
                    field[block, i, j], gradient[block, :, i, j], colour[block, :, i, j],
                )  # fmt: skip
