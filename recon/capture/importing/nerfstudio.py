"""nerfstudio's datasets (`transforms.json`) as captures: photographs in pairs, or with depth maps.

Convention: a pose is camera to world, the camera's frame that of OpenGL (x right, y up, looking along -z); pixel
centres are at halves. `applied_transform` and `applied_scale` say how poses and points were made from those of the
original data, x = applied_scale * applied_transform * x_original: they are undone. The world has z up after that
transform. Depth maps hold z in thousandths of the original unit.

Source: nerfstudio's "Data conventions", and `nerfstudio_dataparser.py`, which reads such datasets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.depth_maps import read_depth_values
from recon.capture.format import Capture
from recon.capture.images import PICTURE_SUFFIXES, CaptureError
from recon.capture.importing.into_capture import write_recording
from recon.capture.importing.lenses import FisheyeCamera
from recon.capture.importing.sources import DepthSource, ImportOptions, faults_at, parse_unit
from recon.capture.importing.views import HALF_PIXEL, View, bounds_of_points, choose_sensors, pictures_of, tell_absent
from recon.geometry.lens_names import FISHEYE, model_name, plain_name
from recon.geometry.mesh_files import read_points
from recon.geometry.rig import OPENGL, Camera, rigid
from recon.runtime.files import allowed, first_of, in_any_case, read_json

TRANSFORMS = "transforms.json"
PERSPECTIVE = ("opencv", "pinhole", "simple_pinhole", "simple_radial", "radial", "full_opencv")
DISTORTION = ("k1", "k2", "p1", "p2", "k3")  # in OpenCV's order
RATIONAL = ("k4", "k5", "k6")  # likewise, of full_opencv alone
UNREAD = (*RATIONAL, "s1", "s2", "s3", "s4")  # which mean something else, or nothing, in other models
LISTED = ("k1", "k2", "k3", "k4", "p1", "p2")  # the order of `distortion_params`
DEPTHS_IN_UNIT = 1000.0  # nerfstudio's depth_unit_scale_factor


@dataclass(frozen=True, eq=False)
class _Dataset:
    """The JSON's content, its folder, the length of its original unit, and how saved coordinates were made."""

    folder: Path
    content: Mapping[str, Any]
    unit_mm: float
    transform: NDArray[np.float64]  # (4, 4), saved from original, without the scale
    scale: float

    def original(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return points (N, 3) in the original coordinates, mm."""
        moved = np.asarray(points, np.float64) / self.scale - self.transform[:3, 3]
        return np.asarray(moved @ self.transform[:3, :3] * self.unit_mm)

    @property
    def up(self) -> str:
        """The original axis that is nearest to the saved z axis, which points upwards."""
        upwards = self.transform[2, :3]
        axis = int(np.abs(upwards).argmax())
        return ("" if upwards[axis] > 0 else "-") + "xyz"[axis]


def import_nerfstudio(
    source: Path, out: Path, pairs: Sequence[tuple[int, int]] | None = None, options: ImportOptions | None = None
) -> Capture:
    """Turn a nerfstudio dataset into a capture.

    Parameters
    ----------
    source : the `transforms.json`, or its folder. A folder or a video named as an image without its suffix holds the
        frames of this camera
    out : the capture's folder, absent or empty
    pairs : numbers of each stereo sensor's (left, right), counted from 1 in the order of `frames`; all other views with
        depth maps that are not in `test_filenames` become sensors, and the rest is held out
    options : the unit's length has to be given unless the file has a key `units`

    Raises
    ------
    CaptureError
        Naming the file, the frame and what is wrong in it. Nothing is left behind.
    """
    path = in_any_case(source / TRANSFORMS) if source.is_dir() else source
    options, content = options or ImportOptions(), read_json(path)
    if options.unit_mm is None and "units" not in content:
        raise CaptureError(f"{path}: the scale is arbitrary; give the length of its unit in mm by --units")
    with faults_at(path):
        dataset = _dataset(path.parent, content, options.unit_mm)
        frames = dict(enumerate(_frames(content), start=1))
        absent = {number for number, frame in frames.items() if not _can_be_placed(dataset, frame)}
        tell_absent(path, [str(frames[number]["file_path"]) for number in absent])
        views = {number: _view(dataset, frame, number) for number, frame in frames.items() if number not in absent}
        bounds = _bounds(dataset)
    return write_recording(out, choose_sensors(source, views, pairs or (), bounds, dataset.up), options)


def _dataset(folder: Path, content: Mapping[str, Any], unit_mm: float | None) -> _Dataset:
    transform = np.array(content.get("applied_transform", np.eye(4)[:3]), np.float64)[:3]
    if transform.shape != (3, 4):
        raise CaptureError(f"applied_transform has shape {transform.shape}, expected (3, 4)")
    scale = float(content.get("applied_scale", 1.0))
    if not scale > 0:
        raise CaptureError(f"applied_scale is {scale:g}, expected a positive number")
    unit = unit_mm or parse_unit(str(content["units"]))
    return _Dataset(folder, content, unit, np.vstack([transform, [0.0, 0.0, 0.0, 1.0]]), scale)


def _frames(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    frames = content["frames"]
    if not isinstance(frames, list) or not frames or not all(isinstance(frame, dict) for frame in frames):
        raise CaptureError(f"frames is {frames!r:.80}, expected a list of images")
    return frames


def _can_be_placed(dataset: _Dataset, frame: Mapping[str, Any]) -> bool:
    """Tell whether the size of a frame's picture can be known: it is said, or the picture is there."""
    name = str(frame.get("file_path", ""))
    image = in_any_case(dataset.folder / name)
    is_said = all(key in {**dataset.content, **frame} for key in "wh")
    return is_said or not name or image.exists() or any(image.parent.glob(f"{escape(image.stem)}*"))


def _view(dataset: _Dataset, frame: Mapping[str, Any], number: int) -> View:
    name = str(frame.get("file_path", ""))
    with faults_at(f"frame {number} {name}"):
        if not name:
            raise CaptureError("file_path is missing")
        image = in_any_case(dataset.folder / name)
        if not image.suffix and not image.exists():  # as in the synthetic scenes of NeRF
            image = first_of(dataset.folder, (name + suffix for suffix in PICTURE_SUFFIXES)) or image
        camera = _camera(_with_listed({**dataset.content, **frame}), image, _pose(dataset, frame))
        is_test = name in dataset.content.get("test_filenames", ())
        depth = None if is_test else _depth(dataset, frame, camera)
        mask = allowed(dataset.folder / str(frame["mask_path"])) if "mask_path" in frame else None
        return View(name, camera, image, depth, is_test, mask)


def _pose(dataset: _Dataset, frame: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return `cam_from_world` in OpenCV's frame (4, 4), the world being the original one, mm."""
    saved = np.array(frame["transform_matrix"], np.float64)
    if saved.shape not in ((4, 4), (3, 4)):
        raise CaptureError(f"transform_matrix has shape {saved.shape}, expected (4, 4)")
    rotation = (dataset.transform[:3, :3].T @ saved[:3, :3] * OPENGL).T
    return rigid(rotation, -rotation @ dataset.original(saved[None, :3, 3])[0])


def _with_listed(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return an entry with the numbers of its list `distortion_params`, if it has one, at their own keys."""
    listed = entry.get("distortion_params", ())
    if len(listed) not in (0, len(LISTED)):
        raise CaptureError(f"distortion_params has {len(listed)} numbers, expected {', '.join(LISTED)}")
    lens = dict(zip(LISTED, map(float, listed), strict=False))
    if differing := [key for key, number in lens.items() if float(entry.get(key, number)) != number]:
        raise CaptureError(
            f"{differing[0]} is {entry[differing[0]]}, but distortion_params has another; keep the right"
        )
    return {**entry, **lens}


def _camera(entry: Mapping[str, Any], image: Path, cam_from_world: NDArray[np.float64]) -> Camera:
    """Make a camera of a frame's entry, whose own numbers come before those of all frames."""
    told = model_name(entry) or "OPENCV"
    model = plain_name(told)
    if model not in (*PERSPECTIVE, *FISHEYE):
        known = ", ".join(name.upper() for name in (*PERSPECTIVE, "opencv_fisheye"))
        raise CaptureError(f"camera_model is {told}, expected one of {known}; undistort the images")
    unread = [key for key in UNREAD[3 if model == "full_opencv" else 0 :] if float(entry.get(key, 0.0))]
    if model in PERSPECTIVE and unread:
        raise CaptureError(
            f"{unread[0]} is not 0, which a perspective camera of the model {told} does not know; undistort the images"
        )
    is_known = "w" in entry and "h" in entry
    width, height = (int(entry["w"]), int(entry["h"])) if is_known else pictures_of(image).size
    focal = float(entry["fl_x"]) if "fl_x" in entry else width / 2 / np.tan(float(entry["camera_angle_x"]) / 2)
    K = np.array(
        [
            [focal, 0, float(entry.get("cx", width / 2)) - HALF_PIXEL],
            [0, float(entry.get("fl_y", focal)), float(entry.get("cy", height / 2)) - HALF_PIXEL],
            [0, 0, 1],
        ]
    )
    if model in FISHEYE:
        lens = np.array([float(entry.get(f"k{number}", 0.0)) for number in range(1, 5)])
        return FisheyeCamera(K, (width, height), cam_from_world, lens=lens)
    dist = np.array(
        [float(entry.get(key, 0.0)) for key in (*DISTORTION, *(RATIONAL if model == "full_opencv" else ()))]
    )
    return Camera(K, (width, height), cam_from_world, dist if dist.any() else np.zeros(0))


def _depth(dataset: _Dataset, frame: Mapping[str, Any], camera: Camera) -> DepthSource | None:
    """Return the depth map of a frame, None if there is none or it says nothing."""
    if "depth_file_path" not in frame:
        return None
    path = allowed(dataset.folder / str(frame["depth_file_path"]))
    values = read_depth_values(path)
    if not np.isfinite(values).any():
        return None
    size = (values.shape[1], values.shape[0])
    return DepthSource((path,), dataset.unit_mm / DEPTHS_IN_UNIT, size=None if size == camera.size else size)


def _bounds(dataset: _Dataset) -> NDArray[np.float64] | None:
    """Return the bounds in the original world, mm: those in the file, or those of its points."""
    if "bounds" in dataset.content:
        return np.array(dataset.content["bounds"], np.float64) * dataset.unit_mm
    if "ply_file_path" not in dataset.content:
        return None
    return bounds_of_points(
        dataset.original(read_points(allowed(dataset.folder / str(dataset.content["ply_file_path"]))))
    )
