"""The picture by which a person checks the exclusion rule: the cells of a cap with their errors."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import error_colours
from recon.validation.pictures import BACKGROUND, CIRCLE, ORANGE, with_colour_scale
from recon.validation.sampling import subsample
from recon.validation.sphere.cells import N_RINGS, N_SECTORS, cap_of
from recon.validation.sphere.exclusion import COHERENT_CELLS
from recon.validation.sphere.fit.model import SphereFit

SIDE_PX, BLOCK_PX = 540, 5  # of the picture, and of the map
REACH = 1.04  # of the radius: half the picture
TEXT_SIZE = 0.45


def cell_picture(points: NDArray[np.float32], fit: SphereFit, limit: float) -> NDArray[np.uint8]:
    """Draw a ball's mean errors as colours, uint8 (H, W, 3) RGB, with each cell's median in mm, and the scale below.

    The cells whose medians are largest, a sixth of all, are outlined: their smallest is the rule's coherent error.

    Parameters
    ----------
    points : float32 (N, 3), mm
    fit : their sphere
    limit : mm, at which the colours end
    """
    cap = cap_of(subsample(points, 1), fit)
    picture = _map(cap.places, cap.errors, limit)
    medians = cap.medians()
    largest = np.argsort(np.where(np.isfinite(medians), -np.abs(medians), np.inf))[:COHERENT_CELLS]
    rim = float(np.quantile(np.hypot(cap.places[:, 0], cap.places[:, 1]), 0.995))
    ends = np.array([rim, *np.sqrt(1 - np.clip(cap.ring_ends, -1, 1) ** 2), 0.0])  # of the rings, from the rim inwards
    for cell in [*(cell for cell in range(len(medians)) if cell not in largest), *largest]:
        sector, ring = divmod(int(cell), N_RINGS)
        turns = -np.pi + 2 * np.pi / N_SECTORS * (sector + np.linspace(0, 1, 24))
        arcs = [ends[ring] * _unit(turns), ends[ring + 1] * _unit(turns[::-1])]
        is_largest = cell in largest
        cv2.polylines(
            picture, [_pixels(np.concatenate(arcs))], True, ORANGE if is_largest else CIRCLE, 2 if is_largest else 1,
            cv2.LINE_AA,
        )  # fmt: skip
        if np.isfinite(medians[cell]):
            middle = (0.62 * ends[ring] + 0.38 * ends[ring + 1]) * _unit(turns[12:13])
            _write(picture, f"{medians[cell]:+.1f}", _pixels(middle)[0])
    return with_colour_scale(picture, limit)


def _map(places: NDArray[np.float64], errors: NDArray[np.float32], limit: float) -> NDArray[np.uint8]:
    """Draw the mean error, cut at twice the limit, of each block of pixels."""
    n = SIDE_PX // BLOCK_PX
    block = np.clip(((np.array([1, -1]) * places[:, :2] / REACH + 1) / 2 * n).astype(int), 0, n - 1)
    keys = block[:, 1] * n + block[:, 0]
    counts = np.bincount(keys, minlength=n * n)
    sums = np.bincount(keys, np.clip(errors, -2 * limit, 2 * limit), n * n)
    means = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    colours = error_colours(means, limit).reshape(n, n, 3)
    colours[(counts == 0).reshape(n, n)] = BACKGROUND
    return np.ascontiguousarray(np.repeat(np.repeat(colours, BLOCK_PX, axis=0), BLOCK_PX, axis=1))


def _unit(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.cos(turns), np.sin(turns)], axis=1)


def _pixels(places: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return columns and rows (N, 2) of places right and up, of the radius."""
    half = (SIDE_PX - 1) / 2
    return np.rint(half + half / REACH * places * (1, -1)).astype(np.int32)


def _write(picture: NDArray[np.uint8], text: str, at: NDArray[np.int32]) -> None:
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, TEXT_SIZE, 1)
    left, base = int(at[0]) - width // 2, int(at[1]) + height // 2
    cv2.rectangle(picture, (left - 3, base + 4), (left + width + 3, base - height - 4), (255, 255, 255), cv2.FILLED)
    cv2.putText(picture, text, (left, base), cv2.FONT_HERSHEY_SIMPLEX, TEXT_SIZE, CIRCLE, 1, cv2.LINE_AA)
