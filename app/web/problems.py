"""Answer every error as an RFC 9457 problem, or as a page where a person reads it."""

from __future__ import annotations

import errno
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qsl, urlencode, urlsplit

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.errors import ClosedError, StudyError, TooManyError, UnavailableError
from app.store.access.experimenters import has_anybody
from app.web.form_token import page_with_form
from app.web.gates import database, fields_of, note_refusal, now, render, route_of
from app.web.roles import signed_in_person
from ground.fields import Taken, taken
from ground.file_models import Fault, fault_of

Typed = Sequence[tuple[str, str]]  # fields of a form, in order; a name may come more than once

log = logging.getLogger(__name__)

PROBLEM = "application/problem+json"
DASHBOARD = "/admin"
CORRECTED = (409, 422)  # statuses of a form that asks for what cannot be done
PROGRAMS = (
    "/api/",
    "/media/",
    "/static/",
    "/healthz",
    "/readyz",
    "/metrics",
)  # prefixes of addresses that programs read
FULL = (errno.ENOSPC, errno.EDQUOT)
CROWDED = (errno.EMFILE, errno.ENFILE)  # no file or connection more can be opened
NOWHERE = (404, 410)  # forged ids, and invitations that are used up
METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE")
SAVED = "saved"  # of an address, after what was saved; a refusal on the same page is not
SECRET = ("form_token", "current", "password", "again")
LOGGED_PARAMETERS = ("slug", "stage", "trial")
HEADINGS = {  # of pages, for people; programs get the phrases of HTTP
    403: "Not allowed",
    404: "Not found",
    405: "Not possible here",
    409: "Not possible now",
    410: "No longer here",
    413: "Too large",
    422: "Not accepted",
    429: "Too many requests",
    507: "No room left",
}
SENTENCES = {
    404: "There is nothing at this address.",
    413: "What was sent is too large for this page, and nothing of it was kept. Shorten it, or send it in parts.",
    507: "The server's disk is full. What came before is kept; an administrator has to make room, then repeat this.",
    503: "Here are too many at once. What came before is kept; please try again in a moment.",
    500: "Something went wrong here. Nothing that was acknowledged is lost; please try again.",
}


@dataclass(frozen=True)
class RefusedForm:
    """A form of the dashboard that was refused; its page shows it once more, and why (`templates/admin/_refused.html`).

    Parameters
    ----------
    action : address to which it was sent
    message : why it was refused
    field : name of what is wrong; empty: nothing alone
    typed : what was sent, for the page's script to fill in; empty: the page is filled already
    """

    action: str
    message: str
    field: str = ""
    typed: Typed = ()


def problem(
    status: int, detail: str, *, extra: Mapping[str, Any] | None = None, headers: Mapping[str, str] | None = None
) -> JSONResponse:
    """Make a problem answer. Its type is "about:blank", so its title is the status's phrase."""
    content = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": status, "detail": detail}
    return JSONResponse({**content, **(extra or {})}, status, headers=dict(headers or {}), media_type=PROBLEM)


def install_problems(app: FastAPI) -> None:
    """Let the app answer all errors that a route or the framework raises."""
    app.add_exception_handler(StudyError, _study_error)
    app.add_exception_handler(HTTPException, _http_error)
    app.add_exception_handler(RequestValidationError, _validation_error)
    app.add_exception_handler(OSError, _system_error)


class UnforeseenErrors:
    """Answer unexpected exceptions with 500, or 503 where only files ran out: the log gets the traceback."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        has_started = False

        async def watch(message: Message) -> None:
            nonlocal has_started
            has_started = has_started or message["type"] == "http.response.start"
            await send(message)

        try:
            await self.app(scope, receive, watch)
        except ClientDisconnect:
            log.info("%s %s: the client left", scope["method"], route_of(scope))
        except Exception as error:
            log.exception("%s %s failed", scope["method"], route_of(scope))
            if has_started:
                raise
            is_crowded = isinstance(error, OSError) and error.errno in CROWDED
            request = Request(scope)
            answer = _crowded(request) if is_crowded else _answer(request, 500, SENTENCES[500])
            await answer(scope, receive, send)


def _crowded(request: Request) -> Response:
    """Ask to come again; a person gets plain text, since no template could be opened."""
    headers = {"Retry-After": str(UnavailableError.retry_after_s)}
    if _is_page(request):
        return PlainTextResponse(SENTENCES[503], 503, headers)
    return problem(503, SENTENCES[503], headers=headers)


async def _study_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, StudyError)
    refused = RefusedForm(request.url.path, error.detail, error.field, await _typed(request))
    answer = await run_in_threadpool(_refusal, request, error, refused)
    return await _form_again(request, error.status, refused) or answer


def _refusal(request: Request, error: StudyError, refused: RefusedForm) -> Response:
    _log_refusal(request, error.status, error.detail)
    if error.status in NOWHERE:
        note_refusal(request, "not found", error.detail)
    extra = {}
    if isinstance(error, ClosedError):
        note_refusal(request, "not taken in", error.detail)
        extra["standing"] = error.standing
    headers = {"WWW-Authenticate": "Bearer"} if error.status == 401 else {}
    if isinstance(error, (TooManyError, UnavailableError)):
        headers["Retry-After"] = str(error.retry_after_s)
    return _answer(request, error.status, error.detail, headers, extra=extra, refused=refused)


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    sentence, headers = SENTENCES.get(error.status_code, str(error.detail)), dict(error.headers or {})
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        allowed = _allowed(request)
        headers["Allow"] = ", ".join(allowed)  # RFC 9110, 15.5.6; the framework names those of one route
        sentence = f"This address does not take {request.method}; it takes {' and '.join(allowed)}."
    return await run_in_threadpool(_answer, request, error.status_code, sentence, headers)


def _allowed(request: Request) -> list[str]:
    """Return the methods that some route at a request's address takes."""
    routes = request.app.router.routes
    return [
        method
        for method in METHODS
        if any(route.matches({**request.scope, "method": method})[0] == Match.FULL for route in routes)
    ]


async def _validation_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    faults = list(dict.fromkeys(_fault(request, detail) for detail in error.errors()))
    _log_refusal(request, 422, str(faults[0]))
    if not _is_page(request):
        told = [{"at": ".".join(map(str, fault.place)), "message": fault.words} for fault in faults]
        return problem(422, f"The request is not as described: {faults[0]}.", extra={"errors": told})
    field = str(faults[0].place[-1])
    sentence = f"The form is not as expected: {field.replace('_', ' ')} {faults[0].words}."
    refused = RefusedForm(request.url.path, sentence, field, await _typed(request))
    answer = await run_in_threadpool(_answer, request, 422, refused.message, refused=refused)
    return await _form_again(request, 422, refused) or answer


def _fault(request: Request, detail: Mapping[str, Any]) -> Fault:
    """Say what is wrong with a part of a request, such as ("body", "name"), in the words of all our refusals."""
    part, *place = detail["loc"]
    fields = fields_of(request.scope["route"].dependant, part)
    if place and place[0] in fields:
        within, rest = taken(fields[place[0]]), place[1:]
    else:  # a body that is one model
        within, rest = (taken(next(iter(fields.values()))) if len(fields) == 1 else Taken(Any)), place
    known = next((n for n in range(len(rest)) if within.at(rest[:n]).inner(rest[n]) is None), len(rest))
    if detail["type"] not in ("extra_forbidden", "missing", "value_error"):  # of a union each kind that it may be
        rest, place = rest[:known], place[: len(place) - len(rest) + known]
    fault = fault_of(detail, tuple(rest), within)
    return fault._replace(place=(part, *place))


async def _system_error(request: Request, error: Exception) -> Response:
    """Answer that the disk is full, which an administrator mends; nobody foresaw any other error."""
    assert isinstance(error, OSError)
    if error.errno not in FULL:
        raise error
    log.error("%s %s failed: %s", request.method, route_of(request.scope), error)
    refused = RefusedForm(request.url.path, SENTENCES[507], typed=await _typed(request))
    return await run_in_threadpool(_answer, request, 507, refused.message, refused=refused)


async def _typed(request: Request) -> Typed:
    """Return the fields of a dashboard form that a person sent, in order, without secrets; none of anything else."""
    is_form = request.headers.get("content-type", "").startswith("application/x-www-form-urlencoded")
    is_asked = request.method == "GET"
    if not (is_form or is_asked) or not _is_page(request) or not _is_dashboard(request):
        return ()
    sent = request.query_params if is_asked else await request.form()  # cached, as the route has read it already
    fields = sent.multi_items()
    return [(name, text) for name, text in fields if isinstance(text, str) and name not in SECRET]


async def _form_again(request: Request, status: int, refused: RefusedForm) -> Response | None:
    """Answer with the page from which a refused form came, as this person sees it now; None where that cannot be."""
    came_from = urlsplit(request.headers.get("referer", ""))
    if status not in CORRECTED or not refused.typed or not came_from.path.startswith(DASHBOARD):
        return None
    headers = [(name, value) for name, value in request.scope["headers"] if not name.startswith(b"content-")]
    scope = dict(request.scope) | {"method": "GET", "path": came_from.path, "raw_path": came_from.path.encode()}
    query = urlencode([field for field in parse_qsl(came_from.query, keep_blank_values=True) if field[0] != SAVED])
    scope |= {"query_string": query.encode(), "path_params": {}, "headers": headers}
    scope["state"] = {**request.scope["state"], "refused": refused}
    page_status, parts = 0, []

    async def receive() -> Message:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Message) -> None:
        nonlocal page_status
        page_status = message.get("status", page_status)
        parts.append(message.get("body", b""))

    try:
        await request.app.router(scope, receive, send)
    except (StudyError, HTTPException, RequestValidationError):
        return None
    return HTMLResponse(b"".join(parts), status) if page_status == 200 else None


def _log_refusal(request: Request, status: int, why: str) -> None:
    """Log a refusal by route and ids, without the address, which may hold an invitation or a link."""
    about = {name: request.path_params[name] for name in LOGGED_PARAMETERS if name in request.path_params}
    log.warning("%s %s %s refused: %d %s", request.method, route_of(request.scope), about, status, why)


def _is_dashboard(request: Request) -> bool:
    return request.url.path.startswith(DASHBOARD)


def _is_page(request: Request) -> bool:
    """Whether a person reads the answer."""
    return not request.url.path.startswith(PROGRAMS) and "text/html" in request.headers.get("accept", "")


def _asked_page(request: Request) -> str:
    """Return the page of the dashboard that whoever signs in shall come to; never the address of a link, a secret."""
    if request.method != "GET" or "secret" in request.path_params:
        return request.query_params.get("to", "/admin")
    return request.url.path + (f"?{request.url.query}" if request.url.query else "")


def _answer(
    request: Request,
    status: int,
    detail: str,
    headers: Mapping[str, str] | None = None,
    *,
    extra: Mapping[str, str] | None = None,
    refused: RefusedForm | None = None,
) -> Response:
    if not _is_page(request):
        return problem(status, detail, extra=extra, headers=headers)
    person = signed_in_person(request) if _is_dashboard(request) and status != 401 and status < 500 else None
    context: dict[str, Any] = {
        "title": HEADINGS.get(status, HTTPStatus(status).phrase),
        "detail": detail,
        "typed": refused.typed if refused and request.method != "GET" else (),  # an address loses nothing
    }
    if status == 401 and _is_dashboard(request):
        context |= {"asked": _asked_page(request), "is_new": not has_anybody(database(request))}
        return page_with_form(request, "admin/sign_in.html", context, status, headers)
    context["experimenter"] = person
    if person is not None:
        context |= {"form_token": request.state.form_token, "now": now(request)}
    return render(request, "admin/problem.html", context, status, headers)
