"""Flicker: change from frame to frame that the reference's film does not have.

The measure compares how much luma changes around each pixel, not the two changes themselves, so that a texture which
lies a pixel beside its place and moves with the camera is no flicker. It follows the temporal differences of
`tLP` (Chu et al. 2020), which compares the change between frames of a film with that of the reference, and takes the
luma difference of successive frames as ITU-T P.910 does for temporal information.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.render.encoding.quality import ssim_window


def excess_change(
    before: tuple[NDArray[np.uint8], NDArray[np.uint8]], now: tuple[NDArray[np.uint8], NDArray[np.uint8]]
) -> NDArray[np.float32]:
    """Compute how much more a film changes between two frames than its reference, at each pixel, grey levels of luma.

    With the film's frames F and the reference's R, the map is max(0, G * (|F(t) - F(t-1)| - |R(t) - R(t-1)|)), where
    G * is the mean in a Gaussian window of 11 pixels and standard deviation 1.5. Its mean over the silhouette is the
    flicker of frame t: 0 for equal films and for films that differ by an offset, and growing with noise in time.
    Change that the film lacks, as by blur, does not count.

    Parameters
    ----------
    before, now : the film's and the reference's frame, uint8 (H, W), luma as stored

    Returns
    -------
    float32 (H, W), grey levels, at least 0

    Source
    ------
    Ours. Related: Chu, Xie, Mayer, Leal-Taixe, Thuerey, "Learning temporal coherence via self-supervision for GAN-based
    video generation" (2020), section 5; ITU-T P.910 (2008), section 5.3.2, temporal information
    (clause 7.8.3 of the edition of 10/2023).
    """
    changes = [cv2.absdiff(later, earlier).astype(np.float32) for later, earlier in zip(now, before, strict=True)]
    return np.asarray(np.maximum(ssim_window(changes[0] - changes[1]), 0), np.float32)
