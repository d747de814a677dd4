"""Importers of COLMAP, nerfstudio and Meshroom: a rig written by the formats' own rules comes back as it was."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.capture.format import Capture, CaptureError
from recon.capture.importing.colmap import import_colmap
from recon.capture.importing.colmap_model import read_model
from recon.capture.importing.meshroom import import_meshroom
from recon.capture.importing.nerfstudio import import_nerfstudio
from recon.capture.importing.sources import ImportOptions
from recon.geometry.rig import Camera, look_at
from recon.runtime.files import allowed

SIZE = (320, 240)
BOUNDS = np.array([[-500.0, -500, -500], [500, 500, 500]])
POINTS = np.random.default_rng(3).uniform(-150, 150, (60, 3))  # mm
DIST = np.array([-0.1, 0.05, 0.001, -0.002, 0.01])
IN_METRES = ImportOptions(unit_mm=1000.0, bounds=BOUNDS)
Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
PAIRS = [(1, 2)]


def camera(x: float, dist: NDArray[np.float64] = DIST, fy: float = 405.0) -> Camera:
    K = np.array([[410.0 + x / 10, 0, 158.5], [0, fy, 121.25], [0, 0, 1]])
    return Camera(K, SIZE, look_at((x, 40.0, 1500.0), (0, 0, 0)), dist)


def seen(view: Camera, points: NDArray[np.float64] = POINTS) -> NDArray[np.float64]:
    """Where a picture shows world points, by OpenCV: pixel centres at integers."""
    dist = view.dist if view.dist.size else np.zeros(5)
    pose = view.cam_from_world
    return np.asarray(cv2.projectPoints(points, cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3], view.K, dist)[0][:, 0])


def write_pictures(folder: Path, n: int = 3) -> None:
    folder.mkdir(parents=True)
    for number in range(1, n + 1):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((SIZE[1], SIZE[0], 3), 50 * number, np.uint8))


def views_of(capture: Capture) -> list[Camera]:
    """All cameras: those of the sensors, then the held-out ones."""
    return [stream.camera for sensor in capture.sensors for stream in sensor.cameras] + [
        photograph.camera for photograph in capture.held_out
    ]


def assert_same(capture: Capture, cameras: list[Camera]) -> None:
    made = views_of(capture)
    assert len(made) == len(cameras)
    for view, true in zip(made, cameras, strict=True):
        np.testing.assert_allclose(view.K, true.K, rtol=1e-9)
        np.testing.assert_allclose(view.cam_from_world, true.cam_from_world, atol=1e-6)
        np.testing.assert_allclose(seen(view), seen(true), atol=1e-6)


MODELS: dict[str, tuple[int, list[int]]] = {  # number in the binary form, places in OpenCV's distortion
    "SIMPLE_PINHOLE": (0, []),
    "PINHOLE": (1, []),
    "SIMPLE_RADIAL": (2, [0]),
    "RADIAL": (3, [0, 1]),
    "OPENCV": (4, [0, 1, 2, 3]),
    "FULL_OPENCV": (6, [0, 1, 2, 3, 4, 5, 6, 7]),
}


def binary_model(folder: Path, model: str, cameras: list[Camera]) -> None:
    """Write what COLMAP writes: with the features that each image has of each point."""
    number, places = MODELS[model]
    folder.mkdir(parents=True)
    content = [struct.pack("<Q", len(cameras)), struct.pack("<Q", len(cameras)), struct.pack("<Q", len(POINTS))]
    for index, view in enumerate(cameras, start=1):
        dist = np.concatenate([view.dist, np.zeros(8)])
        focal = [view.K[0, 0]] if "SIMPLE" in model or model == "RADIAL" else [view.K[0, 0], view.K[1, 1]]
        numbers = [*focal, view.K[0, 2] + 0.5, view.K[1, 2] + 0.5, *dist[places]]
        content[0] += struct.pack(f"<IiQQ{len(numbers)}d", index, number, *SIZE, *numbers)
        x, y, z, w = Rotation.from_matrix(view.rotation).as_quat()
        content[1] += struct.pack("<I7dI", index, w, x, y, z, *(view.cam_from_world[:3, 3] / 1000), index)
        content[1] += f"{index}.png\0".encode() + struct.pack("<Q", len(POINTS))
        for point, pixel in enumerate(seen(view) + 0.5, start=1):
            content[1] += struct.pack("<ddq", *pixel, point)
    for index, point in enumerate(POINTS / 1000, start=1):
        content[2] += struct.pack("<Q3d3BdQ", index, *point, 10, 20, 30, 0.4, len(cameras))
        content[2] += b"".join(struct.pack("<II", image, index - 1) for image in range(1, len(cameras) + 1))
    for name, part in zip(("cameras", "images", "points3D"), content, strict=True):
        (folder / f"{name}.bin").write_bytes(part)


@pytest.mark.parametrize("model", MODELS)
def test_a_binary_colmap_model_of_every_kind_shows_its_points_where_they_were_observed(
    tmp_path: Path, model: str
) -> None:
    dist = np.zeros(8)
    dist[MODELS[model][1]] = [-0.1, 0.05, 0.001, -0.002, 0.01, 0.02, -0.01, 0.003][: len(MODELS[model][1])]
    fy = 405.0 if model in ("PINHOLE", "OPENCV", "FULL_OPENCV") else None
    cameras = [camera(x, dist, fy or 410.0 + x / 10) for x in (-100.0, 100.0, 300.0)]
    binary_model(tmp_path / "source/sparse/0", model, cameras)
    write_pictures(tmp_path / "source/images")
    capture = import_colmap(tmp_path / "source", tmp_path / "out", PAIRS, ImportOptions(unit_mm=1000.0))
    assert_same(capture, cameras)
    assert (capture.bounds[0] < np.quantile(POINTS, 0.05, axis=0)).all()
    np.testing.assert_allclose(read_model(tmp_path / "source/sparse/0").points, POINTS / 1000)


def test_what_is_wrong_in_a_binary_model_is_named(tmp_path: Path) -> None:
    source = tmp_path / "source"
    binary_model(source, "PINHOLE", [camera(-100.0), camera(100.0)])
    images = (source / "images.bin").read_bytes()
    (source / "images.bin").write_bytes(images[:-5])
    with pytest.raises(CaptureError, match=r"images\.bin, byte \d+: the file ends too early"):
        import_colmap(source, tmp_path / "out", PAIRS, IN_METRES)
    cameras = (source / "cameras.bin").read_bytes()
    for model, sentence in (
        (10, "camera model THIN_PRISM_FISHEYE, expected one of SIMPLE_PINHOLE"),
        (16, "camera model EUCM, expected one of SIMPLE_PINHOLE"),
        (77, "unknown model 77"),
    ):
        (source / "cameras.bin").write_bytes(cameras[:12] + struct.pack("<i", model) + cameras[16:])
        with pytest.raises(CaptureError, match=sentence):
            import_colmap(source, tmp_path / "out", PAIRS, IN_METRES)
    with pytest.raises(CaptureError, match="holds no COLMAP model"):
        import_colmap(tmp_path / "nowhere", tmp_path / "out", PAIRS, IN_METRES)
    assert not (tmp_path / "out").exists()


def transforms(cameras: list[Camera], world: NDArray[np.float64], unit_mm: float) -> dict[str, Any]:
    """What nerfstudio's "Data conventions" ask for: OpenGL cameras, numbers shared where they are equal."""
    frames = []
    for number, view in enumerate(cameras, start=1):
        pose = np.eye(4)
        pose[:3, :3] = world @ np.linalg.inv(view.rotation) @ np.diag([1.0, -1, -1])
        pose[:3, 3] = world @ view.centre / unit_mm
        own = {"fl_x": view.K[0, 0]} if number > 1 else {}
        frames.append({"file_path": f"images/{number}.png", "transform_matrix": pose.tolist(), **own})
    first = cameras[0]
    shared = {"fl_x": first.K[0, 0], "fl_y": first.K[1, 1], "cx": first.K[0, 2] + 0.5, "cy": first.K[1, 2] + 0.5}
    lens = dict(zip(("k1", "k2", "p1", "p2", "k3"), first.dist.tolist(), strict=True))
    return {"camera_model": "OPENCV", "w": SIZE[0], "h": SIZE[1], **shared, **lens, "frames": frames}


def nerfstudio_source(folder: Path, content: dict[str, Any]) -> Path:
    write_pictures(folder / "images")
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder


CAMERAS = [camera(x) for x in (-100.0, 100.0, 300.0)]


def test_a_nerfstudio_world_with_z_up_becomes_y_up(tmp_path: Path) -> None:
    source = nerfstudio_source(tmp_path / "source", transforms(CAMERAS, Z_UP, 1000.0))
    assert_same(import_nerfstudio(source, tmp_path / "out", PAIRS, IN_METRES), CAMERAS)


@pytest.mark.parametrize("place", ["{elsewhere}/1.png", "../elsewhere/1.png"])
@pytest.mark.parametrize("key", ["file_path", "mask_path", "depth_file_path", "ply_file_path"])
def test_a_job_of_the_server_imports_no_picture_from_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str, place: str
) -> None:
    write_pictures(tmp_path / "elsewhere")
    content = transforms(CAMERAS, Z_UP, 1000.0)
    said = content if key == "ply_file_path" else content["frames"][0]
    said[key] = place.format(elsewhere=tmp_path / "elsewhere")
    source = nerfstudio_source(tmp_path / "source", content)
    monkeypatch.setenv("RECONSTUDY_FILES_BELOW", str(tmp_path / "source"))
    with pytest.raises(ValueError, match=r"1\.png lies outside the server's folders"):
        import_nerfstudio(source, tmp_path / "out", PAIRS, IN_METRES)
    assert not (tmp_path / "out").exists()


def test_a_link_in_capitals_leads_a_job_of_the_server_nowhere_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_pictures(tmp_path / "elsewhere")
    source = nerfstudio_source(tmp_path / "source", transforms(CAMERAS, Z_UP, 1000.0))
    (source / "images/1.png").unlink()
    (source / "images/1.PNG").symlink_to(tmp_path / "elsewhere/1.png")
    monkeypatch.setenv("RECONSTUDY_FILES_BELOW", str(source))
    for path in (source / "images/1.png", source / "images/1.PNG"):
        with pytest.raises(ValueError, match=r"1\.(png|PNG) lies outside the server's folders"):
            allowed(path)
    with pytest.raises(ValueError, match=r"1\.PNG lies outside the server's folders"):
        import_nerfstudio(source, tmp_path / "out", PAIRS, IN_METRES)


def test_what_nerfstudio_applied_to_the_original_world_is_undone(tmp_path: Path) -> None:
    content = transforms(CAMERAS, Z_UP, 1000.0 / 0.25)  # 0.25 of metres
    content |= {"applied_transform": np.column_stack([Z_UP, np.zeros(3)]).tolist(), "applied_scale": 0.25}
    source = nerfstudio_source(tmp_path / "source", content)
    assert_same(import_nerfstudio(source, tmp_path / "out", PAIRS, IN_METRES), CAMERAS)


def test_nerfstudio_views_with_depth_become_sensors_and_test_views_are_held_out(tmp_path: Path) -> None:
    content = transforms(CAMERAS, Z_UP, 1000.0)
    source = nerfstudio_source(tmp_path / "source", content)
    values = np.full((120, 160), 1500, np.uint16)  # half the picture's size, in mm
    for number, frame in enumerate(content["frames"], start=1):
        frame["depth_file_path"] = f"{number}.png"
        cv2.imwrite(str(source / f"{number}.png"), values * (number != 2))
    content["test_filenames"] = ["images/3.png"]
    (source / "transforms.json").write_text(json.dumps(content))
    capture = import_nerfstudio(source, tmp_path / "out", None, IN_METRES)
    assert [stream.sides for stream in capture.sensors] == [("left",)]
    depth = capture.sensors[0].depth
    assert depth is not None
    assert (depth.scale_mm, depth.kind, depth.size) == (1.0, "z", (160, 120))
    assert [photograph.image for photograph in capture.held_out] == ["held_out/2.png", "held_out/3.png"]


def test_a_field_of_view_and_names_without_suffix_are_understood(tmp_path: Path) -> None:
    content = transforms([camera(x, np.zeros(5), 405.0) for x in (-100.0, 100.0, 300.0)], Z_UP, 1000.0)
    short = {"camera_angle_x": 2 * np.arctan(160 / 400.0)}
    short["frames"] = [
        {"file_path": f"./images/{number}", "transform_matrix": frame["transform_matrix"]}
        for number, frame in enumerate(content["frames"], start=1)
    ]
    capture = import_nerfstudio(nerfstudio_source(tmp_path / "source", short), tmp_path / "out", PAIRS, IN_METRES)
    K = views_of(capture)[0].K
    np.testing.assert_allclose(K, [[400, 0, 159.5], [0, 400, 119.5], [0, 0, 1]])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda content: content.update(camera_model="EQUIRECTANGULAR"),
            "frame 1 images/1.png: camera_model is EQUIRECT",
        ),
        (lambda content: content.update(k4=0.1), "k4 is not 0"),
        (lambda content: content.update(k5=0.1), "k5 is not 0"),
        (lambda content: content.update(s1=0.1, camera_model="full_opencv"), "s1 is not 0"),
        (lambda content: content.update(distortion_model="double_sphere"), "camera_model is double_sphere, expected"),
        (
            lambda content: content["frames"][1].pop("transform_matrix"),
            "frame 2 images/2.png: transform_matrix is missing",
        ),
        (lambda content: content["frames"][0].update(transform_matrix=[[1, 2], [3, 4]]), r"shape \(2, 2\)"),
        (
            lambda content: content["frames"][0].update(transform_matrix=np.ones((4, 4)).tolist()),
            "not a rigid transform",
        ),
        (lambda content: content.update(frames=[]), "frames is"),
        (lambda content: content.pop("frames"), "frames is missing"),
        (lambda content: content.update(applied_scale=-1), "applied_scale is -1"),
        (lambda content: content["frames"][0].update(depth_file_path="no.png"), "no.png: there is no such depth map"),
    ],
)
def test_what_is_wrong_in_a_nerfstudio_dataset_is_named(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], message: str
) -> None:
    content = transforms(CAMERAS, Z_UP, 1000.0)
    change(content)
    source = nerfstudio_source(tmp_path / "source", content)
    with pytest.raises(CaptureError, match=message):
        import_nerfstudio(source, tmp_path / "out", PAIRS, IN_METRES)
    with pytest.raises(CaptureError, match="scale is arbitrary"):
        import_nerfstudio(source, tmp_path / "out", PAIRS)
    assert not (tmp_path / "out").exists()


def scene(cameras: list[Camera], version: str) -> dict[str, Any]:
    """What AliceVision writes: texts for numbers, matrices column by column; its versions differ in the intrinsics."""
    number = tuple(map(int, version.split(".")))
    views, intrinsics, poses = [], [], []
    for index, view in enumerate(cameras, start=1):
        name = f"C:\\shots\\{index}.png" if index == 1 else f"/gone/{index}.png"
        views.append({"viewId": str(index), "poseId": str(index), "intrinsicId": str(index), "path": name})
        pp = view.K[:2, 2] - (np.array(SIZE) / 2 if number >= (1, 2, 1) else 0)
        entry = {
            "intrinsicId": str(index),
            "width": "320",
            "height": "240",
            "principalPoint": [repr(v) for v in pp.tolist()],
        }
        entry["distortionParams"] = [repr(float(view.dist[place])) for place in (0, 1, 4, 2, 3)]
        fx, fy = view.K[0, 0], view.K[1, 1]
        if number < (1, 2, 0):
            entry |= {"type": "brown", "pxFocalLength": repr(float(fx))}
        elif number < (1, 2, 2):
            entry |= {"type": "brown", "pxFocalLength": [repr(float(fx)), repr(float(fy))]}
        else:
            ratio = fy / fx if number >= (1, 2, 5) else fx / fy
            entry |= {"sensorWidth": "24", "focalLength": repr(float(fx * 24 / 320)), "pixelRatio": repr(float(ratio))}
            entry |= {"type": "pinhole", "distortionType": "brown"} if number >= (1, 2, 5) else {"type": "brown"}
        intrinsics.append(entry)
        transform = {
            "rotation": [repr(float(v)) for v in view.rotation.ravel(order="F")],
            "center": [repr(float(v)) for v in view.centre / 1000],
        }
        poses.append({"poseId": str(index), "pose": {"transform": transform, "locked": "0"}})
    views.append({"viewId": "9", "poseId": "9", "intrinsicId": "1", "path": "never_placed.png"})
    structure = [{"landmarkId": str(n), "X": [repr(float(v)) for v in point / 1000]} for n, point in enumerate(POINTS)]
    content = {"version": version.split("."), "views": views, "intrinsics": intrinsics, "poses": poses}
    return content | {"structure": structure}


@pytest.mark.parametrize("version", ["1.0.0", "1.2.0", "1.2.1", "1.2.4", "1.2.11"])
def test_the_cameras_of_every_version_of_meshroom_are_understood(tmp_path: Path, version: str) -> None:
    has_aspect = version != "1.0.0"
    cameras = [camera(x, fy=405.0 if has_aspect else 410.0 + x / 10) for x in (-100.0, 100.0, 300.0)]
    write_pictures(tmp_path / "source/images")
    (tmp_path / "source/cameras.sfm").write_text(json.dumps(scene(cameras, version)))
    capture = import_meshroom(tmp_path / "source", tmp_path / "out", PAIRS, ImportOptions(unit_mm=1000.0))
    assert_same(capture, cameras)
    assert (capture.bounds[0] < np.quantile(POINTS, 0.05, axis=0)).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda content: content["intrinsics"][0].update(distortionType="fisheye4"),
            "its distortion is fisheye4, expected",
        ),
        (lambda content: content["intrinsics"][0].update(distortionParams=["0.1"]), "are 1 numbers, expected 5"),
        (lambda content: content["intrinsics"][0].pop("focalLength"), "view 1 1.png: focalLength is missing"),
        (lambda content: content["views"][1].update(isPoseIndependant="false"), "view 2 2.png: is placed by a rig"),
        (lambda content: content.pop("views"), "views is missing"),
        (lambda content: content.update(poses=[]), "pairs name .*, expected LEFT-RIGHT of each pair"),
        (lambda content: content.update(views=["1"]), "cameras.sfm: "),
    ],
)
def test_what_is_wrong_in_a_scene_of_meshroom_is_named(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], message: str
) -> None:
    content = scene(CAMERAS, "1.2.11")
    change(content)
    write_pictures(tmp_path / "source/images")
    (tmp_path / "source/cameras.sfm").write_text(json.dumps(content))
    with pytest.raises(CaptureError, match=message):
        import_meshroom(tmp_path / "source", tmp_path / "out", PAIRS, IN_METRES)
    with pytest.raises(CaptureError, match=r"holds no cameras\.sfm"):
        import_meshroom(tmp_path, tmp_path / "out", PAIRS, IN_METRES)
    with pytest.raises(CaptureError, match="scale is arbitrary"):
        import_meshroom(tmp_path / "source", tmp_path / "out", PAIRS)
