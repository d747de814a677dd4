"""Parts of a frame by which a sensor is late show in what silhouettes of two cameras have in common."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.capture.checking.check import check_capture
from recon.capture.checking.lag import STEP, TangentPlanes, Tangents, lag_between
from recon.capture.checking.silhouettes import Silhouette, silhouette_of
from recon.capture.format import write_capture
from recon.capture.rectify import viewing_directions
from recon.geometry.rig import Camera, look_at
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MASK

N, PIXEL = 40, 1e-3
K = np.array([[1000.0, 0, 320.0], [0, 1000.0, 240.0], [0, 0, 1]])


def seen(late: float, seed: int, noise_px: float = 0.2) -> Tangents:
    """Tangents of one motion, smooth over some frames, as a camera that is late measures them."""
    rng = np.random.default_rng(7)
    waves = [(rng.uniform(0.1, 0.9), rng.uniform(0, 6), rng.uniform(2, 5)) for _ in range(10)]
    frames = np.arange(N) - late
    motion = [sum(size * np.sin(w * frames + phase) for w, phase, size in waves[end::2]) for end in (0, 1)]
    noise = np.random.default_rng(seed).normal(0, noise_px, (N, 2))
    return Tangents((np.stack(motion, axis=1) + noise) * PIXEL, PIXEL)


@pytest.mark.slow
@given(st.floats(-3, 3), st.integers(0, 10**6))
@settings(deadline=None, max_examples=60)
def test_a_lag_is_found_to_parts_of_a_frame_and_lies_in_its_interval(late: float, seed: int) -> None:
    found = lag_between([(seen(0, seed), seen(late, seed + 1)), (seen(0, seed + 2), seen(late, seed + 3))])
    assert found is not None
    assert found.frames == pytest.approx(late, abs=0.15)
    assert found.low - STEP <= late <= found.high + STEP  # its ends are lags of the grid
    assert found.is_late or abs(late) < 0.5


def test_an_interval_that_ends_at_none_holds_none_exactly() -> None:
    found = lag_between([(seen(0, 633), seen(0, 634)), (seen(0, 635), seen(0, 636))])
    assert found is not None
    assert found.high == 0


@pytest.mark.parametrize(("late", "is_beyond"), [(3.0, False), (-3.0, False), (5.0, True), (-4.0, True)])
def test_a_lag_at_which_the_search_ends_may_be_more_and_says_so(late: float, is_beyond: bool) -> None:
    found = lag_between([(seen(0, 1), seen(late, 2)), (seen(0, 3), seen(late, 4))])
    assert found is not None
    assert found.is_late
    assert (found.is_beyond, "or more" in str(found)) == (is_beyond, is_beyond)


def test_noise_makes_no_sensor_late_and_what_hardly_moves_says_nothing() -> None:
    n_late = 0
    for seed in range(50):
        found = lag_between([(seen(0, 2 * seed, 1.0), seen(0, 2 * seed + 1, 1.0))])
        assert found is not None
        n_late += found.is_late
    assert n_late <= 1
    still = Tangents(np.random.default_rng(0).normal(0, 0.2 * PIXEL, (N, 2)), PIXEL)
    assert lag_between([(still, still)]) is None
    assert lag_between([]) is None


def test_a_mask_that_is_wrong_in_a_single_frame_is_no_motion() -> None:
    first = [0.9, *[0] * 7, 2.7, 0.9, 0.9, 0, 0.9, 0.9, 0, 0.9, 0, 0.9, 2.7, 0, 2.7, 9.6, 0, 0]  # feet, pixels
    second = [-0.4, *[0.4] * 4, -0.5, -0.5, -0.4, -0.3, *[0.4] * 3, -0.5, 0.3, -0.4, -0.5, *[0.4] * 3, -0.4, -0.5]
    still = (Tangents(PIXEL * np.repeat([[each]], 2, 1)[0].T, PIXEL) for each in (first, [*second, 0.4, -0.4, -0.4]))
    assert lag_between([(next(still), next(still))]) is None


@pytest.mark.parametrize(("n_frames", "late"), [(13, 0.0), (13, 1.25), (13, -2.0), (14, -3.0)])
def test_thirteen_frames_are_enough_to_tell(n_frames: int, late: float) -> None:
    first, second = (
        [Tangents(each.angles[:n_frames], PIXEL) for each in (seen(by, seed), seen(by, seed + 1))]
        for by, seed in ((0.0, 0), (late, 10))
    )
    found = lag_between(list(zip(first, second, strict=True)))
    assert found is not None
    assert found.is_late == (late != 0)
    assert found.frames == pytest.approx(late, abs=0.2)


def disc(camera: Camera, at: tuple[float, float, float]) -> Silhouette:
    """The silhouette of a ball, in whole pixels."""
    width, height = camera.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    rays = viewing_directions(camera, pixels.astype(np.float64)) @ camera.rotation
    way = np.array(at) - camera.centre
    cosine = rays @ way / np.linalg.norm(rays, axis=1) / np.linalg.norm(way)
    return silhouette_of((cosine > np.sqrt(1 - (250.0 / np.linalg.norm(way)) ** 2)).reshape(height, width))


@pytest.mark.parametrize("late", [0.3, 0.5, 0.7])
@pytest.mark.parametrize("seed", [1, 5, 7])
def test_motion_by_a_pixel_does_not_make_whole_lags_likely(seed: int, late: float) -> None:
    small = np.array([[150.0, 0, 79.5], [0, 150.0, 59.5], [0, 0, 1]])
    first, second = (Camera(small, (160, 120), look_at((x, 300.0, 2000.0), (0, 0, 0))) for x in (-700.0, 900.0))
    rng = np.random.default_rng(seed)
    waves = [(rng.uniform(4, 16), rng.uniform(0.2, 0.9), rng.uniform(0, 6)) for _ in range(3)]

    def height(instant: float) -> float:
        return float(sum(size * np.sin(w * instant + phase) for size, w, phase in waves))

    seen = [[disc(camera, (0.0, height(frame - by), 0.0)) for frame in range(24)] for camera, by in
            ((first, 0.0), (second, late))]  # fmt: skip
    planes = TangentPlanes(first, second, np.zeros(3))
    found = lag_between([(planes.tangents(first, seen[0]), planes.tangents(second, seen[1]))])
    assert found is not None
    assert found.frames == pytest.approx(late, abs=0.15)


def test_frames_that_the_pictures_edge_cuts_are_left_out() -> None:
    first, second = seen(0, 1), seen(1.5, 2)
    first.angles[5:9] = second.angles[20:25] = np.nan
    found = lag_between([(first, second)])
    assert found is not None
    assert found.frames == pytest.approx(1.5, abs=0.15)


def test_both_cameras_see_a_ball_between_the_same_planes() -> None:
    first, second = (Camera(K, (640, 480), look_at((x, 300.0, 2000.0), (0, 0, 0))) for x in (-700.0, 900.0))
    planes = TangentPlanes(first, second, np.zeros(3))
    assert planes.is_usable
    rng = np.random.default_rng(0)
    on_ball = rng.normal(size=(20_000, 3))
    on_ball = 150.0 * on_ball / np.linalg.norm(on_ball, axis=1, keepdims=True) + (40.0, -60.0, 30.0)
    angles = []
    for camera in (first, second):
        mask = np.zeros((480, 640), bool)
        columns, rows = np.rint(camera.project(on_ball)).astype(int).T
        mask[rows, columns] = True
        angles.append(planes.tangents(camera, [silhouette_of(mask)]).angles[0])
    np.testing.assert_allclose(angles[0], angles[1], atol=1.5e-3)  # a pixel and a half
    assert not TangentPlanes(first, second, first.centre + 10 * (first.centre - second.centre)).is_usable


@pytest.mark.slow
@pytest.mark.parametrize(("late", "told"), [(0.0, None), (1.25, "S2 is 1."), (-0.75, "ahead of S1")])
def test_a_sensor_of_the_studio_that_is_late_is_named(tmp_path: Path, late: float, told: str | None) -> None:
    parameters = SynthParameters("ball", n_sensors=2, n_frames=16, size=(480, 270), late=(("S2", late),))
    capture = synthesise(tmp_path / "ball", parameters)
    masks = {
        stream.id: tuple(MASK.replace("{view}", f"{stream.id}/{side}") for side in stream.sides)
        for stream in capture.sensors
    }
    write_capture(replace(capture, sensors=tuple(replace(each, mask=masks[each.id]) for each in capture.sensors)))
    report = check_capture(capture.folder)
    sentences = [*report.problems, *report.warnings]
    assert not any("could not be checked" in sentence for sentence in sentences)
    assert [sentence for sentence in sentences if "not synchronised" in sentence and (told or "") in sentence] == (
        sentences if told else []
    )
    assert len(sentences) == (told is not None)
