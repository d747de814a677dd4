"""COLMAP text models as captures: pairs of registered images are stereo sensors.

Convention: COLMAP's poses are world to camera, quaternions w, x, y, z; its pixel centres are at halves, so that the
principal point moves by half a pixel; its scale is arbitrary, so that the unit's length has to be given. Its world is
kept except for the axis that points upwards.

Source: Schoenberger, Frahm, "Structure-from-motion revisited", CVPR 2016; COLMAP's description of its text format.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.capture.format import Capture
from recon.capture.images import IMAGE_SUFFIXES, CaptureError
from recon.capture.importing.sources import ImportOptions, Recording, SensorSource, write_recording
from recon.capture.pictures import find_pictures
from recon.rig import Camera, rigid

HALF_PIXEL = 0.5
BOUNDS_SHARE = (0.02, 0.98)  # of the points, on each axis: reconstructions have stray ones
BOUNDS_MARGIN = 0.05  # of the longest edge
MODELS: dict[str, tuple[int, tuple[int, ...]]] = {
    "SIMPLE_PINHOLE": (1, ()),
    "PINHOLE": (2, ()),
    "SIMPLE_RADIAL": (1, (0,)),
    "RADIAL": (1, (0, 1)),
    "OPENCV": (2, (0, 1, 2, 3)),
    "FULL_OPENCV": (2, (0, 1, 2, 3, 4, 5, 6, 7)),
}  # how many focal lengths come first, and where the numbers after the principal point stand in OpenCV's distortion


@dataclass(frozen=True, eq=False)
class _View:
    name: str
    camera: Camera


def import_colmap(
    source: Path, out: Path, pairs: Sequence[tuple[int, int]] | None, options: ImportOptions | None = None
) -> Capture:
    """Turn a COLMAP text model and its images into a capture.

    Parameters
    ----------
    source : folder with `cameras.txt`, `images.txt` and perhaps `points3D.txt`, from which the bounds come; the
        images lie in its sub-folder `images` or in itself. A folder or a video named as an image without its
        suffix holds the frames that this camera recorded; else the image is the only frame, and images that no
        pair uses are held out
    pairs : IMAGE_ID of each sensor's (left, right)
    options : the unit's length has to be given

    Raises
    ------
    CaptureError
        Naming the file, the line and what is wrong in it. Nothing is left behind.
    """
    options = options or ImportOptions()
    if options.unit_mm is None:
        raise CaptureError(f"{source}: COLMAP's scale is arbitrary; give the length of its unit in mm")
    views = _read_views(source, options.unit_mm)
    ids = {view for pair in pairs or () for view in pair}
    if not pairs or not ids <= views.keys():
        listed = ", ".join(f"{number} {view.name}" for number, view in views.items())
        raise CaptureError(f"{source}: the pairs name {sorted(ids)}, expected pairs of IMAGE_IDs out of: {listed}")
    images = source / "images" if (source / "images").is_dir() else source
    sensors = tuple(_sensor(f"S{number}", views, pair, images) for number, pair in enumerate(pairs, start=1))
    is_still = all(len(side.files) == 1 and not side.is_video for sensor in sensors for side in sensor.pictures)
    held_out = [(view.camera, images / view.name) for number, view in views.items() if number not in ids and is_still]
    recording = Recording(
        source.name,
        sensors,
        bounds=_bounds(source / "points3D.txt", options.unit_mm),
        held_out=tuple((camera, path) for camera, path in held_out if path.is_file()),
    )
    return write_recording(out, recording, options)


def _sensor(sensor_id: str, views: dict[int, _View], pair: tuple[int, int], images: Path) -> SensorSource:
    left, right = (views[number] for number in pair)
    pictures = [find_pictures(_recorded(images / view.name)) for view in (left, right)]
    return SensorSource(sensor_id, left.camera, right.camera, (pictures[0], pictures[1]))


def _recorded(image: Path) -> Path:
    return image.with_suffix("") if image.suffix.lower() in IMAGE_SUFFIXES else image


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return line numbers and words of all lines but comments."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CaptureError(f"{path}: cannot be read as a COLMAP text model: {error}") from error
    return [(number, line.split()) for number, line in enumerate(lines, start=1) if not line.startswith("#")]


def _read_views(source: Path, unit_mm: float) -> dict[int, _View]:
    path = source / "images.txt"
    cameras = _read_cameras(source / "cameras.txt")
    rows = _rows(path)
    views = {}
    for number, words in rows[::2]:  # every second line lists the image's points
        try:
            values = np.array(words[1:8], dtype=np.float64)
            if len(words) < 10:
                raise ValueError(f"{len(words)} words, expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
            if words[8] not in cameras:
                raise ValueError(f"camera {words[8]} is not in cameras.txt")
            rotation = Rotation.from_quat(np.roll(values[:4], -1)).as_matrix()
            pose = rigid(rotation, values[4:] * unit_mm)
            views[int(words[0])] = _View(" ".join(words[9:]), replace(cameras[words[8]], cam_from_world=pose))
        except ValueError as error:
            raise CaptureError(f"{path}, line {number}: {error}") from error
    return views


def _read_cameras(path: Path) -> dict[str, Camera]:
    cameras = {}
    for number, words in _rows(path):
        if not words:
            continue
        try:
            cameras[words[0]] = _camera(words[1], words[2:4], np.array(words[4:], dtype=np.float64))
        except (ValueError, IndexError) as error:
            raise CaptureError(f"{path}, line {number}: {error}") from error
    return cameras


def _camera(model: str, size: list[str], numbers: NDArray[np.float64]) -> Camera:
    if model not in MODELS:
        raise ValueError(f"camera model {model}, expected one of {', '.join(MODELS)}; undistort the images with COLMAP")
    n_focal, places = MODELS[model]
    if len(numbers) != n_focal + 2 + len(places):
        raise ValueError(f"{len(numbers)} numbers for {model}, expected {n_focal + 2 + len(places)}")
    focal, centre = numbers[:n_focal], numbers[n_focal : n_focal + 2] - HALF_PIXEL
    dist = np.zeros(max(4, len(places)) if places else 0)
    dist[list(places)] = numbers[n_focal + 2 :]
    K = np.array([[focal[0], 0, centre[0]], [0, focal[-1], centre[1]], [0, 0, 1]])
    return Camera(K, (int(size[0]), int(size[1])), np.eye(4), dist)


def _bounds(path: Path, unit_mm: float) -> NDArray[np.float64] | None:
    if not path.is_file():
        return None
    try:
        points = np.array([words[1:4] for _, words in _rows(path) if words], dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise CaptureError(f"{path}: {error}") from error
    if len(points) < 2:
        return None
    box = np.quantile(points * unit_mm, BOUNDS_SHARE, axis=0)
    margin = BOUNDS_MARGIN * float((box[1] - box[0]).max())
    return np.asarray(box + np.array([[-margin], [margin]]))
