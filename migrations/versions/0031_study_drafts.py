"""Forms of studies that are not created yet are kept as they are typed."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from app.store.database.engine import UtcDateTime

revision = "0031"
down_revision = "0030"


def upgrade() -> None:
    op.create_table(
        "study_draft",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("actor", sa.String(120), nullable=False),
        sa.Column("stimulus_set", sa.String(200), nullable=False),
        sa.Column("content", sa.JSON(), nullable=False),
        sa.Column("changed_at", UtcDateTime(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_study_draft")),
        sa.UniqueConstraint("actor", "stimulus_set", name=op.f("uq_study_draft_actor_stimulus_set")),
    )
