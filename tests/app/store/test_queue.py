"""Jobs wait in a queue, and each is run by one worker at a time."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timedelta
from threading import Barrier

import pytest

from app.errors import ConflictError, NotFoundError
from app.store.database.engine import Database
from app.store.queue import (
    LOST_AFTER,
    JobProgress,
    NewJob,
    QueuedJob,
    Worker,
    beat,
    cancel_job,
    end_job,
    enqueue,
    job_by_id,
    jobs_of,
    leave,
    list_jobs,
    n_before,
    n_jobs,
    retry_job,
    take_job,
    tell_progress,
    workers,
)
from tests.seeded_studies import NOW

KINDS = ("check", "render")
TIMEOUT_S = 60


def queued(database: Database, output: str, kind: str = "check") -> str:
    with database.writing() as connection:
        return enqueue(connection, NewJob(kind, {"capture": "ball"}, output), "Eva", NOW)


def job(database: Database, public_id: str) -> QueuedJob:
    with database.reading() as connection:
        return job_by_id(connection, public_id)


def comes(database: Database, name: str, now: datetime = NOW) -> None:
    beat(database, Worker(name, KINDS, 1, now, now), now)


def test_jobs_are_taken_in_their_order_and_only_by_workers_that_can_run_them(database: Database) -> None:
    first, second = queued(database, "runs/a", "render"), queued(database, "runs/b")
    with database.reading() as connection:
        assert n_before(connection, job_by_id(connection, second)) == 1
    assert take_job(database, "W", ("import-films",), NOW) is None
    (taken, other) = (take_job(database, "W", kinds, NOW) for kinds in (("check",), KINDS))
    assert taken is not None
    assert other is not None
    assert (taken.public_id, other.public_id) == (second, first)
    assert (taken.state, taken.worker, taken.attempt, taken.started_at) == ("running", "W", 1, NOW)
    assert take_job(database, "W", KINDS, NOW) is None


def test_a_job_that_must_wait_lets_others_pass_until_the_earlier_one_has_ended(database: Database) -> None:
    first, second, third = (queued(database, f"runs/{name}") for name in "abc")

    def take() -> str | None:
        job = take_job(
            database, "W", KINDS, NOW, lambda job, earlier: (job.public_id, earlier.public_id) == (second, first)
        )
        return job and job.public_id

    assert [take(), take(), take()] == [first, third, None]
    end_job(database, "W", first, "done", "", NOW)
    assert take() == second


def test_workers_that_take_at_once_never_take_the_same_job(database: Database) -> None:
    ids = {queued(database, f"runs/{number}") for number in range(6)}
    together = Barrier(4)

    def take(number: int) -> list[str]:
        together.wait(TIMEOUT_S)
        taken = []
        while (got := take_job(database, f"W{number}", KINDS, NOW)) is not None:
            taken.append(got.public_id)
        return taken

    with ThreadPoolExecutor(4) as pool:
        taken = [public_id for each in pool.map(take, range(4)) for public_id in each]
    assert sorted(taken) == sorted(ids)


def test_two_jobs_never_make_the_same_thing_at_once(database: Database) -> None:
    first = queued(database, "runs/ball")
    with pytest.raises(ConflictError, match="Eva"):
        queued(database, "runs/ball")
    with database.writing() as connection:
        cancel_job(connection, first, NOW)
    second = queued(database, "runs/ball")
    with pytest.raises(ConflictError, match="runs/ball"), database.writing() as connection:
        retry_job(connection, first)
    assert job(database, second).state == "queued"


def test_jobs_of_a_dead_worker_are_queued_again(database: Database) -> None:
    public_id, cancelled = queued(database, "runs/a"), queued(database, "runs/b")
    comes(database, "dies")
    for _ in range(2):
        take_job(database, "dies", KINDS, NOW)
    tell_progress(database, "dies", public_id, JobProgress("matching", 3, 18, 12.5))
    with database.writing() as connection:
        assert cancel_job(connection, cancelled, NOW).is_cancelling
    comes(database, "lives", NOW + LOST_AFTER)
    assert job(database, public_id).state == "running", "it was silent for a minute at most"
    later = NOW + LOST_AFTER + timedelta(seconds=1)
    comes(database, "lives", later)
    waiting = job(database, public_id)
    assert (waiting.state, waiting.done, waiting.step) == ("queued", 0, "")
    assert job(database, cancelled).state == "cancelled"
    again = take_job(database, "lives", KINDS, later)
    assert again is not None
    assert (again.public_id, again.attempt) == (public_id, 2)
    end_job(database, "dies", public_id, "failed", "too late", later)
    tell_progress(database, "dies", public_id, JobProgress("matching", 9, 18, 1.0))
    assert (job(database, public_id).state, job(database, public_id).done) == ("running", 0)
    with database.reading() as connection:
        assert jobs_of(connection, "dies") == {}
        assert [worker.name for worker in workers(connection, later)] == ["lives"]


def test_a_worker_that_ends_gives_its_jobs_back(database: Database) -> None:
    public_id = queued(database, "runs/a")
    comes(database, "W")
    take_job(database, "W", KINDS, NOW)
    leave(database, "W", NOW)
    assert job(database, public_id).state == "queued"
    with database.reading() as connection:
        assert workers(connection, NOW) == []


def test_what_has_ended_is_neither_cancelled_nor_done_again(database: Database) -> None:
    public_id = queued(database, "runs/a")
    with database.writing() as connection:
        assert cancel_job(connection, public_id, NOW).state == "cancelled"
        with pytest.raises(ConflictError, match="cancelled already"):
            cancel_job(connection, public_id, NOW)
        assert retry_job(connection, public_id).state == "queued"
        with pytest.raises(ConflictError, match="only a failed or cancelled"):
            retry_job(connection, public_id)
    take_job(database, "W", KINDS, NOW)
    end_job(database, "W", public_id, "done", "", NOW)
    with database.writing() as connection:
        with pytest.raises(ConflictError, match="done"):
            cancel_job(connection, public_id, NOW)
        with pytest.raises(ConflictError, match="done"):
            retry_job(connection, public_id)
        with pytest.raises(NotFoundError):
            cancel_job(connection, "unknown", NOW)


def test_running_jobs_come_first_then_the_queue_then_the_latest_that_ended(database: Database) -> None:
    ids = [queued(database, f"runs/{number}") for number in range(5)]
    for number in range(3):
        take_job(database, "W", KINDS, NOW)
        if number < 2:
            end_job(database, "W", ids[number], "done", "", NOW + timedelta(minutes=number))
    with database.reading() as connection:
        listed = [each.public_id for each in list_jobs(connection)]
        counted = n_jobs(connection)
    assert listed == [ids[2], ids[3], ids[4], ids[1], ids[0]]
    assert counted == {"queued": 2, "running": 1, "done": 2, "failed": 0, "cancelled": 0}
