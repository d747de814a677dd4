"""What measured a value that is compared with the scores."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"


def upgrade() -> None:
    op.add_column("measurement", sa.Column("source", sa.String(length=500), nullable=True))
