"""Splats are drawn as other renderers draw them, and as the formulas say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.geometry.rig import Camera, look_at
from recon.geometry.splats import Splats
from recon.models import read_splats
from recon.render import render_splats
from recon.render.gaussians.draw import draw_splats, splat_layer
from recon.render.gaussians.projection import project

SIZE = (75, 50)
GREY = (0.5, 0.5, 0.5)


def camera(size: tuple[int, int] = SIZE, place: tuple[float, float, float] = (300, 200, 2500)) -> Camera:
    K = np.array([[60.0, 0, size[0] / 2 - 0.5], [0, 62, size[1] / 2 - 0.5], [0, 0, 1]])
    return Camera(K, size, look_at(place, [0, 0, 0]))


def random_splats(n: int, degree: int = 3, seed: int = 0) -> Splats:
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(n, 4))
    return Splats(
        rng.normal(size=(n, 3)) * 700,
        np.exp(rng.normal(3.2, 0.9, (n, 3))),
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        rng.uniform(0, 1, n),
        rng.normal(size=(n, (degree + 1) ** 2, 3)) * 0.3,
    )


def from_its_formulas(splats: Splats, seen_by: Camera, background: tuple[float, float, float]) -> NDArray[np.float64]:
    """Draw every splat over every pixel in double precision, the nearest first: slow, without tiles."""
    width, height = seen_by.size
    rows, columns = np.mgrid[:height, :width].astype(float)
    picture, seen = np.zeros((height, width, 3)), np.ones((height, width))
    places = seen_by.points_in_camera(splats.centres)
    K, turns = seen_by.K, Rotation.from_quat(splats.rotations[:, [1, 2, 3, 0]]).as_matrix()
    for i in np.argsort(places[:, 2].astype(np.float32), kind="stable"):
        x, y, z = places[i]
        if z <= 0.01:
            continue
        lowest = np.array([-(K[0, 2] + 0.5) / K[0, 0], -(K[1, 2] + 0.5) / K[1, 1]])
        highest = np.array([(width - 0.5 - K[0, 2]) / K[0, 0], (height - 0.5 - K[1, 2]) / K[1, 1]])
        margin = 0.15 * np.array([width / K[0, 0], height / K[1, 1]])
        u, v = np.clip([x / z, y / z], lowest - margin, highest + margin)
        jacobian = np.array([[K[0, 0] / z, 0, -K[0, 0] * u / z], [0, K[1, 1] / z, -K[1, 1] * v / z]])
        axes = jacobian @ seen_by.rotation @ turns[i] * splats.scales[i]
        plain = axes @ axes.T
        covariance = plain + 0.3 * np.eye(2)
        inverse = np.linalg.inv(covariance)
        opacity = float(splats.opacities[i])
        if splats.antialiased:
            opacity *= float(np.sqrt(max(np.linalg.det(plain), 0) / np.linalg.det(covariance)))
        dx, dy = columns - (K[0, 0] * x / z + K[0, 2]), rows - (K[1, 1] * y / z + K[1, 2])
        power = -0.5 * (inverse[0, 0] * dx * dx + 2 * inverse[0, 1] * dx * dy + inverse[1, 1] * dy * dy)
        alpha = np.minimum(opacity * np.exp(power), 0.999)
        alpha[alpha < 1 / 255] = 0
        direction = splats.centres[i] - seen_by.centre
        colour = colour_from(splats.harmonics[i].astype(float), direction / np.linalg.norm(direction))
        picture += (alpha * seen)[..., None] * colour
        seen *= 1 - alpha
    return np.asarray(np.clip(picture + seen[..., None] * background, 0, 1) * 255)


def colour_from(harmonics: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a colour by the definition of the harmonics: SciPy's complex ones, made real."""
    from scipy.special import sph_harm_y

    x, y, z = direction
    polar, azimuth = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    basis = []
    for degree in range(round(np.sqrt(len(harmonics)))):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            part = value.real if order >= 0 else value.imag
            basis.append(part * (np.sqrt(2) if order else 1))
    return np.asarray(np.maximum(np.array(basis) @ harmonics + 0.5, 0))


@pytest.mark.parametrize(("degree", "antialiased"), [(0, False), (1, False), (2, True), (3, False)])
def test_a_picture_is_what_the_formulas_say(degree: int, antialiased: bool) -> None:
    splats = replace(random_splats(150, degree), antialiased=antialiased)
    drawn = render_splats(splats, camera(), background=(0.2, 0.3, 0.4))
    difference = np.abs(drawn - from_its_formulas(splats, camera(), (0.2, 0.3, 0.4)))
    assert difference.max() < 0.6  # half a level of it is rounding


def described(folder: Path) -> list[dict[str, Any]]:
    return list(json.loads((folder / "expected.json").read_text()))


def test_known_scenes_have_their_known_pictures(real_data: Path) -> None:
    folder = real_data / "splats"
    for scene in described(folder):
        splats = read_splats(folder / scene["ply"])
        for view in scene["views"]:
            K = np.array(view["K"])
            K[:2, 2] -= 0.5
            seen_by = Camera(K, view["size"], np.array(view["cam_from_world"]))
            drawn = render_splats(splats, seen_by, size=view["size"], background=scene["background"])
            expected = cv2.imread(str(folder / view["picture"]))[..., ::-1]
            difference = np.abs(drawn.astype(int) - expected)
            assert difference.mean() < (0.7 if "peer" in scene else 0.1)
            assert difference.max() <= (8 if "peer" in scene else 1)


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_a_picture_is_the_same_for_any_number_of_threads(threads: int) -> None:
    splats = random_splats(2000)
    alone = splat_layer(splats, camera(), SIZE, threads=1)
    assert np.array_equal(alone, splat_layer(splats, camera(), SIZE, threads=threads))


def test_equally_near_splats_are_drawn_in_the_order_of_the_file() -> None:
    two = Splats(
        np.zeros((2, 3)), np.full((2, 3), 200), np.tile([1.0, 0, 0, 0], (2, 1)), np.ones(2), np.zeros((2, 1, 3))
    )
    shades = np.array([[[1.0, 1, 1]], [[-1, -1, -1]]])
    middle = (SIZE[1] // 2, SIZE[0] // 2, 0)
    light, dark = (render_splats(replace(two, harmonics=each), camera())[middle] for each in (shades, shades[::-1]))
    assert light > 190
    assert dark < 60


def test_splats_behind_and_beside_the_camera_are_not_seen() -> None:
    around = random_splats(3)
    places = np.array([[0, 0, -9000.0], [90000, 0, 0], [0, 0, 0]]) * [1, 1, -1]
    visible = project(replace(around, centres=places), camera(place=(0, 0, 2500)), SIZE).depths > 0
    assert visible.tolist() == [False, False, True]


def test_a_scene_that_is_moved_with_its_camera_looks_the_same() -> None:
    splats, seen_by = random_splats(300), camera()
    transform = np.eye(4)
    transform[:3, :3] = 2.5 * Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    transform[:3, 3] = [400, -900, 100]
    pose = np.eye(4)
    pose[:3, :3] = seen_by.rotation @ transform[:3, :3].T / 2.5
    pose[:3, 3] = -pose[:3, :3] @ (transform[:3, :3] @ seen_by.centre + transform[:3, 3])
    moved = render_splats(splats.moved(transform), Camera(seen_by.K, SIZE, pose), background=GREY)
    difference = np.abs(moved.astype(int) - render_splats(splats, seen_by, background=GREY))
    assert difference.max() <= 1


def test_nothing_is_nearer_to_the_camera_than_a_hundredth_of_the_files_unit() -> None:
    splats = random_splats(1)
    near = replace(splats, centres=np.array([[0.0, 0, 2495.0]]))
    assert project(near, camera(place=(0, 0, 2500)), SIZE).depths[0] == pytest.approx(5, rel=1e-3)
    metres = replace(near, unit=1000.0)
    assert project(metres, camera(place=(0, 0, 2500)), SIZE).depths[0] == 0


def test_a_splat_over_a_picture_leaves_the_rest_of_it_as_it_is() -> None:
    rng = np.random.default_rng(3)
    picture = rng.integers(0, 256, (SIZE[1], SIZE[0], 3), np.uint8)
    before = picture.copy()
    splats = random_splats(1).select(np.array([0]))
    placed = replace(splats, centres=np.zeros((1, 3)), scales=np.full((1, 3), 30), opacities=np.ones(1))
    draw_splats(picture, placed, camera())
    changed = (picture != before).any(axis=2)
    rows, columns = np.nonzero(changed)
    assert 4 < changed.sum() < 60
    assert abs(rows.mean() - SIZE[1] / 2) < 1
    assert abs(columns.mean() - SIZE[0] / 2) < 1


def test_a_background_that_is_no_colour_is_refused() -> None:
    for wrong in ((128, 128, 128), (0.5, 0.5), (np.nan, 0, 0)):
        with pytest.raises(ValueError, match="expected red, green and blue from 0 to 1"):
            render_splats(random_splats(1), camera(), background=wrong)


def test_a_picture_may_be_of_another_size_than_the_cameras() -> None:
    assert render_splats(random_splats(5), camera(), size=(33, 17)).shape == (17, 33, 3)
