"""Long work that an experimenter has asked for, as every worker of the server can tell of it."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import Connection, insert, select, update

from app.store.engine import Database
from app.store.keys import new_opaque_id
from app.store.tables import job

BEATS_WITHIN = timedelta(minutes=2)  # a job that is silent for longer died with its process
LONGEST_DETAIL = 500


@dataclass(frozen=True)
class Job:
    public_id: str
    actor: str
    title: str
    state: str
    done: int
    total: int
    detail: str
    result: str | None
    started_at: datetime
    beat_at: datetime

    def is_lost(self, now: datetime) -> bool:
        """Whether the process that did it is gone."""
        return self.state == "running" and now - self.beat_at > BEATS_WITHIN


def begin_job(database: Database, actor: str, title: str, now: datetime) -> str:
    public_id = new_opaque_id()
    values = {"public_id": public_id, "actor": actor, "title": title, "state": "running", "done": 0, "total": 0}
    with database.writing() as connection:
        connection.execute(insert(job).values(**values, detail="", started_at=now, beat_at=now))
    return public_id


def tell_progress(database: Database, public_id: str, done: int, total: int, detail: str, now: datetime) -> None:
    values = {"done": done, "total": total, "detail": detail[:LONGEST_DETAIL], "beat_at": now}
    _change(database, public_id, **values)


def end_job(database: Database, public_id: str, result: str, now: datetime) -> None:
    _change(database, public_id, state="done", result=result, beat_at=now)


def fail_job(database: Database, public_id: str, reason: str, now: datetime) -> None:
    _change(database, public_id, state="failed", detail=reason[:LONGEST_DETAIL], beat_at=now)


def job_by_id(connection: Connection, public_id: str) -> Job | None:
    columns = [job.c[name] for name in Job.__dataclass_fields__]
    row = connection.execute(select(*columns).where(job.c.public_id == public_id)).one_or_none()
    return Job(**row._mapping) if row else None


def _change(database: Database, public_id: str, **values: object) -> None:
    with database.writing() as connection:
        connection.execute(update(job).where(job.c.public_id == public_id).values(**values))
