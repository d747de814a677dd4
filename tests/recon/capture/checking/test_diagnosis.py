from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.capture.checking.check import check_capture
from recon.capture.checking.consistency import triangulated
from recon.capture.checking.diagnosis import diagnose, small_correction, would_lenses_show
from recon.capture.checking.matches import Matches, epipolar_errors
from recon.capture.format import Capture, write_capture
from recon.geometry.rig import Camera, Sensor, look_at, rigid
from recon.studio import SynthParameters, synthesise
from recon.studio.rigs import Field, arc_rig, distorted, disturbed

SIZE = (1280, 720)
FIELDS = (
    Field((0.0, 930.0, 120.0), 1250.0, 2020.0),
    Field((0.0, 870.0, 120.0), 1250.0, 1950.0),
    Field((0.0, 910.0, 60.0), 1750.0, 2240.0),
    Field((0.0, 910.0, 0.0), 1050.0, 1980.0),
    Field((0.0, 1600.0, 10.0), 640.0, 620.0),
)


def camera(x: float) -> Camera:
    K = np.array([[1500.0, 0, 641.0], [0, 1500.0, 357.0], [0, 0, 1]])
    return Camera(K, SIZE, look_at((x, 0.0, 2500.0), (0.0, 0.0, 0.0)))


SENSOR = Sensor("S1", camera(-120.0), camera(120.0))


def matches(seed: int = 0, noise: float = 0.1) -> Matches:
    """Points in and behind the working volume, as the pictures show them."""
    rng = np.random.default_rng(seed)
    points = rng.uniform((-900, -500, -1500), (900, 500, 700), (400, 3))
    left, right = (view.project(points) + rng.normal(0, noise, (400, 2)) for view in (SENSOR.left, SENSOR.right))
    return Matches(left, right)


def turned(view: Camera, axis: int, angle_deg: float) -> Camera:
    vector = np.zeros(3)
    vector[axis] = np.deg2rad(angle_deg)
    return replace(view, cam_from_world=rigid(cv2.Rodrigues(vector)[0], np.zeros(3)) @ view.cam_from_world)


def with_focal(view: Camera, x: float, y: float) -> Camera:
    return replace(view, K=view.K * [[x, 1, 1], [1, y, 1], [1, 1, 1]])


BROKEN: dict[str, tuple[Callable[[Sensor], Sensor], str]] = {
    "swapped": (lambda s: Sensor(s.id, s.right, s.left), "left and right are swapped"),
    "pitch": (lambda s: replace(s, right=turned(s.right, 0, 0.3)), "right camera is rotated by 0.3"),
    "roll": (lambda s: replace(s, left=turned(s.left, 2, 1.0)), "right camera is rotated by"),
    "right focal": (lambda s: replace(s, right=with_focal(s.right, 1.05, 1.05)), "a focal length is wrong"),
    "left focal": (lambda s: replace(s, left=with_focal(s.left, 0.97, 0.97)), "a focal length is wrong"),
    "both focals": (
        lambda s: Sensor(s.id, with_focal(s.left, 1.2, 1.2), with_focal(s.right, 1.2, 1.2)),
        "the focal length of both cameras is wrong",
    ),
    "one axis": (lambda s: replace(s, left=with_focal(s.left, 1.1, 1.0)), "the left camera's focal length is wrong"),
}


def test_a_calibration_with_skew_fits_its_pictures() -> None:
    K = SENSOR.left.K.copy()
    K[0, 1] = 30.0
    skewed = replace(SENSOR, left=replace(SENSOR.left, K=K))
    seen = matches(noise=0.0)
    points = triangulated(SENSOR, seen)
    seen = Matches(skewed.left.project(points), seen.right)
    np.testing.assert_allclose(epipolar_errors(skewed, seen), 0.0, atol=1e-6)
    np.testing.assert_allclose(triangulated(skewed, seen), points, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("fault", BROKEN)
def test_each_single_fault_is_named(fault: str) -> None:
    change, expected = BROKEN[fault]
    (problem,) = diagnose(change(SENSOR), matches())
    assert problem.startswith("sensor S1: ")
    assert expected in problem


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.15))
@settings(deadline=None, max_examples=20)
def test_a_sound_sensor_has_no_fault_whatever_the_noise(seed: int, noise: float) -> None:
    assert diagnose(SENSOR, matches(seed, noise)) == ()


@pytest.mark.parametrize("seed", range(2))
def test_a_fifth_of_a_pixel_that_a_turn_of_the_camera_explains_is_no_fault(seed: int) -> None:
    size = (320, 240)
    K = np.array([[300.0, 0, 159.0], [0, 300.0, 118.0], [0, 0, 1]])
    left, right = (replace(camera(x), K=K, size=size) for x in (-120.0, 120.0))
    rng = np.random.default_rng(seed)
    points = rng.uniform((-700, -900, -200), (700, 900, 200), (200, 3))
    told = Sensor("S1", left, turned(turned(right, 2, 0.3), 0, 0.06))
    seen = Matches(*(view.project(points) + rng.normal(0, 0.1, (200, 2)) for view in (left, right)))
    assert 0.15 < np.median(np.abs(epipolar_errors(told, seen))) < 1 / 3
    assert diagnose(told, seen) == ()


@pytest.mark.parametrize("seed", [157, 296])
def test_a_fifth_of_a_pixel_is_no_fault_where_the_likeliest_turn_hardly_moves_rows(seed: int) -> None:
    size = (320, 240)
    K = np.array([[300.0, 0, 159.0], [0, 300.0, 118.0], [0, 0, 1]])
    left, right = (replace(camera(x), K=K, size=size) for x in (-110.0, 110.0))
    rng = np.random.default_rng(seed)
    points = rng.uniform((-250, -900, -200), (250, 900, 200), (118, 3))
    pitch, yaw, roll = rng.uniform(-0.1, 0.1, 3)
    told = Sensor("S1", left, turned(turned(turned(right, 2, roll), 1, yaw), 0, 0.6 * pitch))
    seen = Matches(*(view.project(points) + rng.normal(0, 0.15, (118, 2)) for view in (left, right)))
    assert 0.15 < np.median(np.abs(epipolar_errors(told, seen))) < 1 / 3
    assert diagnose(told, seen) == ()


@pytest.mark.parametrize("seed", [30, 152, 420])
def test_what_a_good_calibration_is_off_by_is_not_taken_for_wrong_lenses(seed: int) -> None:
    rng = np.random.default_rng((99, seed))
    field = FIELDS[rng.integers(5)]
    rig = distorted(arc_rig(field, n_sensors=2, size=(320, 240), rng=rng), rng.uniform(-0.2, 0.1), rng)
    told = disturbed(rig, rng.uniform(0, 0.1), rng).sensors[0]
    n = int(rng.integers(20, 300))
    points = field.centre + rng.uniform(-1, 1, (n, 3)) * (0.3 * field.width, 0.45 * field.height, 150.0)
    noise = rng.uniform(0.08, 0.25) / 1.41
    places = []
    for view in (rig.sensors[0].left, rig.sensors[0].right):
        turn, shift = cv2.Rodrigues(view.rotation)[0], view.cam_from_world[:3, 3]
        seen, _ = cv2.projectPoints(points, turn, shift, view.K, view.dist)
        places.append(seen[:, 0] + rng.laplace(0, noise, (n, 2)))
    assert diagnose(told, Matches(*places)) == ()


def test_no_small_correction_is_offered_for_pictures_that_are_swapped() -> None:
    left, right = (turned(each, 2, 1.0 * side) for each, side in ((SENSOR.left, -1), (SENSOR.right, 1)))
    rng = np.random.default_rng(0)
    points = rng.uniform((-900, -500, -1500), (900, 500, 700), (400, 3))
    seen = Matches(*(view.project(points) + rng.normal(0, 0.1, (400, 2)) for view in (right, left)))
    assert "swapped" in diagnose(Sensor("S1", left, right), seen)[0]
    assert small_correction(Sensor("S1", left, right), seen) is None


def test_too_few_matches_say_nothing() -> None:
    few = Matches(matches().left[:10], matches().right[:10])
    assert diagnose(BROKEN["swapped"][0](SENSOR), few) == ()


def test_whether_wrong_lenses_would_show_depends_on_how_far_they_move_rows() -> None:
    assert would_lenses_show(SENSOR, matches())
    sides = (replace(each, dist=np.array([0.25, 0, 0, 0])) for each in (SENSOR.left, SENSOR.right))
    assert not would_lenses_show(Sensor("S1", *sides), matches()), "another distortion fits better"
    far = Sensor("S1", *(replace(camera(x), K=camera(x).K * [[8, 1, 1], [1, 8, 1], [1, 1, 1]]) for x in (-20.0, 20.0)))
    rng = np.random.default_rng(0)
    points = rng.uniform((-100, -60, -100), (100, 60, 100), (400, 3))
    left, right = (view.project(points) + rng.normal(0, 0.1, (400, 2)) for view in (far.left, far.right))
    assert not would_lenses_show(far, Matches(left, right))


def test_true_matches_are_on_their_epipolar_lines() -> None:
    exact = matches(noise=0.0)
    np.testing.assert_allclose(epipolar_errors(SENSOR, exact), 0.0, atol=1e-8)
    off = Matches(exact.left, np.add(exact.right, (0.0, 1.0)))  # the baseline is horizontal
    np.testing.assert_allclose(np.abs(epipolar_errors(SENSOR, off)), 1 / np.sqrt(2), rtol=0.05)  # shared by both


@pytest.mark.slow
def test_lenses_are_not_called_wrong_by_a_median_that_few_matches_of_small_pictures_change(tmp_path: Path) -> None:
    synthesise(tmp_path / "ball", SynthParameters("ball", n_sensors=3, n_frames=1, size=(320, 240), seed=1))
    assert check_capture(tmp_path / "ball").problems == ()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    from recon.studio import SynthParameters, synthesise

    folder = tmp_path_factory.mktemp("recorded") / "face"
    return synthesise(folder, SynthParameters(scene="face", n_sensors=1, n_frames=1, size=(480, 270)))


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["swapped", "pitch", "right focal", "none"])
def test_the_fault_of_a_broken_copy_is_named(recorded: Capture, fault: str) -> None:
    change, expected = BROKEN.get(fault, (lambda s: s, ""))
    stream = recorded.sensors[0]
    sensor = change(stream.sensor)
    broken = replace(
        stream, left=replace(stream.left, camera=sensor.left), right=replace(stream.right, camera=sensor.right)
    )
    path = write_capture(replace(recorded, sensors=(broken,)))
    try:
        problems = check_capture(path.parent).problems
    finally:
        write_capture(recorded)
    named = expected.removesuffix(" 0.3")  # how far, a face in the middle of the picture tells less well
    assert len(problems) == (fault != "none")
    assert all(named in problem for problem in problems)
