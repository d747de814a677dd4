"""Points to pixels without any graphics library: round discs that face the camera, compiled by numba.

Convention: that of `rasterise`, with the same four samples a pixel. A disc has one depth, and of equally near ones the
first is seen. A thread draws every disc in its rows of pixels: the picture is the same for any number of threads, and
memory grows with the picture alone, however large the discs are.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.render.rasterise import FARTHEST_PIXEL, NEAREST, SAMPLE_X, SAMPLE_Y, SUBPIXELS, in_threads

LEAST_RADIUS = 0.5  # pixels; a smaller disc could lie between all samples


def draw_discs(
    picture: NDArray[np.uint8],
    projected: NDArray[np.float32],
    colours: NDArray[np.uint8],
    reach: tuple[float, float],
    *,
    threads: int = 1,
) -> None:
    """Draw discs over a picture, four samples a pixel; every disc before the camera meets one sample at least.

    Parameters
    ----------
    picture : uint8 (H, W, 3), drawn over in place
    projected : float32 (N, 3): column, row (pixels) and depth (mm) of each disc's middle
    colours : uint8 (N, 3)
    reach : half the width and height of a disc at a depth of 1 mm, pixels; it is never drawn below `LEAST_RADIUS`
    threads : how many threads share the rows; the picture does not depend on it
    """
    samples = (np.stack([SAMPLE_X, SAMPLE_Y], axis=1) / SUBPIXELS).astype(np.float32)
    nearest = np.zeros((*picture.shape[:2], len(samples)), dtype=np.float32)  # inverse depth of what each sample sees
    seen = np.empty(nearest.shape, dtype=np.int32)  # its disc
    radii = np.array(reach, dtype=np.float32)
    limits = np.array([NEAREST, FARTHEST_PIXEL], dtype=np.float32)

    def draw(first: int) -> None:
        _see_discs(projected, radii, limits, samples, nearest, seen, first, threads)
        _shade(picture, colours, nearest, seen, first, threads)

    in_threads(draw, threads)


@njit(cache=True, nogil=True, error_model="numpy")
def _see_discs(projected, reach, limits, samples, nearest, seen, first, step):  # type: ignore[no-untyped-def]  # numba
    """Enter every disc into the samples where it is the nearest so far, in every `step`-th row from `first` on."""
    height, width = nearest.shape[0], nearest.shape[1]
    full, least, margin = np.float32(1), np.float32(LEAST_RADIUS), samples.max()
    for i in range(projected.shape[0]):
        x, y, z = projected[i, 0], projected[i, 1], projected[i, 2]
        if not (z >= limits[0] and abs(x) < limits[1] and abs(y) < limits[1]):
            continue
        depth = full / z
        radius_x, radius_y = max(reach[0] * depth, least), max(reach[1] * depth, least)
        left = max(0, int(np.ceil(x - radius_x - margin)))
        right = min(width - 1, int(np.floor(x + radius_x + margin)))
        top = max(0, int(np.ceil(y - radius_y - margin)))
        bottom = min(height - 1, int(np.floor(y + radius_y + margin)))
        if left > right or top > bottom:
            continue
        scale_x, scale_y = full / radius_x, full / radius_y
        for row in range(top + (first - top) % step, bottom + 1, step):
            for column in range(left, right + 1):
                for s in range(samples.shape[0]):
                    dx = (np.float32(column) + samples[s, 0] - x) * scale_x
                    dy = (np.float32(row) + samples[s, 1] - y) * scale_y
                    if dx * dx + dy * dy <= full and depth > nearest[row, column, s]:
                        nearest[row, column, s] = depth
                        seen[row, column, s] = i


@njit(cache=True, nogil=True, error_model="numpy")
def _shade(picture, colours, nearest, seen, first, step):  # type: ignore[no-untyped-def]  # numba
    """Average the colours that a pixel's samples see, in every `step`-th row from `first` on."""
    n_samples = nearest.shape[2]
    for y in range(first, picture.shape[0], step):
        for x in range(picture.shape[1]):
            red, green, blue, covered = 0, 0, 0, 0
            for s in range(n_samples):
                if nearest[y, x, s] > 0:
                    colour = colours[seen[y, x, s]]
                    red, green, blue, covered = red + colour[0], green + colour[1], blue + colour[2], covered + 1
            if covered > 0:
                pixel, rest, half = picture[y, x], n_samples - covered, n_samples // 2
                pixel[0] = (red + rest * pixel[0] + half) // n_samples
                pixel[1] = (green + rest * pixel[1] + half) // n_samples
                pixel[2] = (blue + rest * pixel[2] + half) // n_samples
