"""PatchMatch's search against a plain one of numpy, pixel by pixel."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.depth import StereoPair
from recon.depth.matching import plane_search
from recon.depth.matching.guide import Passages
from recon.depth.matching.plane_search import AT_REST, NEIGHBOURS, TAPS, Settings, sweep
from recon.depth.matching.texture import PAD, Texture, texture_of
from recon.depth.matching.views import View, views_of

pytestmark = pytest.mark.slow

HEIGHT, WIDTH = 14, 22
SETTINGS = Settings(*np.float32([0, 7, 1, 605_000, 0.9, 2560, 512, 12.8, 6]))
Plane = NDArray[np.float32]


class PlainSearch:
    """A view's planes, and what they are judged by; all of it read and written one pixel at a time."""

    def __init__(self, view: View, texture: Texture, facing: Texture, planes: Plane, others: Plane) -> None:
        in_columns = [
            np.empty((HEIGHT, WIDTH + 2 * PAD), sorted_.dtype) for sorted_ in (texture.colours, texture.words)
        ]
        for columns, sorted_ in zip(in_columns, (texture.colours, texture.words), strict=True):
            for parity in (0, 1):
                columns[:, parity::2] = sorted_[:, parity, : columns[:, parity::2].shape[1]]
        self.colours = in_columns[0].view(np.uint8).reshape(HEIGHT, -1, 4).astype(int)
        self.words, self.fine, self.passages = in_columns[1], facing.fine, view.passages
        self.planes, self.others = planes, others
        self.costs = np.full((HEIGHT, WIDTH), np.nan)
        self.moved = np.zeros((HEIGHT, WIDTH), np.int16)

    def cost(self, y: int, x: int, plane: Plane) -> float:
        rows = np.arange(-16, 17, 2)
        v, k = (grid.ravel() for grid in np.meshgrid(rows, np.arange(16), indexing="ij"))
        u = -16 + (v // 2) % 2 + 2 * k
        inside = (y + v >= 0) & (y + v < HEIGHT)
        u, v = u[inside], v[inside]
        distance = np.abs(self.colours[y + v, x + u + PAD] - self.colours[y, x + PAD]).sum(axis=1)
        halvings = distance * SETTINGS.fall / 2**23
        weight = 0.5 ** np.floor(halvings) * (1 - (halvings % 1) / 2)
        disparity = plane[0] + plane[1] * u + plane[2] * v
        place = np.clip(np.rint(4 * (WIDTH - 1 - x - u + disparity)), 0, self.fine.shape[1] - 1).astype(int)
        here, there = self.words[y + v, x + u + PAD], self.fine[y + v, place]
        grey = np.minimum(np.abs((here & 0xFFFF) - (there & 0xFFFF)), SETTINGS.grey_limit)
        slope = np.minimum(np.abs((here >> 16) - (there >> 16)), SETTINGS.gradient_limit)
        return float(np.average(grey + SETTINGS.gradient_share * (slope - grey), weights=weight))

    def roughness(self, y: int, x: int, plane: Plane) -> float:
        across, down, passage = self.passages
        rough = 0.0
        for u, v, change in (
            (-1, 0, across[y, x - 1]),
            (1, 0, across[y, x]),
            (0, -1, down[y - 1, x]),
            (0, 1, down[y, x]),
        ):
            if 0 <= x + u < WIDTH and 0 <= y + v < HEIGHT:
                other = self.planes[y + v, x + u]
                there = abs(plane @ [1, u, v] - other[0])
                here = abs(other @ [1, -u, -v] - plane[0])
                rough += passage[change] * min(there + here, SETTINGS.distance_limit)
        return float(SETTINGS.smoothness * rough)

    def trials(self, y: int, x: int, turn: int, seed: int, facing_moved: NDArray[np.int16]) -> Iterator[Plane]:
        """Yield the planes to try; each is made when the one before was judged."""
        for distance in NEIGHBOURS:
            for u, v in ((distance, 0), (-distance, 0), (0, distance), (0, -distance)):
                row, column = y + v, x + u
                if 0 <= row < HEIGHT and 0 <= column < WIDTH:
                    moved = self.moved[row, column]
                    if moved >= turn - 1 and (distance == 1 or moved >= 1):
                        plane = self.planes[row, column]
                        yield np.array([plane @ [1, -u, -v], *plane[1:]])
        moving = self.moved[y, x] >= turn - 3
        there = WIDTH - 1 - x + int(np.rint(self.planes[y, x, 0]))
        if 0 <= there < WIDTH and (moving or facing_moved[y, there] >= (turn | 1) - 3):
            there = min(max(WIDTH - 1 - x + int(np.rint(self.now[0])), 0), WIDTH - 1)
            other = self.others[y, there]
            squeeze = 1 / (1 - other[1])
            yield squeeze * np.array([other @ [1, WIDTH - 1 - x - there, 0], -other[1], other[2]])
        if moving:
            state, step = (
                np.uint32((seed * 0x9E3779B1 + y * 0x85EBCA6B + x * 0xC2B2AE35) % 2**32),
                0.5 ** (turn // 2 % 4),
            )
            state, trial = plane_search._changed(tuple(self.now.astype(np.float32)), np.float32(step), state)
            yield np.array(trial)

    def look(self, y: int, x: int, turn: int, seed: int, facing_moved: NDArray[np.int16]) -> None:
        self.now = self.planes[y, x].copy()
        best: tuple[float, float] | None = None
        for trial in self.trials(y, x, turn, seed, facing_moved):
            if best is None:
                cost = self.cost(y, x, self.now) if np.isnan(self.costs[y, x]) else self.costs[y, x]
                before = cost + self.roughness(y, x, self.now)
                best = cost, before
            trial = np.clip(trial, [SETTINGS.lowest, -0.9, -0.9], [SETTINGS.highest, 0.9, 0.9])
            if abs(trial[0] - self.now[0]) + 5 * np.abs(trial[1:] - self.now[1:]).sum() < 0.1:
                continue
            cost = self.cost(y, x, trial)
            if cost + self.roughness(y, x, trial) < best[1]:
                self.now, best = trial, (cost, cost + self.roughness(y, x, trial))
        if best is not None:
            if before - best[1] > 0.03 * before:
                self.moved[y, x] = turn
            self.costs[y, x], self.planes[y, x] = best[0], self.now


def a_view() -> tuple[View, Texture, Texture]:
    images = np.random.default_rng(3).integers(0, 256, (2, HEIGHT, WIDTH, 3)).astype(np.uint8)
    images = np.stack([cv2.GaussianBlur(image, (0, 0), 1.5) for image in images])
    left, right = views_of(StereoPair(images[0], images[1], 8), 12.0)
    return left, texture_of(left), texture_of(right)


def test_turns_of_the_search_are_those_of_the_plain_one() -> None:
    view, texture, facing = a_view()
    rng = np.random.default_rng(4)
    planes, others = (rng.uniform([0, -0.2, -0.2], [7, 0.2, 0.2], (HEIGHT, WIDTH, 3)) for _ in range(2))
    facing_moved = rng.integers(AT_REST, 4, (HEIGHT, WIDTH)).astype(np.int16)
    plain = PlainSearch(view, texture, facing, planes.copy(), others)
    plain.moved[:, :6] = AT_REST
    found, costs = planes.astype(np.float32), np.full((HEIGHT, WIDTH), -1, np.float32)
    moved, taps = plain.moved.copy(), np.empty(3 * TAPS, np.float32)
    assert isinstance(view.passages, Passages)
    for turn in range(5):
        seen = (texture.colours, texture.words, facing.fine)
        other = (others.astype(np.float32), facing_moved)
        sweep(seen, view.passages, SETTINGS, *other, turn, turn, found, costs, moved, taps, 0, HEIGHT)
        for y in range(HEIGHT):
            for x in range((y + turn) % 2, WIDTH, 2):
                plain.look(y, x, turn, turn, facing_moved)
        np.testing.assert_array_equal(moved, plain.moved)
        np.testing.assert_allclose(found, plain.planes, atol=1e-4)
    assert (moved[:, 6:] == 4).any()
    assert (moved[:, :2] == AT_REST).any()
