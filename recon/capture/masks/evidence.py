"""Evidence of foreground at each pixel, against a clean plate or before a dark background."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from recon.capture.format import Capture, CaptureError, SensorStream, read_frame
from recon.capture.noise import largest_channel
from recon.capture.recording import evenly_chosen

SMOOTHING_PX = 1.0  # standard deviation: takes the noise of single pixels away, keeps edges within a pixel
NOISE_FACTOR = 6.0  # standard deviations of the smoothed background's difference that its noise does not reach
QUIET_SHARE = 0.25  # of the pixels show background in every picture
QUIET_DEVIATIONS = 0.9  # that quantile of the largest of three normal deviations
MIN_DIFFERENCE = 5.0  # grey levels: compression and flicker stay below
SHADE = (0.66, 1.05)  # of the plate's brightness: soft shadows and light thrown back by the actors
HISTOGRAM_SMOOTHING = 3.0  # grey levels
VALLEY_EDGE = 1.25  # the valley begins where the histogram has come down to this multiple of its lowest point
SAMPLED_FRAMES = 3  # first, middle, last: from which a threshold is found


def evidence_of(picture: NDArray[np.float32], plate: NDArray[np.float32] | None) -> NDArray[np.float32]:
    """Measure how much each pixel looks like foreground: float32 (H, W), grey levels.

    Without a plate: the brightest channel, because a saturated colour is bright, too. By plate: the largest difference
    of any channel from the plate in that shade of it which fits best, because a shadow keeps the plate's colour.

    Parameters
    ----------
    picture, plate : float32 (H, W, 3), smoothed; None for a dark background

    Source of the shade: Horprasert, Harwood, Davis, "A statistical approach for real-time robust background
    subtraction and shadow detection", 1999, brightness and chromaticity distortion.
    """
    return largest_channel(picture) if plate is None else _difference(picture, plate)


def _difference(image: NDArray[np.float32], plate: NDArray[np.float32]) -> NDArray[np.float32]:
    alike, brightness = (np.einsum("ijk,ijk->ij", other, plate) for other in (image, plate))
    shade = alike / np.maximum(brightness, 1.0)
    return largest_channel(np.abs(image - shade.clip(*SHADE)[..., None] * plate))


def found_threshold(capture: Capture, stream: SensorStream, plates: Sequence[NDArray[np.float32] | None]) -> float:
    """Choose the evidence, grey levels, above which a pixel is foreground from some frames of a sensor.

    Parameters
    ----------
    capture : the capture
    stream : a sensor of it
    plates : float32 (H, W, 3) of each side, smoothed; None for a dark background
    """
    evidence = np.concatenate(
        [
            evidence_of(smoothed(picture), plate).ravel()
            for frame in evenly_chosen(capture.n_frames, SAMPLED_FRAMES)
            for picture, plate in zip(read_frame(capture, stream.id, frame), plates, strict=True)
        ]
    )
    if plates[0] is None:
        try:
            return dark_background_threshold(np.bincount(evidence.astype(np.uint8), minlength=256))
        except CaptureError as error:
            raise CaptureError(f"sensor {stream.id}: {error}") from error
    noise = float(np.quantile(evidence, QUIET_SHARE)) / QUIET_DEVIATIONS
    return max(MIN_DIFFERENCE, NOISE_FACTOR * noise)


def smoothed(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Remove the noise of single pixels from a picture, uint8 (H, W, 3): float32 (H, W, 3)."""
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTHING_PX))


def dark_background_threshold(histogram: NDArray[np.integer]) -> float:
    """Choose the brightness above which a picture with a dark background shows the object.

    It is the near edge of the valley between background and object in the histogram (256,) of brightness: further
    up, the object's own shadows would be lost.

    A CaptureError says that all pixels are equally bright.

    Source of the two classes: Otsu, "A threshold selection method from grey-level histograms", 1979, on the square root
    of brightness, in which shot noise is equally strong everywhere; the valley is ours.
    """
    counts = np.asarray(histogram, dtype=np.float64)
    level = np.sqrt(np.arange(256))
    split = _otsu(counts, level) + 1
    dark = round(float(np.average(level[:split], weights=counts[:split])) ** 2)
    bright = round(float(np.average(level[split:], weights=counts[split:])) ** 2)
    smooth = gaussian_filter1d(counts, HISTOGRAM_SMOOTHING)
    return dark + float(np.argmax(smooth[dark:] <= VALLEY_EDGE * smooth[dark : bright + 1].min()))


def _otsu(counts: NDArray[np.float64], level: NDArray[np.float64]) -> int:
    """Return the last bin of the lower class."""
    below = np.cumsum(counts)[:-1]
    above, moment = counts.sum() - below, np.cumsum(counts * level)
    both = (below > 0) & (above > 0)
    if not both.any():
        raise CaptureError("all pixels are equally bright: there is nothing to tell the object by")
    means_apart = moment[:-1][both] / below[both] - (moment[-1] - moment[:-1][both]) / above[both]
    return int(np.flatnonzero(both)[np.argmax(below[both] * above[both] * means_apart**2)])
