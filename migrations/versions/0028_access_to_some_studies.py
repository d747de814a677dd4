"""Experimenters and tokens may be restricted to some studies."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0028"
down_revision = "0027"


def upgrade() -> None:
    op.add_column("experimenter", sa.Column("studies", sa.JSON(none_as_null=True), nullable=True))
    op.add_column("api_token", sa.Column("studies", sa.JSON(none_as_null=True), nullable=True))
