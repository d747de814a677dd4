"""Circular triads against enumeration, and against published and independent counts."""

from __future__ import annotations

import csv
from itertools import combinations, permutations, product
from math import comb
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.analysis.reading.read_votes import read_votes, votes_from_rows
from app.analysis.reading.votes_table import votes_from_indices
from app.analysis.screening.triads import (
    Triads,
    chance_of,
    circular_distribution,
    circular_from_wins,
    count_circular,
    expected_circular,
    max_circular,
    pooled_p_value,
    preference_matrix,
    tournament_counts,
    triads,
)

# Kendall and Babington Smith (1940), p. 326: a dog's preferences among six foods.
DOG = {
    "meat": "biscuit chocolate pear cheese",
    "biscuit": "apple pear",
    "chocolate": "biscuit apple pear cheese",
    "apple": "meat",
    "pear": "apple cheese",
    "cheese": "biscuit apple",
}


def slow_circular(preferred: NDArray[np.float64]) -> int:
    """Count triples in which somebody beats somebody who beats somebody who beats the first."""
    found = 0
    for a, b, c in combinations(range(len(preferred)), 3):
        found += any(preferred[x, y] == preferred[y, z] == preferred[z, x] == 1 for x, y, z in permutations((a, b, c)))
    return found


def tournaments(n: int) -> list[NDArray[np.float64]]:
    pairs = list(combinations(range(n), 2))
    result = []
    for outcome in product((0.0, 1.0), repeat=len(pairs)):
        preferred = np.full((n, n), np.nan)
        for (a, b), won in zip(pairs, outcome, strict=True):
            preferred[a, b], preferred[b, a] = won, 1 - won
        result.append(preferred)
    return result


@st.composite
def preferences(draw: st.DrawFn, *, may_be_missing: bool = False, largest: int = 6) -> NDArray[np.float64]:
    n = draw(st.integers(3, largest))
    values = [0.0, 0.5, 1.0, np.nan] if may_be_missing else [0.0, 0.5, 1.0]
    preferred = np.full((n, n), np.nan)
    for a, b in combinations(range(n), 2):
        preferred[a, b] = draw(st.sampled_from(values))
        preferred[b, a] = 1 - preferred[a, b]
    return preferred


def test_the_dog_of_kendall_and_babington_smith() -> None:
    votes = votes_from_rows(
        {"participant": "dog", "dataset": "food", "item_a": better, "item_b": worse, "choice": "a"}
        for better, others in DOG.items()
        for worse in others.split()
    )
    (row,) = triads(votes)
    assert (row.circular, row.circular_max, row.complete, row.n_items) == (5, 8, True, 6)
    assert row.zeta == pytest.approx(0.375, abs=1e-15)
    assert row.p_value == pytest.approx(0.50927734375, abs=1e-10)


@pytest.mark.parametrize("n", [3, 4, 5])
def test_the_distribution_is_that_of_all_tournaments(n: int) -> None:
    counts = [slow_circular(preferred) for preferred in tournaments(n)]
    assert tournament_counts(n) == tuple(np.bincount(counts, minlength=max_circular(n) + 1))
    assert [count_circular(preferred) for preferred in tournaments(n)] == counts


def test_six_items_are_counted_as_published() -> None:
    assert tournament_counts(6) == (720, 960, 2240, 2880, 6240, 3648, 8640, 4800, 2640)
    assert circular_distribution(6)[:2].sum() == pytest.approx(1680 / 32768, abs=1e-15)


@pytest.mark.parametrize("n", range(3, 11))
def test_counts_sum_to_all_tournaments_and_have_the_known_mean(n: int) -> None:
    counts = tournament_counts(n)
    assert sum(counts) == 2 ** comb(n, 2)
    assert sum(t * count for t, count in enumerate(counts)) * 4 == comb(n, 3) * sum(counts)


@given(preferences(may_be_missing=True))
def test_strict_cycles_equal_a_slow_count(preferred: NDArray[np.float64]) -> None:
    assert count_circular(preferred) == slow_circular(preferred)


@given(preferences())
def test_the_expectation_with_ties_is_half_points_less_a_quarter_per_tie(preferred: NDArray[np.float64]) -> None:
    n = len(preferred)
    points = np.nansum(preferred, axis=1)
    t_half = n * (n - 1) * (2 * n - 1) / 12 - np.sum(points**2) / 2
    n_ties = np.sum(preferred == 0.5) / 2
    assert expected_circular(preferred) == pytest.approx(t_half - n_ties / 4, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(preferences(may_be_missing=True, largest=4))
def test_chance_turns_every_vote_and_leaves_ties_and_gaps_in_place(preferred: NDArray[np.float64]) -> None:
    strict = np.argwhere(np.triu((preferred == 1) | (preferred == 0)))
    expected = []
    for outcome in product((0.0, 1.0), repeat=len(strict)):
        turned = preferred.copy()
        for (a, b), won in zip(strict, outcome, strict=True):
            turned[a, b], turned[b, a] = won, 1 - won
        expected.append(expected_circular(turned))
    observed, chance = chance_of(preferred, 100)
    if not len(chance):
        assert len(set(expected)) == 1  # whatever the votes say
        return
    as_few = np.mean(np.array(expected) <= expected_circular(preferred) + 1e-9)
    assert chance[: observed + 1].sum() == pytest.approx(as_few, abs=1e-12)
    for count, share in enumerate(chance):
        same = np.abs(np.array(expected) - expected_circular(preferred) - (count - observed) / 2) < 1e-9
        assert share == pytest.approx(np.mean(same), abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("ties", "missing"), [(0.0, 0.07), (0.15, 0.0), (0.3, 0.0), (0.2, 0.5)])
def test_random_votes_are_more_consistent_than_chance_in_5_percent(ties: float, missing: float) -> None:
    """Over five datasets of six items each, where small p-values are possible."""
    rng = np.random.default_rng(4)
    n, people = 6, 150
    low, high = np.triu_indices(n, 1)
    who, dataset, pair = (part.ravel() for part in np.indices((people, 5, len(low))))
    kept = rng.random(len(who)) >= missing
    choice = np.where(rng.random(len(who)) < ties, 2, rng.integers(0, 2, len(who)))
    names = tuple(map(str, range(people))), tuple("abcde"), tuple("uvwxyz")
    columns = (column[kept] for column in (who, dataset, low[pair], high[pair], choice))
    rows = triads(votes_from_indices(*columns, names=names))
    by_person: dict[str, list[Triads]] = {}
    for row in rows:
        by_person.setdefault(row.participant, []).append(row)
    p_values = np.array([pooled_p_value(person) for person in by_person.values()], float)
    assert len(p_values) == people  # a missing vote takes nobody's test away
    assert 0.013 <= np.mean(p_values <= 0.05) <= 0.1  # 99 % of 150 at a true 4 to 5 %
    assert 0.4 < np.mean(p_values) < 0.62


@given(st.permutations(range(6)))
def test_a_perfectly_ordered_judge_has_none_and_win_counts_agree(order: list[int]) -> None:
    rank = np.array(order)
    preferred = np.where(np.eye(6) > 0, np.nan, (rank[:, None] < rank).astype(float))
    assert count_circular(preferred) == 0
    assert circular_from_wins(np.nansum(preferred, axis=1).astype(np.int64), 6) == 0


def test_a_perfectly_circular_judge_reaches_the_maximum() -> None:
    votes = votes_from_rows(
        {"participant": "p", "dataset": "d", "item_a": str(a), "item_b": str((a + step) % 5), "choice": "a"}
        for a in range(5)
        for step in (1, 2)
    )
    (row,) = triads(votes)
    assert (row.circular, row.circular_max, row.zeta, row.p_value) == (5, 5, 0.0, 1.0)


def test_an_incomplete_design_counts_the_triples_that_are_there_and_says_so() -> None:
    cycle = [("x", "y"), ("y", "z"), ("z", "x"), ("x", "w")]
    votes = votes_from_rows(
        {"participant": "p", "dataset": "d", "item_a": a, "item_b": b, "choice": "a"} for a, b in cycle
    )
    (row,) = triads(votes)
    assert (row.circular, row.complete, row.circular_max, row.zeta, row.p_value) == (1, False, None, None, 1.0)


def test_repeated_votes_count_as_their_majority() -> None:
    def vote(a: str, b: str, choice: str) -> dict[str, str]:
        return {"participant": "p", "dataset": "d", "item_a": a, "item_b": b, "choice": choice}

    cycle = [vote("x", "y", "a"), vote("y", "z", "a"), vote("z", "x", "a")]
    assert triads(votes_from_rows([*cycle, vote("x", "z", "a"), vote("x", "z", "a")]))[0].circular == 0
    (tied,) = triads(votes_from_rows([*cycle, vote("x", "z", "a")]))
    assert (tied.circular, tied.circular_expected_ties) == (0, 0.5)


def test_pooling_over_five_datasets_of_six_items_is_significant_up_to_seventeen() -> None:
    distribution = circular_distribution(6)
    pooled = distribution
    for _ in range(4):
        pooled = np.convolve(pooled, distribution)
    assert pooled[:18].sum() <= 0.05 < pooled[:19].sum()
    votes = votes_from_rows(
        {"participant": "dog", "dataset": dataset, "item_a": better, "item_b": worse, "choice": "a"}
        for dataset in "12345"
        for better, others in DOG.items()
        for worse in others.split()
    )
    assert pooled_p_value(triads(votes)) == pytest.approx(pooled[:26].sum(), abs=1e-12)


def test_303_students_have_the_cycles_counted_elsewhere(real_data: Path) -> None:
    folder = real_data / "votes" / "reference" / "cemschoice"
    with (folder / "triads_expected.csv").open(encoding="utf-8") as file:
        expected = {row["judge"]: row for row in csv.DictReader(file)}
    rows = triads(read_votes(folder / "votes.csv"))
    assert len(rows) == len(expected) == 303
    for row in rows:
        other = expected[row.participant]
        assert row.circular == int(other["strict_cycles"])
        assert row.complete == (other["complete"] == "True")
        if row.complete:
            assert row.circular_expected_ties == pytest.approx(
                float(other["T_half"]) - int(other["ties"]) / 4, abs=1e-12
            )
    assert sum(row.circular for row in rows) == 61
    assert sum(row.circular > 0 for row in rows) == 35


def test_a_published_study_of_tone_mapping_has_no_circular_triad(real_data: Path) -> None:
    rows = triads(read_votes(real_data / "votes" / "pwcmp_tone_mapping.csv"))
    assert sum(row.circular for row in rows) == 0


def test_few_votes_between_many_items_are_counted_as_in_a_full_table() -> None:
    rng = np.random.default_rng(2)
    first = rng.integers(0, 150, 900)
    second = (first + rng.integers(1, 150, 900)) % 150
    names = ("p",), ("d",), tuple(map(str, range(150)))
    votes = votes_from_indices(0 * first, 0 * first, first, second, rng.integers(0, 3, 900), names=names)
    (row,) = triads(votes)
    preferred = preference_matrix(
        *(column.astype(np.int64) for column in (votes.item_a, votes.item_b, votes.choice, votes.count))
    )
    assert row.circular == count_circular(preferred) > 0
    assert row.circular_expected_ties == pytest.approx(expected_circular(preferred), abs=1e-9)
    assert not row.complete
