"""Studies know where their stimulus set lies, so that their films can be made again."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0022"
down_revision = "0021"


def upgrade() -> None:
    op.add_column("study", sa.Column("set_folder", sa.String(length=4000), nullable=True))
