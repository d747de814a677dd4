"""Who came from a recruiting platform: the platform's id, what its link said, and the completion code."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"


def upgrade() -> None:
    op.create_table(
        "recruit",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=False),
        sa.Column("participant_id", sa.Integer(), nullable=False),
        sa.Column("outside_id", sa.String(length=100), nullable=True),
        sa.Column("kept", sa.JSON(), nullable=False),
        sa.Column("completion_code", sa.String(length=40), nullable=False),
        sa.ForeignKeyConstraint(["study_id"], ["study.id"], name=op.f("fk_recruit_study_id")),
        sa.ForeignKeyConstraint(["participant_id"], ["participant.id"], name=op.f("fk_recruit_participant_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_recruit")),
        sa.UniqueConstraint("participant_id", name=op.f("uq_recruit_participant_id")),
        sa.UniqueConstraint("study_id", "outside_id", name=op.f("uq_recruit_study_id_outside_id")),
    )
