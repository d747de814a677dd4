"""What tells whether a table of a study has changed."""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta

from sqlalchemy import Connection, delete, insert, select, update

from app.store.database.engine import Database
from app.store.database.table_state import table_state
from app.store.database.tables import screening_display, session, spoken_answer, stage_record
from tests.seeded_studies import NOW, seed_voters

TABLES = (screening_display, stage_record, spoken_answer)


def test_every_row_that_comes_changes_or_goes_is_seen_and_those_of_other_studies_are_not(database: Database) -> None:
    seed_voters(database, 2, 2)
    with database.reading() as connection:
        first, second = connection.scalars(select(session.c.id).order_by(session.c.id))
    display = {"pixel_mm": 0.25, "height_px": 1080, "measured": {}, "measured_at": NOW, "distance_mm": 600.0}
    said = {"session_id": first, "question": "Why?", "answer": "so", "experimenter": "Eva", "written_at": NOW}
    record = {"session_id": second, "stage": "interview", "data": {}, "completed_at": NOW}
    changes: list[Callable[[Connection], object]] = [
        lambda connection: connection.execute(insert(screening_display).values(session_id=first, **display)),
        lambda connection: connection.execute(update(screening_display).values(distance_mm=650.0)),
        lambda connection: connection.execute(update(screening_display).values(distance_source="fixed")),
        lambda connection: connection.execute(insert(stage_record).values(**record)),
        lambda connection: connection.execute(insert(spoken_answer).values(**said)),
        lambda connection: connection.execute(
            update(spoken_answer).values(answer="no", written_at=NOW + timedelta(seconds=1))
        ),
        lambda connection: connection.execute(delete(stage_record)),
    ]
    states, others = [], set()
    for change in [lambda _: None, *changes]:
        with database.writing() as connection:
            change(connection)
            states.append(str(table_state(connection, 1, TABLES)))
            others.add(str(table_state(connection, 2, TABLES)))
    assert len(set(states)) == len(states)
    assert len(others) == 1
