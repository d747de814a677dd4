"""The pictures of docs/surface.md: models beside a photograph, `python docs/views_picture.py NAME ROW...`.

A ROW is VIEW:COLUMN,ROW,WIDTH,HEIGHT:RUN/APPROACH,RUN/APPROACH,...: the photograph of a view of the first run's
recording, such as S1_S2/0000.png or S1/left, cut to a rectangle of pixels, and the models seen from there.

`--blind FOLDER` in place of NAME writes each row's models without names and in random order, 1-A.png, 1-B.png ..., and
what they are into key.json, to be opened when they were judged.
"""

from __future__ import annotations

import random
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from pictures import WIDTH, keep

from recon.capture.format import read_capture
from recon.geometry.mesh_files import read_mesh
from recon.pipeline.run import read_run, recorded_in
from recon.render.sheet import contact_sheet
from recon.runtime.files import write_json
from recon.validation.views.novel_view import photographs, rendered

BACKGROUND = 235  # grey level where a model covers nothing
BLIND_HEIGHT = 720  # pixels

Panels = dict[str, NDArray[np.uint8]]


def panels(view: str, rectangle: str, models: str) -> Panels:
    """Draw the models of a row, after what the camera saw, by their names."""
    paths = [Path(model) for model in models.split(",")]
    runs = [read_run(path.parent.resolve()) for path in paths]
    frame = runs[0].frames[0]
    shots = {shot.name: shot for shot in photographs(read_capture(recorded_in(runs[0])), [frame])}
    left, top, width, height = map(int, rectangle.split(","))
    cut = np.s_[top : top + height, left : left + width]
    drawn = {"photograph": shots[view].pixels[cut]}
    is_one_run = len({path.parent for path in paths}) == 1
    for path, run in zip(paths, runs, strict=True):
        shown, cover, _ = rendered(read_mesh(path.parent / run.mesh_name(path.name, frame)), shots[view].camera)
        name = path.name if is_one_run else f"{path.name}, {path.parent.name}"
        drawn[name] = np.where(cover[..., None], shown, BACKGROUND)[cut].astype(np.uint8)
    return drawn


def sheet(drawn: Panels) -> NDArray[np.uint8]:
    """Put a row's pictures beside each other, under their names."""
    return contact_sheet([*drawn.values()], [*drawn], columns=len(drawn), width=WIDTH // len(drawn))


def write_blind(folder: Path, rows: list[Panels]) -> None:
    """Write the photographs, and the models in random order."""
    key: dict[str, str] = {}
    for number, drawn in enumerate(rows, 1):
        names = [name for name in drawn if name != "photograph"]
        random.SystemRandom().shuffle(names)
        shown = {f"{number}-photograph": "photograph"} | {
            f"{number}-{chr(65 + n)}": each for n, each in enumerate(names)
        }
        for called, name in shown.items():
            size = (round(drawn[name].shape[1] * BLIND_HEIGHT / drawn[name].shape[0]), BLIND_HEIGHT)
            large = cv2.resize(drawn[name], size, interpolation=cv2.INTER_CUBIC)
            cv2.imwrite(str(folder / f"{called}.png"), large[..., ::-1])
        key |= shown
    write_json(folder / "key.json", key)


if __name__ == "__main__":
    blind = sys.argv[1] == "--blind"
    rows = [panels(*each.split(":")) for each in sys.argv[3 if blind else 2 :]]
    if blind:
        write_blind(Path(sys.argv[2]), rows)
    else:
        sheets = [sheet(drawn) for drawn in rows]
        keep(sys.argv[1], np.vstack([part[:, : min(each.shape[1] for each in sheets)] for part in sheets]))
