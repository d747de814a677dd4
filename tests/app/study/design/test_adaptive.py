"""Adaptive pair selection: laws of one choice, and what it gains over a whole study."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
from numpy.typing import NDArray

from app.analysis.model.bradley_terry import fit_scores
from app.analysis.reading.votes_table import votes_from_indices
from app.study.design.adaptive import adaptive_pairs, check_adaptive, choose_pairs, posterior
from app.study.trial.trial import PlannedPair

Array = NDArray[np.float64]


def nothing(n: int) -> tuple[Array, Array]:
    return np.zeros((n, n)), np.zeros((n, n))


def vote(wins: Array, ties: Array, pair: tuple[int, int], abilities: Array, rng: np.random.Generator) -> int:
    """Add a vote by Davidson's model; 0, 1 or 2 as in a votes table."""
    a, b = pair
    d = abilities[a] - abilities[b]
    weights = np.array([np.exp(d / 2), np.exp(-d / 2), 0.5])
    choice = int(rng.choice(3, p=weights / weights.sum()))
    if choice == 2:
        ties[a, b] += 1
        ties[b, a] += 1
    else:
        wins[(a, b) if choice == 0 else (b, a)] += 1
    return choice


def test_no_pair_is_chosen_twice_and_all_can_be_chosen() -> None:
    pairs = choose_pairs(*nothing(7), 21, np.random.default_rng(0))
    assert len(set(pairs)) == 21
    assert all(a < b for a, b in pairs)


def test_the_first_batch_links_all_conditions() -> None:
    pairs = choose_pairs(*nothing(16), 15, np.random.default_rng(0))
    assert set(np.ravel(pairs)) == set(range(16))


def test_a_condition_without_votes_comes_first() -> None:
    wins, ties = nothing(15)
    wins[:14, :14] = 2 * (1 - np.eye(14))
    assert all(14 in pair for pair in choose_pairs(wins, ties, 3, np.random.default_rng(0)))


def test_the_same_votes_and_seed_give_the_same_pairs() -> None:
    first, again = (choose_pairs(*nothing(15), 20, np.random.default_rng(4)) for _ in range(2))
    assert first == again != choose_pairs(*nothing(15), 20, np.random.default_rng(5))


@pytest.mark.parametrize("n_pairs", [0, 22])
def test_an_impossible_number_of_pairs_is_refused(n_pairs: int) -> None:
    with pytest.raises(ValueError, match="expected 1 to 21 for 7 conditions"):
        choose_pairs(*nothing(7), n_pairs, np.random.default_rng(0))


def test_the_posterior_is_where_its_gradient_vanishes() -> None:
    rng = np.random.default_rng(1)
    wins, ties = nothing(6)
    for _ in range(200):
        pair = tuple(sorted(rng.permutation(6)[:2].tolist()))
        vote(wins, ties, (pair[0], pair[1]), np.arange(6.0), rng)
    scores, information = posterior(wins, ties)
    step = 1e-5

    def log_posterior(x: Array) -> float:
        d = x[:, None] - x[None, :]
        weights = np.stack([np.exp(d / 2), np.exp(-d / 2), np.full_like(d, 0.5)])
        p = np.log(weights / weights.sum(axis=0))
        return float((wins * p[0]).sum() + (ties * p[2]).sum() / 2 - (x**2).sum() / (2 * 1.5**2))

    slopes = [(log_posterior(scores + e) - log_posterior(scores - e)) / (2 * step) for e in step * np.eye(6)]
    assert slopes == pytest.approx(np.zeros(6), abs=1e-6)
    assert np.linalg.eigvalsh(information).min() > 0


@pytest.mark.slow
def test_twenty_conditions_are_ordered_better_than_by_random_pairs() -> None:
    n, n_people, n_pairs = 20, 12, 30
    first, second = np.triu_indices(n, 1)
    lost: dict[str, list[float]] = {"adaptive": [], "random": []}
    for seed in range(12):
        rng = np.random.default_rng(seed)
        abilities = rng.normal(0, 2, n)
        for rule, found in lost.items():
            wins, ties = nothing(n)
            rows = []
            for who in range(n_people):
                drawn = rng.permutation(len(first))[:n_pairs]
                pairs = list(zip(first[drawn].tolist(), second[drawn].tolist(), strict=True))
                if rule == "adaptive":
                    pairs = choose_pairs(wins, ties, n_pairs, rng)
                rows += [(who, *pair, vote(wins, ties, pair, abilities, rng)) for pair in pairs]
            who, a, b, choice = np.array(rows).T
            names = tuple(map(str, range(n_people))), ("d",), tuple(map(str, range(n)))
            scores = fit_scores(votes_from_indices(who, 0 * who, a, b, choice, names=names)).scores
            assert scores is not None
            found.append(1 - np.corrcoef(scores, abilities)[0, 1])
    assert np.mean(lost["adaptive"]) < 0.9 * np.mean(lost["random"])


def planned(n: int, datasets: int = 2) -> list[PlannedPair]:
    both = [(100 * dataset + a, 100 * dataset + b) for dataset in range(datasets) for a, b in combinations(range(n), 2)]
    return [PlannedPair(key, top // 100, top, bottom) for key, (top, bottom) in enumerate(both)]


def test_a_participant_gets_as_many_pairs_of_every_dataset_and_all_identical_ones() -> None:
    pairs = [*planned(15), PlannedPair(999, 0, 3, 3)]
    chosen = adaptive_pairs(pairs, {}, 20, seed=1, slot=0)
    assert Counter(pair.dataset for pair in chosen) == {0: 21, 1: 20}
    assert chosen != adaptive_pairs(pairs, {}, 20, seed=1, slot=1)


def test_votes_for_the_top_are_not_taken_for_votes_for_the_bottom() -> None:
    pairs = planned(15, datasets=1)
    upside_down = [PlannedPair(pair.key, pair.dataset, pair.bottom, pair.top) for pair in pairs]
    votes = {pair.key: (9, 1, 2) for pair in pairs}
    turned = {key: (bottom, top, neither) for key, (top, bottom, neither) in votes.items()}
    chosen = [pair.key for pair in adaptive_pairs(pairs, votes, 20, seed=1, slot=0)]
    assert [pair.key for pair in adaptive_pairs(upside_down, turned, 20, seed=1, slot=0)] == chosen


@pytest.mark.parametrize(
    ("n_pairs", "n_conditions", "why"), [(5, 6, "below 15 nothing is gained"), (106, 15, "at most 105")]
)
def test_a_study_that_cannot_be_adaptive_is_refused(n_pairs: int, n_conditions: int, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        check_adaptive(n_pairs, n_conditions)


def test_a_dataset_with_fewer_pairs_than_asked_for_shows_all_of_them() -> None:
    small = [PlannedPair(key, 1, *both) for key, both in enumerate(combinations(range(3), 2))]
    large = [PlannedPair(10 + key, 2, *both) for key, both in enumerate(combinations(range(10, 25), 2))]
    chosen = adaptive_pairs([*small, *large], {}, 20, seed=1, slot=0)
    assert Counter(pair.dataset for pair in chosen) == {1: 3, 2: 20}
