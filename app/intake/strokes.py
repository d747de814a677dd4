"""Keep the strokes that somebody draws on a capture's pictures, in the form that `reconstudy capture segment` takes.

They lie in `strokes.json` in the capture's folder: {"strokes": [{"sensor", "side", "frame", "label", "points":
[[column, row], ...], "width"}, ...]}, in pixels. A picture needs strokes on the foreground and on the background, and a
camera needs one such picture.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from app.errors import InvalidError
from app.files import read_json_bytes, write_json
from app.intake.captures import SIDES, CameraPictures
from ground.file_models import first_fault

STROKES_FILE = "strokes.json"
MOST_STROKES = 400  # on a picture

Pixel = Annotated[float, Field(ge=0, lt=65536, allow_inf_nan=False)]


class Stroke(BaseModel):
    """A line of a width over pixels that belong to the foreground, or to the background."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    label: Literal["foreground", "background"]
    points: Annotated[list[tuple[Pixel, Pixel]], Field(min_length=1, max_length=4000)]
    width: Annotated[int, Field(ge=1, le=500)] = 5


class PlacedStroke(Stroke):
    """A stroke, and the picture that it is on."""

    model_config = ConfigDict(extra="ignore")  # of a file that another program may have written

    sensor: str
    side: Literal["left", "right"]
    frame: Annotated[int, Field(ge=0)]


class _StrokesFile(BaseModel):
    strokes: list[PlacedStroke] = []


def read_strokes(folder: Path) -> list[PlacedStroke]:
    """Read all strokes of a capture; none where nobody has drawn.

    Raises
    ------
    InvalidError
        If the file is damaged: names the first fault.
    """
    try:
        return _StrokesFile.model_validate_json(read_json_bytes(folder / STROKES_FILE)).strokes
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        raise InvalidError(
            f"{STROKES_FILE} in the capture's folder cannot be read: {first_fault(error, _StrokesFile)}. "
            "Correct the file or delete it."
        ) from error


def replace_strokes(folder: Path, camera: CameraPictures, frame: int, strokes: Sequence[Stroke]) -> None:
    """Replace the strokes on a picture; those on others stay as they are.

    Parameters
    ----------
    folder : the capture's
    camera, frame : of the picture
    strokes : the new ones

    Raises
    ------
    InvalidError
        If there are too many, or one leads out of the picture.
    """
    if len(strokes) > MOST_STROKES:
        raise InvalidError(f"There are {len(strokes)} strokes on this picture; {MOST_STROKES} are enough.")
    if any(x > camera.width - 0.5 or y > camera.height - 0.5 for stroke in strokes for x, y in stroke.points):
        raise InvalidError(f"A stroke leads out of the picture of {camera.width}x{camera.height} pixels.")
    place = (camera.sensor, camera.side, frame)
    with _alone(folder):
        kept = [stroke for stroke in read_strokes(folder) if (stroke.sensor, stroke.side, stroke.frame) != place]
        values = {"sensor": camera.sensor, "side": camera.side, "frame": frame}
        added = [PlacedStroke.model_validate({**stroke.model_dump(), **values}) for stroke in strokes]
        ordered = sorted([*kept, *added], key=lambda stroke: (stroke.sensor, SIDES.index(stroke.side), stroke.frame))
        write_json(folder / STROKES_FILE, {"strokes": [stroke.model_dump(mode="json") for stroke in ordered]})


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Let one request at a time read the file and write it again, in all processes of the server."""
    opened = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(opened, fcntl.LOCK_EX)
        yield
    finally:
        os.close(opened)
