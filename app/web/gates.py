"""Gates decide who may do what: each returns what a route needs, or raises."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from json import JSONDecodeError
from secrets import compare_digest
from typing import Annotated

from fastapi import Depends, Form, Header, Request
from fastapi.responses import Response
from limits import RateLimitItemPerMinute

from app.errors import ForbiddenError, InvalidError, NoSessionError, NotFoundError, StudyError, UnauthorisedError
from app.settings import Settings
from app.store.audit import STRANGER, Actor, Entry, record_alone
from app.store.engine import Database
from app.store.experimenters import Experimenter, Role, is_session_open, open_session
from app.store.invitations import Invitation, invitation_by_code
from app.store.keys import digest
from app.store.sessions import Session, end_overdue, session_by_token
from app.store.studies import Study, study_by_id, study_by_slug
from app.store.tokens import AUDIT, JOBS, PEOPLE, PERSONAL, READ, STUDIES, token_by_secret
from app.store.vote_writer import VoteWriter
from app.study.language_pack import LanguagePack
from app.study.text import check_text
from app.web.limits.throttle import PIECE, SENT_PIECES, WRONG_CODES, WRONG_TOKENS, Throttle

log = logging.getLogger(__name__)

NOTED_IDS = (
    "slug",
    "label",
    "trial",
    "stage",
    "media",
)  # parts of addresses that the audit log may name: no codes or links, which let people in
PARTICIPANT_COOKIE = "session"
SESSION_HEADER = "Session-Id"  # the session that a page shows; the browser's cookie may name a newer one
EXPERIMENTER_COOKIE = "experimenter"
UPLOAD_PATH = re.compile(r"/admin/((stimuli|studies/[a-z0-9-]+)/upload|files/upload/[0-9a-f]{32})")
DATA_PATHS = "/api/v1/"  # whole tables and archives
NOT_SIGNED_IN = "You are not signed in. Use your password, or a sign-in link as `reconstudy admin add NAME` prints it."
NO_TOKEN = (
    "This takes a token, sent as the header `Authorization: Bearer TOKEN`. An owner makes one in the dashboard under "
    "Tokens, or on the server by `reconstudy token add NAME`."
)
SCOPES_OF_ROLE: dict[Role, tuple[str, ...]] = {
    "viewer": (READ,),
    "experimenter": (READ, PERSONAL, AUDIT, JOBS, STUDIES, PEOPLE),
    "owner": (READ, PERSONAL, AUDIT, JOBS, STUDIES, PEOPLE),
}


@dataclass(frozen=True)
class SignedIn:
    """A session, and the token that its participant holds."""

    session: Session
    token: str


async def check_request_text(request: Request) -> None:
    """Refuse a request whose JSON or form holds text that cannot be stored, before anything reads it."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    try:
        if kind == "application/x-www-form-urlencoded":
            for name, text in (await request.form()).multi_items():  # a name may come more than once
                check_text({name: text})
        elif kind.endswith("json"):
            check_text(await request.json())  # kept by the request, so nothing is read twice
    except (JSONDecodeError, UnicodeDecodeError):
        return  # the route refuses it
    except ValueError as error:
        raise InvalidError(f"This cannot be stored: {error}.") from error


def database(request: Request) -> Database:
    shared: Database = request.app.state.database
    return shared


def languages(request: Request) -> Mapping[str, LanguagePack]:
    """Return the language packs that were complete when the server started, by tag."""
    packs: Mapping[str, LanguagePack] = request.app.state.languages
    return packs


def settings(request: Request) -> Settings:
    shared: Settings = request.app.state.settings
    return shared


def throttle(request: Request) -> Throttle:
    shared: Throttle = request.app.state.throttle
    return shared


def address(request: Request) -> str:
    """Return the client's network address, to count requests by; it is stored nowhere."""
    return request.client.host if request.client else "unknown"


def is_secure(request: Request) -> bool:
    """Whether cookies are sent over https alone."""
    return settings(request).secure_cookies or request.url.scheme == "https"


def cookie(request: Request, name: str) -> str | None:
    """Return the value of a cookie that `set_cookie` has set."""
    return request.cookies.get(_cookie_name(name, is_https=is_secure(request)))


def set_cookie(answer: Response, name: str, value: str, *, is_https: bool, lasts_s: int | None = None) -> None:
    """Set a cookie that no script can read; without `lasts_s` it ends with the browser."""
    name = _cookie_name(name, is_https=is_https)
    answer.set_cookie(name, value, max_age=lasts_s, httponly=True, samesite="lax", secure=is_https)


def delete_cookie(request: Request, answer: Response, name: str) -> None:
    """Delete a cookie that `set_cookie` has set."""
    set_cookie(answer, name, "", is_https=is_secure(request), lasts_s=0)


def _cookie_name(name: str, *, is_https: bool) -> str:
    """Over https the prefix lets browsers take the cookie from this host alone, and from no other of its domain."""
    return f"__Host-{name}" if is_https else name


def vote_writer(request: Request) -> VoteWriter:
    writer: VoteWriter = request.app.state.votes
    return writer


def now(request: Request) -> datetime:
    moment: datetime = request.app.state.clock()
    return moment


async def participant_token(request: Request) -> str:
    """Read a participant's token from the bearer header or the cookie; the store decides whether it opens a session."""
    token = _bearer(request) or cookie(request, PARTICIPANT_COOKIE)
    if not token:
        raise NoSessionError
    n_bytes = int(request.headers.get("content-length", 0))  # digits alone: the server has read them
    if n_bytes > PIECE:
        throttle(request).count(SENT_PIECES, "sent", digest(token), cost=n_bytes // PIECE)
    return token


def participant(request: Request, token: Annotated[str, Depends(participant_token)]) -> SignedIn:
    """Open the participant's session; refuse where the request names another one."""
    with database(request).reading() as connection:
        session = session_by_token(connection, token)
    session = session and end_overdue(database(request), session, now(request))
    if session is None or meant_session(request) not in (None, session.public_id):
        raise NoSessionError
    return SignedIn(session, token)


def meant_session(request: Request) -> str | None:
    """Return the id of the session that a request is for; None where it names none."""
    return request.headers.get(SESSION_HEADER)


ANYBODYS = re.compile(r"/admin(/(account(/.*)?|logout|jobs/[^/]+))?|GET /api/v1/studies")
ACCOUNT = re.compile(r"/admin/(account(/.*)?|logout)")
ALL_STUDIES = "/duplicate"  # ends addresses below a study that make another one


def check_reach(request: Request, studies: tuple[str, ...] | None) -> None:
    """Keep who may see some studies only from everything that belongs to none of them.

    Parameters
    ----------
    request : of the person or token
    studies : slugs of those that they see; None: all

    Raises
    ------
    ForbiddenError
    """
    request.state.studies = studies
    path = request.url.path
    is_of_study = "slug" in request.path_params and not path.endswith(ALL_STUDIES)
    if studies is None or is_of_study or ANYBODYS.fullmatch(path) or ANYBODYS.fullmatch(f"{request.method} {path}"):
        return
    raise ForbiddenError("You see some studies only, and this belongs to all of them. An owner can change that.")


def is_seen(request: Request, study: Study) -> bool:
    """Does the person or token of a request, which a gate has let in, see a study?"""
    return request.state.studies is None or study.slug in request.state.studies


@dataclass(frozen=True)
class Reader:
    """Who reads results: the bearer of a token, or a signed-in experimenter."""

    name: str
    scopes: tuple[str, ...]


def reader(request: Request) -> Reader:
    """Identify who reads results, by bearer token or experimenter's cookie, and limit how often they ask."""
    secret = _bearer(request)
    if secret is None:
        person = experimenter(request)
        who = Reader(person.name, SCOPES_OF_ROLE[person.role])
    else:
        with database(request).reading() as connection:
            token = token_by_secret(connection, secret, now(request))
        if token is None:
            throttle(request).count(WRONG_TOKENS, address(request))
            record_alone(database(request), STRANGER, Entry("token refused", subject=request.url.path), now(request))
            raise UnauthorisedError("This token is not known here, has expired or was revoked.")
        check_reach(request, token.studies)
        who = Reader(f"token {token.name}", token.scopes)
    limit = RateLimitItemPerMinute(settings(request).api_requests_per_minute)
    throttle(request).count(limit, "api", who.name)
    return who


def may_read(scope: str) -> Callable[[Request], Reader]:
    """Make the gate that lets in readers with a scope."""

    def gate(request: Request) -> Reader:
        who = reader(request)
        if scope not in who.scopes:
            entry = Entry("access refused", subject=request.url.path, detail={"needed": scope})
            record_alone(database(request), who.name, entry, now(request))
            raise ForbiddenError(f"This takes the scope {scope}; yours are {', '.join(who.scopes)}.")
        return who

    return gate


def may_change(scope: str) -> Callable[..., Reader]:
    """Make the gate that lets in who may change something over REST.

    It takes a token with a scope, or an experimenter's cookie with the session's form token as X-CSRF-Token.
    """
    may = may_read(scope)

    def gate(request: Request, header: Annotated[str, Header(alias="X-CSRF-Token", max_length=100)] = "") -> Reader:
        who = may(request)
        if _bearer(request) is None:
            _acting(request, "experimenter", header)
        return who

    return gate


def experimenter(request: Request) -> Experimenter:
    """Return the experimenter who is signed in by cookie, whatever their role, where they may be."""
    person = _signed_in(request)
    check_reach(request, person.studies)
    if lacks_second_factor(request, person) and not ACCOUNT.fullmatch(request.url.path):
        raise ForbiddenError("This server takes a second factor. Click your name above, and set one up.")
    return person


def lacks_second_factor(request: Request, person: Experimenter) -> bool:
    """Whether the server asks everybody for a second factor, and this person has none yet."""
    return settings(request).second_factor == "required" and not person.has_second_factor


def _signed_in(request: Request) -> Experimenter:
    if (known := getattr(request.state, "person", None)) is not None:  # another gate of the same request has asked
        person: Experimenter = known
        return person
    token = cookie(request, EXPERIMENTER_COOKIE)
    session = open_session(database(request), token, now(request), may_renew=_is_quick(request)) if token else None
    if session is None:
        raise UnauthorisedError(NO_TOKEN if request.url.path.startswith(DATA_PATHS) else NOT_SIGNED_IN)
    request.state.person = session.experimenter
    request.state.form_token = session.form_token
    if session.renewed:
        request.state.renewed_token = session.renewed
    return session.experimenter


def signed_in_person(request: Request) -> Experimenter | None:
    """Return the experimenter who is signed in; None if nobody is, or the database does not answer."""
    try:
        return _signed_in(request)
    except StudyError:
        return None


def is_still_signed_in(request: Request) -> bool:
    """Whether the experimenter's session has not ended meanwhile; for live pages, which outlast their gate."""
    with database(request).reading() as connection:
        return is_session_open(connection, request.state.form_token, now(request))


def _is_quick(request: Request) -> bool:
    """May this response renew the cookie before the old token expires? After a long one, other tabs would be out."""
    path = request.url.path
    return not path.startswith(DATA_PATHS) and UPLOAD_PATH.fullmatch(path) is None


def looking(role: Role) -> Callable[[Request], Experimenter]:
    """Make the gate of a page that takes a role."""

    def gate(request: Request) -> Experimenter:
        return _with_role(request, role)

    return gate


def acting(role: Role) -> Callable[..., Actor]:
    """Make the gate of a form that takes a role and the token that the form was given."""

    def gate(
        request: Request,
        form_token: Annotated[str, Form(max_length=100)] = "",
        header: Annotated[str, Header(alias="X-CSRF-Token", max_length=100)] = "",
    ) -> Actor:
        return _acting(request, role, form_token or header)

    return gate


def acting_by_header(role: Role) -> Callable[..., Actor]:
    """Make the gate of an upload that takes a role: the form's token comes in a header."""

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
    """Add to the audit log that an id or invitation led nowhere; a limited number for one address."""
    if not throttle(request).limiter.hit(WRONG_CODES, "audit", address(request)):
        return
    person: Experimenter | None = getattr(request.state, "person", None)
    route = getattr(request.scope.get("route"), "path", "")
    given = {name: str(request.path_params[name])[:80] for name in NOTED_IDS if name in request.path_params}
    entry = Entry(action, subject=route, detail={"reason": reason, **given})
    try:
        record_alone(database(request), person.name if person else STRANGER, entry, now(request))
    except StudyError as error:  # the client gets its answer all the same
        log.warning("a refusal could not be noted: %s", error)


def study_called(request: Request, slug: str) -> Study:
    """Return a study that the person or token of a request sees; another gate has let them in before."""
    with database(request).reading() as connection:
        study = study_by_slug(connection, slug)
    if study is None or not is_seen(request, study):
        raise NotFoundError("There is no such study.")
    return study


def invitation_to(request: Request, slug: str, code: str) -> Invitation:
    """Find a study's invitation by its code; clients that guess codes are slowed down."""
    throttle(request).check(WRONG_CODES, address(request))
    with database(request).reading() as connection:
        invitation = invitation_by_code(connection, code)
        study = study_by_id(connection, invitation.study_id) if invitation else None
    if invitation is None or study is None or study.slug != slug:
        throttle(request).count(WRONG_CODES, address(request))
        raise NotFoundError("There is no such invitation. Please check the code.")
    return invitation


def _bearer(request: Request) -> str | None:
    scheme, _, token = request.headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" and token.strip() else None


async def _database(request: Request) -> Database:  # async: FastAPI would run a plain function in another thread
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
