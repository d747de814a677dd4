"""A camera of the studio with all that stays the same from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.rig import Camera
from recon.studio.exposure import plate_values
from recon.studio.room import Room, room_plate
from recon.studio.shadow import FLOOR_CELLS, FLOOR_HALF_MM


@dataclass(frozen=True, eq=False)
class View:
    """A camera in the empty studio.

    Parameters
    ----------
    name : its folder in the capture
    gains : float64 (3,), exposure per channel
    plate : float32 (H, W, 3), display values 0 to 255 of the empty studio, not rounded
    floor_map : float64 (3, 3), cell of `shadow.floor_shade` from pixel; the third row is positive where the ray falls
    """

    name: str
    camera: Camera
    gains: NDArray[np.float64]
    plate: NDArray[np.float32]
    floor_map: NDArray[np.float64]

    def as_json(self) -> dict[str, Any]:
        """The camera's true values."""
        return {
            "view": self.name,
            "K": self.camera.K.tolist(),
            "cam_from_world": self.camera.cam_from_world.tolist(),
            "gains": self.gains.tolist(),
        }


def empty_view(
    name: str, camera: Camera, room: Room, noise: NDArray[np.float32], rng: np.random.Generator, *, spread: float
) -> View:
    """A camera with its own exposure and white balance, of standard deviation `spread` and a quarter of it."""
    exposure, red, blue = 1.0 + spread * rng.normal(size=3) * (1.0, 0.25, 0.25)
    gains = exposure * np.array([red, 1.0, blue])
    plate = room_plate(
        camera.size[1], camera.size[0], np.linalg.inv(camera.K), np.ascontiguousarray(camera.rotation.T), camera.centre,
        room.radius, room.floor_y, np.power(room.curtain, 2.2), np.power(room.floor, 2.2), room.shift, noise,
    )  # fmt: skip
    return View(name, camera, gains, plate_values(plate, gains), _floor_map(camera, room.floor_y))


def _floor_map(camera: Camera, floor_y: float) -> NDArray[np.float64]:
    """The ray eye + t d of a pixel meets the floor at t = (eye_y - floor_y) / -d_y: a homography."""
    rays = camera.rotation.T @ np.linalg.inv(camera.K)
    eye, down = camera.centre, -rays[1]
    x = eye[0] * down + (eye[1] - floor_y) * rays[0]
    z = eye[2] * down + (eye[1] - floor_y) * rays[2]
    scale = FLOOR_CELLS / (2 * FLOOR_HALF_MM)
    return np.stack([scale * (x + FLOOR_HALF_MM * down), scale * (z + FLOOR_HALF_MM * down), down])
