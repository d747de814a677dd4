"""Census codes against a plain reference."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recon.depth.channels import fine_grey_image, grey_image
from recon.depth.matching.census import WINDOWS, census_pair


def plain_census(grey: NDArray[np.uint16], window: int = 5) -> NDArray[np.uint32]:
    framed = np.pad(grey, window // 2, mode="edge")
    codes = np.zeros(grey.shape, np.uint32)
    for row in range(window):
        for column in range(window):
            if (row, column) != (window // 2, window // 2):
                darker = framed[row : row + grey.shape[0], column : column + grey.shape[1]] < grey
                codes = (codes << np.uint32(1)) | darker.astype(np.uint32)
    return codes


@settings(deadline=None)  # the first call compiles
@given(seed=st.integers(0, 100), height=st.integers(1, 9), width=st.integers(1, 20), window=st.sampled_from(WINDOWS))
def test_codes_are_those_of_the_plain_reference(seed: int, height: int, width: int, window: int) -> None:
    grey = np.random.default_rng(seed).integers(0, 5, (height, width)).astype(np.uint16)
    np.testing.assert_array_equal(census_pair(grey, window)[0], plain_census(grey, window))


def test_codes_do_not_change_with_exposure() -> None:
    grey = np.random.default_rng(0).integers(0, 20000, (12, 15)).astype(np.uint16)
    np.testing.assert_array_equal(census_pair(grey)[0], census_pair(3 * grey + np.uint16(700))[0])


def test_the_second_code_is_that_of_the_blurred_image() -> None:
    grey = np.random.default_rng(0).integers(0, 65000, (12, 15)).astype(np.uint16)
    codes = census_pair(grey)
    np.testing.assert_array_equal(codes[0], plain_census(grey))
    np.testing.assert_array_equal(codes[1], plain_census(np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0), np.uint16)))


@pytest.mark.parametrize("shape", [(6, 8), (6, 8, 3)])
def test_fine_grey_rounds_to_grey(shape: tuple[int, ...]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    fine = fine_grey_image(image)
    assert np.abs(fine / 256 - grey_image(image).astype(float)).max() < 0.8
