"""The laws of a balanced design, for any number of conditions and datasets, any seed and any participant."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.study.design.design import (
    APART,
    FLIPS,
    LONGEST_RUN,
    Repetition,
    balanced_labels,
    longest_run,
    participant_order,
    shuffle_pairs,
    williams_square,
)
from app.study.trial.trial import PlannedPair, PlannedTrial

seeds = st.integers(0, 2**63 - 1)
slots = st.integers(0, 500)
sizes = st.integers(2, 9)
designs = st.lists(sizes, min_size=1, max_size=6)


def pairs_of(sizes_of_datasets: list[int]) -> list[PlannedPair]:
    """All pairs of datasets with so many conditions each; stimuli are numbered through."""
    pairs: list[PlannedPair] = []
    for dataset, size in enumerate(sizes_of_datasets):
        for top, bottom in combinations(range(size), 2):
            pairs.append(PlannedPair(len(pairs), dataset, 100 * dataset + top, 100 * dataset + bottom))
    return pairs


def items(trial: PlannedTrial, pairs: list[PlannedPair]) -> tuple[int, int, int]:
    """The stimuli A, B and the one shown first."""
    pair = pairs[trial.pair]
    a, b = (pair.top, pair.bottom) if trial.a_half == "top" else (pair.bottom, pair.top)
    return a, b, a if trial.first_shown == "a" else b


@given(designs, seeds, slots)
def test_everybody_sees_every_pair_once(design: list[int], seed: int, slot: int) -> None:
    pairs = pairs_of(design)
    order = participant_order(pairs, seed, slot)
    assert sorted(trial.pair for trial in order) == [pair.key for pair in pairs]


@pytest.mark.slow
@given(designs, seeds, slots)
def test_an_order_follows_from_seed_and_slot_alone(design: list[int], seed: int, slot: int) -> None:
    assert participant_order(pairs_of(design), seed, slot) == participant_order(pairs_of(design), seed, slot)


@pytest.mark.slow
@given(designs, seeds, slots)
def test_a_study_has_the_same_orders_in_another_database(design: list[int], seed: int, slot: int) -> None:
    pairs = pairs_of(design)
    there = [PlannedPair(50 + one.key, 70 + one.dataset, 900 + one.top, 900 + one.bottom) for one in pairs]
    order = participant_order(there, seed, slot)
    assert [replace(trial, pair=trial.pair - 50) for trial in order] == participant_order(pairs, seed, slot)


@given(designs, seeds, slots)
def test_a_dataset_is_finished_before_the_next_begins(design: list[int], seed: int, slot: int) -> None:
    pairs = pairs_of(design)
    datasets = [pairs[trial.pair].dataset for trial in participant_order(pairs, seed, slot)]
    assert 1 + sum(one != other for one, other in pairwise(datasets)) == len(design)


@given(designs, seeds, slots)
def test_no_stimulus_is_in_three_trials_in_a_row(design: list[int], seed: int, slot: int) -> None:
    pairs = pairs_of(design)
    shown = [set(items(trial, pairs)[:2]) for trial in participant_order(pairs, seed, slot)]
    runs = [set.intersection(*shown[start : start + LONGEST_RUN + 1]) for start in range(len(shown) - LONGEST_RUN)]
    assert not any(runs)


@pytest.mark.parametrize("n", range(1, 10))
def test_a_williams_square_balances_positions_and_neighbours(n: int) -> None:
    rows = williams_square(n)
    assert len(rows) == (n if n % 2 == 0 else 2 * n)
    positions = Counter((position, item) for row in rows for position, item in enumerate(row))
    neighbours = Counter(pair for row in rows for pair in pairwise(row))
    assert set(positions.values()) == {len(rows) // n}
    assert len(positions) == n * n
    assert len(neighbours) == n * (n - 1)
    assert len(set(neighbours.values())) <= 1


@given(st.integers(2, 6), seeds, st.integers(0, 20))
def test_a_block_of_participants_balances_the_datasets(n_datasets: int, seed: int, block: int) -> None:
    pairs = pairs_of([2] * n_datasets)
    n_rows = len(williams_square(n_datasets))
    orders = [
        [pairs[trial.pair].dataset for trial in participant_order(pairs, seed, slot)]
        for slot in range(block * n_rows, (block + 1) * n_rows)
    ]
    positions = Counter((position, dataset) for order in orders for position, dataset in enumerate(order))
    assert set(positions.values()) == {n_rows // n_datasets}
    assert len(set(Counter(pair for order in orders for pair in pairwise(order)).values())) == 1


@given(designs, seeds, slots)
def test_every_stimulus_is_a_as_often_as_b(design: list[int], seed: int, slot: int) -> None:
    pairs = pairs_of(design)
    surplus: Counter[int] = Counter()
    for trial in participant_order(pairs, seed, slot):
        a, b, _ = items(trial, pairs)
        surplus.update({a: 1})
        surplus.subtract({b: 1})
    assert all(abs(count) <= 1 for count in surplus.values())


@given(designs, seeds, slots)
def test_a_is_shown_first_as_often_as_b(design: list[int], seed: int, slot: int) -> None:
    order = participant_order(pairs_of(design), seed, slot)
    assert abs(sum(1 if trial.first_shown == "a" else -1 for trial in order)) <= 1


@pytest.mark.slow
@given(designs, seeds, slots)
def test_under_either_label_a_stimulus_is_first_as_often_as_second(design: list[int], seed: int, slot: int) -> None:
    pairs = pairs_of(design)
    surplus: Counter[tuple[str, int]] = Counter()
    for trial in participant_order(pairs, seed, slot):
        a, b, first = items(trial, pairs)
        surplus.update({("a", a): 1 if first == a else -1, ("b", b): 1 if first == b else -1})
    assert all(abs(count) <= 1 for count in surplus.values())


@pytest.mark.slow
@given(designs, seeds, st.integers(0, 100))
def test_four_participants_see_each_pair_in_all_four_ways(design: list[int], seed: int, block: int) -> None:
    pairs = pairs_of(design)
    ways: dict[int, set[tuple[int, int]]] = {pair.key: set() for pair in pairs}
    for slot in range(FLIPS * block, FLIPS * (block + 1)):
        for trial in participant_order(pairs, seed, slot):
            a, _, first = items(trial, pairs)
            ways[trial.pair].add((a, first))
    assert {len(seen) for seen in ways.values()} == {FLIPS}


def test_which_stimulus_is_a_does_not_depend_on_its_place_in_the_video() -> None:
    pairs = pairs_of([6])
    on_top = sum(trial.a_half == "top" for slot in range(400) for trial in participant_order(pairs, 1, slot))
    assert abs(on_top / (400 * len(pairs)) - 0.5) < 0.01


@settings(max_examples=20)
@given(st.integers(10, 24), seeds)
def test_many_conditions_find_an_order_too(n: int, seed: int) -> None:
    pairs = pairs_of([n])
    order = shuffle_pairs(pairs, np.random.default_rng(seed))
    assert sorted(pair.key for pair in order) == list(range(len(pairs)))


def test_pairs_that_all_share_a_stimulus_come_in_some_order() -> None:
    star = [PlannedPair(key, 0, 0, key + 1) for key in range(5)]
    assert sorted(pair.key for pair in shuffle_pairs(star, np.random.default_rng(1))) == list(range(5))


@given(sizes, seeds, st.integers(-1, 1))
def test_labels_of_one_dataset_take_up_what_was_uneven_before(n: int, seed: int, so_far: int) -> None:
    trials = balanced_labels(pairs_of([n]), np.random.default_rng(seed), first_a_so_far=so_far)
    assert abs(so_far + sum(1 if trial.first_shown == "a" else -1 for trial in trials)) <= 1


def with_identical(pairs: list[PlannedPair]) -> list[PlannedPair]:
    """The pairs, and every stimulus against itself."""
    stimuli = sorted({(pair.dataset, stimulus) for pair in pairs for stimulus in pair.stimuli})
    return pairs + [PlannedPair(len(pairs) + n, *one, one[1]) for n, one in enumerate(stimuli)]


repetitions = st.builds(
    Repetition, both_orders=st.booleans(), repeated_pairs=st.integers(0, 3), identical_pairs=st.integers(0, 2)
)
large_designs = st.lists(st.integers(4, 7), min_size=1, max_size=3)


@pytest.mark.slow
@given(large_designs, seeds, slots, repetitions)
def test_repetitions_add_just_what_they_say(design: list[int], seed: int, slot: int, repetition: Repetition) -> None:
    pairs = with_identical(pairs_of(design))
    order = participant_order(pairs, seed, slot, repetition)
    roles = Counter((trial.role, pairs[trial.pair].dataset) for trial in order)
    for dataset, size in enumerate(design):
        n_pairs = size * (size - 1) // 2
        assert roles["main", dataset] == n_pairs * (2 if repetition.both_orders else 1)
        assert roles["repeat", dataset] == repetition.repeated_pairs
        assert roles["identical", dataset] == repetition.identical_pairs
    assert all(pairs[trial.pair].is_identical == (trial.role == "identical") for trial in order)


@pytest.mark.slow
@given(large_designs, seeds, slots, repetitions)
def test_repetitions_make_no_run_longer(design: list[int], seed: int, slot: int, repetition: Repetition) -> None:
    pairs = with_identical(pairs_of(design))
    order = participant_order(pairs, seed, slot, repetition)
    assert longest_run([pairs[trial.pair].stimuli for trial in order]) <= LONGEST_RUN


@given(large_designs, seeds, slots)
def test_in_both_orders_each_stimulus_of_a_pair_is_a_once_and_first_once(
    design: list[int], seed: int, slot: int
) -> None:
    pairs = pairs_of(design)
    ways: dict[int, list[tuple[int, int]]] = {pair.key: [] for pair in pairs}
    for trial in participant_order(pairs, seed, slot, Repetition(both_orders=True)):
        a, _, first = items(trial, pairs)
        ways[trial.pair].append((a, first))
    for pair in pairs:
        assert {a for a, _ in ways[pair.key]} == {first for _, first in ways[pair.key]} == pair.stimuli


@pytest.mark.slow
@given(st.lists(st.integers(6, 7), min_size=1, max_size=3), seeds, slots, st.integers(1, 3))
def test_a_repetition_comes_as_its_pair_was_and_far_from_it(design: list[int], seed: int, slot: int, n: int) -> None:
    pairs = pairs_of(design)
    order = participant_order(pairs, seed, slot, Repetition(repeated_pairs=n))
    for position, trial in enumerate(order):
        if trial.role == "repeat":
            (before,) = (index for index, one in enumerate(order) if one.pair == trial.pair and one.role == "main")
            assert before < position
            assert (order[before].a_half, order[before].first_shown) == (trial.a_half, trial.first_shown)
            assert position - before > APART


@settings(max_examples=10, deadline=None)
@given(st.integers(3, 5), seeds, st.integers(1, 3), st.integers(0, 20))
def test_repeated_and_identical_pairs_go_round(n_stimuli: int, seed: int, n: int, block: int) -> None:
    pairs = with_identical(pairs_of([n_stimuli]))
    n_pairs = n_stimuli * (n_stimuli - 1) // 2
    times: Counter[int] = Counter()
    for slot in range(block * n_pairs, (block + 1) * n_pairs):
        order = participant_order(pairs, seed, slot, Repetition(repeated_pairs=n, identical_pairs=n))
        times.update(trial.pair for trial in order if trial.role != "main")
    per_stimulus = [times[pair.key] for pair in pairs if pair.is_identical]
    assert {times[pair.key] for pair in pairs if not pair.is_identical} == {n}
    assert max(per_stimulus) - min(per_stimulus) <= 1


@given(st.integers(4, 7), seeds, slots)
def test_an_identical_pair_is_not_the_first_of_a_dataset(n: int, seed: int, slot: int) -> None:
    order = participant_order(with_identical(pairs_of([n])), seed, slot, Repetition(identical_pairs=1))
    assert order[0].role == "main"


@given(st.lists(st.frozensets(st.integers(0, 4), min_size=1, max_size=2), max_size=12))
def test_the_longest_run_is_that_of_counting_every_window(shown: list[frozenset[int]]) -> None:
    windows = [shown[i:j] for i in range(len(shown)) for j in range(i + 1, len(shown) + 1)]
    assert longest_run(shown) == max((len(one) for one in windows if frozenset.intersection(*one)), default=0)
