"""A participant's session over REST: look, complete a stage, withdraw, erase or export what was given."""

from __future__ import annotations

import json
import logging
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request
from fastapi.responses import JSONResponse

from app.errors import ConflictError, InvalidError, NotFoundError
from app.operations.upkeep.erasure import erase_participant
from app.store.participants.participants import person_of_session
from app.store.studies.audit import PARTICIPANT, Actor
from app.store.studies.studies import study_by_id
from app.store.trials.own_data import own_data
from app.store.trials.sessions import (
    Session,
    complete_stage,
    withdraw,
)
from app.study.options.stage_data import InvalidStageError, check_stage_data, consent_to_send
from app.study.options.wording import first_language, offered_languages
from app.study.questions.comprehension import right_answer
from app.study.questions.questionnaire import LONGEST_ANSWER, MOST_QUESTIONS
from app.study.stages import INTERVIEW, IllegalMoveError
from app.web.gates import (
    Now,
    Participant,
    Store,
    languages,
    settings,
)
from app.web.participant.session_bodies import (
    OWN_DATA,
    AskedView,
    ComprehensionBody,
    ComprehensionView,
    ErasureBody,
    SessionView,
    StageData,
    present_view,
    session_view,
)

LARGEST_KEPT_LETTER = 6  # bytes of a character in UTF-8, or escaped in JSON: \u0007
LARGEST_INTERVIEW = MOST_QUESTIONS * (LARGEST_KEPT_LETTER * LONGEST_ANSWER + 100)  # bytes, with the questions' names
LARGEST_STAGE_DATA = 200 * 1024  # bytes, of any other stage; pages send a few hundred

log = logging.getLogger(__name__)
router = APIRouter(prefix="/api/v1", tags=["participants"])


@router.get("/session")
def look(signed_in: Participant, database: Store, now: Now) -> SessionView:
    """Show the session's stage and progress."""
    return session_view(database, signed_in.session, signed_in.token, now)


@router.get("/session/asked")
def asked(request: Request, signed_in: Participant) -> AskedView:
    """List what is to be sent when the introduction and the interview are completed."""
    options = signed_in.session.options
    consent = consent_to_send(options, _language(request, signed_in.session))
    questions = [question.as_json() for question in options.questions]
    return AskedView(
        consent=consent,
        comprehension=options.comprehension,
        practice=options.n_practice,
        protocol=options.protocol,
        questions=questions,
    )


@router.put("/session/comprehension")
def mark_comprehension(body: ComprehensionBody, signed_in: Participant) -> ComprehensionView:
    """Mark the answer to the question on the instructions; the page does not know which is right."""
    understood = body.answer == right_answer(signed_in.session.options.protocol)
    if not understood:
        log.info("session %s: the instructions were not understood (%s)", signed_in.session.public_id, body.answer)
    return ComprehensionView(understood=understood)


@router.put("/session/withdrawal")
def leave(signed_in: Participant, database: Store, now: Now) -> SessionView:
    """Withdraw from the study, at any time and for good. What was given is kept apart and counts no more."""
    withdraw(database, signed_in.session, now)
    log.info("session %s: withdrawn", signed_in.session.public_id)
    return present_view(database, signed_in.token, now)


@router.put("/session/erasure", status_code=204)
def erase_own(body: ErasureBody, request: Request, signed_in: Participant, database: Store, now: Now) -> None:  # noqa: ARG001 (it confirms)
    """Withdraw, and have everything that was given deleted for good; the session ends, and nothing leads back to it."""
    session = signed_in.session
    if session.is_preview:  # nothing of it is kept
        withdraw(database, session, now)
        return
    with database.reading() as connection:
        person = person_of_session(connection, session.public_id)
        study = study_by_id(connection, session.study_id)
    assert person is not None, "the session is theirs"
    assert study is not None, "the session is in it"
    erase_participant(settings(request), database, study, person, Actor(0, PARTICIPANT, now))
    log.info("session %s: erased by its participant", session.public_id)


@router.get("/session/export", responses={200: {"content": {"application/json": OWN_DATA}}})
def export(signed_in: Participant, database: Store) -> JSONResponse:
    """Download all that the participant gave, with A and B as they were shown; experimenters' notes are not in it."""
    with database.reading() as connection:
        content = own_data(connection, signed_in.session)
    headers = {"Content-Disposition": f'attachment; filename="{signed_in.session.slug}-{content["participant"]}.json"'}
    return JSONResponse(content, headers=headers)


@router.put("/session/stages/{stage}")
def complete(
    stage: Annotated[str, Path(max_length=40)],
    body: StageData,
    request: Request,
    signed_in: Participant,
    database: Store,
    now: Now,
) -> SessionView:
    """Complete a stage; one that is already behind stays as it was. 409: not the current one, or it ends by itself."""
    if stage not in signed_in.session.options.way:
        raise NotFoundError("There is no such stage.")
    _check_size(stage, body.data)
    try:
        language = _language(request, signed_in.session, body.data.get("language"))
        check_stage_data(stage, body.data, signed_in.session.options, language)
        complete_stage(database, signed_in.session, stage, body.data, now)
    except InvalidStageError as error:
        raise InvalidError(f"This stage is not complete: {error}.") from error
    except IllegalMoveError as error:
        raise ConflictError(f"This stage cannot be completed now: {error}.") from error
    return present_view(database, signed_in.token, now)


def _language(request: Request, session: Session, named: object = None) -> str:
    """Return the language of a session's texts.

    Parameters
    ----------
    named : by the client, for a session that began without a language
    """
    if session.language is not None:
        return session.language
    offered = offered_languages(session.options, languages(request))
    return named if isinstance(named, str) and named in offered else (*offered, first_language(session.options))[0]


def _check_size(stage: str, data: dict[str, Any]) -> None:
    largest = LARGEST_INTERVIEW if stage == INTERVIEW else LARGEST_STAGE_DATA
    try:
        content = json.dumps(data, allow_nan=False, ensure_ascii=False)
    except ValueError as error:
        raise InvalidError(f"What came with this stage is no JSON: {error}.") from error
    if len(content.encode(errors="surrogatepass")) > largest:
        raise InvalidError(f"What came with this stage is longer than {largest} bytes.")
