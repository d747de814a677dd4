"""Keep the 3D models that are attached to a study; attaching one again replaces it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, select

from app.intake.models import Model
from app.store.database.tables import condition, dataset, model
from app.store.studies.studies import ids_by_name, put_row


def replace_models(connection: Connection, study_id: int, models: Sequence[Model], now: datetime) -> None:
    """Store models, and drop earlier ones of the same dataset, condition and kind."""
    datasets, conditions = (ids_by_name(connection, table, study_id) for table in (dataset, condition))
    for attached in models:
        place = {
            "dataset_id": datasets[attached.dataset],
            "condition_id": conditions[attached.condition],
            "kind": attached.kind,
        }
        facts = {name: getattr(attached, name) for name in ("sha256", "n_points", "n_faces", "error_limit_mm")}
        put_row(connection, model, place, facts | {"attached_at": now})


def model_digests(connection: Connection) -> list[str]:
    """Return the digests of attached models, of all studies."""
    return sorted(set(connection.scalars(select(model.c.sha256))))


def model_records(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return a row for each attached model, in the study's order."""
    rows = connection.execute(
        select(
            dataset.c.name.label("dataset"),
            condition.c.name.label("condition"),
            *(model.c[name] for name in ("kind", "sha256", "n_points", "n_faces", "error_limit_mm", "attached_at")),
        )
        .select_from(model.join(dataset).join(condition, model.c.condition_id == condition.c.id))
        .where(dataset.c.study_id == study_id)
        .order_by(dataset.c.position, condition.c.position, model.c.kind.desc())
    )
    return [dict(row._mapping) for row in rows]
