"""The participant's pages: the entrance, and the page that leads from Begin to the thanks.

The page's script shows the trials, through the session API. A page says nothing about what is compared.
"""

from __future__ import annotations

import json
import logging
from functools import cache
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response

from app.files import packaged
from app.store.invitations import invitation_of_session
from app.store.sessions import resume_session
from app.study.protocols import texts_of
from app.web.form_token import entry_token, is_own_form, remember_entry
from app.web.gates import Store, address, note_refusal, throttle
from app.web.participant.bodies import FILM_TYPES
from app.web.participant.entrance import entrance
from app.web.participant.session import remember
from app.web.throttle import WRONG_CODES

TEXTS = "languages"
DEFAULT_LANGUAGE = "en"
LANGUAGE_COOKIE = "language"
STATUS_OF_MESSAGE = {
    "unknown": 404,
    "unknown_resume_code": 404,
    "used": 410,
    "paused": 403,
    "closed": 403,
    "full": 403,
    "bad_link": 422,
    "begun_elsewhere": 409,
}

log = logging.getLogger(__name__)
router = APIRouter(include_in_schema=False)


@router.get("/")
def entrance_page(request: Request, code: str = "") -> Response:
    if code.strip():
        return RedirectResponse(f"/s/{quote(code.strip(), safe='')}", status_code=303)
    return _page(request, "participant/entrance.html")


@router.get("/s/{code}")
def participant_page(request: Request, code: str, another: str = "") -> Response:
    throttle(request).check(WRONG_CODES, address(request))
    study = entrance(request, code, is_for_another=bool(another))
    state = study.state if study else "unknown"
    if study is None:
        throttle(request).count(WRONG_CODES, address(request))
    if study is None or state in STATUS_OF_MESSAGE:
        log.warning("an invitation's page was refused: %s", state)
        note_refusal(request, "not found" if state == "unknown" else "not taken in", f"invitation {state}")
        leads_to = study.full_url if study is not None and state in ("closed", "full", "used") else ""
        return _page(request, "participant/message.html", STATUS_OF_MESSAGE[state], message=state, leads_to=leads_to)
    return _page(
        request,
        "participant/study.html",
        study=study,
        texts=texts_of(texts_in(_language(request)), study.options.protocol),
        code=code,
        second_type=FILM_TYPES.get(study.options.second_codec),
    )


@router.post("/resume")
def resume_elsewhere(
    request: Request,
    resume_code: Annotated[str, Form(max_length=40)],
    database: Store,
    form_token: Annotated[str, Form(max_length=100)] = "",
) -> Response:
    """Resume a session in this browser; sending the form twice does no harm."""
    if not is_own_form(request, form_token):
        log.warning("a resume code came from elsewhere than the entrance's form")
        return _page(request, "participant/entrance.html", 403)
    throttle(request).check(WRONG_CODES, address(request))
    token = resume_session(database, resume_code.strip().lower(), form_token)
    if token is None:
        throttle(request).count(WRONG_CODES, address(request))
        message = "unknown_resume_code"
        log.warning("a resume code is not known")
        return _page(request, "participant/message.html", STATUS_OF_MESSAGE[message], message=message, leads_to="")
    with database.reading() as connection:
        answer = RedirectResponse(f"/s/{invitation_of_session(connection, token)}", status_code=303)
    remember(request, answer, token)
    return answer


def _page(request: Request, template: str, status_code: int = 200, **context: object) -> Response:
    language = _language(request)
    page: Response = request.app.state.templates.TemplateResponse(
        request,
        template,
        {
            "language": language,
            "languages": languages(),
            "texts": texts_in(language),
            "entry_token": entry_token(request),
            **context,
        },
        status_code=status_code,
        headers={"Cache-Control": "no-store"},  # the page changes with the invitation's state
    )
    remember_entry(request, page)
    if request.query_params.get("language") == language:
        page.set_cookie(LANGUAGE_COOKIE, language, samesite="lax")
    return page


def _language(request: Request) -> str:
    """Return the language that was chosen by hand, now or before, else the browser's."""
    for chosen in (request.query_params.get("language"), request.cookies.get(LANGUAGE_COOKIE)):
        if chosen in languages():
            return str(chosen)
    return preferred_language(request.headers.get("accept-language", ""), frozenset(languages()))


def preferred_language(accepted: str, available: frozenset[str]) -> str:
    """Return the first available language of an Accept-Language header by falling weight, else English."""
    weighted = [_weighted(entry) for entry in accepted.split(",") if entry.strip()]
    acceptable = sorted((entry for entry in weighted if entry[0] > 0), key=lambda entry: -entry[0])
    return next((language for _, language in acceptable if language in available), DEFAULT_LANGUAGE)


def _weighted(entry: str) -> tuple[float, str]:
    tag, _, weight = entry.partition(";")
    try:
        quality = float(weight.strip().removeprefix("q=") or 1)
    except ValueError:
        quality = 0.0
    return quality, tag.strip().split("-")[0].lower()


@cache
def languages() -> dict[str, str]:
    """Each language's name for itself, by tag; there is a file for each."""
    return {file.stem: texts_in(file.stem)["language"] for file in sorted(packaged(TEXTS).glob("*.json"))}


@cache
def texts_in(language: str) -> dict[str, Any]:
    texts: dict[str, Any] = json.loads((packaged(TEXTS) / f"{language}.json").read_text(encoding="utf-8"))
    return texts
