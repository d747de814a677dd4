"""Results of tests beside the screen, as an experimenter enters them."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"


def upgrade() -> None:
    op.create_table(
        "screening_entry",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("session_id", sa.Integer(), nullable=False),
        sa.Column("test", sa.String(length=12), nullable=False),
        sa.Column("instrument", sa.String(length=200), nullable=False),
        sa.Column("result", sa.String(length=200), nullable=False),
        sa.Column("verdict", sa.String(length=24), nullable=False),
        sa.Column("logmar", sa.Float(), nullable=True),
        sa.Column("experimenter", sa.String(length=120), nullable=False),
        sa.Column("entered_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint("test in ('acuity', 'colour')", name=op.f("ck_screening_entry_test")),
        sa.ForeignKeyConstraint(["session_id"], ["session.id"], name=op.f("fk_screening_entry_session_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_screening_entry")),
    )
    op.create_index(op.f("ix_screening_entry_session_id"), "screening_entry", ["session_id"])
