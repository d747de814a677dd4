"""The token of forms for visitors without a session: sign-in, set-up, resuming in another browser.

A cookie and the form hold the same secret (OWASP: double submit), so only our page in the same browser can send the
form. Forms within a session carry the session's token instead, see gates.
"""

from __future__ import annotations

from collections.abc import Mapping
from secrets import compare_digest, token_urlsafe
from typing import Annotated, Any

from fastapi import Form, Request
from fastapi.responses import Response

from app.errors import ForbiddenError
from app.web.gates import Headers, cookie, render, set_cookie

ENTRY_COOKIE = "entry"


def _token(request: Request) -> str:
    """Return the token that this browser's forms carry; a new one if the browser has none."""
    return cookie(request, ENTRY_COOKIE) or token_urlsafe(32)


def page_with_form(
    request: Request, template: str, context: Mapping[str, Any], status_code: int = 200, headers: Headers = None
) -> Response:
    """Render a page whose forms carry this browser's token, and set its cookie."""
    token = _token(request)
    page = render(request, template, {"form_token": token, **context}, status_code, headers)
    set_cookie(request, page, ENTRY_COOKIE, token)
    return page


def has_form_token(request: Request) -> bool:
    """Whether this browser has kept the cookie that came with a form."""
    return cookie(request, ENTRY_COOKIE) is not None


def is_own_form(request: Request, form_token: str) -> bool:
    """Whether our page in this browser sent the form."""
    known = cookie(request, ENTRY_COOKIE) or ""
    return bool(known) and compare_digest(form_token.encode(), known.encode())


def own_form(request: Request, form_token: Annotated[Any, Form()] = "") -> None:
    """Refuse a form that no page of ours in this browser sent."""
    if not is_own_form(request, str(form_token)):
        raise ForbiddenError("This form is out of date. Load the page again, then repeat what you entered.")
