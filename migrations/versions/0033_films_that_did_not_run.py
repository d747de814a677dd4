"""Votes say whether their films ran smoothly, as far as their viewing records tell: older ones by counts of frames."""

from __future__ import annotations

from statistics import median
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0033"
down_revision = "0032"

ROWS_AT_ONCE = 5000
FEWEST_FRAMES = 0.5  # of those that a film without drops presents
LATEST_PICTURE_MS = 250.0  # after a press

vote = sa.table(
    "vote",
    *(sa.column(name, sa.Integer) for name in ("id", "trial_id")),
    sa.column("viewing", sa.JSON),
    sa.column("shown_smoothly", sa.Boolean),
)
trial = sa.table("trial", *(sa.column(name, sa.Integer) for name in ("id", "assignment_id")))
assignment = sa.table("assignment", *(sa.column(name, sa.Integer) for name in ("id", "pair_id")))
pair = sa.table("pair", sa.column("id", sa.Integer), sa.column("fps", sa.Float))


def upgrade() -> None:
    op.add_column("vote", sa.Column("shown_smoothly", sa.Boolean(), nullable=True))
    connection = op.get_bind()
    rows_of = (
        sa.select(vote.c.id, vote.c.viewing, pair.c.fps)
        .select_from(
            vote.join(trial, vote.c.trial_id == trial.c.id)
            .join(assignment, trial.c.assignment_id == assignment.c.id)
            .join(pair, assignment.c.pair_id == pair.c.id)
        )
        .order_by(vote.c.id)
        .limit(ROWS_AT_ONCE)
    )
    changed = sa.update(vote).where(vote.c.id == sa.bindparam("key"))
    last = 0
    while rows := connection.execute(rows_of.where(vote.c.id > last)).all():
        last = rows[-1].id
        changes = [{"key": row.id, "smooth": _shown_smoothly(row.viewing, row.fps)} for row in rows]
        connection.execute(changed.values(shown_smoothly=sa.bindparam("smooth")), changes)


def _shown_smoothly(viewing: dict[str, Any], fps: float) -> bool | None:
    expected = viewing.get("shown_ms", 0.0) * fps / 1000
    if not viewing.get("n_frames") or expected <= 0:
        return None
    told = [switch for switch in viewing.get("switches", ()) if switch.get("presented_ms", -1.0) >= switch["at_ms"]]
    if told and median(switch["presented_ms"] - switch["at_ms"] for switch in told) > LATEST_PICTURE_MS:
        return False
    n_films = 2 if viewing.get("technique") == "two videos" and viewing.get("switches") else 1
    return bool((viewing["n_frames"] - viewing.get("n_dropped", 0)) / n_films >= FEWEST_FRAMES * expected)
