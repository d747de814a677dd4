"""Files are whole or absent."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from recon.storage.files import STALE_S, alone_in, new_folder, read_json, remove_leftovers, whole_file, write_json


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


def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    (tmp_path / "a").mkdir()
    left, in_use, kept = tmp_path / "a/0001.ply", tmp_path / "0002.ply", tmp_path / "a/0003.ply"
    kept.touch()
    with whole_file(left) as temporary, whole_file(in_use) as used:
        temporary.touch()
        used.touch()
        left_by_another = temporary.with_name(temporary.name.replace(str(os.getpid()), str(ended.pid)))
        temporary.rename(left_by_another)
        remove_leftovers(tmp_path)
        assert [path.exists() for path in (left_by_another, used, kept)] == [False, True, True]
        temporary.touch()


def test_what_another_host_writes_is_left_alone_until_nobody_writes_it(tmp_path: Path) -> None:
    path = tmp_path / ".0001.elsewhere-1.part.ply"
    path.touch()
    remove_leftovers(tmp_path)
    assert path.exists()
    long_ago = time.time() - 2 * STALE_S
    os.utime(path, (long_ago, long_ago))
    remove_leftovers(tmp_path)
    assert not path.exists()


def test_two_are_never_in_a_folder_at_once(tmp_path: Path) -> None:
    folder = tmp_path / "a/run"

    def enter() -> None:
        with alone_in(folder):
            pass

    with alone_in(folder), pytest.raises(ValueError, match=r"run: another start is writing into it; wait until"):
        enter()
    enter()
    assert not list(folder.iterdir())


def test_a_folder_is_free_when_the_process_in_it_was_killed(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from recon.storage.files import alone_in\n"
        "with alone_in(Path(sys.argv[1])): print('in', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        other.stdout.readline()
        with pytest.raises(ValueError, match="another start is writing"), alone_in(tmp_path):
            pass
        other.kill()
        other.wait()
        with alone_in(tmp_path):
            pass


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
        ("[" * 100_000, "not readable"),
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


def test_json_that_the_system_does_not_give_is_named_without_its_number(tmp_path: Path) -> None:
    (tmp_path / "a.json").mkdir()
    with pytest.raises(ValueError, match=r"a\.json: cannot be read: is a directory$"):
        read_json(tmp_path / "a.json")


def test_a_new_folder_removes_what_a_killed_process_began_of_it(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    with new_folder(tmp_path / "a") as folder:
        left = folder.with_name(folder.name.replace(str(os.getpid()), str(ended.pid)))
        (left / "S1").mkdir(parents=True)
    (tmp_path / "a").rmdir()
    with new_folder(tmp_path / "b"):
        assert left.exists()
    with new_folder(tmp_path / "a") as folder:
        assert not left.exists()
        assert folder.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


@pytest.mark.parametrize("is_there", [True, False])
def test_a_new_folder_is_made_where_a_link_leads(tmp_path: Path, is_there: bool) -> None:
    if is_there:
        (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to("disk")
    with new_folder(tmp_path / "link") as folder:
        (folder / "a.txt").write_text("content")
    assert (tmp_path / "disk/a.txt").read_text() == "content"
    assert (tmp_path / "link").is_symlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "link"]


def test_the_current_folder_is_no_new_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    def make() -> None:
        with new_folder(Path()):
            pass

    with pytest.raises(ValueError, match="is the current folder"):
        make()
    (tmp_path / "a.txt").write_text("mine")
    with pytest.raises(ValueError, match="is the current folder"):
        make()
