"""Contact sheets: pictures of a run side by side, to look at."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

GAP = 8  # pixels between pictures
LABEL = 28  # pixels above each picture for its label
PAPER, INK = 245, (40, 40, 40)


def contact_sheet(
    images: Sequence[NDArray[np.uint8]], labels: Sequence[str], *, columns: int = 3, width: int = 480
) -> NDArray[np.uint8]:
    """Lay out pictures in rows under their labels, all of the same width, on cells as high as the tallest.

    Parameters
    ----------
    images : uint8 (H, W, 3) sRGB or (H, W) grey each
    labels : for each picture
    columns : pictures in a row
    width : of a picture, pixels

    Returns
    -------
    uint8 (H, W, 3), sRGB

    Raises
    ------
    ValueError
        If there is no picture, or labels and pictures differ in number.
    """
    if not images or len(images) != len(labels):
        raise ValueError(f"a contact sheet needs pictures and a label each, found {len(images)} and {len(labels)}")
    cells = [_scaled(image, width) for image in images]
    height = max(cell.shape[0] for cell in cells)
    columns = min(columns, len(cells))
    rows = -(-len(cells) // columns)
    step_y, step_x = height + LABEL + GAP, width + GAP
    sheet = np.full((rows * step_y + GAP, columns * step_x + GAP, 3), PAPER, dtype=np.uint8)
    for number, (cell, label) in enumerate(zip(cells, labels, strict=True)):
        top, left = number // columns * step_y + GAP, number % columns * step_x + GAP
        sheet[top + LABEL : top + LABEL + cell.shape[0], left : left + width] = cell
        strip = np.full((LABEL, width, 3), PAPER, dtype=np.uint8)
        cv2.putText(strip, label, (2, LABEL - 9), cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
        sheet[top : top + LABEL, left : left + width] = strip
    return sheet


def _scaled(image: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    colour = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
    height = max(1, round(colour.shape[0] * width / colour.shape[1]))
    interpolation = cv2.INTER_AREA if width < colour.shape[1] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(colour, (width, height), interpolation=interpolation), np.uint8)
