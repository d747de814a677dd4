"""The screening: what displays are, tests that run on the server, and their rings and plates."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    op.create_table(
        "screening_display",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("session_id", sa.Integer(), nullable=False),
        sa.Column("pixel_mm", sa.Float(), nullable=False),
        sa.Column("distance_mm", sa.Float(), nullable=True),
        sa.Column("distance_source", sa.String(length=12), nullable=True),
        sa.Column("height_px", sa.Integer(), nullable=False),
        sa.Column("measured", sa.JSON(), nullable=False),
        sa.Column("measured_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint("pixel_mm > 0", name=op.f("ck_screening_display_pixel_mm")),
        sa.ForeignKeyConstraint(["session_id"], ["session.id"], name=op.f("fk_screening_display_session_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_screening_display")),
        sa.UniqueConstraint("session_id", name=op.f("uq_screening_display_session_id")),
    )
    op.create_table(
        "screening_test",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("session_id", sa.Integer(), nullable=False),
        sa.Column("test", sa.String(length=12), nullable=False),
        sa.Column("setup", sa.JSON(), nullable=False),
        sa.Column("started_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("finished_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("verdict", sa.String(length=24), nullable=True),
        sa.Column("result", sa.JSON(), nullable=True),
        sa.CheckConstraint("test in ('acuity', 'colour')", name=op.f("ck_screening_test_test")),
        sa.ForeignKeyConstraint(["session_id"], ["session.id"], name=op.f("fk_screening_test_session_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_screening_test")),
        sa.UniqueConstraint("session_id", "test", name=op.f("uq_screening_test_session_id_test")),
    )
    op.create_table(
        "screening_item",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("session_id", sa.Integer(), nullable=False),
        sa.Column("screening_test_id", sa.Integer(), nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("content", sa.JSON(), nullable=False),
        sa.Column("served_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("answer", sa.Integer(), nullable=True),
        sa.Column("answered_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("response_ms", sa.Float(), nullable=True),
        sa.ForeignKeyConstraint(["session_id"], ["session.id"], name=op.f("fk_screening_item_session_id")),
        sa.ForeignKeyConstraint(
            ["screening_test_id"], ["screening_test.id"], name=op.f("fk_screening_item_screening_test_id")
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_screening_item")),
        sa.UniqueConstraint("screening_test_id", "number", name=op.f("uq_screening_item_screening_test_id_number")),
    )
    op.create_index(op.f("ix_screening_item_session_id"), "screening_item", ["session_id"], unique=False)
