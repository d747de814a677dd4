"""One stereo sensor as an entry of keys and matrices, named as `cv2.stereoCalibrate` and as others name them.

Convention: X_right = R X_left + T, pixel centres at integers, distortion k1, k2, p1, p2, k3, ...
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError
from recon.capture.importing.calibrations.placed import CAMERA_FROM_WORLD
from recon.capture.importing.lenses import with_lens
from recon.capture.importing.sources import faults_at
from recon.geometry.lens_names import model_name
from recon.geometry.rig import Camera, Sensor, rigid

NAMES = {  # of a camera's parts, before or behind the side; in any case, with or without lines between the words
    "K": "k|m|mtx|camera_?matrix|intrinsics?|intrinsic_?matrix|k_?matrix",
    "D": "d|dist|distortion|dist_?coeffs?|distortion_?coefficients",
}
SIDES_AS = {"1": "1|left|l", "2": "2|right|r"}
KEYS: dict[str, re.Pattern[str]] = {
    name + side: re.compile(f"(?:{names})_?(?:{sides})|(?:{sides})_?(?:{names})", re.IGNORECASE)
    for side, sides in SIDES_AS.items()
    for name, names in NAMES.items()
} | {
    "R": re.compile("r|rot|rotation|rotation_?matrix", re.IGNORECASE),
    "T": re.compile("t|trans|translation|translation_?vector", re.IGNORECASE),
}
SIZE_KEYS = ("image_size", "imageSize", "size")
OPTIONAL = ("D1", "D2")
EXAMPLES = {
    "K1": "M1, cameraMatrix1, camera_matrix_left",
    "K2": "M2, cameraMatrix2, camera_matrix_right",
    "R": "rotation",
    "T": "t, translation",
}


def stereo_sensor(name: str, entry: Mapping[str, Any], size: tuple[int, int], unit_mm: float) -> Sensor:
    """Return the sensor of an entry with the keys of KEYS, or raise a CaptureError.

    Parameters
    ----------
    name : of the sensor
    entry : with its file, for messages, at the key ""
    size : (width, height) of the pictures, for entries that do not say it
    unit_mm : length of the unit of T
    """
    matrices = {key: _matrix(entry, key) for key in KEYS}
    if matrices["D1"].size != matrices["D2"].size and not matrices["D1"].size * matrices["D2"].size:
        raise CaptureError(f"{entry['']}: has distortion of one camera only, expected D1 and D2")
    with faults_at(f"{entry['']}: sensor {name}"):
        told = _size(entry) or size
        rotation = matrices["R"]
        if rotation.shape != (3, 3):
            if rotation.size != 3:
                raise ValueError(f"R has the shape {rotation.shape}, expected (3, 3), or an axis times an angle, (3,)")
            rotation = cv2.Rodrigues(rotation.ravel())[0]
        right_from_left = rigid(rotation, matrices["T"].ravel() * unit_mm)
        pose = np.asarray(entry.get("cam_from_world", CAMERA_FROM_WORLD), dtype=np.float64).copy()
        pose[:3, 3] *= unit_mm
        model = model_name(entry)
        left = with_lens(Camera(matrices["K1"], told, pose), model, matrices["D1"])
        right = with_lens(Camera(matrices["K2"], told, right_from_left @ pose), model, matrices["D2"])
        return Sensor(name, left, right)


def _matrix(entry: Mapping[str, Any], key: str) -> NDArray[np.float64]:
    told = [name for name in (key, *entry) if name in entry and KEYS[key].fullmatch(name)]
    if told:
        try:
            return np.asarray(entry[told[0]], dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise CaptureError(f"{entry['']}: {told[0]} is {entry[told[0]]!r}, expected a matrix") from error
    if key in OPTIONAL:
        return np.zeros(0)
    raise CaptureError(f"{entry['']}: {key} is missing (or {EXAMPLES[key]})")


def _size(entry: Mapping[str, Any]) -> tuple[int, int] | None:
    if "image_width" in entry and "image_height" in entry:
        return int(entry["image_width"]), int(entry["image_height"])
    for name in SIZE_KEYS:
        if name in entry:
            width, height = np.ravel(entry[name])
            return int(width), int(height)
    return None
