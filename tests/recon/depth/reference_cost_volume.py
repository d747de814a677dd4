"""A small cost volume, held whole: the plain reference of the kernels that never hold one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recon.depth.matching.guide import Passages, permeabilities
from recon.depth.matching.slanted import SPARE

HEIGHT, WIDTH, N_DISPARITIES = 13, 21, 16
LEVEL = np.zeros((HEIGHT, WIDTH), np.float32)
ROOM = SPARE  # places of the other view before the first disparity and after the last


def some_passages(seed: int) -> Passages:
    guide = np.random.default_rng(seed).integers(0, 30, (HEIGHT, WIDTH, 3)).astype(np.uint8)
    return permeabilities(guide, sigma=12.0)


def some_codes(seed: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Codes of a view, and those of the other with room around."""
    rng = np.random.default_rng(seed)
    codes = rng.integers(0, 2**24, (2, HEIGHT, WIDTH)).astype(np.uint32)
    return codes, rng.integers(0, 2**24, (2, HEIGHT, ROOM + WIDTH + N_DISPARITIES + ROOM)).astype(np.uint32)


def costs_of(codes: NDArray[np.uint32], facing: NDArray[np.uint32], index: NDArray[np.integer]) -> NDArray[np.float64]:
    """Hamming costs (H, W, K) of disparity indices (H, W, K)."""
    rows, columns = np.indices((HEIGHT, WIDTH))
    seen = facing[:, rows[..., None], ROOM + WIDTH - 1 - columns[..., None] + index]
    return np.asarray(np.bitwise_count(codes[..., None] ^ seen).sum(axis=0), np.float64)


def aggregated(
    costs: NDArray[np.float64],
    across: NDArray[np.floating],
    down: NDArray[np.floating],
    slopes: tuple[NDArray[np.floating], NDArray[np.floating]] = (LEVEL, LEVEL),
) -> NDArray[np.float64]:
    """Both recursions of the filter over the whole volume (H, W, K), along slopes (H, W) from pixel to pixel."""
    backward = one_way(costs[:, ::-1], across[:, -2::-1], -slopes[0][:, -2::-1], axis=1)[:, ::-1]
    rows = one_way(costs, across, slopes[0], axis=1) + backward - costs
    upward = one_way(rows[::-1], down[-2::-1], -slopes[1][-2::-1], axis=0)[::-1]
    return one_way(rows, down, slopes[1], axis=0) + upward - rows


def one_way(
    costs: NDArray[np.float64], passage: NDArray[np.floating], slope: NDArray[np.floating], axis: int
) -> NDArray[np.float64]:
    flows = np.moveaxis(costs, axis, 0).copy()
    gates, rises = np.moveaxis(passage, axis, 0), np.moveaxis(slope, axis, 0)
    for place in range(1, len(flows)):
        flows[place] += gates[place - 1][:, None] * risen(flows[place - 1], rises[place - 1])
    return np.moveaxis(flows, 0, axis)


def risen(flows: NDArray[np.float64], rise: NDArray[np.floating]) -> NDArray[np.float64]:
    """Flows (n, K) at a surface that lies higher by `rise` (n,), beyond the ends the outermost."""
    lanes = np.arange(flows.shape[1])
    return np.stack([np.interp(lanes - each, lanes, flow) for flow, each in zip(flows, rise, strict=True)])


def open_gates(passages: Passages) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    return passages.passage[passages.across], passages.passage[passages.down]
