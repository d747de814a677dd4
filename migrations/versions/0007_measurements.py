"""Objective measures that are attached to a study."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    op.create_table(
        "measurement",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("dataset_id", sa.Integer(), nullable=False),
        sa.Column("condition_id", sa.Integer(), nullable=False),
        sa.Column("measure", sa.String(length=200), nullable=False),
        sa.Column("value", sa.Float(), nullable=False),
        sa.Column("direction", sa.String(length=20), nullable=False),
        sa.Column("unit", sa.String(length=40), nullable=False),
        sa.Column("attached_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint("direction in ('less is better', 'more is better')", name=op.f("ck_measurement_direction")),
        sa.ForeignKeyConstraint(["condition_id"], ["condition.id"], name=op.f("fk_measurement_condition_id")),
        sa.ForeignKeyConstraint(["dataset_id"], ["dataset.id"], name=op.f("fk_measurement_dataset_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_measurement")),
        sa.UniqueConstraint(
            "dataset_id", "condition_id", "measure", name=op.f("uq_measurement_dataset_id_condition_id_measure")
        ),
    )
    op.create_index(op.f("ix_measurement_condition_id"), "measurement", ["condition_id"])
