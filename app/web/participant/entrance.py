"""What a participant finds at an invitation's address, or at a recruiting platform's link to it."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal
from urllib.parse import quote

from fastapi import Request
from fastapi.responses import RedirectResponse
from starlette.datastructures import QueryParams

from app.store.database.engine import Transaction
from app.store.database.keys import typed_code
from app.store.participants.invitations import Invitation, invitation_by_code
from app.store.participants.recruits import recruit_of_session, session_of_outside_id
from app.store.studies.images import image_digests
from app.store.studies.studies import Study, study_by_id
from app.store.trials.admission import WhyClosed, why_closed
from app.store.trials.designs import has_single_films, largest_film
from app.store.trials.orders import most_trials
from app.store.trials.sessions import Session, session_by_token, stage_of
from app.study.options.duration import stage_minutes
from app.study.options.options import StudyOptions, parse_options
from app.study.options.recruiting import Arrival
from app.study.stages import ENDS
from app.study.trial.technique import WEBCODECS
from app.web.gates import PARTICIPANT_COOKIE, cookie, database, now
from app.web.once import Shared

log = logging.getLogger(__name__)
_announced: Shared[Mapping[str, float]] = Shared(64)  # minutes of studies

State = Literal["open", "mine", "known", "used", "paused", "closed", "full", "bad_link", "begun_elsewhere"]


@dataclass(frozen=True)
class Entrance:
    """What an invitation's address leads to; "mine": this browser's session was begun with the invitation;
    "known": the link's outside id has a session."""

    slug: str
    title: str
    state: State
    language: str | None  # of this browser's session, where it has one
    is_shared: bool  # whether another participant may begin at this browser
    options: StudyOptions
    fallback: str  # the option, empty where the study lacks the films for it
    images: Mapping[str, str]  # SHA-256 by name
    outside: Mapping[str, str]  # the link's parameters by which a recruiting platform says who comes
    no_consent_url: str  # where to go without consent; empty: nowhere
    full_url: str  # where to go from a study that takes in nobody more; empty: nowhere
    film_size: tuple[int, ...]  # display's pixels, where the films need as many; else empty
    is_named: bool  # does the invitation bear a label for one participant?
    minutes: Mapping[str, float]  # that each stage takes, for the consent; empty where there is none to give
    is_preview: bool  # does this browser hold an experimenter's walk through the study?
    has_ended: bool  # has the session ended to which the link leads?


def see_invitation(code: str) -> RedirectResponse:
    """Redirect to an invitation's page; a code may be typed in capitals or in groups."""
    return RedirectResponse(f"/s/{quote(typed_code(code), safe='')}", status_code=303)


def entrance(request: Request, code: str, *, is_for_another: bool = False) -> Entrance | None:
    """Look up what an invitation's address leads to, without using it; None if there is no such invitation.

    Parameters
    ----------
    is_for_another : whether a new participant sits at this browser, who begins if a place is left
    """
    with database(request).reading() as connection:
        invitation = invitation_by_code(connection, code)
        study = study_by_id(connection, invitation.study_id) if invitation else None
        if invitation is None or study is None:
            return None
        token = cookie(request, PARTICIPANT_COOKIE)
        session = session_by_token(connection, token) if token else None
        images = image_digests(connection, study.id)
        has_singles = has_single_films(connection, study.id)
        state: State = _used_or(why_closed(connection, study, now(request)), invitation)
        options = parse_options(study.options)
        if options.outside.id:
            state, arrival = _state_of_link(request, connection, study, session, state)
        else:
            arrival = None
            is_mine = session is not None and session.invitation_id == invitation.id
            state = "mine" if is_mine and not (is_for_another and state == "open") else state
        film_size = largest_film(connection, study.id) if options.pixels == "1:1" else ()
        minutes = _minutes(request, connection, study, options) if options.consent else {}
        has_ended = state == "known" and arrival is not None and _has_ended(connection, study, arrival)
    places = invitation.has_places(1 if state == "mine" else 2)
    return Entrance(
        slug=study.slug,
        title=study.name,
        state=state,
        language=session.language if session is not None and state == "mine" else None,
        is_shared=study.standing == "open" and places and not options.outside.id,
        options=options,
        images=images,
        fallback=_technique(options) if has_singles else "",
        outside={options.outside.id: arrival.outside_id, **arrival.kept} if arrival else {},
        no_consent_url=options.outside.address("no_consent", arrival),
        full_url=options.outside.address("full", arrival),
        film_size=film_size,
        is_named=invitation.is_named,
        minutes=minutes,
        is_preview=session is not None and state == "mine" and session.is_preview,
        has_ended=has_ended,
    )


def _technique(options: StudyOptions) -> str:
    return options.fallback if options.has_pair_films else WEBCODECS


def _has_ended(connection: Transaction, study: Study, arrival: Arrival) -> bool:
    known = session_of_outside_id(connection, study.id, arrival.outside_id)
    return known is not None and stage_of(connection, known) in ENDS


def _minutes(request: Request, connection: Transaction, study: Study, options: StudyOptions) -> Mapping[str, float]:
    """Estimate how long each stage takes, once for a study as it is: with thousands of pairs it takes a moment."""
    known = f"{database(request).engine.url} {study.id} {study.created_at} {study.revision}"
    return _announced.get(known, lambda: stage_minutes(options, most_trials(connection, study), study.exposure_s))


def _used_or(why: WhyClosed | None, invitation: Invitation) -> State:
    return why or ("used" if invitation.is_used else "open")


def _state_of_link(
    request: Request, connection: Transaction, study: Study, session: Session | None, for_anybody: State
) -> tuple[State, Arrival | None]:
    """Return what a recruiting platform's link leads to, and who comes by it.

    A page that is loaded again has lost the link's parameters: then the cookie says who it is. Another id than the
    cookie's is another person at this browser.
    """
    options = parse_options(study.options).outside
    recruit = recruit_of_session(connection, session.id) if session is not None else None
    held = recruit.arrival if recruit and session and session.study_id == study.id else None
    if session is not None and session.study_id == study.id and options.id not in request.query_params:
        return "mine", held  # or a preview, which nobody sent
    try:
        _check_said_once(request.query_params, (options.id, *options.keep))
        arrival = options.arrival(request.query_params)
    except ValueError as error:
        log.warning("study %s: a recruiting platform's link is refused: %s", study.slug, error)
        return "bad_link", None
    assert arrival is not None, "the study has an id"
    if held is not None and held.outside_id == arrival.outside_id and held.kept == arrival.kept:
        return "mine", held
    if session_of_outside_id(connection, study.id, arrival.outside_id) is None:
        return for_anybody, arrival
    is_here = held is not None and held.outside_id == arrival.outside_id  # with other parameters, which are kept anew
    return ("known" if options.resume == "anywhere" or is_here else "begun_elsewhere"), arrival


def _check_said_once(parameters: QueryParams, names: Iterable[str]) -> None:
    """Refuse a link that gives a parameter two values: it is not known who comes."""
    for name in names:
        if len(set(parameters.getlist(name))) > 1:
            raise ValueError(f"{name} stands twice in the link, with different values")
