"""COLMAP's models on disk: cameras, images and points, as text or binary.

Convention: poses are world to camera, quaternions w, x, y, z; pixel centres are at halves, so that the principal point
moves by half a pixel on the way to and from `recon.geometry.rig`.

Source: COLMAP's description of its output format, and `scene/reconstruction_io_binary.cc` for the binary one.
"""

from __future__ import annotations

import struct
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError
from recon.capture.importing.lenses import FisheyeCamera
from recon.capture.importing.sources import faults_at, turn_of
from recon.capture.importing.views import HALF_PIXEL
from recon.geometry.ply_elements import are_numbers
from recon.geometry.rig import Camera, rigid
from recon.runtime.files import first_of, in_any_case
from recon.runtime.notices import Notice

FOLDERS = (  # of a model, below the folder that COLMAP worked in; the last ones are ETH3D's
    ".",
    "sparse/0",
    "sparse",
    "dslr_calibration_undistorted",
    "rig_calibration_undistorted",
)
CAMERAS = ("cameras.bin", "cameras.txt")
MODELS: dict[str, tuple[int, tuple[int, ...]]] = {
    "SIMPLE_PINHOLE": (1, ()),
    "PINHOLE": (2, ()),
    "SIMPLE_RADIAL": (1, (0,)),
    "RADIAL": (1, (0, 1)),
    "OPENCV": (2, (0, 1, 2, 3)),
    "FULL_OPENCV": (2, (0, 1, 2, 3, 4, 5, 6, 7)),
}  # how many focal lengths come first, and where the numbers after the principal point stand in OpenCV's distortion
FISHEYES: dict[str, tuple[int, tuple[int, ...]]] = {
    "OPENCV_FISHEYE": (2, (0, 1, 2, 3)),
    "SIMPLE_RADIAL_FISHEYE": (1, (0,)),
    "RADIAL_FISHEYE": (1, (0, 1)),
    "SIMPLE_FISHEYE": (1, ()),
    "FISHEYE": (2, ()),
}  # likewise, in OpenCV's fisheye
LENSES = MODELS | FISHEYES
MODEL_NAMES = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION",
    "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM", "EQUIRECTANGULAR",
)  # fmt: skip  # by the number in the binary form
IMAGE_WORDS = 10  # of its line, the last one its name


@dataclass(frozen=True, eq=False)
class ColmapImage:
    """An image of a model: its name, the number of its camera, and `cam_from_world` (4, 4) in the model's unit."""

    name: str
    camera: int
    pose: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ColmapModel:
    """A model.

    Parameters
    ----------
    cameras : by number, without pose
    images : by number
    points : float64 (N, 3), in the model's unit
    """

    cameras: dict[int, Camera]
    images: dict[int, ColmapImage]
    points: NDArray[np.float64]


def find_model(source: Path) -> Path:
    """Find the folder of a model below a folder, or raise a CaptureError if there is none."""
    for folder in (source / name for name in FOLDERS):
        if cameras := first_of(folder, CAMERAS):
            if folder != source:
                _tell_others(cameras.parent)
            return cameras.parent
    places = ", ".join(str(source / name) for name in FOLDERS)
    raise CaptureError(f"{source}: holds no COLMAP model; looked for cameras.bin and cameras.txt in {places}")


def _tell_others(folder: Path) -> None:
    """Warn of models beside a numbered one: COLMAP makes several where it cannot join all images."""
    if not folder.name.isdecimal():
        return
    numbers = sorted(each.name for each in folder.parent.iterdir() if each.name.isdecimal() and each != folder)
    others = [f"{folder.parent.name}/{number}" for number in numbers if first_of(folder.parent / number, CAMERAS)]
    if others:
        warnings.warn(
            f"{folder}: is one of several models, and read alone; what only {' or '.join(others)} shows is left out: "
            "name that folder to read it instead",
            Notice,
            stacklevel=2,
        )


def read_model(folder: Path) -> ColmapModel:
    """Read a model, binary if there is such a one, as COLMAP does, else text; the points may be missing.

    A CaptureError names the file and the place that is wrong.
    """
    is_binary = in_any_case(folder / "cameras.bin").is_file()
    cameras, images, points = (
        in_any_case(folder / f"{name}{'.bin' if is_binary else '.txt'}") for name in ("cameras", "images", "points3D")
    )
    if is_binary:
        model = ColmapModel(_read_cameras_bin(cameras), _read_images_bin(images), _read_points_bin(points))
    else:
        model = ColmapModel(_read_cameras_txt(cameras), _read_images_txt(images), _read_points_txt(points))
    for number, image in model.images.items():
        if image.camera not in model.cameras:
            raise CaptureError(f"{folder}: image {number} {image.name} has camera {image.camera}, which is not listed")
    return model


class _Reader:
    """Reads numbers from a binary file, one after the other."""

    def __init__(self, path: Path) -> None:
        self._path, self._at = path, 0
        try:
            self._bytes = path.read_bytes()
        except OSError as error:
            raise CaptureError(f"{path}: cannot be read: {error.strerror}") from error

    def numbers(self, form: str) -> tuple[int | float, ...]:
        """Return the little-endian numbers of a form of `struct`."""
        try:
            values = struct.unpack_from("<" + form, self._bytes, self._at)
        except struct.error as error:
            raise self.fault("the file ends too early") from error
        self._at += struct.calcsize("<" + form)
        return values

    def whole(self, form: str) -> int:
        """Return one whole number."""
        return int(self.numbers(form)[0])

    def text(self) -> str:
        """Return a text that ends with a zero byte."""
        end = self._bytes.find(b"\0", self._at)
        if end < 0:
            raise self.fault("a name has no end")
        name, self._at = self._bytes[self._at : end], end + 1
        return name.decode("utf-8", errors="replace")

    def skip(self, n_bytes: int) -> None:
        """Leave out some bytes."""
        if self._at + n_bytes > len(self._bytes):
            raise self.fault("the file ends too early")
        self._at += n_bytes

    def fault(self, reason: str) -> CaptureError:
        """Return an error that says where it is."""
        return CaptureError(f"{self._path}, byte {self._at}: {reason}; expected COLMAP's binary format")


def _read_cameras_bin(path: Path) -> dict[int, Camera]:
    reader = _Reader(path)
    cameras = {}
    for _ in range(reader.whole("Q")):
        number, model, width, height = map(int, reader.numbers("IiQQ"))
        if not 0 <= model < len(MODEL_NAMES):
            raise reader.fault(f"camera {number} has the unknown model {model}")
        with faults_at(f"{path}: camera {number}"):
            n_numbers = _n_numbers(MODEL_NAMES[model])
        values = np.array(reader.numbers(f"{n_numbers}d"), np.float64)
        with faults_at(f"{path}: camera {number}"):
            cameras[number] = _camera(MODEL_NAMES[model], (width, height), values)
    return cameras


def _read_images_bin(path: Path) -> dict[int, ColmapImage]:
    reader = _Reader(path)
    images = {}
    for _ in range(reader.whole("Q")):
        number, *values, camera = reader.numbers("I7dI")
        name = reader.text()
        reader.skip(24 * reader.whole("Q"))  # two numbers of 8 bytes and the point's for each feature
        with faults_at(f"{path}: image {number} {name}"):
            images[int(number)] = ColmapImage(name, int(camera), _pose(np.array(values)))
    return images


def _read_points_bin(path: Path) -> NDArray[np.float64]:
    if not path.is_file():
        return np.zeros((0, 3))
    reader = _Reader(path)
    points = []
    for _ in range(reader.whole("Q")):
        _, *point = reader.numbers("Q3d")
        points.append(point)
        reader.skip(3 + 8)  # colour and error
        reader.skip(8 * reader.whole("Q"))  # its images
    return np.array(points, np.float64).reshape(-1, 3)


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """Return line numbers and words of all lines but comments."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CaptureError(f"{path}: cannot be read as a COLMAP text model: {error}") from error
    return [(number, line.split()) for number, line in enumerate(lines, start=1) if not line.lstrip().startswith("#")]


def _read_cameras_txt(path: Path) -> dict[int, Camera]:
    cameras = {}
    for number, words in _rows(path):
        if not words:
            continue
        with faults_at(f"{path}, line {number}"):
            size = (int(words[2]), int(words[3]))
            cameras[int(words[0])] = _camera(words[1], size, np.array(words[4:], dtype=np.float64))
    return cameras


def _read_images_txt(path: Path) -> dict[int, ColmapImage]:
    images, is_after_image = {}, False
    for number, words in _rows(path):
        if not words or (is_after_image and (len(words) < IMAGE_WORDS or are_numbers(words[IMAGE_WORDS - 1]))):
            is_after_image = False  # the line after an image's lists its points, is empty, or was left out
            continue
        is_after_image = True
        with faults_at(f"{path}, line {number}"):
            if len(words) < IMAGE_WORDS:
                raise ValueError(f"{len(words)} words, expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
            pose = _pose(np.array(words[1:8], dtype=np.float64))
            images[int(words[0])] = ColmapImage(" ".join(words[9:]), int(words[8]), pose)
    return images


def _read_points_txt(path: Path) -> NDArray[np.float64]:
    if not path.is_file():
        return np.zeros((0, 3))
    with faults_at(path):
        return np.array([words[1:4] for _, words in _rows(path) if words], dtype=np.float64).reshape(-1, 3)


def _pose(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the transform of a quaternion w, x, y, z and a translation."""
    return rigid(turn_of(np.roll(values[:4], -1)), values[4:])


def _n_numbers(model: str) -> int:
    if model not in LENSES:
        raise ValueError(f"camera model {model}, expected one of {', '.join(LENSES)}; undistort the images with COLMAP")
    n_focal, places = LENSES[model]
    return n_focal + 2 + len(places)


def _camera(model: str, size: tuple[int, int], numbers: NDArray[np.float64]) -> Camera:
    if len(numbers) != _n_numbers(model):
        raise ValueError(f"{len(numbers)} numbers for {model}, expected {_n_numbers(model)}")
    n_focal, places = LENSES[model]
    focal, centre = numbers[:n_focal], numbers[n_focal : n_focal + 2] - HALF_PIXEL
    dist = np.zeros(max(4, len(places)) if places or model in FISHEYES else 0)
    dist[list(places)] = numbers[n_focal + 2 :]
    K = np.array([[focal[0], 0, centre[0]], [0, focal[-1], centre[1]], [0, 0, 1]])
    if model in FISHEYES:
        return FisheyeCamera(K, size, np.eye(4), lens=dist)
    return Camera(K, size, np.eye(4), dist)
