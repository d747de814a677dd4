"""Trying a mask before anything is drawn."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.errors import InvalidError
from app.intake.captures import CameraPictures
from app.intake.strokes import Stroke, replace_strokes
from app.operations.mask_trial import try_strokes


def test_a_mask_without_strokes_is_refused_in_words_and_not_by_a_file(tmp_path: Path) -> None:
    camera = CameraPictures("S1", "left", "left/{frame}.png", 64, 48)
    with pytest.raises(InvalidError, match="nothing is drawn on this frame"):
        try_strokes(tmp_path, camera, 0)
    replace_strokes(tmp_path, camera, 3, [Stroke(label="foreground", points=[(1, 1)])])
    with pytest.raises(InvalidError, match="nothing is drawn on this frame"):
        try_strokes(tmp_path, camera, 0)
