"""Serve the manual, so that every page can lead to its own of it, also where there is no way out to the internet."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Request
from fastapi.responses import FileResponse, Response

from app.errors import NotFoundError
from app.files import packaged
from app.web.admin.layout import page
from app.web.admin.manual_reference import jobs, settings, tables
from app.web.markdown import render_manual
from app.web.roles import Person

PAGES = {  # in the order of the list, which leaves out what is for developers
    "begin": "Begin with what you have",
    "experimenter": "The dashboard",
    "studies": "Studies",
    "recruiting": "Recruiting",
    "screening": "Screening",
    "languages": "Languages",
    "ratings": "Ratings",
    "analysis": "Analysis",
    "measures": "Measures",
    "models": "Your own models",
    "splats": "Gaussian splats",
    "capture": "Recordings",
    "cameras": "Other cameras and programs",
    "depth": "Depth",
    "surface": "Surfaces and videos",
    "validation": "Validation",
    "intake": "Files on the server",
    "work": "Work on the server",
    "formats": "Formats",
    "api": "Results over REST",
    "python": "Python",
    "r": "R",
    "simulation": "How often analyses err",
    "experiment": "The paper’s experiment",
    "comparison": "Other tools",
    "security": "Security",
    "operations": "Run a server",
    "settings": "Settings",
    "jobs": "Jobs",
    "tables": "Tables of results",
    "troubleshooting": "When something is wrong",
}
WRITTEN = {"settings": settings, "jobs": jobs, "tables": tables}  # pages that follow from the program
PICTURES = {".webp": "image/webp", ".svg": "image/svg+xml", ".png": "image/png"}

router = APIRouter(prefix="/admin/manual", include_in_schema=False)

Name = Annotated[str, Path(max_length=80)]


@router.get("")
def first_page(request: Request, person: Person) -> Response:
    return manual_page(request, person, "experimenter")


@router.get("/pictures/{name}")
def picture(_person: Person, name: Name) -> Response:
    folder = packaged("docs") / "pictures"
    chosen = next((path for path in folder.glob("*") if path.name == name and path.suffix in PICTURES), None)
    if chosen is None:
        raise NotFoundError("The manual has no such picture.")
    headers = {"Cache-Control": "private, max-age=86400"}
    return FileResponse(chosen, media_type=PICTURES[chosen.suffix], headers=headers)


@router.get("/{name}")
def manual_page(request: Request, person: Person, name: Name) -> Response:
    """Show a page of the manual, by its name in the list: a name from outside never becomes a path."""
    if name not in PAGES:
        raise NotFoundError("The manual has no such page.")
    context = {"text": render_manual(text_of(name), PAGES), "pages": PAGES, "name": name}
    return page(request, "manual", person, context)


def text_of(name: str) -> str:
    """Return a page of the manual as Markdown."""
    return WRITTEN[name]() if name in WRITTEN else (packaged("docs") / f"{name}.md").read_text(encoding="utf-8")
