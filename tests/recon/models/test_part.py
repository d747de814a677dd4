"""Textures of models are decoded whole, or named."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from recon.models.part import decode_picture


def test_a_texture_of_more_pixels_than_can_be_read_is_named() -> None:
    content = cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes()
    header = b"IHDR" + struct.pack(">II", 60000, 60000) + content[24:29]
    content = content[:12] + header + struct.pack(">I", zlib.crc32(header)) + content[33:]
    with pytest.raises(ValueError, match=r"its texture skin is not readable as a picture: pixels <= "):
        decode_picture(content, "skin")


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_what_a_program_appends_to_a_texture_does_no_harm(suffix: str) -> None:
    content = cv2.imencode(suffix, np.full((16, 16, 3), 90, np.uint8))[1].tobytes()
    assert (decode_picture(content + b"notes" * 50, "skin") == 90).all()
    with pytest.raises(ValueError, match="its texture skin is cut off after"):
        decode_picture(content[:-8], "skin")
