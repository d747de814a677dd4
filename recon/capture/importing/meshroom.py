"""Meshroom's cameras (AliceVision's SfMData as JSON, `cameras.sfm`) as captures: pairs of views are stereo sensors.

Convention: `rotation` is camera from world, column by column, `center` the optical centre; the camera's frame is that
of OpenCV, pixel centres are at integers. Before version 1.2.1 the principal point counts from the picture's corner,
since then from its middle. Before version 1.2.2 focal lengths are in pixels, since then in mm of the sensor's width;
the pixel ratio turned round in version 1.2.5. The scale is arbitrary, so that the unit's length has to be given.

Source: AliceVision, `sfmDataIO/jsonIO.cpp` and `camera/DistortionBrown.hpp`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.format import Capture
from recon.capture.images import CaptureError
from recon.capture.importing.into_capture import write_recording
from recon.capture.importing.sources import ImportOptions, faults_at
from recon.capture.importing.views import View, bounds_of_points, choose_sensors
from recon.geometry.rig import Camera, rigid
from recon.runtime.files import files_like, first_of, read_json

SFM_FILES = ("cameras.sfm", "sfm.sfm", "sfm.json")
SENSOR_WIDTH = 36.0  # mm, AliceVision's default
PLACES = {
    "none": (),
    "pinhole": (),
    "radialk1": (0,),
    "radialk3": (0, 1, 4),
    "brown": (0, 1, 4, 2, 3),
}  # of the distortion's numbers in OpenCV's order
EARLIER_NAMES = {"radial1": "radialk1", "radial3": "radialk3"}  # in `type`, before `distortionType`


def import_meshroom(
    source: Path, out: Path, pairs: Sequence[tuple[int, int]] | None, options: ImportOptions | None = None
) -> Capture:
    """Turn the views that Meshroom has placed into a capture.

    Parameters
    ----------
    source : the file, or the folder of one; images that are not where they were when it was written are looked for
        beside it and in `images` there. Bounds come from its points, if it holds any
    out : the capture's folder, absent or empty
    pairs : viewId of each sensor's (left, right); the rest is held out
    options : the unit's length has to be given

    Raises
    ------
    CaptureError
        Naming the file, the view and what is wrong. Nothing is left behind.
    """
    options = options or ImportOptions()
    path = _find(source)
    if options.unit_mm is None:
        raise CaptureError(f"{path}: Meshroom's scale is arbitrary; give the length of its unit in mm by --units")
    content = read_json(path)
    with faults_at(path):
        views = _views(path, content, options.unit_mm)
        points = np.array([point["X"] for point in content.get("structure", ())], np.float64).reshape(-1, 3)
    bounds = bounds_of_points(points * options.unit_mm)
    return write_recording(out, choose_sensors(source, views, pairs or (), bounds), options)


def _find(source: Path) -> Path:
    if source.is_file():
        return source
    if named := first_of(source, SFM_FILES):
        return named
    paths = files_like(source, "*.sfm")
    if len(paths) > 1:
        raise CaptureError(f"{source}: holds {', '.join(path.name for path in paths)}; name the one to read")
    if not paths:
        raise CaptureError(f"{source}: holds no {' or '.join(SFM_FILES)}; export JSON by the node ConvertSfMFormat")
    return paths[0]


def _views(path: Path, content: Mapping[str, Any], unit_mm: float) -> dict[int, View]:
    version = tuple(int(number) for number in content.get("version", (1, 0, 0)))
    intrinsics = {entry["intrinsicId"]: entry for entry in content["intrinsics"]}
    poses = {
        entry["poseId"]: entry["pose"]["transform"]
        for entry in content.get("poses", ())
        if int(entry["pose"].get("valid", 1))
    }
    views = {}
    for entry in content["views"]:
        number, name = int(entry["viewId"]), Path(str(entry["path"]).replace("\\", "/")).name
        if entry.get("poseId") not in poses or entry.get("intrinsicId") not in intrinsics:
            continue  # Meshroom could not place it
        with faults_at(f"view {number} {name}"):
            if entry.get("isPoseIndependant", "true") in ("false", "0", False):
                raise CaptureError(
                    "is placed by a rig, expected a pose of its own; reconstruct without rig constraints"
                )
            pose = _pose(poses[entry["poseId"]], unit_mm)
            camera = _camera(version, intrinsics[entry["intrinsicId"]], pose)
        views[number] = View(name, camera, _image(path.parent, str(entry["path"]), name))
    return views


def _pose(transform: Mapping[str, Any], unit_mm: float) -> NDArray[np.float64]:
    rotation = np.array(transform["rotation"], np.float64).reshape(3, 3).T
    return rigid(rotation, -rotation @ np.array(transform["center"], np.float64) * unit_mm)


def _camera(version: tuple[int, ...], entry: Mapping[str, Any], cam_from_world: NDArray[np.float64]) -> Camera:
    width, height = int(entry["width"]), int(entry["height"])
    centre = np.array(entry["principalPoint"], np.float64)
    if version >= (1, 2, 1):
        centre = centre + np.array([width, height]) / 2
    fx, fy = _focal_lengths(version, entry, width)
    K = np.array([[fx, 0, centre[0]], [0, fy, centre[1]], [0, 0, 1]])
    return Camera(K, (width, height), cam_from_world, _dist(entry))


def _focal_lengths(version: tuple[int, ...], entry: Mapping[str, Any], width: int) -> tuple[float, float]:
    if version < (1, 2, 0):
        return float(entry["pxFocalLength"]), float(entry["pxFocalLength"])
    if version < (1, 2, 2):
        fx, fy = entry["pxFocalLength"]
        return float(fx), float(fy)
    fx = float(entry["focalLength"]) / float(entry.get("sensorWidth", SENSOR_WIDTH)) * width
    ratio = float(entry.get("pixelRatio", 1.0))
    return fx, fx * ratio if version >= (1, 2, 5) else fx / ratio


def _dist(entry: Mapping[str, Any]) -> NDArray[np.float64]:
    kind = str(entry.get("type", "pinhole")).lower()
    kind = EARLIER_NAMES.get(kind, kind)
    if kind == "pinhole":
        kind = str(entry.get("distortionType", "none")).lower()
    if kind not in PLACES:
        raise CaptureError(f"its distortion is {kind}, expected one of {', '.join(PLACES)}; undistort the images")
    if str(entry.get("undistortionType", "none")).lower() != "none" and entry.get("undistortionParams"):
        raise CaptureError(f"its undistortion is {entry['undistortionType']}, expected none; undistort the images")
    numbers = np.array(entry.get("distortionParams") or (), np.float64)
    places = list(PLACES[kind])
    if not numbers.any():
        return np.zeros(0)
    if len(numbers) != len(places):
        raise CaptureError(f"distortionParams are {len(numbers)} numbers, expected {len(places)} for {kind}")
    dist = np.zeros(5)
    dist[places] = numbers
    return dist


def _image(folder: Path, path: str, name: str) -> Path:
    return first_of(folder, (path, f"images/{name}", name)) or folder / name
