"""Recordings with late sensors, written anew: against what the studio records without a lag."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recon.capture.checking.lag import Lag
from recon.capture.format import (
    Capture,
    CaptureError,
    DepthMaps,
    frame_pictures,
    read_capture,
    read_frame,
    read_masks,
    read_picture,
    write_capture,
)
from recon.capture.images import write_picture
from recon.capture.mending.interpolation import way_between
from recon.capture.mending.resample import moved, resample, schedule
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MASK
from tests.command_line import Command

SIZE = (160, 120)


def recorded(folder: Path, late: float, n_frames: int = 6) -> Capture:
    parameters = SynthParameters("sphere", 2, n_frames, SIZE, noise=0.0, fps=25.0, late=(("S2", late),))
    capture = synthesise(folder, parameters)
    sensors = tuple(
        replace(each, mask=tuple(MASK.replace("{view}", f"{each.id}/{side}") for side in each.sides))
        for each in capture.sensors
    )
    write_capture(replace(capture, sensors=sensors))
    return read_capture(folder)


def lag(frames: float) -> Lag:
    return Lag(frames, frames - 0.1, frames + 0.1, 9.0 if frames else 0.0)


class _Stream:
    def __init__(self, name: str) -> None:
        self.id = name


class _Capture:
    folder, n_frames = Path(), 20

    def __init__(self, ids: list[str]) -> None:
        self.sensors = tuple(map(_Stream, ids))


@given(st.lists(st.floats(-3, 3), min_size=1, max_size=3))
def test_every_new_frame_is_of_one_instant_and_was_recorded_by_all(late: list[float]) -> None:
    ids = [f"S{k + 1}" for k in range(len(late) + 1)]

    lags = {(a, b): lag(round(by, 2)) for a, b, by in zip(ids, ids[1:], late, strict=False)}
    if not any(each.is_late for each in lags.values()):
        return
    plan = schedule(_Capture(ids), lags)  # type: ignore[arg-type]
    behind = np.cumsum([0.0, *(each.frames if each.is_late else 0.0 for each in lags.values())])
    for frame in (0, plan.n_frames - 1):
        instants = []
        for name, by in zip(ids, behind, strict=True):
            whole, share = plan.instant(name, frame)
            assert 0 <= whole <= 19 - (share > 0)
            instants.append(whole + share - by)
        assert np.ptp(instants) <= 0.2 + 1e-9
    assert any(plan.instant(name, 0)[1] == 0 for name in ids)


@pytest.mark.slow
def test_a_sensor_late_by_whole_frames_gets_the_very_files_of_the_right_instants(tmp_path: Path) -> None:
    late = recorded(tmp_path / "late", 2.0)
    now = recorded(tmp_path / "now", 0.0)
    made = resample(late, {("S1", "S2"): lag(2.0)}, tmp_path / "made")
    assert made.n_frames == 4
    for frame in range(4):
        for sensor in ("S1", "S2"):
            for mine, true in zip(read_frame(made, sensor, frame), read_frame(now, sensor, frame), strict=True):
                assert np.abs(mine.astype(int) - true).max() <= 1
    masks, true_masks = (read_masks(capture, "S2", 1) for capture in (read_capture(tmp_path / "made"), now))
    assert masks is not None
    assert true_masks is not None
    assert np.array_equal(masks[0], true_masks[0])


@pytest.mark.slow
def test_half_a_frame_is_made_of_both_and_nearer_to_the_truth_than_either(tmp_path: Path) -> None:
    late, now = (recorded(tmp_path / str(by), by, n_frames=30) for by in (0.5, 0.0))
    lags = {("S1", "S2"): lag(0.5)}
    plan = schedule(late, lags)
    made = resample(late, lags, tmp_path / "made")

    def error(one: Capture, frame: int, other: Capture, its: int) -> float:
        return float(np.mean((read_frame(one, "S2", frame)[0].astype(float) - read_frame(other, "S2", its)[0]) ** 2))

    n_better = 0
    for frame in range(4, 20, 2):
        now_frame = plan.first + frame
        mine = error(made, frame, now, now_frame)
        n_better += mine < 0.7 * min(error(late, now_frame + step, now, now_frame) for step in (0, 1))
    assert n_better >= 7


def test_the_way_between_moves_what_moves_by_its_share() -> None:
    rng = np.random.default_rng(0)
    picture = np.kron(rng.integers(0, 255, (24, 32, 3), dtype=np.uint8), np.ones((5, 5, 1), np.uint8))
    first, second = picture[:, :-8], picture[:, 8:]
    middle = way_between(first, second, 0.25).picture(first, second)
    expected = picture[:, 2:-6]
    inside = np.s_[12:-12, 12:-12]
    assert np.abs(middle[inside].astype(float) - expected[inside]).mean() < 5.0
    assert np.abs(first[inside].astype(float) - expected[inside]).mean() > 15.0


@pytest.mark.slow
def test_photographs_whose_suffix_is_in_capitals_are_copied_as_they_are(tmp_path: Path) -> None:
    capture = synthesise(tmp_path / "a", SynthParameters("sphere", 2, 4, (48, 36)))
    stream = capture.sensors[1]
    for frame in range(4):
        for picture in frame_pictures(capture.folder, stream, frame):
            write_picture(picture.path.with_suffix(".jpg"), read_picture(picture))
            picture.path.with_suffix(".jpg").rename(picture.path.with_suffix(".JPG"))
    left, right = (replace(each, image=each.image.replace(".png", ".JPG")) for each in stream.cameras)
    capture = replace(capture, sensors=(capture.sensors[0], replace(stream, left=left, right=right)))
    made = resample(capture, {("S1", "S2"): lag(2.0)}, tmp_path / "b")
    taken, given = (frame_pictures(each.folder, each.sensors[1], at)[0].path for each, at in ((made, 0), (capture, 2)))
    assert taken.read_bytes() == given.read_bytes()


def test_a_lag_that_may_be_more_than_was_searched_is_not_put_right_by_what_was() -> None:
    with pytest.raises(CaptureError, match=r"how late S2 is to S1 is not known, but 3\.50 frames or more"):
        schedule(_Capture(["S1", "S2"]), {("S1", "S2"): Lag(-3.5, -3.5, -3.2, 9.0, is_beyond=True)})  # type: ignore[arg-type]


@pytest.mark.slow
def test_depth_maps_that_are_late_by_half_a_frame_are_each_taken_once(tmp_path: Path) -> None:
    capture = synthesise(tmp_path / "a", SynthParameters("sphere", 2, 6, (48, 36)))
    name = "S2/depth/{frame:04d}.npy"
    for frame in range(6):
        (tmp_path / "a/S2/depth").mkdir(parents=True, exist_ok=True)
        np.save(tmp_path / "a" / name.format(frame=frame), np.full((36, 48), 1000.0 + frame))
    second = replace(capture.sensors[1], depth=DepthMaps(name))
    made = resample(replace(capture, sensors=(capture.sensors[0], second)), {("S1", "S2"): lag(0.5)}, tmp_path / "b")
    taken = [float(np.load(tmp_path / "b" / name.format(frame=frame))[0, 0]) for frame in range(made.n_frames)]
    assert np.diff(taken).tolist() == [1.0] * (made.n_frames - 1)
    (told,) = moved(replace(capture, sensors=(capture.sensors[0], second)), {("S1", "S2"): lag(0.5)})
    assert told.endswith("; of a sensor with depth maps, by the nearest whole frames")


@pytest.mark.slow
def test_what_is_not_known_or_not_late_is_refused(tmp_path: Path) -> None:
    capture = synthesise(tmp_path / "a", SynthParameters("sphere", 2, 2, (48, 36)))
    with pytest.raises(CaptureError, match="how late S2 is behind S1 is not known"):
        resample(capture, {}, tmp_path / "b")
    with pytest.raises(CaptureError, match="nothing to resample"):
        resample(capture, {("S1", "S2"): lag(0.0)}, tmp_path / "b")
    assert not (tmp_path / "b").exists()


@pytest.mark.slow
def test_a_sensor_that_is_late_is_put_right_though_nothing_tells_of_two_others(tmp_path: Path) -> None:
    capture = synthesise(tmp_path / "a", SynthParameters("sphere", 3, 5, (48, 36)))
    plan = schedule(capture, {("S2", "S3"): lag(2.0)})
    assert (plan.late, plan.n_frames) == ({"S1": 0.0, "S2": 0.0, "S3": 2.0}, 3)


@pytest.mark.slow
def test_it_is_said_by_how_much_a_sensor_is_moved_and_how_sure_that_is_or_that_it_is_not(tmp_path: Path) -> None:
    capture = synthesise(tmp_path / "a", SynthParameters("sphere", 4, 2, (48, 36)))
    told = list(moved(capture, {("S1", "S2"): Lag(2.25, 2.0, 2.6, 9.0), ("S2", "S3"): lag(0.0)}))
    assert told == [
        "S2 is moved by 2.25 frames against S1, give or take 0.35",
        "S4 stays as it is to S3: how late it is could not be checked",
    ]


@pytest.mark.slow
def test_the_command_asks_for_the_folder_and_says_what_is_not_known(command: Command, tmp_path: Path) -> None:
    synthesise(tmp_path / "a", SynthParameters("sphere", 2, 2, (48, 36)))
    told = command("capture", "check", tmp_path / "a", "--resample")
    assert told.code == 2
    assert "--out belong" in " ".join(told.err.split())
    told = command("capture", "check", tmp_path / "a", "--resample", "-o", tmp_path / "b")
    assert told.code == 1
    assert "how late S2 is behind S1 is not known" in told.err
