"""Render the frame of the experimenter's pages (navigation, head, tabs); redirect and read texts of forms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote

from fastapi import Request
from fastapi.responses import RedirectResponse, Response

from app.intake.bounds import load_readers
from app.store.access.experimenters import Experimenter
from app.store.access.rights import Role
from app.store.studies.studies import Study, progress_of
from app.web.admin.alarms import alarm_in
from app.web.gates import database, now, render
from app.web.security import policy

TABS: tuple[tuple[str, str, Role], ...] = (
    ("", "Overview", "viewer"),
    ("/results", "Results", "viewer"),
    ("/objective", "Objective", "viewer"),
    ("/models", "3D", "experimenter"),
    ("/participants", "Participants", "experimenter"),
    ("/votes", "Votes", "experimenter"),
    ("/design", "Design", "viewer"),
    ("/stimuli", "Films", "viewer"),
    ("/invitations", "Invitations", "experimenter"),
    ("/texts", "Texts", "experimenter"),
    ("/edit", "Settings", "experimenter"),
)
SUB_TABS: tuple[tuple[tuple[str, str, Role], ...], ...] = (  # the pages of one tab
    (("/results", "All participants", "viewer"), ("/results/groups", "Groups", "experimenter")),
    (("/objective", "Reports", "viewer"), ("/objective/scores", "Against the scores", "viewer")),
    (
        ("/participants", "Participants", "experimenter"),
        ("/participants/comments", "Comments", "experimenter"),
        ("/participants/demographics", "Demographics", "experimenter"),
    ),
)


MANUAL = {  # where the manual speaks of a page, by its template; of others in its first page
    "account": "experimenter#first-start",
    "against_scores": "analysis#do-objective-measures-predict-the-scores",
    "comments": "experimenter#while-it-runs",
    "demographics": "experimenter#while-it-runs",
    "design": "studies#orders",
    "edit": "studies#options",
    "file_entry": "intake",
    "files": "intake",
    "groups": "experimenter#results",
    "invitations": "experimenter#invitations",
    "models": "experimenter#results",
    "new_study": "experimenter#a-study",
    "new_study_settings": "experimenter#a-study",
    "objective": "measures",
    "overview": "experimenter#while-it-runs",
    "participant": "experimenter#while-it-runs",
    "participants": "experimenter#while-it-runs",
    "results": "experimenter#results",
    "set": "studies#stimulus-sets",
    "sets": "studies#stimulus-sets",
    "settings": "operations",
    "stimuli": "studies#films-that-fail",
    "strokes": "intake#draw-strokes-for-masks",
    "studies": "experimenter#a-study",
    "table_reading": "analysis#votes",
    "task": "work",
    "texts": "languages",
    "tokens": "api#a-token",
    "users": "experimenter#first-start",
    "votes": "experimenter#while-it-runs",
    "work": "work",
    "work_job": "work",
    "work_new": "work",
}


def page(
    request: Request, template: str, person: Experimenter, context: dict[str, Any], status_code: int = 200
) -> Response:
    """Render a page for the signed-in person; its forms carry the session's form token."""
    if person.may("experimenter"):  # who may send what is read in bounds
        load_readers()
    manual = MANUAL.get(template, "experimenter")
    frame = {"experimenter": person, "form_token": request.state.form_token, "now": now(request), "manual": manual}
    return render(request, f"admin/{template}.html", {**frame, **context}, status_code)


def study_page(
    request: Request,
    template: str,
    person: Experimenter,
    study: Study,
    context: dict[str, Any] | None = None,
    status_code: int = 200,
) -> Response:
    """Render a page of a study, under its name and tabs, and the alarm of films that fail."""
    alarm = alarm_in(database(request), study)
    with database(request).reading() as connection:
        progress = progress_of(connection, study.id)
    base = f"/admin/studies/{study.slug}"
    frame = {
        "study": study,
        "progress": progress,
        "base": base,
        "tabs": _tabs(request.url.path, person, base),
        "sub_tabs": _sub_tabs(request.url.path, person, base),
        "alarm": alarm,
    }
    return page(request, template, person, {**frame, **(context or {})}, status_code)


def _tabs(path: str, person: Experimenter, base: str) -> list[dict[str, Any]]:
    """Return the tabs of a study that a person may open; `is_current` marks that of the page at `path`."""
    shown = [(base + tab, name) for tab, name, role in TABS if person.may(role)]
    return [
        {
            "address": address,
            "name": name,
            "is_current": path == address or (address != base and path.startswith(f"{address}/")),
        }
        for address, name in shown
    ]


def _sub_tabs(path: str, person: Experimenter, base: str) -> list[dict[str, Any]]:
    """Return the pages of the tab that the page at `path` belongs to, where a person may open several."""
    for tab in SUB_TABS:
        shown = [(base + address, name) for address, name, role in tab if person.may(role)]
        if len(shown) > 1 and path in dict(shown):
            return [{"address": address, "name": name, "is_current": path == address} for address, name in shown]
    return []


def viewing(answer: Response, models: Sequence[Mapping[str, Any]]) -> Response:
    """Let a page of models draw its splats: Spark orders them by WebAssembly, in a worker made of its own text."""
    if any(model["kind"] == "splat" for model in models):
        more = "script-src 'self' 'wasm-unsafe-eval'; worker-src 'self' blob:"
        answer.headers["Content-Security-Policy"] = f"{policy(None)}; {more}"
    return answer


def attachment(name: str) -> str:
    """Return the header that lets the browser save an answer under a name, in any script (RFC 6266)."""
    return f"attachment; filename*=utf-8''{quote(name)}" if quote(name) != name else f'attachment; filename="{name}"'


def see(path: str) -> Response:
    """Redirect to another page after a form."""
    return RedirectResponse(path, status_code=303)


def unix(text: str) -> str:
    """Return a form's text with a file's line ends."""
    return text.replace("\r\n", "\n").strip()
