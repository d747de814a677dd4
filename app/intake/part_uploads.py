"""Keep uploads that arrive in parts: what is there of a file, and where to go on after a lost connection.

A file's part and a description beside it lie in a hidden folder of the intake folder. The id follows from
the person and the file, so that whoever sends the same file again goes on where it stopped, in any tab or browser.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import IO

from app.errors import ConflictError, NotFoundError
from app.files import is_locked, read_json, write_json
from app.intake.shelves import HIDDEN

ID = re.compile("[0-9a-f]{32}")
KEPT_FOR = timedelta(days=1)  # since the last part
ROOM_FACTOR = 2  # of an upload's size on the disk: the zip file and what is in it


@dataclass(frozen=True)
class PartUpload:
    """A file that arrives in parts.

    Parameters
    ----------
    id : its address
    kind, name : the entry it becomes
    file : its name on the sender's computer
    size : bytes, of the whole file
    by : who sends it
    task : id of the task that checks it, once all is there
    """

    id: str
    kind: str
    name: str
    file: str
    size: int
    by: str
    task: str | None = None


@dataclass(frozen=True)
class Standing:
    """How far an upload is: bytes that are there, and when the last came."""

    upload: PartUpload
    offset: int
    changed_at: datetime


def upload_id(by: str, kind: str, name: str, file: str, size: int, modified: int) -> str:
    """Return the id of a person's upload of a file.

    Parameters
    ----------
    by : who sends it
    kind, name : the entry it becomes
    file, size, modified : the file's name, bytes, and last change in ms since 1970, as its browser says
    """
    facts = json.dumps([by, kind, name, file, size, modified])
    return hashlib.sha256(facts.encode()).hexdigest()[:32]


def begin_upload(intake: Path, upload: PartUpload) -> Standing:
    """Begin an upload, or go on with the same one; one whose work has ended begins anew."""
    if _read(intake, upload.id) is None or not _part(intake, upload.id).is_file():
        write_json(_description(intake, upload.id), asdict(upload))
        _part(intake, upload.id).touch()
    return standing(intake, upload.id)


def standing(intake: Path, upload_id: str) -> Standing:
    """Return how far an upload is.

    Work that was noted counts while it holds the file's lock, and once it has ended and removed the file. Otherwise its
    process was killed, or it failed for the server's reasons, and the file can be checked again: its task is None.

    Raises
    ------
    NotFoundError
        If there is no such upload; it may have expired.
    """
    upload = _read(intake, upload_id)
    if upload is None:
        raise NotFoundError("There is no such upload; it may have been discarded. Please choose the file again.")
    part = _part(intake, upload_id)
    try:
        fact = part.stat()
        if upload.task is not None and not is_locked(part):
            upload = replace(upload, task=None)
        return Standing(upload, fact.st_size, datetime.fromtimestamp(fact.st_mtime, UTC))
    except FileNotFoundError:  # its work has ended, perhaps just now
        changed_s = _description(intake, upload_id).stat().st_mtime
        return Standing(upload, upload.size, datetime.fromtimestamp(changed_s, UTC))


def bytes_to_come(intake: Path, upload_id: str, size: int) -> int:
    """Return what an upload of so many bytes will still take on the disk; nothing more once its check runs."""
    part = _part(intake, upload_id)
    try:
        n_received = part.stat().st_size
        return 0 if n_received == size and is_locked(part) else size * ROOM_FACTOR - n_received
    except FileNotFoundError:  # not begun, or its work has ended
        return size * ROOM_FACTOR


@contextmanager
def appending(intake: Path, upload_id: str, offset: int) -> Iterator[IO[bytes]]:
    """Yield the file of an upload, open at its end, for one request at a time.

    Raises
    ------
    NotFoundError
        If there is no such upload.
    ConflictError
        If it is not as far as `offset`, or another request adds to it now.
    """
    standing(intake, upload_id)
    try:
        file = _part(intake, upload_id).open("r+b")
    except FileNotFoundError as error:
        raise ConflictError("This upload is complete already.") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise ConflictError("Another tab sends this file now. Close one of them.") from error
        there = file.seek(0, 2)
        if there != offset:
            raise ConflictError(f"The server has {there} bytes of this file, the part begins at {offset}.")
        yield file


def note_task(intake: Path, upload: PartUpload, task: str) -> None:
    """Note the task that checks a complete upload."""
    write_json(_description(intake, upload.id), asdict(replace(upload, task=task)))


@contextmanager
def checking(intake: Path, upload_id: str) -> Iterator[Path]:
    """Yield the file of a complete upload, which stays locked while it is checked and is removed afterwards.

    It is kept where the block ends with an `OSError`, such as a full disk: the file is not at fault, and may be large.
    """
    part = _part(intake, upload_id)
    with part.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        is_kept = False
        try:
            yield part
        except OSError:
            is_kept = True
            raise
        finally:
            if not is_kept:
                part.unlink(missing_ok=True)


def remove_killed(intake: Path) -> list[str]:
    """Remove what checks have unpacked whose process was killed; return their ids. Their files can be checked again."""
    killed = []
    for folder in (intake / HIDDEN).glob("*.work"):
        part = _part(intake, folder.stem)
        if not (part.is_file() and is_locked(part)):
            shutil.rmtree(folder, ignore_errors=True)
            killed.append(folder.stem)
    return killed


def work_folder(intake: Path, upload_id: str) -> Path:
    """Return the folder where a complete upload is unpacked, which is removed afterwards."""
    return intake / HIDDEN / f"{upload_id}.work"


def discard(intake: Path, upload_id: str) -> None:
    """Remove an upload and all that is there of it."""
    shutil.rmtree(work_folder(intake, upload_id), ignore_errors=True)
    _part(intake, upload_id).unlink(missing_ok=True)
    _description(intake, upload_id).unlink(missing_ok=True)


def unfinished(intake: Path) -> list[Standing]:
    """Return the uploads of which something is missing, the newest first."""
    ids = [path.stem for path in (intake / HIDDEN).glob("*.json")]
    known = [standing(intake, upload_id) for upload_id in ids if _read(intake, upload_id) is not None]
    waiting = [each for each in known if each.upload.task is None]
    return sorted(waiting, key=lambda each: each.changed_at, reverse=True)


def remove_expired(intake: Path, now: datetime) -> list[str]:
    """Remove what nobody has added to for a day; return its ids."""
    changed: dict[str, datetime] = {}
    for path in (intake / HIDDEN).glob("*"):
        with suppress(FileNotFoundError):  # another request has removed it
            at = datetime.fromtimestamp(path.stat().st_mtime, UTC)
            changed[path.stem] = max(at, changed.get(path.stem, at))
    expired = sorted(upload for upload, at in changed.items() if now - at > KEPT_FOR)
    for upload in expired:
        discard(intake, upload)
    return expired


def _part(intake: Path, upload_id: str) -> Path:
    return intake / HIDDEN / f"{upload_id}.part"


def _description(intake: Path, upload_id: str) -> Path:
    return intake / HIDDEN / f"{upload_id}.json"


def _read(intake: Path, upload_id: str) -> PartUpload | None:
    path = _description(intake, upload_id)
    if not ID.fullmatch(upload_id) or not path.is_file():
        return None
    kept = read_json(path)
    return PartUpload(**{"task": kept.pop("job", None), **kept})  # as 1.0 called it
