"""Gates of the dashboard and of results: experimenters come in by their role, analysts by their token's scopes."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from secrets import compare_digest
from typing import Annotated, Any

from fastapi import Depends, Form, Header, Request
from fastapi.responses import Response
from limits import RateLimitItemPerMinute

from app.errors import ForbiddenError, NotFoundError, StudyError, UnauthorisedError
from app.store.access.experimenters import SESSION_LASTS, Experimenter, is_session_open, open_session
from app.store.access.rights import SCOPES_OF_ROLE, Role
from app.store.access.tokens import token_by_secret
from app.store.studies.audit import STRANGER, Actor, Entry, record_alone
from app.store.studies.studies import Study, study_by_slug
from app.web.gates import UPLOAD_PATH, address, bearer, cookie, database, now, set_cookie, settings, throttle
from app.web.limits.throttle import WRONG_TOKENS

EXPERIMENTER_COOKIE = "experimenter"
DATA_PATHS = "/api/v1/"  # whole tables and archives
NOT_SIGNED_IN = "You are not signed in. Use your password, or a sign-in link from an owner or whoever runs the server."
NO_TOKEN = (
    "This takes a token, sent as the header `Authorization: Bearer TOKEN`. An owner makes one in the dashboard under "
    "Tokens, or on the server by `reconstudy token add NAME`."
)
OF_TASKS = r"(tasks|jobs)/[^/]+(/cancel)?"  # which show people who see some studies only their own
ANYBODYS = re.compile(
    rf"/admin(/(account(/.*)?|logout|manual(/.*)?|studies|{OF_TASKS}))?|GET /api/v1/studies|/api/v1/tasks/[^/]+"
)
ACCOUNT = re.compile(r"/admin/(account(/.*)?|logout)")
MAKES_A_STUDY = "/duplicate"  # ends addresses below a study that make another one

# Any value passes as a parameter: one that did not would skip the gate that takes it, but not what stands behind it.
CsrfToken = Annotated[str, Header(alias="X-CSRF-Token")]


def set_experimenter_cookie(request: Request, answer: Response, token: str) -> None:
    """Set the cookie of an experimenter's session; no script can read it."""
    set_cookie(request, answer, EXPERIMENTER_COOKIE, token, lasts_s=int(SESSION_LASTS.total_seconds()))


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
    is_of_study = "slug" in request.path_params and not path.endswith(MAKES_A_STUDY)
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
    secret = bearer(request)
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


def may_change(scope: str) -> Callable[..., Actor]:
    """Make the gate that lets in who may change something over REST.

    It takes a token with a scope, or an experimenter's cookie with the session's form token as X-CSRF-Token.
    """
    may = may_read(scope)

    def gate(request: Request, header: CsrfToken = "") -> Actor:
        who = may(request)
        if bearer(request) is None:
            return _acting(request, "experimenter", header)
        return Actor(0, who.name, now(request))

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

    def gate(request: Request, form_token: Annotated[Any, Form()] = "", header: CsrfToken = "") -> Actor:
        return _acting(request, role, str(form_token) or header)

    return gate


def acting_by_header(role: Role) -> Callable[..., Actor]:
    """Make the gate of an upload that takes a role: the form's token comes in a header."""

    def gate(request: Request, header: CsrfToken = "") -> Actor:
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


def study_called(request: Request, slug: str) -> Study:
    """Return a study that the person or token of a request sees; another gate has let them in before."""
    if not hasattr(request.state, "studies"):
        raise UnauthorisedError(NOT_SIGNED_IN)
    with database(request).reading() as connection:
        study = study_by_slug(connection, slug)
    if study is None or not is_seen(request, study):
        raise NotFoundError("There is no such study.")
    return study


Person = Annotated[Experimenter, Depends(experimenter)]
Looking = Annotated[Experimenter, Depends(looking("experimenter"))]
Owner = Annotated[Experimenter, Depends(looking("owner"))]
Myself = Annotated[Actor, Depends(acting("viewer"))]
Acting = Annotated[Actor, Depends(acting("experimenter"))]
ActingOwner = Annotated[Actor, Depends(acting("owner"))]
AStudy = Annotated[Study, Depends(study_called)]
