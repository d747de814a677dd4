"""Keep objective measures attached to a study; attaching one again replaces its value."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, select

from app.intake.reports import BETTER, Measure
from app.store.database.tables import condition, dataset, measurement
from app.store.studies.studies import ids_by_name, put_row


def replace_measurements(connection: Connection, study_id: int, measures: Sequence[Measure], now: datetime) -> None:
    """Store measures, and drop earlier values of the same dataset, approach and measure."""
    datasets, conditions = (ids_by_name(connection, table, study_id) for table in (dataset, condition))
    for measure in measures:
        place = {
            "dataset_id": datasets[measure.dataset],
            "condition_id": conditions[measure.approach],
            "measure": measure.measure,
        }
        facts = {name: getattr(measure, name) for name in ("value", "direction", "unit", "source")}
        put_row(connection, measurement, place, facts | {"attached_at": now})


def measurement_records(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return a row for each attached value: by measure, then in the study's order."""
    rows = connection.execute(
        select(
            dataset.c.name.label("dataset"),
            condition.c.name.label("approach"),
            measurement.c.measure,
            measurement.c.value,
            measurement.c.direction,
            measurement.c.unit,
            measurement.c.source,
            measurement.c.attached_at,
        )
        .select_from(measurement.join(dataset).join(condition, measurement.c.condition_id == condition.c.id))
        .where(dataset.c.study_id == study_id)
        .order_by(measurement.c.measure, dataset.c.position, condition.c.position)
    )
    return [
        {
            **row._mapping,
            "better": BETTER[row.direction],
            "source": row.source or "",
            "attached_at": row.attached_at.isoformat(),
        }
        for row in rows
    ]
