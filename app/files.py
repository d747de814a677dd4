"""Write files and folders whole or not at all: under a temporary name, renamed at the end."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

PRIVATE = 0o600  # mode of files that only their owner reads and writes
PRIVATE_FOLDER = 0o700
LARGEST_JSON = 16 * 1024 * 1024  # bytes; read into memory they take up to twenty times as much
LONGEST_FILE_NAME = 200  # bytes; file systems take 255, and temporary names are longer
LOCK = ".lock"  # in folders of work, held by the process that works there
UNSAFE = frozenset('/\\:*?"<>|')  # in names of files, on one system or another
FORMULA = tuple("=+-@\t\r\n＝＋－＠")  # first characters of a spreadsheet's formula; the last in Asian editions


def packaged(name: str) -> Path:
    """Find a file or folder of the program: inside the package, where a wheel has it, or beside it in a checkout.

    `languages`, `migrations`, `static` and `templates` are the folders that a wheel has inside; setup.py puts them
    there.
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
        and all(character.isprintable() and character not in UNSAFE for character in name)
    )


def free_gb(folder: Path) -> float:
    """Return what is free on the disk of a folder that may still have to be made, GB."""
    nearest = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.is_dir())
    return shutil.disk_usage(nearest).free / 1e9


def private_folder(path: Path) -> None:
    """Make a folder that only its owner may enter, or make one that is there private."""
    path.mkdir(PRIVATE_FOLDER, parents=True, exist_ok=True)
    path.chmod(PRIVATE_FOLDER)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` that becomes `path` if the block ends without an error.

    The temporary name keeps the suffix, because encoders choose the format by it. Threads and processes that write the
    same file at once use different names; the last to end wins. The error of a full disk names `path`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}-{secrets.token_hex(4)}.part{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        if error.errno == errno.ENOSPC and error.filename is None:  # as of every write
            error.filename = str(path)
        raise
    finally:
        temporary.unlink(missing_ok=True)


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


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file, whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON object, indented, whole or not at all."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def read_json(path: Path, largest: int = LARGEST_JSON) -> dict[str, Any]:
    """Read a JSON object of so many bytes at most.

    Raises
    ------
    ValueError
        If the file is missing, is not JSON, or holds something other than an object.
    """
    try:
        content = json.loads(read_json_bytes(path, largest))
    except FileNotFoundError as error:
        raise ValueError(f"{path}: there is no such file") from error
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {(error.strerror or str(error)).lower()}") from error
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path}: is not readable as JSON: {error}") from error
    except RecursionError as error:
        raise ValueError(f"{path}: holds too many lists within one another") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: holds a {type(content).__name__}, expected a JSON object")
    return content


def read_json_bytes(path: Path, largest: int = LARGEST_JSON) -> bytes:
    """Read the bytes of a JSON file, unless it is larger than its kind ever is.

    Raises
    ------
    ValueError
        If it has more than the largest number of bytes.
    """
    if (size := path.stat().st_size) > largest:
        raise ValueError(f"has {size / 2**20:.1f} MB, expected {largest // 2**20} MB at most for a JSON file")
    return path.read_bytes()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
