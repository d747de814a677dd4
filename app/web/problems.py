"""Answer every error as an RFC 9457 problem, or as a page where a person reads it."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.errors import ClosedError, StudyError, TooManyError, UnavailableError
from app.web.form_token import entry_token, remember_entry
from app.web.gates import note_refusal

Typed = Sequence[tuple[str, str]]

log = logging.getLogger(__name__)

PROBLEM = "application/problem+json"
PROGRAMS = (
    "/api/",
    "/media/",
    "/static/",
    "/healthz",
    "/readyz",
    "/metrics",
)  # prefixes of addresses that programs read
NOWHERE = (404, 410)  # forged ids, and invitations that are used up
NOT_SHOWN = ("form_token", "current", "password", "again", "seen")  # fields that hold secrets, or that nobody typed
FEWEST_TYPED = 20  # characters; shorter texts are soon typed again
LOGGED_PARAMETERS = ("slug", "stage", "trial")
SENTENCES = {
    404: "There is nothing at this address.",
    405: "This address does not take that method.",
    413: "The request is too large.",
    500: "Something went wrong here. Nothing that was acknowledged is lost; please try again.",
}


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


class UnforeseenErrors:
    """Answer unexpected exceptions with 500: the log gets the traceback, the client a sentence."""

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
        except Exception:
            log.exception("%s %s failed", scope["method"], scope["path"])
            if has_started:
                raise
            await _answer(Request(scope), 500, SENTENCES[500])(scope, receive, send)


async def _study_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, StudyError)
    return await run_in_threadpool(_refusal, request, error, await _typed(request))


def _refusal(request: Request, error: StudyError, typed: Typed) -> Response:
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
    return _answer(request, error.status, error.detail, headers, extra=extra, typed=typed)


def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return _answer(request, error.status_code, SENTENCES.get(error.status_code, str(error.detail)), error.headers)


async def _validation_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    faults = [{"at": ".".join(map(str, fault["loc"])), "message": fault["msg"]} for fault in error.errors()]
    where = f"{faults[0]['at']}: {faults[0]['message']}" if faults else "unreadable"
    _log_refusal(request, 422, where)
    if not _is_page(request):
        return problem(422, f"The request is not as described: {where}.", extra={"errors": faults})
    return _answer(request, 422, f"The form is not as expected: {where}.", typed=await _typed(request))


async def _typed(request: Request) -> Typed:
    """Long texts of a refused dashboard form, by field: the page shows them again, to be copied."""
    is_form = request.headers.get("content-type", "").startswith("application/x-www-form-urlencoded")
    if not is_form or not _is_page(request) or not request.url.path.startswith("/admin"):
        return ()
    fields = (await request.form()).multi_items()  # cached, as the route has read it already
    return [
        (name, text)
        for name, text in fields
        if name not in NOT_SHOWN and isinstance(text, str) and len(text) >= FEWEST_TYPED
    ]


def _log_refusal(request: Request, status: int, why: str) -> None:
    """Log a refusal by route and ids, without the address, which may hold an invitation or a link."""
    route = getattr(request.scope.get("route"), "path", "an unknown address")
    about = {name: request.path_params[name] for name in LOGGED_PARAMETERS if name in request.path_params}
    log.warning("%s %s %s refused: %d %s", request.method, route, about, status, why)


def _is_page(request: Request) -> bool:
    """Whether a person reads the answer."""
    return not request.url.path.startswith(PROGRAMS) and "text/html" in request.headers.get("accept", "")


def _answer(
    request: Request,
    status: int,
    detail: str,
    headers: Mapping[str, str] | None = None,
    *,
    extra: Mapping[str, str] | None = None,
    typed: Typed = (),
) -> Response:
    if not _is_page(request):
        return problem(status, detail, extra=extra, headers=headers)
    context: dict[str, Any] = {"title": HTTPStatus(status).phrase, "detail": detail, "typed": typed}
    options = {"status_code": status, "headers": dict(headers or {})}
    templates = request.app.state.templates
    if status == 401 and request.url.path.startswith("/admin"):
        context["form_token"] = entry_token(request)
        return remember_entry(request, templates.TemplateResponse(request, "admin/sign_in.html", context, **options))
    page: Response = templates.TemplateResponse(request, "admin/problem.html", context, **options)
    return page
