"""Agreement takes ties and missing votes, disagreement beyond noise is tested at its level, and camps are found."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, permutations
from pathlib import Path

import numpy as np
import pytest

from app.analysis import analyse, read_votes, votes_from_rows
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.reading.votes_table import VotesTable
from app.analysis.screening.agreement import agreement_rows
from app.analysis.screening.disagreement import disagreement, heterogeneity, krippendorff_alpha

SCORES = np.linspace(0.8, -0.8, 6)


def panel(seed: int, people: int = 22, **plan: float) -> VotesTable:
    return simulate_votes(StudyPlan(6, 5, people, **plan), SCORES, np.random.default_rng(seed))


def turned(votes: VotesTable, is_turned: np.ndarray) -> VotesTable:
    """The same votes with other sides."""
    a, b = np.where(is_turned, votes.item_b, votes.item_a), np.where(is_turned, votes.item_a, votes.item_b)
    choice = np.where(is_turned & (votes.choice < 2), 1 - votes.choice, votes.choice)
    return replace(votes, item_a=a, item_b=b, choice=choice)


def camps(seed: int) -> VotesTable:
    """Every second person prefers the opposite."""
    votes = panel(seed, spread=0.2)
    is_other = (votes.participant % 2 == 1) & (votes.choice < 2)
    return replace(votes, choice=np.where(is_other, 1 - votes.choice, votes.choice).astype(np.int8))


def slow_alpha(votes: VotesTable) -> float:
    """Krippendorff's alpha from all pairs of values, each unit in both directions."""
    units: dict[tuple[int, int], list[float]] = {}
    for dataset, low, sign in zip(
        votes.dataset.tolist(),
        votes.pair.tolist(),
        np.where(votes.choice == 2, 0, np.where(votes.prefers_lower, 1, -1)).tolist(),
        strict=True,
    ):
        units.setdefault((dataset, low), []).append(float(sign))
    both = [values for unit in units.values() for values in (unit, [-value for value in unit]) if len(unit) > 1]
    every = [value for values in both for value in values]
    within = sum(sum((a - b) ** 2 for a, b in permutations(values, 2)) / (len(values) - 1) for values in both)
    between = 2 * sum((a - b) ** 2 for a, b in combinations(every, 2)) / (len(every) - 1)
    return 1 - within / between


def test_alpha_is_that_of_the_definition_with_ties_and_missing_votes() -> None:
    votes = panel(1, 5)
    votes = votes.where(np.random.default_rng(2).random(len(votes)) < 0.7)
    assert krippendorff_alpha(votes)["alpha"] == pytest.approx(slow_alpha(votes), abs=1e-12)


def test_alpha_does_not_depend_on_which_item_is_named_first() -> None:
    votes = panel(3)
    other = turned(votes, np.random.default_rng(4).random(len(votes)) < 0.5)
    assert krippendorff_alpha(other) == krippendorff_alpha(votes)


def test_alpha_without_ties_is_close_to_kendalls_u() -> None:
    votes = panel(5, tie_rate=0.0)
    us = [row["u"] for row in agreement_rows(votes)]
    assert krippendorff_alpha(votes)["alpha"] == pytest.approx(np.mean(us), abs=0.01)


def test_people_who_agree_exactly_leave_alpha_without_an_interval() -> None:
    alike = [
        {"participant": f"p{who}", "dataset": "d", "item_a": "x", "item_b": other, "choice": "a"}
        for who in range(9)
        for other in "yz"
    ]
    assert krippendorff_alpha(votes_from_rows(alike)) == {"alpha": 1, "alpha_low": None, "alpha_high": None}


def test_the_interval_of_alpha_holds_it_where_people_differ() -> None:
    found = [krippendorff_alpha(panel(seed)) for seed in range(40)]
    centre = np.mean([row["alpha"] for row in found])
    held = sum(row["alpha_low"] <= centre <= row["alpha_high"] for row in found)  # type: ignore[operator]
    assert held >= 34


@pytest.mark.slow
def test_people_who_differ_in_nothing_disagree_as_often_as_the_level_says() -> None:
    p_values = [heterogeneity(panel(seed, spread=0.0))["p_value"] for seed in range(120)]  # type: ignore[index]
    assert np.mean(np.array(p_values) < 0.05) < 0.11
    assert np.mean(p_values) == pytest.approx(0.5, abs=0.1)


def test_people_with_opinions_disagree_and_form_no_camps() -> None:
    found = [heterogeneity(panel(seed, spread=0.8)) for seed in range(10)]
    assert all(row is not None and row["p_value"] < 0.05 for row in found)
    assert sum(row is not None and row["camps"] is not None for row in found) <= 1


def test_opposite_tastes_are_two_camps_with_the_right_people() -> None:
    found = heterogeneity(camps(1))
    assert found is not None
    assert found["camps"] is not None
    even = {str(person) for person in range(0, 22, 2)}
    assert even in [set(names) for names in found["camps"]["participants"]]
    votes = found["camps"]["votes"]
    assert votes[0][0] / votes[0][1] > 0.5 > votes[1][0] / votes[1][1]


def test_people_who_throw_a_coin_are_no_camp() -> None:
    for seed in range(5):
        votes = simulate_votes(StudyPlan(6, 5, 22), 2 * SCORES, np.random.default_rng(seed))
        clicks = np.random.default_rng(seed).integers(0, 2, len(votes))
        found = heterogeneity(
            replace(votes, choice=np.where(votes.participant < 4, clicks, votes.choice).astype(np.int8))
        )
        assert found is not None
        assert found["camps"] is None


def test_missing_votes_change_hands_too() -> None:
    votes = camps(2)
    votes = votes.where(np.random.default_rng(5).random(len(votes)) < 0.8)
    found = heterogeneity(votes)
    assert found is not None
    assert found["p_value"] == pytest.approx(1 / 200)


@pytest.mark.parametrize(("name", "sizes"), [("two_camps", (11, 11)), ("camps_24", (12, 12))])
def test_two_camps_are_said(real_data: Path, name: str, sizes: tuple[int, int]) -> None:
    analysis = analyse(read_votes(real_data / "foreign" / "verdicts" / f"{name}.csv"))
    (said,) = (row["text"] for row in analysis["findings"] if row["about"] == "disagreement")
    assert said.startswith("People disagree more than their own noise explains")
    assert f"two camps of {sizes[0]} and {sizes[1]} people" in said


@pytest.mark.parametrize("name", ["nodiff", "clear", "null_alike_0"])
def test_people_who_are_alike_are_not_said_to_disagree(real_data: Path, name: str) -> None:
    analysis = analyse(read_votes(real_data / "foreign" / "verdicts" / f"{name}.csv"))
    (said,) = (row["text"] for row in analysis["findings"] if row["about"] == "disagreement")
    assert said.startswith("It is not shown that people disagree")


def test_a_single_person_and_ties_alone_have_no_agreement() -> None:
    votes = panel(1, 2)
    assert disagreement(votes.where(votes.participant == 0)) is None
    tied = disagreement(replace(votes, choice=np.full(len(votes), 2, np.int8)))
    assert tied is not None
    assert tied["alpha"] is None


def test_votes_change_hands_on_their_own_pair_alone() -> None:
    """Two people disagree on a dataset; a third has four votes on another, which are none of theirs."""
    rows = [("x", "d", "a"), ("y", "d", "b"), *(("z", "e", choice) for choice in "abab")]
    columns = ("participant", "dataset", "choice")
    votes = votes_from_rows([dict(zip(columns, row, strict=True), item_a="A", item_b="B") for row in rows])
    found = heterogeneity(votes)
    assert found is not None
    assert found["ratio"] == pytest.approx(1.0)
