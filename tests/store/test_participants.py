"""Who is excluded is excluded once, also when two ask at the same moment."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from datetime import datetime

import pytest

from app.errors import ConflictError
from app.store.engine import Database
from app.store.invitations import Invitation
from app.store.participants import (
    exclude,
    exclusion_records,
    participant_labelled,
    participant_records,
    undo_exclusion,
)
from app.store.sessions import begin_session

LONG_ENOUGH_S = 0.5  # for who need not wait


def test_nobody_is_excluded_twice_when_two_ask_at_once(
    database: Database, study_id: int, invite: Callable[[int | None], Invitation], now: datetime
) -> None:
    begin_session(database, invite(None), now)
    with database.reading() as connection:
        person = participant_labelled(connection, study_id, "P001")

    def exclude_too() -> None:
        with database.writing() as connection:
            exclude(connection, person, "second", "Eva", now)

    with ThreadPoolExecutor(1) as pool:
        with database.writing() as connection:
            exclude(connection, person, "first", "Eva", now)
            second = pool.submit(exclude_too)
            wait([second], LONG_ENOUGH_S)
        with pytest.raises(ConflictError, match="P001 is excluded already"):
            second.result()
    with database.writing() as connection:
        assert [row["reason"] for row in participant_records(connection, study_id)] == ["first"]
        undo_exclusion(connection, person, "Eva", now)
        exclude(connection, person, "again", "Eva", now)
        assert [row["reason"] for row in exclusion_records(connection, person.id)] == ["again", "first"]
