"""The empty studio: a floor, and a curtain that hangs around it."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from recon.studio.looks import Colour


@dataclass(frozen=True)
class Room:
    """The studio's floor, and a curtain that hangs around it.

    Parameters
    ----------
    radius : mm, of the curtain around the world's y axis; the sensors stand inside
    floor_y : mm
    """

    radius: float = 3900.0
    floor_y: float = 0.0
    curtain: Colour = (0.36, 0.42, 0.46)
    floor: Colour = (0.40, 0.37, 0.34)
    shift: float = 0.0


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _noise(volume: NDArray[np.float32], x: float, y: float, z: float) -> float:
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    tx, ty, tz = x - fx, y - fy, z - fz
    i0, j0, k0 = np.uint64(np.int64(fx) & 63), np.uint64(np.int64(fy) & 63), np.uint64(np.int64(fz) & 63)
    i1, j1, k1 = (
        np.uint64((np.int64(fx) + 1) & 63),
        np.uint64((np.int64(fy) + 1) & 63),
        np.uint64((np.int64(fz) + 1) & 63),
    )
    tx, ty, tz = tx * tx * (3.0 - 2.0 * tx), ty * ty * (3.0 - 2.0 * ty), tz * tz * (3.0 - 2.0 * tz)
    a = volume[i0, j0, k0] + tz * (volume[i0, j0, k1] - volume[i0, j0, k0])
    b = volume[i0, j1, k0] + tz * (volume[i0, j1, k1] - volume[i0, j1, k0])
    c = volume[i1, j0, k0] + tz * (volume[i1, j0, k1] - volume[i1, j0, k0])
    d = volume[i1, j1, k0] + tz * (volume[i1, j1, k1] - volume[i1, j1, k0])
    a += ty * (b - a)
    c += ty * (d - c)
    return float(a + tx * (c - a))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _step(value: float, low: float, high: float) -> float:
    t = min(1.0, max(0.0, (value - low) / (high - low)))
    return t * t * (3.0 - 2.0 * t)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _layer(volume: NDArray[np.float32], x: float, y: float, z: float, cell: float, footprint: float) -> float:
    """Sample noise with features of `cell` mm; a cell under half a pixel is averaged away."""
    if cell < 0.5 * footprint:
        return 0.0
    inverse = 1.0 / cell
    fade = 1.0 if cell > 1.5 * footprint else cell / footprint - 0.5
    return float(fade * _noise(volume, x * inverse, y * inverse + 0.37 * cell, z * inverse))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def room_plate(
    slopes: NDArray[np.float64],
    camera_to_world: NDArray[np.float64],
    eye: NDArray[np.float64],
    spread: float,
    radius: float,
    floor_y: float,
    curtain: NDArray[np.float64],
    floor: NDArray[np.float64],
    shift: float,
    volume: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Colour the empty studio, linear, float32 (H, W, 3).

    Parameters
    ----------
    slopes : float64 (H, W, 2), x / z and y / z of every pixel's ray in the camera
    camera_to_world : float64 (3, 3), world axes from camera axes; eye : float64 (3,)
    spread : size of a pixel at a distance of 1 mm
    """
    height, width = slopes.shape[0], slopes.shape[1]
    colours = np.empty((height, width, 3), np.float32)
    for row in range(height):
        for column in range(width):
            cx, cy = slopes[row, column, 0], slopes[row, column, 1]
            dx = camera_to_world[0, 0] * cx + camera_to_world[0, 1] * cy + camera_to_world[0, 2]
            dy = camera_to_world[1, 0] * cx + camera_to_world[1, 1] * cy + camera_to_world[1, 2]
            dz = camera_to_world[2, 0] * cx + camera_to_world[2, 1] * cy + camera_to_world[2, 2]
            a, b = dx * dx + dz * dz, eye[0] * dx + eye[2] * dz
            t = (-b + np.sqrt(b * b - a * (eye[0] * eye[0] + eye[2] * eye[2] - radius * radius))) / a
            on_floor = dy < 0.0 and (floor_y - eye[1]) / dy < t
            if on_floor:
                t = (floor_y - eye[1]) / dy
            x, y, z = eye[0] + t * dx, eye[1] + t * dy, eye[2] + t * dz
            fp = t * spread
            if on_floor:
                tone = (
                    1.0
                    + 0.10 * _layer(volume, x + shift, 0.0, z, 260.0, fp)
                    + 0.12 * _layer(volume, x, 3.0, z, 60.0, fp)
                )
                tone += 0.14 * _layer(volume, x, 7.0, z, 14.0, fp) + 0.18 * _layer(volume, x, 11.0, z, 5.0, fp)
                tone += 0.20 * _layer(volume, x, 15.0, z, 2.3, fp)
                pool = 0.42 + 0.95 * np.exp(-(x * x + z * z) / 5.0e6)
                near_wall = _step(radius - np.sqrt(x * x + z * z), -50.0, 500.0)
                light = pool * (0.55 + 0.45 * near_wall)
                r, g, bl = floor[0] * tone * light, floor[1] * tone * light, floor[2] * tone * light
            else:
                arc = np.arctan2(x, z) * radius
                sway = 60.0 * _noise(volume, arc / 420.0 + shift, y / 1400.0, 0.3)
                pleat = np.sin(6.2831853 * (arc + sway) / 190.0) + 0.35 * np.sin(6.2831853 * (arc - 0.5 * sway) / 73.0)
                tone = 0.80 + 0.17 * pleat + 0.08 * _layer(volume, arc, y, 5.0, 120.0, fp)
                tone += 0.09 * _layer(volume, arc, 0.4 * y, 5.0, 17.0, fp) + 0.12 * _layer(volume, arc, y, 9.0, 4.5, fp)
                fall = 0.55 + 0.30 * _step(y, -200.0, 1600.0) - 0.10 * _step(y, 2000.0, 3200.0)
                fall *= 0.55 + 0.45 * _step(y - floor_y, -60.0, 260.0)
                r, g, bl = curtain[0] * tone * fall, curtain[1] * tone * fall, curtain[2] * tone * fall
            colours[row, column, 0], colours[row, column, 1], colours[row, column, 2] = r, g, bl
    return colours
