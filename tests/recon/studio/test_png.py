from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.studio.png import LONGEST_CODE, _code_lengths, encode_png


def decoded(content: bytes) -> np.ndarray:
    return np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED))


@given(st.integers(1, 40), st.integers(1, 40), st.floats(0.0, 90.0), st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=40)
def test_every_picture_is_read_back_as_it_was(height: int, width: int, noise: float, seed: int) -> None:
    picture = np.random.default_rng(seed).normal(128, noise, (height, width, 3)).clip(0, 255).astype(np.uint8)
    np.testing.assert_array_equal(decoded(encode_png(picture)), picture)


@pytest.mark.parametrize("value", [0, 2, 255])
def test_a_picture_of_one_value_is_read_back(value: int) -> None:
    picture = np.full((3, 5, 3), value, np.uint8)
    np.testing.assert_array_equal(decoded(encode_png(picture)), picture)


def test_it_is_as_small_as_zlib_makes_noise() -> None:
    picture = np.random.default_rng(0).normal(90, 1.5, (200, 300, 3)).round().astype(np.uint8)
    options = (
        cv2.IMWRITE_PNG_STRATEGY,
        cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
        cv2.IMWRITE_PNG_FILTER,
        cv2.IMWRITE_PNG_FILTER_UP,
    )
    assert len(encode_png(picture)) < 1.02 * len(cv2.imencode(".png", picture, options)[1])


def test_no_code_is_longer_than_deflate_allows() -> None:
    counts = np.zeros(257, np.int64)
    counts[:40] = np.round(1.6 ** np.arange(40))  # Fibonacci's numbers make the longest codes
    lengths = _code_lengths(counts)
    assert lengths.max() <= LONGEST_CODE
    assert float((0.5 ** lengths[counts > 0]).sum()) == 1.0  # Kraft's equality: every sequence of bits means something
