"""Comments on trials, tags of comments, labels of invitations, and the group that a participant is assigned to."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0023"
down_revision = "0022"


def upgrade() -> None:
    op.create_table(
        "trial_comment",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("session_id", sa.Integer(), nullable=False),
        sa.Column("trial_id", sa.Integer(), nullable=False),
        sa.Column("comment", sa.Text(), nullable=False),
        sa.Column("experimenter", sa.String(length=120), nullable=False),
        sa.Column("written_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["session_id"], ["session.id"], name=op.f("fk_trial_comment_session_id")),
        sa.ForeignKeyConstraint(["trial_id"], ["trial.id"], name=op.f("fk_trial_comment_trial_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_trial_comment")),
        sa.UniqueConstraint("trial_id", name=op.f("uq_trial_comment_trial_id")),
    )
    op.create_index(op.f("ix_trial_comment_session_id"), "trial_comment", ["session_id"])
    op.create_table(
        "comment_tag",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=False),
        sa.Column("name", sa.String(length=60), nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.ForeignKeyConstraint(["study_id"], ["study.id"], name=op.f("fk_comment_tag_study_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_comment_tag")),
        sa.UniqueConstraint("study_id", "name", name=op.f("uq_comment_tag_study_id_name")),
    )
    op.create_table(
        "comment_tagging",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("session_id", sa.Integer(), nullable=False),
        sa.Column("comment_tag_id", sa.Integer(), nullable=False),
        sa.Column("source", sa.String(length=8), nullable=False),
        sa.Column("subject", sa.String(length=500), nullable=False),
        sa.Column("tagged_by", sa.String(length=120), nullable=False),
        sa.Column("tagged_at", sa.DateTime(timezone=True), nullable=False),
        sa.CheckConstraint("source in ('written', 'spoken', 'trial')", name=op.f("ck_comment_tagging_source")),
        sa.ForeignKeyConstraint(["session_id"], ["session.id"], name=op.f("fk_comment_tagging_session_id")),
        sa.ForeignKeyConstraint(["comment_tag_id"], ["comment_tag.id"], name=op.f("fk_comment_tagging_comment_tag_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_comment_tagging")),
        sa.UniqueConstraint(
            "session_id",
            "source",
            "subject",
            "comment_tag_id",
            name=op.f("uq_comment_tagging_session_id_source_subject_comment_tag_id"),
        ),
    )
    op.create_index(op.f("ix_comment_tagging_comment_tag_id"), "comment_tagging", ["comment_tag_id"])
    op.add_column("invitation", sa.Column("label", sa.String(length=200), server_default=sa.text("''"), nullable=False))
    op.add_column("participant", sa.Column("group_name", sa.String(length=60), nullable=True))
