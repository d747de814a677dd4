"""Who may: each gate returns what a route needs, or raises."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from secrets import compare_digest
from typing import Annotated, Literal

from fastapi import Depends, Form, Header, Request
from limits import RateLimitItemPerMinute

from app.errors import ForbiddenError, NoSessionError, NotFoundError, StudyError, UnauthorisedError
from app.settings import Settings
from app.store.audit import STRANGER, Actor, Entry, record_alone
from app.store.designs import has_single_films
from app.store.engine import Database
from app.store.experimenters import Experimenter, Role, is_session_open, open_session
from app.store.invitations import Invitation, invitation_by_code
from app.store.sessions import Session, session_by_token
from app.store.studies import Study, study_by_id, study_by_slug
from app.store.tokens import AUDIT, PERSONAL, READ, token_by_secret
from app.store.vote_writer import VoteWriter
from app.study.options import StudyOptions, parse_options
from app.web.throttle import WRONG_CODES, WRONG_TOKENS, Throttle

log = logging.getLogger(__name__)

NOTED_IDS = ("slug", "label", "trial", "stage", "media")  # in addresses; no codes or links, which let people in
PARTICIPANT_COOKIE = "session"
SESSION_HEADER = "Session-Id"  # a browser's cookie may come to name another session than a page of it shows
EXPERIMENTER_COOKIE = "experimenter"
UPLOAD_PATH = re.compile(r"/admin/(stimuli|studies/[a-z0-9-]+)/upload")
DATA_PATHS = "/api/v1/"  # whole tables and archives
SCOPES_OF_ROLE: dict[Role, tuple[str, ...]] = {
    "viewer": (READ,),
    "experimenter": (READ, PERSONAL, AUDIT),
    "owner": (READ, PERSONAL, AUDIT),
}


State = Literal["open", "mine", "used", "paused", "closed"]


@dataclass(frozen=True)
class Entrance:
    """What stands behind an invitation's address; "mine": this browser's session was begun with it."""

    slug: str
    title: str
    state: State
    is_shared: bool  # another participant may begin with it, after the one at this browser
    options: StudyOptions
    fallback: str  # of the options, where the study has the films for it


@dataclass(frozen=True)
class SignedIn:
    """A session, and the token that its participant holds."""

    session: Session
    token: str


def database(request: Request) -> Database:
    found: Database = request.app.state.database
    return found


def settings(request: Request) -> Settings:
    found: Settings = request.app.state.settings
    return found


def throttle(request: Request) -> Throttle:
    found: Throttle = request.app.state.throttle
    return found


def address(request: Request) -> str:
    """Where a request comes from, to count by; it is kept nowhere."""
    return request.client.host if request.client else "unknown"


def is_secure(request: Request) -> bool:
    """Whether cookies must keep to https."""
    return settings(request).secure_cookies or request.url.scheme == "https"


def vote_writer(request: Request) -> VoteWriter:
    writer: VoteWriter = request.app.state.votes
    return writer


def now(request: Request) -> datetime:
    moment: datetime = request.app.state.clock()
    return moment


async def participant_token(request: Request) -> str:
    """What who asks holds, by bearer token or cookie; whether it opens a session is for the store to say."""
    token = _bearer(request) or request.cookies.get(PARTICIPANT_COOKIE)
    if not token:
        raise NoSessionError
    return token


def participant(request: Request, token: Annotated[str, Depends(participant_token)]) -> SignedIn:
    """The session of who asks; where they say which one they mean, no other."""
    with database(request).reading() as connection:
        session = session_by_token(connection, token)
    if session is None or meant_session(request) not in (None, session.public_id):
        raise NoSessionError
    return SignedIn(session, token)


def meant_session(request: Request) -> str | None:
    """The id of the session that a request is for, where it says so."""
    return request.headers.get(SESSION_HEADER)


@dataclass(frozen=True)
class Reader:
    """Who reads results: the bearer of a token, or a signed-in experimenter."""

    name: str
    scopes: tuple[str, ...]


def reader(request: Request) -> Reader:
    """Who asks, by a bearer token or an experimenter's cookie; not too often."""
    secret = _bearer(request)
    if secret is None:
        person = experimenter(request)
        found = Reader(person.name, SCOPES_OF_ROLE[person.role])
    else:
        with database(request).reading() as connection:
            token = token_by_secret(connection, secret, now(request))
        if token is None:
            throttle(request).count(WRONG_TOKENS, address(request))
            record_alone(database(request), STRANGER, Entry("token refused", subject=request.url.path), now(request))
            raise UnauthorisedError("This token is not known here, has expired or was revoked.")
        found = Reader(f"token {token.name}", token.scopes)
    limit = RateLimitItemPerMinute(settings(request).api_requests_per_minute)
    throttle(request).count(limit, "api", found.name)
    return found


def may_read(scope: str) -> Callable[[Request], Reader]:
    """The gate for those who have a scope."""

    def gate(request: Request) -> Reader:
        found = reader(request)
        if scope not in found.scopes:
            entry = Entry("access refused", subject=request.url.path, detail={"needed": scope})
            record_alone(database(request), found.name, entry, now(request))
            raise ForbiddenError(f"This takes the scope {scope}; yours are {', '.join(found.scopes)}.")
        return found

    return gate


def experimenter(request: Request) -> Experimenter:
    """The experimenter who is signed in by cookie, whatever their role."""
    if (known := getattr(request.state, "person", None)) is not None:  # several gates of one request ask
        person: Experimenter = known
        return person
    token = request.cookies.get(EXPERIMENTER_COOKIE)
    found = open_session(database(request), token, now(request), may_renew=_is_quick(request)) if token else None
    if found is None:
        raise UnauthorisedError(
            "You are not signed in. Use your password, or a sign-in link as `reconstudy admin add NAME` prints it."
        )
    request.state.person = found.experimenter
    request.state.form_token = found.form_token
    if found.renewed:
        request.state.renewed_token = found.renewed
    return found.experimenter


def is_still_signed_in(request: Request) -> bool:
    """Whether the session that a gate let in goes on; for an answer that itself goes on for long."""
    with database(request).reading() as connection:
        return is_session_open(connection, request.state.form_token, now(request))


def _is_quick(request: Request) -> bool:
    """Whether the answer, which brings a new token, comes before the old one ends: else other tabs would be out."""
    path = request.url.path
    return not path.startswith(DATA_PATHS) and UPLOAD_PATH.fullmatch(path) is None


def looking(role: Role) -> Callable[[Request], Experimenter]:
    """The gate of a page that takes a role."""

    def gate(request: Request) -> Experimenter:
        return _with_role(request, role)

    return gate


def acting(role: Role) -> Callable[..., Actor]:
    """The gate of a form that takes a role: who sends it must have been given it."""

    def gate(
        request: Request,
        form_token: Annotated[str, Form(max_length=100)] = "",
        header: Annotated[str, Header(alias="X-CSRF-Token", max_length=100)] = "",
    ) -> Actor:
        return _acting(request, role, form_token or header)

    return gate


def acting_by_header(role: Role) -> Callable[..., Actor]:
    """The gate of a request whose body is a file: the form's token comes in a header."""

    def gate(request: Request, header: Annotated[str, Header(alias="X-CSRF-Token", max_length=100)] = "") -> Actor:
        return _acting(request, role, header)

    return gate


def _acting(request: Request, role: Role, form_token: str) -> Actor:
    person = _with_role(request, role)
    if not compare_digest(form_token.encode(), request.state.form_token.encode()):
        entry = Entry("form refused", subject=request.url.path)
        record_alone(database(request), person.name, entry, now(request))
        raise ForbiddenError("This form is out of date. Load the page again, then repeat your change.")
    return Actor(person.id, person.name, now(request))


def _with_role(request: Request, role: Role) -> Experimenter:
    person = experimenter(request)
    if not person.may(role):
        entry = Entry("access refused", subject=request.url.path, detail={"role": person.role, "needed": role})
        record_alone(database(request), person.name, entry, now(request))
        raise ForbiddenError(f"This takes the role {role}; yours is {person.role}. An owner can change it.")
    return person


def note_refusal(request: Request, action: str, reason: str) -> None:
    """An entry in the audit log on an id or invitation that leads nowhere; not too many of one address."""
    if not throttle(request).limiter.hit(WRONG_CODES, "audit", address(request)):
        return
    person: Experimenter | None = getattr(request.state, "person", None)
    route = getattr(request.scope.get("route"), "path", "")
    given = {name: str(request.path_params[name])[:80] for name in NOTED_IDS if name in request.path_params}
    entry = Entry(action, subject=route, detail={"reason": reason, **given})
    try:
        record_alone(database(request), person.name if person else STRANGER, entry, now(request))
    except StudyError as error:  # the refusal is answered all the same
        log.warning("a refusal could not be noted: %s", error)


def study_called(request: Request, slug: str) -> Study:
    with database(request).reading() as connection:
        found = study_by_slug(connection, slug)
    if found is None:
        raise NotFoundError("There is no such study.")
    return found


def invitation_to(request: Request, slug: str, code: str) -> Invitation:
    """The invitation with this code, if it is one to this study; who guesses codes is slowed down."""
    throttle(request).check(WRONG_CODES, address(request))
    with database(request).reading() as connection:
        invitation = invitation_by_code(connection, code)
        study = study_by_id(connection, invitation.study_id) if invitation else None
    if invitation is None or study is None or study.slug != slug:
        throttle(request).count(WRONG_CODES, address(request))
        raise NotFoundError("There is no such invitation. Please check the code.")
    return invitation


def entrance(request: Request, code: str, *, is_for_another: bool = False) -> Entrance | None:
    """What an invitation's address leads to; None if there is no such invitation. Looking uses nothing up.

    Parameters
    ----------
    is_for_another : whether somebody else than the browser's participant sits down, who begins where a place is left
    """
    with database(request).reading() as connection:
        invitation = invitation_by_code(connection, code)
        study = study_by_id(connection, invitation.study_id) if invitation else None
        token = request.cookies.get(PARTICIPANT_COOKIE)
        session = session_by_token(connection, token) if token else None
        has_singles = study is not None and has_single_films(connection, study.id)
    if invitation is None or study is None:
        return None
    state = _state_for_anybody(study, invitation)
    if session is not None and session.invitation_id == invitation.id and not (is_for_another and state == "open"):
        state = "mine"
    is_shared = study.standing == "open" and invitation.has_places(1 if state == "mine" else 2)
    options = parse_options(study.options)
    return Entrance(study.slug, study.name, state, is_shared, options, options.fallback if has_singles else "")


def _state_for_anybody(study: Study, invitation: Invitation) -> State:
    if study.standing != "open":
        return "paused" if study.standing == "paused" else "closed"
    return "used" if invitation.is_used else "open"


def _bearer(request: Request) -> str | None:
    scheme, _, token = request.headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" and token.strip() else None


async def _database(request: Request) -> Database:  # async, because FastAPI sends a plain function to another thread
    return database(request)


async def _now(request: Request) -> datetime:
    return now(request)


Store = Annotated[Database, Depends(_database)]
Now = Annotated[datetime, Depends(_now)]
ParticipantToken = Annotated[str, Depends(participant_token)]
Participant = Annotated[SignedIn, Depends(participant)]
Person = Annotated[Experimenter, Depends(experimenter)]
Looking = Annotated[Experimenter, Depends(looking("experimenter"))]
Owner = Annotated[Experimenter, Depends(looking("owner"))]
Myself = Annotated[Actor, Depends(acting("viewer"))]
Acting = Annotated[Actor, Depends(acting("experimenter"))]
ActingOwner = Annotated[Actor, Depends(acting("owner"))]
AStudy = Annotated[Study, Depends(study_called)]
