"""Pad films to a size: the number of bytes, which every browser shows, then tells nothing about what they show.

The padding is an MP4 box `free` at the end, which players skip (ISO/IEC 14496-12, section 8.1.2). A film is kept under
the key of its content and its padded size, `KEY-SIZE.mp4`; `KEY.mp4` is there only until it is padded.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from app.files import whole_file

FREE = b"free"
HEADER = 8  # bytes of a box's header: its size and its name
MADE_AT = 946684800  # seconds since 1970, each film's time: real times would tell the order of conditions


def padded(film: Path, size: int) -> Path:
    """Return a film's copy of this size in bytes, which is made unless it is there.

    Parameters
    ----------
    film : unpadded
    size : at least that of the film and of an empty box
    """
    copy = film.with_name(f"{film.stem}-{size}{film.suffix}")
    if not copy.is_file():
        with whole_file(copy) as temporary:
            shutil.copyfile(film, temporary)
            n_bytes = temporary.stat().st_size
            with temporary.open("r+b") as file:
                file.seek(n_bytes)
                file.write((size - n_bytes).to_bytes(4) + FREE)
                file.truncate(size)
            os.utime(temporary, (MADE_AT, MADE_AT))
    return copy


def restore(film: Path) -> bool:
    """Make an unpadded film again from a padded copy; return whether there was one."""
    copy = next(film.parent.glob(f"{film.stem}-*{film.suffix}"), None)
    if copy is not None:
        with whole_file(film) as temporary:
            shutil.copyfile(copy, temporary)
            os.truncate(temporary, _size_unpadded(copy))
    return copy is not None


def _size_unpadded(film: Path) -> int:
    """Return how many bytes a film has without its padding: without its last box, if that is a `free` one."""
    start, end, name = 0, film.stat().st_size, b""
    with film.open("rb") as file:
        at = 0
        while at < end:
            file.seek(at)
            header = file.read(2 * HEADER)
            size, name = int.from_bytes(header[:4]), header[4:8]
            start = at
            at += max(HEADER, int.from_bytes(header[8:]) if size == 1 else size or end - at)
    return start if name == FREE else end
