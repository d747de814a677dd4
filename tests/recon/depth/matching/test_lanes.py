"""Sixteen numbers in a register do what numpy does with sixteen numbers."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from recon.depth.matching import lanes


@njit
def _arithmetic(numbers, factor, out):  # type: ignore[no-untyped-def]  # lanes have no Python type
    first, second = lanes.load(numbers, 1), lanes.load(numbers, 20)
    lanes.store(out, 0, lanes.add(first, second))
    lanes.store(out, 16, lanes.add_scaled(first, factor, second))
    lanes.store(out, 32, lanes.multiply(first, second))
    lanes.store(out, 48, lanes.truncated_difference(first, second, factor))
    lanes.store(out, 64, lanes.spread_lane(first, 5))
    lanes.store(out, 80, lanes.zeros())
    lanes.store_eight(out, 96, lanes.add(first, second))
    lanes.store(out, 112, lanes.load_eight(numbers, 20))
    lanes.store(out, 128, lanes.moved_down(first))
    return lanes.total(first)


def test_arithmetic_is_lane_by_lane() -> None:
    numbers = np.random.default_rng(0).normal(size=40).astype(np.float32)
    out = np.full(144, 7, np.float32)
    total = _arithmetic(numbers, np.float32(0.7), out)
    first, second = numbers[1:17], numbers[20:36]
    expected = [first + second, first + np.float32(0.7) * second, first * second]
    expected += [np.minimum(np.abs(first - second), np.float32(0.7)), np.full(16, first[5]), np.zeros(16)]
    expected += [
        np.append((first + second)[:8], np.full(8, 7)),
        np.append(second[:8], np.zeros(8)),
        np.append(first[1:], first[15]),
    ]
    np.testing.assert_allclose(out.reshape(9, 16), expected, rtol=1e-6, atol=1e-7)
    assert total == pytest.approx(first.sum(), rel=1e-6)


@njit
def _bits(words, codes, first, step, out):  # type: ignore[no-untyped-def]  # lanes have no Python type
    gathered = lanes.gather(words, 10, first, step, 29)
    lanes.store(out, 0, lanes.lower_half(gathered))
    lanes.store(out, 16, lanes.upper_half(gathered))
    lanes.store(out, 32, lanes.byte_distance(codes[3], gathered))
    lanes.store(out, 48, lanes.hamming(codes[3], codes, 7))


@pytest.mark.parametrize(("first", "step"), [(3.4, 1.7), (35.2, -2.3), (-4.0, 0.0)])
def test_words_are_gathered_clipped_taken_apart_and_compared(first: float, step: float) -> None:
    rng = np.random.default_rng(1)
    words = rng.integers(-(2**31), 2**31, 50).astype(np.int32)
    codes = rng.integers(0, 2**32, 50).astype(np.uint32)
    out = np.empty(64, np.float32)
    _bits(words, codes, np.float32(first), np.float32(step), out)
    index = np.rint(np.float32(first) + np.arange(16, dtype=np.float32) * np.float32(step))
    taken = words[10 + np.clip(index, 0, 29).astype(int)]
    bytes_ = taken.view(np.uint8).reshape(16, 4).astype(int)
    own = codes[3:4].view(np.uint8).astype(int)
    expected = [taken & 0xFFFF, taken >> 16, np.abs(bytes_ - own).sum(axis=1), np.bitwise_count(codes[3] ^ codes[7:23])]
    np.testing.assert_array_equal(out.reshape(4, 16), expected)


@njit
def _fallen(places, fall, out):  # type: ignore[no-untyped-def]  # lanes have no Python type
    lanes.store(out, 0, lanes.falling(lanes.load(places, 0), fall))


def test_a_weight_falls_in_straight_lines_between_powers_of_two_and_ends_at_zero() -> None:
    steps, out = np.linspace(0, 7, 16).astype(np.float32), np.empty(16, np.float32)
    _fallen(steps, np.float32(2**23), out)
    np.testing.assert_allclose(out, np.interp(steps, np.arange(9), 0.5 ** np.arange(9)), rtol=1e-6)
    _fallen(steps, np.float32(2**23 * 1000), out)
    np.testing.assert_array_equal(out, [1, *[0] * 15])


@njit
def _lowest(numbers, first, last, flip):  # type: ignore[no-untyped-def]  # lanes have no Python type
    return lanes.lowest(lanes.load(numbers, 0), first, last, flip)


def lane_of(numbers: NDArray[np.float32], first: int, last: int, flip: int) -> int:
    return (int(_lowest(numbers, first, last, flip)) & 15) ^ flip


def test_the_lowest_lane_is_found_within_its_limits_and_ties_go_to_the_chosen_end() -> None:
    numbers = np.array([3, 1, 7, 1, 9, 4, 4, 8, 2, 2, 6, 5, 1, 8, 8, 0], np.float32)
    assert lane_of(numbers, 0, 15, 0) == 15
    assert lane_of(numbers, 0, 14, 0) == 1
    assert lane_of(numbers, 0, 14, 15) == 12
    assert lane_of(numbers, 4, 9, 0) == 8
    assert lane_of(numbers, 4, 9, 15) == 9
