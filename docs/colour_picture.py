"""The pictures of colours in docs/surface.md: `python docs/colour_picture.py NAME RUN:APPROACH:VIEW:COLUMN,ROW ...`.

For each run the surface by an approach, with colours of vertices and of photographs, beside the photograph of a view
such as held_out/0000.png or S1/left; cut to a square around a pixel.
"""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
from pictures import keep

from recon.capture.format import read_capture
from recon.geometry.mesh_files import read_mesh
from recon.pipeline.run import mesh_name, read_run, recorded_in
from recon.validation.views.novel_view import photographs, rendered

SIDE, SHOWN = 220, 300  # pixels of the photograph, and of the picture


def row(run: Path, approach: str, view: str, middle: tuple[int, int]) -> np.ndarray:
    """Both renderings and the photograph, side by side."""
    described = read_run(run)
    frame = described.frames[0]
    shots = {shot.name: shot for shot in photographs(read_capture(recorded_in(described)), [frame])}
    photograph = shots[view]
    names = (approach, f"{approach}_photographs")
    meshes = [read_mesh(run / mesh_name(name, frame)) for name in names]
    drawn = [np.where(cover[..., None], shown, 0) for shown, cover in (rendered(m, photograph.camera) for m in meshes)]
    left, top = (max(0, place - SIDE // 2) for place in middle)
    cut = np.s_[top : top + SIDE, left : left + SIDE]
    parts = [np.ascontiguousarray(picture[cut]) for picture in (*drawn, photograph.pixels)]
    return np.hstack([cv2.resize(part, (SHOWN, SHOWN), interpolation=cv2.INTER_CUBIC) for part in parts])


def main(name: str, wanted: list[str]) -> None:
    """Draw a row for each run and write the picture."""
    rows = []
    for each in wanted:
        run, approach, view, middle = each.split(":")
        column, line = (int(number) for number in middle.split(","))
        rows.append(row(Path(run), approach, view, (column, line)))
    keep(name, np.vstack(rows))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
