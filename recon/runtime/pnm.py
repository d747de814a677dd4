"""PGM and PPM pictures, whose head says what their largest value is: OpenCV goes by it for some kinds only.

It also refuses those of digits that do not end in a newline.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.runtime.picture_size import check_size

NEXT = rb"(?:\s|#[^\r\n]*[\r\n])+(\d{1,9})"
HEAD = re.compile(rb"P([2356])" + 3 * NEXT + rb"\s")
COMMENT = re.compile(rb"#[^\r\n]*")
DEEPEST = 65535


def is_pnm(content: bytes) -> bool:
    """Tell whether a file begins as PGM or PPM; bitmaps (PBM) are none."""
    return content[:2] in (b"P2", b"P3", b"P5", b"P6")


def read_pnm(content: bytes) -> NDArray[Any]:
    """Decode a PGM or PPM as RGB (H, W, 3), uint8 or uint16, whose largest value is white.

    A ValueError says what is wrong with it.
    """
    head = HEAD.match(content)
    if head is None:
        raise ValueError("begins as PGM or PPM, but does not say its width, height and largest value")
    kind, width, height, largest = map(int, head.groups())
    if not (width and height and 0 < largest <= DEEPEST):
        raise ValueError(f"is a picture of {width}x{height} pixels up to {largest}, expected 1x1 and 1 to {DEEPEST}")
    check_size(width, height)
    n_channels = 3 if kind in (3, 6) else 1
    dtype, full = (np.dtype(np.uint8), 255) if largest < 256 else (np.dtype(np.uint16), DEEPEST)
    values = (_digits if kind in (2, 3) else _bytes)(content[head.end() :], width * height * n_channels, dtype)
    picture = np.broadcast_to(values.reshape(height, width, n_channels), (height, width, 3))
    if largest == full:
        return np.ascontiguousarray(picture)
    return np.asarray(np.rint(np.minimum(picture, largest) * (full / largest)), dtype)


def _digits(body: bytes, n_values: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    words = COMMENT.sub(b"", body).split(None, n_values)[:n_values]
    _check_whole(len(words), n_values, "values")
    if not all(map(bytes.isdigit, words)):
        raise ValueError("holds values that are no whole numbers")
    return np.asarray(np.minimum(np.array(words, np.float64), 256**dtype.itemsize - 1), dtype)


def _bytes(body: bytes, n_values: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    _check_whole(len(body), n_values * dtype.itemsize, "bytes")
    return np.frombuffer(body, dtype.newbyteorder(">"), n_values).astype(dtype)


def _check_whole(n_there: int, n_announced: int, what: str) -> None:
    if n_there < n_announced:
        raise ValueError(f"is cut off: {n_there} of {n_announced} {what} are there")
