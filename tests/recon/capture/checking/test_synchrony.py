from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from recon.capture.checking.check import check_capture
from recon.capture.checking.continuity import Glance
from recon.capture.checking.sensor_report import SensorReport
from recon.capture.checking.synchrony import MAX_LAG, MIN_MARGIN, lag, would_lag_show
from recon.capture.format import Capture, image_path
from recon.studio import SynthParameters, synthesise
from tests.recon.capture.calibration.board_geometry import record_board

N = 40


def signal(seed: int) -> np.ndarray:
    """How much a scene moves from frame to frame."""
    rng = np.random.default_rng(seed)
    return np.asarray(np.convolve(rng.normal(3.0, 1.0, N + 12), np.ones(3) / 3, mode="valid"))


@given(st.integers(0, 2**32 - 1), st.integers(-MAX_LAG, MAX_LAG), st.floats(0.3, 3.0))
@settings(deadline=None, max_examples=60)
def test_a_late_camera_is_found_whatever_its_distance_unless_motion_is_steady(
    seed: int, late: int, scale: float
) -> None:
    motion, noise = signal(seed), np.random.default_rng(seed + 1).normal(0, 0.05, N)
    first, second = motion[5 : 5 + N], scale * (motion[5 - late : 5 - late + N] + noise)
    assume(late == 0 or np.corrcoef(first, second)[0, 1] < 1 - MIN_MARGIN - 0.02)  # else it is steady
    assert lag([(first, second)]) == late


def test_motion_that_is_alike_a_frame_later_says_nothing() -> None:
    steady = np.sin(np.arange(N + 1) / 8)
    assert lag([(steady[1:], steady[:-1])]) == 0


def test_cameras_without_likeness_or_motion_say_nothing() -> None:
    assert lag([(signal(1)[:N], signal(2)[:N])]) == 0
    assert lag([(np.zeros(N), np.zeros(N)), (None, signal(2)[:N])]) == 0


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    from recon.studio import SynthParameters, synthesise

    parameters = SynthParameters("ball", n_sensors=2, n_frames=16, size=(200, 150))
    return synthesise(tmp_path_factory.mktemp("recorded") / "ball", parameters)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sides", "expected"),
    [
        (("right",), "sensor S2: its cameras are not synchronised, the right pictures are 2 frames behind"),
        (("left", "right"), "sensors S1 and S2 are not synchronised, S2 is 2 frames behind S1"),
        ((), None),
    ],
)
def test_cameras_that_started_late_are_named(
    recorded: Capture, tmp_path: Path, sides: tuple[str, ...], expected: str | None
) -> None:
    folder = Path(shutil.copytree(recorded.folder, tmp_path / "late"))
    for side in sides:
        files = [image_path(folder, f"S2/{side}/{{frame:04d}}.png", frame) for frame in range(recorded.n_frames)]
        contents = [path.read_bytes() for path in files]
        for frame, path in enumerate(files):
            path.write_bytes(contents[frame - 2])  # the motion is periodic
    found = [problem for problem in check_capture(folder).problems if "synchronised" in problem]
    assert [problem.startswith(expected or "-") for problem in found] == [True] * len(found)
    assert bool(found) == bool(expected)


@pytest.mark.slow
def test_a_few_frames_of_several_sensors_could_not_be_checked(tmp_path: Path) -> None:
    synthesise(tmp_path / "few", SynthParameters("ball", n_sensors=2, n_frames=2, size=(160, 120)))
    sentences = check_capture(tmp_path / "few").warnings
    assert any("same instants could not be checked" in sentence for sentence in sentences)


def glances_of(motion: list[float]) -> dict[int, Glance]:
    levels = np.cumsum([0.0, *motion])
    return {frame: Glance(np.full((2, 2), level, np.float32), frame) for frame, level in enumerate(levels)}


@pytest.mark.parametrize(
    ("n_frames", "size", "expected"),
    [(30, 5.0, True), (12, 5.0, False), (30, 0.0, False), (1, 5.0, None)],
    ids=["it moves", "few frames", "nothing moves", "one frame"],
)
def test_a_pair_is_said_to_be_of_one_time_only_where_motion_tells_it(
    tmp_path: Path, n_frames: int, size: float, expected: bool | None
) -> None:
    (stream,) = record_board(tmp_path / "board", n_sensors=1, n_frames=1).sensors
    motion = list(size * np.random.default_rng(0).random(n_frames - 1))
    glances = {side.image: glances_of(motion) for side in stream.cameras}
    assert would_lag_show(stream, glances) is expected
    report = SensorReport("S1", 100.0, expected_error_mm=1.0, textured=0.9, are_instants_checked=expected)
    assert ("whether its two cameras recorded at one time could not" in report.verdict()) is (expected is False)
