from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from recon.capture.checking.consistency import (
    Comparison,
    Explanation,
    Shared,
    compared,
    disagreements,
    shared_points,
    triangulated,
    unexplained,
    with_focal,
)
from recon.capture.checking.matches import Matches
from recon.geometry.rig import Camera, Sensor, look_at, rigid

SIZE = (1280, 720)
TOLERANCE_MM = 6.0


def sensor(name: str, azimuth_deg: float) -> Sensor:
    """A sensor 2.5 m from the world's origin."""
    angle = np.deg2rad(azimuth_deg)
    place = 2500.0 * np.array([np.sin(angle), 0.1, np.cos(angle)])
    beside = 120.0 * np.array([np.cos(angle), 0.0, -np.sin(angle)])
    K = np.array([[1500.0, 0, 641.0], [0, 1500.0, 357.0], [0, 0, 1]])
    left, right = (Camera(K, SIZE, look_at(place + offset, (0.0, 0.0, 0.0))) for offset in (-beside, beside))
    return Sensor(name, left, right)


FIRST, SECOND = sensor("S1", -20.0), sensor("S2", 20.0)


def points(n: int = 60) -> np.ndarray:
    return np.random.default_rng(1).uniform(-400, 400, (n, 3))


def seen(by: Sensor, places: np.ndarray, seed: int = 0) -> Matches:
    rng = np.random.default_rng(seed)
    left, right = (camera.project(places) + rng.normal(0, 0.1, (len(places), 2)) for camera in (by.left, by.right))
    return Matches(left, right)


def shared() -> Shared:
    """Points that both see, a fifth of them matched wrongly."""
    places = points()
    wrong = places.copy()
    wrong[:12] = wrong[:12][::-1]
    return Shared(seen(FIRST, places), seen(SECOND, wrong, seed=1))


def moved(camera: Camera) -> Camera:
    move = rigid(cv2.Rodrigues(np.array([0.0, 0.04, 0.0]))[0], (0, 0, 0))
    return replace(camera, cam_from_world=camera.cam_from_world @ move)


def turned(camera: Camera) -> Camera:
    turn = rigid(cv2.Rodrigues(np.array([0.0, np.deg2rad(0.5), 0.0]))[0], np.zeros(3))
    return replace(camera, cam_from_world=turn @ camera.cam_from_world)


FAULTS: dict[str, tuple[Callable[[Sensor], Sensor], str]] = {
    "both focal lengths": (
        lambda s: Sensor(s.id, with_focal(s.left, 1.04), with_focal(s.right, 1.04)),
        r"the focal lengths of both cameras of S\d are (0.96|1.04) times",
    ),
    "toe-in": (lambda s: replace(s, right=turned(s.right)), "S2 were turned towards or away from each other by 0.5"),
    "moved": (
        lambda s: Sensor(s.id, moved(s.left), moved(s.right)),
        "S1 or S2 was moved as a whole: turned by about 2.3 degrees",
    ),
}


def test_true_matches_are_where_the_points_are() -> None:
    exact = Matches(FIRST.left.project(points()), FIRST.right.project(points()))
    np.testing.assert_allclose(triangulated(FIRST, exact), points(), atol=1e-6)


def test_sensors_that_agree_are_left_alone() -> None:
    found = compared(FIRST, SECOND, [shared()], TOLERANCE_MM)
    assert found.n_agreeing > 40  # of 60, a fifth of them matched wrongly
    assert list(disagreements([found])) == []


@pytest.mark.parametrize("fault", FAULTS)
def test_what_makes_sensors_disagree_is_named(fault: str) -> None:
    change, expected = FAULTS[fault]
    comparison = compared(FIRST, change(SECOND), [shared()], TOLERANCE_MM)
    (sentence,) = disagreements([comparison])
    assert sentence.startswith("sensors S1 and S2 disagree: ")
    (found,) = [name for name, (_, words) in FAULTS.items() if re.search(words, sentence)]
    assert found == fault, (expected, sentence)


def test_few_points_say_nothing() -> None:
    few = Shared(*(Matches(m.left[20:25], m.right[20:25]) for m in (shared().first, shared().second)))
    broken = FAULTS["moved"][0](SECOND)
    comparison = compared(FIRST, broken, [few], TOLERANCE_MM)
    assert not comparison.is_known
    assert list(disagreements([comparison])) == list(unexplained([comparison])) == []


def test_points_that_are_apart_for_no_single_reason_are_said_not_to_be_checked() -> None:
    elsewhere = points()[::-1] * 1.3
    comparison = compared(FIRST, SECOND, [Shared(seen(FIRST, points()), seen(SECOND, elsewhere))], TOLERANCE_MM)
    assert not comparison.is_known
    assert list(disagreements([comparison])) == []
    (sentence,) = unexplained([comparison])
    assert sentence.startswith("whether sensors S1 and S2 agree could not be checked: only 0 of 60 points")


MOVE = Explanation(20, "{} was moved as a whole: turned by about 2.0 degrees")


@pytest.mark.parametrize(
    ("apart", "expected"),
    [
        ({"S1 S2", "S2 S3"}, "20 if S2, with which S3 does not agree either, was moved as a whole"),
        ({"S1 S2"}, "20 if S1, and not S2, which agrees with S3, was moved as a whole"),
        ({"S2 S3"}, "20 if S3, and not S2, which agrees with S1, was moved as a whole"),
    ],
)
def test_a_third_sensor_tells_which_one_was_moved(apart: set[str], expected: str) -> None:
    comparisons = [
        Comparison((a, b), 30, 0 if f"{a} {b}" in apart else 25, 12.0, MOVE if f"{a} {b}" in apart else None)
        for a, b in (("S1", "S2"), ("S2", "S3"))
    ]
    sentences = list(disagreements(comparisons))
    assert len(sentences) == len(apart)
    assert expected in sentences[0]


def test_points_are_joined_where_three_matchings_meet() -> None:
    places = points(5)
    a, b = seen(FIRST, places), seen(SECOND, places, seed=1)
    between = Matches(np.concatenate([a.right[[3, 1]], [[1.0, 1.0]]]), np.concatenate([b.left[[3, 1]], [[2.0, 2.0]]]))
    joined = shared_points(a, b, between)
    np.testing.assert_array_equal(joined.first.left, a.left[[3, 1]])
    np.testing.assert_array_equal(joined.second.right, b.right[[3, 1]])
