"""Quality of encoded video frames: PSNR and SSIM against the pictures that they were made from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import fmean

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

# What a delivered video must keep of its frames, in luma: below, encoding could be taken for a fault of the model.
MEAN_PSNR_DB, FRAME_PSNR_DB, MEAN_SSIM = 48.0, 44.0, 0.99
LOSSLESS_DB = 100.0

WINDOW_PX, SIGMA_PX = 11, 1.5  # of SSIM: Wang et al. (2004), section III-C
MARGIN = WINDOW_PX // 2  # pixels whose window reaches over the picture's edge
C1, C2, TWO = np.float32((0.01 * 255) ** 2), np.float32((0.03 * 255) ** 2), np.float32(2)


@dataclass(frozen=True)
class VideoCheck:
    """Quality of each frame of a video against the frame that it was made from, in luma.

    Parameters
    ----------
    psnr_db, ssim : of each frame
    crc32 : of each frame's luma as it is stored, by which the frame is recognised
    """

    psnr_db: tuple[float, ...]
    ssim: tuple[float, ...]
    crc32: tuple[int, ...] = ()

    @property
    def faults(self) -> tuple[str, ...]:
        """Sentences on what is below the bar for a delivered video; empty for a good video."""
        worst = min(range(len(self.psnr_db)), key=self.psnr_db.__getitem__)
        mean, ssim = fmean(self.psnr_db), fmean(self.ssim)
        faults = []
        if mean < MEAN_PSNR_DB:
            faults.append(f"mean PSNR-Y is {mean:.2f} dB, expected {MEAN_PSNR_DB:g}")
        if self.psnr_db[worst] < FRAME_PSNR_DB:
            faults.append(f"PSNR-Y of frame {worst} is {self.psnr_db[worst]:.2f} dB, expected {FRAME_PSNR_DB:g}")
        if ssim < MEAN_SSIM:
            faults.append(f"mean SSIM-Y is {ssim:.4f}, expected {MEAN_SSIM:g}")
        return tuple(faults)


def luma_of(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Convert an RGB frame (H, W, 3) to BT.709 luma, uint8 (H, W), 16 to 235."""
    weights = np.array([[0.2126, 0.7152, 0.0722]], dtype=np.float32) * np.float32(219 / 255)
    return np.asarray(np.rint(cv2.transform(frame.astype(np.float32), weights) + 16), np.uint8)


def psnr_db(mean_squared: float, peak_squared: float = 255.0**2) -> float:
    """Convert a mean squared error to the peak signal-to-noise ratio, dB; infinite where there is no error."""
    return 10 * math.log10(peak_squared / mean_squared) if mean_squared > 0 else math.inf


def psnr_of(image: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Compute the peak signal-to-noise ratio of two images (H, W), dB, at most `LOSSLESS_DB`."""
    squared = float(np.square(np.subtract(image, other, dtype=np.float32)).mean(dtype=np.float64))
    return min(LOSSLESS_DB, psnr_db(squared))


def ssim_of(image: NDArray[np.uint8], other: NDArray[np.uint8]) -> float:
    """Compute the mean structural similarity of two images (H, W), without their margin."""
    _, similarity = ssim_maps(image.astype(np.float32), other.astype(np.float32))
    return float(without_margin(similarity).mean(dtype=np.float64))


def ssim_maps(a: NDArray[np.float32], b: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Compute contrast times structure, and SSIM, at each pixel of two images (H, W), 0 to 255: float32 (H, W) each.

    In the margin, windows see the image mirrored at its edge.

    Source
    ------
    Wang, Bovik, Sheikh, Simoncelli, "Image quality assessment: from error visibility to structural similarity"
    (2004), equation 13.
    """
    structure, similarity = _similarity(*map(ssim_window, (a, b, a * b, a * a + b * b)))
    return structure, similarity


def without_margin(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Cut off the pixels whose window reaches over the edge: (H, W) to (H - 10, W - 10)."""
    return np.ascontiguousarray(image[MARGIN:-MARGIN, MARGIN:-MARGIN])


def ssim_window(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Average an image (H, W) over the Gaussian window of SSIM."""
    return np.asarray(cv2.GaussianBlur(image, (WINDOW_PX, WINDOW_PX), SIGMA_PX), np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def _similarity(mean_a, mean_b, product, square):  # type: ignore[no-untyped-def]  # numba
    """Compute contrast times structure, and SSIM, from the windows' means of a, b, a b and a^2 + b^2."""
    structure, similarity = np.empty_like(product), np.empty_like(product)
    for row in range(product.shape[0]):
        for column in range(product.shape[1]):
            both = mean_a[row, column] * mean_b[row, column]
            squares = mean_a[row, column] * mean_a[row, column] + mean_b[row, column] * mean_b[row, column]
            alike = (TWO * (product[row, column] - both) + C2) / (square[row, column] - squares + C2)
            structure[row, column] = alike
            similarity[row, column] = alike * (TWO * both + C1) / (squares + C1)
    return structure, similarity
