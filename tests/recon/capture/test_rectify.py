from __future__ import annotations

import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recon.capture.importing.middlebury import import_middlebury
from recon.capture.rectify import Rectification, rectify, rectify_images, rectify_masks, viewing_directions
from recon.geometry.rig import Camera, Sensor, bounds_corners, look_at, rigid
from tests.recon.capture.calibration.board_geometry import board_texture, board_view

SIZE = (320, 240)
BOUNDS = np.array([[-60.0, -50.0, -40.0], [60.0, 50.0, 40.0]])
DISTORTION = np.array([-0.12, 0.05, 0.001, -0.0008, 0.01])


def camera(
    centre: tuple[float, float, float],
    *,
    roll_deg: float = 0.0,
    shift: float = 0.0,
    dist: NDArray[np.float64] | None = None,
) -> Camera:
    """A camera that looks at the origin, turned about its axis, its principal point off by `shift` pixels."""
    K = np.array([[600.0, 0.0, 159.5 + shift], [0.0, 610.0, 119.5 - shift / 2], [0.0, 0.0, 1.0]])
    turn = cv2.Rodrigues(np.array([0.0, 0.0, np.deg2rad(roll_deg)]))[0]
    pose = rigid(turn, (0, 0, 0)) @ look_at(centre, (0.0, 0.0, 0.0))
    return Camera(K, SIZE, pose, np.zeros(0) if dist is None else dist)


def distorted_pixels(original: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where OpenCV's own model puts world points in the original picture."""
    turn, shift = cv2.Rodrigues(original.rotation)[0], original.cam_from_world[:3, 3]
    return np.asarray(cv2.projectPoints(points, turn, shift, original.K, original.dist)[0][:, 0])


def points_inside(n: int = 200) -> NDArray[np.float64]:
    return np.random.default_rng(1).uniform(BOUNDS[0], BOUNDS[1], (n, 3))


sensors = st.builds(
    lambda angle, baseline, roll, other_roll, shift, distance, verge: Sensor(
        "S1",
        camera((distance * np.sin(angle), verge, distance * np.cos(angle)), roll_deg=roll, shift=shift),
        camera(
            (
                distance * np.sin(angle) + baseline * np.cos(angle),
                verge + 3.0,
                distance * np.cos(angle) - baseline * np.sin(angle),
            ),
            roll_deg=other_roll,
            shift=-shift,
            dist=DISTORTION,
        ),
    ),
    angle=st.floats(-3.0, 3.0),
    baseline=st.floats(30.0, 120.0) | st.floats(-120.0, -30.0),
    roll=st.floats(-180.0, 180.0),
    other_roll=st.floats(-180.0, 180.0),
    shift=st.floats(-25.0, 25.0),
    distance=st.floats(500.0, 900.0),
    verge=st.floats(-60.0, 60.0),
)


@pytest.mark.slow
@given(sensors)
@settings(max_examples=60, deadline=None)
def test_a_point_lies_in_the_same_row_and_its_disparity_tells_its_depth(sensor: Sensor) -> None:
    made, points = rectify(sensor, BOUNDS), points_inside()
    left, right = made.left.project(points), made.right.project(points)
    disparity = left[:, 0] - right[:, 0]
    depth = made.left.points_in_camera(points)[:, 2]
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-6)
    np.testing.assert_allclose(made.depth(disparity), depth, rtol=1e-9)
    np.testing.assert_allclose(made.focal * made.baseline / (disparity - made.offset), depth, rtol=1e-9)


@pytest.mark.slow
@given(sensors)
@settings(max_examples=60, deadline=None)
def test_the_disparities_of_the_bounds_are_small_and_covered(sensor: Sensor) -> None:
    made, corners = rectify(sensor, BOUNDS), bounds_corners(BOUNDS)
    disparity = made.left.project(corners)[:, 0] - made.right.project(corners)[:, 0]
    assert disparity.min() == pytest.approx(1.0)
    assert made.n_disparities - 3 <= disparity.max() <= made.n_disparities - 2


@given(sensors)
@settings(max_examples=30, deadline=None)
def test_what_both_cameras_see_of_the_bounds_is_in_both_rectified_pictures(sensor: Sensor) -> None:
    made, points = rectify(sensor, BOUNDS), points_inside()
    seen = np.ones(len(points), dtype=bool)
    for original in (sensor.left, sensor.right):
        pixels = distorted_pixels(original, points)
        seen &= ((pixels >= 1) & (pixels <= np.array(SIZE) - 2)).all(axis=1)
    for rectified in (made.left, made.right):
        pixels = rectified.project(points[seen])
        assert ((pixels >= 0) & (pixels <= np.array(rectified.size) - 1)).all()


@given(sensors)
@settings(max_examples=30, deadline=None)
def test_the_maps_lead_to_where_the_original_cameras_see_the_same_ray(sensor: Sensor) -> None:
    made = rectify(sensor, BOUNDS)
    for original, rectified, maps in (
        (sensor.left, made.left, made.left_maps),
        (sensor.right, made.right, made.right_maps),
    ):
        rows, columns = np.mgrid[0 : rectified.size[1] : 9, 0 : rectified.size[0] : 9].reshape(2, -1)
        rays = np.linalg.inv(rectified.K) @ np.stack([columns, rows, np.ones_like(rows)])
        points = 700.0 * rays.T @ rectified.rotation + rectified.centre
        expected = distorted_pixels(original, points)
        np.testing.assert_allclose(np.stack([m[rows, columns] for m in maps], axis=1), expected, atol=2e-3)


def test_skew_is_taken_into_account() -> None:
    straight = Sensor("S1", camera((-30.0, 0, 600)), camera((30.0, 0, 600)))
    K = straight.left.K.copy()
    K[0, 1] = 4.0
    skewed = Sensor("S1", Camera(K, SIZE, straight.left.cam_from_world), straight.right)
    made = rectify(skewed, BOUNDS)
    points = points_inside(20)
    columns, rows = (
        cv2.remap(m, *made.left.project(points).astype(np.float32).T[:, None], cv2.INTER_LINEAR)[0]
        for m in made.left_maps
    )
    np.testing.assert_allclose(np.stack([columns, rows], axis=1), skewed.left.project(points), atol=0.05)


def test_rectified_cameras_share_all_but_the_principal_column() -> None:
    made = rectify(Sensor("S1", camera((0.0, -40, 600), roll_deg=90), camera((0.0, 35, 600), roll_deg=90)), BOUNDS)
    difference = made.left.K - made.right.K
    assert made.left.size == made.right.size
    assert made.left.dist.size == made.right.dist.size == 0
    assert np.count_nonzero(difference) == 1
    assert difference[0, 2] == made.offset
    np.testing.assert_array_equal(made.left.rotation, made.right.rotation)
    assert made.focal == pytest.approx(605.0)
    assert made.baseline == pytest.approx(75.0)


def test_cameras_on_their_side_give_pictures_in_which_the_baseline_is_horizontal() -> None:
    left, right = camera((-30.0, 0, 600), roll_deg=90), camera((30.0, 0, 600), roll_deg=90)
    made = rectify(Sensor("S1", left, right), BOUNDS)
    np.testing.assert_allclose(made.left.rotation @ (right.centre - left.centre), [60, 0, 0], atol=1e-9)
    centre, above = made.left.project(np.array([[0.0, 0, 0], [0, 20, 0]]))
    assert above[1] < centre[1]
    assert above[0] == pytest.approx(centre[0], abs=1e-6)


@pytest.mark.parametrize("roll_deg", [0.0, 90.0, 180.0, 30.0])
def test_rectified_pictures_of_a_plane_are_the_same_but_for_its_disparity(roll_deg: float) -> None:
    sensor = Sensor("S1", camera((-25.0, 0, 600), roll_deg=roll_deg), camera((25.0, 0, 600), roll_deg=roll_deg))
    made = rectify(sensor, BOUNDS)
    texture = cv2.GaussianBlur(board_texture(seed=3), (0, 0), 2)
    left, right = rectify_images(made, board_view(sensor.left, texture), board_view(sensor.right, texture))
    points = np.random.default_rng(2).uniform([-40, -40, 0], [40, 40, 0], (200, 3))
    values = [
        cv2.remap(image, *rectified.project(points).astype(np.float32).T[:, None], cv2.INTER_LINEAR)[0].astype(float)
        for image, rectified in ((left, made.left), (right, made.right))
    ]
    assert np.abs(values[0] - values[1]).mean() < 2.0
    assert np.std(values[0]) > 15.0  # there is something to compare


def test_masks_are_false_where_the_original_saw_nothing() -> None:
    sensor = Sensor("S1", camera((-30.0, 0, 450), roll_deg=40), camera((30.0, 0, 450), roll_deg=40))
    made = rectify(sensor, np.array([[-200.0, -200, -50], [200, 200, 50]]))
    everything = np.ones((SIZE[1], SIZE[0]), dtype=bool)
    for mask, (columns, rows) in zip(
        rectify_masks(made, everything, everything), (made.left_maps, made.right_maps), strict=True
    ):
        inside = (columns > 0) & (columns < SIZE[0] - 1) & (rows > 0) & (rows < SIZE[1] - 1)
        outside = (columns < -1) | (columns > SIZE[0]) | (rows < -1) | (rows > SIZE[1])
        assert mask[inside].all()
        assert not mask[outside].any()
        assert outside.any()


def test_depth_is_nan_without_disparity_and_beyond_infinity() -> None:
    made = rectify(Sensor("S1", camera((-30.0, 0, 600)), camera((30.0, 0, 600))), BOUNDS)
    depth = made.depth(np.array([np.nan, made.offset, made.offset - 1.0, 5.0], dtype=np.float64))
    assert np.isnan(depth[:3]).all()
    assert depth[3] > 0


def test_pictures_are_cut_to_the_bounds() -> None:
    sensor = Sensor("S1", camera((-30.0, 0, 600)), camera((30.0, 0, 600)))
    small = rectify(sensor, BOUNDS / 4)
    assert small.left.size[0] < rectify(sensor, BOUNDS).left.size[0] < SIZE[0]
    outline = small.left.project(bounds_corners(BOUNDS / 4))
    assert outline.min() > 10  # the margin of 16 pixels, less the disparity's share


@pytest.mark.parametrize(
    ("sensor", "bounds", "message"),
    [
        (Sensor("S1", camera((0.0, 0, 600)), camera((1.0, 0, 500))), BOUNDS, "nearly along the baseline"),
        (
            Sensor("S1", camera((-30.0, 0, 600)), camera((30.0, 0, 600))),
            np.add(BOUNDS, (0, 0, 900)),
            "lie -340 to -260 mm in front of the cameras",
        ),
        (Sensor("S1", camera((-30.0, 0, 600)), camera((30.0, 0, 600))), np.add(BOUNDS, (900, 0, 0)), "in common"),
        (
            Sensor("S1", camera((-30.0, 0, 600)), camera((30.0, 0, 600))),
            np.array([[-60.0, -50, -40], [60, 50, 590]]),
            "take tighter bounds",
        ),
    ],
)
def test_what_cannot_be_rectified_is_named(sensor: Sensor, bounds: NDArray[np.float64], message: str) -> None:
    with pytest.raises(ValueError, match=f"sensor S1: .*{message}"):
        rectify(sensor, bounds)


def test_cameras_that_look_apart_cannot_be_rectified() -> None:
    left = camera((-30.0, 0, 600))
    away = Camera(left.K, SIZE, rigid(np.diag([-1.0, 1.0, -1.0]), (0, 0, 0)) @ left.cam_from_world)
    with pytest.raises(ValueError, match="viewing direction"):
        rectify(Sensor("S1", camera((30.0, 0, 600)), away), BOUNDS)


def test_a_rectification_can_be_sent_to_another_process() -> None:
    made = rectify(Sensor("S1", camera((-30.0, 0, 600)), camera((30.0, 0, 600))), BOUNDS)
    again: Rectification = pickle.loads(pickle.dumps(made))
    np.testing.assert_array_equal(again.left_maps[0], made.left_maps[0])
    assert again.offset == made.offset


def test_the_temple_stands_upright_after_rectification(real_data: Path, tmp_path: Path) -> None:
    capture = import_middlebury(real_data / "temple", tmp_path / "temple", n_frames=1)
    foot, roof = np.array([[28.0, -30.0, -55.0], [28.0, 110.0, -55.0]])
    for stream in capture.sensors:
        made = rectify(stream.sensor, capture.bounds)
        low, high = made.left.project(np.array([foot, roof]))
        assert low[1] - high[1] > 300  # rows
        assert abs(low[0] - high[0]) < 60
        depth = made.left.points_in_camera(np.array([(foot + roof) / 2]))[0, 2]
        assert 2.4 < depth**2 / (made.focal * made.baseline) < 3.0  # mm of depth per pixel of disparity


@pytest.mark.parametrize("k1", [-0.35, -0.1, 0.2])
def test_the_viewing_direction_of_a_pixel_leads_back_to_it_however_strong_the_distortion(k1: float) -> None:
    K = np.array([[800.0, 0.5, 639.5], [0, 810.0, 359.5], [0, 0, 1]])
    camera = Camera(K, (1280, 720), np.eye(4), np.array([k1, 0.4 * abs(k1), 1e-3, 1e-3, 0]))
    pixels = np.array([[0.0, 0], [1279, 719], [0, 359.5], [300, 100], [639.5, 359.5]])
    points = viewing_directions(camera, pixels)
    ideal = cv2.projectPoints(points, np.zeros(3), np.zeros(3), np.eye(3), camera.dist)[0][:, 0]
    back = np.column_stack([ideal, np.ones(len(ideal))]) @ K.T
    np.testing.assert_allclose(back[:, :2], pixels, atol=1e-3)
