"""What requests share (the database, settings, cookies), and the gate of participants.

A gate decides who may do what: it returns what a route needs, or raises. roles.py has those of all other people.
"""

from __future__ import annotations

import logging
import re
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from inspect import Parameter, Signature
from json import JSONDecodeError
from typing import Annotated, Any, TypeVar

from fastapi import Depends, Query, Request
from fastapi.dependencies.models import Dependant
from fastapi.responses import Response
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from starlette.types import Scope

from app.errors import InvalidError, NoSessionError, NotFoundError, StudyError
from app.settings import Settings
from app.store.access.experimenters import Experimenter
from app.store.database.engine import Database
from app.store.database.keys import digest
from app.store.participants.invitations import Invitation, invitation_by_code
from app.store.studies.audit import STRANGER, Entry, record_alone
from app.store.studies.studies import Study, study_by_id
from app.store.trials.sessions import Session, end_overdue, session_by_token
from app.store.trials.vote_writer import VoteWriter
from app.study.languages.language_pack import LanguagePack
from app.study.languages.text import check_text
from app.study.options.options import parse_options
from app.study.options.platforms import link_path
from app.web.limits.connections import network_of
from app.web.limits.throttle import PIECE, SENT_PIECES, WRONG_CODES, Throttle

log = logging.getLogger(__name__)

# Parts of addresses that the audit log may name: no codes or links, which let people in.
NOTED_IDS = ("slug", "label", "trial", "stage", "media")
UPLOAD_PATH = re.compile(  # whose body is a file, with limits of its own
    r"/admin/((stimuli|studies/[a-z0-9-]+)/upload|studies/import|files/upload/[0-9a-f]{32})"
    r"|/api/v1/(sets|votes|uploads/[0-9a-f]{32}|studies/(import|[a-z0-9-]+/results))"
)
NO_ROUTE = "unknown"  # where an address matches none
PARTICIPANT_COOKIE = "session"
SESSION_HEADER = "Session-Id"  # the session that a page shows; the browser's cookie may name a newer one
BROWSERS = (("Edg", "Edge"), ("OPR", "Opera"), ("Firefox", "Firefox"), ("Chrome", "Chrome"), ("Safari", "Safari"))
SYSTEMS = ("Windows", "Android", "iPhone", "iPad", "Mac", "Linux")

FORMS = ("application/x-www-form-urlencoded", "multipart/form-data")  # a client chooses which
FORM_TOKEN = "form_token"  # in every form of ours
WHOLE_FORMS: set[Callable[..., Any]] = set()  # dependencies that read a whole form

Headers = Mapping[str, str] | None
Reader = TypeVar("Reader", bound=Callable[..., Any])


@dataclass(frozen=True)
class SignedIn:
    """A session, and the token that its participant holds."""

    session: Session
    token: str


async def check_request_text(request: Request) -> AsyncIterator[None]:
    """Refuse a request whose JSON or form holds text that cannot be stored, before anything reads it."""
    try:
        await _check_text_of(request)
        yield
    finally:
        await request.close()  # the files of a form


async def _check_text_of(request: Request) -> None:
    if UPLOAD_PATH.fullmatch(request.url.path):
        return  # a file, whatever its type is said to be; it is not read into memory
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    try:
        if kind in FORMS:
            fields = (await request.form()).multi_items()  # a name may come more than once
            for name, part in fields:
                check_text({name: part if isinstance(part, str) else part.filename})
            _refuse_unknown(request, [name for name, _ in fields])
        elif kind.endswith("json"):
            check_text(await request.json())  # kept by the request, so nothing is read twice
    except (JSONDecodeError, UnicodeDecodeError):
        return  # the route refuses it
    except RecursionError as error:
        raise InvalidError("This cannot be stored: it holds too many lists within one another.") from error
    except ValueError as error:
        raise InvalidError(f"This cannot be stored: {error}.") from error


def takes_any_field(reader: Reader) -> Reader:
    """Mark a dependency that reads a whole form by itself, and refuses what it does not know."""
    WHOLE_FORMS.add(reader)
    return reader


def _refuse_unknown(request: Request, names: Iterable[str]) -> None:
    """Refuse a form with a field that its route does not have: a misspelt one would be dropped without a word."""
    dependant = getattr(request.scope.get("route"), "dependant", None)
    if dependant is None or not WHOLE_FORMS.isdisjoint(_calls(dependant)):
        return
    known = {FORM_TOKEN, *fields_of(dependant)}
    if unknown := next((name for name in names if name not in known), None):
        raise InvalidError(
            f"This form has no field {unknown[:40]!r}, so nothing was done. Load the page again, then repeat."
        )


def _calls(dependant: Dependant) -> Iterator[Any]:
    yield dependant.call
    for each in dependant.dependencies:
        yield from _calls(each)


def fields_of(dependant: Dependant, part: str = "body") -> dict[str, FieldInfo]:
    """Return the fields that a route and what it depends on take, by name.

    Parameters
    ----------
    part : of a request: "body" for forms, or "query", "path", "header", "cookie"
    """
    fields = {field.alias: field.field_info for field in getattr(dependant, f"{part}_params")}
    for each in dependant.dependencies:
        fields |= fields_of(each, part)
    return fields


def from_query(model: type[BaseModel], names: Iterable[str]) -> Callable[..., dict[str, Any]]:
    """Return a dependency that reads fields of a model from an address, with their bounds, defaults and words."""

    def read(**given: Any) -> dict[str, Any]:
        return given

    parameters = []
    for name in names:
        info = model.model_fields[name]
        default = Parameter.empty if info.is_required() else info.default
        annotation: Any = Annotated[(info.annotation, *info.metadata, Query(description=info.description))]
        parameters.append(Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=annotation))
    read.__signature__ = Signature(parameters)  # type: ignore[attr-defined]  # PEP 362
    return read


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


def render(
    request: Request, template: str, context: Mapping[str, Any], status_code: int = 200, headers: Headers = None
) -> Response:
    """Render a page from its template."""
    page: Response = request.app.state.templates.TemplateResponse(
        request, template, dict(context), status_code, headers
    )
    return page


def route_of(scope: Scope) -> str:
    """Return the pattern that an address matched, such as "/s/{code}": the address itself may let people in."""
    if route := scope.get("route"):
        return str(route.path)
    return "/static" if scope["path"].startswith("/static/") else NO_ROUTE


def link_to(request: Request, study: Study, code: str) -> str:
    """Return an invitation's whole link, with what a recruiting platform fills in where the study needs it."""
    return str(request.base_url).removesuffix("/") + link_path(code, parse_options(study.options).outside)


def address(request: Request) -> str:
    """Return the client's network address, of IPv6 its network, to count requests by; it is stored nowhere."""
    return network_of(request.client.host) if request.client else "unknown"


def is_secure(request: Request) -> bool:
    """Whether cookies are sent over https alone."""
    return settings(request).secure_cookies or request.url.scheme == "https"


def cookie(request: Request, name: str) -> str | None:
    """Return the value of a cookie that `set_cookie` has set."""
    return request.cookies.get(_cookie_name(request, name))


def set_cookie(request: Request, answer: Response, name: str, value: str, *, lasts_s: int | None = None) -> None:
    """Set a cookie that no script can read; without `lasts_s` it ends with the browser."""
    name, is_https = _cookie_name(request, name), is_secure(request)
    answer.set_cookie(name, value, max_age=lasts_s, httponly=True, samesite="lax", secure=is_https)


def delete_cookie(request: Request, answer: Response, name: str) -> None:
    """Delete a cookie that `set_cookie` has set."""
    set_cookie(request, answer, name, "", lasts_s=0)


def _cookie_name(request: Request, name: str) -> str:
    """Return a cookie's name; over https its prefix lets browsers take it from this host alone, not from its domain."""
    return f"__Host-{name}" if is_secure(request) else name


def vote_writer(request: Request) -> VoteWriter:
    writer: VoteWriter = request.app.state.votes
    return writer


def now(request: Request) -> datetime:
    moment: datetime = request.app.state.clock()
    return moment


async def participant_token(request: Request) -> str:
    """Read a participant's token from the bearer header or the cookie; the store decides whether it opens a session."""
    token = bearer(request) or cookie(request, PARTICIPANT_COOKIE)
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


def note_refusal(request: Request, action: str, reason: str) -> None:
    """Add to the audit log that an id or invitation led nowhere; a limited number for one address."""
    if not throttle(request).hit(WRONG_CODES, "audit", address(request)):
        return
    person: Experimenter | None = getattr(request.state, "person", None)
    given = {name: str(request.path_params[name])[:80] for name in NOTED_IDS if name in request.path_params}
    entry = Entry(action, subject=route_of(request.scope), detail={"reason": reason, **given})
    try:
        record_alone(database(request), person.name if person else STRANGER, entry, now(request))
    except StudyError as error:  # the client gets its answer all the same
        log.warning("a refusal could not be noted: %s", error)


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


def bearer(request: Request) -> str | None:
    """Return the token of the header Authorization; None without one."""
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


def browser_of(request: Request) -> str | None:
    """Name the browser and system of a request roughly, such as "Firefox on Linux"; None where it does not say."""
    agent = request.headers.get("user-agent", "")
    browser = next((name for mark, name in BROWSERS if f"{mark}/" in agent), None)
    system = next((name for name in SYSTEMS if name in agent), None)
    return " on ".join(filter(None, (browser, system))) or None
