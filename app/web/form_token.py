"""The token of forms for visitors without a session: sign-in, set-up, resuming in another browser.

A cookie and the form hold the same secret (OWASP: double submit), so only our page in the same browser can send the
form. Forms within a session carry the session's token instead, see gates.
"""

from __future__ import annotations

from secrets import compare_digest, token_urlsafe
from typing import Annotated

from fastapi import Form, Request
from fastapi.responses import Response

from app.errors import ForbiddenError
from app.web.gates import cookie, set_cookie

ENTRY_COOKIE = "entry"


def entry_token(request: Request) -> str:
    """Return the token that this browser's forms carry; a new one if the browser has none."""
    known = getattr(request.state, "entry_token", None) or cookie(request, ENTRY_COOKIE)
    request.state.entry_token = known or token_urlsafe(32)
    return str(request.state.entry_token)


def remember_entry(request: Request, answer: Response) -> Response:
    """Set the cookie with the token that the page was given."""
    set_cookie(request, answer, ENTRY_COOKIE, entry_token(request))
    return answer


def is_own_form(request: Request, form_token: str) -> bool:
    """Whether our page in this browser sent the form."""
    known = cookie(request, ENTRY_COOKIE) or ""
    return bool(known) and compare_digest(form_token.encode(), known.encode())


def own_form(request: Request, form_token: Annotated[str, Form(max_length=100)] = "") -> None:
    """Refuse a form that no page of ours in this browser sent."""
    if not is_own_form(request, form_token):
        raise ForbiddenError("This form is out of date. Load the page again, then repeat what you entered.")
