"""Take a study from one server to another in one zip file: films, texts, votes, measures, and the stimulus set.

`study.json` lists the rows of each table and the digest of every file; the rows are `tables/NAME.jsonl`. Nothing enters
a server before all digests are right, and a study that does not arrive whole leaves nothing behind.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

from app.errors import StimuliError, StudyError
from app.ffmpeg import VIDEO_SUFFIXES, Progress, no_progress
from app.files import (
    WorkFolder,
    file_digest,
    is_plain_name,
    one_by_one_in,
    private_folder,
    whole_file,
    whole_folder,
)
from app.films.object_store import MediaStore
from app.intake.bounds import in_bounds
from app.intake.merge import files_of_set
from app.intake.stimuli import MANIFEST, StimulusSet, read_manifest
from app.intake.zips import MB, check_zip, unpack
from app.operations.database import open_store, study_named
from app.operations.studies.attach import digest_of, model_file, report_folder
from app.operations.studies.create import new_slug, slugify
from app.operations.studies.stimulus_sets import known_sets, set_of_study
from app.operations.upkeep.erasure import erase_again
from app.settings import Settings
from app.store.database.engine import Database, Transaction, open_database
from app.store.database.keys import utc_now
from app.store.studies.attached_models import model_digests, model_records
from app.store.studies.attached_reports import report_digests, report_records
from app.store.studies.audit import COMMAND_LINE, Actor, Entry, record
from app.store.studies.studies import Study, progress_of
from app.store.travel import copy_study, only_study_in, stage_study, study_tables, write_study_rows
from app.store.trials.backup import STUDY_FACTS, file_of, read_facts, write_facts
from app.store.trials.designs import film_files

MEDIA, SET, REPORTS, MODELS = "media", "set", "reports", "models"  # folders of the zip file
BELONGING = (*VIDEO_SUFFIXES, ".jsonl", ".json", ".ply", ".png", ".pdf", ".svg", ".csv", ".html", ".txt")
MOST_FILES = 100_000
NO_LIMIT_MB = 1024 * 1024  # of a file that an operator has at hand
ROWS = "rows.sqlite"
KIND = "a study, as `reconstudy study export` writes it"


def export_study(
    settings: Settings, database: Database, study: Study, out: IO[bytes], actor: Actor, *, has_outside: bool = False
) -> dict[str, Any]:
    """Write a study into a zip file, from which `import_study` makes it on any server.

    Parameters
    ----------
    out : the zip file, opened for writing
    actor : who exports it, for the audit log
    has_outside : with outside ids, completion codes, addresses that lead back, and names on invitations

    Raises
    ------
    ValueError
        If a film or an attached file is missing or another one than it was.
    """
    with ZipFile(out, "w", ZIP_DEFLATED) as archive, database.snapshot() as connection:
        tables = write_study_rows(connection, study.id, archive, has_outside=has_outside)
        of_set, notes = _files_of_set(settings, connection, study)
        files = {**_files_of_study(settings, connection, study.id), **of_set}
        digests = {name: _write_file(archive, name, path, sha256) for name, (path, sha256) in files.items()}
        facts = {"created_at": utc_now().isoformat(), "study": study.slug, "tables": tables, "files": digests}
        write_facts(archive, STUDY_FACTS, facts)
    with database.writing() as connection:
        actor.note(connection, "study exported", study, study.slug, with_outside_ids=has_outside)
    n_rows = {name: tables[name]["rows"] for name in ("participant", "vote")}
    return {"study": study.slug, "participants": n_rows["participant"], "votes": n_rows["vote"], "notes": notes}


def export_to_file(settings: Settings, slug: str, path: Path, *, has_outside: bool = False) -> dict[str, Any]:
    """Write a study into a zip file by its short name; see `export_study`."""
    with open_store(settings) as database:
        with database.reading() as connection:
            study = study_named(connection, slug)
        actor = Actor(0, COMMAND_LINE, utc_now())
        with whole_file(path) as temporary, temporary.open("wb") as out:
            made = export_study(settings, database, study, out, actor, has_outside=has_outside)
    return {**made, "file": str(path), "bytes": path.stat().st_size}


def check_study_zip(packed: Path, largest_mb: int) -> None:
    """Check a zip file of a study before any of it is unpacked; as `check_zip`."""
    check_zip(packed, largest_mb, MOST_FILES)


def import_file(settings: Settings, path: Path, *, name: str = "", progress: Progress = no_progress) -> dict[str, Any]:
    """Make a study of a zip file on this machine; see `import_study`."""
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file; expected {KIND}")
    with open_store(settings) as database, WorkFolder(".upload-", settings.data_dir / "uploads") as folder:
        actor = Actor(0, COMMAND_LINE, utc_now())
        try:
            check_study_zip(path, NO_LIMIT_MB)
            return import_study(settings, database, path, Path(folder), actor, name=name, progress=progress)
        except StudyError as error:
            raise ValueError(f"{path}: {error.detail}") from error


def import_study(
    settings: Settings,
    database: Database,
    packed: Path,
    work: Path,
    actor: Actor,
    *,
    name: str = "",
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Make a study of a zip file that `export_study` wrote: all of it, or nothing is changed.

    It is paused, and gets new invitations; whoever was taking part needs a new code to go on. Who was erased on this
    server is erased again.

    Parameters
    ----------
    packed : the zip file, which `check_zip` has passed
    work : a folder of the data folder for what is unpacked, removed by the caller
    actor : who imports it
    name : of the study here; empty: its own

    Raises
    ------
    ValueError
        If the file is not whole or not as described, or a study has this name.
    """
    unpacked = work / "unpacked"
    progress("unpacking and checking", 0, 1)
    limit = max(settings.largest_upload_mb * MB, packed.stat().st_size * 8)
    digests = in_bounds(_stage, packed, unpacked, work / ROWS, limit)
    source = open_database(f"sqlite:///{work / ROWS}")
    try:
        with one_by_one_in(settings.media_dir):  # studies share films
            return _import(settings, database, source, _Unpacked(unpacked, digests), actor, name, progress)
    finally:
        source.dispose()


@dataclass(frozen=True)
class _Unpacked:
    """What came in a zip file.

    Parameters
    ----------
    folder : of its files
    digests : SHA-256 of each file, by its name in the folder
    """

    folder: Path
    digests: Mapping[str, str]

    def check(self, name: str, sha256: str) -> None:
        """Raise a ValueError unless a file is there and the one that was meant."""
        if name not in self.digests:
            raise ValueError(f"{name} is missing, which the study shows; export it again")
        if self.digests[name] != sha256:
            raise ValueError(f"{name} is not the file that the study shows; export it again")


@dataclass(frozen=True)
class _Place:
    """Where a file or folder of the zip file comes to lie."""

    source: Path
    target: Path


def _import(
    settings: Settings,
    database: Database,
    source: Database,
    unpacked: _Unpacked,
    actor: Actor,
    name: str,
    progress: Progress,
) -> dict[str, Any]:
    with source.writing() as connection:
        n_erased = erase_again(settings, connection)
        row = only_study_in(connection)
        films = film_files(connection)
        reports, models = report_digests(connection), model_digests(connection)
    chosen = name.strip() or str(row["name"])
    slug = new_slug(database, chosen)
    _check_attached(unpacked, films, reports, models)
    stimulus_set = _set_in(unpacked, str(row["manifest_sha256"]))
    here = {film: _film_here(settings, film, sha256) for film, sha256 in films.items()}
    folder = unpacked.folder
    places = [_Place(folder / MEDIA / film, settings.media_dir / file) for film, file in here.items()]
    places += [_Place(folder / REPORTS / digest, report_folder(settings, digest)) for digest in reports]
    places += [_Place(folder / MODELS / f"{sha256}.ply", model_file(settings, sha256)) for sha256 in models]
    with database.reading() as connection:
        set_folder, is_new = _place_of_set(settings, connection, stimulus_set)
    if set_folder is not None and is_new:
        places.append(_Place(folder / SET, set_folder))
    values: dict[str, Any] = {"slug": slug, "name": chosen, "set_folder": str(set_folder) if set_folder else None}
    values |= {"paused_at": None if row["state"] == "closed" else actor.now}
    with ExitStack() as undo:
        for number, place in enumerate(places, start=1):
            _put(place, undo)
            progress("files", number, len(places))
        if settings.media_url:
            MediaStore(settings.media_url).upload(settings.media_dir / file for file in here.values())
        progress("rows", 0, 1)
        with database.writing() as connection, source.reading() as rows:
            study_id = copy_study(rows, connection, values, here)
            detail = {"exported_as": row["slug"], "erased_again": n_erased}
            record(connection, actor.name, Entry("study imported", study_id, slug, detail), actor.now)
            counts = progress_of(connection, study_id)
        undo.pop_all()
    notes = [] if set_folder else ["its stimulus set did not come with it: its films cannot be made again here"]
    facts = {"n_votes": counts.n_votes, "n_started": counts.n_started, "erased_again": n_erased, "notes": notes}
    return {"slug": slug, "name": chosen, "state": "closed" if row["state"] == "closed" else "paused", **facts}


def _stage(packed: Path, unpacked: Path, rows: Path, limit: int) -> dict[str, str]:
    """Unpack a zip file, check every digest, and put its rows into a database of their own; return the digests.

    Raises
    ------
    ValueError
    """
    unpack(packed, unpacked, limit, BELONGING, "a study")
    with ZipFile(packed) as archive:
        archive.filename = "the zip file"  # for messages
        facts = read_facts(archive, STUDY_FACTS)
        _check_listed(facts, [entry for entry in archive.namelist() if not entry.endswith("/")])
        for name, sha256 in facts["files"].items():
            if file_digest(unpacked / name) != sha256:
                raise ValueError(f"{name} is not the file that was packed; export the study again")
        stage_study(archive, f"sqlite:///{rows}")
    return dict(facts["files"])


def _check_listed(facts: Mapping[str, Any], entries: list[str]) -> None:
    """Check that a zip file holds what it lists, no more and no less."""
    files = facts.get("files")
    if not isinstance(files, dict):
        raise ValueError(f"{STUDY_FACTS} lists no files; expected {KIND}")
    if strange := sorted(set(facts["tables"]) - set(study_tables())):
        raise ValueError(f"it holds rows of {strange[0]!r}, which belongs to no study")
    listed = {STUDY_FACTS, *files, *map(file_of, facts["tables"])}
    if missing := sorted(listed - set(entries)):
        raise ValueError(f"{missing[0]} is missing; export the study again")
    if strange := sorted(set(entries) - listed):
        raise ValueError(f"{strange[0]} is not among the files that {STUDY_FACTS} lists")


def _files_of_study(settings: Settings, connection: Transaction, study_id: int) -> dict[str, tuple[Path, str | None]]:
    """Return the files of a study by their name in the zip file, with the digests that they must have."""
    files: dict[str, tuple[Path, str | None]] = {
        f"{MEDIA}/{name}": (settings.media_dir / name, sha256)
        for name, sha256 in film_files(connection, study_id).items()
    }
    for digest in {row["digest"] for row in report_records(connection, study_id)}:
        folder = report_folder(settings, digest)
        files |= {f"{REPORTS}/{digest}/{path.name}": (path, None) for path in sorted(folder.glob("*"))}
    for sha256 in {row["sha256"] for row in model_records(connection, study_id)}:
        files[f"{MODELS}/{sha256}.ply"] = (model_file(settings, sha256), sha256)
    return files


def _files_of_set(
    settings: Settings, connection: Transaction, study: Study
) -> tuple[dict[str, tuple[Path, str | None]], list[str]]:
    """Return the files of a study's stimulus set; nothing and a sentence where it is not here as it was."""
    known = set_of_study(settings, connection, study)
    if known is None:
        return {}, ["its stimulus set is not here any more, or has changed: the study travels without it"]
    inside = known.folder.resolve()
    try:
        names = files_of_set(inside)
    except StimuliError:
        names = []
    strange = [name for name in names if not (inside / name).resolve().is_relative_to(inside)]
    if not names or strange or not all((inside / name).is_file() for name in names):
        return {}, ["its stimulus set is not whole: the study travels without it"]
    return {f"{SET}/{name}": (inside / name, None) for name in names}, []


def _write_file(archive: ZipFile, name: str, path: Path, sha256: str | None) -> str:
    if not path.is_file():
        raise ValueError(
            f"{path}: is missing, so nothing was exported; `reconstudy db check` names all that is missing"
        )
    digest = file_digest(path)
    if sha256 not in (None, digest):
        raise ValueError(f"{path}: is not the file that was made for the study, so nothing was exported")
    archive.write(path, name, ZIP_STORED if path.suffix in VIDEO_SUFFIXES else ZIP_DEFLATED)
    return digest


def _check_attached(unpacked: _Unpacked, films: Mapping[str, str], reports: list[str], models: list[str]) -> None:
    """Check that the files are there which the rows name, by their digests."""
    for name, sha256 in films.items():
        if not is_plain_name(name) or Path(name).suffix not in VIDEO_SUFFIXES:
            raise ValueError(f"a film is named {name!r}, expected a plain name such as 0a1b.mp4")
        unpacked.check(f"{MEDIA}/{name}", sha256)
    for sha256 in models:
        unpacked.check(f"{MODELS}/{sha256}.ply", sha256)
    for digest in reports:
        folder = unpacked.folder / REPORTS / digest
        if digest_of(sorted(folder.glob("*"))) != digest:
            raise ValueError(f"the report {digest[:12]} is not the one that was attached; export the study again")


def _film_here(settings: Settings, name: str, sha256: str) -> str:
    """Return a film's name here: its own, unless another film has it."""
    there = settings.media_dir / name
    if not there.is_file() or file_digest(there) == sha256:
        return name
    return f"{sha256}{there.suffix}"


def _set_in(unpacked: _Unpacked, manifest_sha256: str) -> StimulusSet | None:
    """Read the stimulus set that came with a study; None where none came."""
    folder = unpacked.folder / SET
    if not folder.is_dir():
        return None
    unpacked.check(f"{SET}/{MANIFEST}", manifest_sha256)
    stimulus_set = in_bounds(read_manifest, folder, Path(f"{SET}/{MANIFEST}"))
    for stimulus in (*stimulus_set.stimuli, *stimulus_set.practice):
        unpacked.check(f"{SET}/{stimulus.video}", stimulus.sha256)
    return stimulus_set


def _place_of_set(
    settings: Settings, connection: Transaction, stimulus_set: StimulusSet | None
) -> tuple[Path | None, bool]:
    """Return where a study's stimulus set lies or shall lie, and whether it is new here."""
    if stimulus_set is None:
        return None, False
    for known in known_sets(settings, connection):
        if known.content.sha256 == stimulus_set.sha256:
            return known.folder.resolve(), False
    name = slugify(stimulus_set.name) if any(map(str.isalnum, stimulus_set.name)) else "set"
    place = settings.sets_dir / name
    return (settings.sets_dir / f"{name}-{stimulus_set.sha256[:8]}" if place.exists() else place), True


def _put(place: _Place, undo: ExitStack) -> None:
    """Put a file or folder where it belongs, unless it is there; `undo` removes it."""
    if place.target.exists():
        return
    if place.target.parent.name in (REPORTS, MODELS):
        private_folder(place.target.parent)
    if place.source.is_dir():
        with whole_folder(place.target) as temporary:
            shutil.copytree(place.source, temporary, dirs_exist_ok=True)
        undo.callback(shutil.rmtree, place.target, ignore_errors=True)
    else:
        with whole_file(place.target) as temporary:
            shutil.copyfile(place.source, temporary)
        undo.callback(place.target.unlink, missing_ok=True)
