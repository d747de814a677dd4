"""Files are whole or absent, whoever writes them."""

from __future__ import annotations

import errno
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from ground.files import read_json, whole_file, write_json


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


def test_a_file_appears_only_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    with whole_file(path) as temporary:
        temporary.write_text("content")
        assert temporary.suffix == path.suffix
        assert not path.exists()
    assert path.read_text() == "content"
    assert list(path.parent.iterdir()) == [path]


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail() -> None:
        with whole_file(path) as temporary:
            temporary.write_text("half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        fail()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_json_comes_back_as_it_was(tmp_path: Path) -> None:
    content = {"a": [1, 2.5, None], "b": {"c": "é"}}
    write_json(tmp_path / "a.json", content)
    assert read_json(tmp_path / "a.json") == content


def test_json_may_begin_with_the_mark_that_windows_writes(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{"b": "é"}', encoding="utf-8-sig")
    assert read_json(tmp_path / "a.json") == {"b": "é"}


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (None, "no such file"),
        ("{", "not readable"),
        ("[1]", "JSON object"),
        ("[" * 100_000, "holds too many lists within one another"),
        (f'{{"n": {"9" * 5000}}}', "not readable"),
    ],
)
def test_json_that_cannot_be_used_is_named(tmp_path: Path, text: str | None, problem: str) -> None:
    path = tmp_path / "a.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ValueError, match=problem) as raised:
        read_json(path)
    assert str(path) in str(raised.value)
