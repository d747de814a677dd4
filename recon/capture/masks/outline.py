"""Masks made exact at their outline: by how steeply the evidence falls, and by GrabCut where it says nothing."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

EDGE_PX = 2  # how far a threshold's outline lies outside the object's at most
NEIGHBOURHOOD_PX = 4  # from which the object's typical evidence is taken
HALF = 0.5  # a blurred edge is where half of the object's evidence is left
REACH_PX = 16  # how far from the mask GrabCut may add, at 1000 pixels of picture height
ROUNDS = 2  # of GrabCut
RELIEF_PX = 3.0  # standard deviation; texture is what is finer
RELIEF_WINDOW_PX = 5
RELIEF_FACTOR = 7.0  # times that of an unchanged background, measured in bench/capture.py
MIN_RELIEF = 2.5  # grey levels, where there is no noise
RELIEF_HALO_PX = 4  # how far an outline's step reaches beyond it
MARGIN_PX = 20  # of background around, for GrabCut's colours
Models = tuple[NDArray[np.float64], NDArray[np.float64]]
"""GrabCut's colours of background and foreground."""


def tightened(mask: NDArray[np.bool_], evidence: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Trim from a mask the rim where less than half of the object's own evidence is left.

    Parameters
    ----------
    mask : bool (H, W)
    evidence : float32 (H, W), high where the object is; its blur has put the threshold's outline outside
    """
    inner = cv2.erode(mask.astype(np.uint8), None, iterations=EDGE_PX).astype(np.float32)
    window = (2 * NEIGHBOURHOOD_PX + 1, 2 * NEIGHBOURHOOD_PX + 1)
    weight = cv2.boxFilter(inner, -1, window)
    typical = cv2.boxFilter(inner * evidence, -1, window) / np.maximum(weight, 1e-6)
    rim = mask & (inner == 0) & (weight > 0)
    return np.asarray(mask & ~(rim & (evidence < HALF * typical)))


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


def repatterned(
    picture: NDArray[np.float32], plate: NDArray[np.float32], changed: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Keep changed pixels that do not show the plate's own pattern: a soft shadow keeps it, a dark object does not.

    Parameters
    ----------
    picture, plate : float32 (H, W, 3), smoothed
    changed : bool (H, W), where they differ
    """
    background = plate.mean(axis=2)
    ratio = picture.mean(axis=2) / np.maximum(background, 1.0)
    fine = (ratio - cv2.GaussianBlur(ratio, (0, 0), RELIEF_PX)) * background
    relief = np.sqrt(cv2.blur(fine * fine, (RELIEF_WINDOW_PX, RELIEF_WINDOW_PX)))
    quiet = relief[~changed]
    if quiet.size == 0:
        return np.zeros_like(changed)
    differs = (changed & (relief > max(MIN_RELIEF, RELIEF_FACTOR * float(np.median(quiet))))).astype(np.uint8)
    closed = cv2.morphologyEx(differs, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * RELIEF_HALO_PX + 1, 2 * RELIEF_HALO_PX + 1))
    return np.asarray(cv2.erode(closed, disc) > 0)


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
