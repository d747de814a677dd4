"""Files are whole or absent."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from recon.runtime.files import STALE_S, alone_in, new_folder, read_json, remove_leftovers, whole_file


def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    (tmp_path / "a").mkdir()
    left, in_use, kept = tmp_path / "a/0001.ply", tmp_path / "0002.ply", tmp_path / "a/0003.ply"
    kept.touch()
    with whole_file(left) as temporary, whole_file(in_use) as used:
        temporary.touch()
        used.touch()
        left_by_another = temporary.with_name(temporary.name.replace(f"-{os.getpid()}-", f"-{ended.pid}-"))
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
    assert not folder.exists()


def test_a_folder_that_was_there_and_whatever_was_made_in_a_new_one_stay(tmp_path: Path) -> None:
    with alone_in(tmp_path):
        pass
    with alone_in(tmp_path / "run"):
        (tmp_path / "run/file").touch()
    assert (tmp_path / "run/file").exists()


def test_a_folder_is_free_when_the_process_in_it_was_killed(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from recon.runtime.files import alone_in\n"
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
