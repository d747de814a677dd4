"""The signed field of an algebraic point set surface on the samples of a band.

Around every sample an algebraic sphere is fitted to the points and normals nearby; its signed distance at the sample
is the field, its gradient there the normal, and powers of the same weights blend the colours.
Source: Guennebaud and Gross, Algebraic Point Set Surfaces, SIGGRAPH 2007; the closed form of the fit with normals from
Guennebaud, Germann and Gross, Dynamic Sampling and Rendering of Algebraic Point Set Surfaces, 2008, section 2.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from recon.surface.band import Band, Cells, neighbours_of


def signed_field(
    cells: Cells, band: Band, *, overhang: float, agreement: float, min_weight: float
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Fit a sphere at every sample of the band.

    Parameters
    ----------
    overhang : how far the mean of the weighted points may lie beside a sample, along the surface, as a share of
        their radius; beyond it the sample is past the data's edge and has no value
    agreement : shortest mean normal that counts as one surface
    min_weight : least sum of weights that supports a value

    Returns
    -------
    field (B, 8, 8, 8), voxels, negative inside, NaN where points do not support it; gradient (B, 8, 8, 8, 3), unit;
    colour (B, 8, 8, 8, 3), 0 to 255; all float32
    """
    field, gradient, colour = fit_spheres(
        cells.moments, cells.starts, neighbours_of(band, cells), overhang, agreement, min_weight
    )
    return field, gradient, colour


@njit(cache=True)
def spread_cell(moment: NDArray[np.float32], x: float, y: float, z: float, sums: NDArray[np.float32]) -> None:
    """Add a cell's weighted moments about each sample it reaches to `sums` (14, 8, 8, 8).

    `x, y, z` is the cell's mean point from the corner of the block of samples. The weight is (1 - r^2 / h^2)^4
    (Guennebaud and Gross 2007, equation 1); colours take its fourth power, half as wide, because a picture bears less
    smoothing than a shape.
    """
    weight, nx, ny, nz = moment[3], moment[4], moment[5], moment[6]
    along, spread = moment[7], moment[8]
    red, green, blue = moment[9], moment[10], moment[11]
    radius = moment[12]
    one, zero = np.float32(1), np.float32(0)
    inverse = one / (radius * radius)
    for i in range(max(int(np.ceil(x - radius)), 0), min(int(np.floor(x + radius)) + 1, 8)):
        dx = np.float32(x - i)
        for j in range(max(int(np.ceil(y - radius)), 0), min(int(np.floor(y + radius)) + 1, 8)):
            dy = np.float32(y - j)
            square = dx * dx + dy * dy
            if square * inverse >= one:
                continue
            for k in range(8):
                dz = np.float32(z - k)
                r2 = square + dz * dz
                t = max(one - r2 * inverse, zero)
                t = t * t
                t = t * t
                w = weight * t
                sums[0, i, j, k] += w
                sums[1, i, j, k] += w * dx
                sums[2, i, j, k] += w * dy
                sums[3, i, j, k] += w * dz
                sums[4, i, j, k] += w * nx
                sums[5, i, j, k] += w * ny
                sums[6, i, j, k] += w * nz
                sums[7, i, j, k] += w * (dx * nx + dy * ny + dz * nz + along)
                sums[8, i, j, k] += w * (r2 + spread)
                sums[9, i, j, k] += w * radius
                t = t * t
                w = weight * t * t
                sums[10, i, j, k] += w
                sums[11, i, j, k] += w * red
                sums[12, i, j, k] += w * green
                sums[13, i, j, k] += w * blue


@njit(cache=True)
def sphere_distance(sums: NDArray[np.float32], i: int, j: int, k: int) -> tuple[float, float, float, float, float]:
    """Signed distance of a sample to its algebraic sphere, its gradient there, and the mean normal's length.

    With the sample as origin the sphere is u0 + u . p + u4 |p|^2 = 0.
    """
    inverse = 1 / sums[0, i, j, k]
    px, py, pz = sums[1, i, j, k] * inverse, sums[2, i, j, k] * inverse, sums[3, i, j, k] * inverse
    nx, ny, nz = sums[4, i, j, k] * inverse, sums[5, i, j, k] * inverse, sums[6, i, j, k] * inverse
    along, square = sums[7, i, j, k] * inverse, sums[8, i, j, k] * inverse
    spread = square - (px * px + py * py + pz * pz)
    u4 = 0.0
    if spread > 1e-3:  # voxels squared; points in one place have no curvature
        u4 = 0.5 * (along - (px * nx + py * ny + pz * nz)) / spread
    ux, uy, uz = nx - 2 * u4 * px, ny - 2 * u4 * py, nz - 2 * u4 * pz
    u0 = -(ux * px + uy * py + uz * pz) - u4 * square
    length2 = ux * ux + uy * uy + uz * uz
    length = np.sqrt(length2)
    agreement = np.sqrt(nx * nx + ny * ny + nz * nz)
    if length < 1e-6:  # the sample is the sphere's centre
        return np.nan, 0.0, 0.0, 0.0, agreement
    # 2 u0 / (|u| + sqrt(|u|^2 - 4 u0 u4)) is the distance to the sphere without cancellation, also for a plane.
    distance = 2 * u0 / (length + np.sqrt(max(length2 - 4 * u0 * u4, 0.0)))
    return distance, ux / length, uy / length, uz / length, agreement


@njit(parallel=True, cache=True)
def fit_spheres(
    moments: NDArray[np.float32],
    starts: NDArray[np.int64],
    neighbours: NDArray[np.int32],
    overhang: float,
    agreement: float,
    min_weight: float,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """As `signed_field`; `neighbours` (B, 27) says where each block's surrounding cells stand.

    A block is one thread's work and takes its cells in a fixed order: the result does not depend on the threads.
    """
    n_blocks = len(neighbours)
    field = np.full((n_blocks, 8, 8, 8), np.float32(np.nan))
    gradient = np.zeros((n_blocks, 8, 8, 8, 3), np.float32)
    colour = np.zeros((n_blocks, 8, 8, 8, 3), np.float32)
    for block in prange(n_blocks):
        sums = np.zeros((14, 8, 8, 8), np.float32)
        for side in range(27):
            other = neighbours[block, side]
            if other < 0:
                continue
            di, dj, dk = 8.0 * (side // 9 - 1), 8.0 * (side // 3 % 3 - 1), 8.0 * (side % 3 - 1)
            for cell in range(starts[other], starts[other + 1]):
                moment = moments[cell]
                x, y, z = moment[0] + di, moment[1] + dj, moment[2] + dk
                if z > -moment[12] and z < 7 + moment[12]:
                    spread_cell(moment, x, y, z, sums)
        for i in range(8):
            for j in range(8):
                for k in range(8):
                    total = sums[0, i, j, k]
                    if total < min_weight:
                        continue
                    distance, nx, ny, nz, mean = sphere_distance(sums, i, j, k)
                    if np.isnan(distance) or mean < agreement:
                        continue
                    px, py, pz = sums[1, i, j, k] / total, sums[2, i, j, k] / total, sums[3, i, j, k] / total
                    beside = px * px + py * py + pz * pz - (px * nx + py * ny + pz * nz) ** 2
                    if beside > (overhang * sums[9, i, j, k] / total) ** 2:
                        continue
                    field[block, i, j, k] = distance
                    gradient[block, i, j, k, 0] = nx
                    gradient[block, i, j, k, 1] = ny
                    gradient[block, i, j, k, 2] = nz
                    for c in range(3):
                        colour[block, i, j, k, c] = sums[11 + c, i, j, k] / sums[10, i, j, k]
    return field, gradient, colour
