from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from recon.runtime.tiff import read_tiff

COLUMNS, ROWS = np.meshgrid(np.arange(53), np.arange(37))
RGB = np.stack([COLUMNS * 4, ROWS * 6, COLUMNS + ROWS], axis=-1).astype(np.uint8)
RGB16 = RGB.astype(np.uint16) * 257 + 5
GREY, GREY16 = RGB[..., 0], RGB16[..., 0]
ALPHA = RGB[..., 2]


def content(folder: Path, pixels: np.ndarray, **how: Any) -> bytes:
    """Return a TIFF by a writer that is none of the readers."""
    tifffile.imwrite(folder / "a.tif", pixels, **how)
    return (folder / "a.tif").read_bytes()


def same_in_all(channel: np.ndarray) -> np.ndarray:
    return np.repeat(channel[..., None], 3, axis=-1)


@pytest.mark.parametrize(
    ("pixels", "how", "expected"),
    [
        (RGB, {"photometric": "rgb"}, RGB),
        (RGB, {"photometric": "rgb", "tile": (16, 16)}, RGB),
        (RGB, {"photometric": "rgb", "compression": "zlib", "predictor": True, "bigtiff": True}, RGB),
        (np.moveaxis(RGB, -1, 0), {"photometric": "rgb", "planarconfig": "separate"}, RGB),
        (np.dstack([RGB, ALPHA]), {"photometric": "rgb", "extrasamples": ["unassalpha"]}, RGB),
        (GREY, {"photometric": "miniswhite"}, same_in_all(255 - GREY)),
        (GREY > 99, {"photometric": "minisblack"}, same_in_all(np.uint8(255) * (GREY > 99))),
        (RGB16, {"photometric": "rgb", "tile": (16, 16), "byteorder": ">"}, RGB16),
        (np.dstack([RGB16, GREY16]), {"photometric": "rgb", "extrasamples": ["unassalpha"]}, RGB16),
        (GREY16, {"photometric": "minisblack"}, same_in_all(GREY16)),
    ],
)
def test_a_tiff_is_read_as_it_was_written_whatever_its_layout(
    tmp_path: Path, pixels: np.ndarray, how: Mapping[str, Any], expected: np.ndarray
) -> None:
    read = read_tiff(content(tmp_path, pixels, **how))
    assert read.dtype == expected.dtype
    np.testing.assert_array_equal(read, expected)


@pytest.mark.parametrize(
    ("pixels", "how", "sentence"),
    [
        (np.moveaxis(RGB16, -1, 0), {"photometric": "rgb", "planarconfig": "separate"}, "16 bits whose channels"),
        (GREY16, {"photometric": "miniswhite"}, "16 bits whose channels"),
        (np.dstack([GREY16, GREY16]), {"photometric": "minisblack", "planarconfig": "contig"}, "not known"),
        (GREY / np.float32(255), {}, "32 bits a channel, floating"),
        (GREY16.astype(np.int16), {}, "signed"),
        (RGB, {"photometric": "rgb", "extratags": [(274, 3, 1, 3, True)]}, "orientation 3"),
        (np.stack([RGB, RGB]), {"photometric": "rgb"}, "of 2 pictures"),
    ],
)
def test_a_tiff_that_would_be_misread_is_refused_by_what_it_has(
    tmp_path: Path, pixels: np.ndarray, how: Mapping[str, Any], sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        read_tiff(content(tmp_path, pixels, **how))


@pytest.mark.parametrize("pixels", [RGB, RGB16])
@pytest.mark.parametrize("planes", ["contig", "separate"])
def test_a_tiff_that_is_cut_off_is_never_read_as_whole(tmp_path: Path, pixels: np.ndarray, planes: str) -> None:
    stored = pixels if planes == "contig" else np.moveaxis(pixels, -1, 0)
    whole = content(tmp_path, stored, photometric="rgb", planarconfig=planes)
    with pytest.raises(ValueError, match="is a TIFF"):
        read_tiff(whole[:-9])
