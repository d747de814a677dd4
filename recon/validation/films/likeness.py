"""Likeness of two frames in luma, over the whole picture and inside a silhouette: PSNR, SSIM and MS-SSIM."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.render.encoding.quality import WINDOW_PX, psnr_db, ssim_maps, without_margin

SCALE_WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)  # Wang, Simoncelli, Bovik (2003), section 3.2
SMALLEST_PX = WINDOW_PX * 2 ** (len(SCALE_WEIGHTS) - 1)  # the window must fit into the smallest scale


@dataclass(frozen=True)
class Likeness:
    """Likeness of two frames over a region.

    Parameters
    ----------
    psnr_y : dB, infinite for equal frames
    ssim : -1 to 1
    ms_ssim : 0 to 1; None for pictures with a side shorter than `SMALLEST_PX`
    """

    psnr_y: float
    ssim: float
    ms_ssim: float | None


def likenesses(
    image: NDArray[np.uint8], reference: NDArray[np.uint8], regions: Sequence[NDArray[np.bool_]] = ()
) -> list[Likeness]:
    """Compare two frames over the whole picture, then inside each region.

    SSIM is the mean of its map over the pixels whose window lies inside the picture. In a region, each pixel of a map
    counts by the share of it that the region covers, at every scale.

    Parameters
    ----------
    image, reference : uint8 (H, W), luma as stored; both sides at least 11 pixels
    regions : bool (H, W) each, none empty

    Source
    ------
    Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to structural similarity" (2004),
    equation 13. Wang, Simoncelli, Bovik, "Multiscale structural similarity for image quality assessment" (2003),
    equation 7, with negative means of contrast and structure taken as 0.
    """
    a, b = image.astype(np.float32), reference.astype(np.float32)
    weights: list[NDArray[np.float32] | None] = [None, *(region.astype(np.float32) for region in regions)]
    squared = np.square(a - b)
    psnrs = [psnr_db(_mean(squared, weight)) for weight in weights]
    n_scales = len(SCALE_WEIGHTS) if min(image.shape) >= SMALLEST_PX else 1
    structures, similarities = np.empty((len(weights), n_scales)), np.empty((len(weights), n_scales))
    for scale in range(n_scales):
        structure, similarity = map(without_margin, ssim_maps(a, b))
        for index, weight in enumerate(weights):
            inside = None if weight is None else without_margin(weight)
            structures[index, scale] = _mean(structure, inside)
            similarities[index, scale] = _mean(similarity, inside)
        if scale + 1 < n_scales:
            a, b = _halved(a), _halved(b)
            weights = [None if weight is None else _halved(weight) for weight in weights]
    return [
        Likeness(psnr, float(similarity[0]), _multi_scale(structure, similarity) if n_scales > 1 else None)
        for psnr, structure, similarity in zip(psnrs, structures, similarities, strict=True)
    ]


def similarity_map(image: NDArray[np.uint8], reference: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Compute SSIM at each pixel of two frames uint8 (H, W), float32 (H - 10, W - 10): without the edge."""
    return without_margin(ssim_maps(image.astype(np.float32), reference.astype(np.float32))[1])


def _multi_scale(structures: NDArray[np.float64], similarities: NDArray[np.float64]) -> float:
    """Combine the means of each scale, finest first; the coarsest counts with its luminance."""
    terms = np.maximum([*structures[:-1], similarities[-1]], 0.0)
    return float(np.prod(terms ** np.array(SCALE_WEIGHTS)))


def _mean(values: NDArray[np.float32], weight: NDArray[np.float32] | None) -> float:
    if weight is None:
        return float(values.mean(dtype=np.float64))
    total = float(weight.sum(dtype=np.float64))
    # A region of a few pixels along the edge may vanish from the inner part: then all of the map counts alike.
    return float(np.vdot(values, weight)) / total if total else float(values.mean(dtype=np.float64))


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Average squares of four pixels; an odd last row or column is left out."""
    rows, columns = image.shape[0] // 2, image.shape[1] // 2
    return np.asarray(cv2.resize(image[: 2 * rows, : 2 * columns], (columns, rows), interpolation=cv2.INTER_AREA))
