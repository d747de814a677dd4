"""Files of the server are whole or absent, whoever writes them."""

from __future__ import annotations

import errno
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from app.files import whole_file


def test_two_threads_that_write_one_file_leave_a_whole_one(tmp_path: Path) -> None:
    path, together = tmp_path / "film.mp4", Barrier(2)

    def write(letter: bytes) -> None:
        with whole_file(path) as temporary, temporary.open("wb") as file:
            together.wait(10)
            for _ in range(100):
                file.write(letter * 1000)
                file.flush()
            together.wait(10)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(write, (b"a", b"b")))
    assert path.read_bytes() in (b"a" * 100_000, b"b" * 100_000)
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_is_told_with_the_file_that_did_not_fit(tmp_path: Path) -> None:
    """An error of writing names no file by itself."""
    with pytest.raises(OSError, match=r"film\.mp4"), whole_file(tmp_path / "film.mp4"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    assert list(tmp_path.iterdir()) == []
