"""Scores with random effects against long Markov chains, and what is said where they cannot be fitted."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.analysis import AnalysisSettings, VotesTable, analyse, votes_from_rows
from app.analysis.comparisons.comparison import compare
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.random_effect_rows import random_effect_tables
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.random_effects import fit_random_effects, mixture_interval
from app.analysis.reading.votes_table import votes_from_indices
from tests.app.analysis.model.random_effects_chain import DATASETS, ITEMS, PEOPLE

CHAIN = json.loads((Path(__file__).parent / "random_effects_chain.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def votes() -> VotesTable:
    columns = np.array(CHAIN["votes"]).T
    names = [list(map(str, range(size))) for size in (PEOPLE, DATASETS, ITEMS)]
    return votes_from_indices(*columns, names=(names[0], names[1], names[2]))


@pytest.mark.slow
def test_scores_and_spreads_are_those_of_long_markov_chains(votes: VotesTable) -> None:
    assert CHAIN["r_hat"] < 1.001
    posterior = fit_random_effects(fit_scores(votes), votes, ["participants", "datasets"])
    assert not isinstance(posterior, str)
    means, sds = posterior.along(np.eye(ITEMS))
    low, high = mixture_interval(posterior.weights, means, sds)
    mean = posterior.weights @ means
    for item in range(ITEMS):
        known = CHAIN["posterior"][str(item)]
        assert mean[item] == pytest.approx(known["mean"], abs=0.005)
        assert (low[item], high[item]) == pytest.approx((known["low"], known["high"]), abs=0.025)  # of a width of 1.05
    for level in posterior.levels:
        median, *ends = posterior.spread(level)
        known = CHAIN["posterior"][level]
        assert median == pytest.approx(known["median"], rel=0.04)
        assert ends == pytest.approx([known["low"], known["high"]], rel=0.35)  # of a skewed tail


@pytest.mark.slow
def test_people_who_do_not_differ_have_the_scores_without_random_effects() -> None:
    votes = simulate_votes(StudyPlan(5, 3, 40, spread=0), np.linspace(-0.7, 0.7, 5), np.random.default_rng(2))
    analysis = analyse(votes, AnalysisSettings(random_effects="participants"))
    plain = {row["item"]: row["score"] for row in analysis["scores"] if row["dataset"] == "all"}
    for row in analysis["random_effects_scores"]:
        assert row["score"] == pytest.approx(plain[row["item"]], abs=0.03)
    assert {row["level"]: row["sd"] for row in analysis["random_effects"]}["participants"] < 0.15


@pytest.mark.parametrize(("people", "why"), [(1, "1 participant cannot tell"), (2, "2 participants cannot tell")])
def test_too_few_people_are_said_in_their_number(people: int, why: str) -> None:
    row = {"dataset": "d", "item_a": "x", "item_b": "y"}
    votes = [row | {"participant": f"P{person}", "choice": choice} for person in range(people) for choice in "ab"]
    warnings = analyse(votes_from_rows(votes), AnalysisSettings(random_effects="participants"))["warnings"]
    assert any(why in text for text in warnings)


@pytest.mark.slow
def test_sentences_say_for_whom_intervals_hold(votes: VotesTable) -> None:
    def sentences(random_effects: str) -> list[str]:
        findings = analyse(votes, AnalysisSettings(random_effects=random_effects))["findings"]
        return [row["text"] for row in findings if row["about"] == "random effects"]

    assert [text.split(".")[0] for text in sentences("")] == ["Intervals over all datasets hold for these 4 datasets"]
    only_these, people, _ = sentences("participants")
    assert "hold for these 4 datasets" in only_these
    assert "for other people: 4 has the highest" in people
    everything, _ = sentences("participants,datasets")
    assert "for other people and other datasets like these: 4 has the highest" in everything


def test_a_share_of_people_and_a_difference_turn_with_their_pair(votes: VotesTable) -> None:
    analysis = analyse(votes, AnalysisSettings(random_effects="participants"))
    row = next(r for r in analysis["random_effects_contrasts"] if (r["item_a"], r["item_b"]) == ("0", "4"))
    assert row["difference"] < 0 < 0.5 - row["people_preferring"]
    assert row["ci_high"] < 0
    assert row["p_value"] < row["p_holm"] < 0.05
    last = next(r for r in analysis["random_effects_scores"] if r["item"] == "4")
    first = next(r for r in analysis["random_effects_scores"] if r["item"] == "0")
    assert row["difference"] == pytest.approx(first["score"] - last["score"])


def without_names(votes: VotesTable) -> VotesTable:
    return replace(votes, participants=("",), participant=np.zeros_like(votes.participant))


@pytest.mark.parametrize(
    ("change", "settings", "why"),
    [
        (lambda votes: votes.where(votes.participant < 2), {}, "2 participants cannot tell"),
        (lambda votes: votes.where(votes.dataset < 2), {}, "2 datasets cannot tell"),
        (without_names, {}, "the participants are not recorded"),
        (lambda votes: votes, {"ties": "rao-kupper"}, "use davidson, half or drop"),
        (lambda votes: votes.where((votes.item_a != 4) & (votes.item_b != 4) | (votes.choice == 1)), {}, "no finite"),
    ],
)
def test_why_there_are_no_random_effects_is_said(
    votes: VotesTable, change: Callable[[VotesTable], VotesTable], settings: dict[str, str], why: str
) -> None:
    compared = list(compare(change(votes), AnalysisSettings(**settings)))
    tables, (warning,) = random_effect_tables(compared, "participants,datasets")
    assert not any(tables.values())
    assert "no fit with random effects" in warning
    assert why in warning


def test_five_votes_of_people_who_contradict_each_other_end_in_a_sentence() -> None:
    """The more they are let differ, the better it fits: the search for a spread leads away without end."""
    told = ("p0 x z none z", "p1 x y a y", "p1 x z a z", "p2 x y b x", "p2 x z b z")
    names = ("participant", "item_a", "item_b", "choice", "first_shown")
    votes = votes_from_rows(dict(zip(names, row.split(), strict=True)) for row in told)
    compared = list(compare(votes, AnalysisSettings(ties="drop", order_effect=True)))
    tables, (warning,) = random_effect_tables(compared, "participants")
    assert not any(tables.values())
    assert warning.endswith("so few votes do not tell how much participants differ")


def test_an_unknown_kind_of_random_effect_is_refused() -> None:
    with pytest.raises(ValueError, match="'scenes', expected participants or participants,datasets"):
        AnalysisSettings(random_effects="scenes")
