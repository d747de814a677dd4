"""A worker runs the queue's jobs as commands, which it can stop, and which nobody begins twice."""

from __future__ import annotations

import errno
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest

from app.errors import UnavailableError
from app.files import write_json
from app.operations.jobs import command, worker
from app.operations.jobs.command import STEPS, Command, job_folder, log_tail, needed_environment, step_ends, was_done
from app.operations.jobs.estimate import whole_left_s
from app.operations.jobs.kinds import KINDS, job_kind
from app.operations.jobs.worker import JobWorker
from app.settings import Settings
from app.store.database.engine import Database
from app.store.database.keys import utc_now
from app.store.queue import QueuedJob, cancel_job, enqueue, job_by_id, leave, retry_job
from tests.seeded_studies import NOW

pytestmark = pytest.mark.slow

TIMEOUT_S = 60
SAYS_AND_WAITS = (
    "import json, os, pathlib, time; print('begins', flush=True);"
    "told = dict(step='matching', done=3, total=18, left_s=12.5);"
    "pathlib.Path(os.environ['RECONSTUDY_PROGRESS_FILE']).write_text(json.dumps(told)); time.sleep(60)"
)


@pytest.fixture
def here(tmp_path: Path) -> Settings:
    settings = Settings(data_dir=tmp_path)
    (settings.intake_dir / "films" / "mine").mkdir(parents=True)
    return settings


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Let jobs run a Python program instead of their command."""
    return lambda program: monkeypatch.setattr(command, "PROGRAM", (sys.executable, "-c", program))


def queued(here: Settings, database: Database) -> str:
    new = job_kind("import-films").read({"films": "mine"}, here)
    with database.writing() as connection:
        return enqueue(connection, new, "Eva", NOW)


def job(database: Database, public_id: str) -> QueuedJob:
    with database.reading() as connection:
        return job_by_id(connection, public_id)


def look_until(
    runner: JobWorker, database: Database, public_id: str, is_reached: Callable[[QueuedJob], bool]
) -> QueuedJob:
    ends_s = time.monotonic() + TIMEOUT_S
    while True:
        runner.look()
        seen = job(database, public_id)
        if is_reached(seen):
            return seen
        assert time.monotonic() < ends_s, seen
        time.sleep(0.02)


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_command_that_fails_ends_its_job_with_its_own_sentence(here: Settings, database: Database) -> None:
    public_id = queued(here, database)
    JobWorker(here, database).work(threading.Event(), once=True)
    ended = job(database, public_id)
    assert ended.state == "failed"
    assert ended.detail.startswith("films/mine: "), "the sentence names the entry, without the server's folders"
    first, *_, last = log_tail(job_folder(here, public_id), 50)
    assert "reconstudy stimuli import" in first
    assert last.startswith("reconstudy: ")
    assert not (here.sets_dir / "mine").exists()


def test_what_the_command_line_refuses_ends_a_job_with_a_sentence(tmp_path: Path) -> None:
    refused = Command(
        tmp_path / "job", ["validate", "sphere", "a.ply", "--radius=5", "-o=r", "--thresholds=100:5"], 1, NOW
    )
    while refused.status is None:
        time.sleep(0.02)
    assert refused.outcome().startswith("'100:5' are no thresholds")


def test_a_job_whose_end_could_not_be_stored_does_not_run_for_ever(
    here: Settings, database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    public_id, runner = queued(here, database), JobWorker(here, database)
    (here.intake_dir / "films" / "mine").rmdir()
    store, is_away = worker.end_job, [True]

    def away_once(*end: Any) -> None:
        if is_away.pop():
            raise UnavailableError("The database does not answer.")
        store(*end)

    is_away.insert(0, False)
    monkeypatch.setattr(worker, "end_job", away_once)
    with pytest.raises(UnavailableError):
        runner.look()
    assert job(database, public_id).state == "running"
    ended = look_until(runner, database, public_id, lambda job: job.state == "failed")
    assert "Films" in ended.detail


def test_a_job_is_done_although_the_disk_is_too_full_for_its_steps(
    here: Settings, database: Database, runs: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(command, "write_json", full)
    runs(SAYS_AND_WAITS.replace("time.sleep(60)", "time.sleep(0.1)"))
    public_id = queued(here, database)
    look_until(JobWorker(here, database), database, public_id, lambda job: job.state == "done")


def test_a_worker_without_the_extra_takes_only_what_it_can_do(monkeypatch: pytest.MonkeyPatch) -> None:
    assert set(worker.kinds_here()) == KINDS.keys()
    monkeypatch.setattr(worker, "has_extra", lambda _extra: False)
    assert worker.kinds_here() == ("import-films",)


def test_a_running_job_tells_how_far_it_is_and_stops_when_cancelled(
    here: Settings, database: Database, runs: Callable[[str], None]
) -> None:
    runs(SAYS_AND_WAITS)
    public_id, runner = queued(here, database), JobWorker(here, database)
    seen = look_until(runner, database, public_id, lambda job: job.total > 0)
    assert (seen.step, seen.done, seen.total, seen.left_s) == ("matching", 3, 18, 12.5)
    assert log_tail(job_folder(here, public_id), 1) == ["begins"]
    with database.writing() as connection:
        cancel_job(connection, public_id, NOW)
    look_until(runner, database, public_id, lambda job: job.state == "cancelled")
    runs("print('resumes')")
    with database.writing() as connection:
        retry_job(connection, public_id)
    again = look_until(runner, database, public_id, lambda job: job.state == "done")
    assert again.attempt == 2
    assert log_tail(job_folder(here, public_id), 1) == ["resumes"]


@pytest.mark.parametrize("holds", [[], ["set.json"]])
def test_a_cancelled_job_leaves_no_empty_folder_but_whatever_it_made(
    here: Settings, database: Database, runs: Callable[[str], None], holds: list[str]
) -> None:
    out = here.sets_dir / "mine"
    files = f"[(out / name).touch() for name in {holds}]"
    runs(f"import pathlib; out = pathlib.Path({str(out)!r}); out.mkdir(parents=True); {files};{SAYS_AND_WAITS}")
    public_id, runner = queued(here, database), JobWorker(here, database)
    look_until(runner, database, public_id, lambda job: job.total > 0)
    assert out.is_dir()
    with database.writing() as connection:
        cancel_job(connection, public_id, NOW)
    look_until(runner, database, public_id, lambda job: job.state == "cancelled")
    assert out.exists() == bool(holds)


def test_a_job_is_estimated_as_a_whole_from_one_that_was_done(
    here: Settings, database: Database, runs: Callable[[str], None]
) -> None:
    runs(SAYS_AND_WAITS.replace("time.sleep(60)", "time.sleep(0.1)"))
    public_id = queued(here, database)
    earlier = look_until(JobWorker(here, database), database, public_id, lambda job: job.state == "done")
    folder = job_folder(here, public_id)
    assert step_ends(folder).keys() == {"matching"}
    assert earlier.started_at is not None
    earlier = replace(earlier, ended_at=earlier.started_at + timedelta(seconds=40))
    write_json(folder / STEPS, {"matching": 10.0, "meshes": 39.0})
    running = replace(earlier, public_id="now", state="running", left_s=12.0)
    moment = earlier.started_at + timedelta(seconds=8)  # at half the pace: 20 s of matching, and 60 s after it
    assert whole_left_s(running, [earlier], here, moment) == pytest.approx(12 + 60)
    untold = [
        replace(running, step="clouds"),
        replace(running, left_s=None),
        replace(running, attempt=2),
        replace(running, kind="render"),
    ]
    assert [whole_left_s(job, [earlier], here, moment) for job in untold] == [None] * 4


def test_a_worker_that_is_told_to_end_queues_its_job_again(
    here: Settings, database: Database, runs: Callable[[str], None]
) -> None:
    runs("import signal, time; signal.signal(signal.SIGTERM, signal.SIG_DFL); time.sleep(60)")
    public_id, runner, stop = queued(here, database), JobWorker(here, database), threading.Event()
    look_until(runner, database, public_id, lambda job: job.state == "running")
    stop.set()
    runner.work(stop)
    assert job(database, public_id).state == "queued"


def test_a_job_that_was_done_when_its_worker_was_told_to_end_is_not_queued_again(
    here: Settings, database: Database, runs: Callable[[str], None]
) -> None:
    runs("pass")
    public_id, runner, stop = queued(here, database), JobWorker(here, database), threading.Event()
    runner.look()
    assert job(database, public_id).state == "running"
    for running in runner._running.values():  # as it may between two looks
        running.command._process.wait(TIMEOUT_S)
    stop.set()
    runner.work(stop)
    assert job(database, public_id).state == "done"


def test_the_command_of_a_worker_that_was_killed_ends_before_the_job_begins_again(
    runs: Callable[[str], None], tmp_path: Path
) -> None:
    runs("import os, pathlib, sys, time; pathlib.Path(sys.argv[1]).write_text(str(os.getpid())); time.sleep(60)")
    note = tmp_path / "pid"
    orphan = Command(tmp_path / "job", [str(note)], 1, NOW)
    ends_s = time.monotonic() + TIMEOUT_S
    while not note.exists() or not note.read_text():
        assert time.monotonic() < ends_s
        time.sleep(0.02)
    runs("pass")
    second = Command(tmp_path / "job", [], 1, NOW)
    assert not is_running(int(note.read_text()))
    assert orphan.status is not None
    while second.status is None:
        time.sleep(0.02)


def test_a_job_whose_command_did_all_while_its_worker_died_is_done_and_not_begun_again(
    here: Settings, database: Database, runs: Callable[[str], None]
) -> None:
    public_id = queued(here, database)
    runs("import os, pathlib; pathlib.Path(os.environ['RECONSTUDY_DONE_FILE']).touch()")
    dying = JobWorker(here, database)
    dying.look()
    dying._running[public_id].command._process.wait(TIMEOUT_S)
    runs("raise SystemExit('a set is not made into a folder that is not empty')")
    JobWorker(here, database, clock=lambda: utc_now() + timedelta(hours=1)).work(threading.Event(), once=True)
    assert (job(database, public_id).state, job(database, public_id).attempt) == ("done", 2)


def test_nothing_that_people_uploaded_is_imported_even_where_the_server_was_started_beside_it(
    here: Settings, database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    films = here.intake_dir / "films" / "mine"
    for name in ("app/__init__.py", "json.py", "sitecustomize.py"):
        (films / name).parent.mkdir(exist_ok=True)
        (films / name).write_text("print('what was uploaded runs', flush=True)")
    monkeypatch.chdir(films)
    public_id = queued(here, database)
    JobWorker(here, database).work(threading.Event(), once=True)
    assert job(database, public_id).state == "failed"  # there is no film
    assert "what was uploaded runs" not in "\n".join(log_tail(job_folder(here, public_id), 100))


def test_a_job_that_was_given_to_another_worker_is_stopped(
    here: Settings, database: Database, runs: Callable[[str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    runs("import time; time.sleep(60)")
    public_id, slow = queued(here, database), JobWorker(here, database)
    look_until(slow, database, public_id, lambda job: job.state == "running")
    kill, killed = Command.kill, list[Command]()

    def kill_and_say_so(command: Command) -> None:
        killed.append(command)
        kill(command)

    monkeypatch.setattr(Command, "kill", kill_and_say_so)
    name = job(database, public_id).worker
    assert name is not None
    with database.writing() as connection:
        cancel_job(connection, public_id, NOW)
    leave(database, name, NOW)  # as another worker does that takes the first for dead
    slow.look()
    assert [command.status for command in killed] == [-signal.SIGKILL]
    assert job(database, public_id).state == "cancelled"


def test_a_command_of_a_job_never_finds_the_database_of_the_studies(
    monkeypatch: pytest.MonkeyPatch, runs: Callable[[str], None], tmp_path: Path
) -> None:
    monkeypatch.setenv("RECONSTUDY_DATABASE_URL", "postgresql://reader:secret@host/study")
    monkeypatch.setenv("RECONSTUDY_STIMULI_DIR", "elsewhere")
    runs(
        "import os; print({k: v for k, v in os.environ.items() if 'STUDY' in k}); from app.settings import Settings; "
        "print(Settings().url)"
    )
    ran = Command(tmp_path / "job", [], 1, NOW, [tmp_path / "intake", tmp_path / "sets"])
    while ran.status is None:
        time.sleep(0.02)
    said = (tmp_path / "job" / "log.txt").read_text()
    assert "postgresql" not in said
    assert "elsewhere" not in said
    assert f"'RECONSTUDY_FILES_BELOW': '{tmp_path}/intake:{tmp_path}/sets'" in said
    assert f"sqlite:///{tmp_path / 'job' / 'none'}" in said
    assert not (tmp_path / "job" / "none").exists()


def test_a_command_of_a_job_is_told_no_secret_of_its_surroundings(
    monkeypatch: pytest.MonkeyPatch, runs: Callable[[str], None], tmp_path: Path
) -> None:
    for name in ("PGPASSWORD", "AWS_SECRET_ACCESS_KEY", "MY_TOKEN"):
        monkeypatch.setenv(name, "planted")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "kept")
    runs("import os; print(os.environ)")
    ran = Command(tmp_path / "job", [], 1, NOW)
    while ran.status is None:
        time.sleep(0.02)
    said = (tmp_path / "job" / "log.txt").read_text()
    assert "planted" not in said
    assert "'NUMBA_CACHE_DIR': 'kept'" in said


@pytest.mark.parametrize(("arguments", "is_done"), [(["--version"], True), (["stimuli", "check", "nowhere"], False)])
def test_a_command_leaves_a_note_when_it_has_done_all(tmp_path: Path, arguments: list[str], is_done: bool) -> None:
    ran = Command(tmp_path / "job", arguments, 1, NOW)
    ran._process.wait(TIMEOUT_S)
    assert was_done(tmp_path / "job") is is_done


def test_no_surrounding_lets_a_program_read_larger_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENCV_IO_MAX_IMAGE_PIXELS", str(2**40))
    assert needed_environment()["OPENCV_IO_MAX_IMAGE_PIXELS"] == str(2**27)


def test_a_job_that_takes_too_long_is_ended(here: Settings, database: Database, runs: Callable[[str], None]) -> None:
    runs(SAYS_AND_WAITS)
    public_id = queued(here, database)
    hasty = JobWorker(here.model_copy(update={"longest_job_h": 0.2 / 3600}), database)
    hasty.work(threading.Event(), once=True)
    ended = job(database, public_id)
    assert ended.state == "failed"
    assert "RECONSTUDY_LONGEST_JOB_H allows more" in ended.detail
