"""What a frame of a film and the reference's look like beside each other."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.validation.films.likeness import MARGIN, similarity_map

TILE_PX, TITLE_PX = 300, 22
AROUND = 0.05  # of the silhouette's longer side: what is shown around it
OUTLINE = (213, 94, 0)  # Okabe and Ito's vermilion
TITLES = ("reference", "film", "SSIM: black is unlike")


def comparison_picture(
    image: NDArray[np.uint8], reference: NDArray[np.uint8], silhouette: NDArray[np.bool_] | None
) -> NDArray[np.uint8]:
    """Draw the reference's frame, the film's, and the map of SSIM, uint8 (H', W', 3) RGB, side by side.

    Parameters
    ----------
    image, reference : uint8 (H, W), luma
    silhouette : bool (H, W), whose outline is drawn and around which the pictures are cut; None for the whole frame
    """
    likeness = np.pad(similarity_map(image, reference), MARGIN, constant_values=1)
    likeness_grey = np.rint(255 * np.clip(likeness, 0, 1)).astype(np.uint8)
    window = _window(silhouette)
    tiles = []
    for title, grey in zip(TITLES, (reference, image, likeness_grey), strict=True):
        coloured = np.repeat(grey[..., None], 3, axis=2)
        if silhouette is not None:
            outlines, _ = cv2.findContours(silhouette.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(coloured, outlines, -1, OUTLINE, 1)
        tiles.append(_tile(coloured[window], title))
    return np.concatenate(tiles, axis=1)


def _window(silhouette: NDArray[np.bool_] | None) -> tuple[slice, slice]:
    if silhouette is None or not silhouette.any():
        return slice(None), slice(None)
    rows, columns = (np.flatnonzero(silhouette.any(axis=axis)) for axis in (1, 0))
    margin = round(AROUND * max(np.ptp(rows), np.ptp(columns))) + 1
    top, left = max(rows[0] - margin, 0), max(columns[0] - margin, 0)
    return slice(top, rows[-1] + margin), slice(left, columns[-1] + margin)


def _tile(pixels: NDArray[np.uint8], title: str) -> NDArray[np.uint8]:
    scale = TILE_PX / max(pixels.shape[:2])
    size = (max(1, round(pixels.shape[1] * scale)), max(1, round(pixels.shape[0] * scale)))
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST)
    tile = np.full((small.shape[0] + TITLE_PX, max(small.shape[1], TILE_PX // 2) + 8, 3), 255, np.uint8)
    tile[TITLE_PX:, : small.shape[1]] = small
    cv2.putText(tile, title, (0, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (0, 0, 0), 1, cv2.LINE_AA)
    return tile
