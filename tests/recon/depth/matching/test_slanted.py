"""Aggregation along a surface against a plain reference that holds the whole cost volume."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from recon.depth.matching import slanted
from recon.depth.matching.slanted import CENTRE, MOST_MOVED, SURFACE_STEP, aggregate_along_surface
from tests.recon.depth.reference_cost_volume import (
    HEIGHT,
    N_DISPARITIES,
    ROOM,
    WIDTH,
    aggregated,
    costs_of,
    open_gates,
    some_codes,
    some_passages,
)


def in_parts(length: int, work: Callable[[int, int], None]) -> None:
    """Three uneven parts."""
    work(0, 1)
    work(1, length // 2)
    work(length // 2, length)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_surface_is_refined_as_by_the_plain_reference(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slanted, "in_bands", in_parts)
    rng = np.random.default_rng(seed)
    codes, facing = some_codes(seed)
    passages = some_passages(seed)
    surface = rng.uniform(6, 9, (HEIGHT, WIDTH)).astype(np.float32)
    surface[:, WIDTH // 2 :] += np.float32(0.5)
    refined = aggregate_along_surface(codes, facing, ROOM, passages, surface, N_DISPARITIES)
    whole = np.floor(surface).astype(int)[..., None] + np.arange(-CENTRE, 8 - CENTRE)
    part = (surface - np.floor(surface))[..., None]
    costs = (1 - part) * costs_of(codes, facing, whole) + part * costs_of(codes, facing, whole + 1)
    across, down = (gate.copy() for gate in open_gates(passages))
    across[:, :-1][np.abs(np.diff(surface, axis=1)) > SURFACE_STEP] = 0
    down[:-1][np.abs(np.diff(surface, axis=0)) > SURFACE_STEP] = 0
    total = aggregated(costs, across, down)
    lane = CENTRE - MOST_MOVED + total[..., CENTRE - MOST_MOVED : CENTRE + MOST_MOVED + 1].argmin(axis=2)
    before, here, after = (np.take_along_axis(total, (lane + step)[..., None], 2)[..., 0] for step in (-1, 0, 1))
    bend = before - 2 * here + after
    offset = np.where(bend > 0, 0.5 * (before - after) / np.where(bend > 0, bend, 1), 0)
    expected = np.clip(surface + lane - CENTRE + np.clip(offset, -0.4999, 0.4999), 0, N_DISPARITIES - 1)
    np.testing.assert_allclose(refined, expected, atol=2e-3)
