"""What a job makes, so that no two make the same thing at once."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"


def upgrade() -> None:
    op.add_column("job", sa.Column("subject", sa.String(length=200), nullable=True))
    runs = sa.text("state = 'running'")
    op.create_index("uq_job_running_subject", "job", ["subject"], unique=True, sqlite_where=runs, postgresql_where=runs)
