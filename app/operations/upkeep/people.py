"""Change what is kept of a participant: exclude, withdraw, erase, give a new code; the audit log says who did."""

from __future__ import annotations

from collections.abc import Mapping

from app.errors import ConflictError, InvalidError
from app.operations.upkeep.erasure import erase_participant
from app.settings import Settings
from app.store.database.engine import Database
from app.store.participants.exclusions import AGAIN
from app.store.participants.interviews import keep_spoken, spoken_of
from app.store.participants.participants import (
    check_not_erased,
    exclude,
    exclusion_records,
    participant_labelled,
    undo_exclusion,
    withdraw_participant,
)
from app.store.participants.recruits import let_in_again
from app.store.participants.screening import enter_result
from app.store.studies.audit import Actor
from app.store.studies.studies import Study
from app.store.trials.sessions import new_resume_code
from app.study.options.options import parse_options
from app.study.questions.questionnaire import LONGEST_ANSWER
from app.study.screening.screening import EnteredResult, check_entered

NOTHING_SHOWN: Mapping[str, str] = {}


def exclude_person(database: Database, study: Study, label: str, reason: str, actor: Actor) -> None:
    """Leave a participant's votes out of the analysis; ConflictError where they are left out already."""
    with database.writing() as connection:
        exclude(connection, participant_labelled(connection, study.id, label), reason, actor.name, actor.now)
        actor.note(connection, "participant excluded", study, label)  # the reason stands where an erasure takes it


def include_person(database: Database, study: Study, label: str, actor: Actor) -> None:
    """Count a participant's votes again; ConflictError where they count."""
    with database.writing() as connection:
        undo_exclusion(connection, participant_labelled(connection, study.id, label), actor.name, actor.now)
        actor.note(connection, "exclusion undone", study, label)


def let_take_part_again(database: Database, study: Study, label: str, actor: Actor) -> None:
    """Let somebody begin anew by the same link; what they gave before stays, and counts no more.

    Raises
    ------
    ConflictError
        If they were let in again before: a second place would let one person count twice.
    """
    with database.writing() as connection:
        person = participant_labelled(connection, study.id, label)
        check_not_erased(connection, person.id)
        for known in exclusion_records(connection, person.id):
            if known["undone_at"] is None and known["reason"] == AGAIN:
                raise ConflictError(f"{label} may take part again already, by the same link.")
            if known["undone_at"] is None:  # it stays in the history
                undo_exclusion(connection, person, actor.name, actor.now)
        exclude(connection, person, AGAIN, actor.name, actor.now)
        let_in_again(connection, person.id, label)
        actor.note(connection, "participant let in again", study, label)


def withdraw_person(database: Database, study: Study, label: str, actor: Actor) -> None:
    """Withdraw a participant, which nothing undoes."""
    with database.writing() as connection:
        withdraw_participant(connection, participant_labelled(connection, study.id, label), actor.now)
        actor.note(connection, "participant withdrawn", study, label)


def erase_person(settings: Settings, database: Database, study: Study, label: str, actor: Actor) -> None:
    """Delete what a participant gave, for good; ConflictError where they were erased before."""
    with database.reading() as connection:
        person = participant_labelled(connection, study.id, label)
    erase_participant(settings, database, study, person, actor)


def renew_code(database: Database, study: Study, label: str, actor: Actor) -> str:
    """Make a new code by which a participant goes on, and return it; it is kept nowhere."""
    with database.writing() as connection:
        code = new_resume_code(connection, participant_labelled(connection, study.id, label).id)
        actor.note(connection, "new code to go on", study, label)
    return code


def enter_screening(database: Database, study: Study, label: str, entered: EnteredResult, actor: Actor) -> None:
    """Keep the result of a test beside the screen, such as a printed chart; earlier ones stay.

    Raises
    ------
    InvalidError
        If the study's screening takes no such result.
    """
    try:
        check_entered(entered, parse_options(study.options).screening)
    except ValueError as error:
        raise InvalidError(f"Nothing was entered: {error}.") from error
    with database.writing() as connection:
        participant = participant_labelled(connection, study.id, label)
        check_not_erased(connection, participant.id)
        enter_result(connection, participant.id, entered, actor.name, actor.now)
        actor.note(connection, "screening result entered", study, label, test=entered.test)


def note_interview(
    database: Database,
    study: Study,
    label: str,
    noted: Mapping[str, str],
    actor: Actor,
    shown: Mapping[str, str] = NOTHING_SHOWN,
) -> None:
    """Keep what a participant said in the spoken interview; a question that is not noted keeps its answer.

    Parameters
    ----------
    noted : answers by question
    shown : the answers as whoever notes saw them; one that is unchanged was not noted here

    Raises
    ------
    InvalidError
        If the study does not ask a question, or an answer is too long.
    ConflictError
        If somebody else has noted another answer meanwhile.
    """
    with database.writing() as connection:
        participant = participant_labelled(connection, study.id, label)
        check_not_erased(connection, participant.id)
        kept = spoken_of(connection, participant.id)
        known = {*parse_options(study.options).spoken_questions, *kept}
        changed = {asked: said for asked, said in noted.items() if said != shown.get(asked)}
        if unknown := sorted(set(changed) - known):
            raise InvalidError(f"This study does not ask {unknown[0]!r:.80}.")
        if long := [asked for asked, said in changed.items() if len(said) > LONGEST_ANSWER]:
            raise InvalidError(f"The answer to {long[0]!r:.80} is longer than {LONGEST_ANSWER} characters.")
        others = {asked for asked, said in shown.items() if kept.get(asked, "") not in (said, changed.get(asked))}
        if lost := sorted(others & changed.keys()):
            raise ConflictError(f"Somebody else has noted something on {lost[0]!r:.80} meanwhile. Nothing was kept.")
        keep_spoken(connection, participant.id, changed, actor.name, actor.now)
        actor.note(connection, "interview noted", study, label)
