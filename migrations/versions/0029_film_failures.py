"""Films that participants' browsers could not show are kept, and raise an alarm."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from app.store.database.engine import UtcDateTime

revision = "0029"
down_revision = "0028"


def upgrade() -> None:
    op.create_table(
        "film_failure",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("session_id", sa.Integer(), nullable=False),
        sa.Column("media", sa.String(32), nullable=False),
        sa.Column("trial", sa.String(40), nullable=False),
        sa.Column("reason", sa.String(300), nullable=False),
        sa.Column("browser", sa.String(80), nullable=False),
        sa.Column("happened_at", UtcDateTime(), nullable=False),
        sa.Column("settled_at", UtcDateTime(), nullable=True),
        sa.ForeignKeyConstraint(["session_id"], ["session.id"], name=op.f("fk_film_failure_session_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_film_failure")),
    )
    for column in ("session_id", "happened_at"):
        op.create_index(op.f(f"ix_film_failure_{column}"), "film_failure", [column])
