"""Depth refinement: from confirmed disparities with holes to a smooth, slanted, dense surface.

Holes take the farther of the two surfaces beside them, a median removes what stands alone, and a local plane gives
the slant along which `permeability.aggregate_along_surface` then gathers its costs.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.depth.bands import Bands

PLANE_RADIUS = 3  # pixels: planes are fitted to 7x7 windows
SAME_SURFACE = 1.0  # pixels of disparity: what differs more belongs to another surface
MIN_SUPPORT = 6  # pixels, twice what determines a plane
RIDGE = 1e-2  # pixels squared, towards fronto-parallel where the support is a line


def filled(disparity: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Holes filled with the smaller of the nearest valid disparities left and right: what is hidden lies behind.

    A row without any takes the row above, the first rows the first that has one. At least one pixel must be valid.
    """
    rows = np.flatnonzero(valid.any(axis=1))
    dense = np.empty(disparity.shape, np.float32)
    _fill_kernel(disparity, valid, dense)
    source = rows[np.maximum(np.searchsorted(rows, np.arange(len(dense)), side="right") - 1, 0)]
    return dense[source]


@njit(cache=True, nogil=True)
def _fill_kernel(disparity: NDArray[np.float32], valid: NDArray[np.bool_], dense: NDArray[np.float32]) -> None:
    height, width = disparity.shape
    for y in range(height):
        last = np.float32(np.inf)
        for x in range(width):
            if valid[y, x]:
                last = disparity[y, x]
            dense[y, x] = last
        last = np.float32(np.inf)
        for x in range(width - 1, -1, -1):
            if valid[y, x]:
                last = disparity[y, x]
            dense[y, x] = min(dense[y, x], last)


def without_specks(disparity: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """The median of size x size pixels; 3 or 5."""
    return np.asarray(cv2.medianBlur(np.ascontiguousarray(disparity, np.float32), size), dtype=np.float32)


def local_planes(disparity: NDArray[np.float32], valid: NDArray[np.bool_], in_bands: Bands) -> NDArray[np.float32]:
    """The disparity of the plane through each pixel's surroundings.

    Parameters
    ----------
    disparity : float32 (H, W), pixels, dense
    valid : bool (H, W), the pixels that planes are fitted to
    in_bands : does the work given for rows first to last, in as many parts as there are threads

    Returns
    -------
    planes : float32 (H, W), pixels; least squares over the valid pixels of a 7x7 window whose disparity is within
        1 pixel of the centre's, and the disparity itself where there are fewer than six
    """
    planes = np.empty(disparity.shape, np.float32)
    in_bands(len(planes), partial(_plane_kernel, disparity, valid.view(np.uint8), planes))
    return planes


@njit(cache=True, nogil=True)
def _plane_kernel(
    disparity: NDArray[np.float32], valid: NDArray[np.uint8], planes: NDArray[np.float32], first: int, last: int
) -> None:
    height, width = disparity.shape
    padded = np.zeros((2, width + 2 * PLANE_RADIUS), np.float32)
    sums = np.empty((9, width), np.float32)
    for y in range(first, last):
        sums[:] = 0
        for row in range(max(y - PLANE_RADIUS, 0), min(y + PLANE_RADIUS + 1, height)):
            v = np.float32(row - y)
            for x in range(width):
                padded[0, x + PLANE_RADIUS] = disparity[row, x]
                padded[1, x + PLANE_RADIUS] = valid[row, x]
            for column in range(2 * PLANE_RADIUS + 1):
                _add_neighbour(padded, column, v, disparity[y], sums)
        for x in range(width):
            planes[y, x] = disparity[y, x] + _height_at_centre(sums[:, x])


@njit(inline="always")
def _add_neighbour(
    padded: NDArray[np.float32], column: int, v: np.float32, centre: NDArray[np.float32], sums: NDArray[np.float32]
) -> None:
    """Add one neighbour of every pixel of a row to the sums of its normal equations."""
    u = np.float32(column - PLANE_RADIUS)
    for x in range(centre.shape[0]):
        rise = padded[0, x + column] - centre[x]
        weight = padded[1, x + column] if abs(rise) <= np.float32(SAME_SURFACE) else np.float32(0)
        rise *= weight
        sums[0, x] += weight
        sums[1, x] += weight * u
        sums[2, x] += weight * v
        sums[3, x] += rise
        sums[4, x] += weight * (u * u)
        sums[5, x] += weight * (v * v)
        sums[6, x] += weight * (u * v)
        sums[7, x] += rise * u
        sums[8, x] += rise * v


@njit(inline="always")
def _height_at_centre(sums: NDArray[np.float32]) -> np.float32:
    """The constant of the plane that solves the normal equations, by Cramer's rule on centred moments."""
    n = sums[0]
    if n < MIN_SUPPORT:
        return np.float32(0)
    u, v, rise = sums[1] / n, sums[2] / n, sums[3] / n
    uu, vv, uv = sums[4] / n - u * u + np.float32(RIDGE), sums[5] / n - v * v + np.float32(RIDGE), sums[6] / n - u * v
    ur, vr = sums[7] / n - u * rise, sums[8] / n - v * rise
    determinant = uu * vv - uv * uv
    slope_u, slope_v = (ur * vv - vr * uv) / determinant, (vr * uu - ur * uv) / determinant
    height: np.float32 = rise - slope_u * u - slope_v * v
    return height
