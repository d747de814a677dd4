"""All tables. A vote is inserted once and never updated; other rows are updated column by column."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
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
    Text,
    TypeDecorator,
    UniqueConstraint,
    false,
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
    Column("paused_at", UtcDateTime),  # NULL: it does not pause
    Column("archived_at", UtcDateTime),  # NULL: it is not put away
    _required("revision", Integer, server_default="1"),  # counts edits, so that two editors notice each other
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

measurement = Table(
    "measurement",
    metadata,
    _id(),
    _reference("dataset", index=False),
    _reference("condition"),
    _required("measure", String(200)),
    _required("value", Float),
    _required("direction", String(20)),
    _required("unit", String(40)),
    _required("attached_at", UtcDateTime),
    UniqueConstraint("dataset_id", "condition_id", "measure"),
    CheckConstraint("direction in ('less is better', 'more is better')", name="direction"),
)

report = Table(  # its files lie in the data folder, under their digest
    "report",
    metadata,
    _id(),
    _reference("study", index=False),
    _required("kind", String(20)),
    _required("subject", String(500)),
    _digest("digest"),
    _required("attached_at", UtcDateTime),
    UniqueConstraint("study_id", "kind", "subject"),
)

model = Table(  # the file lies in the data folder, under its digest
    "model",
    metadata,
    _id(),
    _reference("dataset", index=False),
    _reference("condition"),
    _required("kind", String(5)),
    _digest("sha256"),
    _required("n_points", Integer),
    _required("n_faces", Integer),
    Column("error_limit_mm", Float),  # NULL: the truth is not known
    _required("attached_at", UtcDateTime),
    UniqueConstraint("dataset_id", "condition_id", "kind"),
    CheckConstraint("kind in ('mesh', 'cloud')", name="kind"),
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

second_film = Table(  # a pair's film once more, for browsers that do not play the first
    "second_film",
    metadata,
    _id(),
    _required("media", String(32), unique=True),
    _required("of_media", String(32), unique=True),  # of the pair, to compare or to practise with
    _required("codec", String(8)),
    _required("file", String(80)),
    _digest("sha256"),
)

single_film = Table(  # a strip of a pair's film alone, for browsers that play no film of both
    "single_film",
    metadata,
    _id(),
    _required("of_media", String(32)),  # of the pair, to compare or to practise with
    _required("strip", String(9)),
    _required("file", String(80)),
    _digest("sha256"),
    UniqueConstraint("of_media", "strip"),
    CheckConstraint("strip in ('top', 'bottom', 'reference')", name="strip"),
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
    _required("is_preview", Boolean, server_default=false()),  # an experimenter's look; it counts nowhere
    Column("erased_at", UtcDateTime),  # NULL: what was given is still there
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

screening_display = Table(
    "screening_display",
    metadata,
    _id(),
    _reference("session", index=False),
    _required("pixel_mm", Float),
    Column("distance_mm", Float),  # NULL: not yet known
    Column("distance_source", String(12)),
    _required("height_px", Integer),
    _required("measured", JSON),  # as the browser told it
    _required("measured_at", UtcDateTime),
    UniqueConstraint("session_id"),
    CheckConstraint("pixel_mm > 0", name="pixel_mm"),
)

screening_test = Table(
    "screening_test",
    metadata,
    _id(),
    _reference("session", index=False),
    _required("test", String(12)),
    _required("setup", JSON),
    _required("started_at", UtcDateTime),
    Column("finished_at", UtcDateTime),  # NULL: it runs
    Column("verdict", String(24)),
    Column("result", JSON(none_as_null=True)),
    UniqueConstraint("session_id", "test"),
    CheckConstraint("test in ('acuity', 'colour')", name="test"),
)

screening_item = Table(
    "screening_item",
    metadata,
    _id(),
    _reference("session"),
    _reference("screening_test", index=False),
    _required("number", Integer),
    _required("content", JSON),  # what is right stands here and nowhere else
    _required("served_at", UtcDateTime),
    Column("answer", Integer),
    Column("answered_at", UtcDateTime),  # NULL: not yet
    Column("response_ms", Float),
    UniqueConstraint("screening_test_id", "number"),
)

spoken_answer = Table(
    "spoken_answer",
    metadata,
    _id(),
    _reference("session", index=False),
    _required("question", String(500)),  # as it was asked
    _required("answer", Text),
    _required("experimenter", String(120)),
    _required("written_at", UtcDateTime),
    UniqueConstraint("session_id", "question"),
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

exclusion = Table(
    "exclusion",
    metadata,
    _id(),
    _reference("participant"),
    _required("reason", String(500)),
    _required("excluded_by", String(120)),
    _required("excluded_at", UtcDateTime),
    Column("undone_by", String(120)),
    Column("undone_at", UtcDateTime),  # NULL: it holds
)

experimenter = Table(
    "experimenter",
    metadata,
    _id(),
    _required("name", String(100), unique=True),
    _required("role", String(12), server_default="owner"),
    Column("password_hash", String(200)),  # NULL: none chosen yet
    _digest("link_hash", unique=True),
    Column("link_expires_at", UtcDateTime),  # NULL: the link is of no use
    Column("disabled_at", UtcDateTime),
    _required("created_at", UtcDateTime),
)

experimenter_session = Table(
    "experimenter_session",
    metadata,
    _id(),
    _reference("experimenter"),
    _digest("token_hash", unique=True),
    Column("previous_hash", String(64), index=True),  # of the token before, which lives on for a moment
    _required("created_at", UtcDateTime),
    Column("rotated_at", UtcDateTime),
    Column("seen_at", UtcDateTime),
    Column("form_token", String(64)),  # what every form of this session must carry
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
    Column("created_by", String(120)),
    Column("expires_at", UtcDateTime),  # NULL: until it is revoked
    Column("revoked_at", UtcDateTime),
)

audit_entry = Table(
    "audit_entry",
    metadata,
    _id(),
    _required("at", UtcDateTime),
    _required("actor", String(120)),
    _required("action", String(60)),
    Column("study_id", ForeignKey("study.id"), index=True),  # NULL: of no study
    _required("subject", String(200)),
    _required("detail", JSON),
)

job = Table(
    "job",
    metadata,
    _id(),
    _required("public_id", String(32), unique=True),
    _required("actor", String(120)),
    _required("title", String(300)),
    _required("state", String(8)),
    _required("done", Integer),
    _required("total", Integer),
    _required("detail", String(500)),
    Column("result", String(200)),  # where to go when it is done
    _required("started_at", UtcDateTime),
    _required("beat_at", UtcDateTime),  # when it last told that it lives
    CheckConstraint("state in ('running', 'done', 'failed')", name="state"),
)
