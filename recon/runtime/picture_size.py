"""Limit what a picture may announce: a file of few bytes can promise more pixels than there is memory for."""

from __future__ import annotations

import struct
from collections.abc import Iterator

MOST_PIXELS = 2**28  # 16384x16384, the largest texture; jobs of the server hold OpenCV to half
NOT_FRAMES = (0xC4, 0xC8, 0xCC)  # among the JPEG markers C0 to CF, which otherwise begin with the picture's size
JPEG_SCAN = 0xDA


def check_size(width: int, height: int, what: str = "") -> None:
    """Raise a ValueError if a picture has more pixels than are read.

    Parameters
    ----------
    width, height : pixels
    what : begins the message
    """
    if width * height > MOST_PIXELS:
        raise ValueError(f"{what}announces {width}x{height} pixels, expected at most {MOST_PIXELS / 1e6:.0f} million")


def check_announced(content: bytes, what: str = "") -> None:
    """Raise a ValueError if a PNG, JPEG, BMP or WebP says that it has more pixels than are read, as `check_size`."""
    try:
        width, height = announced_size(content)
    except (struct.error, IndexError):  # cut off, which its decoder says better
        return
    check_size(width, height, what)


def announced_size(content: bytes) -> tuple[int, int]:
    """Return the width and height that the head of a PNG, JPEG, BMP or WebP says; (0, 0) for others."""
    if content.startswith(b"\x89PNG"):
        width, height = struct.unpack_from(">II", content, 16)
    elif content.startswith(b"BM"):
        width, height = struct.unpack_from("<HH" if content[14] == 12 else "<ii", content, 18)  # 12: of OS/2
    elif content.startswith(b"\xff\xd8"):
        height, width = next(_jpeg_frames(content), (0, 0))
    elif content[:4] == b"RIFF" and content[8:12] == b"WEBP":
        width, height = _webp_size(content)
    else:
        return 0, 0
    return abs(width), abs(height)  # rows of a BMP from the top have a negative height


def _jpeg_frames(content: bytes) -> Iterator[tuple[int, int]]:
    """Yield the height and width of each frame of a JPEG before its first scan."""
    place = 2
    while content[place] == 0xFF and content[place + 1] != JPEG_SCAN:
        marker = content[place + 1]
        if 0xC0 <= marker <= 0xCF and marker not in NOT_FRAMES:
            yield struct.unpack_from(">HH", content, place + 5)
        is_fill = marker == 0xFF
        place += 1 if is_fill else 2 + struct.unpack_from(">H", content, place + 2)[0]


def _webp_size(content: bytes) -> tuple[int, int]:
    """Return the width and height of a WebP by its first part (RFC 9649)."""
    kind = content[12:16]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        bits = struct.unpack_from("<I", content, 21)[0]
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    return 1 + int.from_bytes(content[24:27], "little"), 1 + int.from_bytes(content[27:30], "little")
