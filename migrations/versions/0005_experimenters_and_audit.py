"""Roles and passwords of experimenters, the audit log, exclusions, jobs, and studies that pause or are put away.

Columns are added, tables are not copied: SQLite would have to drop a table that others refer to.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    moment = sa.DateTime(timezone=True)
    op.add_column("study", sa.Column("paused_at", moment, nullable=True))
    op.add_column("study", sa.Column("archived_at", moment, nullable=True))
    op.add_column("study", sa.Column("revision", sa.Integer(), server_default="1", nullable=False))
    op.add_column("participant", sa.Column("is_preview", sa.Boolean(), server_default=sa.false(), nullable=False))
    op.add_column("participant", sa.Column("erased_at", moment, nullable=True))
    op.add_column("experimenter", sa.Column("role", sa.String(length=12), server_default="owner", nullable=False))
    op.add_column("experimenter", sa.Column("password_hash", sa.String(length=200), nullable=True))
    op.add_column("experimenter", sa.Column("link_expires_at", moment, nullable=True))
    op.add_column("experimenter", sa.Column("disabled_at", moment, nullable=True))
    op.add_column("experimenter_session", sa.Column("previous_hash", sa.String(length=64), nullable=True))
    op.add_column("experimenter_session", sa.Column("rotated_at", moment, nullable=True))
    op.add_column("experimenter_session", sa.Column("seen_at", moment, nullable=True))
    op.add_column("experimenter_session", sa.Column("form_token", sa.String(length=64), nullable=True))
    op.create_index(op.f("ix_experimenter_session_previous_hash"), "experimenter_session", ["previous_hash"])
    op.add_column("api_token", sa.Column("created_by", sa.String(length=120), nullable=True))
    op.add_column("api_token", sa.Column("expires_at", moment, nullable=True))
    op.add_column("api_token", sa.Column("revoked_at", moment, nullable=True))
    _create_exclusion(moment)
    _create_audit_entry(moment)
    _create_job(moment)


def _create_exclusion(moment: sa.DateTime) -> None:
    op.create_table(
        "exclusion",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("participant_id", sa.Integer(), nullable=False),
        sa.Column("reason", sa.String(length=500), nullable=False),
        sa.Column("excluded_by", sa.String(length=120), nullable=False),
        sa.Column("excluded_at", moment, nullable=False),
        sa.Column("undone_by", sa.String(length=120), nullable=True),
        sa.Column("undone_at", moment, nullable=True),
        sa.ForeignKeyConstraint(["participant_id"], ["participant.id"], name=op.f("fk_exclusion_participant_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_exclusion")),
    )
    op.create_index(op.f("ix_exclusion_participant_id"), "exclusion", ["participant_id"])


def _create_audit_entry(moment: sa.DateTime) -> None:
    op.create_table(
        "audit_entry",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("at", moment, nullable=False),
        sa.Column("actor", sa.String(length=120), nullable=False),
        sa.Column("action", sa.String(length=60), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=True),
        sa.Column("subject", sa.String(length=200), nullable=False),
        sa.Column("detail", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(["study_id"], ["study.id"], name=op.f("fk_audit_entry_study_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_audit_entry")),
    )
    op.create_index(op.f("ix_audit_entry_study_id"), "audit_entry", ["study_id"])


def _create_job(moment: sa.DateTime) -> None:
    op.create_table(
        "job",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("public_id", sa.String(length=32), nullable=False),
        sa.Column("actor", sa.String(length=120), nullable=False),
        sa.Column("title", sa.String(length=300), nullable=False),
        sa.Column("state", sa.String(length=8), nullable=False),
        sa.Column("done", sa.Integer(), nullable=False),
        sa.Column("total", sa.Integer(), nullable=False),
        sa.Column("detail", sa.String(length=500), nullable=False),
        sa.Column("result", sa.String(length=200), nullable=True),
        sa.Column("started_at", moment, nullable=False),
        sa.Column("beat_at", moment, nullable=False),
        sa.CheckConstraint("state in ('running', 'done', 'failed')", name=op.f("ck_job_state")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_job")),
        sa.UniqueConstraint("public_id", name=op.f("uq_job_public_id")),
    )
