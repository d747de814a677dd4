"""The virtual camera goes from the first sensor to the last, smoothly, with the bounds in the picture."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.geometry.rig import Camera, Rig, Sensor, bounds_corners, look_at
from recon.render.camera_path import PathParameters, camera_path

BOUNDS = np.array([[-400.0, 0.0, -300.0], [400.0, 1800.0, 300.0]])
CENTRE = BOUNDS.mean(axis=0)
SIZE = (1920, 1080)


def rig_at(azimuths_deg: list[float], distance: float = 3500.0, height: float = 500.0) -> Rig:
    """Sensors that look at the centre of the bounds from a ring around it."""
    K = np.array([[1000.0, 0, 319.5], [0, 1000.0, 239.5], [0, 0, 1]])
    sensors = []
    for number, azimuth in enumerate(np.deg2rad(azimuths_deg)):
        place = CENTRE + np.array([distance * np.sin(azimuth), height, distance * np.cos(azimuth)])
        aside = 50 * np.array([np.cos(azimuth), 0, -np.sin(azimuth)])
        left, right = (Camera(K, (640, 480), look_at(place + way * aside, CENTRE)) for way in (-1, 1))
        sensors.append(Sensor(f"S{number + 1}", left, right))
    return Rig(tuple(sensors))


def middle(sensor: Sensor) -> np.ndarray:
    return (sensor.left.centre + sensor.right.centre) / 2


def test_the_path_begins_at_the_first_sensor_and_ends_at_the_last() -> None:
    rig = rig_at([-50, 0, 60])
    cameras = camera_path(rig, BOUNDS, 25, SIZE)
    np.testing.assert_allclose(cameras[0].centre, middle(rig.sensors[0]), atol=1e-6)
    np.testing.assert_allclose(cameras[-1].centre, middle(rig.sensors[2]), atol=1e-6)


@pytest.mark.slow
def test_the_path_passes_the_sensors_between_even_when_they_surround_the_model() -> None:
    rig = rig_at([-120, 0, 120])  # the shorter way from the first to the last does not pass the second
    cameras = camera_path(rig, BOUNDS, 2001, SIZE)
    nearest = min(float(np.linalg.norm(camera.centre - middle(rig.sensors[1]))) for camera in cameras)
    assert nearest < 10


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    azimuths=st.lists(st.floats(-170, 170), min_size=2, max_size=5, unique_by=lambda value: round(value)),
    height=st.floats(-1000, 2500),
    kind=st.sampled_from(["sensors", "orbit", "swing"]),
    size=st.sampled_from([(1920, 1080), (640, 480), (1080, 1920)]),
)
def test_every_frame_looks_at_the_centre_upright_and_shows_the_whole_bounds(
    azimuths: list[float], height: float, kind: str, size: tuple[int, int]
) -> None:
    for camera in camera_path(rig_at(azimuths, height=height), BOUNDS, 12, size, kind=kind):
        centre = camera.project(np.array([CENTRE, CENTRE + np.array([0, 100, 0])]))
        np.testing.assert_allclose(centre[0], [(size[0] - 1) / 2, (size[1] - 1) / 2], atol=1e-6)
        assert centre[1, 0] == pytest.approx(centre[0, 0], abs=1e-6)
        assert centre[1, 1] < centre[0, 1]
        corners = camera.project(bounds_corners(BOUNDS)) - centre[0]
        assert (np.abs(corners) <= 0.94 * np.array(size) / 2 + 1e-6).all()


def test_one_field_of_view_serves_all_frames_and_fills_the_margin_once() -> None:
    cameras = camera_path(rig_at([-40, 40]), BOUNDS, 20, SIZE)
    assert all(np.array_equal(camera.K, cameras[0].K) for camera in cameras)
    reach = [np.abs(camera.project(bounds_corners(BOUNDS)) - [959.5, 539.5]).max(axis=0) for camera in cameras]
    filled = (np.max(reach, axis=0) / (0.94 * np.array(SIZE) / 2)).max()
    assert filled == pytest.approx(1, abs=1e-9)


def test_speed_is_constant_in_the_middle_and_rises_from_rest() -> None:
    cameras = camera_path(rig_at([-50, 0, 50]), BOUNDS, 376, SIZE)
    speed = np.linalg.norm(np.diff([camera.centre for camera in cameras], axis=0), axis=1)
    assert speed[70:-70] == pytest.approx(speed[187], rel=0.01)
    assert max(speed[0], speed[-1]) < 0.02 * speed[187]
    assert np.abs(np.diff(speed)).max() < 0.06 * speed[187]  # no jerk an eye would see


def test_an_orbit_turns_once_at_constant_speed_and_leads_into_itself() -> None:
    centres = np.array([camera.centre for camera in camera_path(rig_at([30]), BOUNDS, 90, SIZE, kind="orbit")])
    steps = np.linalg.norm(np.diff(np.concatenate([centres, centres[:1]]), axis=0), axis=1)
    assert steps == pytest.approx(steps[0])
    np.testing.assert_allclose(centres.mean(axis=0)[[0, 2]], CENTRE[[0, 2]], atol=1e-6)


def test_a_single_sensor_is_swung_around_to_both_sides() -> None:
    rig = rig_at([20])
    cameras = camera_path(rig, BOUNDS, 101, SIZE)
    azimuths = [np.rad2deg(np.arctan2(*(camera.centre - CENTRE)[[0, 2]])) for camera in cameras]
    assert azimuths[0] == pytest.approx(20)
    assert azimuths[-1] == pytest.approx(20)
    assert [min(azimuths), max(azimuths)] == pytest.approx([-5, 45], abs=0.1)


def test_a_sensor_too_near_for_the_widest_view_is_backed_away_from() -> None:
    rig = rig_at([-30, 30], distance=900.0)
    parameters = PathParameters(widest_deg=50)
    camera = camera_path(rig, BOUNDS, 5, SIZE, parameters=parameters)[0]
    towards, sensor = camera.centre - CENTRE, middle(rig.sensors[0]) - CENTRE
    assert float(towards @ sensor) == pytest.approx(float(np.linalg.norm(towards) * np.linalg.norm(sensor)))
    assert np.linalg.norm(towards) > 1.5 * np.linalg.norm(sensor)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "spiral"}, "no camera path 'spiral'"),
        ({"n_frames": 0}, "0 frames"),
        ({"bounds": BOUNDS[::-1]}, "bounds"),
        ({"bounds": np.zeros((2, 3))}, "bounds"),
        ({"rig": rig_at([0], distance=1e-9, height=4000.0)}, "90 degrees above the horizon"),
        ({"rig": rig_at([0]), "kind": "sensors"}, "choose the path"),
    ],
)
def test_what_cannot_be_a_path_is_refused_with_the_reason(change: dict[str, object], message: str) -> None:
    arguments = {"rig": rig_at([-20, 20]), "bounds": BOUNDS, "n_frames": 5, "size": SIZE, **change}
    with pytest.raises(ValueError, match=message):
        camera_path(**arguments)  # type: ignore[arg-type]  # built by name
