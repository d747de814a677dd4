"""Films with fewer bytes, for slow lines."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0025"
down_revision = "0024"


def upgrade() -> None:
    op.create_table(
        "lighter_film",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("of_media", sa.String(length=32), nullable=False),
        sa.Column("file", sa.String(length=80), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_lighter_film")),
        sa.UniqueConstraint("of_media", name=op.f("uq_lighter_film_of_media")),
    )
