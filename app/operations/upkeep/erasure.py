"""Erase participants for good: from the database's files, and from every backup that is restored later.

A backup is not rewritten. Instead the data folder holds a list of all erasures, by opaque ids, and `restore` applies it
before anybody sees the restored rows.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from app.errors import UnavailableError
from app.files import PRIVATE
from app.settings import Settings
from app.store.database.engine import Database, Transaction
from app.store.participants.participants import Person, person_of_session, sessions_of
from app.store.studies.audit import Actor, Entry, is_recorded, record
from app.store.studies.studies import Study, study_by_slug
from app.store.trials.deletion import erase, forget_people, studies_to_forget

LIST = "erasures.jsonl"  # in the data folder
NOT_NOTED = "This cannot be erased at the moment, because the server's disk is full. Please try again later."
HOUSEKEEPING = "housekeeping"  # who deletes personal data at the end of their time, in the audit log
FORGOTTEN = "personal data deleted"  # that it did so, there


def erase_participant(settings: Settings, database: Database, study: Study, person: Person, actor: Actor) -> None:
    """Delete what a participant gave, as `erase`, also from the database's files and future restores.

    Raises
    ------
    ConflictError
        If they were erased before.
    """
    with database.writing() as connection:
        sessions = sessions_of(connection, person.id)
        erase(connection, person, actor.now)
        actor.note(connection, "participant erased", study, person.label)
        for session in sessions:
            _note(settings, {"session": session, "at": actor.now.isoformat()})
    database.shred_deleted()


def enforce_retention(settings: Settings, database: Database, now: datetime) -> list[str]:
    """Delete the personal data of studies whose time is over; returns their slugs."""
    with database.reading() as connection:
        ended = studies_to_forget(connection, now)
    for study in ended:
        with database.writing() as connection:
            forget_people(connection, study.id, now)
            record(connection, HOUSEKEEPING, Entry(FORGOTTEN, study.id, study.slug), now)
            mark = {"study": study.slug, "created_at": study.created_at.isoformat()}
            _note(settings, {**mark, "at": now.isoformat()})
    if ended:
        database.shred_deleted()
    return [study.slug for study in ended]


def erase_again(settings: Settings, connection: Transaction) -> int:
    """Apply the list of erasures to rows that are being restored; returns how many it found there.

    Raises
    ------
    ValueError
        If the list cannot be read.
    """
    n_erased = 0
    for entry in _entries(settings.data_dir / LIST):
        at = datetime.fromisoformat(entry["at"])
        person = person_of_session(connection, entry["session"]) if "session" in entry else None
        study = study_by_slug(connection, entry["study"]) if "study" in entry else None
        if person is not None and person.erased_at is None:
            erase(connection, person, at)
            n_erased += 1
        elif study is not None and study.created_at.isoformat() == entry["created_at"]:
            if is_recorded(connection, study.id, FORGOTTEN, at):
                continue  # the backup is newer: what it holds was given after the study had been opened again
            forget_people(connection, study.id, at)
            n_erased += 1
    return n_erased


def _note(settings: Settings, entry: Mapping[str, Any]) -> None:
    """Add to the list, on disk before the erasure is committed: a crash between erases at a restore, and never not.

    Raises
    ------
    UnavailableError
        If the disk takes no more, or only the beginning of a line.
    """
    path = settings.data_dir / LIST
    path.parent.mkdir(parents=True, exist_ok=True)
    file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, PRIVATE)
    try:
        fcntl.flock(file, fcntl.LOCK_EX)
        n_bytes = os.fstat(file).st_size
        is_torn = n_bytes > 0 and os.pread(file, 1, n_bytes - 1) != b"\n"  # by a power cut
        line = b"\n" * is_torn + json.dumps(entry).encode() + b"\n"
        try:
            if os.write(file, line) < len(line):
                raise OSError(errno.ENOSPC, "the disk took the beginning of the line alone")
            os.fsync(file)
        except OSError as error:
            os.ftruncate(file, n_bytes)
            raise UnavailableError(NOT_NOTED) from error
    finally:
        os.close(file)


def _entries(path: Path) -> Iterator[dict[str, Any]]:
    if not path.exists():
        return
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            entry = json.loads(line)
            if not isinstance(entry["at"], str) or not entry.keys() & {"session", "study"}:
                raise ValueError("it names neither a session nor a study")
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(
                f"{path}, line {number}: is no erasure, so nothing was restored: {error}; "
                "if a power cut tore the line, delete it"
            ) from error
        yield entry
