"""Sessions keep their language and texts, studies their images.

Studies with texts of their own state the languages they were offered in.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0020"
down_revision = "0019"

OFFERED = ["en", "de"]  # until now, whatever the study's own texts were
STUDY = sa.table("study", sa.column("id", sa.Integer), sa.column("options", sa.JSON))


def upgrade() -> None:
    op.create_table(
        "shown_texts",
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("language", sa.String(length=40), nullable=False),
        sa.Column("content", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("sha256", name=op.f("pk_shown_texts")),
    )
    op.create_table(
        "study_image",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=False),
        sa.Column("name", sa.String(length=80), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("content", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["study_id"], ["study.id"], name=op.f("fk_study_image_study_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_study_image")),
        sa.UniqueConstraint("study_id", "name", name=op.f("uq_study_image_study_id_name")),
    )
    op.create_index(op.f("ix_study_image_sha256"), "study_image", ["sha256"])
    op.add_column("session", sa.Column("language", sa.String(length=40), nullable=True))
    op.add_column("session", sa.Column("texts_sha256", sa.String(length=64), nullable=True))
    connection = op.get_bind()
    for study in connection.execute(sa.select(STUDY)).all():
        if texts := _own_texts(study.options):
            options = {**study.options, "languages": OFFERED, "texts": {OFFERED[1]: texts}}
            connection.execute(sa.update(STUDY).where(STUDY.c.id == study.id).values(options=options))


def _own_texts(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the texts that participants read in either language, as they count in the second."""
    texts: dict[str, Any] = {f"study.{key}": options.get(key) for key in ("consent", "debriefing")}
    for question in options.get("questions", ()):
        before = f"questions.{question['name']}"
        bare = question.get("options") if question["kind"] == "choice" and question.get("text") else None
        texts[f"{before}.text"] = question.get("text")
        texts[f"{before}.labels"] = list(question.get("labels") or bare or ())
    return {key: text for key, text in texts.items() if text}
