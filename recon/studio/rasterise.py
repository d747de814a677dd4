"""Which triangle a camera sees at each pixel: five samples per pixel, one of them at its centre.

The centre's sample is the ground truth (a pixel is where its centre's ray goes); the other four smooth the outlines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from recon.rig import Camera

N_SAMPLES = 5
NEAREST_MM = 50.0


@dataclass(frozen=True, eq=False)
class Visibility:
    """What a camera sees inside a window of its image.

    Parameters
    ----------
    column, row : the window's first pixel
    faces : int32 (h, w, 5), the visible face per sample, -1 where there is none
    nearness : float32 (h, w, 5), 1 / z in the camera, 0 where there is nothing
    pixels : float64 (N, 3), per vertex column, row, 1 / z
    """

    column: int
    row: int
    faces: NDArray[np.int32]
    nearness: NDArray[np.float32]
    pixels: NDArray[np.float64]


def see(camera: Camera, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> Visibility:
    """Rasterise a closed mesh; faces that turn their back on the camera are skipped.

    Parameters
    ----------
    vertices : float64 (N, 3), mm, world
    faces : int32 (M, 3), counter-clockwise seen from outside

    Raises
    ------
    ValueError
        If a vertex lies behind the camera or closer than NEAREST_MM.
    """
    in_camera = camera.points_in_camera(vertices)
    if in_camera[:, 2].min() < NEAREST_MM:
        raise ValueError(f"a surface comes within {in_camera[:, 2].min():.0f} mm of a camera; keep {NEAREST_MM:.0f} mm")
    pixels = in_camera @ camera.K.T
    pixels[:, :2] /= pixels[:, 2:]
    pixels[:, 2] = 1.0 / pixels[:, 2]
    width, height = camera.size
    low = np.maximum(np.floor(pixels[:, :2].min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(pixels[:, :2].max(axis=0)).astype(int) + 2, (width, height))
    w, h = np.maximum(high - low, 0)
    seen = np.full((h, w, N_SAMPLES), -1, np.int32)
    nearness = np.zeros((h, w, N_SAMPLES), np.float32)
    _rasterise(pixels, faces, int(low[0]), int(low[1]), seen, nearness)
    return Visibility(int(low[0]), int(low[1]), seen, nearness, pixels)


@numba.njit(cache=True, nogil=True)
def _rasterise(pixels, faces, column, row, seen, nearness):  # type: ignore[no-untyped-def]
    h, w = seen.shape[0], seen.shape[1]
    offset_x = (0.0, -0.125, 0.375, -0.375, 0.125)
    offset_y = (0.0, -0.375, -0.125, 0.125, 0.375)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay = pixels[a, 0] - column, pixels[a, 1] - row
        bx, by = pixels[b, 0] - column, pixels[b, 1] - row
        cx, cy = pixels[c, 0] - column, pixels[c, 1] - row
        area = (cx - ax) * (by - ay) - (bx - ax) * (cy - ay)  # rows point down: positive when seen from outside
        if area <= 0.0:
            continue
        x0 = max(0, int(np.ceil(min(ax, min(bx, cx)) - 0.375)))
        x1 = min(w - 1, int(np.floor(max(ax, max(bx, cx)) + 0.375)))
        y0 = max(0, int(np.ceil(min(ay, min(by, cy)) - 0.375)))
        y1 = min(h - 1, int(np.floor(max(ay, max(by, cy)) + 0.375)))
        if x0 > x1 or y0 > y1:
            continue
        na, nb, nc = pixels[a, 2], pixels[b, 2], pixels[c, 2]
        # Weights of a, b, c are planes over the image: u = u0 + ux x + uy y.
        inverse = 1.0 / area
        ux, uy = (by - cy) * -inverse, (cx - bx) * -inverse
        vx, vy = (cy - ay) * -inverse, (ax - cx) * -inverse
        u0 = -(ux * cx + uy * cy)
        v0 = -(vx * cx + vy * cy)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                for s in range(5):
                    sx, sy = x + offset_x[s], y + offset_y[s]
                    u = u0 + ux * sx + uy * sy
                    v = v0 + vx * sx + vy * sy
                    t = 1.0 - u - v
                    if u >= -1e-9 and v >= -1e-9 and t >= -1e-9:
                        near = np.float32(u * na + v * nb + t * nc)
                        if near > nearness[y, x, s]:
                            nearness[y, x, s] = near
                            seen[y, x, s] = f
