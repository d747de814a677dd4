"""Temporal filtering: still scenes calm down, moving ones leave no ghost."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.depth import StereoPair, match_id, match_sequence
from recon.depth.temporal import Frame, Memory, TemporalParameters, filtered, remembered, temporal_permeability

SHAPE = (6, 7)
STILL = Frame(np.full((*SHAPE, 3), 90, np.uint8), 1.0, None)


def plain_pixel(old: float, strength: float, new: float, passage: float, p: TemporalParameters) -> tuple[float, float]:
    weight = passage * strength
    if weight > 0 and abs(new - old) <= 2 * p.sigma_disparity:
        weight *= np.exp(-abs(new - old) / p.sigma_disparity)
        return (new + weight * old) / (1 + weight), min(1 + weight, p.memory)
    if weight > 1 and passage > 0.75:
        return old, weight - 1
    return (np.nan, 0.0) if np.isnan(new) else (new, 1.0)


@pytest.mark.parametrize("seed", range(5))
def test_the_memory_is_that_of_the_plain_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    guides = rng.integers(80, 100, (2, *SHAPE, 3)).astype(np.uint8)
    old, new = rng.uniform(5, 9, (2, *SHAPE)).astype(np.float32)
    old[rng.random(SHAPE) < 0.2] = np.nan
    new[rng.random(SHAPE) < 0.2] = np.nan
    strength = np.where(np.isfinite(old), rng.uniform(0, 8, SHAPE), 0).astype(np.float32)
    before, frame = Frame(guides[0], 1.0, None), Frame(guides[1], 1.0, None)
    parameters = TemporalParameters()
    after = remembered(Memory(before, old, strength), frame, new, parameters)
    passage = temporal_permeability(before, frame, parameters.sigma)
    expected = np.array(
        [
            plain_pixel(float(old[place]), float(strength[place]), float(new[place]), float(passage[place]), parameters)
            for place in np.ndindex(SHAPE)
        ]
    ).reshape(*SHAPE, 2)
    np.testing.assert_allclose(after.disparity, expected[..., 0], rtol=1e-5)
    np.testing.assert_allclose(after.strength, expected[..., 1], rtol=1e-4, atol=1e-5)


def after_frames(disparities: list[float], frames: list[Frame]) -> list[float]:
    """The remembered disparity of the middle pixel after each frame."""
    memory, values = None, []
    for disparity, frame in zip(disparities, frames, strict=True):
        memory = remembered(memory, frame, np.full(SHAPE, disparity, np.float32), TemporalParameters())
        values.append(float(memory.disparity[3, 3]))
    return values


def test_a_hole_and_an_outlier_are_bridged_while_the_picture_is_still() -> None:
    values = after_frames([8, 8, 8, 8, np.nan, 8, 40, 8], [STILL] * 8)
    assert values == pytest.approx([8.0] * 8)


def test_a_lasting_change_takes_over_within_as_many_frames_as_spoke_for_the_old() -> None:
    values = after_frames([8, 8, 8, 20, 20, 20, 20], [STILL] * 7)
    assert values[2] == pytest.approx(8)
    assert values[-1] == pytest.approx(20)


def test_a_changed_picture_forgets_at_once() -> None:
    changed = Frame(np.full((*SHAPE, 3), 200, np.uint8), 1.0, None)
    assert after_frames([8, 8, 8, 20], [STILL, STILL, STILL, changed])[-1] == 20
    assert np.isnan(after_frames([8, 8, 8, np.nan], [STILL, STILL, STILL, changed])[-1])


def test_nothing_is_remembered_outside_the_mask() -> None:
    outside = Frame(STILL.guide, 1.0, np.zeros(SHAPE, np.bool_))
    assert np.isnan(after_frames([8, 8, np.nan], [STILL, STILL, outside])[-1])


def test_a_frame_without_a_match_keeps_fractions_of_a_pixel() -> None:
    pair = StereoPair(*np.random.default_rng(0).integers(0, 256, (2, 20, 24, 3)).astype(np.uint8), 8)
    matched = [np.full((20, 24), 5.25, np.float32)] * 3 + [np.full((20, 24), np.nan, np.float32)]
    *_, last = filtered([pair] * 4, matched)
    assert (last == 5.25).all()


def test_a_frame_of_another_size_is_refused() -> None:
    memory = remembered(None, STILL, np.zeros(SHAPE, np.float32), TemporalParameters())
    other = Frame(np.zeros((5, 7, 3), np.uint8), 1.0, None)
    with pytest.raises(ValueError, match=r"\(5, 7, 3\), the one before \(6, 7, 3\)"):
        remembered(memory, other, np.zeros((5, 7), np.float32), TemporalParameters())


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [({"sigma": 0.0}, "sigma is 0"), ({"sigma_disparity": -1.0}, "sigma_disparity is -1"), ({"memory": 0.5}, "memory")],
)
def test_impossible_parameters_are_refused(changes: dict[str, float], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        TemporalParameters(**changes)


def weak_scene(width: int = 160, height: int = 60) -> NDArray[np.float32]:
    noise = np.random.default_rng(0).normal(size=(height // 3, width // 3)).astype(np.float32)
    return np.asarray(90 + 12 * cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)


def noisy_pairs(n_frames: int, shift: int) -> list[StereoPair]:
    rng, scene = np.random.default_rng(1), weak_scene()
    clean = scene[:, 20:140], scene[:, 20 + shift : 140 + shift]
    pairs = []
    for _ in range(n_frames):
        images = [np.clip(view + rng.normal(0, 4, view.shape), 0, 255).round().astype(np.uint8) for view in clean]
        pairs.append(StereoPair(images[0], images[1], 12))
    return pairs


def test_a_still_noisy_sequence_flickers_less_and_is_no_worse() -> None:
    pairs = noisy_pairs(8, shift=5)
    alone = np.nan_to_num(np.array([match_id(pair) for pair in pairs]))[:, :, 12:]
    together = np.nan_to_num(np.array(list(match_sequence(pairs, match_id))))[:, :, 12:]
    assert (together == np.rint(together)).all()
    assert np.abs(np.diff(together[2:], axis=0)).mean() <= 0.8 * np.abs(np.diff(alone[2:], axis=0)).mean()
    assert (np.abs(together[2:] - 5) > 1).mean() <= (np.abs(alone[2:] - 5) > 1).mean()


def test_a_moving_square_leaves_no_ghost() -> None:
    rng = np.random.default_rng(2)
    behind = rng.integers(0, 256, (60, 160)).astype(np.uint8)
    square = rng.integers(0, 256, (24, 24)).astype(np.uint8)
    pairs = []
    for frame in range(6):
        left, right = behind[:, 20:140].copy(), behind[:, 22:142].copy()
        column = 30 + 8 * frame
        left[18:42, column : column + 24] = square
        right[18:42, column - 9 : column + 15] = square
        pairs.append(StereoPair(left, right, 12))
    alone, together = match_id(pairs[-1]), list(match_sequence(pairs, match_id))[-1]
    left_behind = together[18:42, 46:66]  # where the square was two frames before
    assert np.nanmax(left_behind) == np.nanmax(alone[18:42, 46:66]) == 2
