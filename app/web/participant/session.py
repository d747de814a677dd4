"""A participant's session over REST: begin, resume, look, complete a stage."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict
from datetime import datetime, timedelta
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request, Response
from fastapi.responses import JSONResponse
from limits import RateLimitItemPerMinute

from app.errors import ChangedError, ConflictError, InvalidError, NotFoundError
from app.operations.erasure import erase_participant
from app.store.admission import Admission, admit
from app.store.audit import PARTICIPANT, Actor
from app.store.engine import Database, Transaction
from app.store.images import image_digests
from app.store.keys import resume_code
from app.store.own_data import own_data
from app.store.participants import person_of_session
from app.store.recruits import recruit_of_session
from app.store.sessions import (
    Session,
    complete_stage,
    done_of,
    last_answer_at,
    resume_session,
    session_by_token,
    withdraw,
)
from app.store.studies import Study, study_by_id
from app.study.comprehension import is_understood
from app.study.duration import stage_minutes
from app.study.options import parse_options
from app.study.questionnaire import LONGEST_ANSWER, MOST_QUESTIONS
from app.study.recruiting import Ending
from app.study.stage_data import InvalidStageError, check_stage_data, consent_to_send
from app.study.stages import FINISHED, INTERVIEW, SCREENED_OUT, TRIAL, IllegalMoveError
from app.study.wording import DEBRIEFING, NAME, Wording, first_language, offered_languages, own_texts, wording
from app.web.gates import (
    PARTICIPANT_COOKIE,
    Now,
    Participant,
    Store,
    address,
    cookie,
    invitation_to,
    languages,
    set_cookie,
    settings,
    throttle,
)
from app.web.limits.connections import network_of
from app.web.limits.throttle import REMARKS, WRONG_CODES
from app.web.markdown import render_markdown
from app.web.participant.session_bodies import (
    OWN_DATA,
    AdmissionBody,
    AskedView,
    ComprehensionBody,
    ComprehensionView,
    EndingView,
    ErasureBody,
    OpenedSessionView,
    ProgressView,
    Resumption,
    SessionView,
    StageData,
    StudyView,
    TurnedAwayBody,
)

COOKIE_LASTS_S = 30 * 24 * 3600  # longer than a participant may take to come back
LONG_ABSENCE = timedelta(minutes=30)  # then the page shows the instructions again
LARGEST_KEPT_LETTER = 6  # bytes of a character in UTF-8, or escaped in JSON: \u0007
LARGEST_INTERVIEW = MOST_QUESTIONS * (LARGEST_KEPT_LETTER * LONGEST_ANSWER + 100)  # bytes, with the questions' names
LARGEST_STAGE_DATA = 200 * 1024  # bytes, of any other stage; pages send a few hundred

ENDING_OF: dict[str, Ending] = {FINISHED: "complete", SCREENED_OUT: "screened_out"}

log = logging.getLogger(__name__)
router = APIRouter(prefix="/api/v1", tags=["participants"])

Slug = Annotated[str, Path(max_length=64, pattern=r"^[a-z0-9-]+$", examples=["temple"])]


@router.post("/studies/{slug}/sessions", status_code=201)
def begin(
    slug: Slug, admission: AdmissionBody, request: Request, response: Response, database: Store, now: Now
) -> OpenedSessionView:
    """Begin a session with an invitation. 404: no such invitation; 410: it is used up; 403: `standing` says whether
    the study pauses, is closed or full.

    With a key, a request whose answer was lost may be sent again: 200 with the same session. An outside id that has
    begun before leads to its session: 200; the older token ends. 422: the study needs an outside id.
    """
    invitation = invitation_to(request, slug, admission.invitation)
    limit = RateLimitItemPerMinute(settings(request).sessions_per_minute)
    throttle(request).count(limit, "begin", network_of(address(request)))
    with database.reading() as connection:
        study = study_by_id(connection, invitation.study_id)
    assert study is not None, "an invitation is to a study"
    try:
        arrival = parse_options(study.options).outside.arrival(admission.outside)
    except ValueError as error:
        raise InvalidError(f"Please open the link on the platform that invited you: {error}.") from error
    shown = _wording(request, database, study, admission)
    held = cookie(request, PARTICIPANT_COOKIE)
    admitted = admit(database, invitation, Admission(admission.key, arrival, held, shown), now)
    response.status_code = 201 if admitted.is_new else 200
    return _opened(request, response, database, admitted.token, now)


def _wording(request: Request, database: Database, study: Study, admission: AdmissionBody) -> Wording | None:
    """Return all texts of the study in the language that the page was read in.

    Raises
    ------
    InvalidError
        If the study is not offered in this language.
    ChangedError
        If the texts are others than the page's.
    """
    if admission.language is None:
        return None
    packs, options = languages(request), parse_options(study.options)
    offered = offered_languages(options, packs)
    if admission.language not in offered:
        raise InvalidError(
            f"This study is not offered in {admission.language!r}; expected one of {', '.join(offered)}."
        )
    with database.reading() as connection:
        images = image_digests(connection, study.id)
    shown = wording(packs[admission.language], options, study.name, images)
    if admission.texts_sha256 not in (None, shown.sha256):
        raise ChangedError("The study's texts have changed meanwhile. Please load the page again.")
    return shown


@router.post("/studies/{slug}/turned-away", status_code=204)
def turn_away(slug: Slug, body: TurnedAwayBody, request: Request) -> None:
    """Say that a browser cannot show a study's films, for the log; its invitation stays unused."""
    invitation_to(request, slug, body.invitation)
    browser = request.headers.get("user-agent", "")[:200]
    throttle(request).count(REMARKS, "remark", address(request))
    log.warning("study %s: turned away (%s): %r", slug, body.why, browser)


@router.post("/session/resume")
def resume(
    resumption: Resumption, request: Request, response: Response, database: Store, now: Now
) -> OpenedSessionView:
    """Go on with a session in another browser; the session's older token and resume code end.

    With a key, a request whose answer was lost may be sent again, until the new code is used.
    """
    throttle(request).check(WRONG_CODES, address(request))
    token = resume_session(database, resumption.resume_code, resumption.key)
    if token is None:
        throttle(request).count(WRONG_CODES, address(request))
        raise NotFoundError("There is no session with this code. Please check it.")
    return _opened(request, response, database, token, now)


@router.get("/session")
def look(signed_in: Participant, database: Store, now: Now) -> SessionView:
    """The stage of the session and how far it is."""
    return SessionView(**_view(database, signed_in.session, signed_in.token, now))


@router.get("/session/asked")
def asked(request: Request, signed_in: Participant) -> AskedView:
    """What the introduction's and the interview's completion must hold."""
    options = signed_in.session.options
    consent = consent_to_send(options, _language(request, signed_in.session))
    questions = [asdict(question) for question in options.questions]
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
    understood = is_understood(body.answer, signed_in.session.options.protocol)
    if not understood:
        log.info("session %s: the instructions were not understood (%s)", signed_in.session.public_id, body.answer)
    return ComprehensionView(understood=understood)


@router.put("/session/withdrawal")
def leave(signed_in: Participant, database: Store, now: Now) -> SessionView:
    """Withdraw from the study, at any time and for good. What was given is kept apart and counts no more."""
    withdraw(database, signed_in.session, now)
    log.info("session %s: withdrawn", signed_in.session.public_id)
    return SessionView(**_view(database, _reread(database, signed_in.token), signed_in.token, now))


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
    return SessionView(**_view(database, _reread(database, signed_in.token), signed_in.token, now))


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


def remember(request: Request, response: Response, token: str) -> None:
    """Set the cookie of a participant's session; no script can read it."""
    set_cookie(request, response, PARTICIPANT_COOKIE, token, lasts_s=COOKIE_LASTS_S)


def _opened(request: Request, response: Response, database: Database, token: str, now: datetime) -> OpenedSessionView:
    remember(request, response, token)
    is_page = not {"origin", "sec-fetch-site"}.isdisjoint(request.headers)  # which has the cookie, and tells no script
    told = None if is_page else token
    return OpenedSessionView(**_view(database, _reread(database, token), token, now), token=told)


def _reread(database: Database, token: str) -> Session:
    with database.reading() as connection:
        session = session_by_token(connection, token)
    assert session is not None, "it was there in the transaction before"
    return session


def _view(database: Database, session: Session, token: str, now: datetime) -> dict[str, Any]:
    with database.reading() as connection:
        done = done_of(connection, session.id)
        answered_at = last_answer_at(connection, session.id)
        ending = _ending(connection, session)
        images = image_digests(connection, session.study_id) if session.stage == FINISHED else {}
    said = own_texts(session.options, session.language or first_language(session.options))
    debriefing = str(said.get(DEBRIEFING, "")) if session.stage == FINISHED else None
    title = str(said.get(NAME, session.name))
    return {
        "session": session.public_id,
        "study": StudyView(slug=session.slug, title=title, exposure_s=session.exposure_s),
        "stage": session.stage,
        "stages": list(session.options.way),
        "progress": ProgressView(done=done.n_done, total=done.n_total),
        "minutes": stage_minutes(session.options, done.n_total, session.exposure_s),
        "language": session.language,
        "was_away_long": session.stage == TRIAL and answered_at is not None and now - answered_at > LONG_ABSENCE,
        "resume_code": resume_code(token),
        "debriefing": debriefing,
        "debriefing_html": None if debriefing is None else str(render_markdown(debriefing, images)),
        "ending": ending,
    }


def _ending(connection: Transaction, session: Session) -> EndingView | None:
    """Return where a session's participant goes, with the completion code of who has finished."""
    if session.stage not in ENDING_OF:
        return None
    options = session.options.outside
    recruit = recruit_of_session(connection, session.id)
    if options.is_on and recruit is None:  # a preview
        return None
    ending = ENDING_OF[session.stage]
    code = (recruit.completion_code if recruit else "") or options.code if ending == "complete" else ""
    url = options.address(ending, recruit.arrival if recruit else None, code)
    if not code and not url:
        return None
    return EndingView(code=code or None, url=url or None, after_s=options.redirect_after_s)
