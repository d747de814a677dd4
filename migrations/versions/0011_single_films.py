"""Films of one stimulus each, for browsers that play no film of both."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"


def upgrade() -> None:
    op.create_table(
        "single_film",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("of_media", sa.String(length=32), nullable=False),
        sa.Column("strip", sa.String(length=9), nullable=False),
        sa.Column("file", sa.String(length=80), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_single_film")),
        sa.UniqueConstraint("of_media", "strip", name=op.f("uq_single_film_of_media_strip")),
        sa.CheckConstraint("strip in ('top', 'bottom', 'reference')", name=op.f("ck_single_film_strip")),
    )
