"""A contact sheet holds each picture under its label."""

from __future__ import annotations

import numpy as np
import pytest

from recon.render.sheet import GAP, LABEL, PAPER, contact_sheet


def test_pictures_stand_in_rows_in_their_order() -> None:
    images = [np.full((30 + 10 * k, 60, 3), 10 * k, dtype=np.uint8) for k in range(4)]
    sheet = contact_sheet(images, ["one", "two", "three", "four"], columns=3, width=60)
    assert sheet.shape == (2 * (60 + LABEL + GAP) + GAP, 3 * (60 + GAP) + GAP, 3)
    for k in range(4):
        top, left = k // 3 * (60 + LABEL + GAP) + GAP + LABEL, k % 3 * (60 + GAP) + GAP
        assert np.array_equal(sheet[top : top + 30 + 10 * k, left : left + 60], images[k])
        assert (sheet[top - LABEL : top, left : left + 60] < 150).any()  # ink
    assert (sheet[-1] == PAPER).all()


def test_grey_pictures_are_scaled_to_the_width() -> None:
    grey = np.tile(np.arange(120, dtype=np.uint8), (80, 1))
    sheet = contact_sheet([grey], ["depth"], width=60)
    assert sheet.shape == (40 + LABEL + 2 * GAP, 60 + 2 * GAP, 3)
    row = sheet[LABEL + GAP + 20, GAP : GAP + 60, 1].astype(int)
    assert np.abs(row - np.arange(60) * 2).max() <= 1


def test_a_label_for_each_picture_is_required() -> None:
    with pytest.raises(ValueError, match="found 0 and 0"):
        contact_sheet([], [])
    with pytest.raises(ValueError, match="found 1 and 2"):
        contact_sheet([np.zeros((4, 4), np.uint8)], ["a", "b"])
