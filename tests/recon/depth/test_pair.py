"""What a stereo pair refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from recon.depth.pair import StereoPair

GREY = np.zeros((20, 30), np.uint8)
COLOUR = np.zeros((20, 30, 3), np.uint8)
EVERYTHING = np.ones((20, 30), np.bool_)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"right": np.zeros((20, 31), np.uint8)}, "left image is 30x20, the right 31x20"),
        ({"right": COLOUR}, "left image has 1 channels, the right 3"),
        ({"left": COLOUR}, "left image has 3 channels, the right 1"),
        ({"left": np.zeros((20, 30, 4), np.uint8)}, r"left image has shape \(20, 30, 4\)"),
        ({"right": GREY.astype(np.uint16)}, "right image is uint16; expected 8 bits"),
        ({"left": np.zeros((6, 30), np.uint8)}, "left image is 30x6 pixels; matching needs at least 7"),
        ({"left": np.zeros((20, 6), np.uint8)}, "left image is 6x20 pixels; matching needs at least 7"),
        ({"n_disparities": 0}, "number of disparities is 0"),
        ({"n_disparities": -4}, "number of disparities is -4"),
        ({"n_disparities": 31}, "disparities 0 to 30 reach beyond images 30 pixels wide"),
        ({"min_disparity": 25}, "disparities 25 to 32 reach beyond"),
        ({"min_disparity": -30}, "disparities -30 to -23 reach beyond"),
        ({"left_mask": ~EVERYTHING}, "left mask is empty"),
        ({"right_mask": ~EVERYTHING}, "right mask is empty"),
        ({"left_mask": EVERYTHING[1:]}, r"left mask has shape \(19, 30\)"),
        ({"right_mask": EVERYTHING.astype(np.uint8)}, "right mask is uint8; expected bool"),
    ],
)
def test_a_pair_that_cannot_be_matched_is_refused_with_its_values(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        StereoPair(**{"left": GREY, "right": GREY, "n_disparities": 8, **changes})


def test_a_pair_of_the_least_size_is_accepted() -> None:
    pair = StereoPair(np.zeros((7, 7), np.uint8), np.zeros((7, 7), np.uint8), 7)
    assert (pair.height, pair.width) == (7, 7)
