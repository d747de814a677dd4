"""A tiny recording made on the spot: a textured board before a dark background, seen by stereo sensors."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import CameraStream, Capture, SensorStream, image_path, write_capture
from recon.geometry.rig import Camera, look_at

SIZE = (160, 120)
TEXELS = 200  # of the board, 1 mm each
BOARD_BOUNDS = np.array([[-70.0, -70.0, -15.0], [70.0, 70.0, 15.0]])


def board_texture(seed: int) -> NDArray[np.uint8]:
    """Smooth noise of several sizes between 70 and 250 grey levels, (TEXELS, TEXELS, 3)."""
    rng = np.random.default_rng(seed)
    layers = [cv2.resize(rng.random((n, n, 3)), (TEXELS, TEXELS), interpolation=cv2.INTER_CUBIC) for n in (12, 25, 50)]
    noise = np.sum(layers, axis=0)
    spread = (noise - noise.min()) / (noise.max() - noise.min())
    return np.asarray(70 + 180 * spread, dtype=np.uint8)


def board_view(camera: Camera, texture: NDArray[np.uint8], shift_mm: float = 0.0) -> NDArray[np.uint8]:
    """What a camera without distortion sees of a board in the plane z = 0 about the world's origin."""
    half = TEXELS / 4  # the board is 100 mm wide, half a millimetre a texel
    texel_to_world = np.array([[0.5, 0, -half + shift_mm], [0, -0.5, half], [0, 0, 1]])
    plane = camera.cam_from_world[:3][:, [0, 1, 3]]
    return cv2.warpPerspective(
        texture, camera.K @ plane @ texel_to_world, camera.size, flags=cv2.INTER_LINEAR, borderValue=(6, 6, 6)
    )


def board_camera(x: float, y: float = 0.0) -> Camera:
    """A camera 600 mm before the board that looks at its centre."""
    K = [[500.0, 0, 82.5], [0, 505.0, 57.0], [0, 0, 1]]
    return Camera(np.array(K), SIZE, look_at((x, y, 600.0), (0.0, 0.0, 0.0)))


def record_board(folder: Path, *, n_sensors: int = 2, n_frames: int = 2, plates: bool = False) -> Capture:
    """Write a capture of the board, which moves by 3 mm a frame."""
    sensors = tuple(_sensor(number, plates) for number in range(n_sensors))
    for stream in sensors:
        _photograph(folder, stream, n_frames)
    capture = Capture(folder, "board", "scene", 25.0, n_frames, BOARD_BOUNDS, {}, sensors)
    write_capture(capture)
    return capture


def _sensor(number: int, plates: bool) -> SensorStream:
    name, x = f"S{number + 1}", -100.0 + 200.0 * number
    left, right = (
        CameraStream(board_camera(x + offset), f"{name}/{side}/{{frame:04d}}.png")
        for side, offset in (("left", -20.0), ("right", 20.0))
    )
    return SensorStream(name, left, right, (f"{name}/plate_l.png", f"{name}/plate_r.png") if plates else None)


def _photograph(folder: Path, stream: SensorStream, n_frames: int) -> None:
    texture = board_texture(seed=0)
    for frame in range(n_frames):
        for side in (stream.left, stream.right):
            path = image_path(folder, side.image, frame)
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), board_view(side.camera, texture, shift_mm=3.0 * frame)[..., ::-1])
    for name in stream.plate or ():
        cv2.imwrite(str(folder / name), np.full((SIZE[1], SIZE[0], 3), 6, dtype=np.uint8))
