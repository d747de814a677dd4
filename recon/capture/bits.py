"""How many of their 16 bits the pictures of a recording fill: many programs write a camera's 10, 12 or 14 lowest."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from recon.capture.images import PICTURE_SUFFIXES, PNG_START, read_deep_image
from recon.runtime.pnm import is_pnm
from recon.runtime.tiff import stated_bits

CAMERA_BITS = (8, 10, 12, 14)  # that programs write into the lower bits of 16
ALL_BITS = 16
HEAD_BYTES = 32
TIFF_SUFFIXES = (".tif", ".tiff")


def used_bits(pictures: Iterable[Path]) -> int:
    """Return how many bits the values of pictures fill, all of them together: 16, or fewer of those with 16 bits.

    What their files state counts (sBIT of a PNG, BitsPerSample or MaxSampleValue of a TIFF), unless values show that
    the upper bits are meant, as PNG's standard says; else the fewest bits of a camera that hold all values.
    """
    return _bits(pictures)[0]


def brightness_doubt(pictures: Iterable[Path]) -> Iterator[str]:
    """Say in a sentence that a capture's pictures are read too dark, or may be, as the upper bits of 16 are taken."""
    bits, is_stated = _bits(pictures)
    if bits == ALL_BITS:
        return
    times = 2 ** (ALL_BITS - bits)
    way = f"write them over all 16, {times} times as bright, as `capture import` does"
    if is_stated:
        yield f"the pictures have 16 bits and state {bits} bits, of which the upper 8 of 16 show little; {way}"
    else:
        yield (
            f"the pictures have 16 bits and no value above {2**bits - 1}: whether they are dark, or a camera's of "
            f"{bits} bits and read too dark, could not be checked; if the latter, {way}"
        )


def _bits(pictures: Iterable[Path]) -> tuple[int, bool]:
    """Return how many bits are used, and whether the files state it."""
    filled = stated = 0
    for path in filter(is_deep, pictures):
        filled |= int(np.bitwise_or.reduce(read_deep_image(path), axis=None))
        stated = max(stated, _stated(path))
    if not stated:
        return next((bits for bits in CAMERA_BITS if 0 < filled < 2**bits), ALL_BITS), False
    are_lower = filled < 2**stated and filled % 2 ** (ALL_BITS - stated) > 0
    return stated if are_lower else ALL_BITS, True


def is_deep(path: Path) -> bool:
    """Tell whether a picture has 16 bits whose use it may not tell itself, as PGM and PPM do."""
    suffix = path.suffix.lower()
    if suffix not in PICTURE_SUFFIXES or suffix in (".jpg", ".jpeg", ".bmp", ".exr") or not path.is_file():
        return False
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if head.startswith(PNG_START):
        return head[24:25] == b"\x10"  # of the chunk IHDR
    return not is_pnm(head) and read_deep_image(path).dtype == np.uint16


def _stated(path: Path) -> int:
    """Return how many bits a file says that its values have; 0 if it does not."""
    content = path.read_bytes()
    bits = _stated_by_png(content) if content.startswith(PNG_START) else stated_bits(content)
    return bits if CAMERA_BITS[0] <= bits <= ALL_BITS else 0


def _stated_by_png(content: bytes) -> int:
    """Return the largest number of significant bits of grey, or of red, green and blue."""
    start = content.find(b"sBIT", 0, content.find(b"IDAT")) + len(b"sBIT")
    has_colours = content[25] & 2  # of the chunk IHDR
    return max(content[start : start + (3 if has_colours else 1)]) if start >= len(b"sBIT") else 0
