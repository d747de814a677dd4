"""Jobs are queued, cancelled and tried again by people, and none overwrites what another one made."""

from __future__ import annotations

from datetime import timedelta

import pytest

from app.errors import ConflictError
from app.operations.jobs.queueing import cancel, must_wait, queue_job, refuse_while_used, retry, uses, waits_for
from app.store.database.engine import Database
from app.store.queue import NewJob, end_job, list_jobs, take_job
from app.store.studies.audit import Actor
from tests.seeded_studies import NOW

EVA = Actor(1, "Eva", NOW)


def cancelled(database: Database, new: NewJob) -> str:
    public_id = queue_job(database, new, EVA).public_id
    cancel(database, public_id, EVA)
    return public_id


def done(database: Database, new: NewJob) -> None:
    public_id = queue_job(database, new, EVA).public_id
    assert take_job(database, "W", (new.kind,), NOW) is not None
    end_job(database, "W", public_id, "done", "", NOW + timedelta(minutes=1))


def test_a_job_is_not_tried_again_where_another_one_has_made_the_same_since(database: Database) -> None:
    first = cancelled(database, NewJob("reconstruct", {"capture": "ball", "name": "ball"}, "runs/ball"))
    done(database, NewJob("reconstruct", {"capture": "ball", "name": "ball", "voxel": 5.0}, "runs/ball"))
    with pytest.raises(ConflictError, match="Another job has made 'runs/ball' since"):
        retry(database, first, EVA)


def test_what_changes_an_entry_may_change_it_again(database: Database) -> None:
    first = cancelled(database, NewJob("segment", {"capture": "ball", "method": "plate"}, "captures/ball"))
    done(database, NewJob("segment", {"capture": "ball", "method": "auto"}, "captures/ball"))
    assert retry(database, first, EVA).state == "queued"


def test_a_job_does_not_read_what_another_one_changes_meanwhile(database: Database) -> None:
    segment, other, reconstruct, again = (
        queue_job(database, new, EVA)
        for new in (
            NewJob("segment", {"capture": "ball"}, "captures/ball"),
            NewJob("reconstruct", {"capture": "box", "name": "box"}, "runs/box"),
            NewJob("reconstruct", {"capture": "ball", "name": "ball"}, "runs/ball"),
            NewJob("reconstruct", {"capture": "box", "name": "box-2"}, "runs/box-2"),
        )
    )
    assert must_wait(reconstruct, segment)
    assert must_wait(segment, reconstruct), "one that changes waits for one that reads, too"
    with database.reading() as connection:
        open_jobs = list_jobs(connection)
    assert [waits_for(job, open_jobs) for job in (segment, other, reconstruct, again)] == [None, None, segment, None]


def test_a_job_uses_the_entries_of_all_its_fields_and_what_it_makes(database: Database) -> None:
    values = {"sources": ["runs/ball", "models/ball"], "name": "films", "title": "ball"}
    job = queue_job(database, NewJob("render", values, "sets/films"), EVA)
    assert uses(job) == {"runs/ball", "models/ball", "sets/films"}
    unknown = queue_job(database, NewJob("of an older version", {"capture": "ball"}, "runs/old"), EVA)
    assert uses(unknown) == {"runs/old"}


def test_what_an_open_job_uses_is_kept_as_it_is(database: Database) -> None:
    queued = queue_job(database, NewJob("reconstruct", {"capture": "ball", "name": "ball"}, "runs/ball"), EVA)
    with database.writing() as connection:
        for used in ("captures/ball", "runs/ball"):
            with pytest.raises(ConflictError, match="A job works on ball now"):
                refuse_while_used(connection, used)
        refuse_while_used(connection, "captures/box")
    cancel(database, queued.public_id, EVA)
    with database.writing() as connection:
        refuse_while_used(connection, "captures/ball")
