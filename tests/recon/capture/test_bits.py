"""How many of 16 bits pictures fill: as their files say, else by the values of all of them together."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from recon.capture.bits import brightness_doubt, used_bits


def png(path: Path, values: np.ndarray, stated: int = 0) -> Path:
    """Write a PNG of 16 bits, and how many of them are significant."""
    content = cv2.imencode(".png", values.astype(np.uint16))[1].tobytes()
    chunk = b"sBIT" + bytes([stated])
    said = struct.pack(">I", 1) + chunk + struct.pack(">I", zlib.crc32(chunk)) if stated else b""
    path.write_bytes(content[:33] + said + content[33:])
    return path


RAMP = np.arange(300).reshape(15, 20)


@pytest.mark.parametrize("stated", [10, 12, 14])
def test_a_dark_recording_has_the_bits_that_its_files_state(tmp_path: Path, stated: int) -> None:
    assert used_bits([png(tmp_path / "a.png", RAMP, stated)]) == stated
    assert used_bits([png(tmp_path / "b.png", RAMP)]) == 10  # the fewest of a camera that hold 299


def test_a_png_whose_significant_bits_are_the_upper_ones_fills_16(tmp_path: Path) -> None:
    assert used_bits([png(tmp_path / "dark.png", RAMP * 4, 14)]) == 16
    assert used_bits([png(tmp_path / "bright.png", RAMP * 200, 14)]) == 16
    assert used_bits([png(tmp_path / "whole.png", RAMP, 16)]) == 16


def test_the_largest_value_that_a_tiff_states_counts(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, RAMP.astype(np.uint16), photometric="minisblack", extratags=[(281, 3, 1, 16383, True)])
    assert used_bits([path]) == 14


def test_whether_pictures_of_a_capture_are_read_too_dark_could_not_be_checked_or_is_known(tmp_path: Path) -> None:
    dark = png(tmp_path / "dark.png", RAMP * 50)
    assert "of 14 bits" in "".join(brightness_doubt([dark]))
    assert "could not be checked" in "".join(brightness_doubt([dark]))
    known = "".join(brightness_doubt([png(tmp_path / "known.png", RAMP * 50, 14)]))
    assert "state 14 bits" in known
    assert not [*brightness_doubt([dark, png(tmp_path / "bright.png", RAMP * 200)])]
    assert not [*brightness_doubt([png(tmp_path / "sixteen.png", RAMP * 50, 16)])]
