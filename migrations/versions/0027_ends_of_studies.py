"""Studies know when they were closed, and when their participants' personal data were deleted."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0027"
down_revision = "0026"


def upgrade() -> None:
    op.add_column("study", sa.Column("closed_at", sa.DateTime(timezone=True), nullable=True))
    op.add_column("study", sa.Column("forgotten_at", sa.DateTime(timezone=True), nullable=True))
    # when an older study was closed is not known: what it keeps data for counts from now
    op.execute("UPDATE study SET closed_at = coalesce(archived_at, CURRENT_TIMESTAMP) WHERE state = 'closed'")
