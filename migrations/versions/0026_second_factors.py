"""A second factor for experimenters with codes to recover, and the browser of each of their sessions."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0026"
down_revision = "0025"


def upgrade() -> None:
    op.add_column("experimenter", sa.Column("totp_secret", sa.String(length=64), nullable=True))
    op.add_column("experimenter", sa.Column("totp_since", sa.DateTime(timezone=True), nullable=True))
    op.add_column("experimenter", sa.Column("totp_step", sa.BigInteger(), nullable=True))
    op.add_column("experimenter_session", sa.Column("browser", sa.String(length=60), nullable=True))
    op.create_table(
        "recovery_code",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("experimenter_id", sa.Integer(), nullable=False),
        sa.Column("code_hash", sa.String(length=64), nullable=False),
        sa.ForeignKeyConstraint(
            ["experimenter_id"], ["experimenter.id"], name=op.f("fk_recovery_code_experimenter_id")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_recovery_code")),
    )
    op.create_index(op.f("ix_recovery_code_experimenter_id"), "recovery_code", ["experimenter_id"])
