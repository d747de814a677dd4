"""A participant takes along all that they gave, also what did not count."""

from __future__ import annotations

from dataclasses import replace

from sqlalchemy import insert, select

from app.store.database.engine import Database
from app.store.database.tables import recruit, screening_item, screening_test, session
from app.store.trials.own_data import own_data
from app.store.trials.sessions import session_by_token
from app.store.trials.trials import void_trial
from tests.seeded_studies import NOW, seed_voters


def test_a_look_that_was_interrupted_is_among_the_data_of_who_looked(database: Database) -> None:
    voter = seed_voters(database, 1, 3)[0]
    with database.reading() as connection:
        begun = session_by_token(connection, voter.token)
    assert begun is not None
    viewing = {"first_shown": "a", "shown_ms": 700.0, "switches": []}
    void_trial(database, begun.id, voter.trials[0][0], "hidden", viewing, NOW)
    with database.reading() as connection:
        given = own_data(connection, begun)
    assert given["interrupted"] == [{"void_reason": "hidden", "void_viewing": viewing, "voided_at": NOW.isoformat()}]


def test_an_answer_of_the_screening_says_of_which_test_it_is(database: Database) -> None:
    voter = seed_voters(database, 1, 3)[0]
    with database.writing() as connection:
        begun = session_by_token(connection, voter.token)
        assert begun is not None
        for answer, test in enumerate(("colour", "acuity")):
            values = {"session_id": begun.id, "test": test, "setup": {}, "started_at": NOW}
            test_id = connection.execute(
                insert(screening_test).values(**values).returning(screening_test.c.id)
            ).scalar_one()
            item = {"screening_test_id": test_id, "number": 1, "content": {}, "served_at": NOW, "answer": answer}
            connection.execute(insert(screening_item).values(session_id=begun.id, **item))
        told = own_data(connection, begun)["screening_answers"]
    assert [(answer["test"], answer["answer"]) for answer in told] == [("colour", 0), ("acuity", 1)]


def test_the_completion_code_is_told_at_the_end_alone(database: Database) -> None:
    voter = seed_voters(database, 1, 3)[0]
    with database.writing() as connection:
        begun = session_by_token(connection, voter.token)
        assert begun is not None
        person = connection.execute(select(session.c.participant_id).where(session.c.id == begun.id)).scalar_one()
        came = {"study_id": begun.study_id, "participant_id": person, "outside_id": "5f2a", "kept": {}}
        connection.execute(insert(recruit).values(**came, completion_code="k7m2p9xq4wva"))
    with database.reading() as connection:
        for stage in ("introduction", "trial", "screened_out", "withdrawn", "timed_out"):
            assert own_data(connection, replace(begun, stage=stage))["recruiting"] == [
                {"outside_id": "5f2a", "kept": {}}
            ]
        (told,) = own_data(connection, replace(begun, stage="finished"))["recruiting"]
    assert told["completion_code"] == "k7m2p9xq4wva"
