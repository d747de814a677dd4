"""All tables. A vote is inserted once and never updated; other rows are updated column by column."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    CheckConstraint,
    Column,
    DateTime,
    Dialect,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    TypeDecorator,
    UniqueConstraint,
)


class UtcDateTime(TypeDecorator[datetime]):
    """A moment; SQLite keeps no time zone, so it is UTC on the way in and out."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"{value.isoformat()}: has no time zone")
        return value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


NAMES = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "ck": "ck_%(table_name)s_%(constraint_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s",
    "pk": "pk_%(table_name)s",
}
metadata = MetaData(naming_convention=NAMES)


def _id() -> Column[int]:
    return Column("id", Integer, primary_key=True)


def _reference(target: str, *, index: bool = True) -> Column[int]:
    return Column(f"{target}_id", ForeignKey(f"{target}.id"), nullable=False, index=index)


def _required(name: str, kind: Any, **options: Any) -> Column[Any]:
    return Column(name, kind, nullable=False, **options)


def _digest(name: str, **options: Any) -> Column[str]:
    return _required(name, String(64), **options)


study = Table(
    "study",
    metadata,
    _id(),
    _required("slug", String(64), unique=True),
    _required("name", String(200)),
    _required("state", String(8)),
    _required("exposure_s", Float),
    _required("seed", BigInteger),
    _required("factors", JSON),
    _required("options", JSON, server_default="{}"),
    _digest("manifest_sha256"),
    _required("created_at", UtcDateTime),
    CheckConstraint("state in ('open', 'closed')", name="state"),
    CheckConstraint("exposure_s > 0", name="exposure"),
)

dataset = Table(
    "dataset",
    metadata,
    _id(),
    _reference("study", index=False),
    _required("position", Integer),
    _required("name", String(200)),
    UniqueConstraint("study_id", "name"),
)

condition = Table(
    "condition",
    metadata,
    _id(),
    _reference("study", index=False),
    _required("position", Integer),
    _required("name", String(200)),
    _required("levels", JSON),
    UniqueConstraint("study_id", "name"),
)

stimulus = Table(
    "stimulus",
    metadata,
    _id(),
    _reference("dataset", index=False),
    _reference("condition"),
    _digest("sha256"),
    _required("width", Integer),
    _required("height", Integer),
    _required("fps", Float),
    _required("n_frames", Integer),
    _required("codec", String(40)),
    _required("renderer", String(200)),
    UniqueConstraint("dataset_id", "condition_id"),
)

pair = Table(
    "pair",
    metadata,
    _id(),
    _reference("dataset"),
    Column("top_id", ForeignKey("stimulus.id"), nullable=False),
    Column("bottom_id", ForeignKey("stimulus.id"), nullable=False),
    _required("media", String(32), unique=True),
    _required("file", String(80)),
    _digest("sha256"),
    _required("width", Integer),
    _required("height", Integer),
    _required("guard_rows", Integer),
    _required("fps", Float),
    _required("n_frames", Integer),
    UniqueConstraint("top_id", "bottom_id"),
)

practice_pair = Table(
    "practice_pair",
    metadata,
    _id(),
    _reference("study", index=False),
    _required("position", Integer),
    _required("media", String(32), unique=True),
    _required("file", String(80)),
    _digest("sha256"),
    _required("width", Integer),
    _required("height", Integer),
    _required("guard_rows", Integer),
    _required("fps", Float),
    _required("n_frames", Integer),
    UniqueConstraint("study_id", "position"),
)

invitation = Table(
    "invitation",
    metadata,
    _id(),
    _reference("study"),
    _required("code", String(40), unique=True),
    Column("places", Integer),  # NULL: as many as come
    _required("created_at", UtcDateTime),
)

participant = Table(
    "participant",
    metadata,
    _id(),
    _reference("study", index=False),
    _reference("invitation"),
    _required("slot", Integer),  # counts arrivals; the label follows from it
    _required("order_slot", Integer, server_default="0"),  # whose order of trials it is: one that was given up, or new
    Column("released_at", UtcDateTime),  # when somebody else got this order; NULL: it is held
    _required("label", String(40)),
    _required("created_at", UtcDateTime),
    UniqueConstraint("study_id", "slot"),
    UniqueConstraint("study_id", "label"),
)

Index(
    "uq_participant_held_order",
    participant.c.study_id,
    participant.c.order_slot,
    unique=True,
    sqlite_where=participant.c.released_at.is_(None),
    postgresql_where=participant.c.released_at.is_(None),
)

session = Table(
    "session",
    metadata,
    _id(),
    _required("public_id", String(32), unique=True),
    _reference("participant"),
    _digest("token_hash", unique=True),
    _digest("resume_hash", unique=True),
    Column("begin_hash", String(64), unique=True, index=True),  # of the key that the client made; NULL: it made none
    _required("stage", String(40)),
    _required("started_at", UtcDateTime),
    Column("finished_at", UtcDateTime),
    Column("withdrawn_at", UtcDateTime),
)

stage_record = Table(
    "stage_record",
    metadata,
    _id(),
    _reference("session", index=False),
    _required("stage", String(40)),
    _required("data", JSON),
    _required("completed_at", UtcDateTime),
    UniqueConstraint("session_id", "stage"),
)

assignment = Table(
    "assignment",
    metadata,
    _id(),
    _reference("participant", index=False),
    _required("position", Integer),
    _reference("pair"),
    _required("a_half", String(6)),
    _required("first_shown", String(1)),
    _required("role", String(9), server_default="main"),
    UniqueConstraint("participant_id", "position"),
    CheckConstraint("a_half in ('top', 'bottom')", name="a_half"),
    CheckConstraint("first_shown in ('a', 'b')", name="first_shown"),
    CheckConstraint("role in ('main', 'repeat', 'identical')", name="role"),
)

trial = Table(
    "trial",
    metadata,
    _id(),
    _required("public_id", String(32), unique=True),
    _reference("session", index=False),
    _reference("assignment"),
    _required("attempt", Integer),
    Column("served_at", UtcDateTime),  # NULL: not yet reached
    Column("voided_at", UtcDateTime),  # NULL: it counts
    Column("void_reason", String(20)),
    Column("void_viewing", JSON(none_as_null=True)),
    UniqueConstraint("session_id", "assignment_id", "attempt"),
)

vote = Table(
    "vote",
    metadata,
    _id(),
    _required("client_id", String(36), unique=True),
    _reference("session", index=False),
    _reference("trial", index=True),
    _required("choice", String(4)),
    _required("first_shown", String(1)),
    _required("n_switches", Integer),
    _required("shown_ms", Float),
    _required("response_ms", Float),
    _required("viewing", JSON),
    _required("received_at", UtcDateTime),
    UniqueConstraint("session_id", "trial_id"),
    CheckConstraint("choice in ('a', 'b', 'none')", name="choice"),
    CheckConstraint("first_shown in ('a', 'b')", name="first_shown"),
)

experimenter = Table(
    "experimenter",
    metadata,
    _id(),
    _required("name", String(100), unique=True),
    _digest("link_hash", unique=True),
    _required("created_at", UtcDateTime),
)

experimenter_session = Table(
    "experimenter_session",
    metadata,
    _id(),
    _reference("experimenter"),
    _digest("token_hash", unique=True),
    _required("created_at", UtcDateTime),
    _required("expires_at", UtcDateTime),
)

api_token = Table(
    "api_token",
    metadata,
    _id(),
    _required("name", String(100), unique=True),
    _digest("token_hash", unique=True),
    _required("scopes", JSON),
    _required("created_at", UtcDateTime),
)
