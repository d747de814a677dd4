"""MATLAB's stereoParameters, saved by `toStruct` as .mat or written by `jsonencode`, and what has OpenCV's convention:
the variables of `stereoParametersToOpenCV`, and `Calib_Results_stereo.mat` of Bouguet's Calibration Toolbox.

Convention: pixel centres count from 1; rows are vectors, so that `IntrinsicMatrix` and `RotationOfCamera2` are the
transposes of K and R. Since R2022b, `K` and `PoseCamera2` are not transposed.

Source: MATLAB's pages of stereoParameters, cameraParameters and stereoParametersToOpenCV; Bouguet's page
"Description of the calibration parameters".
"""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError
from recon.capture.importing.calibrations.placed import (
    CAMERA_FROM_WORLD,
    MOST_BYTES,
    Placed,
    calibration_in,
    needed_view,
)
from recon.capture.importing.calibrations.stereo_entry import stereo_sensor
from recon.capture.importing.sources import faults_at
from recon.capture.importing.views import View, pictures_of
from recon.capture.recording import SIDES
from recon.geometry.rig import Camera, rigid
from recon.runtime.files import read_json

FIRST_PIXEL = 1.0  # of MATLAB; OpenCV's is 0
UNITS = {"millimeters": 1.0, "mm": 1.0, "centimeters": 10.0, "meters": 1000.0, "m": 1000.0, "inches": 25.4}
KEYS = ("CameraParameters1", "CameraParameters2")
LOAD = """
import pickle, sys
from scipy.io import loadmat
try:
    import resource
    resource.setrlimit(resource.RLIMIT_DATA, (2**30, 2**30))
except ImportError:
    pass
sys.stdout.buffer.write(pickle.dumps(loadmat(sys.argv[1], simplify_cells=True)))
"""  # in a process of its own, as a damaged file crashes that
LONGEST_S = 60
TOO_NEW = b"MATLAB 7.3"
SAYS = r'^MATLAB|"CameraParameters1"'  # a .mat, and a .json
TOOLBOX = "Calib_Results_stereo.mat"
HOW = f"write it by s = toStruct(stereoParams); save('stereo.mat', '-struct', 's', '-v7'), or name {TOOLBOX}"


def read_matlab(source: Path, unit_mm: float | None) -> Placed:
    """Read stereoParameters as a struct, with pictures in `left` and `right`, or `camera1` and `camera2`, beside it."""
    path = calibration_in(source, TOOLBOX, "*.mat", "*.json", holds=SAYS)
    content = read_json(path) if path.suffix.lower() == ".json" else _read_mat(path)
    entry = _entry_as_opencv(path, content)
    struct = _struct(path, content) if entry is None else {}
    images = [
        needed_view(path.parent, (side, f"camera{number}", f"cam{number}"), number)
        for number, side in enumerate(SIDES, start=1)
    ]
    sizes = [pictures_of(image).size for image in images]
    if entry is None:
        cameras = _cameras(path, struct, sizes, unit_mm)
    else:
        sensor = stereo_sensor("S1", entry, sizes[0], unit_mm or 1.0)
        cameras = [sensor.left, sensor.right]
    views = (View(key, camera, image) for key, camera, image in zip(KEYS, cameras, images, strict=True))
    return Placed(dict(enumerate(views, start=1)))


def _entry_as_opencv(path: Path, content: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return what `stereo_sensor` takes, of variables with OpenCV's convention; None where there are no such ones."""
    if "rotationOfCamera2" in content:
        pose = {"R": content["rotationOfCamera2"], "T": content.get("translationOfCamera2")}
        return {**content, **pose, "": path}
    if "fc_left" not in content:
        return None
    with faults_at(path):
        entry = {"R": content["R"] if "R" in content else content["om"], "T": content["T"], "": path}
        for number, side in enumerate(SIDES, start=1):
            (fx, fy), (cx, cy) = content[f"fc_{side}"], content[f"cc_{side}"]
            skew = float(content.get(f"alpha_c_{side}", 0)) * fx
            entry |= {f"K{number}": [[fx, skew, cx], [0, fy, cy], [0, 0, 1]], f"D{number}": content[f"kc_{side}"]}
        return entry | ({"size": (content["nx"], content["ny"])} if "nx" in content else {})


def _cameras(
    path: Path, content: Mapping[str, Any], sizes: Sequence[tuple[int, int]], unit_mm: float | None
) -> list[Camera]:
    with faults_at(path):
        unit = unit_mm or UNITS[str(content[KEYS[0]].get("WorldUnits", "millimeters")).lower()]
        right_from_left = _right_from_left(content, unit)
        poses = (CAMERA_FROM_WORLD, right_from_left @ CAMERA_FROM_WORLD)
        return [_camera(content[key], pose, size) for key, pose, size in zip(KEYS, poses, sizes, strict=True)]


def _struct(path: Path, content: Mapping[str, Any]) -> Mapping[str, Any]:
    for part in (content, *content.values()):
        if isinstance(part, Mapping) and all(isinstance(part.get(key), Mapping) for key in KEYS):
            return part
    raise CaptureError(f"{path}: holds no struct with {' and '.join(KEYS)}; {HOW}")


def _read_mat(path: Path) -> dict[str, Any]:
    if path.stat().st_size > MOST_BYTES:
        raise CaptureError(f"{path}: has {path.stat().st_size} bytes, expected a calibration of {MOST_BYTES} at most")
    with path.open("rb") as file:
        if file.read(len(TOO_NEW)) == TOO_NEW:
            raise CaptureError(f"{path}: is of MATLAB's version 7.3, which is not read; {HOW}")
    command = [sys.executable, "-P", "-c", LOAD, str(path.absolute())]
    try:
        read = subprocess.run(command, capture_output=True, check=True, timeout=LONGEST_S)
    except subprocess.SubprocessError as error:
        raise CaptureError(f"{path}: is not readable as a file of MATLAB, damaged or cut off; {HOW}") from error
    return dict(pickle.loads(read.stdout))


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


def _camera(entry: Mapping[str, Any], pose: NDArray[np.float64], size: tuple[int, int]) -> Camera:
    """Return a camera; `size` is that of its pictures, for entries that leave it empty."""
    if "MappingCoefficients" in entry:
        raise CaptureError("is a fisheye of Scaramuzza's model, which is not read; undistort the pictures by MATLAB")
    K = np.array(entry["K"], np.float64) if "K" in entry else np.array(entry["IntrinsicMatrix"], np.float64).T
    K = K - np.array([[0, 0, FIRST_PIXEL], [0, 0, FIRST_PIXEL], [0, 0, 0]])
    told = np.ravel(entry.get("ImageSize", ()))[:2]
    height, width = (int(length) for length in (told if told.size else size[::-1]))
    radial = np.ravel(np.array(entry["RadialDistortion"], np.float64))
    tangential = np.ravel(np.array(entry["TangentialDistortion"], np.float64))
    return Camera(K, (width, height), pose, np.array([*radial[:2], *tangential, *radial[2:]]))
