"""Votes may be ratings, which name no better one of two."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0019"
down_revision = "0018"


def upgrade() -> None:
    with op.batch_alter_table("vote") as vote:
        vote.add_column(sa.Column("rating", sa.Integer(), nullable=True))
        vote.alter_column("choice", existing_type=sa.String(length=4), nullable=True)
        vote.create_check_constraint(op.f("ck_vote_answer"), "choice is not null or rating is not null")
