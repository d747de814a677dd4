"""Verdicts rest on matched points that agree with one another, and say so where few do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.capture.checking.agreement import Agreement, agreeing, agreeing_with_each_other
from recon.capture.checking.check import check_capture
from recon.capture.checking.matches import Matches
from recon.capture.format import image_path, write_capture
from tests.recon.capture.calibration.board_geometry import record_board
from tests.recon.capture.checking.test_consistency import FIRST, points, seen


def exchange_pictures(folder: Path, left: str, right: str, frame: int) -> None:
    one, other = image_path(folder, left, frame), image_path(folder, right, frame)
    content = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(content)


def test_the_true_matches_among_many_wrong_ones_are_found() -> None:
    rng = np.random.default_rng(0)
    true = seen(FIRST, points(200))
    wrong = Matches(*rng.uniform((0, 0), FIRST.left.size, (2, 400, 2)))
    chosen = agreeing(Matches(np.concatenate([true.left, wrong.left]), np.concatenate([true.right, wrong.right])))
    assert chosen[:200].sum() > 190
    assert chosen[200:].sum() < 20
    assert Agreement(int(chosen.sum()), len(chosen)).is_enough


@pytest.mark.parametrize(("n_true", "is_believed"), [(75, True), (30, False)])
def test_a_pattern_that_repeats_does_not_outvote_about_as_many_that_fit_the_calibration(
    n_true: int, *, is_believed: bool
) -> None:
    both = seen(FIRST, points(n_true + 85))
    right = both.right + np.where(np.arange(n_true + 85) < n_true, 0.0, 76.0)[:, None] * [0.0, 1.0]
    chosen = agreeing_with_each_other(FIRST, Matches(both.left, right))
    assert chosen[:n_true].all() == is_believed
    assert chosen[n_true:].mean() < 0.1 if is_believed else chosen[n_true:].all()


@pytest.mark.parametrize("n", [5, 20, 60, 400, 1500])
def test_matches_by_chance_are_never_enough(n: int) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        chosen = agreeing(Matches(*rng.uniform((0, 0), (640, 480), (2, n, 2))))
        assert not Agreement(int(chosen.sum()), n).is_enough


@pytest.mark.slow
def test_pictures_that_show_different_things_could_not_be_checked(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board", n_sensors=1)
    rng = np.random.default_rng(0)
    for frame in range(2):
        other = cv2.resize(rng.integers(0, 255, (30, 40, 3), np.uint8), (160, 120), interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(image_path(board.folder, board.sensors[0].right.image, frame)), other)
    report = check_capture(board.folder)
    assert any("S1: its calibration could not be checked, because only " in warning for warning in report.warnings)
    assert report.verdicts == ("S1: its calibration could not be checked, so which accuracy to expect is not known",)
    assert report.sensors[0].expected_error_mm is None


def test_matches_that_do_not_agree_tell_nothing_about_exposures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = record_board(tmp_path / "board", n_sensors=1)
    for frame in range(2):
        path = str(image_path(board.folder, board.sensors[0].right.image, frame))
        cv2.imwrite(path, cv2.imread(path) // 2)
    rng = np.random.default_rng(0)
    monkeypatch.setattr(
        "recon.capture.checking.sensor.match_pictures",
        lambda *_: Matches(*rng.uniform((0, 0), (159, 119), (2, 400, 2))),
    )
    warnings = check_capture(board.folder).warnings
    assert any("S1: its calibration could not be checked, because only " in warning for warning in warnings)
    assert not any("at matched points" in warning for warning in warnings)


@pytest.mark.slow
@pytest.mark.parametrize("swapped", [(2,), (0, 1, 3)])
def test_shots_whose_pictures_are_swapped_are_named_and_the_sensor_is_judged_by_the_others(
    tmp_path: Path, swapped: tuple[int, ...]
) -> None:
    board = record_board(tmp_path / "board", n_sensors=1, n_frames=4)
    (stream,) = board.sensors
    for frame in swapped:
        exchange_pictures(board.folder, stream.left.image, stream.right.image, frame)
    report = check_capture(board.folder)
    names = ", ".join(map(str, swapped))
    (problem,) = report.problems
    assert f"S1: left and right are swapped in frame{'s' * (len(swapped) > 1)} {names}, but not in the" in problem
    assert report.sensors[0].expected_error_mm is not None


def test_an_error_that_is_larger_than_the_bounds_is_a_problem_by_itself(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board", n_sensors=1)
    flat = board.bounds.mean(axis=0) + np.outer((-1, 1), (90.0, 90.0, 0.5))
    write_capture(replace(board, bounds=flat))
    (problem,) = check_capture(board.folder).problems
    assert "the depth error to expect, " in problem
    assert "is larger than the bounds (1 mm)" in problem
