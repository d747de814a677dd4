"""Begin a session over REST, go on with one in another browser, or be turned away."""

from __future__ import annotations

import logging
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Path, Request, Response
from limits import RateLimitItemPerMinute

from app.errors import ChangedError, InvalidError, NotFoundError
from app.store.database.engine import Database
from app.store.studies.images import image_digests
from app.store.studies.studies import Study, study_by_id
from app.store.trials.admission import Admission, admit
from app.store.trials.sessions import resume_session
from app.study.options.options import parse_options
from app.study.options.wording import Wording, offered_languages, wording
from app.web.gates import (
    PARTICIPANT_COOKIE,
    Now,
    Store,
    address,
    cookie,
    invitation_to,
    languages,
    set_cookie,
    settings,
    throttle,
)
from app.web.limits.throttle import REMARKS, WRONG_CODES
from app.web.participant.session_bodies import (
    AdmissionBody,
    OpenedSessionView,
    Resumption,
    TurnedAwayBody,
    present_view,
)

COOKIE_LASTS_S = 30 * 24 * 3600  # longer than a participant may take to come back

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
    throttle(request).count(limit, "begin", address(request))
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
    """Say that a browser or device cannot take part in a study, for the log; its invitation stays unused."""
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


def remember(request: Request, response: Response, token: str) -> None:
    """Set the cookie of a participant's session; no script can read it."""
    set_cookie(request, response, PARTICIPANT_COOKIE, token, lasts_s=COOKIE_LASTS_S)


def _opened(request: Request, response: Response, database: Database, token: str, now: datetime) -> OpenedSessionView:
    remember(request, response, token)
    is_page = not {"origin", "sec-fetch-site"}.isdisjoint(request.headers)  # which has the cookie, and tells no script
    view = present_view(database, token, now)
    return OpenedSessionView(**dict(view), token=None if is_page else token)
