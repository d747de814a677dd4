"""MATLAB's stereoParameters, saved by `toStruct` as .mat or written by `jsonencode`.

Convention: pixel centres count from 1; rows are vectors, so that `IntrinsicMatrix` and `RotationOfCamera2` are the
transposes of K and R. Since R2022b, `K` and `PoseCamera2` are not transposed.

Source: MATLAB's pages of stereoParameters, cameraParameters and stereoParametersToOpenCV.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from recon.capture.images import CaptureError
from recon.capture.importing.calibrations.placed import (
    CAMERA_FROM_WORLD,
    MOST_BYTES,
    Placed,
    calibration_in,
    needed_view,
)
from recon.capture.importing.sources import faults_at
from recon.capture.importing.views import View
from recon.geometry.rig import Camera, rigid
from recon.runtime.files import read_json

FIRST_PIXEL = 1.0  # of MATLAB; OpenCV's is 0
UNITS = {"millimeters": 1.0, "mm": 1.0, "centimeters": 10.0, "meters": 1000.0, "m": 1000.0, "inches": 25.4}
KEYS = ("CameraParameters1", "CameraParameters2")
DAMAGED = (  # what scipy lets through of a damaged file
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    MatReadError,
    MemoryError,
    NameError,
    OSError,
    TypeError,
    ValueError,
    zlib.error,
)
HOW = "write it by s = toStruct(stereoParams); save('stereo.mat', '-struct', 's', '-v7')"


def read_matlab(source: Path, unit_mm: float | None) -> Placed:
    """Read stereoParameters as a struct, with pictures in `left` and `right`, or `camera1` and `camera2`, beside it."""
    path = calibration_in(source, "*.mat", "*.json")
    content = _struct(path)
    with faults_at(path):
        unit = unit_mm or UNITS[str(content[KEYS[0]].get("WorldUnits", "millimeters")).lower()]
        right_from_left = _right_from_left(content, unit)
        poses = (CAMERA_FROM_WORLD, right_from_left @ CAMERA_FROM_WORLD)
        views = {}
        for number, (key, pose, side) in enumerate(zip(KEYS, poses, ("left", "right"), strict=True), start=1):
            image = needed_view(path.parent, (side, f"camera{number}", f"cam{number}"), number)
            views[number] = View(key, _camera(content[key], pose), image)
    return Placed(views)


def _struct(path: Path) -> Mapping[str, Any]:
    content = read_json(path) if path.suffix.lower() == ".json" else _read_mat(path)
    for part in (content, *content.values()):
        if isinstance(part, Mapping) and all(isinstance(part.get(key), Mapping) for key in KEYS):
            return part
    raise CaptureError(f"{path}: holds no struct with {' and '.join(KEYS)}; {HOW}")


def _read_mat(path: Path) -> dict[str, Any]:
    if path.stat().st_size > MOST_BYTES:
        raise CaptureError(f"{path}: has {path.stat().st_size} bytes, expected a calibration of {MOST_BYTES} at most")
    try:
        return dict(loadmat(path, simplify_cells=True))
    except NotImplementedError as error:
        raise CaptureError(f"{path}: is of MATLAB's version 7.3, which is not read; {HOW}") from error
    except DAMAGED as error:
        raise CaptureError(f"{path}: is not readable as a file of MATLAB: {error}") from error


def _right_from_left(content: Mapping[str, Any], unit_mm: float) -> NDArray[np.float64]:
    if "RotationOfCamera2" in content:
        rotation = np.array(content["RotationOfCamera2"], np.float64).T
        translation = content["TranslationOfCamera2"]
    else:
        pose = content["PoseCamera2"]
        whole = np.array(pose["A"], np.float64) if "A" in pose else None
        rotation = np.array(pose["R"], np.float64) if whole is None else whole[:3, :3]
        translation = pose["Translation"] if whole is None else whole[:3, 3]
    return rigid(rotation, np.array(translation, np.float64).ravel() * unit_mm)


def _camera(entry: Mapping[str, Any], pose: NDArray[np.float64]) -> Camera:
    if "MappingCoefficients" in entry:
        raise CaptureError("is a fisheye of Scaramuzza's model, which is not read; undistort the pictures by MATLAB")
    K = np.array(entry["K"], np.float64) if "K" in entry else np.array(entry["IntrinsicMatrix"], np.float64).T
    K = K - np.array([[0, 0, FIRST_PIXEL], [0, 0, FIRST_PIXEL], [0, 0, 0]])
    height, width = (int(length) for length in np.ravel(entry["ImageSize"])[:2])
    radial = np.ravel(np.array(entry["RadialDistortion"], np.float64))
    tangential = np.ravel(np.array(entry["TangentialDistortion"], np.float64))
    return Camera(K, (width, height), pose, np.array([*radial[:2], *tangential, *radial[2:]]))
