"""The pictures of docs/surface.md: models beside a photograph, `python docs/views_picture.py NAME ROW...`.

A ROW is VIEW:COLUMN,ROW,WIDTH,HEIGHT:RUN/APPROACH,RUN/APPROACH,...: the photograph of a view of the first run's
recording, such as S1_S2/0000.png or S1/left, cut to a rectangle of pixels, and the models seen from there.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pictures import WIDTH, keep

from recon.capture.format import read_capture
from recon.geometry.mesh_files import read_mesh
from recon.pipeline.run import read_run, recorded_in
from recon.render.sheet import contact_sheet
from recon.validation.views.novel_view import photographs, rendered

BACKGROUND = 235  # grey level where a model covers nothing


def row(view: str, rectangle: str, models: str) -> NDArray[np.uint8]:
    """Draw the models of a row, and what the camera saw."""
    paths = [Path(model) for model in models.split(",")]
    runs = [read_run(path.parent.resolve()) for path in paths]
    frame = runs[0].frames[0]
    shots = {shot.name: shot for shot in photographs(read_capture(recorded_in(runs[0])), [frame])}
    left, top, width, height = map(int, rectangle.split(","))
    cut = np.s_[top : top + height, left : left + width]
    panels = [shots[view].pixels[cut]]
    for path in paths:
        shown, cover, _ = rendered(read_mesh(path.parent / runs[0].mesh_name(path.name, frame)), shots[view].camera)
        panels.append(np.where(cover[..., None], shown, BACKGROUND)[cut].astype(np.uint8))
    is_one_run = len({path.parent for path in paths}) == 1
    names = [path.name if is_one_run else f"{path.name}, {path.parent.name}" for path in paths]
    return contact_sheet(panels, ["photograph", *names], columns=len(panels), width=WIDTH // len(panels))


if __name__ == "__main__":
    rows = [row(*each.split(":")) for each in sys.argv[2:]]
    keep(sys.argv[1], np.vstack([part[:, : min(each.shape[1] for each in rows)] for part in rows]))
