"""Attempts that were interrupted, withdrawals, keys made by clients, and what studies ask besides votes.

Columns are added, tables are not copied: SQLite would have to drop a table that others refer to.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    op.add_column("study", sa.Column("options", sa.JSON(), server_default="{}", nullable=False))
    op.add_column("session", sa.Column("begin_hash", sa.String(length=64), nullable=True))
    op.add_column("session", sa.Column("withdrawn_at", sa.DateTime(timezone=True), nullable=True))
    op.create_index(op.f("ix_session_begin_hash"), "session", ["begin_hash"], unique=True)
    op.add_column("trial", sa.Column("voided_at", sa.DateTime(timezone=True), nullable=True))
    op.add_column("trial", sa.Column("void_reason", sa.String(length=20), nullable=True))
    op.add_column("trial", sa.Column("void_viewing", sa.JSON(), nullable=True))
