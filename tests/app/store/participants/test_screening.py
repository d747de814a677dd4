"""A screening whose requests come twice, on either kind of database."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import func, select

from app.errors import GoneError
from app.store.database.engine import Database
from app.store.database.tables import screening_display, screening_test
from app.store.participants.participants import participant_labelled
from app.store.participants.screening import answer_item, end_test, item_to_show, keep_display, states_of
from app.store.trials.deletion import erase
from app.store.trials.sessions import session_by_token
from app.store.trials.trials import void_trial
from app.study.screening.screening import ScreeningOptions
from tests.seeded_studies import NOW, seed_voters

N_PEOPLE = 8
REQUESTS: dict[str, Callable[[Database, int], object]] = {
    "first plate": lambda database, session: item_to_show(database, session, "colour", ScreeningOptions(), NOW),
    "skipped": lambda database, session: end_test(database, session, "acuity", "skipped", NOW),
    "measured": lambda database, session: keep_display(database, session, 0.25, 1080, {}, NOW),
}


@pytest.mark.parametrize("name", REQUESTS)
def test_a_request_that_comes_twice_at_once_is_answered_twice(database: Database, name: str) -> None:
    with ThreadPoolExecutor(4) as pool:
        for voter in seed_voters(database, N_PEOPLE, 2):
            with database.reading() as connection:
                begun = session_by_token(connection, voter.token)
            assert begun is not None
            answers = list(pool.map(REQUESTS[name], [database] * 4, [begun.id] * 4))
            assert answers == [answers[0]] * 4


def test_an_answer_to_a_test_that_was_skipped_meanwhile_is_told_that_it_is_over(database: Database) -> None:
    (voter,) = seed_voters(database, 1, 2)
    with database.reading() as connection:
        begun = session_by_token(connection, voter.token)
    assert begun is not None
    item_to_show(database, begun.id, "colour", ScreeningOptions(), NOW)
    end_test(database, begun.id, "colour", "skipped", NOW)
    assert answer_item(database, begun.id, "colour", 1, 0, 900.0, NOW) is None


@pytest.mark.parametrize("name", REQUESTS)
def test_nothing_is_kept_of_who_was_erased_while_a_request_was_under_way(database: Database, name: str) -> None:
    (voter,) = seed_voters(database, 1, 2)
    with database.writing() as connection:
        begun = session_by_token(connection, voter.token)
        erase(connection, participant_labelled(connection, 1, "P001"), NOW)
    assert begun is not None
    with pytest.raises(GoneError):
        REQUESTS[name](database, begun.id)
    with pytest.raises(GoneError):
        void_trial(database, begun.id, voter.trials[0][0], "hidden", {"shown_ms": 700.0}, NOW)
    with database.reading() as connection:
        kept = [connection.scalar(select(func.count()).select_from(of)) for of in (screening_display, screening_test)]
    assert kept == [0, 0]


def test_a_state_tells_of_each_test_whether_it_began_and_how_much_was_answered(database: Database) -> None:
    (voter,) = seed_voters(database, 1, 2)
    with database.reading() as connection:
        begun = session_by_token(connection, voter.token)
    assert begun is not None

    def states() -> dict[str, tuple[bool, bool, int]]:
        with database.reading() as connection:
            found = states_of(connection, begun.id, ScreeningOptions())
        return {state.test: (state.has_begun, state.is_over, state.n_answered) for state in found}

    item_to_show(database, begun.id, "colour", ScreeningOptions(), NOW)
    assert states() == {"acuity": (False, False, 0), "colour": (True, False, 0)}
    answer_item(database, begun.id, "colour", 1, 0, 900.0, NOW)
    assert states()["colour"] == (True, False, 1)
    end_test(database, begun.id, "colour", "skipped", NOW)
    assert states()["colour"] == (True, True, 1)
