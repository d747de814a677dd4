"""What a frame of a film and the reference's look like beside each other."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.render.encoding.quality import MARGIN
from recon.validation.films.likeness import similarity_map
from recon.validation.pictures import ORANGE, tile, window_around

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
    shown = np.ones(image.shape, np.bool_) if silhouette is None else silhouette
    tiles = []
    for title, grey in zip(TITLES, (reference, image, likeness_grey), strict=True):
        coloured = np.repeat(grey[..., None], 3, axis=2)
        if silhouette is not None:
            outlines, _ = cv2.findContours(silhouette.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(coloured, outlines, -1, ORANGE, 1)
        tiles.append(tile(coloured[window_around(shown)], title))
    return np.concatenate(tiles, axis=1)
