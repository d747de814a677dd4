"""Tell where everything lies and in which state it is, without changing any of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from app.errors import UnavailableError
from app.files import free_gb
from app.intake.stimuli import MANIFEST
from app.operations.extras import MODULES, has_extra
from app.operations.jobs.kinds import title_of
from app.operations.running import running_url
from app.settings import Settings
from app.store.database.engine import Database, embedded_file, open_database, without_password
from app.store.database.keys import utc_now
from app.store.database.migrate import newest_version, version_of
from app.store.database.server_tasks import running_tasks
from app.store.queue import JobState, list_jobs, workers
from app.store.studies.studies import all_studies, progress_by_study

RUNNING: tuple[JobState, ...] = ("running",)
UNKNOWN: Mapping[str, Any] = {"studies": None, "jobs": []}  # without a database that can be read


def server_status(settings: Settings) -> dict[str, Any]:
    """Describe the data folder, what it holds, the server, and what is installed.

    Returns
    -------
    {"version", "data_dir", "free_gb", "database": {"kind", "place", "megabytes", "answers", "version", "newest"},
    "studies": {"n", "open", "participants", "votes"} or None without a database, "jobs": titles of what runs now,
    "films": {"n", "megabytes", "place"}, "stimulus_sets": {"n", "place"}, "server": its address or None,
    "extras": whether each is installed}
    """
    films, sets = list(settings.media_dir.glob("*.mp4")), settings.sets_dir
    return {
        "version": version("reconstudy"),
        "data_dir": str(settings.data_dir.absolute()),
        "free_gb": round(free_gb(settings.data_dir), 1),
        **_database_status(settings),
        "films": {
            "n": len(films),
            "megabytes": _megabytes(films),
            "place": settings.media_url or str(settings.media_dir.absolute()),
        },
        "stimulus_sets": {"n": len(list(sets.glob(f"*/{MANIFEST}"))), "place": str(sets.absolute())},
        "server": running_url(settings),
        "extras": {extra: has_extra(extra) for extra in MODULES},
    }


def _database_status(settings: Settings) -> dict[str, Any]:
    file = embedded_file(settings.url)
    facts: dict[str, Any] = {
        "kind": "SQLite" if file else "PostgreSQL",
        "place": str(file or without_password(settings.url)),
        "megabytes": None,
        "answers": True,
        "version": None,
        "newest": newest_version(),
    }
    if file is not None and not file.is_file():  # opening it would make it
        return {"database": facts, **UNKNOWN}
    if file is not None:
        facts["megabytes"] = _megabytes([file])
    with open_database(settings.url) as database:
        try:
            facts["version"] = version_of(database)
            return {"database": facts, **(_content(database) if facts["version"] == facts["newest"] else UNKNOWN)}
        except UnavailableError:
            return {"database": {**facts, "answers": False}, **UNKNOWN}


def _content(database: Database) -> dict[str, Any]:
    with database.reading() as connection:
        now = utc_now()
        studies, tasks, alive = all_studies(connection), running_tasks(connection, now), workers(connection, now)
        running = [job for job in list_jobs(connection, states=RUNNING) if job.worker in {each.name for each in alive}]
        counts = progress_by_study(connection).values()
    return {
        "studies": {
            "n": len(studies),
            "open": sum(study.standing == "open" for study in studies),
            "participants": sum(count.n_started for count in counts),
            "votes": sum(count.n_votes for count in counts),
        },
        "jobs": [*(task.title for task in tasks), *(f"{title_of(job.kind)}: {job.output}" for job in running)],
    }


def _megabytes(files: Iterable[Path]) -> float:
    return round(sum(file.stat().st_size for file in files) / 1e6, 1)
