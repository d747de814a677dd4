"""A job goes on by itself: from a recording to models, films and a study, each when the one before is done."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from app.errors import InvalidError
from app.ffmpeg import no_progress
from app.main import running_server
from app.operations.database import open_store
from app.operations.jobs import command
from app.operations.jobs.chains import STUDY_OF_SET
from app.operations.jobs.kinds import job_kind
from app.operations.jobs.worker import JobWorker
from app.operations.studies.create import create_study
from app.operations.studies.creation import create_of_set
from app.operations.studies.manage import list_studies
from app.settings import Settings
from app.store.database.engine import Database, open_database
from app.store.database.keys import utc_now
from app.store.database.server_tasks import ServerTask, claim_lost_task
from app.store.queue import QueuedJob, enqueue, list_jobs
from tests.seeded_studies import NOW

pytestmark = pytest.mark.slow

MAKES = """
import pathlib, shutil, sys
out = [word.partition("=")[2] for word in sys.argv if word.startswith("--out=")]
if "render" in sys.argv or "import" in sys.argv:
    shutil.copytree({films!r}, out[0])
elif "reconstruct" in sys.argv:
    pathlib.Path(out[0]).mkdir(parents=True)
"""


@pytest.fixture
def here(tmp_path: Path, stimulus_set: Path, monkeypatch: pytest.MonkeyPatch) -> Settings:
    """A server with a capture, whose jobs copy a stimulus set instead of making one."""
    settings = Settings(data_dir=tmp_path / "data")
    for file in ("captures/ball/capture.json", "captures/ball/strokes.json", "films/mine/a.mp4"):
        path = settings.intake_dir / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    program = MAKES.format(films=str(stimulus_set.parent))
    monkeypatch.setattr(command, "PROGRAM", (sys.executable, "-c", program))
    return settings


def run(here: Settings, database: Database, kind: str, **given: Any) -> list[QueuedJob]:
    """Queue a job, let a worker run all there is to run, and return the jobs in their order."""
    new = job_kind(kind).read(given, here)
    with database.writing() as connection:
        enqueue(connection, new, "Eva", NOW)
    JobWorker(here, database).work(threading.Event(), once=True)
    with database.reading() as connection:
        return sorted(list_jobs(connection), key=lambda job: job.ended_at or NOW)


def left_task(database: Database) -> ServerTask | None:
    return claim_lost_task(database, [STUDY_OF_SET], NOW + timedelta(days=9999), is_alone=False)


@pytest.mark.parametrize(
    ("kind", "given", "goal", "kinds"),
    [
        ("reconstruct", {"capture": "ball"}, "nothing", ["reconstruct"]),
        ("reconstruct", {"capture": "ball"}, "films", ["reconstruct", "render"]),
        ("segment", {"capture": "ball", "method": "strokes"}, "models", ["segment", "reconstruct"]),
        ("segment", {"capture": "ball", "method": "strokes"}, "study", ["segment", "reconstruct", "render"]),
        ("import-films", {"films": "mine"}, "study", ["import-films"]),
    ],
)
def test_a_job_goes_on_as_far_as_was_asked(
    here: Settings, database: Database, kind: str, given: dict[str, Any], goal: str, kinds: list[str]
) -> None:
    jobs = run(here, database, kind, then=goal, **given)
    assert [(job.kind, job.state, job.detail) for job in jobs] == [(name, "done", "") for name in kinds]
    assert (left_task(database) is not None) == (goal == "study")
    assert {job.actor for job in jobs} == {"Eva"}


def test_a_failed_job_has_no_follower_until_it_succeeds(
    here: Settings, database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "PROGRAM", (sys.executable, "-c", "raise SystemExit(1)"))
    (failed,) = run(here, database, "reconstruct", capture="ball", then="films")
    assert failed.state == "failed"


def test_a_job_that_cannot_go_on_is_done_and_says_why(
    here: Settings, database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "PROGRAM", (sys.executable, "-c", ""))  # makes nothing, and says that all went well
    (done,) = run(here, database, "reconstruct", capture="ball", then="films")
    assert done.state == "done"
    assert done.detail.startswith("It did not go on: Runs and models: 'ball' was given, expected")


def test_a_goal_that_a_kind_does_not_have_is_refused(here: Settings) -> None:
    with pytest.raises(
        InvalidError, match="When it is done: 'models' was given, expected one of nothing, films, study"
    ):
        job_kind("reconstruct").read({"capture": "ball", "then": "models"}, here)


def test_a_running_server_makes_the_study_at_the_end_of_a_chain(here: Settings) -> None:
    with running_server(here), open_database(here.url) as database:
        run(here, database, "reconstruct", capture="ball", then="study", study_name="From a recording")
        ends_s = time.monotonic() + 60
        while not (studies := list_studies(here)) and time.monotonic() < ends_s:
            time.sleep(0.1)
    assert [(study["slug"], study["state"], study["n_pairs"]) for study in studies] == [
        ("from-a-recording", "paused", 6)
    ]


def test_a_study_at_the_end_of_a_chain_gets_a_free_name_and_is_made_once(here: Settings) -> None:
    with open_store(here) as database:
        run(here, database, "import-films", films="mine", name="one", then="study", study_name="Temple")
        task = left_task(database)
        assert task is not None
        create_study(here, here.sets_dir / "one", "Temple")
        later = replace(task, started_at=utc_now())
        assert create_of_set(here, database, later, no_progress) == "/admin/studies/temple-2"
        assert create_of_set(here, database, later, no_progress) == "/admin/studies/temple-2", "it was made before"
    assert [study["slug"] for study in list_studies(here)] == ["temple-2", "temple"]
