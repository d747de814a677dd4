"""The light on actors and objects, and the highlights that glossy ones send to a camera.

Light changes slowly over a body, so it is computed at the vertices and interpolated between them; `appearance` computes
colours at every pixel. Lights are rows as in `looks`.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

N_LIT = 7  # numbers per vertex that `appearance.shade` reads


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def lit(surface: NDArray[np.float32], lights: NDArray[np.float64], eye: NDArray[np.float64]) -> NDArray[np.float32]:
    """Light every vertex as a camera sees it.

    Returns float32 (N, N_LIT): place at rest, light on a white surface (linear RGB), a mirror's share towards the eye.

    Parameters
    ----------
    surface : float32 (N, 11), per vertex: place at rest, normal, place in the world, openness, share of the key light
    lights : float64 (2 + lights, 6), as in `looks.light_table`
    eye : float64 (3,), mm, the camera's centre
    """
    result = np.empty((len(surface), 7), np.float32)
    softness = lights[1, 0]
    scale = 1.0 / (1.0 + softness)
    for i in range(len(surface)):
        nx, ny, nz = surface[i, 3], surface[i, 4], surface[i, 5]
        vx, vy, vz = eye[0] - surface[i, 6], eye[1] - surface[i, 7], eye[2] - surface[i, 8]
        near = 1.0 / np.sqrt(vx * vx + vy * vy + vz * vz)
        vx, vy, vz = near * vx, near * vy, near * vz
        openness = surface[i, 9]
        up = 0.5 + 0.5 * ny
        red = openness * (lights[0, 3] + up * (lights[0, 0] - lights[0, 3]))
        green = openness * (lights[0, 4] + up * (lights[0, 1] - lights[0, 4]))
        blue = openness * (lights[0, 5] + up * (lights[0, 2] - lights[0, 5]))
        shine = 0.0
        for light in range(2, len(lights)):
            lx, ly, lz = lights[light, 0], lights[light, 1], lights[light, 2]
            facing = scale * (nx * lx + ny * ly + nz * lz + softness)
            if facing <= 0.0:
                continue
            facing *= 0.45 + 0.55 * openness
            if light == 2:
                facing *= surface[i, 10]
            red += facing * lights[light, 3]
            green += facing * lights[light, 4]
            blue += facing * lights[light, 5]
            hx, hy, hz = lx + vx, ly + vy, lz + vz
            half = (nx * hx + ny * hy + nz * hz) / np.sqrt(hx * hx + hy * hy + hz * hz)
            if half > 0.0:
                half *= half
                half *= half
                half *= half
                shine += facing * half * half * lights[light, 4]
        result[i, 0], result[i, 1], result[i, 2] = surface[i, 0], surface[i, 1], surface[i, 2]
        result[i, 3], result[i, 4], result[i, 5], result[i, 6] = red, green, blue, shine
    return result
