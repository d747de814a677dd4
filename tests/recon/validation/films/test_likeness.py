"""PSNR, SSIM and MS-SSIM: against other implementations, and the laws that measures of likeness keep."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import convolve2d
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from recon.validation.films.likeness import SCALE_WEIGHTS, likenesses
from tests.recon.validation.films.clips import blurred, disc, noisy

FRAMES, MASKS = disc(1)
REFERENCE, MASK = FRAMES[0], MASKS[0]


def worse(sigma: float) -> NDArray[np.uint8]:
    return noisy(blurred(FRAMES, 1.0), sigma)[0]


def slow_multi_scale(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """MS-SSIM written from the paper: each mean by direct convolution, each scale by averages of four pixels."""
    offsets = np.arange(-5, 6)
    window = np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * 1.5**2))
    window /= window.sum()
    c1, c2 = (0.01 * 255) ** 2, (0.03 * 255) ** 2
    score = 1.0
    for scale, weight in enumerate(SCALE_WEIGHTS):

        def mean(image: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.asarray(convolve2d(image, window, mode="valid"))

        mean_a, mean_b = mean(a), mean(b)
        var_a, var_b = mean(a**2) - mean_a**2, mean(b**2) - mean_b**2
        term = (2 * (mean(a * b) - mean_a * mean_b) + c2) / (var_a + var_b + c2)
        if scale == len(SCALE_WEIGHTS) - 1:
            term = term * (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
            return float(score * term.mean() ** weight)
        score *= term.mean() ** weight
        a, b = ((i[0::2, 0::2] + i[1::2, 0::2] + i[0::2, 1::2] + i[1::2, 1::2]) / 4 for i in (a, b))
    raise AssertionError


@pytest.mark.parametrize("sigma", [2.0, 12.0])
def test_the_whole_frame_agrees_with_other_implementations(sigma: float) -> None:
    image = worse(sigma)
    (whole,) = likenesses(image, REFERENCE)
    ssim = structural_similarity(
        image, REFERENCE, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=255
    )
    assert whole.psnr_y == pytest.approx(peak_signal_noise_ratio(REFERENCE, image), rel=1e-6)
    assert whole.ssim == pytest.approx(ssim, abs=1e-5)
    assert whole.ms_ssim == pytest.approx(slow_multi_scale(image.astype(float), REFERENCE.astype(float)), abs=1e-5)


def test_a_region_is_measured_by_its_part_of_the_maps() -> None:
    image = worse(8.0)
    _, inside = likenesses(image, REFERENCE, [MASK])
    _, likeness = structural_similarity(
        image, REFERENCE, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=255, full=True
    )
    squared = np.square(image[MASK].astype(float) - REFERENCE[MASK])
    assert inside.psnr_y == pytest.approx(10 * np.log10(255**2 / squared.mean()), rel=1e-6)
    assert inside.ssim == pytest.approx(likeness[MASK].mean(), abs=1e-5)


def test_the_region_of_all_pixels_is_the_whole_frame() -> None:
    whole, region = likenesses(worse(8.0), REFERENCE, [np.ones_like(MASK)])
    assert (region.psnr_y, region.ssim, region.ms_ssim) == pytest.approx((whole.psnr_y, whole.ssim, whole.ms_ssim))


def test_a_region_does_not_see_what_is_beyond_its_windows() -> None:
    image = REFERENCE.copy()
    image[:30] = 255 - image[:30]
    whole, region = likenesses(image, REFERENCE, [MASK])
    assert (region.psnr_y, region.ssim) == (np.inf, pytest.approx(1.0, abs=1e-6))
    assert whole.psnr_y < 30


def test_equal_frames_have_the_best_values() -> None:
    for likeness in likenesses(REFERENCE, REFERENCE, [MASK]):
        assert likeness.psnr_y == np.inf
        assert (likeness.ssim, likeness.ms_ssim) == pytest.approx((1.0, 1.0), abs=1e-6)


@pytest.mark.parametrize("distorted", [noisy, blurred])
def test_every_measure_falls_as_noise_and_blur_grow(distorted: object) -> None:
    rows = []
    for sigma in (0.7, 1.5, 3.0, 6.0):
        image = distorted(FRAMES, sigma)[0]  # type: ignore[operator]  # one of two functions
        rows.append([value for like in likenesses(image, REFERENCE, [MASK]) for value in vars(like).values()])
    assert (np.diff(rows, axis=0) < 0).all()


def test_likeness_is_the_same_from_either_side() -> None:
    image = worse(8.0)
    there, back = likenesses(image, REFERENCE)[0], likenesses(REFERENCE, image)[0]
    assert tuple(vars(there).values()) == pytest.approx(tuple(vars(back).values()))


def test_small_pictures_have_no_ms_ssim() -> None:
    (small,) = likenesses(worse(8.0)[:175], REFERENCE[:175])
    assert small.ms_ssim is None
    assert small.ssim < 1
