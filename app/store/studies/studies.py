"""Keep studies, and count their progress."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, Row, Table, delete, exists, func, insert, select, true, update

from app.errors import ConflictError
from app.store.database.engine import insert_or_ignore
from app.store.database.tables import (
    api_token,
    condition,
    dataset,
    experimenter,
    pair,
    participant,
    session,
    study,
    vote,
)
from app.store.participants.exclusions import takes_part_in
from app.study.stages import FINISHED

Standing = Literal["open", "paused", "closed", "archived"]
STANDINGS: tuple[Standing, ...] = ("open", "paused", "closed", "archived")


@dataclass(frozen=True)
class Study:
    """A row of the table of studies."""

    id: int
    slug: str
    name: str
    state: Literal["open", "closed"]
    exposure_s: float
    seed: int
    factors: Mapping[str, Sequence[str]]
    options: Mapping[str, Any]
    manifest_sha256: str
    set_folder: str | None
    created_at: datetime
    paused_at: datetime | None
    closed_at: datetime | None
    archived_at: datetime | None
    forgotten_at: datetime | None
    revision: int

    @property
    def standing(self) -> Standing:
        """Open: people may begin; paused: not now; closed: nobody new; archived: closed and out of the way."""
        if self.archived_at is not None:
            return "archived"
        if self.state == "closed":
            return "closed"
        return "open" if self.paused_at is None else "paused"


@dataclass(frozen=True)
class StudyCounts:
    """How much of a study there is, and how far it is."""

    n_datasets: int
    n_conditions: int
    n_pairs: int
    n_started: int
    n_finished: int
    n_votes: int


def insert_study(connection: Connection, values: Mapping[str, Any]) -> int:
    """Insert the row of a study; `values` are its columns.

    Raises
    ------
    ValueError
        If a study has its slug.
    """
    inserted = insert_or_ignore(connection, study, [values], study.c.id)
    if not inserted:
        raise ValueError(f"there is already a study {values['slug']!r}; choose another name")
    return int(inserted[0])


def slug_exists(connection: Connection, slug: str) -> bool:
    return bool(connection.scalar(select(exists().where(study.c.slug == slug))))


def study_by_slug(connection: Connection, slug: str) -> Study | None:
    return _study(connection.execute(select(study).where(study.c.slug == slug)).one_or_none())


def study_by_id(connection: Connection, study_id: int) -> Study | None:
    return _study(connection.execute(select(study).where(study.c.id == study_id)).one_or_none())


def lock_study(connection: Connection, study_id: int) -> Study:
    """Read a study and lock it: nobody begins in it or edits it before the transaction ends."""
    row = connection.execute(select(study).where(study.c.id == study_id).with_for_update()).one()
    return Study(**row._mapping)


def all_studies(connection: Connection) -> list[Study]:
    """Return all studies, the newest first."""
    rows = connection.execute(select(study).order_by(study.c.created_at.desc(), study.c.id.desc()))
    return [Study(**row._mapping) for row in rows]


def set_standing(connection: Connection, study_id: int, standing: Standing, now: datetime) -> None:
    """Open, pause, close or archive a study; one that is opened again keeps its participants' data anew."""
    is_open = standing in ("open", "paused")
    values = {
        "state": "open" if is_open else "closed",
        "paused_at": now if standing == "paused" else None,
        "closed_at": None if is_open else func.coalesce(study.c.closed_at, now),
        "archived_at": now if standing == "archived" else None,
        "forgotten_at": None if is_open else study.c.forgotten_at,
    }
    connection.execute(update(study).where(study.c.id == study_id).values(**values))


def edit_study(connection: Connection, study_id: int, seen_revision: int, values: Mapping[str, Any]) -> None:
    """Change columns of a study, if it is still as its editor saw it.

    Raises
    ------
    ConflictError
        If somebody else has changed it meanwhile.
    """
    changed = connection.execute(
        update(study)
        .where(study.c.id == study_id, study.c.revision == seen_revision)
        .values(**values, revision=seen_revision + 1)
    )
    if not changed.rowcount:
        raise ConflictError(
            "Somebody else has changed this study meanwhile. Look at it again, then repeat your change."
        )


def give_address(connection: Connection, this_study: Study, slug: str) -> None:
    """Give a study another slug; who sees some studies only, by their slugs, goes on seeing it.

    Raises
    ------
    ConflictError
        If another study has it.
    """
    if slug_exists(connection, slug):
        raise ConflictError(f"Another study has the address {slug!r}; give this one another name first.")
    connection.execute(update(study).where(study.c.id == this_study.id).values(slug=slug))
    change_reach(connection, this_study.slug, [slug])


def change_reach(connection: Connection, slug: str, now_called: Sequence[str]) -> None:
    """Let who sees some studies only, by their slugs, see others in place of one: that by its new slug, or none."""
    for holder in (experimenter, api_token):
        for row in connection.execute(select(holder.c.id, holder.c.studies).where(holder.c.studies.is_not(None))).all():
            seen = [name for known in row.studies for name in (now_called if known == slug else [known])]
            connection.execute(update(holder).where(holder.c.id == row.id).values(studies=seen))


def edit_set(connection: Connection, study_id: int, manifest_sha256: str, factors: Mapping[str, Sequence[str]]) -> None:
    """Note that the manifest of a study's stimulus set has changed, and the set's factors."""
    values = {"manifest_sha256": manifest_sha256, "factors": factors}
    connection.execute(update(study).where(study.c.id == study_id).values(**values))


def ids_by_name(connection: Connection, table: Table, study_id: int) -> dict[str, int]:
    """Return the ids of a study's datasets or conditions, by name."""
    rows = connection.execute(select(table.c.name, table.c.id).where(table.c.study_id == study_id))
    return {row.name: row.id for row in rows}


def put_row(connection: Connection, table: Table, place: Mapping[str, Any], facts: Mapping[str, Any]) -> None:
    """Insert a row in place of the one whose columns have the values of `place`."""
    connection.execute(delete(table).where(*(table.c[name] == value for name, value in place.items())))
    connection.execute(insert(table).values(**place, **facts))


def progress_of(connection: Connection, study_id: int) -> StudyCounts:
    return _progress(connection, study.c.id == study_id)[study_id]


def progress_by_study(connection: Connection) -> dict[int, StudyCounts]:
    """Return the progress of all studies, by id."""
    return _progress(connection, true())


def _progress(connection: Connection, which: ColumnElement[bool]) -> dict[int, StudyCounts]:
    takes_part = takes_part_in(study.c.id)
    sessions = select(func.count()).select_from(session.join(participant)).where(takes_part)
    counts = {
        "n_datasets": select(func.count()).where(dataset.c.study_id == study.c.id),
        "n_conditions": select(func.count()).where(condition.c.study_id == study.c.id),
        "n_pairs": select(func.count())
        .select_from(pair.join(dataset))
        .where(dataset.c.study_id == study.c.id, pair.c.top_id != pair.c.bottom_id),
        "n_started": sessions,
        "n_finished": sessions.where(session.c.stage == FINISHED),
        "n_votes": select(func.count())
        .select_from(vote.join(session, vote.c.session_id == session.c.id).join(participant))
        .where(takes_part),
    }
    columns = (query.scalar_subquery().label(name) for name, query in counts.items())
    rows = connection.execute(select(study.c.id, *columns).where(which))
    return {study_id: StudyCounts(**dict(zip(counts, numbers, strict=True))) for study_id, *numbers in rows}


def _study(row: Row[Any] | None) -> Study | None:
    return Study(**row._mapping) if row else None
