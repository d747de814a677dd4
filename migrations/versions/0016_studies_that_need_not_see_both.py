"""Studies made before the option `see_both` go on without it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"

STUDY = sa.table("study", sa.column("id", sa.Integer), sa.column("options", sa.JSON))


def upgrade() -> None:
    connection = op.get_bind()
    for study in connection.execute(sa.select(STUDY)).all():
        options = {**study.options, "see_both": False}
        connection.execute(sa.update(STUDY).where(STUDY.c.id == study.id).values(options=options))
