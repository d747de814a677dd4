"""Cameras go to other programs and come back, in nerfstudio's form and convention."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.geometry.rig import Camera, look_at
from recon.render.path_file import read_path, write_path

SIZE = (96, 54)
K = np.array([[50.0, 0, 47.5], [0, 50.0, 26.5], [0, 0, 1]])
CAMERAS = tuple(Camera(K, SIZE, look_at(place, (0, 500, 0))) for place in ((0, 500, 1000), (3000, 900, 10)))


def content_of(folder: Path) -> dict[str, Any]:
    write_path(folder / "path.json", CAMERAS, 25.0)
    return dict(json.loads((folder / "path.json").read_text()))


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    places=st.lists(st.tuples(*[st.floats(-5000, 5000)] * 3), min_size=1, max_size=4),
    focal=st.floats(30, 2000),
    size=st.sampled_from([(96, 54), (1920, 1080), (54, 96), (101, 77)]),
)
def test_cameras_come_back_as_they_went(
    tmp_path_factory: pytest.TempPathFactory,
    places: list[tuple[float, float, float]],
    focal: float,
    size: tuple[int, int],
) -> None:
    own = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1]])
    poses = [look_at((x, y, z), (x + 10, y, z + 900)) for x, y, z in places]
    file = tmp_path_factory.mktemp("path") / "path.json"
    write_path(file, [Camera(own, size, pose) for pose in poses], 30.0)
    for camera, pose in zip(read_path(file, len(places), size), poses, strict=True):
        np.testing.assert_allclose(camera.cam_from_world, pose, rtol=0, atol=1e-9)
        np.testing.assert_allclose(camera.K, own, rtol=0, atol=1e-9)
        assert camera.size == size


def test_a_camera_in_front_of_the_world_has_its_axes_in_opengl(tmp_path: Path) -> None:
    """At (0, 500, 1000) mm, looking along -z, upright: OpenGL's axes are then the world's."""
    content = content_of(tmp_path)
    assert content["camera_path"][0]["camera_to_world"] == [1, 0, 0, 0, 0, 1, 0, 500, 0, 0, 1, 1000, 0, 0, 0, 1]
    assert content["camera_path"][0]["fov"] == pytest.approx(2 * np.rad2deg(np.arctan(27 / 50)))
    assert content["camera_path"][0]["aspect"] == pytest.approx(16 / 9)
    assert (content["render_width"], content["render_height"]) == SIZE
    assert (content["fps"], content["seconds"], content["units"]) == (25.0, 0.08, "mm")


def test_nerfstudio_sees_a_point_in_the_same_pixel(tmp_path: Path) -> None:
    """Its projection, by its source: focal lengths from the vertical `fov`, the middle at half the size, -z ahead."""
    content = content_of(tmp_path)
    point = np.array([120.0, 640.0, -80.0])
    for camera, entry in zip(CAMERAS, content["camera_path"], strict=True):
        world_from_camera = np.reshape(entry["camera_to_world"], (4, 4))
        x, y, z = (np.linalg.inv(world_from_camera) @ [*point, 1.0])[:3]
        focal = content["render_height"] / 2 / np.tan(np.deg2rad(entry["fov"]) / 2)
        pixel = [focal * x / -z + content["render_width"] / 2, -focal * y / -z + content["render_height"] / 2]
        np.testing.assert_allclose(camera.project(point[None])[0] + 0.5, pixel)  # its pixel centres are at halves


def test_a_path_serves_films_of_its_shape_in_any_resolution(tmp_path: Path) -> None:
    content_of(tmp_path)
    large = read_path(tmp_path / "path.json", 2, (960, 540))
    point = np.array([[120.0, 640.0, -80.0]])
    np.testing.assert_allclose(large[1].project(point) + 0.5, 10 * (CAMERAS[1].project(point) + 0.5))


IDENTITY = np.eye(4)
SCALED = [*(2 * IDENTITY[:3]).ravel(), 0, 0, 0, 1]
HUGE = [1e200, -1e200, 0, 0, 1e200, 1e200, 0, 0, 1e200, 1e200, 1e200, 0, 0, 0, 0, 1]  # whose products are infinite
MIRRORED = np.diag([-1.0, 1, 1, 1]).ravel().tolist()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera_type": "fisheye"}, r"camera_type is 'fisheye', expected 'perspective'"),
        ({"camera_type": None}, r"camera_type is None"),
        ({"units": None}, r"units is None, expected 'mm': bring the cameras into the world of the capture"),
        ({"render_width": None}, r"render_width is None, expected a positive number"),
        ({"render_height": 96}, r"the picture is 96 by 96, the film 96 by 54; change --size"),
        ({"camera_path": None}, r"camera_path is None, expected a list"),
        ({"camera_path": [{}]}, r"found 1 cameras, the film has 2 frames"),
    ],
)
def test_a_file_that_does_not_fit_is_named_with_the_key(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    (tmp_path / "path.json").write_text(json.dumps(content_of(tmp_path) | change))
    with pytest.raises(ValueError, match=rf"path\.json: {message}"):
        read_path(tmp_path / "path.json", 2, SIZE)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera_to_world": None}, "camera_to_world is None, expected 16 numbers"),
        ({"camera_to_world": [1, 0, 0]}, r"camera_to_world is \[1, 0, 0\], expected 16 numbers"),
        ({"camera_to_world": [float("nan")] * 16}, "not finite"),
        ({"camera_to_world": [1e200] * 16}, "not finite"),
        ({"camera_to_world": HUGE}, "camera_to_world, inverted: cam_from_world is not a rigid transform"),
        ({"camera_to_world": SCALED}, "not a rigid transform"),
        ({"camera_to_world": MIRRORED}, "not a rigid transform"),
        ({"camera_to_world": np.ones(16).tolist()}, "not a rigid transform"),
        ({"fov": None}, "fov is None"),
        ({"fov": 180}, "fov is 180 degrees"),
        ({"fov": float("nan")}, "fov is nan"),
        ({"aspect": 1.0}, "the picture is 1 by 1, the film 96 by 54"),
        ({"aspect": True}, "aspect is True"),
    ],
)
def test_a_broken_camera_is_named_with_its_place(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    content = content_of(tmp_path)
    content["camera_path"][1] |= change
    (tmp_path / "path.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"path\.json: camera_path\[1\]: .*{message}"):
        read_path(tmp_path / "path.json", 2, SIZE)


def test_what_is_no_camera_is_named_with_its_place(tmp_path: Path) -> None:
    (tmp_path / "path.json").write_text(json.dumps(content_of(tmp_path) | {"camera_path": [7, 8]}))
    with pytest.raises(ValueError, match=r"camera_path\[0\]: found 7, expected a camera"):
        read_path(tmp_path / "path.json", 2, SIZE)
