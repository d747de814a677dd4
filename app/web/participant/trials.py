"""Trials over REST: the server decides which comes next."""

from __future__ import annotations

import logging
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response

from app.errors import ConflictError, GoneError
from app.store.studies.film_failures import Failure, note_failure
from app.store.trials.designs import practice_pairs
from app.store.trials.sessions import done_of
from app.store.trials.trials import mark_served, next_trials, void_trial
from app.study.stages import SCREENED_OUT, TIMED_OUT, TRIAL, is_past
from app.web.gates import Now, Participant, Store, browser_of, throttle
from app.web.limits.throttle import REMARKS
from app.web.participant.trial_bodies import (
    MediaView,
    OneTrialView,
    TrialView,
    TroubleBody,
    VoidBody,
    practice_view,
    trial_media,
    trial_view,
)

N_AHEAD = 5  # films in a browser's memory besides the present one

log = logging.getLogger(__name__)

router = APIRouter(prefix="/api/v1/session", tags=["participants"])


@router.get("/trials/next", response_model=TrialView, responses={204: {"description": "No trial is left"}})
def next_trial(signed_in: Participant, database: Store, now: Now) -> TrialView | Response:
    """Send the trial to show now; the same one until its vote is in. 409: the trials have not begun."""
    session = signed_in.session
    if session.has_withdrawn:
        raise GoneError("You have withdrawn from the study. Thank you for the time you gave.")
    if session.stage in (SCREENED_OUT, TIMED_OUT) or is_past(TRIAL, session.stage):
        return Response(status_code=204)
    if session.stage != TRIAL:
        raise ConflictError(f"The trials have not begun: the session is in the stage {session.stage}.")
    with database.reading() as connection:
        upcoming = next_trials(connection, session.id)
        done = done_of(connection, session.id)
    if not upcoming:  # the last vote arrived since the session was read
        return Response(status_code=204)
    if any(trial.served_at is None for trial in upcoming):
        mark_served(database, [trial.id for trial in upcoming], now)
    views = [trial_view(session, upcoming_trial, done, ahead) for ahead, upcoming_trial in enumerate(upcoming)]
    following = views[1] if len(views) > 1 else None
    return TrialView(**dict(views[0]), next_media=following.media.url if following else None, following=following)


@router.get("/films")
def films_ahead(signed_in: Participant, database: Store) -> list[MediaView]:
    """List the films of the next trials in order, to be fetched before they are due, from the instructions on."""
    session = signed_in.session
    if session.has_withdrawn or session.stage in (SCREENED_OUT, TIMED_OUT):
        return []
    with database.reading() as connection:
        return [trial_media(session, upcoming) for upcoming in next_trials(connection, session.id, N_AHEAD)]


@router.get("/practice")
def practice(signed_in: Participant, database: Store) -> list[OneTrialView]:
    """List the practice trials, if the study has any; their results are sent when the practice stage completes."""
    session = signed_in.session
    with database.reading() as connection:
        pairs = practice_pairs(connection, session.study_id)
    return [practice_view(session, pair, len(pairs)) for pair in pairs]


@router.put("/trials/{trial}/void", status_code=204)
def void(
    trial: Annotated[str, Path(max_length=32)], body: VoidBody, signed_in: Participant, database: Store, now: Now
) -> None:
    """Say that a trial was interrupted: it comes once more at the end. 409: it has a vote, or came again already."""
    if signed_in.session.has_withdrawn:
        raise GoneError("You have withdrawn from the study.")
    if void_trial(database, signed_in.session.id, trial, body.reason, body.viewing, now):
        log.info("session %s: trial %s interrupted (%s)", signed_in.session.public_id, trial, body.reason)


@router.put("/trials/{trial}/trouble", status_code=204)
def note_trouble(
    trial: Annotated[str, Path(max_length=32)],
    body: TroubleBody,
    request: Request,
    signed_in: Participant,
    database: Store,
    now: Now,
) -> None:
    """Say that a trial's film could not be shown: an alarm for the experimenters, and many pause the study.

    The trial comes again; `stopped` of the session says when that leads nowhere.
    """
    session = signed_in.session
    throttle(request).count(REMARKS, "remark", session.public_id)
    failure = Failure(trial, body.why, browser_of(request) or "")
    with database.writing() as connection:
        is_paused = note_failure(connection, session.study_id, session.id, failure, now)
    request.app.state.metrics.film_failures.inc()
    if is_paused:
        log.error("study %s: paused, as films fail for many people", session.slug)
    log.warning("session %s: the film of a trial was not shown", signed_in.session.public_id)  # why stands at the alarm
