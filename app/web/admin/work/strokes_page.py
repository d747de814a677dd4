"""Show the page to draw strokes on a capture's pictures, from which masks of all its frames are made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Annotated

from fastapi import APIRouter, Depends, Path, Request
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict

from app.errors import InvalidError, NotFoundError
from app.intake.captures import CameraPictures, read_outline
from app.intake.strokes import Stroke, read_strokes, replace_strokes
from app.operations.mask_trial import try_strokes
from app.web.admin.layout import page
from app.web.admin.work.files_page import Name, entry_address
from app.web.gates import Store, settings
from app.web.roles import Looking
from app.web.uploads import UploadingActor, entry_of

PICTURE = "/{sensor}/{side}/{frame}"

router = APIRouter(prefix="/admin/files/captures/{name}/strokes", include_in_schema=False)


@dataclass(frozen=True)
class Drawing:
    """A picture to draw on: the capture's folder and name, the camera and the frame."""

    folder: FilePath
    name: str
    camera: CameraPictures
    frame: int


def drawing(
    request: Request,
    name: Name,
    sensor: Annotated[str, Path(max_length=40)],
    side: Annotated[str, Path(max_length=10)],
    frame: Annotated[str, Path(max_length=8)],
) -> Drawing:
    """Find the picture that an address names.

    Raises
    ------
    NotFoundError
        If there is no such capture or picture.
    """
    folder = entry_of(settings(request), "captures", name)
    try:
        outline = read_outline(folder)
        return Drawing(folder, name, outline.camera(sensor, side), outline.frame(frame))
    except InvalidError as error:
        raise NotFoundError(error.detail) from error


ADrawing = Annotated[Drawing, Depends(drawing)]


class DrawnStrokes(BaseModel):
    """All strokes on a picture."""

    model_config = ConfigDict(extra="forbid", strict=True)

    strokes: list[Stroke]


@router.get("")
def strokes_page(request: Request, person: Looking, name: Name) -> Response:
    folder = entry_of(settings(request), "captures", name)
    outline = read_outline(folder)
    base = entry_address("captures", name)
    cameras = [
        {"sensor": camera.sensor, "side": camera.side, "width": camera.width, "height": camera.height}
        for camera in outline.cameras
    ]
    drawn = {
        "base": base,
        "cameras": cameras,
        "n_frames": outline.n_frames,
        "strokes": [stroke.model_dump(mode="json") for stroke in read_strokes(folder)],
    }
    return page(request, "strokes", person, {"name": name, "base": base, "outline": outline, "drawn": drawn})


@router.put(PICTURE, status_code=204)
def keep(actor: UploadingActor, picture: ADrawing, drawn: DrawnStrokes, store: Store) -> None:
    """Replace the strokes on a picture."""
    replace_strokes(picture.folder, picture.camera, picture.frame, drawn.strokes)
    with store.writing() as connection:
        place = f"{picture.camera.name}/{picture.frame}"
        actor.note(connection, "strokes drawn", subject=f"captures/{picture.name}", picture=place)


@router.post(f"{PICTURE}/mask")
def try_mask(_actor: UploadingActor, picture: ADrawing) -> Response:
    """Answer with the mask that the strokes on a picture make, as PNG."""
    return Response(try_strokes(picture.folder, picture.camera, picture.frame), media_type="image/png")
