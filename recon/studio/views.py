"""A camera of the studio with all that stays the same from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from recon.capture.rectify import viewing_directions
from recon.geometry.rig import Camera
from recon.studio.light.appearance import Rays, Room, room_plate
from recon.studio.light.exposure import plate_values
from recon.studio.light.looks import linear
from recon.studio.light.shadow import FLOOR_CELLS, FLOOR_HALF_MM

CURTAIN_MM = 3900.0  # radius of the curtain around the world's y axis; the sensors stand inside
FLOOR_Y_MM = 0.0
LEAST_GAIN = 0.1  # of a camera whose exposure is drawn from a wide spread: with less than none, actors were white
CURTAIN, FLOOR = (0.36, 0.42, 0.46), (0.40, 0.37, 0.34)  # sRGB, 0 to 1


@dataclass(frozen=True, eq=False)
class View:
    """A camera in the empty studio.

    Parameters
    ----------
    name : its folder in the capture
    gains : float64 (3,), exposure per channel
    plate : float32 (H, W, 3), display values 0 to 255 of the empty studio, not rounded
    floor_cells : float32 (H, W, 2), column and row in `shadow.floor_shade` of each pixel, -1 where it shows no floor
    """

    name: str
    camera: Camera
    gains: NDArray[np.float64]
    plate: NDArray[np.float32]
    floor_cells: NDArray[np.float32]

    def as_json(self) -> dict[str, Any]:
        """Return the camera's true values."""
        return {
            "view": self.name,
            "K": self.camera.K.tolist(),
            "dist": self.camera.dist.tolist(),
            "cam_from_world": self.camera.cam_from_world.tolist(),
            "gains": self.gains.tolist(),
        }


def empty_view(
    name: str,
    camera: Camera,
    noise: NDArray[np.float32],
    rng: np.random.Generator,
    *,
    spread: float,
    cast: NDArray[np.float64],
) -> View:
    """Make a camera with its own exposure and white balance, and its picture of the empty studio.

    Parameters
    ----------
    name : the camera's folder in the capture
    camera : its calibration
    noise : float32 (S, S, S), for the room's texture
    rng : draws exposure and white balance
    spread : standard deviation of the exposure, share; a quarter of it for the white balance
    cast : float64 (3,), further gains
    """
    exposure, red, blue = np.maximum(1.0 + spread * rng.normal(size=3) * (1.0, 0.25, 0.25), LEAST_GAIN)
    gains = exposure * np.array([red, 1.0, blue]) * cast
    slopes = pixel_slopes(camera)
    axes = np.ascontiguousarray(camera.rotation.T)
    rays = Rays(slopes, axes, camera.centre, 1.0 / camera.K[0, 0])
    plate = room_plate(rays, Room(CURTAIN_MM, FLOOR_Y_MM, linear(CURTAIN), linear(FLOOR)), noise)
    cells = _cells_below(slopes, axes, camera.centre, FLOOR_Y_MM, FLOOR_CELLS, FLOOR_HALF_MM)
    return View(name, camera, gains, plate_values(plate, gains), cells)


def pixel_slopes(camera: Camera) -> NDArray[np.float64]:
    """Compute x / z and y / z, float64 (H, W, 2), of the rays through all pixels' centres, in the camera."""
    width, height = camera.size
    pixels = np.stack(np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)), axis=-1)
    if not camera.dist.any():
        return np.asarray((pixels - camera.K[:2, 2]) / np.diag(camera.K)[:2])
    return viewing_directions(camera, pixels.reshape(-1, 2))[:, :2].reshape(height, width, 2)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _cells_below(
    slopes: NDArray[np.float64],
    camera_to_world: NDArray[np.float64],
    eye: NDArray[np.float64],
    floor_y: float,
    n_cells: int,
    half: float,
) -> NDArray[np.float32]:
    """Find the floor cell below each pixel: the ray eye + t d meets the floor at t = (eye_y - floor_y) / -d_y."""
    cells = np.full(slopes.shape, -1.0, np.float32)
    turn, scale = camera_to_world, n_cells / (2.0 * half)
    for row in range(slopes.shape[0]):
        for column in range(slopes.shape[1]):
            x, y = slopes[row, column, 0], slopes[row, column, 1]
            down = -(turn[1, 0] * x + turn[1, 1] * y + turn[1, 2])
            if down <= 0.0:
                continue
            t = (eye[1] - floor_y) / down
            u = scale * (eye[0] + t * (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2]) + half)
            v = scale * (eye[2] + t * (turn[2, 0] * x + turn[2, 1] * y + turn[2, 2]) + half)
            if 0.0 <= u < n_cells - 1 and 0.0 <= v < n_cells - 1:
                cells[row, column, 0], cells[row, column, 1] = u, v
    return cells
