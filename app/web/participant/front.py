"""The demo's front page: what the demo has made, and links to every part of it.

Only the demo has it, because it shows the experimenter's sign-in link; the demo listens to its own machine alone.
"""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, Response

from app.errors import NotFoundError
from app.files import read_json
from app.web.gates import render
from app.web.media import SANDBOX
from app.web.participant.entrance import see_invitation

FRONT_FILE = "front.json"
MADE = ("run", "stimuli", "validation", "analysis")  # folders whose files it links to, beside the study's own


def front_routes(folder: Path) -> APIRouter:
    """Make the routes of a front page.

    Parameters
    ----------
    folder : holds `front.json` and the pictures that it names; beside it lies what the demo has made
    """
    router = APIRouter(include_in_schema=False)

    @router.get("/")
    def front_page(request: Request, code: str = "") -> Response:
        if code.strip():
            return see_invitation(code)
        return render(request, "front.html", read_json(folder / FRONT_FILE), headers={"Cache-Control": "no-store"})

    @router.get("/front/{name}")
    def picture(name: str) -> Response:
        path = folder / name
        if path.suffix not in (".webp", ".svg", ".jpg") or path.parent != folder or not path.is_file():
            raise NotFoundError("There is no such picture.")
        return FileResponse(path)

    @router.get("/made/{place:path}")
    def made(place: str) -> Response:
        path, parts = (folder.parent / place).resolve(), [(folder.parent / part).resolve() for part in MADE]
        if not any(path.is_relative_to(part) for part in parts) or not path.is_file():
            raise NotFoundError("The demo has made no such file.")
        return FileResponse(path, headers={"Content-Security-Policy": SANDBOX})

    return router
