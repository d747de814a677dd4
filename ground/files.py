"""Files that are whole or absent: all is written under a temporary name and renamed at the end."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import secrets
import shutil
import socket
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

FULL = 2**16  # bytes; with less left on the disk, that is why writing failed
# What reading a damaged zip file raises; a RuntimeError, that a part is encrypted or packed in an unknown way.
DAMAGED_ZIP = (BadZipFile, zlib.error, EOFError, RuntimeError)
LONGEST_HOST = 20  # letters of a host's name in that of a file, which has 255 bytes at most


class DiskFullError(OSError):
    """No room is left for a file; what was whole before is still there."""

    def __init__(self, path: Path, free: int) -> None:
        super().__init__(
            errno.ENOSPC,
            f"{path}: the disk is full, {free} bytes are left in {path.parent}; make room and start again: "
            "what is finished is kept, and nothing is half written",
            str(path),
        )

    def __str__(self) -> str:
        return str(self.strerror)


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path` that becomes `path` if the block ends without an error.

    The temporary name keeps the suffix, because encoders choose the format by it, and holds the host and the process
    that write it. Threads that write the same file at once use different names; the last to end wins.

    A DiskFullError says that the block failed and no room is left where it wrote.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = f"{host()}-{os.getpid()}-{secrets.token_hex(4)}"
    temporary = path.with_name(f".{path.stem}.{writer}.part{path.suffix}")
    try:
        yield temporary
        temporary.replace(path)
    except Exception as error:
        _check_space(path, error)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def host() -> str:
    """Return the name of this machine as temporary names have it."""
    return re.sub(r"\W", "_", socket.gethostname())[:LONGEST_HOST]


def write_bytes(path: Path, content: bytes) -> Path:
    """Write a file, whole or not at all, and return its path."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content)
    return path


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all."""
    write_bytes(path, text.encode())


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON object, indented, whole or not at all."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def read_json(path: Path, largest: int | None = None) -> dict[str, Any]:
    """Read a JSON object.

    Parameters
    ----------
    path : of the file
    largest : most bytes that it may have; None: any number

    Raises
    ------
    ValueError
        If the file is missing, is too large, is not JSON, or holds something other than an object.
    """
    try:
        content = json.loads(read_json_bytes(path, largest))
    except FileNotFoundError as error:
        raise ValueError(f"{path}: there is no such file") from error
    except OSError as error:
        raise refused(path, error) from error
    except TooLargeError as error:
        raise ValueError(f"{path}: {error}") from error
    except RecursionError as error:
        raise ValueError(f"{path}: holds too many lists within one another") from error
    except ValueError as error:
        raise ValueError(f"{path}: is not readable as JSON: {error}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: holds a {type(content).__name__}, expected a JSON object")
    return content


class TooLargeError(ValueError):
    """A file is larger than its kind ever is."""


def read_json_bytes(path: Path, largest: int | None) -> bytes:
    """Read the bytes of a JSON file, or raise a TooLargeError if they are more than so many."""
    if largest is not None and (size := path.stat().st_size) > largest:
        raise TooLargeError(f"has {size / 2**20:.1f} MB, expected {largest // 2**20} MB at most for a JSON file")
    return path.read_bytes()


def refused(path: Path, error: OSError) -> ValueError:
    """Return the ValueError for a file that the system refuses to read."""
    return ValueError(f"{path}: cannot be read: {(error.strerror or str(error)).lower()}")


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _check_space(path: Path, error: Exception) -> None:
    """Raise DiskFullError if a full disk is why writing failed: programs and libraries say it in many ways."""
    free = shutil.disk_usage(path.parent).free
    if free < FULL or (isinstance(error, OSError) and error.errno == errno.ENOSPC):
        raise DiskFullError(path, free) from error
