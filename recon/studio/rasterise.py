"""Visibility: which triangle a camera sees at each pixel, by five samples, one of them at its centre.

The centre's sample is the ground truth (a pixel is where its centre's ray goes); the other four smooth the outlines.
Open3D's ray casting sees the same triangle at 99.99 % of the pixels and takes ten times as long: 0.16 s of processor
time for a person before a camera instead of 0.017 s. It would also need the rays of a distorted lens.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import Camera

N_SAMPLES = 5
NEAREST_MM = 50.0
N_DISTORTION = 5  # k1, k2, p1, p2, k3


class Visibility(NamedTuple):
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

    def depths(self, size: tuple[int, int]) -> NDArray[np.float64]:
        """Return the depth z at each pixel's centre of a whole image, float64 (H, W), mm; 0 where there is nothing.

        `size` is its (width, height), pixels.
        """
        near = self.nearness[..., 0].astype(np.float64)
        depths = np.zeros(size[::-1])
        window = depths[self.row : self.row + len(near), self.column : self.column + near.shape[1]]
        np.divide(1.0, near, out=window, where=near > 0)
        return depths


def see(camera: Camera, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> Visibility:
    """Rasterise a closed mesh; faces that turn their back on the camera are skipped.

    Convention: vertices are distorted, edges stay straight: triangles of a few pixels are exact to 0.01 px.

    Parameters
    ----------
    vertices : float64 (N, 3), mm, world
    faces : int32 (M, 3), counter-clockwise seen from outside

    Raises
    ------
    ValueError
        If a vertex lies behind the camera or closer than NEAREST_MM, or the camera's distortion has more than
        N_DISTORTION coefficients.
    """
    if camera.dist.size > N_DISTORTION:
        raise ValueError(f"dist has {camera.dist.size} coefficients, expected at most {N_DISTORTION}")
    dist = np.zeros(N_DISTORTION)
    dist[: camera.dist.size] = camera.dist
    pixels, extent = _project(vertices, np.ascontiguousarray(camera.cam_from_world[:3]), camera.K, dist)
    if extent[0, 2] < NEAREST_MM:
        raise ValueError(f"a surface comes within {extent[0, 2]:.0f} mm of a camera; keep {NEAREST_MM:.0f} mm")
    low = np.maximum(np.floor(extent[0, :2]).astype(int) - 1, 0)
    high = np.minimum(np.ceil(extent[1, :2]).astype(int) + 2, camera.size)
    w, h = np.maximum(high - low, 0)
    seen = np.full((h, w, N_SAMPLES), -1, np.int32)
    nearness = np.zeros((h, w, N_SAMPLES), np.float32)
    _rasterise(pixels, faces, int(low[0]), int(low[1]), seen, nearness)
    return Visibility(int(low[0]), int(low[1]), seen, nearness, pixels)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _project(
    vertices: NDArray[np.float64], pose: NDArray[np.float64], K: NDArray[np.float64], dist: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Project points to column, row and 1 / z (N, 3); return also the lowest and highest (2, 3) column, row, z."""
    pixels = np.empty((len(vertices), 3))
    extent = np.empty((2, 3))
    k1, k2, p1, p2, k3 = dist[0], dist[1], dist[2], dist[3], dist[4]
    for i in range(3):
        extent[0, i], extent[1, i] = np.inf, -np.inf
    for i in range(len(vertices)):
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        near = 1.0 / depth
        a = near * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3])
        b = near * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3])
        r2 = a * a + b * b
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        u = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
        v = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
        column, row = K[0, 0] * u + K[0, 1] * v + K[0, 2], K[1, 1] * v + K[1, 2]
        pixels[i, 0], pixels[i, 1], pixels[i, 2] = column, row, near
        extent[0, 0], extent[1, 0] = min(extent[0, 0], column), max(extent[1, 0], column)
        extent[0, 1], extent[1, 1] = min(extent[0, 1], row), max(extent[1, 1], row)
        extent[0, 2], extent[1, 2] = min(extent[0, 2], depth), max(extent[1, 2], depth)
    return pixels, extent


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _rasterise(
    pixels: NDArray[np.float64],
    faces: NDArray[np.int32],
    column: int,
    row: int,
    seen: NDArray[np.int32],
    nearness: NDArray[np.float32],
) -> None:
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
        # No sample of a pixel can lie inside where its centre is this far outside.
        u_low = -0.375 * (abs(ux) + abs(uy)) - 1e-9
        v_low = -0.375 * (abs(vx) + abs(vy)) - 1e-9
        t_low = -0.375 * (abs(ux + vx) + abs(uy + vy)) - 1e-9
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                u_middle = u0 + ux * x + uy * y
                v_middle = v0 + vx * x + vy * y
                if u_middle < u_low or v_middle < v_low or 1.0 - u_middle - v_middle < t_low:
                    continue
                for s in range(5):
                    u = u_middle + ux * offset_x[s] + uy * offset_y[s]
                    v = v_middle + vx * offset_x[s] + vy * offset_y[s]
                    if u >= -1e-9 and v >= -1e-9 and u + v <= 1.0 + 1e-9:
                        near = np.float32(nc + u * (na - nc) + v * (nb - nc))
                        if near > nearness[y, x, s]:
                            nearness[y, x, s] = near
                            seen[y, x, s] = f
