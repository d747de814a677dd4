"""The pictures of the front page, from what `reconstudy demo` has made: `python docs/pictures.py demo`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from app.analysis.drawing.charts_in_common import svg_png
from app.analysis.report.figures import drawn_figures
from app.files import read_json, write_bytes
from recon.pipeline.preview import webp
from recon.render.sheet import contact_sheet

PICTURES = Path(__file__).parent / "pictures"
LARGEST = 200_000  # bytes
WIDTH = 1100  # pixels on the page
SCORES_WIDTH = 430  # of the figure, in the units of its letters, which are read in half of the page
UPPER_BODY = np.s_[40:250, 125:335]  # of a model's picture: where the approaches differ most


def main(demo: Path) -> None:
    """Write the two pictures."""
    front = demo / "front"
    models = [
        front / f"model_{depth}_{fusion}_photographs.webp" for fusion in ("fa", "fb") for depth in ("id", "dr", "pm")
    ]
    keep("models", sheet(models, UPPER_BODY, columns=3))
    figures = drawn_figures(read_json(demo / "analysis" / "analysis.json"), SCORES_WIDTH)
    scores = next(figure for figure in figures if figure.name == "scores")
    picture = cv2.imdecode(np.frombuffer(svg_png(scores.svg), np.uint8), cv2.IMREAD_COLOR_RGB)
    keep("scores", np.asarray(picture, np.uint8))


def sheet(paths: list[Path], part: Any, *, columns: int) -> NDArray[np.uint8]:
    """A part of each picture beside each other, under the names of what they show."""
    labels = [path.stem.removesuffix("_photographs").replace("_", " ", 1) for path in paths]
    return contact_sheet([read(path)[part] for path in paths], labels, columns=columns, width=WIDTH // columns)


def read(path: Path) -> NDArray[np.uint8]:
    """A picture, uint8 (H, W, 3), RGB."""
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR_RGB)
    if picture is None:
        raise SystemExit(f"{path}: is no picture; run `reconstudy demo` first")
    return np.asarray(picture, np.uint8)


def keep(name: str, picture: NDArray[np.uint8]) -> None:
    """Write a picture as WebP, no wider than the page."""
    width = min(WIDTH, picture.shape[1])
    height = round(picture.shape[0] * width / picture.shape[1])
    scaled = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    content = webp(scaled)
    if len(content) > LARGEST:
        raise SystemExit(f"{name}: {len(content)} bytes, expected at most {LARGEST}")
    write_bytes(PICTURES / f"{name}.webp", content)
    print(f"{name}.webp: {len(content)} bytes")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "demo"))
