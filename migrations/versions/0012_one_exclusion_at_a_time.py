"""A participant is excluded once at a time; of those who were so twice the first exclusion holds."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"


def upgrade() -> None:
    op.execute(
        "UPDATE exclusion SET undone_at = excluded_at, undone_by = 'database upgrade' "
        "WHERE undone_at IS NULL AND EXISTS (SELECT 1 FROM exclusion AS earlier WHERE earlier.undone_at IS NULL "
        "AND earlier.participant_id = exclusion.participant_id AND earlier.id < exclusion.id)"
    )
    holds = sa.text("undone_at IS NULL")
    op.create_index(
        "uq_exclusion_in_force",
        "exclusion",
        ["participant_id"],
        unique=True,
        sqlite_where=holds,
        postgresql_where=holds,
    )
