from __future__ import annotations

import re

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recon.geometry.rig import Camera, Rig, Sensor, bounds_corners, checked_bounds, look_at, rigid

K = np.array([[500.0, 0.3, 319.5], [0.0, 510.0, 239.5], [0.0, 0.0, 1.0]])

small = st.floats(-1.0, 1.0)
vectors = st.tuples(small, small, small)


def rotation(vector: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.asarray(cv2.Rodrigues(np.array(vector))[0])


def camera_at(x: float, size: tuple[int, int] = (640, 480)) -> Camera:
    return Camera(K, size, rigid(np.eye(3), (-x, 0, 0)))


@given(vectors, vectors)
@settings(deadline=None)
def test_the_centre_is_where_the_camera_stands(
    turn: tuple[float, float, float], at: tuple[float, float, float]
) -> None:
    R = rotation(turn)
    camera = Camera(K, (640, 480), rigid(R, -R @ np.array(at)))
    np.testing.assert_allclose(camera.centre, at, atol=1e-12)
    np.testing.assert_allclose(camera.points_in_camera(np.array([at])), [[0, 0, 0]], atol=1e-12)


@given(vectors, st.lists(vectors, min_size=1, max_size=5))
@settings(deadline=None)
def test_projection_agrees_with_opencv(
    turn: tuple[float, float, float], points: list[tuple[float, float, float]]
) -> None:
    without_skew = K * [[1, 0, 1], [1, 1, 1], [1, 1, 1]]
    camera = Camera(without_skew, (640, 480), rigid(rotation(turn), (0.1, 0.2, 4.0)))
    world = np.array(points)
    expected = cv2.projectPoints(world, np.array(turn), np.array([0.1, 0.2, 4.0]), without_skew, None)[0][:, 0]
    np.testing.assert_allclose(camera.project(world), expected, atol=1e-8)


@given(vectors)
@settings(deadline=None)
def test_a_camera_that_looks_at_a_point_sees_it_in_the_middle_with_up_above(
    direction: tuple[float, float, float],
) -> None:
    centre = np.array(direction) * (100.0, 50.0, 100.0) + (0.0, 0.0, 500.0)
    camera = Camera(K, (640, 480), look_at(centre, (0.0, 0.0, 0.0)))
    target, above, right = camera.project(np.array([(0.0, 0, 0), (0, 10, 0), (10, 0, 0)]))
    np.testing.assert_allclose(target, K[:2, 2], atol=1e-9)
    assert above[1] < target[1]  # rows count downwards
    assert right[0] > target[0]
    np.testing.assert_allclose(camera.centre, centre)


def test_looking_along_up_is_refused() -> None:
    with pytest.raises(ValueError, match="parallel to up"):
        look_at((0.0, 100.0, 0.0), (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"K": np.eye(4)}, r"K has shape (4, 4), expected (3, 3)"),
        ({"K": np.diag([-500.0, 500.0, 1.0])}, "is not a camera matrix"),
        ({"K": np.diag([500.0, 500.0, 2.0])}, "is not a camera matrix"),
        ({"K": K * np.nan}, "not finite"),
        ({"size": (0, 480)}, "image size (0, 480) is not positive"),
        ({"dist": np.zeros(3)}, "dist has 3 values"),
        ({"dist": np.full(5, np.inf)}, "finite"),
        (
            {"cam_from_world": rigid(2 * np.eye(3), (0, 0, 0))},
            "not a rigid transform: R R^T differs from the identity by 3",
        ),
        ({"cam_from_world": rigid(np.diag([1.0, 1.0, -1.0]), (0, 0, 0))}, "det R = -1"),
        ({"cam_from_world": np.vstack([np.eye(4)[:3], [0, 0, 1, 1]])}, "last row [0.0, 0.0, 1.0, 1.0]"),
        ({"K": np.diag([1e-300, 500.0, 1.0])}, "lie 6.39e+302 focal lengths beside its axis, expected at most 50"),
        ({"K": K + np.eye(3)[:, :1] * (0.0, 0.0, 1e30)}, "focal lengths beside its axis"),
        ({"K": np.diag([1e30, 500.0, 1.0])}, "a focal length of 1e+30 px for pictures of 640x480, expected at most"),
        ({"K": K + np.eye(3)[:, :1] * (0.0, 1e30, 0.0)}, "a skew of 1e+30 px, expected less than fx"),
        ({"size": (640, 10**9)}, "image size (640, 1000000000) is not positive and at most 1000000"),
        ({"dist": [-0.1, 1e308, 0, 0]}, "dist[1] is 1e+308, which throws a corner of the picture"),
        ({"dist": [0, 0, 0, 0, 0, 0, 0, 1e30]}, "dist[7] is 1e+30, which throws a corner of the picture"),
        (
            {"cam_from_world": rigid(np.eye(3), (0, 0, 1e30))},
            "1e+30 mm from the world's origin, expected at most 1e+10",
        ),
    ],
)
def test_a_wrong_camera_is_named_with_its_value(change: dict[str, object], message: str) -> None:
    values: dict[str, object] = {"K": K, "size": (640, 480), "cam_from_world": np.eye(4)}
    with pytest.raises(ValueError, match=re.escape(message)):
        Camera(**{**values, **change})  # type: ignore[arg-type]  # wrong on purpose


def test_a_sensor_needs_two_places() -> None:
    with pytest.raises(ValueError, match="sensor S7: the baseline is 0 mm"):
        Sensor("S7", camera_at(5.0), camera_at(5.0))


def test_a_sensor_needs_equal_sizes() -> None:
    with pytest.raises(ValueError, match=re.escape("left is (640, 480), right (320, 240)")):
        Sensor("S1", camera_at(0.0), camera_at(60.0, size=(320, 240)))


def test_the_baseline_is_the_distance_of_the_centres() -> None:
    assert Sensor("S1", camera_at(-20.0), camera_at(55.0)).baseline == pytest.approx(75.0)


def test_a_rig_needs_different_ids_and_at_least_one_sensor() -> None:
    sensor = Sensor("S1", camera_at(0.0), camera_at(60.0))
    with pytest.raises(ValueError, match="must differ"):
        Rig((sensor, sensor))
    with pytest.raises(ValueError, match="at least one sensor"):
        Rig(())


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ([[-1e308, 0, 0], [1, 1, 1]], "beyond 1e+10 mm"),
        ([[0, 0, 0], [1e-300, 1, 1]], "edges of at least 0.001 mm"),
    ],
)
def test_bounds_that_no_object_has_are_refused(bounds: list[list[float]], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        checked_bounds(bounds)


def test_bounds_have_eight_different_corners() -> None:
    corners = bounds_corners(np.array([[0.0, 1, 2], [3, 4, 5]]))
    assert len({tuple(corner) for corner in corners}) == 8
    np.testing.assert_array_equal(corners.min(axis=0), [0, 1, 2])
    np.testing.assert_array_equal(corners.max(axis=0), [3, 4, 5])
