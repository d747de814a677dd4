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
    in_bands(len(planes), partial(_plane_kernel, disparity, valid, planes))
    return planes


@njit(cache=True, nogil=True)
def _plane_kernel(
    disparity: NDArray[np.float32], valid: NDArray[np.bool_], planes: NDArray[np.float32], first: int, last: int
) -> None:
    height, width = disparity.shape
    padded = np.full(width + 2 * PLANE_RADIUS, np.inf, np.float32)  # infinity is within reach of nothing
    sums = np.empty((9, width), np.float32)
    for y in range(first, last):
        sums[:] = 0
        for row in range(max(y - PLANE_RADIUS, 0), min(y + PLANE_RADIUS + 1, height)):
            for x in range(width):
                padded[x + PLANE_RADIUS] = disparity[row, x] if valid[row, x] else np.float32(np.inf)
            _add_row(padded, np.float32(row - y), disparity[y], sums)
        _heights_at_centre(sums, disparity[y], planes[y])


@njit(inline="always")
def _add_row(
    padded: NDArray[np.float32], v: np.float32, centre: NDArray[np.float32], sums: NDArray[np.float32]
) -> None:
    """Add the neighbours in one row, v rows below, to the sums of every pixel's normal equations."""
    for x in range(centre.shape[0]):
        n, n_u, n_uu, rises, rises_u = np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0)
        for column in range(2 * PLANE_RADIUS + 1):
            u, rise = np.float32(column - PLANE_RADIUS), padded[x + column] - centre[x]
            is_same = abs(rise) <= np.float32(SAME_SURFACE)
            n += np.float32(1) if is_same else np.float32(0)
            n_u += u if is_same else np.float32(0)
            n_uu += u * u if is_same else np.float32(0)
            rises += rise if is_same else np.float32(0)
            rises_u += rise * u if is_same else np.float32(0)
        sums[0, x] += n
        sums[1, x] += n_u
        sums[2, x] += n * v
        sums[3, x] += rises
        sums[4, x] += n_uu
        sums[5, x] += n * (v * v)
        sums[6, x] += n_u * v
        sums[7, x] += rises_u
        sums[8, x] += rises * v


@njit(inline="always")
def _heights_at_centre(sums: NDArray[np.float32], centre: NDArray[np.float32], planes: NDArray[np.float32]) -> None:
    """The planes that solve the normal equations, by Cramer's rule on centred moments, at their own pixels."""
    for x in range(centre.shape[0]):
        is_enough = sums[0, x] >= np.float32(MIN_SUPPORT)
        share = np.float32(1) / (sums[0, x] if is_enough else np.float32(1))
        u, v, rise = sums[1, x] * share, sums[2, x] * share, sums[3, x] * share
        uu, vv = sums[4, x] * share - u * u + np.float32(RIDGE), sums[5, x] * share - v * v + np.float32(RIDGE)
        uv, ur, vr = sums[6, x] * share - u * v, sums[7, x] * share - u * rise, sums[8, x] * share - v * rise
        height = rise - ((ur * vv - vr * uv) * u + (vr * uu - ur * uv) * v) / (uu * vv - uv * uv)
        planes[x] = centre[x] + (height if is_enough else np.float32(0))
