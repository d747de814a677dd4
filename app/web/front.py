"""The demo's front page: what the product does, shown by what the demo has just made, and where to go from there.

It hands out the experimenter's sign-in link, so only the demo has it, which listens to its own machine alone.
"""

from __future__ import annotations

from pathlib import Path
from urllib.parse import quote

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, RedirectResponse, Response

from app.errors import NotFoundError
from app.files import read_json

FRONT_FILE = "front.json"


def front_routes(folder: Path) -> APIRouter:
    """Routes of a front page whose content and pictures lie in a folder.

    Parameters
    ----------
    folder : with `front.json` and the pictures that it names
    """
    router = APIRouter(include_in_schema=False)

    @router.get("/")
    def front_page(request: Request, code: str = "") -> Response:
        if code.strip():
            return RedirectResponse(f"/s/{quote(code.strip(), safe='')}", status_code=303)
        page: Response = request.app.state.templates.TemplateResponse(
            request, "front.html", read_json(folder / FRONT_FILE), headers={"Cache-Control": "no-store"}
        )
        return page

    @router.get("/front/{name}")
    def picture(name: str) -> Response:
        path = folder / name
        if path.suffix not in (".webp", ".svg", ".jpg") or path.parent != folder or not path.is_file():
            raise NotFoundError("There is no such picture.")
        return FileResponse(path)

    return router
