from __future__ import annotations

import struct
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from PIL import Image

from recon.runtime.picture_size import announced_size, check_announced

WAYS: dict[str, dict[str, Any]] = {
    "PNG": {},
    "BMP": {},
    "JPEG": {},
    "progressive": {"format": "JPEG", "progressive": True},
    "WEBP": {},
    "lossless": {"format": "WEBP", "lossless": True},
    "alpha": {"format": "WEBP", "exif": b"Exif\0\0"},
}


@pytest.mark.parametrize("way", WAYS)
def test_the_size_is_what_another_reader_says(way: str) -> None:
    file = BytesIO()
    pixels = np.random.default_rng(0).integers(0, 256, (31, 53, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(file, **({"format": way} | WAYS[way]))
    assert announced_size(file.getvalue()) == (53, 31)
    check_announced(file.getvalue())


def test_a_bmp_from_the_top_and_one_of_os2_have_their_size() -> None:
    assert announced_size(b"BM" + bytes(12) + struct.pack("<Iii", 40, 53, -31)) == (53, 31)
    assert announced_size(b"BM" + bytes(12) + struct.pack("<IHH", 12, 53, 31)) == (53, 31)


@pytest.mark.parametrize("start", [b"\x89PNG\r\n", b"BM", b"\xff\xd8\xff", b"RIFF\0\0\0\0WEBPVP8 ", b"", b"P5 1 1"])
def test_a_head_that_is_cut_off_is_left_to_the_decoder(start: bytes) -> None:
    check_announced(start)
