"""Pictures between two frames, moved along the optical flow from either side."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

FLOW = cv2.DISOPTICAL_FLOW_PRESET_MEDIUM
HALF_BRIGHT = 127.5


@dataclass(frozen=True, eq=False)
class Way:
    """Where what a picture shows at an instant between two frames lies in each of them.

    Parameters
    ----------
    share : of the time from the first frame to the second, 0 to 1
    to_first, to_second : float32 (H, W, 2), pixels to go from the picture between, column and row
    """

    share: float
    to_first: NDArray[np.float32]
    to_second: NDArray[np.float32]

    def picture(self, first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the picture between two of a camera, uint8 (H, W, 3) or (H, W)."""
        return np.asarray(np.rint(self._blended(first, second)), np.uint8)

    def mask(self, first: NDArray[np.bool_], second: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the mask between two of a camera, bool (H, W)."""
        blended = self._blended(*(np.where(mask, np.uint8(255), np.uint8(0)) for mask in (first, second)))
        return np.asarray(blended > HALF_BRIGHT)

    def _blended(self, first: NDArray[np.uint8], second: NDArray[np.uint8]) -> NDArray[np.float32]:
        parts = [_moved(image, flow) for image, flow in ((first, self.to_first), (second, self.to_second))]
        return (1 - np.float32(self.share)) * parts[0] + np.float32(self.share) * parts[1]


def way_between(first: NDArray[np.uint8], second: NDArray[np.uint8], share: float) -> Way:
    """Find how what two pictures of a camera show moved from one to the other.

    The flow between is composed of that from either side, as if everything moved evenly.

    Source: Jiang, Sun, Jampani, Yang, Learned-Miller, Kautz, "Super SloMo", CVPR 2018, equation 4; the flows: Kroeger,
    Timofte, Dai, Van Gool, "Fast optical flow using dense inverse search", ECCV 2016.

    Parameters
    ----------
    first, second : uint8 (H, W, 3)
    share : of the time from the first to the second, 0 to 1
    """
    before, after = (np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)) for picture in (first, second))
    flow = cv2.DISOpticalFlow.create(FLOW)
    onwards, back = (np.asarray(flow.calc(*pair, None)) for pair in ((before, after), (after, before)))
    t = np.float32(share)
    to_first = -(1 - t) * t * onwards + t * t * back
    to_second = (1 - t) * (1 - t) * onwards - t * (1 - t) * back
    return Way(share, np.asarray(to_first), np.asarray(to_second))


def _moved(image: NDArray[np.uint8], flow: NDArray[np.float32]) -> NDArray[np.float32]:
    height, width = flow.shape[:2]
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    places = columns + flow[..., 0], rows + flow[..., 1]
    moved = cv2.remap(image, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.float32)
