"""The permeability filter against a plain reference that holds the whole cost volume."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.depth.permeability import (
    CLOSED,
    FRAME,
    WORST,
    Passages,
    aggregate_along_surface,
    aggregate_and_choose,
    guide_image,
    noise_level,
    permeabilities,
)

HEIGHT, WIDTH, N_DISPARITIES = 13, 21, 16


def some_passages(seed: int) -> Passages:
    guide = np.random.default_rng(seed).integers(0, 30, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    return permeabilities(guide, sigma=12.0)


def some_codes(seed: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Codes of a view, and those of the other with room around."""
    rng = np.random.default_rng(seed)
    codes = rng.integers(0, 2**24, (2, HEIGHT, WIDTH)).astype(np.uint32)
    return codes, rng.integers(0, 2**24, (2, HEIGHT, FRAME + WIDTH + N_DISPARITIES + FRAME)).astype(np.uint32)


def costs_of(codes: NDArray[np.uint32], facing: NDArray[np.uint32], index: NDArray[np.integer]) -> NDArray[np.float64]:
    """Hamming costs (H, W, K) of disparity indices (H, W, K)."""
    rows, columns = np.indices((HEIGHT, WIDTH))
    seen = facing[:, rows[..., None], FRAME + WIDTH - 1 - columns[..., None] + index]
    return np.asarray(np.bitwise_count(codes[..., None] ^ seen).sum(axis=0), np.float64)


def aggregated(
    costs: NDArray[np.float64], across: NDArray[np.floating], down: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Both recursions of the filter over the whole volume (H, W, K)."""
    rows = one_way(costs, across, axis=1) + one_way(costs[:, ::-1], across[:, -2::-1], axis=1)[:, ::-1] - costs
    return one_way(rows, down, axis=0) + one_way(rows[::-1], down[-2::-1], axis=0)[::-1] - rows


def one_way(costs: NDArray[np.float64], passage: NDArray[np.floating], axis: int) -> NDArray[np.float64]:
    flows = np.moveaxis(costs, axis, 0).copy()
    gates = np.moveaxis(passage, axis, 0)
    for place in range(1, len(flows)):
        flows[place] += gates[place - 1][:, None] * flows[place - 1]
    return np.moveaxis(flows, 0, axis)


def open_gates(passages: Passages) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    return passages.passage[passages.across], passages.passage[passages.down]


def chosen(
    codes: NDArray[np.uint32],
    facing: NDArray[np.uint32],
    passages: Passages,
    *,
    flip: int = 0,
    n_held: int = HEIGHT,
    n_disparities: int = N_DISPARITIES,
) -> NDArray[np.float32]:
    best, found = np.full((HEIGHT, WIDTH), WORST, np.int32), np.zeros((HEIGHT, WIDTH), np.float32)
    start = np.zeros((1, 1), np.int32)
    aggregate_and_choose(codes, facing, FRAME, passages, start, 30, n_disparities, flip, n_held, best, found)
    return found


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("n_disparities", [16, 9, 1])
def test_the_winner_and_its_parabola_are_those_of_the_plain_reference(seed: int, n_disparities: int) -> None:
    codes, facing = some_codes(seed)
    passages = some_passages(seed)
    every = np.broadcast_to(np.arange(N_DISPARITIES), (HEIGHT, WIDTH, N_DISPARITIES))
    total = aggregated(costs_of(codes, facing, every), *open_gates(passages))[..., :n_disparities]
    found = chosen(codes, facing, passages, n_disparities=n_disparities)
    winner = total.argmin(axis=2)
    np.testing.assert_array_equal(np.rint(found), winner)
    inner = (winner > 0) & (winner < n_disparities - 1)
    before, here, after = (
        np.take_along_axis(total, np.clip(winner + step, 0, n_disparities - 1)[..., None], 2)[..., 0]
        for step in (-1, 0, 1)
    )
    bend = np.where(inner, before - 2 * here + after, 1)
    vertex = np.where(inner, winner + 0.5 * (before - after) / bend, winner)
    np.testing.assert_allclose(found, vertex, atol=2e-3)


@pytest.mark.parametrize("n_held", [1, 4, 5, 12])
def test_rows_computed_twice_are_the_same_rows(n_held: int) -> None:
    codes, facing = some_codes(3)
    passages = some_passages(3)
    np.testing.assert_array_equal(
        chosen(codes, facing, passages, n_held=n_held), chosen(codes, facing, passages, n_held=HEIGHT)
    )


def test_a_tie_is_broken_to_the_chosen_end() -> None:
    codes = np.zeros((2, HEIGHT, WIDTH), np.uint32)
    facing = np.zeros((2, HEIGHT, FRAME + WIDTH + N_DISPARITIES + FRAME), np.uint32)
    passages = some_passages(0)
    assert (np.rint(chosen(codes, facing, passages, flip=0)) == 0).all()
    assert (np.rint(chosen(codes, facing, passages, flip=15)) == N_DISPARITIES - 1).all()


def test_windows_that_move_from_tile_to_tile_find_the_same_where_the_winner_is_inside_them() -> None:
    rng = np.random.default_rng(5)
    scene = rng.integers(0, 2**24, (2, HEIGHT, 80)).astype(np.uint32)
    facing = np.ascontiguousarray(scene)
    codes = np.ascontiguousarray(scene[:, :, FRAME + WIDTH - 1 - np.arange(WIDTH) + 20])  # disparity index 20
    passages = some_passages(5)
    best, found = np.full((HEIGHT, WIDTH), WORST, np.int32), np.zeros((HEIGHT, WIDTH), np.float32)
    start = rng.integers(7, 18, (HEIGHT // 4 + 1, WIDTH // 4 + 1)).astype(np.int32)
    aggregate_and_choose(codes, facing, FRAME, passages, start, 2, 40, 0, HEIGHT, best, found)
    np.testing.assert_array_equal(np.rint(found), 20)


def bands(length: int, work: Callable[[int, int], None]) -> None:
    """Three uneven parts."""
    work(0, 1)
    work(1, length // 2)
    work(length // 2, length)


@pytest.mark.parametrize("seed", range(3))
def test_a_surface_is_refined_as_by_the_plain_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    codes, facing = some_codes(seed)
    passages = some_passages(seed)
    surface = rng.uniform(6, 9, (HEIGHT, WIDTH)).astype(np.float32)
    surface[:, WIDTH // 2 :] += np.float32(0.5)
    refined = aggregate_along_surface(codes, facing, FRAME, passages, surface, N_DISPARITIES, bands)
    whole = np.floor(surface).astype(int)[..., None] + np.arange(-7, 9)
    part = (surface - np.floor(surface))[..., None]
    costs = (1 - part) * costs_of(codes, facing, whole) + part * costs_of(codes, facing, whole + 1)
    across, down = (gate.copy() for gate in open_gates(passages))
    across[:, :-1][np.abs(np.diff(surface, axis=1)) > 1.5] = 0
    down[:-1][np.abs(np.diff(surface, axis=0)) > 1.5] = 0
    total = aggregated(costs, across, down)
    lane = 5 + total[..., 5:10].argmin(axis=2)
    before, here, after = (np.take_along_axis(total, (lane + step)[..., None], 2)[..., 0] for step in (-1, 0, 1))
    bend = before - 2 * here + after
    offset = np.where(bend > 0, 0.5 * (before - after) / np.where(bend > 0, bend, 1), 0)
    expected = np.clip(surface + lane - 7 + np.clip(offset, -0.4999, 0.4999), 0, N_DISPARITIES - 1)
    np.testing.assert_allclose(refined, expected, atol=2e-3)


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
