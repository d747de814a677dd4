"""Rows that are apart are measured and moved together: against known shifts, turns and stretches."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recon.capture.checking.matches import Matches
from recon.capture.checking.rows import RowFit, aligned, fit_rows
from recon.capture.checking.sensor import _misfit, _row_warnings
from recon.capture.checking.sensor_report import Rows, SensorReport
from recon.depth.disparity_io import read_disparity
from recon.geometry.rig import Camera, Sensor, rigid
from recon.pipeline.reconstruct import match_files

PIVOT = (160.0, 120.0)


def matches(shift: float, turn: float, stretch: float, n: int = 200, seed: int = 0) -> Matches:
    """Points of a rectified pair whose right picture is moved so, found to 0.1 px; a tenth of them wrong."""
    rng = np.random.default_rng(seed)
    left = rng.uniform((0, 0), (320, 240), (n, 2))
    right = left - np.column_stack([rng.uniform(5, 40, n), np.zeros(n)])
    apart = shift + turn * (right[:, 0] - PIVOT[0]) + stretch * (left[:, 1] - PIVOT[1])
    right[:, 1] -= apart + rng.normal(0, 0.1, n)
    right[: n // 10] = rng.uniform((0, 0), (320, 240), (n // 10, 2))
    return Matches(left, right)


@given(st.floats(-3, 3), st.floats(-0.003, 0.003), st.floats(-0.003, 0.003))
def test_a_shift_a_turn_and_a_stretch_are_found_together(shift: float, turn: float, stretch: float) -> None:
    fit = fit_rows(matches(shift, turn, stretch), PIVOT)
    assert fit is not None
    assert (fit.shift_px, fit.turn, fit.stretch) == pytest.approx((shift, turn, stretch), abs=0.05)
    assert fit.after_px < 0.15
    assert fit.is_off == (fit.before_px > 1 / 3 and fit.largest_px <= 3.5)


def test_rows_that_agree_are_left_alone_and_few_points_say_nothing() -> None:
    fit = fit_rows(matches(0.1, 0.0, 0.0), PIVOT)
    assert fit is not None
    assert not fit.is_off
    assert fit_rows(matches(1.0, 0.0, 0.0, n=15), PIVOT) is None
    rng = np.random.default_rng(1)
    unrelated = Matches(rng.uniform(0, 300, (80, 2)), rng.uniform(0, 300, (80, 2)))
    assert fit_rows(unrelated, PIVOT) is None


def test_a_picture_that_is_moved_and_moved_back_is_as_it_was() -> None:
    rng = np.random.default_rng(0)
    picture = cv2.GaussianBlur(rng.integers(0, 255, (120, 160), dtype=np.uint8), (0, 0), 2)
    turned = cv2.getRotationMatrix2D((80, 60), 0.5, 1.0)
    moved = cv2.warpAffine(picture, turned, (160, 120), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    # cv2 turns counter-clockwise: what was farther to the right is higher, so the left picture's row is larger
    fit = RowFit(0.0, np.sin(np.deg2rad(0.5)), 0.0, (80.0, 60.0), 1.0, 1.0, 0.0)
    back = aligned(moved, fit)[10:-10, 10:-10].astype(float)
    assert np.abs(back - picture[10:-10, 10:-10]).max() <= 3


@pytest.mark.slow
@pytest.mark.parametrize(("shift", "turn_deg"), [(1.0, 0.0), (0.0, 0.3)])
def test_matching_a_real_pair_is_as_good_with_rows_apart(
    tmp_path: Path, real_data: Path, shift: float, turn_deg: float
) -> None:
    folder = real_data / "stereo_pairs/teddy"
    truth = cv2.imread(str(folder / "disp2.png"), cv2.IMREAD_GRAYSCALE) / 4.0
    right = cv2.imread(str(folder / "im6.png"))
    height, width = truth.shape
    move = cv2.getRotationMatrix2D(((width - 1) / 2, (height - 1) / 2), turn_deg, 1.0)
    move[1, 2] += shift
    cv2.imwrite(str(tmp_path / "off.png"), cv2.warpAffine(right, move, (width, height), flags=cv2.INTER_CUBIC))

    def bad(name: Path) -> float:
        told = match_files(folder / "im2.png", name, tmp_path / "out.npy", method="dr", n_disparities=64)
        assert any("rows" in warning for warning in told["warnings"]) == (name.name == "off.png")
        disparity = read_disparity(tmp_path / "out.npy")
        inside = np.zeros_like(truth, bool)
        inside[20:-20, 20:-20] = True
        known = inside & (truth > 0) & np.isfinite(disparity)
        return float((np.abs(disparity - truth)[known] > 1).mean())

    assert bad(tmp_path / "off.png") < bad(folder / "im6.png") + 0.005


@pytest.mark.parametrize(("left_px", "told"), [(0.1, "move them together, of which 0.10 remain"), (None, "calibrate")])
def test_rows_are_promised_to_be_moved_together_only_where_they_will_be(left_px: float | None, told: str) -> None:
    report = SensorReport("S1", 100.0, rows=Rows(90, 0.6, 10.0, 1.0, 80, left_px), is_checked=True)
    (warning,) = _row_warnings(report, 0.6, None, is_told=False)
    assert told in warning
    assert ("move them together" in warning) is (left_px is not None)


def test_rows_of_a_pair_whose_object_gives_no_match_are_as_far_apart_as_those_of_the_room() -> None:
    K = np.array([[500.0, 0, 160], [0, 500, 120], [0, 0, 1]])
    left = Camera(K, (320, 240), np.eye(4))
    sensor = Sensor("S1", left, Camera(K, (320, 240), rigid(np.eye(3), (-100.0, 0, 0))))
    assert _misfit(sensor, matches(0.8, 0.0, 0.0), Rows(3, None, None)) == pytest.approx(0.8 / np.sqrt(2), abs=0.2)
