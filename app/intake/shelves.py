"""List and find what lies in the server's intake folder: recordings, videos, tables and what jobs made of them.

It has a folder for each kind. Somebody may also put entries there by hand, with scp or on a network drive.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from app.errors import ForbiddenError, InvalidError
from app.files import is_reserved
from app.intake.summaries import CLOUDS, SUMMARIES, TABLES, is_readable, walk

KINDS: tuple[str, ...] = tuple(SUMMARIES)
PLAIN_NAME = re.compile(r"[^\W_](?:[\w .+-]{0,98}[\w+-])?")  # letters and digits of any script
LONGEST_PART = 255  # bytes of a file's or folder's name, by the file system
LONGEST_NAME = 200  # bytes; leaves room for what is added to it
SUFFIXES: Mapping[str, tuple[str, ...]] = {  # of entries that are files
    "clouds": CLOUDS,
    "measures": (".csv",),
    "votes": TABLES,
}
UNREADABLE = "cannot be read: give the server's user access to it"
HIDDEN = ".uploads"  # folder of the intake folder for what is on its way in or out
FOLDERS = frozenset({"captures", "calibration", "models", "films", "clouds", "runs"})  # kinds whose entries are folders


@dataclass(frozen=True)
class ShelfEntry:
    """A folder or file in the intake folder.

    Parameters
    ----------
    kind, name : where it lies, `KIND/NAME`
    size : bytes, of all files in it
    changed_at : the newest change of a file in it
    summary : what it holds, or what is wrong with it, in one line
    """

    kind: str
    name: str
    size: int
    changed_at: datetime
    summary: str


def shelf(folder: Path, kind: str) -> Path:
    """Return the folder of a kind; it may be missing.

    Raises
    ------
    InvalidError
        If there is no such kind.
    """
    if kind not in KINDS:
        raise InvalidError(f"There is no kind of files {kind[:40]!r}; expected one of {', '.join(KINDS)}.")
    return folder / kind


def entries(folder: Path, kind: str) -> list[ShelfEntry]:
    """Return what lies on the shelf of a kind, the newest first; names that are not plain are left out.

    Raises
    ------
    ForbiddenError
        If the server's user may not read the shelf.
    """
    place = _open_shelf(folder, kind)
    paths = sorted(place.iterdir()) if place.is_dir() else []
    listed = []
    for path in paths:
        with suppress(FileNotFoundError):  # somebody has just deleted it
            if _is_entry(kind, path):
                listed.append(_entry(kind, path))
    return sorted(listed, key=lambda entry: entry.changed_at, reverse=True)


def entry_path(folder: Path, kind: str, name: str) -> Path:
    """Return the path of an entry.

    Raises
    ------
    InvalidError
        If the name is not plain, or nothing of this name lies there.
    ForbiddenError
        If the server's user may not read it.
    """
    path = _open_shelf(folder, kind) / checked_name(kind, name)
    if not _is_entry(kind, path):
        raise InvalidError(f"There is nothing called {name!r} in {kind}; it may have been deleted.")
    _check_readable(path, f"{name!r} in {kind}")
    return path


def free_path(folder: Path, kind: str, name: str) -> Path:
    """Return the path of a new entry, whose name is not taken.

    Raises
    ------
    InvalidError
        If the name is not plain, or taken.
    ForbiddenError
        If the server's user may not read the shelf.
    """
    path = _open_shelf(folder, kind) / checked_name(kind, name)
    if path.exists() or path.is_symlink():
        raise InvalidError(f"There is {name!r} in {kind} already; choose another name, or delete that one first.")
    return path


def remove_entry(folder: Path, kind: str, name: str) -> None:
    """Remove an entry, which disappears at once as a whole.

    Raises
    ------
    InvalidError
        If there is none, or the server's user may not remove all of it; what is left then lies where it was.
    """
    path = entry_path(folder, kind, name)
    removed = folder / HIDDEN / f"{secrets.token_hex(16)}.work"
    removed.parent.mkdir(exist_ok=True)
    try:
        path.rename(removed)
        shutil.rmtree(removed) if removed.is_dir() else removed.unlink()
    except PermissionError as error:
        if removed.exists():
            removed.rename(path)
        raise InvalidError(
            f"{name!r} in {kind}, or a folder in it, belongs to another user of the server, who has to delete it there."
        ) from error


def file_in(folder: Path, kind: str, name: str, place: str) -> Path:
    """Return a file of an entry.

    Parameters
    ----------
    folder : the intake folder
    kind, name : of the entry
    place : where the file lies in the entry; the entry's name where it is a file itself

    Raises
    ------
    InvalidError
        If there is no such entry or file, or the place leads out of the entry.
    ForbiddenError
        If the server's user may not read it, or a folder on the way to it.
    """
    entry = entry_path(folder, kind, name)
    if entry.is_file() and place == name:
        return entry
    path = entry
    for part in place.split("/"):
        path = path / part
        if not part or part.startswith(".") or "\0" in part or len(part.encode()) > LONGEST_PART:
            break
        if path.is_symlink() or not path.exists():
            break
        _check_readable(path, f"{place[:200]!r} in {name!r}")
    else:
        if path.is_file():
            return path
    raise InvalidError(f"There is no file {place[:200]!r} in {name!r}; it may have been deleted.")


def is_plain(name: str) -> bool:
    """Return whether a name is letters, digits, spaces and . _ + - and begins with a letter or digit."""
    return PLAIN_NAME.fullmatch(name) is not None and len(name.encode()) <= LONGEST_NAME and not is_reserved(name)


def checked_name(kind: str, name: str) -> str:
    """Return the name of an entry, once it is known to be plain and to end as its kind does.

    Raises
    ------
    InvalidError
        If it is another.
    """
    if not is_plain(name):
        raise InvalidError(
            f"The name {name[:100]!r} cannot be used: expected 1 to 100 letters, digits, spaces or . _ + - (at most "
            f"{LONGEST_NAME} bytes as UTF-8), with a letter or digit first, and none that Windows keeps for devices, "
            "such as CON or NUL."
        )
    if kind not in FOLDERS and not name.lower().endswith(SUFFIXES[kind]):
        raise InvalidError(f"The name {name!r} has to end in {' or '.join(SUFFIXES[kind])}.")
    return name


def _open_shelf(folder: Path, kind: str) -> Path:
    """Return the folder of a kind, once it is known that the server's user may read it if it is there."""
    place = shelf(folder, kind)
    if place.exists():
        _check_readable(place, f"The server's folder {kind}")
    return place


def _check_readable(path: Path, called: str) -> None:
    if not is_readable(path):
        raise ForbiddenError(f"{called} {UNREADABLE}.")


def _is_entry(kind: str, path: Path) -> bool:
    if path.is_symlink() or not is_plain(path.name):
        return False
    if path.is_dir():
        return kind in FOLDERS
    return path.is_file() and path.name.lower().endswith(SUFFIXES.get(kind, ()))


def _entry(kind: str, path: Path) -> ShelfEntry:
    facts: list[os.stat_result] = []
    for file in walk(path) if path.is_dir() else [path]:
        with suppress(FileNotFoundError, PermissionError):  # a job has just removed it, or its folder is closed
            facts.append(file.stat())
    changed_s = max((fact.st_mtime for fact in facts), default=path.stat().st_mtime)
    size = sum(fact.st_size for fact in facts)
    summary = SUMMARIES[kind](path) if is_readable(path) else UNREADABLE
    return ShelfEntry(kind, path.name, size, datetime.fromtimestamp(changed_s, UTC), summary)
