"""The cameras of a film as a JSON file, so that other programs show their models from the same places.

The form is nerfstudio's camera path, as `ns-render camera-path` reads it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import OPENGL, Camera
from recon.runtime.files import naming, read_json, write_json
from recon.runtime.remote import address_of, fetched

FIXED = {
    "camera_type": ("perspective", "films are made by pinhole cameras"),
    "units": ("mm", "bring the cameras into the world of the capture, and say so by this key"),
}


def write_path(file: Path, cameras: Sequence[Camera], fps: float) -> None:
    """Write the cameras of a film.

    Convention: a camera is `camera_to_world`, 16 numbers row by row, from OpenGL's camera frame (x right, y up, looking
    along -z) to the world of the capture, mm. `fov` is the vertical field of view in degrees, and the optical axis
    meets the middle of the picture.

    Parameters
    ----------
    file : to write
    cameras : one for each frame, all of one size, with square pixels and without distortion
    fps : frames per second
    """
    width, height = cameras[0].size
    content = {
        "camera_type": "perspective",
        "render_height": height,
        "render_width": width,
        "fps": fps,
        "seconds": len(cameras) / fps,
        "units": "mm",
        "keyframes": [],  # of nerfstudio's editor, which makes a path of them
        "is_cycle": False,
        "smoothness_value": 0.0,
        "camera_path": [_described(camera) for camera in cameras],
    }
    write_json(file, content)


def read_path(file: Path, n_frames: int, size: tuple[int, int]) -> tuple[Camera, ...]:
    """Read the cameras of a film, in the convention of `write_path`.

    Parameters
    ----------
    file : to read
    n_frames : how many cameras the film needs
    size : (width, height) of the film, pixels; its shape must be the file's

    Raises
    ------
    ValueError
        If a key is missing or wrong, or the file is for a film of another length or shape.
    """
    content = read_json(fetched(file))
    with naming(address_of(file)):
        return _cameras(content, n_frames, size)


def _described(camera: Camera) -> dict[str, Any]:
    width, height = camera.size
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = camera.rotation.T * OPENGL + 0.0  # no -0.0
    world_from_camera[:3, 3] = camera.centre
    return {
        "camera_to_world": world_from_camera.ravel().tolist(),
        "fov": float(np.rad2deg(2 * np.arctan2(height / 2, camera.K[1, 1]))),
        "aspect": width / height,
    }


def _cameras(content: Mapping[str, Any], n_frames: int, size: tuple[int, int]) -> tuple[Camera, ...]:
    for key, (expected, why) in FIXED.items():
        if content.get(key) != expected:
            raise ValueError(f"{key} is {content.get(key)!r}, expected {expected!r}: {why}")
    _check_shape(_number(content, "render_width"), _number(content, "render_height"), size)
    entries = content.get("camera_path")
    if not isinstance(entries, list):
        raise ValueError(f"camera_path is {entries!r:.80}, expected a list of cameras")
    if len(entries) != n_frames:
        raise ValueError(f"found {len(entries)} cameras, the film has {n_frames} frames; change --seconds or --fps")
    cameras = []
    for number, entry in enumerate(entries):
        with naming(f"camera_path[{number}]"):
            cameras.append(_camera(entry, size))
    return tuple(cameras)


def _camera(entry: Any, size: tuple[int, int]) -> Camera:
    if not isinstance(entry, dict):
        raise ValueError(f"found {entry!r:.80}, expected a camera with camera_to_world, fov and aspect")
    width, height = size
    _check_shape(_number(entry, "aspect"), 1.0, size)
    fov = _number(entry, "fov")
    if fov >= 180:
        raise ValueError(f"fov is {fov:g} degrees, expected less than 180")
    focal = height / 2 / np.tan(np.deg2rad(fov) / 2)
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    cam_from_world = _inverted(_matrix(entry.get("camera_to_world")))
    with naming("camera_to_world, inverted"), np.errstate(over="ignore", invalid="ignore"):  # numbers that are no pose
        return Camera(K, size, cam_from_world)


def _matrix(numbers: Any) -> NDArray[np.float64]:
    """Return the matrix (4, 4) of 16 numbers, row by row."""
    try:
        return np.array(numbers, np.float64).reshape(4, 4)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"camera_to_world is {numbers!r:.80}, expected 16 numbers") from error


def _inverted(world_from_camera: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `cam_from_world` in OpenCV's frame (4, 4), with the last row as it was, so that a wrong one shows."""
    rotation = (world_from_camera[:3, :3] * OPENGL).T
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that are no pose
        translation = -rotation @ world_from_camera[:3, 3]
    return np.vstack([np.column_stack([rotation, translation]), world_from_camera[3]])


def _check_shape(width: float, height: float, size: tuple[int, int]) -> None:
    """Refuse a picture whose width, at the film's height, differs from the film's by a pixel or more."""
    if not abs(width / height * size[1] - size[0]) < 1:
        raise ValueError(f"the picture is {width:g} by {height:g}, the film {size[0]} by {size[1]}; change --size")


def _number(content: Mapping[str, Any], key: str) -> float:
    """Return a positive number at a key."""
    value = content.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 1e-9 < value < 1e9:
        raise ValueError(f"{key} is {value!r:.80}, expected a positive number")
    return float(value)
