"""Fisheyes are undistorted on import, and what is not known is refused by its name, or asked."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.capture.format import CaptureError, read_frame
from recon.capture.importing.colmap import import_colmap
from recon.capture.importing.json_file import import_json
from recon.capture.importing.lenses import FisheyeCamera, with_lens
from recon.capture.importing.nerfstudio import import_nerfstudio
from recon.capture.importing.opencv import import_opencv
from recon.capture.importing.sources import ImportOptions
from recon.geometry.lens_names import model_name
from recon.geometry.rig import Camera
from tests.recon.capture.importing.labelled_recording import BOUNDS, OPTIONS, SIZE, colmap_model

K = np.array([[210.0, 0, 160.0], [0, 208.0, 118.0], [0, 0, 1]])
LENS = np.array([-0.03, 0.012, -0.004, 0.001])
PINHOLE = Camera(K, SIZE, np.eye(4))
SPOTS = np.array([[30.0, 40.0], [160.0, 118.0], [250.0, 200.0], [300.0, 30.0]])  # of the undistorted picture


def distorted(spots: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the fisheye shows what a pinhole camera of the same K shows at pixels (N, 2), by the paper's formula."""
    slopes = (spots - K[:2, 2]) / np.diag(K)[:2]
    radius = np.linalg.norm(slopes, axis=1, keepdims=True)
    theta = np.arctan(radius)
    bent = theta * (1 + LENS[0] * theta**2 + LENS[1] * theta**4 + LENS[2] * theta**6 + LENS[3] * theta**8)
    scale = np.divide(bent, radius, out=np.ones_like(bent), where=radius > 0)
    return np.asarray(slopes * scale * np.diag(K)[:2] + K[:2, 2])


def fisheye_picture() -> NDArray[np.uint8]:
    """Round spots as the fisheye shows them."""
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    squared = [(columns - x) ** 2 + (rows - y) ** 2 for x, y in distorted(SPOTS)]
    levels = 200.0 * np.exp(-np.min(squared, axis=0) / (2 * 3.0**2))
    return np.repeat(levels.astype(np.uint8)[..., None], 3, axis=2)


def check_spots(picture: NDArray[np.uint8]) -> None:
    """The spots are where the pinhole camera shows them."""
    for x, y in SPOTS:
        window = picture[int(y) - 12 : int(y) + 13, int(x) - 12 : int(x) + 13, 0].astype(float)
        rows, columns = np.mgrid[int(y) - 12 : int(y) + 13, int(x) - 12 : int(x) + 13]
        centre = np.array([(window * columns).sum(), (window * rows).sum()]) / window.sum()
        np.testing.assert_allclose(centre, (x, y), atol=0.35)


def write(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), fisheye_picture())


def opencv_file(path: Path, dist: NDArray[np.float64], line: str = "") -> None:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in (("K1", K), ("D1", dist), ("K2", K), ("D2", dist), ("R", np.eye(3)), ("T", np.c_[[-90.0, 0, 0]])):
        storage.write(key, value)
    storage.release()
    path.write_text(path.read_text() + line)


@pytest.mark.parametrize(
    "entry",
    [
        {"distortion_model": "equidistant", "camera_model": "pinhole"},  # as Kalibr has both
        {"DistortionModel": "Equidistant"},
        {"lens-type": "fisheye", "model": "acA1920"},
        {"distortion_model1": "kb4", "distortion_model2": "kb4"},
        {"lens": "Kannala-Brandt"},
        {"kind": "scene", "type": "fisheye"},
        {"fisheye": "true"},
        {"is_fisheye": True, "camera_model": "OPENCV"},
        {"model": "KANNALA_BRANDT8", "distortion_model": ""},
    ],
)
def test_a_fisheye_is_known_at_whatever_key_it_is_named(entry: dict[str, str]) -> None:
    assert isinstance(with_lens(PINHOLE, model_name(entry), LENS), FisheyeCamera)


def test_a_pair_of_two_models_and_a_name_that_is_not_read_are_refused() -> None:
    with pytest.raises(ValueError, match="the cameras have the models equidistant and plumb_bob, expected one"):
        model_name({"distortion_model1": "equidistant", "distortion_model2": "plumb_bob"})
    with pytest.raises(CaptureError, match="the camera model is Double Sphere, expected one of"):
        with_lens(PINHOLE, model_name({"optics": "Double Sphere"}), LENS)
    with pytest.raises(CaptureError, match="the camera model is omnidirectional, expected one of"):
        with_lens(PINHOLE, model_name({"xi1": 1.2}), LENS)
    assert model_name({"name": "fisheye", "kind": "sphere", "model_number": "D435", "is_fisheye": False}) is None


def test_the_maps_are_those_of_the_models_formula() -> None:
    camera = with_lens(PINHOLE, model_name({"fisheye_model": 1.0}), LENS)
    assert isinstance(camera, FisheyeCamera)
    assert isinstance(with_lens(PINHOLE, "Kannala Brandt4", LENS), FisheyeCamera)
    rows, columns = np.mgrid[0 : SIZE[1] : 17, 0 : SIZE[0] : 23]
    expected = distorted(np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float))
    found = np.stack([part[::17, ::23].ravel() for part in camera._maps], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-4)  # the maps are float32


@pytest.mark.parametrize("form", ["pictures", "video"])
def test_a_fisheye_of_an_opencv_file_is_undistorted(tmp_path: Path, form: str) -> None:
    opencv_file(tmp_path / "c.yml", LENS[:, None], "distortion_model: equidistant\n")
    for side in ("left", "right"):
        if form == "pictures":
            write(tmp_path / side / "0.png")
            write(tmp_path / side / "plate.png")
        else:
            writer = cv2.VideoWriter(
                str(tmp_path / f"{side}.avi"), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 25.0, SIZE
            )
            writer.write(fisheye_picture())
            writer.release()
    capture = import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    assert not capture.sensors[0].left.camera.dist.any()
    for picture in read_frame(capture, "S1", 0):
        check_spots(picture)
    if form == "pictures":
        check_spots(cv2.imread(str(tmp_path / "out" / "S1" / "left" / "plate.png")))


def test_a_fisheye_of_a_json_file_is_undistorted(tmp_path: Path) -> None:
    for side in ("left", "right"):
        write(tmp_path / f"{side}.png")
    sides = {side: {"K": K.tolist(), "dist": LENS.tolist(), "image": [f"{side}.png"]} for side in ("left", "right")}
    sides["right"]["right_from_left"] = {"R": np.eye(3).tolist(), "t": [-90, 0, 0]}
    content = {"distortion_model": "fisheye", "bounds": BOUNDS.tolist(), "sensors": [{"id": "S1", **sides}]}
    (tmp_path / "c.json").write_text(json.dumps(content))
    check_spots(read_frame(import_json(tmp_path / "c.json", tmp_path / "out"), "S1", 0)[0])


def test_fisheyes_of_colmap_and_nerfstudio_are_undistorted_held_out_photographs_and_masks_too(tmp_path: Path) -> None:
    model = colmap_model(tmp_path / "colmap")
    lines = (model / "cameras.txt").read_text().splitlines()
    numbers = " ".join(map(str, (K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5, *LENS)))
    changed = [f"{line.split()[0]} OPENCV_FISHEYE 320 240 {numbers}" for line in lines[1:]]
    (model / "cameras.txt").write_text("\n".join(changed))
    for path in list((model / "images").glob("*.png")):
        write(path)
        write(model / "masks" / f"{path.name}.png")
    options = ImportOptions(bounds=BOUNDS, unit_mm=1000.0)
    capture = import_colmap(model, tmp_path / "of_colmap", [(11, 12)], options)
    check_spots(read_frame(capture, "S1", 0)[0])
    check_spots(cv2.imread(str(tmp_path / "of_colmap" / capture.held_out[0].image)))
    check_spots(cv2.imread(str(tmp_path / "of_colmap/S1/mask/right/0000.png")))
    frames: list[dict[str, object]] = [
        {"file_path": f"{side}.png", "mask_path": f"{side}.png", "transform_matrix": np.eye(4).tolist()}
        for side in ("left", "right")
    ]
    frames[1]["transform_matrix"] = (np.eye(4) + np.outer((1, 0, 0, 0), (0, 0, 0, 0.09))).tolist()
    lens = {f"k{number}": value for number, value in enumerate(LENS.tolist(), start=1)}
    shown = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5, "w": SIZE[0], "h": SIZE[1]}
    content = {"camera_model": "OPENCV_FISHEYE", "units": "m", **shown, **lens, "frames": frames}
    for side in ("left", "right"):
        write(tmp_path / "nerf" / f"{side}.png")
    (tmp_path / "nerf" / "transforms.json").write_text(json.dumps(content))
    capture = import_nerfstudio(tmp_path / "nerf", tmp_path / "of_nerfstudio", [(1, 2)], ImportOptions(bounds=BOUNDS))
    check_spots(read_frame(capture, "S1", 0)[0])
    check_spots(cv2.imread(str(tmp_path / "of_nerfstudio/S1/mask/left/0000.png")))


@pytest.mark.parametrize(
    ("dist", "line", "told"),
    [
        (LENS[:, None], "", "a fisheye's, as cv2.fisheye.calibrate gives them, or k1, k2, p1, p2"),
        (
            LENS[None],
            "distortion_model: omnidirectional\n",
            "the camera model is omnidirectional, expected one of plumb",
        ),
        (np.zeros((1, 8)), "distortion_model: equidistant\n", "a fisheye has 8 distortion numbers, expected 4"),
    ],
)
def test_what_is_not_known_is_asked_or_refused_by_its_name(
    tmp_path: Path, dist: NDArray[np.float64], line: str, told: str
) -> None:
    opencv_file(tmp_path / "c.yml", dist, line)
    for side in ("left", "right"):
        write(tmp_path / f"{side}.png")
    with pytest.raises(CaptureError, match=told):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("model", ["plumb_bob", "radtan", "rational_polynomial", "Thin Prism", None])
@pytest.mark.parametrize("n", [0, 4, 5, 8, 12, 14])
def test_perspective_models_are_opencvs_numbers(model: str | None, n: int) -> None:
    dist = np.linspace(0.01, 0.02, n)[None]
    if model in ("plumb_bob", "radtan") and n > 5:
        with pytest.raises(CaptureError, match=f"{n} distortion numbers, expected 5 at most of the model {model}"):
            with_lens(PINHOLE, model, dist)
        dist[:, 5:] = 0  # as programs write that have places for more
    camera = with_lens(PINHOLE, model, dist)
    assert not isinstance(camera, FisheyeCamera)
    np.testing.assert_array_equal(camera.dist, dist[0])
