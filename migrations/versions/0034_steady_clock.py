"""Sessions know when they began by a clock that nobody sets, too; older ones have the wall clock alone."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0034"
down_revision = "0033"


def upgrade() -> None:
    op.add_column("session", sa.Column("machine_start", sa.String(36), nullable=True))
    op.add_column("session", sa.Column("running_s", sa.Float(), nullable=True))
