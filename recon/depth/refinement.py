"""Depth refinement: from confirmed disparities with holes to a smooth, slanted, dense surface.

Holes take the farther of the two surfaces beside them, a median removes what stands alone, and a local plane gives
the slant along which `slanted.aggregate_along_surface` then gathers its costs.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.runtime.workers import in_bands

PLANE_OFFSETS = (-4, -1, 1, 4)  # pixels: planes are fitted to 16 places of a 9x9 window; all 81 do no better
PLANE_RADIUS = max(PLANE_OFFSETS)
SAME_SURFACE = 1.0  # pixels of disparity: what differs more belongs to another surface
MIN_SUPPORT = 6  # pixels, twice what determines a plane
RIDGE = 1e-2  # pixels squared, towards fronto-parallel where the support is a line


def filled(disparity: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Fill holes by the smaller of the nearest valid disparities left and right, as what is hidden lies behind.

    A row without any takes the row above, the first rows the first that has one; the result is dense, float32 (H, W).

    Parameters
    ----------
    disparity : float32 (H, W)
    valid : bool (H, W), at least one pixel of it True
    """
    rows = np.flatnonzero(valid.any(axis=1))
    dense = np.empty(disparity.shape, np.float32)
    in_bands(len(dense), partial(_fill_kernel, disparity, valid, dense))
    if len(rows) == len(dense):
        return dense
    source = rows[np.maximum(np.searchsorted(rows, np.arange(len(dense)), side="right") - 1, 0)]
    return dense[source]


@njit(cache=True, nogil=True)
def _fill_kernel(
    disparity: NDArray[np.float32], valid: NDArray[np.bool_], dense: NDArray[np.float32], first: int, last: int
) -> None:
    width = disparity.shape[1]
    for y in range(first, last):
        nearest = np.float32(np.inf)
        for x in range(width):
            if valid[y, x]:
                nearest = disparity[y, x]
            dense[y, x] = nearest
        nearest = np.float32(np.inf)
        for x in range(width - 1, -1, -1):
            if valid[y, x]:
                nearest = disparity[y, x]
            dense[y, x] = min(dense[y, x], nearest)


def without_specks(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Filter a disparity map, float32 (H, W), by a median of 3x3 pixels."""
    smooth = np.empty(disparity.shape, np.float32)

    def smooth_rows(first: int, last: int) -> None:
        begin = max(first - 1, 0)
        with_rim = np.ascontiguousarray(disparity[begin : last + 1], np.float32)
        smooth[first:last] = cv2.medianBlur(with_rim, 3)[first - begin : last - begin]

    in_bands(len(smooth), smooth_rows)
    return smooth


def local_planes(disparity: NDArray[np.float32], valid: NDArray[np.bool_], n_disparities: int) -> NDArray[np.float32]:
    """Fit a plane to each pixel's surroundings and return its disparity there.

    Parameters
    ----------
    disparity : float32 (H, W), disparity indices, dense
    valid : bool (H, W), the pixels that planes are fitted to
    n_disparities : planes are cut to 0 and this less one

    Returns
    -------
    planes : float32 (H, W), disparity indices; least squares over the valid pixels 1 and 4 rows and columns away
        whose disparity is within 1 pixel of the centre's, and the disparity itself where there are fewer than six
    """
    planes = np.empty(disparity.shape, np.float32)
    in_bands(len(planes), partial(_plane_kernel, disparity, valid, np.float32(n_disparities - 1), planes))
    return planes


@njit(cache=True, nogil=True)
def _plane_kernel(
    disparity: NDArray[np.float32],
    valid: NDArray[np.bool_],
    highest: np.float32,
    planes: NDArray[np.float32],
    first: int,
    last: int,
) -> None:
    width = disparity.shape[1]
    n_held = 2 * PLANE_RADIUS + 1
    held = np.full((n_held, width + 2 * PLANE_RADIUS), np.inf, np.float32)
    sums = np.empty((9, width), np.float32)
    for y in range(first - PLANE_RADIUS, first + PLANE_RADIUS):
        _frame_row(disparity, valid, y, held[y % n_held])
    for y in range(first, last):
        _frame_row(disparity, valid, y + PLANE_RADIUS, held[(y + PLANE_RADIUS) % n_held])
        sums[:] = 0
        for v in PLANE_OFFSETS:
            _add_row(held[(y + v) % n_held], np.float32(v), disparity[y], sums)
        _planes_at_centre(sums, disparity[y], highest, planes[y])


@njit(inline="always")
def _frame_row(disparity: NDArray[np.float32], valid: NDArray[np.bool_], y: int, row: NDArray[np.float32]) -> None:
    """Copy a row of the image between the row's ends, with infinity, which is within reach of nothing, for unknown."""
    width = disparity.shape[1]
    if 0 <= y < disparity.shape[0]:
        for x in range(width):
            row[x + PLANE_RADIUS] = disparity[y, x] if valid[y, x] else np.float32(np.inf)
    else:
        row[:] = np.float32(np.inf)


@njit(inline="always")
def _add_row(row: NDArray[np.float32], v: np.float32, centre: NDArray[np.float32], sums: NDArray[np.float32]) -> None:
    """Add the neighbours in one row, v rows below, to the sums of every pixel's normal equations."""
    for x in range(centre.shape[0]):
        n, n_u, n_uu, rises, rises_u = np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0)
        for offset in PLANE_OFFSETS:
            u, rise = np.float32(offset), row[x + PLANE_RADIUS + offset] - centre[x]
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
def _planes_at_centre(
    sums: NDArray[np.float32], centre: NDArray[np.float32], highest: np.float32, planes: NDArray[np.float32]
) -> None:
    """Solve the normal equations by Cramer's rule on centred moments; write each plane's disparity at its pixel."""
    for x in range(centre.shape[0]):
        is_enough = sums[0, x] >= np.float32(MIN_SUPPORT)
        share = np.float32(1) / (sums[0, x] if is_enough else np.float32(1))
        u, v, rise = sums[1, x] * share, sums[2, x] * share, sums[3, x] * share
        uu, vv = sums[4, x] * share - u * u + np.float32(RIDGE), sums[5, x] * share - v * v + np.float32(RIDGE)
        uv, ur, vr = sums[6, x] * share - u * v, sums[7, x] * share - u * rise, sums[8, x] * share - v * rise
        height = rise - ((ur * vv - vr * uv) * u + (vr * uu - ur * uv) * v) / (uu * vv - uv * uv)
        plane = centre[x] + (height if is_enough else np.float32(0))
        planes[x] = min(max(plane, np.float32(0)), highest)
