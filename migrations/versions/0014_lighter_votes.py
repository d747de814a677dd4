"""What a vote takes to be kept: an index less, and a check without a list.

A vote refers to its trial together with its session, so that the index of both serves to find it, too. Of a list of
three and more SQLite makes a table, for every row that it checks.
"""

from __future__ import annotations

from alembic import op

revision = "0014"
down_revision = "0013"


def upgrade() -> None:
    op.create_index("uq_trial_session_id_id", "trial", ["session_id", "id"], unique=True)
    with op.batch_alter_table("vote") as vote:
        vote.drop_constraint(op.f("fk_vote_trial_id"), type_="foreignkey")
        vote.create_foreign_key(
            op.f("fk_vote_session_id_trial_id"), "trial", ["session_id", "trial_id"], ["session_id", "id"]
        )
        vote.drop_index("ix_vote_trial_id")
        vote.drop_constraint(op.f("ck_vote_choice"), type_="check")
        vote.create_check_constraint(op.f("ck_vote_choice"), "choice = 'a' or choice = 'b' or choice = 'none'")
