"""The permeability filter against a plain reference that holds the whole cost volume."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.depth.matching.guide import Passages
from recon.depth.matching.permeability import WORST, Searched, Winners, aggregate_and_choose
from tests.recon.depth.reference_cost_volume import (
    HEIGHT,
    LEVEL,
    N_DISPARITIES,
    ROOM,
    WIDTH,
    aggregated,
    costs_of,
    open_gates,
    some_codes,
    some_passages,
)


def chosen(
    codes: NDArray[np.uint32],
    facing: NDArray[np.uint32],
    passages: Passages,
    *,
    flip: int = 0,
    n_held: int = HEIGHT,
    n_disparities: int = N_DISPARITIES,
    slopes: tuple[NDArray[np.float32], NDArray[np.float32]] = (LEVEL, LEVEL),
) -> NDArray[np.float32]:
    best, found = np.full((HEIGHT, WIDTH), WORST, np.int32), np.zeros((HEIGHT, WIDTH), np.float32)
    start = np.zeros(slopes[0].shape, np.int32)
    searched = Searched(codes, facing, ROOM, passages, start, slopes, 0)
    aggregate_and_choose(searched, Winners(best, found, n_disparities, flip), n_held)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("n_disparities", "steepest"), [(16, 0.0), (9, 0.0), (1, 0.0), (16, 0.9)])
def test_the_winner_and_its_parabola_are_those_of_the_plain_reference(
    seed: int, n_disparities: int, steepest: float
) -> None:
    slopes = np.random.default_rng(seed).uniform(-steepest, steepest, (2, HEIGHT, WIDTH)).astype(np.float32)
    codes, facing = some_codes(seed)
    passages = some_passages(seed)
    every = np.broadcast_to(np.arange(N_DISPARITIES), (HEIGHT, WIDTH, N_DISPARITIES))
    total = aggregated(costs_of(codes, facing, every), *open_gates(passages), (slopes[0], slopes[1]))[
        ..., :n_disparities
    ]
    found = chosen(codes, facing, passages, n_disparities=n_disparities, slopes=(slopes[0], slopes[1]))
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


@pytest.mark.slow
@pytest.mark.parametrize("n_held", [1, 4, 5, 12])
def test_rows_computed_twice_are_the_same_rows(n_held: int) -> None:
    codes, facing = some_codes(3)
    passages = some_passages(3)
    np.testing.assert_array_equal(
        chosen(codes, facing, passages, n_held=n_held), chosen(codes, facing, passages, n_held=HEIGHT)
    )


def test_a_tie_is_broken_to_the_chosen_end() -> None:
    codes = np.zeros((2, HEIGHT, WIDTH), np.uint32)
    facing = np.zeros((2, HEIGHT, ROOM + WIDTH + N_DISPARITIES + ROOM), np.uint32)
    passages = some_passages(0)
    assert (np.rint(chosen(codes, facing, passages, flip=0)) == 0).all()
    assert (np.rint(chosen(codes, facing, passages, flip=15)) == N_DISPARITIES - 1).all()


def test_windows_that_move_from_tile_to_tile_find_the_same_where_the_winner_is_inside_them() -> None:
    rng = np.random.default_rng(5)
    scene = rng.integers(0, 2**24, (2, HEIGHT, 80)).astype(np.uint32)
    facing = np.ascontiguousarray(scene)
    codes = np.ascontiguousarray(scene[:, :, ROOM + WIDTH - 1 - np.arange(WIDTH) + 20])  # disparity index 20
    passages = some_passages(5)
    best, found = np.full((HEIGHT, WIDTH), WORST, np.int32), np.zeros((HEIGHT, WIDTH), np.float32)
    start = rng.integers(7, 18, (HEIGHT // 4 + 1, WIDTH // 4 + 1)).astype(np.int32)
    level = np.zeros(start.shape, np.float32)
    searched = Searched(codes, facing, ROOM, passages, start, (level, level), 2)
    aggregate_and_choose(searched, Winners(best, found, 40, 0), HEIGHT)
    np.testing.assert_array_equal(np.rint(found), 20)
