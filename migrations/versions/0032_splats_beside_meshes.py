"""Splats can be attached beside meshes and clouds."""

from __future__ import annotations

from alembic import op

revision = "0032"
down_revision = "0031"


def upgrade() -> None:
    with op.batch_alter_table("model") as model:
        model.drop_constraint(op.f("ck_model_kind"), type_="check")
        model.create_check_constraint(op.f("ck_model_kind"), "kind in ('mesh', 'cloud', 'splat')")
