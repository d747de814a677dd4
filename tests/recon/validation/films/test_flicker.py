"""Flicker: what it counts, and what it is blind to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.validation.films.flicker import excess_change
from tests.recon.validation.films.clips import blurred, disc, noisy

FRAMES, MASKS = disc()


def flicker(frames: Sequence[NDArray[np.uint8]], reference: Sequence[NDArray[np.uint8]] = FRAMES) -> float:
    """Mean over the frames, inside the disc."""
    maps = [
        excess_change((frames[t - 1], reference[t - 1]), (frames[t], reference[t]))[MASKS[t]].mean()
        for t in range(1, len(frames))
    ]
    return float(np.mean(maps))


def plain_residual(frames: Sequence[NDArray[np.uint8]], reference: Sequence[NDArray[np.uint8]]) -> float:
    """Mean difference of the changes themselves."""
    changes, expected = np.diff(np.array(frames, float), axis=0), np.diff(np.array(reference, float), axis=0)
    return float(np.abs(changes - expected)[np.array(MASKS[1:])].mean())


def test_equal_films_do_not_flicker() -> None:
    assert flicker(FRAMES) == 0


@pytest.mark.parametrize("offset", [-20, 7, 35])
def test_a_constant_offset_is_no_flicker(offset: int) -> None:
    assert flicker([(frame.astype(int) + offset).astype(np.uint8) for frame in FRAMES]) == 0


def test_change_that_both_films_have_is_no_flicker() -> None:
    flashing = [(frame.astype(int) + 9 * (t % 2)).astype(np.uint8) for t, frame in enumerate(FRAMES)]
    assert excess_change((flashing[0], flashing[0]), (flashing[1], flashing[1])).max() == 0


def test_a_frozen_film_does_not_flicker() -> None:
    assert flicker([FRAMES[0]] * len(FRAMES)) == pytest.approx(0, abs=1e-6)


def test_flicker_grows_with_noise_in_time() -> None:
    values = [flicker(noisy(FRAMES, sigma)) for sigma in (0.5, 1, 2, 4, 8)]
    assert (np.diff([0, *values]) > 0).all()


def test_flicker_grows_with_the_amplitude_of_flashes() -> None:
    values = [flicker([(f.astype(int) + a * (t % 2)).astype(np.uint8) for t, f in enumerate(FRAMES)]) for a in (2, 5)]
    assert 0 < values[0] < values[1]


def test_a_texture_beside_its_place_flickers_less_than_noise_that_the_plain_residual_takes_for_less() -> None:
    slow, _ = disc(step_px=0.5)
    displaced, noise = [np.roll(frame, 1, axis=1) for frame in slow], noisy(slow, 1.5)
    assert flicker(displaced, slow) < 0.7 * flicker(noise, slow)
    assert plain_residual(displaced, slow) > plain_residual(noise, slow)


def test_blur_is_no_flicker() -> None:
    soft = blurred(FRAMES, 2)
    assert flicker(soft) < plain_residual(soft, FRAMES) / 100
