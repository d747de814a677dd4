"""Back up, restore and check a server: its database, pair videos, attached reports and models."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile

from app.files import PRIVATE, file_digest, is_plain_name, private_folder, whole_file
from app.operations.studies.attach import digest_of, model_file, report_folder
from app.operations.upkeep.encryption import decrypt, encrypt, is_encrypted, read_recipients
from app.operations.upkeep.erasure import erase_again
from app.settings import Settings
from app.store.database.engine import Database, Transaction, embedded_file, open_database
from app.store.database.keys import utc_now
from app.store.studies.attached_models import model_digests
from app.store.studies.attached_reports import report_digests
from app.store.trials.backup import FACTS, faults_of, holds_nothing, read_tables, refuse_what_is_held, write_tables
from app.store.trials.designs import film_files
from ground.files import DAMAGED_ZIP

MEDIA = "media/"
ATTACHED = re.compile(r"reports/[0-9a-f]{64}/([^/]+)|models/[0-9a-f]{64}\.ply")  # in the data folder


def back_up(
    settings: Settings, path: Path, *, with_media: bool = False, encrypt_to: Sequence[str] = ()
) -> dict[str, Any]:
    """Write all rows to a file; the server may run. An earlier backup of this name is replaced by the whole new one.

    Parameters
    ----------
    settings : of the server
    path : file to write
    with_media : with pair videos, reports and models
    encrypt_to : public keys, or files of them, beside those of the settings; none: the file is not encrypted

    Raises
    ------
    ValueError
        If there is no database, a public key is none, the file is there and would be missed, or a film is missing.
    """
    given = (*encrypt_to, *([settings.backup_encrypt_to] if settings.backup_encrypt_to else []))
    recipients = read_recipients(given) if given else []
    _check_is_there(settings)
    with open_database(settings.url) as database, ExitStack() as files:
        replaces = path.exists()
        if replaces:
            _check_may_be_replaced(path, database)
        temporary = files.enter_context(whole_file(path))
        with _new_private(temporary) as written:
            # without a name: if this process is killed, nobody can read what it had not encrypted yet
            plain = files.enter_context(TemporaryFile(dir=path.parent)) if recipients else written
            with ZipFile(plain, "w", ZIP_DEFLATED) as archive:
                tables = write_tables(database, archive, utc_now())
                videos = sorted(_films(database)) if with_media else []
                attached = _attached(settings, database) if with_media else []
                _refuse_missing([*(settings.media_dir / name for name in videos), *attached])
                for name in videos:
                    archive.write(settings.media_dir / name, MEDIA + name, ZIP_STORED)
                for file in attached:
                    archive.write(file, file.relative_to(settings.data_dir).as_posix())
            if recipients:
                plain.seek(0)
                encrypt(plain, written, recipients)
            written.flush()
            os.fsync(written.fileno())
    counts = {"videos": len(videos), "attached": len(attached), "encrypted": bool(recipients), "replaced": replaces}
    return {"file": str(path), "bytes": path.stat().st_size, "tables": tables, **counts}


def _new_private(path: Path) -> IO[bytes]:
    return os.fdopen(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, PRIVATE), "w+b")


def _check_may_be_replaced(path: Path, database: Database) -> None:
    """Refuse to write over what is no backup, and over a backup where the database holds nothing to back up."""
    if not _is_backup(path):
        raise ValueError(f"{path}: is there and is no backup, so it was left as it is; name another file")
    if holds_nothing(database):
        raise ValueError(
            f"{path}: is a backup, and the database is empty, so the backup was left as it is; "
            "`reconstudy restore` brings it back, or name another file"
        )


def _is_backup(path: Path) -> bool:
    """Whether a file is a backup, encrypted or not, or empty, as `mktemp` makes it."""
    if not path.is_file():
        return False
    if path.stat().st_size == 0 or is_encrypted(path):
        return True
    try:
        with ZipFile(path) as archive:
            return FACTS in archive.namelist()
    except (BadZipFile, NotImplementedError):
        return False


def restore(settings: Settings, path: Path, *, replace: bool = False, identity: Path | None = None) -> dict[str, Any]:
    """Restore what `back_up` wrote into a database of either kind: everything, or nothing is changed.

    Who was erased since the backup is erased again.

    Parameters
    ----------
    settings : of the server
    path : of the backup
    replace : drop what the database holds
    identity : file of the private key to an encrypted backup

    Raises
    ------
    ValueError
        If the file is not a complete backup, cannot be decrypted, or the database holds data and `replace` is not set.
    """
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file; expected a backup, as `reconstudy backup` writes it")
    try:
        is_locked = is_encrypted(path)
    except OSError as error:
        raise ValueError(f"{path}: is not a backup: {error}") from error
    if not is_locked:
        with path.open("rb") as file:
            return _restore(settings, path, file, replace=replace)
    if identity is None:
        raise ValueError(f"{path}: is encrypted; name the file of a private key that opens it: --identity FILE")
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    with TemporaryFile(dir=settings.data_dir) as plain:  # without a name: nothing readable stays
        decrypt(path, plain, identity)
        return _restore(settings, path, plain, replace=replace)


def _restore(settings: Settings, path: Path, content: IO[bytes], *, replace: bool) -> dict[str, Any]:
    try:
        archive = ZipFile(content)
    except (OSError, BadZipFile, NotImplementedError) as error:
        raise ValueError(f"{path}: is not a backup: {error}") from error
    archive.filename = str(path)  # for messages
    with archive, open_database(settings.url) as database:
        videos = [name.removeprefix(MEDIA) for name in archive.namelist() if name.startswith(MEDIA)]
        if strange := [name for name in videos if not is_plain_name(name)]:
            raise ValueError(f"{path}: holds a video named {strange[0]!r}, expected plain names without folders")
        attached = [name for name in archive.namelist() if _is_attached(name)]
        refuse_what_is_held(database, replace=replace)
        places = {MEDIA + name: settings.media_dir / name for name in videos}
        places |= {name: settings.data_dir / name for name in attached}
        for folder in {name.partition("/")[0] for name in attached}:
            private_folder(settings.data_dir / folder)
        n_erased = 0
        try:
            with ExitStack() as files:
                for name, place in places.items():
                    _extract(archive, name, files.enter_context(whole_file(place)))

                def finish(connection: Transaction) -> None:
                    nonlocal n_erased
                    n_erased = erase_again(settings, connection)
                    # as late as possible: the files there may belong to the rows that are being replaced
                    files.close()

                tables = read_tables(database, archive, replace=replace, before_commit=finish)
        except DAMAGED_ZIP as error:
            raise ValueError(f"{path}: is damaged: {error}") from error
        database.shred_deleted()
        films = {} if settings.media_url else _films(database)
        n_missing = sum(not (settings.media_dir / name).is_file() for name in films)
    counts = {"videos": len(videos), "attached": len(attached), "missing_videos": n_missing}
    return {"tables": tables, **counts, "erased_again": n_erased}


def check(settings: Settings) -> dict[str, Any]:
    """Return all faults of the database, and of the pair videos, models and reports that it names.

    Raises
    ------
    ValueError
        If there is no database.
    """
    _check_is_there(settings)
    with open_database(settings.url) as database:
        if faults := faults_of(database):
            return {"faults": faults, "videos": 0, "attached": 0}
        films = {} if settings.media_url else _films(database)
        models, reports = _attached_digests(database)
    for name, sha256 in sorted(films.items()):
        faults += _faults_of_file(settings.media_dir / name, sha256, "prepared")
    for sha256 in models:
        faults += _faults_of_file(model_file(settings, sha256), sha256, "attached")
    for digest in reports:
        faults += _faults_of_report(report_folder(settings, digest), digest)
    return {"faults": faults, "videos": len(films), "attached": len(models) + len(reports)}


def _faults_of_file(path: Path, sha256: str, made: str) -> list[str]:
    if not path.is_file():
        return [f"{path}: is missing"]
    return [] if file_digest(path) == sha256 else [f"{path}: is not the file that was {made}"]


def _faults_of_report(folder: Path, digest: str) -> list[str]:
    if not folder.is_dir():
        return [f"{folder}: is missing"]
    return [] if digest_of(sorted(folder.iterdir())) == digest else [f"{folder}: is not the report that was attached"]


def _is_attached(name: str) -> bool:
    """Whether a backup's entry is a file of a report or a model, named as the server names them."""
    match = ATTACHED.fullmatch(name)
    return match is not None and (match[1] is None or is_plain_name(match[1]))


def _extract(archive: ZipFile, name: str, path: Path) -> None:
    with archive.open(name) as source, path.open("wb") as target:
        shutil.copyfileobj(source, target)


def _attached(settings: Settings, database: Database) -> list[Path]:
    """Return the files of all studies' reports and models."""
    models, reports = _attached_digests(database)
    folders = [report_folder(settings, digest) for digest in reports]
    _refuse_missing(folders)
    of_reports = [file for folder in folders for file in sorted(folder.iterdir())]
    return [*of_reports, *(model_file(settings, sha256) for sha256 in models)]


def _refuse_missing(paths: Iterable[Path]) -> None:
    if missing := next((path for path in paths if not path.exists()), None):
        raise ValueError(
            f"{missing}: is missing, so nothing was backed up; `reconstudy db check` names all that is missing, an "
            "earlier backup with --media has it, and without --media the rows alone are backed up"
        )


def _attached_digests(database: Database) -> tuple[list[str], list[str]]:
    """Return the digests of attached models and of reports."""
    with database.reading() as connection:
        return model_digests(connection), report_digests(connection)


def _films(database: Database) -> dict[str, str]:
    with database.reading() as connection:
        return film_files(connection)


def _check_is_there(settings: Settings) -> None:
    """Refuse an SQLite database that is not there, which opening it would make."""
    if (kept := embedded_file(settings.url)) is not None and not kept.exists():
        raise ValueError(f"{kept}: there is no database; RECONSTUDY_DATA_DIR names its folder")
