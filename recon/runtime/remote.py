"""Folders behind an fsspec URL, such as ``s3://bucket/run``: each machine works on copies of their files.

The copy of ``s3://bucket/run/run.json`` is ``TMP/reconstudy-copies-UID/s3:/bucket/run/run.json``, so a path alone says
where a file comes from, in every process of every machine. All other code works with paths: it calls `fetched` before
it reads a file, and `stored` after it wrote one. Copies may be removed whenever nothing runs.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path, PurePath
from typing import Any

from recon.runtime.files import naming, whole_file, write_bytes

COPIES = "reconstudy-copies-"
LOCAL = ("file", "local")


def place(address: str) -> Path:
    """Find the path that a path or an fsspec URL names; for a URL, that of its copy on this machine.

    A ValueError says that there is no file system for the URL, or that the folder of copies belongs to another user.
    """
    scheme, mark, rest = address.partition("://")
    if not mark:
        return Path(address)
    if scheme in LOCAL:
        return Path(rest)
    _files(address)
    return _copies() / f"{scheme}:" / rest


def address_of(path: Path) -> str:
    """Return the URL of a copy; other paths as they are."""
    return _url(path) or str(path)


def with_addresses(sentence: str) -> str:
    """Return a sentence with URLs in place of the paths of their copies, which nobody has ever named."""
    folder = _place_of_copies()
    names = "|".join(re.escape(str(path)) for path in (folder, folder.resolve()))
    return re.sub(rf"(?:{names})/([\w+.-]+:)/", r"\1//", sentence)


def fetched(path: Path) -> Path:
    """Bring a copy up to date, and return its path; other paths as they are.

    A ValueError says that there is no file behind the URL, or that the folder of copies belongs to another user, an
    OSError that the file system there fails.
    """
    url = _url(path)
    if url is None:
        return path
    _copies()  # a worker on another machine has named no URL, but made paths of it
    with _naming(url):
        files, name = _files(url)
        version = files.ukey(name)
        if not _is_copy_of(path, version):
            with whole_file(path) as temporary:
                files.get_file(name, str(temporary))
            _note_copy(path, version)
    return path


def stored(path: Path) -> Path:
    """Upload a copy that was written to, and return its path; other paths as they are. An OSError as in `fetched`."""
    url = _url(path)
    if url is not None:
        with _naming(url):
            files, name = _files(url)
            files.makedirs(files._parent(name), exist_ok=True)
            files.put_file(str(path), name)
            _note_copy(path, files.ukey(name))
    return path


def is_copy(path: Path) -> bool:
    """Return whether a path is the copy of a file or folder behind a URL."""
    return _url(path) is not None


def is_there(path: Path) -> bool:
    """Return whether a file exists; for a copy, behind its URL."""
    url = _url(path)
    if url is None:
        return path.is_file()
    with _naming(url):
        files, name = _files(url)
        return bool(files.isfile(name))


def missing(paths: Iterable[Path]) -> list[Path]:
    """List the files that do not exist; behind a URL each folder is listed once."""
    listed = cache(_listed)
    return [path for path in paths if not (path.name in listed(path.parent) if is_copy(path) else path.is_file())]


def remove(path: Path) -> None:
    """Remove a file or a folder, if it exists; for a copy, behind its URL too."""
    url = _url(path)
    if url is not None:
        with _naming(url):
            files, name = _files(url)
            if files.exists(name):
                files.rm(name, recursive=True)
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _url(path: Path) -> str | None:
    parts = path.parts
    for number, part in enumerate(parts[:-1]):
        if part.startswith(COPIES):
            return f"{parts[number + 1]}//{PurePath(*parts[number + 2 :]).as_posix()}"
    return None


def _place_of_copies() -> Path:
    return Path(tempfile.gettempdir()) / f"{COPIES}{os.getuid()}"


def _copies() -> Path:
    folder = _place_of_copies()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if folder.is_symlink() or folder.stat().st_uid != os.getuid():
        raise ValueError(f"{folder}: is not ours; remove it, or set TMPDIR to a folder that nobody else writes to")
    return folder


def _files(url: str) -> tuple[Any, str]:
    """Return the file system of a URL, and the name in it."""
    import fsspec  # late: most runs have no URL

    with naming(url):
        files, name = fsspec.core.url_to_fs(url, use_listings_cache=False)
    return files, name


def _listed(folder: Path) -> set[str]:
    url = address_of(folder)
    with _naming(url):
        files, name = _files(url)
        try:
            entries = files.ls(name, detail=True)
        except FileNotFoundError:
            return set()
        return {PurePath(entry["name"]).name for entry in entries if entry["type"] == "file"}


@contextmanager
def _naming(url: str) -> Iterator[None]:
    """Name the address in errors; the packages of file systems raise many kinds."""
    try:
        yield
    except FileNotFoundError as error:
        raise ValueError(f"{url}: there is no such file") from error
    except (ValueError, ImportError):  # the latter: a package for this kind of address is missing
        raise
    except Exception as error:
        raise OSError(f"{url}: {error}; look at the address, the keys, and whether the store answers") from error


def _is_copy_of(path: Path, version: str) -> bool:
    note = _note_of(path)
    return path.is_file() and note.is_file() and note.read_text(encoding="utf-8") == _state(path, version)


def _note_copy(path: Path, version: str) -> None:
    write_bytes(_note_of(path), _state(path, version).encode())


def _note_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.copied")


def _state(path: Path, version: str) -> str:
    """Describe which version was copied, and the copy as it was left: a later write to it shows."""
    facts = path.stat()
    return f"{version} {facts.st_mtime_ns} {facts.st_size}"
