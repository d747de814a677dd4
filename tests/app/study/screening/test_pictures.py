"""Rings and PNG files of the screening."""

from __future__ import annotations

import subprocess

import imageio_ffmpeg
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from app.simulation.observer import Observer, gap_of_ring
from app.study.screening.pictures import decode_srgb, encode_srgb, landolt_ring, png, read_png


@pytest.mark.slow
@given(st.floats(2, 40), st.integers(0, 7))
def test_a_rings_gap_is_where_it_was_put(gap_px: float, direction: int) -> None:
    assert gap_of_ring(landolt_ring(gap_px, direction)) == direction


@pytest.mark.slow
@given(st.floats(2, 40), st.integers(0, 7))
def test_a_ring_has_the_ink_that_its_standard_gives_it(gap_px: float, direction: int) -> None:
    """The ring less its gap, in linear light: pi (2.5^2 - 1.5^2) - 1 gap^2, the slit's curved ends aside."""
    ink = (1 - decode_srgb(landolt_ring(gap_px, direction) / 255.0)).sum() / gap_px**2
    assert ink == pytest.approx(4 * np.pi - 1, abs=0.1)


def test_a_straight_gap_of_whole_pixels_is_drawn_without_grey() -> None:
    ring = landolt_ring(4, 0)
    middle = len(ring) // 2
    assert np.all(ring[middle - 2 : middle + 2, middle:] == 255)
    assert np.all(ring[middle - 1 : middle + 1, middle - 9 : middle - 6] == 0)


@pytest.mark.parametrize("gap_px", [0.5, 401, float("nan")])
def test_a_gap_that_cannot_be_drawn_is_refused(gap_px: float) -> None:
    with pytest.raises(ValueError, match="expected 1 to 400"):
        landolt_ring(gap_px, 0)


@given(arrays(np.uint8, st.sampled_from([(3, 5), (4, 2, 3)])))
def test_a_png_is_read_as_it_was_written(picture: np.ndarray) -> None:
    assert np.array_equal(read_png(png(picture)), picture)


def test_others_read_the_png_too() -> None:
    picture = np.random.default_rng(1).integers(256, size=(6, 8, 3), dtype=np.uint8)
    command = [
        imageio_ffmpeg.get_ffmpeg_exe(),
        "-v",
        "error",
        "-f",
        "png_pipe",
        "-i",
        "-",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-",
    ]
    raw = subprocess.run(command, input=png(picture), capture_output=True, check=True).stdout
    assert np.array_equal(np.frombuffer(raw, np.uint8).reshape(picture.shape), picture)


@pytest.mark.parametrize(
    "file",
    [b"GIF89a", png(np.zeros((2, 2), bool))],
)
def test_files_that_are_something_else_are_named(file: bytes) -> None:
    with pytest.raises(ValueError, match="expected"):
        read_png(file)


@given(st.floats(0, 1))
def test_srgb_levels_and_light_are_inverse(level: float) -> None:
    assert encode_srgb(decode_srgb(np.array([level])))[0] == pytest.approx(level, abs=1e-6)


def test_an_observer_sees_large_rings_and_guesses_small_ones() -> None:
    rng = np.random.default_rng(4)
    ring = landolt_ring(5, 3)
    large, small = ([Observer(0.2).answer_ring(ring, size, rng) for _ in range(300)] for size in (1.0, -0.4))
    assert np.mean(np.array(large) == 3) > 0.94
    assert np.mean(np.array(small) == 3) < 0.25
