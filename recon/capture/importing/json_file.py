"""Recordings that a JSON file describes: for everything that no other importer reads.

The full form lists `sensors`, each with `id`, `left` and `right`; a camera has `K` (3x3), `dist` (OpenCV's, optional),
`image` (a pattern with {frame}, a list of files, a folder or a video, relative to the JSON), `plate` (optional) and
one pose out of POSES, a 4x4 transform or {"R": 3x3, "t": [x, y, z]}. Instead of `right` or beside it, a sensor may have
`depth` as in `capture.json`, its `image` a pattern or a list. The short form is for one sensor: `K_left`,
`K_right`, `dist_left`, `dist_right`, a pose as `R_left_from_right` with `t_left_from_right` (or `_right_from_left`),
and `left_file`, `right_file`: lists of files, or objects from the shot's name to its file. Both may have `held_out`, a
list of cameras with an `image` each that no sensor uses, and `units`, `name`, `kind`, `fps`, `bounds`, `radius`, `size`
and `up`; keys of lengths may end in _mm or _m instead of following `units`.

Convention: X_a = R_a_from_b X_b + t_a_from_b; pixel centres at integers; camera frames as OpenCV. Without a pose the
world is the first left camera's frame turned by half a circle about x: x right, y up, the camera looks along -z.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.format import Capture, image_path
from recon.capture.images import CaptureError, is_video
from recon.capture.importing.calibrations.placed import CAMERA_FROM_WORLD, calibration_in
from recon.capture.importing.into_capture import write_recording
from recon.capture.importing.lenses import with_lens
from recon.capture.importing.sources import DepthSource, ImportOptions, Recording, SensorSource, faults_at, parse_unit
from recon.capture.importing.views import tell_absent
from recon.capture.pictures import Pictures, find_pictures
from recon.capture.recording import FRAME_FIELD, SIDES, DepthFacts, check_facts, frames_after
from recon.geometry.lens_names import model_name
from recon.geometry.rig import UNITS_MM, Camera, rigid
from recon.runtime.files import allowed, in_any_case, read_json

DIST_KEYS = ("dist", "dist_left", "dist_right")
LENS_KEY = re.compile(r"(dist.*|d|coeff\w*|radial\w*|tangential\w*|[kps]\d)(_?(left|right))?", re.IGNORECASE)
SAYS = r'"sensors"|"K_left"'  # a file that describes a recording
POSES = ("cam_from_world", "world_from_cam", "right_from_left", "left_from_right")


@dataclass(frozen=True)
class _Description:
    """The JSON's content, its place, and the length of its unit."""

    path: Path
    content: Mapping[str, Any]
    unit_mm: float

    def length(self, name: str) -> NDArray[np.float64] | None:
        """Return the numbers at a key of lengths, mm, or None."""
        for key, unit in ((name, self.unit_mm), *((f"{name}_{unit}", length) for unit, length in UNITS_MM.items())):
            if key in self.content:
                return _numbers(self.content, key) * unit
        return None


def import_json(
    source: Path, out: Path, options: ImportOptions | None = None, *, shots: Sequence[str] | None = None
) -> Capture:
    """Turn a recording that a JSON file describes into a capture.

    Parameters
    ----------
    source : the JSON file, or the folder that it is alone in; its file names are relative to its folder
    out : the capture's folder, absent or empty
    options : where given, they come before what the file says
    shots : of a short form, names of the shots to take as frames, in this order; None for all

    Raises
    ------
    CaptureError
        Naming the file and what is wrong in it. Nothing is left behind.
    """
    options = options or ImportOptions()
    source = calibration_in(source, "*.json", holds=SAYS)
    content = read_json(source)
    unit = options.unit_mm or parse_unit(str(content.get("units", "mm")))
    described = _Description(source, content, unit)
    if shots is not None and "sensors" in content:
        raise CaptureError(f"{source}: shots are of the short form, and it has the full one; leave them out")
    with faults_at(source):
        sensors = _sensors(described) if "sensors" in content else (_short_form(described, shots),)
        recording = Recording(
            str(content.get("name", source.resolve().parent.name)),
            sensors,
            kind=_kind(described),
            object=_object(described),
            fps=content.get("fps"),
            bounds=described.length("bounds"),
            held_out=_held_out(described),
            up=str(content.get("up", "y")),
        )
    return write_recording(out, recording, options)


def _short_form(described: _Description, shots: Sequence[str] | None) -> SensorSource:
    content, folder = described.content, described.path.parent
    left_files, right_files = (_files(content, f"{side}_file") for side in ("left", "right"))
    names = list(left_files) if shots is None else list(shots)
    missing = [name for name in names if name not in left_files or name not in right_files]
    if missing or set(left_files) != set(right_files):
        raise CaptureError(
            f"left_file has the shots {list(left_files)}, right_file {list(right_files)}, asked: {names}"
        )
    sides = []
    for key, files in (("left_file", left_files), ("right_file", right_files)):
        with faults_at(key):
            sides.append(_listed(folder, [files[name] for name in names]))
    left, right = sides
    key = next((key for key in POSES[2:] if f"R_{key}" in content), "left_from_right")
    translation = described.length(f"t_{key}")
    if translation is None:
        raise CaptureError(f"t_{key} is missing")
    pose = rigid(_numbers(content, f"R_{key}"), translation)
    right_from_left = np.linalg.inv(pose) if key == "left_from_right" else pose
    left_camera, right_camera = (
        with_lens(
            Camera(_numbers(content, f"K_{side}"), pictures.size, cam_from_world),
            model_name(content),
            _dist(content, f"dist_{side}"),
        )
        for side, pictures, cam_from_world in (
            ("left", left, CAMERA_FROM_WORLD),
            ("right", right, right_from_left @ CAMERA_FROM_WORLD),
        )
    )
    return SensorSource("S1", left_camera, right_camera, (left, right))


def _sensors(described: _Description) -> tuple[SensorSource, ...]:
    return tuple(_sensor(described, entry, number) for number, entry in enumerate(described.content["sensors"]))


def _sensor(described: _Description, entry: Mapping[str, Any], number: int) -> SensorSource:
    name = str(entry.get("id", f"S{number + 1}"))
    with faults_at(f"sensor {name}"):
        sides = SIDES[:1] if "depth" in entry and "right" not in entry else SIDES
        pictures = tuple(_pictures(described.path.parent, entry[side], side) for side in sides)
        left_pose = _pose(described, entry["left"], None if number else CAMERA_FROM_WORLD)
        poses = [left_pose, *(_pose(described, entry[side], left_pose) for side in sides[1:])]
        left, *right = (
            with_lens(
                Camera(_numbers(entry[side], "K"), picture.size, pose),
                model_name(entry[side], entry, described.content),
                _dist(entry[side], "dist"),
            )
            for side, picture, pose in zip(sides, pictures, poses, strict=True)
        )
        depth = _depth(described.path.parent, entry["depth"]) if "depth" in entry else None
        return SensorSource(name, left, right[0] if right else None, pictures, depth)


def _held_out(described: _Description) -> tuple[tuple[Camera, Path], ...]:
    """Return the photographs that no sensor uses, without those that are not there."""
    held_out, absent = [], []
    for entry in described.content.get("held_out", ()):
        path = allowed(described.path.parent / str(entry["image"]))
        if not path.is_file():
            absent.append(str(entry["image"]))
            continue
        with faults_at(f"held_out {entry['image']}"):
            camera = Camera(_numbers(entry, "K"), Pictures((path,)).size, _pose(described, entry, None))
            held_out.append((with_lens(camera, model_name(entry, described.content), _dist(entry, "dist")), path))
    tell_absent(described.path, absent)
    return tuple(held_out)


def _depth(folder: Path, entry: Mapping[str, Any]) -> DepthSource:
    image = entry["image"]
    files = _matching(folder, image) if isinstance(image, str) else tuple(in_any_case(folder / name) for name in image)
    if not files:
        raise CaptureError("depth: image is an empty list, expected depth maps")
    size = entry.get("size")
    check_facts(DepthFacts, {"image": str(files[0]), "size": size}, "depth: ")
    return DepthSource(files, entry.get("scale_mm", 1.0), entry.get("kind", "z"), size and (size[0], size[1]))


def _pose(described: _Description, entry: Mapping[str, Any], other: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return `cam_from_world` in mm; `other` is the left camera's, or the pose of a left camera that has none."""
    told = [key for key in POSES if key in entry]
    if not told and other is CAMERA_FROM_WORLD:
        if unread := [key for key, value in entry.items() if key != "K" and np.shape(value) in ((3, 4), (4, 4))]:
            raise CaptureError(f"{unread[0]} is not read, expected one of {', '.join(POSES)}")
        return CAMERA_FROM_WORLD
    if len(told) != 1:
        raise CaptureError(f"a camera has the poses {told}, expected one of {', '.join(POSES)}")
    pose = _transform(entry[told[0]], described.unit_mm)
    if told[0] in POSES[2:]:
        if other is None:
            raise CaptureError(f"{told[0]} is for a right camera")
        return np.asarray((pose if told[0] == "right_from_left" else np.linalg.inv(pose)) @ other)
    return np.asarray(pose if told[0] == "cam_from_world" else np.linalg.inv(pose))


def _transform(value: Any, unit_mm: float) -> NDArray[np.float64]:
    if isinstance(value, Mapping):
        return rigid(_numbers(value, "R"), _numbers(value, "t").ravel() * unit_mm)
    pose = np.array(value, dtype=np.float64)
    if pose.shape not in ((3, 4), (4, 4)):
        raise CaptureError(f"a pose has shape {pose.shape}, expected 4x4 or R and t")
    return rigid(pose[:3, :3], pose[:3, 3] * unit_mm)


def _pictures(folder: Path, entry: Mapping[str, Any], side: str) -> Pictures:
    image = entry["image"]
    plate = folder / entry["plate"] if "plate" in entry else None
    with faults_at(f"{side}, image"):
        if not image or not isinstance(image, str | list):
            raise CaptureError(f"is {image!r}, expected a pattern, a list of files, a folder or a video")
        if isinstance(image, list):
            return _listed(folder, image, plate)
        if FRAME_FIELD.search(image):
            return Pictures(_matching(folder, image), plate, is_folder=True)  # their numbers are compared, too
        if is_video(image) or in_any_case(folder / image).is_file():
            return _listed(folder, [image], plate)
        pictures = find_pictures(folder / image)
        return pictures if plate is None else replace(pictures, plate=plate)


def _listed(folder: Path, names: Sequence[str], plate: Path | None = None) -> Pictures:
    pictures = Pictures(tuple(folder / name for name in names), plate)
    if absent := [path for path in pictures.files if not path.is_file()]:
        raise CaptureError(f"{absent[0]}: there is no such file")
    return pictures


def _matching(folder: Path, pattern: str) -> tuple[Path, ...]:
    """Return the files of a pattern, counted from 0 or from 1."""
    first = next((first for first in (0, 1) if in_any_case(image_path(folder, pattern, first)).is_file()), None)
    if first is None:
        raise CaptureError(f"{image_path(folder, pattern, 0)}: there is no such image, nor a number 1")
    files: list[Path] = []
    while (path := in_any_case(image_path(folder, pattern, first + len(files)))).is_file():
        files.append(path)
    if later := frames_after(folder, pattern, first + len(files)):
        example = image_path(folder, pattern, later[0]).name
        raise CaptureError(f"{path}: there is no such image, but later ones such as {example}")
    return tuple(files)


def _files(content: Mapping[str, Any], key: str) -> dict[str, str]:
    files = content.get(key)
    if isinstance(files, str):
        files = [files]
    if isinstance(files, list):
        files = {str(number): name for number, name in enumerate(files, start=1)}
    if not isinstance(files, dict) or not files:
        raise CaptureError(f"{key} is {files!r}, expected files, or an object from the shot's name to its file")
    return {str(shot): str(name) for shot, name in files.items()}


def _numbers(content: Mapping[str, Any], key: str) -> NDArray[np.float64]:
    if key not in content:
        raise CaptureError(f"{key} is missing")
    try:
        return np.array(content[key], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise CaptureError(f"{key} is {content[key]!r}, expected numbers") from error


def _dist(content: Mapping[str, Any], key: str) -> NDArray[np.float64]:
    for name, value in content.items():  # a slip would leave the distortion out without a word
        is_meant = LENS_KEY.fullmatch(name) and name not in DIST_KEYS and not isinstance(value, str | Mapping)
        if is_meant and np.any(np.asarray(value, np.float64)):
            raise CaptureError(f"{name} is not read, expected {key}")
    return _numbers({key: [], **content}, key)


def _kind(described: _Description) -> str:
    guess = "sphere" if described.length("radius") is not None else "scene"
    return str(described.content.get("kind", "cuboid" if described.length("size") is not None else guess))


def _object(described: _Description) -> dict[str, Any]:
    radius, size = described.length("radius"), described.length("size")
    facts = dict(described.content.get("object", {}))
    if radius is not None:
        facts["radius_mm"] = float(radius)
    if size is not None:
        facts["size_mm"] = size.tolist()
    return facts
