"""What is deleted is gone, and the rest stays: of people, and of studies, on either kind of database."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor, wait
from datetime import timedelta

import pytest
from sqlalchemy import Table, func, insert, select, update

from app.errors import ConflictError, InvalidError
from app.store.database.engine import Database
from app.store.database.tables import (
    exclusion,
    invitation,
    participant,
    recruit,
    screening_display,
    session,
    spoken_answer,
    stage_record,
    study,
    trial_comment,
)
from app.store.participants.comments import CommentPlace, keep_trial_comment, tag_comment, tag_names
from app.store.participants.participants import everything_of, participant_labelled
from app.store.studies.studies import set_standing
from app.store.trials.deletion import delete_study, erase, forget_people, studies_to_forget
from app.store.trials.sessions import session_by_token
from tests.app.store.trials.test_designs import OTHER_FILMS, insert_film
from tests.seeded_studies import NOW, seed_voters

WAIT_S = 0.5  # an erasure that waits for nobody is done long before
KEEPS = {"privacy": {"keep_days": 10}}


def test_a_note_that_is_being_written_goes_with_the_person_who_is_erased(database: Database) -> None:
    voter = seed_voters(database, 1, 2)[0]
    (trial_id, _), *_ = voter.trials

    def erase_them() -> None:
        with database.writing() as connection:
            erase(connection, participant_labelled(connection, 1, "P001"), NOW)

    with ThreadPoolExecutor(1) as pool:
        with database.writing() as connection:
            keep_trial_comment(connection, 1, trial_id, "Ada sighed.", "Eva", NOW)
            erasure = pool.submit(erase_them)
            wait([erasure], WAIT_S)
        erasure.result()
    with database.reading() as connection:
        assert connection.scalar(select(func.count()).select_from(trial_comment)) == 0
    with database.writing() as connection, pytest.raises(InvalidError, match="P001 was erased"):
        keep_trial_comment(connection, 1, trial_id, "Ada sighed.", "Eva", NOW)
    with pytest.raises(ConflictError, match="P001 was erased before"):
        erase_them()


def test_a_tag_goes_with_the_last_person_whose_comments_bear_it(database: Database) -> None:
    voters = seed_voters(database, 2, 2)
    with database.writing() as connection:
        for label, voter, tags in zip(("P001", "P002"), voters, (("shared", "of one"), ("shared",)), strict=True):
            (trial_id, _), *_ = voter.trials
            keep_trial_comment(connection, 1, trial_id, "Ada sighed.", "Eva", NOW)
            for tag in tags:
                tag_comment(connection, 1, CommentPlace(label, "trial", trial_id), tag, "Eva", NOW)
        erase(connection, participant_labelled(connection, 1, "P001"), NOW)
        assert tag_names(connection, 1) == ["shared"]
        forget_people(connection, 1, NOW)
        assert tag_names(connection, 1) == []


def test_what_leads_to_a_person_is_deleted_and_votes_stay(database: Database) -> None:
    voter = seed_voters(database, 2, 3)[0]
    by = {"experimenter": "Eva", "written_at": NOW}
    with database.writing() as connection:
        begun = session_by_token(connection, voter.token)
        assert begun is not None
        one = {"session_id": begun.id}
        connection.execute(insert(stage_record).values(**one, stage="interview", data={"a": 1}, completed_at=NOW))
        connection.execute(insert(spoken_answer).values(**one, question="Why?", answer="So.", **by))
        measured = {"pixel_mm": 0.25, "height_px": 1080, "measured": {}, "measured_at": NOW}
        connection.execute(insert(screening_display).values(**one, **measured))
        person = connection.execute(select(session.c.participant_id).where(session.c.id == begun.id)).scalar_one()
        came = {"study_id": begun.study_id, "participant_id": person, "outside_id": "5f2a", "kept": {}}
        connection.execute(insert(recruit).values(**came, completion_code=""))
        left_out = {"participant_id": person, "reason": "asleep", "excluded_by": "Eva", "excluded_at": NOW}
        connection.execute(insert(exclusion).values(**left_out))
        connection.execute(update(invitation).values(label="Ada Lovelace"))
        forget_people(connection, begun.study_id, NOW)
    with database.reading() as connection:
        for table in (stage_record, spoken_answer, screening_display, recruit):
            assert connection.scalar(select(func.count()).select_from(table)) == 0, table.name
        assert connection.scalar(select(func.count()).select_from(exclusion)) == 1
        assert set(connection.scalars(select(invitation.c.label))) == {""}
        assert session_by_token(connection, voter.token) is None
        assert set(connection.scalars(select(session.c.stage))) == {"timed_out"}
        kept = everything_of(connection, participant_labelled(connection, begun.study_id, "P001"))
        assert {name for name, rows in kept.items() if rows} == {
            "participant",
            "session",
            "assignment",
            "trial",
            "exclusion",
        }


def test_the_days_count_from_when_the_study_was_closed_and_end_when_it_is_opened_again(database: Database) -> None:
    seed_voters(database, 1, 2)
    later = NOW + timedelta(days=11)
    with database.writing() as connection:
        study_id = connection.execute(update(study).values(options=KEEPS).returning(study.c.id)).scalar_one()
        assert studies_to_forget(connection, later) == []
        set_standing(connection, study_id, "closed", NOW)
        set_standing(connection, study_id, "archived", NOW + timedelta(days=5))  # does not count anew
        assert studies_to_forget(connection, NOW + timedelta(days=9)) == []
        assert [each.id for each in studies_to_forget(connection, later)] == [study_id]
        set_standing(connection, study_id, "open", later)
        assert studies_to_forget(connection, later + timedelta(days=99)) == []
        until = {**KEEPS, "limits": {"open_until": NOW.isoformat()}}
        connection.execute(update(study).values(options=until))
        assert [each.id for each in studies_to_forget(connection, later)] == [study_id]
        forget_people(connection, study_id, later)
        assert studies_to_forget(connection, later + timedelta(days=99)) == []
        longer = {**KEEPS, "limits": {"open_until": later.isoformat()}}  # others came since
        connection.execute(update(study).values(options=longer))
        assert studies_to_forget(connection, later + timedelta(days=9)) == []
        assert [each.id for each in studies_to_forget(connection, later + timedelta(days=10))] == [study_id]
        assert connection.scalar(select(func.count()).select_from(participant)) == 1


@pytest.mark.parametrize(("table", "more"), OTHER_FILMS)
def test_the_other_films_of_a_deleted_study_are_deleted(
    database: Database, study_id: int, table: Table, more: dict[str, str]
) -> None:
    with database.writing() as connection:
        insert_film(connection, study_id, table, more)
        delete_study(connection, study_id)
        assert connection.execute(select(func.count()).select_from(table)).scalar_one() == 0
