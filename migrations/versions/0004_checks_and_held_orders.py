"""Trials that check a participant, pairs that come more than once, and orders that are given out again."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"

KEPT = "id, participant_id, position, pair_id, a_half, first_shown"


def upgrade() -> None:
    _renew_assignment()
    op.add_column("participant", sa.Column("order_slot", sa.Integer(), server_default="0", nullable=False))
    op.add_column("participant", sa.Column("released_at", sa.DateTime(timezone=True), nullable=True))
    op.execute("UPDATE participant SET order_slot = slot")
    held = sa.text("released_at IS NULL")
    op.create_index(
        "uq_participant_held_order",
        "participant",
        ["study_id", "order_slot"],
        unique=True,
        sqlite_where=held,
        postgresql_where=held,
    )


def _renew_assignment() -> None:
    """A pair may come twice in an order: the constraint against it goes, which SQLite does only by a new table.

    The table is made anew under its own name, so that what refers to it does so again when the transaction ends.
    """
    role = sa.Column("role", sa.String(length=9), server_default="main", nullable=False)
    roles = "role in ('main', 'repeat', 'identical')"
    if op.get_bind().dialect.name != "sqlite":
        op.drop_constraint(op.f("uq_assignment_participant_id_pair_id"), "assignment")
        op.add_column("assignment", role)
        op.create_check_constraint(op.f("ck_assignment_role"), "assignment", roles)
        return
    op.execute("PRAGMA defer_foreign_keys = ON")
    op.execute("CREATE TEMPORARY TABLE kept_assignment AS SELECT * FROM assignment")
    op.drop_table("assignment")
    op.create_table(
        "assignment",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("participant_id", sa.Integer(), nullable=False),
        sa.Column("position", sa.Integer(), nullable=False),
        sa.Column("pair_id", sa.Integer(), nullable=False),
        sa.Column("a_half", sa.String(length=6), nullable=False),
        sa.Column("first_shown", sa.String(length=1), nullable=False),
        role,
        sa.CheckConstraint("a_half in ('top', 'bottom')", name=op.f("ck_assignment_a_half")),
        sa.CheckConstraint("first_shown in ('a', 'b')", name=op.f("ck_assignment_first_shown")),
        sa.CheckConstraint(roles, name=op.f("ck_assignment_role")),
        sa.ForeignKeyConstraint(["pair_id"], ["pair.id"], name=op.f("fk_assignment_pair_id")),
        sa.ForeignKeyConstraint(["participant_id"], ["participant.id"], name=op.f("fk_assignment_participant_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_assignment")),
        sa.UniqueConstraint("participant_id", "position", name=op.f("uq_assignment_participant_id_position")),
    )
    op.create_index(op.f("ix_assignment_pair_id"), "assignment", ["pair_id"])
    op.execute(f"INSERT INTO assignment ({KEPT}) SELECT {KEPT} FROM kept_assignment")
    op.execute("DROP TABLE kept_assignment")
