"""What the checks need of a mask: how much of the picture it covers, and its outline. A mask is read once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import SensorStream
from recon.capture.masks.outline import edge_share

MAX_EDGE = 0.9  # of the picture's edge that masks cover; an object fills less, its background all
MOST_LISTED = 5  # frames in a sentence


@dataclass(frozen=True, eq=False)
class Silhouette:
    """A mask in short.

    Parameters
    ----------
    share : of the picture that is foreground
    edge : share of the picture's edge that is
    outline : int16 (N, 2), column and row of the foreground's outermost pixels; empty without a foreground
    size : (width, height) of the mask, pixels
    """

    share: float
    edge: float
    outline: NDArray[np.int16]
    size: tuple[int, int]


Silhouettes = Mapping[str, Mapping[int, Silhouette]]
"""By the pattern of a camera's masks and the frame; those that cannot be read are left out."""


def silhouette_of(mask: NDArray[np.bool_]) -> Silhouette:
    """Describe a mask, bool (H, W)."""
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    pixels = np.concatenate(outlines)[:, 0] if outlines else np.zeros((0, 2))
    return Silhouette(float(mask.mean()), edge_share(mask), pixels.astype(np.int16), (mask.shape[1], mask.shape[0]))


def check_masks(
    stream: SensorStream, silhouettes: Silhouettes
) -> tuple[tuple[float, ...] | None, list[str], list[str]]:
    """Return the mean share of foreground in each camera's masks, None without masks; problems and warnings."""
    cameras = [silhouettes.get(pattern, {}) for pattern in stream.mask or ()]
    frames = sorted(set.intersection(*map(set, cameras))) if cameras else []
    if not frames:
        return None, [], []
    coverage = tuple(float(np.mean([camera[frame].share for frame in frames])) for camera in cameras)
    if min(coverage) == 0:
        return coverage, [f"sensor {stream.id}: the masks of a camera are empty in all frames"], []
    warnings = []
    if empty := [frame for frame in frames if min(camera[frame].share for camera in cameras) == 0]:
        warnings.append(f"sensor {stream.id}: a mask is empty in {listed(empty)}; the sensor sees nothing there")
    edge = max(float(np.mean([camera[frame].edge for frame in frames])) for camera in cameras)
    if edge > MAX_EDGE:
        warnings.append(
            f"sensor {stream.id}: the masks of a camera cover {edge:.0%} of the pictures' edges; white is the object, "
            "black the background: are they the other way round?"
        )
    return coverage, [], warnings


def listed(frames: Sequence[int]) -> str:
    """Name frames in a sentence."""
    more = f" and {len(frames) - MOST_LISTED} more" if len(frames) > MOST_LISTED else ""
    return f"frame{'s' * (len(frames) > 1)} {', '.join(map(str, frames[:MOST_LISTED]))}{more}"
