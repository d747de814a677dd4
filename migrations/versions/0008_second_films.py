"""Films in a second codec, for browsers that do not play the first."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    op.create_table(
        "second_film",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("media", sa.String(length=32), nullable=False),
        sa.Column("of_media", sa.String(length=32), nullable=False),
        sa.Column("codec", sa.String(length=8), nullable=False),
        sa.Column("file", sa.String(length=80), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_second_film")),
        sa.UniqueConstraint("media", name=op.f("uq_second_film_media")),
        sa.UniqueConstraint("of_media", name=op.f("uq_second_film_of_media")),
    )
