"""The guide: its noise is measured and taken out, and what passes between its pixels."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from recon.depth.matching.guide import CLOSED, guide_image, noise_level, permeabilities
from tests.recon.depth.reference_cost_volume import open_gates


def test_passages_are_those_of_the_channel_that_changes_most_and_end_with_the_image() -> None:
    guide = np.random.default_rng(0).integers(0, 256, (5, 6, 3)).astype(np.uint8)
    passages = permeabilities(guide, sigma=12.0)
    across, down = open_gates(passages)
    wide = guide.astype(float)
    np.testing.assert_allclose(across[:, :-1], np.exp(-np.abs(np.diff(wide, axis=1)).max(axis=2) / 12), rtol=1e-5)
    np.testing.assert_allclose(down[:-1], np.exp(-np.abs(np.diff(wide, axis=0)).max(axis=2) / 12), rtol=1e-5)
    assert not across[:, -1].any()
    assert not down[-1].any()


def test_nothing_passes_the_border_of_a_mask() -> None:
    mask = np.zeros((6, 7), np.bool_)
    mask[2:4, 3:5] = True
    passages = permeabilities(np.zeros((6, 7), np.uint8), sigma=12.0, mask=mask)
    assert (passages.across[2:4, [2, 4]] == CLOSED).all()
    assert (passages.down[[1, 3], 3:5] == CLOSED).all()
    assert passages.across[2, 3] == 0
    assert passages.down[2, 4] == 0


@pytest.mark.parametrize("sigma", [1.0, 4.0, 8.0])
def test_noise_is_measured_within_a_fifth(sigma: float) -> None:
    rng = np.random.default_rng(0)
    ramp = np.add.outer(np.linspace(60, 120, 200), np.linspace(0, 60, 220))
    noisy = np.clip(ramp + rng.normal(0, sigma, ramp.shape), 0, 255).round().astype(np.uint8)
    assert noise_level(noisy) == pytest.approx(sigma, rel=0.2)


def test_the_guide_loses_noise_and_keeps_an_edge() -> None:
    rng = np.random.default_rng(0)
    step = np.repeat([[60.0] * 20 + [160.0] * 20], 40, axis=0)
    noisy = np.clip(step + rng.normal(0, 4, step.shape), 0, 255).astype(np.uint8)
    guide = guide_image(noisy, 4.0).astype(float)
    assert guide[:, 5:15].std() < 1.5
    assert np.abs(np.diff(guide, axis=1))[:, 19].min() > 60
    assert cv2.absdiff(guide, step).max() < 40
