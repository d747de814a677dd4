"""Write files and folders whole or not at all: under a temporary name, renamed at the end."""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import ground.files
from ground.files import file_digest as file_digest
from ground.files import whole_file as whole_file
from ground.files import write_bytes as write_bytes
from ground.files import write_json as write_json
from ground.files import write_text as write_text

if TYPE_CHECKING:
    from jinja2 import Environment

PRIVATE = 0o600  # mode of files that only their owner reads and writes
PRIVATE_FOLDER = 0o700
LARGEST_JSON = 16 * 1024 * 1024  # bytes; read into memory they take up to twenty times as much
LONGEST_FILE_NAME = 200  # bytes; file systems take 255, and temporary names are longer
LOCK = ".lock"  # in folders of work, held by the process that works there
UNSAFE = frozenset('/\\:*?"<>|')  # in names of files, on one system or another
# Names of devices of Windows, whatever their ending.
RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9\u00b9\u00b2\u00b3]|lpt[0-9\u00b9\u00b2\u00b3])(\..*)?", re.IGNORECASE)
FORMULA = tuple("=+-@\t\r\n＝＋－＠")  # first characters of a spreadsheet's formula; the last in Asian editions


def packaged(name: str) -> Path:
    """Find a file or folder of the program: inside the package, where a wheel has it, or beside it in a checkout.

    `docs`, `languages`, `migrations`, `static` and `templates` are the folders that a wheel has inside; setup.py puts
    them there.
    """
    package = Path(str(files("app")))
    inside = package / name
    return inside if inside.exists() else package.parent / name


def page_templates(*folders: str, **options: Any) -> Environment:
    """Return the templates of packaged folders: they escape HTML, and what they name and nobody gave is an error.

    Parameters
    ----------
    folders : where templates are looked for, in this order
    options : of the environment, where they differ
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # commands that write no page start without it

    usual: dict[str, Any] = {"autoescape": True, "trim_blocks": True, "lstrip_blocks": True}
    loader = FileSystemLoader([packaged(folder) for folder in folders])
    return Environment(loader=loader, undefined=StrictUndefined, **usual | options)


def is_plain_name(name: str) -> bool:
    """Whether a name from outside may become that of a file: letters of any script, nothing that paths are made of."""
    return (
        0 < len(name.encode()) <= LONGEST_FILE_NAME
        and name == name.strip()
        and not name.startswith(".")
        and not name.endswith(".")
        and not is_reserved(name)
        and all(character.isprintable() and character not in UNSAFE for character in name)
    )


def is_reserved(name: str) -> bool:
    """Whether Windows takes a name for one of its devices, with any ending: such a file cannot be copied there."""
    return RESERVED.fullmatch(name) is not None


def free_gb(folder: Path) -> float:
    """Return what is free on the disk of a folder that may still have to be made, GB."""
    nearest = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.is_dir())
    return shutil.disk_usage(nearest).free / 1e9


def private_folder(path: Path) -> None:
    """Make a folder that only its owner may enter, or make one that is there private."""
    path.mkdir(PRIVATE_FOLDER, parents=True, exist_ok=True)
    path.chmod(PRIVATE_FOLDER)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder that becomes `path`, which is missing or empty, if the block ends without an error."""
    path = path.resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.part")
    temporary.mkdir()
    try:
        yield temporary
        temporary.rename(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


class WorkFolder(TemporaryDirectory[str]):
    """A temporary folder, locked while this process uses it: what a killed process left is told by its lock.

    Parameters
    ----------
    prefix : begins its name
    parent : where it is made
    """

    def __init__(self, prefix: str, parent: Path) -> None:
        parent.mkdir(parents=True, exist_ok=True)
        super().__init__(prefix=prefix, dir=parent)
        self._lock = (Path(self.name) / LOCK).open("wb")
        fcntl.flock(self._lock, fcntl.LOCK_EX)

    def cleanup(self) -> None:
        self._lock.close()
        super().cleanup()


@contextmanager
def one_by_one_in(folder: Path) -> Iterator[None]:
    """Let one thread or process at a time work in a folder; others wait for the end of its block."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / LOCK).open("ab") as lock:  # closing it unlocks it, as the end of a process does
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def is_locked(path: Path) -> bool:
    """Whether a process holds the lock of a file that exists."""
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def without_formula(text: str) -> str:
    """Return a cell's text with an apostrophe before what a spreadsheet would take for a formula."""
    return f"'{text}" if text.startswith(FORMULA) else text


def read_json(path: Path, largest: int = LARGEST_JSON) -> dict[str, Any]:
    """Read a JSON object of so many bytes at most, or raise a ValueError that says what is wrong."""
    return ground.files.read_json(path, largest)


def read_json_bytes(path: Path, largest: int = LARGEST_JSON) -> bytes:
    """Read the bytes of a JSON file, or raise a ValueError if they are more than its kind ever has."""
    return ground.files.read_json_bytes(path, largest)
