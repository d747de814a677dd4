"""Files and folders that are whole or absent: all is written under a temporary name and renamed at the end."""

from __future__ import annotations

import fcntl
import glob
import os
import re
import shutil
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from ground.files import DiskFullError as DiskFullError
from ground.files import host
from ground.files import read_json as read_json
from ground.files import refused as refused
from ground.files import whole_file as whole_file
from ground.files import write_bytes as write_bytes
from ground.files import write_json as write_json

LONGEST_NAME = 100  # letters
RESERVED = (".mask", ".master", ".quality")  # endings of files that stand beside a video
STALE_S = 3600.0  # after so long without a write, a temporary file of another host has no writer any more
FILES_BELOW = "RECONSTUDY_FILES_BELOW"  # folders with : between, as a job of the server has it; unset: any folder


def allowed(path: Path) -> Path:
    """Return a path that a file names, in any case, if it may be read; a ValueError says that it may not.

    A job of the server reads the server's own folders alone, so that no upload has other files read.
    """
    folders = os.environ.get(FILES_BELOW, "/").split(os.pathsep)
    for look in (Path, in_any_case):  # the disk's name may be a link to elsewhere
        place = look(path)
        if not any(place.resolve().is_relative_to(folder) for folder in folders):
            raise ValueError(f"{path} lies outside the server's folders; put it beside the file that names it")
    return place


@contextmanager
def naming(place: object) -> Iterator[None]:
    """Begin the sentence of a ValueError with a file's path, or another place, unless it does so already."""
    try:
        yield
    except ValueError as error:
        if str(error).startswith(str(place)):
            raise
        raise ValueError(f"{place}: {error}") from error


def check_safe_name(name: str) -> str:
    """Return a name of a scene, an approach or a level, or raise a ValueError if files cannot be called so."""
    is_odd = name != name.strip() or not name.isprintable() or any(letter in name for letter in '/\\:*?"<>|')
    if not name or len(name) > LONGEST_NAME or is_odd or name.startswith(".") or name.endswith(RESERVED):
        raise ValueError(
            f'{name!r} is no name for files; expected up to {LONGEST_NAME} letters without / \\ : * ? " < > |, without '
            f"a dot in front, spaces at the ends, or the ending {' or '.join(RESERVED)}"
        )
    if name == "all":
        raise ValueError("'all' is what results call everything together; choose another name")
    return name


def check_exists(path: Path) -> None:
    """Raise a ValueError if there is no such file or folder."""
    if not path.exists():
        raise ValueError(f"{path}: there is no such file or folder")


def check_not_read(out: Path, inputs: Iterable[Path]) -> None:
    """Raise a ValueError if a file to write is one of those that are read."""
    if out.exists() and any(path.exists() and out.samefile(path) for path in inputs):
        raise ValueError(f"{out}: is one of the files that are read; choose another name for what is made of them")


def check_replaceable(folder: Path, names: Sequence[str], keys: Collection[str], by: str) -> None:
    """Raise a ValueError if a folder holds files that a report would overwrite, and that are no earlier one's.

    Parameters
    ----------
    folder : of the report
    names : of its files, first that of the JSON one
    keys : that this has
    by : what writes such reports, for the message
    """
    there = [name for name in names if (folder / name).exists()]
    try:
        content = read_json(folder / names[0]) if there else {}
    except ValueError:  # it is not there, or no JSON
        content = {}
    if there and not all(key in content for key in keys):
        raise ValueError(
            f"{folder}: holds {' and '.join(there)} that no {by} wrote, and that its report would overwrite; choose "
            "another folder"
        )


def check_suffix(path: Path, suffixes: tuple[str, ...]) -> None:
    """Raise a ValueError if a file's name ends in none of these, in small or capital letters."""
    if path.suffix.lower() not in suffixes:
        raise ValueError(f"{path}: unknown kind of file, expected a name that ends in {' or '.join(suffixes)}")


def any_case(pattern: str) -> str:
    """Return a pattern of file names that takes its letters in any case: `*.[jJ][sS]` of `*.js`."""
    return "".join(f"[{letter.lower()}{letter.upper()}]" if letter.isalpha() else letter for letter in pattern)


def in_any_case(path: Path) -> Path:
    """Return a path as the disk has it: where nothing is there, one whose names differ from it in capitals only.

    Cameras and other systems write capitals, and do not tell them from small letters. A ValueError names two that
    differ in capitals only.
    """
    if path.exists() or path.parent == path:
        return path
    folder = in_any_case(path.parent)
    beside = folder.iterdir() if folder.is_dir() and os.access(folder, os.R_OK) else ()
    alike = sorted(other.name for other in beside if other.name.lower() == path.name.lower())
    if len(alike) > 1:
        raise ValueError(f"{folder}: holds {' and '.join(alike)}, whose names differ in capitals only; keep one")
    return folder / (alike[0] if alike else path.name)


def first_of(folder: Path, names: Iterable[str | Path]) -> Path | None:
    """Return the first of some files or folders that is there, by its name in any case, or None."""
    return next((path for path in (in_any_case(folder / name) for name in names) if path.exists()), None)


def files_like(folder: Path, *patterns: str) -> list[Path]:
    """Return the files below a folder whose names have a pattern's form in any case, by pattern and then by name."""
    paths = (path for pattern in patterns for path in sorted(folder.glob(any_case(pattern))) if path.is_file())
    return list(dict.fromkeys(paths))


def why_no_file(path: Path) -> str:
    """Return the end of a sentence on a path where a file should be, and is none."""
    return "is a folder, expected a file" if path.is_dir() else "there is no such file"


@contextmanager
def new_folder(out: Path, *, replaces: bool = False) -> Iterator[Path]:
    """Yield a temporary folder beside `out` that becomes `out` if the block ends without an error.

    What a killed process of this host began of it is removed. With `replaces`, so is what `out` was before.

    A ValueError says that `out` exists and is not an empty folder, or is the one that this process works in.
    """
    place = out.resolve()  # where a link leads
    if place == Path.cwd():
        raise ValueError(f"{out}: is the current folder, which cannot be replaced; name one to make in it")
    if not replaces and out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise ValueError(f"{out}: exists already; choose another folder or remove it first")
    begun = f".{place.name}.{host()}-"
    for path in place.parent.glob(f"{glob.escape(begun)}*.part"):
        process = path.stem.removeprefix(begun)
        if process.isdecimal() and not _is_running(int(process)):
            shutil.rmtree(path, ignore_errors=True)
    temporary = place.with_name(f"{begun}{os.getpid()}.part")
    temporary.mkdir(parents=True)
    try:
        yield temporary
        if replaces and place.exists():
            shutil.rmtree(place)
        temporary.rename(place)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Make a folder, and be the only one of this function's callers that writes into it; it ends with the process.

    A new folder in which nothing was made is removed again.

    Two that write into one folder would mix their files, each whole, into a result that neither of them describes.

    A ValueError says that another one is at it. Where a disk knows no locks, as some network disks, nobody is refused.
    """
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(handle)
        raise ValueError(
            f"{folder}: another start is writing into it; wait until that has ended, or choose another folder"
        ) from error
    except OSError:  # no locks here
        pass
    try:
        yield
    finally:
        if is_new:
            with suppress(OSError):  # it holds what was made
                folder.rmdir()
        os.close(handle)


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files below `folder` whose process was killed before it could rename them."""
    for path in folder.rglob(".*.part*"):
        name = re.fullmatch(r"\..+\.(\w+)-(\d+)(?:-\w+)?\.part(\..+)?", path.name)
        if name and path.is_file() and _is_abandoned(path, machine=name[1], process=int(name[2])):
            path.unlink(missing_ok=True)


def _is_abandoned(path: Path, *, machine: str, process: int) -> bool:
    """Tell whether the process that wrote a temporary file is gone."""
    if machine == host():
        return not _is_running(process)
    try:
        return time.time() - path.stat().st_mtime > STALE_S
    except FileNotFoundError:
        return False


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)  # signal 0 asks and does nothing
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True
