"""Masks made exact at their outline: by how steeply the evidence falls, and by GrabCut where it says nothing."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

EDGE_PX = 2  # how far a threshold's outline lies outside the object's at most
NEIGHBOURHOOD_PX = 4  # from which the object's typical evidence is taken
HALF = 0.5  # a blurred edge is where half of the object's evidence is left
LIT = 0.3  # of the threshold: a background as bright may be brighter than it beside the object, by stray light
TRIMS = 6  # of EDGE_PX each, as far as stray light reaches
ACROSS_PX = 8  # a neighbourhood that reaches across it
BESIDE_PX = 9  # from a mask on, there is background only
REACH_PX = 16  # how far from the mask GrabCut may add, at 1000 pixels of picture height
ROUNDS = 2  # of GrabCut
PATTERN_PX = 3.0  # standard deviation; a background's pattern is what is finer
PATTERN_WINDOW_PX = 9  # in which two pictures are compared
KEPT = 0.7  # correlation with the plate from which a place shows the plate's pattern
REPLACED = 0.35  # below which it shows something else
SMALLEST_PX = 5  # diameter of such a place; compression leaves narrower ones beside outlines
MARGIN_PX = 20  # of background around, for GrabCut's colours
Models = tuple[NDArray[np.float64], NDArray[np.float64]]
"""GrabCut's colours of background and foreground."""


def edge_share(mask: NDArray[np.bool_]) -> float:
    """Return the share of a picture's outermost pixels that a mask, bool (H, W), covers."""
    return float(np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]]).mean())


def tightened(
    mask: NDArray[np.bool_],
    evidence: NDArray[np.float32],
    background: NDArray[np.float32] | float = 0.0,
    reach: int = NEIGHBOURHOOD_PX,
) -> NDArray[np.bool_]:
    """Trim from a mask the rim where less than half of the object's own evidence is left.

    Parameters
    ----------
    mask : bool (H, W)
    evidence : float32 (H, W), high where the object is; its blur has put the threshold's outline outside
    background : float32 (H, W), the evidence that what lies behind the object would give
    reach : pixels around, from which the object's typical evidence is taken
    """
    inner = cv2.erode(mask.astype(np.uint8), None, iterations=EDGE_PX)
    typical, weight = _around(inner, evidence, reach)
    rim = mask & (inner == 0) & (weight > 0)
    return np.asarray(mask & ~(rim & (evidence < background + HALF * (typical - background))))


def without_lit_background(
    mask: NDArray[np.bool_], brightness: NDArray[np.float32], threshold: float
) -> NDArray[np.bool_]:
    """Trim from a mask what is rather its background, where that is not black and stray light falls on it.

    Parameters
    ----------
    mask : bool (H, W)
    brightness : float32 (H, W)
    threshold : of the brightness, above which the mask was made
    """
    beyond = cv2.erode((~mask).astype(np.uint8), None, iterations=BESIDE_PX)
    background, _ = _around(beyond, brightness, 2 * BESIDE_PX)
    lit = background > LIT * threshold
    for _ in range(TRIMS):
        trimmed = mask & lit & ~tightened(mask, brightness, background, ACROSS_PX)
        if not trimmed.any():
            break
        mask = mask & ~trimmed
    return mask


def _around(
    chosen: NDArray[np.uint8], evidence: NDArray[np.float32], reach: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Average the evidence of chosen pixels around each one; returns it, 0 where there are none, and their share."""
    window = (2 * reach + 1, 2 * reach + 1)
    share = cv2.boxFilter(chosen.astype(np.float32), -1, window)
    return np.asarray(cv2.boxFilter(chosen * evidence, -1, window) / np.maximum(share, 1e-6)), np.asarray(share)


def grown(picture: NDArray[np.uint8], mask: NDArray[np.bool_], doubtful: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Add to a mask those doubtful pixels near it whose colours are the object's rather than the background's.

    Parameters
    ----------
    picture : uint8 (H, W, 3)
    mask, doubtful : bool (H, W)
    """
    reach = max(3, round(REACH_PX * mask.shape[0] / 1000))
    near = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=reach) > 0
    seeds = np.where(mask, cv2.GC_FGD, np.where(near & doubtful, cv2.GC_PR_BGD, cv2.GC_BGD)).astype(np.uint8)
    return cut(picture, seeds, ROUNDS)[0] if (near & doubtful & ~mask).any() else mask


def likeness(
    picture: NDArray[np.float32], plate: NDArray[np.float32], left_out: NDArray[np.bool_], changed: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """Correlate the fine pattern of a picture with that of the clean plate around each pixel.

    A shadow keeps the plate's pattern, however dark it is; an object hides it.

    Parameters
    ----------
    picture, plate : float32 (H, W, 3), smoothed
    left_out : bool (H, W), where the object is known to be, whose edges are no pattern
    changed : bool (H, W), where the two differ; the noise is measured elsewhere

    Returns
    -------
    float32 (H, W), -1 to 1, NaN where the plate's pattern is fainter than the noise
    """
    weight = (~left_out).astype(np.float32)
    near = np.maximum(cv2.GaussianBlur(weight, (0, 0), PATTERN_PX), 1e-3)

    def fine(shades: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(weight * (shades - cv2.GaussianBlur(weight * shades, (0, 0), PATTERN_PX) / near))

    def around(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.blur(values, (PATTERN_WINDOW_PX, PATTERN_WINDOW_PX)))

    a, b = (fine(np.einsum("ijk->ij", image) / 3) for image in (picture, plate))
    strength, noise = around(b * b), around((a - b) ** 2)[~(changed | left_out)]
    faintest = float(np.median(noise)) if noise.size else np.inf
    alike = around(a * b) / np.sqrt(np.maximum(around(a * a) * strength, 1e-6))
    return np.where(strength > np.maximum(faintest, 1e-3), alike, np.float32(np.nan))


def hides_plate(
    picture: NDArray[np.float32],
    plate: NDArray[np.float32],
    faint: NDArray[np.bool_],
    changed: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Mark faintly different places where the plate's pattern is gone: bool (H, W), trousers of the floor's colour.

    Parameters
    ----------
    picture, plate : float32 (H, W, 3), smoothed
    faint : bool (H, W), where the colours differ more than in a shadow, if only a little
    changed : bool (H, W), where the two differ, shadows included
    """
    other = faint & (likeness(picture, plate, np.zeros_like(changed), changed) < REPLACED)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (SMALLEST_PX, SMALLEST_PX))
    return np.asarray(cv2.morphologyEx(other.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0)


def cut(
    picture: NDArray[np.uint8], seeds: NDArray[np.uint8], rounds: int, models: Models | None = None
) -> tuple[NDArray[np.bool_], Models]:
    """Cut out the foreground by GrabCut; returns it, bool (H, W), and the colours learnt.

    Parameters
    ----------
    picture : uint8 (H, W, 3)
    seeds : uint8 (H, W), OpenCV's classes GC_BGD, GC_FGD, GC_PR_BGD, GC_PR_FGD
    rounds : iterations
    models : colours to begin with, None to learn them from the seeds

    Source: Rother, Kolmogorov, Blake, "GrabCut - interactive foreground extraction using iterated graph cuts", 2004.
    """
    rows, columns = np.nonzero(seeds != cv2.GC_BGD)
    window = np.s_[
        max(rows.min() - MARGIN_PX, 0) : rows.max() + MARGIN_PX + 1,
        max(columns.min() - MARGIN_PX, 0) : columns.max() + MARGIN_PX + 1,
    ]
    labels = np.ascontiguousarray(seeds[window])
    background, foreground = (np.zeros((1, 65)), np.zeros((1, 65))) if models is None else models
    cv2.setRNGSeed(0)  # GrabCut groups colours from random starts
    mode = cv2.GC_INIT_WITH_MASK if models is None else cv2.GC_EVAL
    cv2.grabCut(
        np.ascontiguousarray(picture[window]), labels, None, background, foreground, rounds, mode
    )  # changes its arguments
    mask = np.zeros(seeds.shape, dtype=bool)
    mask[window] = (labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)
    return mask, (background, foreground)
