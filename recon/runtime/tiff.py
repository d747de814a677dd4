"""TIFF pictures: Pillow reads those of 8 bits, OpenCV those of 16, and what neither reads right is refused.

OpenCV multiplies colours of 8 bits by their transparency, mixes up 16 bits whose channels lie apart, and inverts 16
bits where 0 is white. Both turn a picture that says how its camera was held, and take the first of several.
"""

from __future__ import annotations

import struct
from io import BytesIO
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageSequence
from PIL.TiffImagePlugin import TiffImageFile

from recon.runtime.picture_size import MOST_PIXELS

GREY_OR_RGB = (1, 2)  # colours of 16 bits that OpenCV reads right, by TIFF's number
BITS, COLOURS, ORIENTATION, LARGEST, PLANES, FORMAT = 258, 262, 274, 281, 284, 339  # tags
FULL_BITS = 16
UNREADABLE = (
    *(OSError, SyntaxError, ValueError, TypeError, LookupError, OverflowError, EOFError, MemoryError, struct.error),
    Image.DecompressionBombError,
    cv2.error,
)  # what both let through of a damaged file


def read_tiff(content: bytes) -> NDArray[Any]:
    """Decode a TIFF as RGB (H, W, 3), uint8 or uint16, without transparency.

    A ValueError says what it holds that is not read.
    """
    try:
        with TiffImageFile(BytesIO(content)) as picture:  # `Image.open` has a limit of its own, which warns
            bits = max(picture.tag_v2.get(BITS, (1,)))
            unread = _unread(picture, bits)
            pixels = None if unread else _sixteen(content) if bits > 8 else np.asarray(picture.convert("RGB"))
    except UNREADABLE as error:
        raise ValueError("is a TIFF that is damaged, or of a kind that is not known") from error
    if pixels is None:
        raise ValueError(f"is a TIFF {unread or 'that is damaged'}, which is not read")
    return pixels


def stated_bits(content: bytes) -> int:
    """Return how many bits the values of a TIFF have, as its BitsPerSample or MaxSampleValue says; 0 if neither."""
    with TiffImageFile(BytesIO(content)) as picture:
        bits = max(picture.tag_v2.get(BITS, (1,)))
        largest = np.max(picture.tag_v2.get(LARGEST, 0))
    return bits if bits != FULL_BITS else int(largest).bit_length()


def _unread(picture: TiffImageFile, bits: int) -> str:
    """Return what a picture has that neither library reads as it is meant, or nothing."""
    tags, (width, height) = picture.tag_v2, picture.size
    if width * height > MOST_PIXELS:
        return f"of {width}x{height} pixels"
    if bits > 16 or set(tags.get(FORMAT, (1,))) != {1}:
        return f"of {bits} bits a channel, floating or signed"
    if tags.get(ORIENTATION, 1) != 1:
        return f"that is stored turned or mirrored (orientation {tags[ORIENTATION]})"
    if bits > 8 and (tags.get(COLOURS) not in GREY_OR_RGB or tags.get(PLANES, 1) != 1):
        return f"of {bits} bits whose channels lie apart, or are no RGB or grey"
    first = picture.size
    n_alike = sum(page.size == first for page in ImageSequence.Iterator(picture))
    picture.seek(0)
    return f"of {n_alike} pictures" if n_alike > 1 else ""


def _sixteen(content: bytes) -> NDArray[Any] | None:
    """Return RGB by OpenCV, whose own RGB of 16 bits is noise in its version 5.0."""
    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    return None if pixels is None else np.ascontiguousarray(pixels[..., ::-1])
