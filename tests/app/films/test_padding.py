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


def test_a_damaged_copy_whose_box_has_no_size_is_read_to_its_end(tmp_path: Path) -> None:
    film = tmp_path / "film.mp4"
    (tmp_path / "film-40.mp4").write_bytes(b"\0\0\0\1mdat" + bytes(32))  # a size of 64 bits, which is 0
    assert restore(film)
    assert film.stat().st_size == 40
