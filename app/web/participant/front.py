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
from app.web.participant.entrance import see_invitation

FRONT_FILE = "front.json"


def front_routes(folder: Path) -> APIRouter:
    """Make the routes of a front page.

    Parameters
    ----------
    folder : holds `front.json` and the pictures that it names
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

    return router
