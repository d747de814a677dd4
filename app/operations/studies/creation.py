"""Create a study as a task of the server, which goes on after a restart."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from urllib.parse import quote

from app.ffmpeg import Progress
from app.operations.studies.create import create_study, new_slug, read_options, slugify
from app.operations.studies.stimulus_sets import set_called
from app.operations.tasks import BACK, KIND, Kept, start_task
from app.settings import Settings
from app.store.database.engine import Database, Transaction
from app.store.database.server_tasks import ServerTask, running_tasks
from app.store.studies.audit import Actor
from app.store.studies.drafts import KeptDraft, drafts_of, drop_draft
from app.store.studies.studies import study_by_slug
from app.study.kinds import QUICK
from app.study.options.study_file import StudyFile, parse_study_file, write_study_file

CREATION = "create study"
DRAFT = "draft"  # names the form that a study is made of, among what a task keeps
MOST_OF_A_NAME = 1000


def begin_creation(
    settings: Settings, database: Database, folder: Path, wanted: StudyFile, actor: Actor, *, drawn_from: str = ""
) -> str:
    """Begin to create a study of a stimulus set, paused until it is opened; return the task's id.

    Parameters
    ----------
    drawn_from : name in addresses of the set whose form was filled in: it is kept until the study is there

    Raises
    ------
    ValueError
        If a study has this name.
    ConflictError
        If somebody else creates one of this name now.
    """
    slug = new_slug(database, wanted.name)
    kept = {KIND: CREATION, "folder": str(folder), "study": write_study_file(wanted), "by": actor.name}
    if drawn_from:
        kept |= {DRAFT: drawn_from, BACK: f"/admin/studies/new?stimulus_set={quote(drawn_from)}"}
    title = f"Creating the study {wanted.name}"
    return start_task(
        database,
        actor,
        title,
        lambda tell: _create(settings, database, kept, tell),
        subject=f"study {slug}",
        kept=kept,
    )


def waiting_drafts(connection: Transaction, actor: str, now: datetime) -> list[KeptDraft]:
    """Return a person's forms, the newest first, but those whose study is being created now."""
    tasks = [task.work for task in running_tasks(connection, now) if task.actor == actor and task.work]
    being_created = {work.get(DRAFT) for work in tasks}
    return [draft for draft in drafts_of(connection, actor) if draft.stimulus_set not in being_created]


def go_on_creating(settings: Settings, database: Database, task: ServerTask, progress: Progress) -> str:
    """Create a study whose task was interrupted; return its page. Films that are there are not made again."""
    assert task.work is not None, "the task of a creation keeps it"
    slug = slugify(parse_study_file(str(task.work["study"])).name)
    with database.reading() as connection:
        made = study_by_slug(connection, slug)
    if made is not None and made.created_at >= task.started_at:  # the server stopped after the last step
        return _created(database, slug, task.work)
    return _create(settings, database, task.work, progress)


def create_of_set(settings: Settings, database: Database, task: ServerTask, progress: Progress) -> str:
    """Create the study at the end of a chain of jobs, under a free name, and return its page."""
    assert task.work is not None, "the task of a chain keeps it"
    with database.reading() as connection:
        known = set_called(settings, connection, str(task.work["set"]))
    options = read_options(None, {}, str(task.work.get("study_preset") or QUICK))
    wished = str(task.work.get("study_name") or known.title)
    for name in (f"{wished} {number}" if number > 1 else wished for number in range(1, MOST_OF_A_NAME)):
        with database.reading() as connection:
            there = study_by_slug(connection, slugify(name))
        if there is None:
            text = write_study_file(StudyFile(name=name, options=options))
            kept = {"folder": str(known.folder), "study": text, "by": task.work["by"]}
            return _create(settings, database, kept, progress)
        if there.created_at >= task.started_at and there.manifest_sha256 == known.content.sha256:
            return f"/admin/studies/{there.slug}"  # the server stopped after the last step
    raise ValueError(f"there are {MOST_OF_A_NAME} studies called {wished!r}; make one by hand, under another name")


def _create(settings: Settings, database: Database, kept: Kept, progress: Progress) -> str:
    wanted = parse_study_file(str(kept["study"]))
    made = create_study(
        settings,
        Path(kept["folder"]),
        wanted.name,
        exposure_s=wanted.exposure_s,
        seed=wanted.seed,
        options=wanted.options,
        progress=progress,
        by=str(kept["by"]),
        is_paused=True,
    )
    return _created(database, made["slug"], kept)


def _created(database: Database, slug: str, kept: Kept) -> str:
    """Drop the form that a study was made of; return the study's page."""
    if DRAFT in kept:
        with database.writing() as connection:
            drop_draft(connection, str(kept["by"]), str(kept[DRAFT]))
    return f"/admin/studies/{slug}"
