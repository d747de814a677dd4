"""Folders behind a URL are worked on through copies that are never stale."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fsspec.implementations.memory import MemoryFileSystem

from recon.runtime.artefacts import Artefacts
from recon.runtime.remote import address_of, fetched, is_there, missing, place, remove, stored

pytestmark = pytest.mark.usefixtures("store")


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[MemoryFileSystem]:
    """An empty file system, and an empty folder for copies of it."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    store = MemoryFileSystem()
    yield store
    store.store.clear()
    store.pseudo_dirs[:] = [""]


def written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.mark.parametrize("address", ["s3://bucket/run", "memory://lab/ball/run"])
def test_a_copy_tells_where_it_comes_from(address: str) -> None:
    assert address_of(place(address)) == address
    assert address_of(place(address) / "meshes/pm_fb/0000.ply") == f"{address}/meshes/pm_fb/0000.ply"


def test_paths_stay_paths(tmp_path: Path) -> None:
    assert place("runs/ball") == Path("runs/ball")
    assert place(f"file://{tmp_path}") == tmp_path
    assert address_of(tmp_path) == str(tmp_path)
    assert fetched(tmp_path / "absent") == stored(tmp_path / "absent") == tmp_path / "absent"


def test_a_file_is_fetched_again_only_when_it_changed(store: MemoryFileSystem) -> None:
    path = place("memory://lab/run") / "run.json"
    store.pipe("/lab/run/run.json", b"one")
    assert fetched(path).read_text() == "one"
    first = path.stat().st_mtime_ns
    assert fetched(path).stat().st_mtime_ns == first
    store.pipe("/lab/run/run.json", b"two")
    assert fetched(path).read_text() == "two"


def test_a_copy_that_was_written_to_and_never_stored_is_not_trusted(store: MemoryFileSystem) -> None:
    path = place("memory://lab/run") / "run.json"
    store.pipe("/lab/run/run.json", b"whole")
    written(fetched(path), "half")
    assert fetched(path).read_text() == "whole"


def test_what_is_stored_is_there_for_all_and_not_fetched_again(store: MemoryFileSystem) -> None:
    path = stored(written(place("memory://lab/run") / "a/b.txt", "b"))
    before = path.stat().st_mtime_ns
    assert store.cat("/lab/run/a/b.txt") == b"b"
    assert fetched(path).stat().st_mtime_ns == before
    assert is_there(path)
    remove(place("memory://lab/run"))
    assert not is_there(path)
    assert not store.exists("/lab/run")


def test_what_is_missing_is_named_with_its_address(store: MemoryFileSystem) -> None:
    folder = place("memory://lab/run")
    store.pipe("/lab/run/a/1.png", b"1")
    paths = [folder / name for name in ("a/1.png", "a/2.png", "b/1.png")]
    assert missing(paths) == paths[1:]
    with pytest.raises(ValueError, match=r"^memory://lab/run/a/2\.png: there is no such file"):
        fetched(paths[1])


def test_artefacts_are_resumed_where_the_copies_are_gone(store: MemoryFileSystem, tmp_path: Path) -> None:
    artefacts = Artefacts(place("memory://lab/run"))
    assert artefacts.make("b.txt", {"input": 1}, lambda path: written(path, "one") and None)
    remove(tmp_path)
    assert not artefacts.make("b.txt", {"input": 1}, lambda path: written(path, "two") and None)
    assert store.cat("/lab/run/b.txt") == b"one"
    assert artefacts.make("b.txt", {"input": 2}, lambda path: written(path, "two") and None)
    assert store.cat("/lab/run/b.txt") == b"two"


def test_a_making_that_failed_leaves_nothing_that_counts() -> None:
    artefacts = Artefacts(place("memory://lab/run"))
    artefacts.make("b.txt", {"input": 1}, lambda path: written(path, "one") and None)

    def fail(path: Path) -> None:
        written(path, "half")
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        artefacts.make("b.txt", {"input": 2}, fail)
    assert not artefacts.has("b.txt", {"input": 1})


def test_an_unknown_kind_of_address_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^xyz://a: Protocol not known"):
        place("xyz://a")


def test_a_store_that_fails_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_arguments: object) -> None:
        raise LookupError("no credentials")

    monkeypatch.setattr(MemoryFileSystem, "put_file", fail)
    with pytest.raises(OSError, match=r"^memory://lab/b\.txt: no credentials; look at the address"):
        stored(written(place("memory://lab") / "b.txt", "b"))


def test_a_folder_of_copies_that_others_could_write_is_refused_also_where_a_worker_finds_it(
    store: MemoryFileSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.pipe("/lab/run/run.json", b"one")
    path = place("memory://lab/run") / "run.json"
    monkeypatch.setattr("os.getuid", lambda: 4711)
    with pytest.raises(ValueError, match="is not ours"):
        place("memory://lab")
    with pytest.raises(ValueError, match="is not ours"):
        fetched(path)
