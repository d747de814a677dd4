"""What all of the experimenter's pages share: the frame around them, and where forms lead."""

from __future__ import annotations

from typing import Any

from fastapi import Request
from fastapi.responses import RedirectResponse, Response

from app.store.experimenters import Experimenter
from app.web.gates import now

VENDOR = ("htmx.min.js", "sse.js", "vega.min.js", "vega-interpreter.min.js", "three.module.min.js")


def page(
    request: Request, template: str, person: Experimenter, context: dict[str, Any], status_code: int = 200
) -> Response:
    """A page for who is signed in; its forms carry the session's form token."""
    shown: Response = request.app.state.templates.TemplateResponse(
        request,
        f"admin/{template}.html",
        {"experimenter": person, "form_token": request.state.form_token, "now": now(request), **context},
        status_code=status_code,
    )
    return shown


def see(path: str) -> Response:
    """Look at another page after a form was taken."""
    return RedirectResponse(path, status_code=303)
