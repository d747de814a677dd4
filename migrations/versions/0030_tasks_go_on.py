"""Tasks keep what they need to be taken up after a restart, and can be cancelled."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0030"
down_revision = "0029"


def upgrade() -> None:
    op.add_column("job", sa.Column("work", sa.JSON(none_as_null=True), nullable=True))
    op.add_column("job", sa.Column("cancelled_at", sa.DateTime(timezone=True), nullable=True))
