"""Votes keep what the analysis needs of their viewing records, and large tables are read by indices."""

from __future__ import annotations

import json
from statistics import median
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0024"
down_revision = "0023"

ROWS_AT_ONCE = 5000
SHOWN_ALONE = ("ACR", "ACR-HR")

vote = sa.table(
    "vote",
    *(sa.column(name, sa.Integer) for name in ("id", "session_id")),
    sa.column("viewing", sa.JSON),
    sa.column("both_seen", sa.Boolean),
    sa.column("press_to_picture_ms", sa.Float),
)


def upgrade() -> None:
    op.add_column("vote", sa.Column("both_seen", sa.Boolean(), nullable=True))
    op.add_column("vote", sa.Column("press_to_picture_ms", sa.Float(), nullable=True))
    _fill(op.get_bind())
    op.create_index(op.f("ix_vote_received_at"), "vote", ["received_at"])
    op.create_index(op.f("ix_trial_voided_at"), "trial", ["voided_at"])
    op.create_index("ix_trial_session_id_served_at", "trial", ["session_id", "served_at", "voided_at"])


def _fill(connection: sa.Connection) -> None:
    alone = _sessions_alone(connection)
    last = 0
    while rows := connection.execute(
        sa.select(vote.c.id, vote.c.session_id, vote.c.viewing)
        .where(vote.c.id > last)
        .order_by(vote.c.id)
        .limit(ROWS_AT_ONCE)
    ).all():
        last = rows[-1].id
        changes = [
            {
                "key": row.id,
                "seen": None if row.session_id in alone else _has_seen_both(row.viewing),
                "delay": _press_to_picture_ms(row.viewing),
            }
            for row in rows
        ]
        changed = sa.update(vote).where(vote.c.id == sa.bindparam("key"))
        connection.execute(
            changed.values(both_seen=sa.bindparam("seen"), press_to_picture_ms=sa.bindparam("delay")), changes
        )


def _sessions_alone(connection: sa.Connection) -> set[int]:
    """Return the sessions of studies that show one film at a time."""
    rows = connection.exec_driver_sql(
        "SELECT session.id, study.options FROM session JOIN participant ON participant.id = session.participant_id "
        "JOIN study ON study.id = participant.study_id"
    )
    return {key for key, options in rows if _options(options).get("protocol") in SHOWN_ALONE}


def _options(stored: Any) -> dict[str, Any]:
    options: dict[str, Any] = json.loads(stored) if isinstance(stored, str) else stored
    return options


def _has_seen_both(viewing: dict[str, Any]) -> bool | None:
    if "switches" not in viewing:
        return None
    return {"a", "b"} <= {viewing["first_shown"], *(switch["to"] for switch in viewing["switches"])}


def _press_to_picture_ms(viewing: dict[str, Any]) -> float | None:
    told = [switch for switch in viewing.get("switches", ()) if switch.get("presented_ms", -1.0) >= switch["at_ms"]]
    delays = [switch["presented_ms"] - switch["at_ms"] for switch in told]
    return round(median(delays), 1) if delays else None
