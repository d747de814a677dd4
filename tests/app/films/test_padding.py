"""Films are filled up to a size, and are the same films."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.films.padding import HEADER, padded, restore
from tests.app import tiny_stimuli


@pytest.mark.parametrize("more", [0, 1, 100_000])
def test_a_padded_film_shows_the_same_and_can_be_made_small_again(tmp_path: Path, more: int) -> None:
    film = tmp_path / "film.mp4"
    tiny_stimuli.encode(film, "testsrc=size=64x48", "-movflags", "+faststart")
    content = film.read_bytes()
    copy = padded(film, len(content) + HEADER + more)
    assert copy.stat().st_size == len(content) + HEADER + more
    assert np.array_equal(tiny_stimuli.frames(copy), tiny_stimuli.frames(film))
    film.unlink()
    assert restore(film)
    assert film.read_bytes() == content
    assert not restore(tmp_path / "other.mp4")
