"""Render the frame of the experimenter's pages (navigation, head, tabs, paging); redirect and read texts of forms."""

from __future__ import annotations

from typing import Any

from fastapi import Request
from fastapi.responses import RedirectResponse, Response

from app.store.experimenters import Experimenter, Role
from app.store.studies import Study, progress_of
from app.web.gates import database, now

TABS: tuple[tuple[str, str, Role], ...] = (
    ("", "Overview", "viewer"),
    ("/results", "Results", "viewer"),
    ("/objective", "Objective", "viewer"),
    ("/models", "3D", "experimenter"),
    ("/participants", "Participants", "experimenter"),
    ("/votes", "Votes", "experimenter"),
    ("/design", "Design", "viewer"),
    ("/stimuli", "Stimuli", "viewer"),
    ("/invitations", "Invitations", "experimenter"),
    ("/texts", "Texts", "experimenter"),
    ("/edit", "Settings", "experimenter"),
)


def page(
    request: Request, template: str, person: Experimenter, context: dict[str, Any], status_code: int = 200
) -> Response:
    """Render a page for the signed-in person; its forms carry the session's form token."""
    shown: Response = request.app.state.templates.TemplateResponse(
        request,
        f"admin/{template}.html",
        {"experimenter": person, "form_token": request.state.form_token, "now": now(request), **context},
        status_code=status_code,
    )
    return shown


def study_page(
    request: Request,
    template: str,
    person: Experimenter,
    study: Study,
    context: dict[str, Any] | None = None,
    status_code: int = 200,
) -> Response:
    """Render a page of a study, under its name and tabs."""
    with database(request).reading() as connection:
        progress = progress_of(connection, study.id)
    tabs = [(path, name) for path, name, role in TABS if person.may(role)]
    base = f"/admin/studies/{study.slug}"
    frame = {"study": study, "progress": progress, "tabs": tabs, "base": base}
    return page(request, template, person, {**frame, **(context or {})}, status_code)


def turns(at: int, size: int, *, has_more: bool) -> dict[str, int | None]:
    """Return where the previous and next pages of a long list begin; None where there is none."""
    return {"before": max(0, at - size) if at else None, "after": at + size if has_more else None}


def see(path: str) -> Response:
    """Redirect to another page after a form."""
    return RedirectResponse(path, status_code=303)


def unix(text: str) -> str:
    """Return a form's text with a file's line ends."""
    return text.replace("\r\n", "\n").strip()
