"""Laws of orders in which films are rated one by one."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from app.study.design.design import APART, Repetition
from app.study.design.rating_order import most_neighbours, rating_order
from app.study.trial.trial import PlannedPair

SIZES = st.lists(st.integers(1, 7), min_size=1, max_size=5)  # films of each dataset


def alone(sizes: list[int]) -> list[PlannedPair]:
    """Each film by itself."""
    films = [(dataset, film) for dataset, n in enumerate(sizes) for film in range(n)]
    return [PlannedPair(key, dataset, key, key) for key, (dataset, _) in enumerate(films)]


def against_references(sizes: list[int]) -> list[PlannedPair]:
    """Each film below its dataset's reference, and each reference below itself."""
    films = [(dataset, film) for dataset, n in enumerate(sizes) for film in range(n)]
    pairs = [PlannedPair(key, dataset, 1000 + dataset, key) for key, (dataset, _) in enumerate(films)]
    return pairs + [PlannedPair(500 + d, d, 1000 + d, 1000 + d) for d in range(len(sizes))]


@given(SIZES, st.integers(0, 2**32), st.integers(0, 50))
def test_every_film_is_rated_once_and_datasets_mix_as_well_as_they_can(sizes: list[int], seed: int, slot: int) -> None:
    pairs = alone(sizes)
    order = rating_order(pairs, seed, slot, Repetition())
    assert sorted(trial.pair for trial in order) == list(range(sum(sizes)))
    assert {(trial.a_half, trial.first_shown, trial.role) for trial in order} == {("top", "a", "main")}
    datasets = [pairs[trial.pair].dataset for trial in order]
    assert sum(a == b for a, b in pairwise(datasets)) == most_neighbours(datasets)


@given(st.integers(0, 2**32), st.integers(0, 50), st.integers(1, 6))
def test_a_film_comes_again_after_others_and_its_first_rating_counts(seed: int, slot: int, n_repeated: int) -> None:
    order = rating_order(alone([6, 6, 6]), seed, slot, Repetition(repeated_pairs=n_repeated))
    assert Counter(trial.role for trial in order) == {"main": 18, "repeat": 3 * n_repeated}
    for trial in order:
        if trial.role == "repeat":
            first, second = (place for place, other in enumerate(order) if other.pair == trial.pair)
            assert second - first > APART
            assert order[first].role == "main"


@given(st.integers(0, 2**32), st.integers(0, 50))
def test_a_reference_is_rated_against_itself_once_but_not_first(seed: int, slot: int) -> None:
    order = rating_order(against_references([3, 2]), seed, slot, Repetition(identical_pairs=1))
    assert Counter(trial.role for trial in order) == {"main": 5, "identical": 2}
    assert order[0].role == "main"


def test_slots_have_orders_of_their_own_and_seeds_repeat_them() -> None:
    pairs = alone([5, 5])
    orders = [[trial.pair for trial in rating_order(pairs, 1, slot, Repetition())] for slot in range(20)]
    assert len({tuple(order) for order in orders}) == 20
    assert orders[3] == [trial.pair for trial in rating_order(pairs, 1, 3, Repetition())]
    firsts = Counter(order[0] for order in orders)
    assert len(firsts) > 5


def test_repeated_films_rotate_from_slot_to_slot() -> None:
    pairs = alone([4])
    once = Repetition(repeated_pairs=1)
    repeated = [
        next(trial.pair for trial in rating_order(pairs, 1, slot, once) if trial.role == "repeat") for slot in range(4)
    ]
    assert sorted(repeated) == [0, 1, 2, 3]
