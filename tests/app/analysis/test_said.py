"""Sentences are held against what is true of generated votes: the checker knows the truth, not the text.

Each kind of study has a truth: which conditions differ and how, whether people or datasets differ, who clicks at
random. A claim is read out of the sentence's `about` and the names and numbers in it, and must follow from the votes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from app.analysis import AnalysisSettings, analyse
from app.analysis.reading.votes_table import ALL, IDENTICAL, VotesTable, joined, votes_from_indices
from app.analysis.warnings import measure_warnings

ITEMS = ("id+fa", "id+fb", "dr+fa", "dr+fb", "pm+fa", "pm+fb")
FACTORS = {"depth": {item: item[:2] for item in ITEMS}, "fusion": {item: item[3:] for item in ITEMS}}


@dataclass(frozen=True)
class Truth:
    """What a kind of study is made of: true scores (log-odds), and what shifts them."""

    scores: tuple[float, ...] = (0.0,) * 6
    people: int = 22
    datasets: int = 5
    spread: float = 0.3
    scene_spread: float = 0.0
    camps: bool = False
    clicker: bool = False
    order: float = 0.0
    tie: float = 0.2
    missing: float = 0.0
    fails_checks: bool = False


CLEAR = (1.5, 0.9, 0.3, -0.3, -0.9, -1.5)
DEPTH = (0.8, 0.8, 0.0, 0.0, -0.8, -0.8)
CROSSED = (1.0, -1.0, 0.0, 0.0, -1.0, 1.0)
KINDS = {
    "no difference": Truth(),
    "no difference, identical people": Truth(spread=0.0),
    "no difference, people who differ": Truth(spread=1.0),
    "no difference, datasets that differ": Truth(scene_spread=0.5),
    "no difference, few people": Truth(people=8),
    "no difference, no ties": Truth(tie=0.0),
    "no difference, half of the votes": Truth(missing=0.5),
    "clear": Truth(CLEAR),
    "clear, people who differ": Truth(CLEAR, spread=1.0),
    "clear, datasets that differ": Truth(CLEAR, scene_spread=0.4),
    "clear, few people": Truth(CLEAR, people=8),
    "clear, one dataset": Truth(CLEAR, datasets=1),
    "clear, votes missing": Truth(CLEAR, missing=0.3),
    "clear, a clicker": Truth(CLEAR, clicker=True),
    "clear, checks failed": Truth(CLEAR, fails_checks=True),
    "depth alone": Truth(DEPTH),
    "depth alone, datasets that differ": Truth(DEPTH, scene_spread=0.3),
    "crossed factors": Truth(CROSSED),
    "two camps": Truth(CLEAR, camps=True),
    "an order effect": Truth(order=1.0),
    "an order effect and scores": Truth(DEPTH, order=0.8),
}


SEED = 200  # the studies' seeds follow it; how often tests err by chance stands in docs/simulation.md


def votes_of(truth: Truth, seed: int = SEED) -> VotesTable:
    rng = np.random.default_rng(seed)
    n = len(ITEMS)
    low, high = np.triu_indices(n, 1)
    who, dataset, pair = (part.ravel() for part in np.indices((truth.people, truth.datasets, len(low))))
    kept = rng.random(len(who)) >= truth.missing
    who, dataset, pair = who[kept], dataset[kept], pair[kept]
    sides = rng.random(len(who)) < 0.5
    a, b = np.where(sides, high[pair], low[pair]), np.where(sides, low[pair], high[pair])
    sign = np.where(truth.camps & (np.arange(truth.people) % 2 == 1), -1, 1)[:, None, None]
    scores = sign * (np.array(truth.scores) + truth.scene_spread * rng.standard_normal((1, truth.datasets, n)))
    scores = scores + truth.spread * rng.standard_normal((truth.people, 1, n))
    first = rng.integers(0, 2, len(who))
    d = scores[who, dataset, a] - scores[who, dataset, b] + truth.order * np.where(first == 0, 1, -1)
    if truth.clicker:
        d = np.where(who == 0, 0.0, d)
    weights = np.stack([np.exp(d / 2), np.exp(-d / 2), np.full(len(d), 2 * truth.tie / (1 - truth.tie))])
    drawn = rng.random(len(d)) * weights.sum(axis=0)
    choice = (drawn > weights[0]).astype(np.int8) + (drawn > weights[0] + weights[1])
    people = tuple(f"P{person:03d}" for person in range(truth.people))
    names = people, tuple(f"d{number}" for number in range(truth.datasets)), ITEMS
    votes = votes_from_indices(who, dataset, a, b, choice, names=names, first_shown=first)
    if not truth.fails_checks:
        return votes
    person = np.arange(truth.people).repeat(6)
    item = rng.integers(0, n, len(person))
    answers = np.where(person == 0, 0, 2)
    checks = votes_from_indices(person, 0 * person, item, item, answers, names=names, first_shown=0 * person)
    return joined([votes, replace(checks, role=np.full(len(person), IDENTICAL, np.int8))])


def said(analysis: Mapping[str, Any], about: str) -> str:
    return " ".join(row["text"] for row in analysis["findings"] if row["about"] == about)


class Analysed(dict[str, tuple[VotesTable, dict[str, Any]]]):
    """Votes of each kind and their analysis, made when they are asked for."""

    def __missing__(self, kind: str) -> tuple[VotesTable, dict[str, Any]]:
        votes = votes_of(KINDS[kind], SEED + list(KINDS).index(kind))
        self[kind] = votes, analyse(votes, AnalysisSettings(factors=FACTORS))
        return self[kind]


@pytest.fixture(scope="module")
def analyses() -> Analysed:
    return Analysed()


QUICK = {"no difference", "clear, a clicker", "depth alone", "crossed factors", "two camps", "an order effect"}
every_kind = pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=() if kind in QUICK else pytest.mark.slow) for kind in KINDS]
)


@pytest.fixture(scope="module")
def of_one_person() -> dict[str, Any]:
    votes = votes_of(Truth(CLEAR))
    return analyse(votes.where(votes.participant == 0), AnalysisSettings(factors=FACTORS))


@pytest.fixture(scope="module")
def of_ties() -> dict[str, Any]:
    votes = votes_of(Truth(CLEAR))
    return analyse(replace(votes, choice=np.full(len(votes), 2, np.int8)))


@pytest.mark.slow
@every_kind
def test_best_and_worst_are_said_only_of_what_is_best_and_worst(kind: str, analyses: Analysed) -> None:
    truth, (_, analysis) = KINDS[kind], analyses[kind]
    for place, is_it in (("best", max(truth.scores)), ("worst", min(truth.scores))):
        claim = re.match(rf"(\S+) is {place}:", said(analysis, place))
        if claim:
            assert truth.scores[ITEMS.index(claim[1])] == is_it
            assert truth.scores.count(is_it) == 1
            assert not truth.camps


@every_kind
def test_counts_are_counts_of_the_votes(kind: str, analyses: Analysed) -> None:
    votes, analysis = analyses[kind]
    used = votes.used()
    claims = re.findall(
        r"(\S+) and (\S+), (\S+) is preferred in (\d+) of (\d+) decided votes", said(analysis, "difference")
    )
    for first, second, better, n_for, n in claims:
        assert better == first
        codes = ITEMS.index(first), ITEMS.index(second)
        of_pair = np.isin(used.item_a, codes) & np.isin(used.item_b, codes) & (used.choice < 2)
        chosen = np.where(used.choice == 0, used.item_a, used.item_b)[of_pair]
        assert (int(n_for), int(n)) == (int((chosen == codes[0]).sum()), len(chosen))


@every_kind
def test_a_pair_is_said_to_differ_only_if_it_does_on_these_datasets(kind: str, analyses: Analysed) -> None:
    truth, (_, analysis) = KINDS[kind], analyses[kind]
    if "no difference" in kind and not truth.scene_spread:
        assert said(analysis, "difference") == ""
        assert said(analysis, "told apart").startswith("The answers do not tell any")
    if "no difference" in kind or truth.camps:
        assert " 0 of 15 pairs differ" in said(analysis, "told apart") or truth.datasets < 3


@every_kind
def test_an_effect_of_a_factor_is_said_only_where_there_is_one(kind: str, analyses: Analysed) -> None:
    truth, (_, analysis) = KINDS[kind], analyses[kind]
    scores = np.array(truth.scores).reshape(3, 2)
    reach = {"depth": np.ptp(scores.mean(axis=1)), "fusion": np.ptp(scores.mean(axis=0))}
    text = said(analysis, "factors")
    for factor, size in reach.items():
        if f"An effect of {factor} is shown" in text:
            assert size > 0
            assert not truth.camps
        if size > 1 and not truth.camps and "do not simply add up" not in text:
            assert f"An effect of {factor} is shown" in text
    if "do not simply add up" in text:
        assert "An effect of" not in text  # no main effect stands before an interaction
    assert ("do not simply add up" in text) or kind != "crossed factors"
    assert not re.search(r"matters|farthest|best", text)
    for sentence in (row["text"] for row in analysis["findings"] if row["about"] == "factors"):
        assert re.search(r"on this dataset|on these \d datasets|for datasets like these", sentence)


@every_kind
def test_only_who_is_careless_stands_out(kind: str, analyses: Analysed) -> None:
    truth, (_, analysis) = KINDS[kind], analyses[kind]
    flagged = {row["participant"] for row in analysis["observers"] if row["flags"]}
    assert flagged <= ({"P000"} if truth.clicker or truth.fails_checks else set())
    assert flagged or not truth.fails_checks  # votes alone do not always tell a clicker
    assert all(name in said(analysis, "participants") for name in flagged)


@every_kind
def test_an_order_effect_is_said_where_there_is_one(kind: str, analyses: Analysed) -> None:
    truth, (_, analysis) = KINDS[kind], analyses[kind]
    assert ("Being shown first helps" in said(analysis, "order")) == (truth.order > 0)


@every_kind
def test_disagreement_and_camps_are_said_where_they_are(kind: str, analyses: Analysed) -> None:
    truth, (_, analysis) = KINDS[kind], analyses[kind]
    text = said(analysis, "disagreement")
    if truth.camps or truth.spread >= 1:
        assert text.startswith("People disagree more than their own noise explains")
    if kind == "no difference, identical people":
        assert text.startswith("It is not shown that people disagree")
    assert ("two camps of" in text) == truth.camps


@every_kind
def test_the_simultaneous_interval_is_around_the_difference_and_wider(kind: str, analyses: Analysed) -> None:
    _, analysis = analyses[kind]
    whole = [row for row in analysis["contrasts"] if row["comparison"] == row["dataset"] == "all"]
    for row in whole:
        assert row["ci_simultaneous_low"] < row["ci_low"] < row["difference"]
        assert row["difference"] < row["ci_high"] < row["ci_simultaneous_high"]
        assert row["p_datasets"] is None or row["p_datasets"] >= row["p_value"]


@every_kind
def test_the_ranks_that_are_left_open_hold_the_true_ones(kind: str, analyses: Analysed) -> None:
    truth, (_, analysis) = KINDS[kind], analyses[kind]
    rows = [row for row in analysis["scores"] if row["comparison"] == row["dataset"] == "all"]
    assert sum(row["p_best"] for row in rows) == pytest.approx(1)
    if truth.camps or truth.scene_spread:
        return  # no score holds for everybody; these datasets have scores of their own
    for row in rows:
        own = truth.scores[ITEMS.index(row["item"])]
        first, last = 1 + sum(score > own for score in truth.scores), sum(score >= own for score in truth.scores)
        assert row["rank_low"] <= last
        assert row["rank_high"] >= first
    assert ("Possible ranks" in said(analysis, "ranks")) == (len({row["rank_low"] for row in rows}) > 1)


@pytest.mark.slow
def test_every_sentence_that_is_checked_is_said_of_some_kind(analyses: Analysed) -> None:
    texts = " ".join(row["text"] for kind in KINDS for row in analyses[kind][1]["findings"])
    for claim in (
        *(" is best:", " is worst:", "is preferred in", "pairs differ", "An effect of depth is shown"),
        *("do not simply add up", "Being shown first helps", "two camps of", "likelier from somebody who answers"),
        *("It is not shown that people disagree", "Possible ranks", "The answers do not tell any"),
    ):
        assert claim in texts, claim


@pytest.mark.slow
def test_of_random_measures_none_is_said_to_go_with_the_scores() -> None:
    rng = np.random.default_rng(3)
    measures = {
        f"m{number}": {f"d{k}": dict(zip(ITEMS, rng.random(6).tolist(), strict=True)) for k in range(5)}
        for number in range(12)
    }
    analysis = analyse(votes_of(Truth(CLEAR)), AnalysisSettings(measures=measures))
    assert said(analysis, "measures").startswith("It is not shown that any of the 12 objective measures")


@pytest.mark.slow
def test_a_share_of_people_is_not_said_where_nothing_differs() -> None:
    for spread in (0.0, 0.4):
        analysis = analyse(votes_of(Truth(spread=spread)), AnalysisSettings(random_effects="participants"))
        assert "of people" not in said(analysis, "random effects")
    analysis = analyse(votes_of(Truth(CLEAR)), AnalysisSettings(random_effects="participants"))
    claim = re.search(r"that (\d+|more than 99) % of people \(95 % interval", said(analysis, "random effects"))
    assert claim


@pytest.mark.slow
def test_results_before_the_planned_number_are_interim() -> None:
    votes = votes_of(Truth(CLEAR, people=11))
    early = analyse(votes, AnalysisSettings(planned_participants=22))
    assert said(early, "interim").startswith("Interim: 11 of 22 planned participants. Do not conclude")
    assert "p below 0.006 counts" in said(early, "interim")
    assert not said(analyse(votes, AnalysisSettings(planned_participants=11)), "interim")
    assert not said(analyse(votes), "interim")


def test_adaptive_pairs_are_named_with_what_they_do_to_intervals() -> None:
    votes = votes_of(Truth(CLEAR, datasets=1))
    assert "Pairs were chosen from the votes so far" in said(
        analyse(votes, AnalysisSettings(adaptive_pairs=True)), "limits"
    )
    assert "Pairs were chosen" not in said(analyse(votes), "limits")


def test_groups_that_no_vote_links_have_scores_and_pairs_of_their_own() -> None:
    votes = votes_of(Truth(CLEAR, datasets=2))
    inside = (votes.item_a < 3) == (votes.item_b < 3)
    analysis = analyse(votes.where(inside))
    whole = [row for row in analysis["island_scores"] if row["comparison"] == row["dataset"] == "all"]
    assert sorted(row["item"] for row in whole) == sorted(ITEMS)
    for group in (1, 2):
        scores = [row["score"] for row in whole if row["group"] == group]
        assert sum(scores) == pytest.approx(0, abs=1e-9)
    pairs = [row for row in analysis["island_contrasts"] if row["comparison"] == row["dataset"] == "all"]
    assert len(pairs) == 6
    assert said(analysis, "ranking").count("Within {") == 2


@pytest.mark.slow
def test_a_single_participant_is_warned_of_once(of_one_person: dict[str, Any]) -> None:
    assert sum("single participant" in warning for warning in of_one_person["warnings"]) == 1


def all_of(analysis: Mapping[str, Any]) -> str:
    return " ".join([*(row["text"] for row in analysis["findings"]), *analysis["warnings"]])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["of_one_person", "of_ties"])
def test_a_single_participant_or_only_ties_have_no_sentence_on_intervals_or_on_ranks(
    kind: str, request: pytest.FixtureRequest
) -> None:
    said_of_them = all_of(request.getfixturevalue(kind))
    assert not re.search(r"Intervals over all datasets|Probability to have the highest", said_of_them)


@pytest.mark.slow
def test_who_is_the_best_is_no_probability_where_too_few_people_voted() -> None:
    votes = votes_of(Truth(people=2))
    assert "Probability to have the highest" not in all_of(analyse(votes))


def test_two_conditions_have_no_circular_triads() -> None:
    votes = votes_of(Truth(CLEAR))
    two = votes.where((votes.item_a < 2) & (votes.item_b < 2))
    assert "circular" not in all_of(analyse(two.with_items(np.arange(len(votes.items)) < 2)))


@pytest.mark.slow
def test_what_holds_of_many_fits_is_one_warning(of_ties: dict[str, Any]) -> None:
    assert sum("tie parameter grows" in text for text in of_ties["warnings"]) == 1


def test_effects_of_order_and_measures_carry_their_intervals_and_scope() -> None:
    values = {f"d{k}": dict(zip(ITEMS, CLEAR, strict=True)) for k in range(5)}
    analysis = analyse(votes_of(Truth(CLEAR, order=0.8)), AnalysisSettings(measures={"m": values}))
    assert re.search(r"log-odds, 95 % interval \+\d\.\d\d to \+\d\.\d\d", said(analysis, "order"))
    assert re.search(r"rank correlation \S+ \(95 % interval \S+ to \S+\)", said(analysis, "measures"))
    assert "on these 5 datasets" in said(analysis, "measures")


def test_interim_is_said_before_any_result() -> None:
    analysis = analyse(votes_of(Truth(CLEAR, people=11)), AnalysisSettings(planned_participants=40))
    assert analysis["findings"][0]["about"] == "interim"


@pytest.mark.slow
def test_a_predicted_share_of_a_factor_is_not_said_without_an_interval() -> None:
    text = said(analyse(votes_of(Truth(DEPTH)), AnalysisSettings(factors=FACTORS)), "factors")
    assert "decided votes" in text
    assert "%" not in text.replace("95 %", "")


def test_nobody_is_said_to_be_found_out_where_nobody_could_be_judged(of_one_person: dict[str, Any]) -> None:
    assert "attention checks" not in said(of_one_person, "participants")
    two = votes_of(Truth(CLEAR, datasets=1))
    few = said(analyse(two.where((two.item_a < 2) & (two.item_b < 2))), "participants")
    assert "Nobody is judged by what their votes prefer" in few
    assert "JOD" not in few
    unlinked = said(analyse(two.where((two.item_a < 2) == (two.item_b < 2))), "participants")
    assert "and conditions that all have scores, 60 of them at most" in unlinked


def test_fewer_votes_than_those_of_the_simulation_are_named() -> None:
    for n_datasets, is_named in ((2, True), (5, False)):
        text = said(analyse(votes_of(Truth(datasets=n_datasets))), "participants")
        assert ("fewer of those who, as here, give 30" in text) is is_named


def test_the_best_and_the_worst_without_a_vote_between_them_are_said_to_have_none() -> None:
    votes = votes_of(Truth(CLEAR, people=30))
    ends = (np.minimum(votes.item_a, votes.item_b) == 0) & (np.maximum(votes.item_a, votes.item_b) == 5)
    text = said(analyse(votes.where(~ends)), "difference")
    assert text.startswith("No vote compares id+fa and pm+fb; for id+fa the model predicts")


def test_the_number_of_people_says_how_much_adaptive_pairs_cost() -> None:
    for people, share in ((22, "9 % of studies"), (64, "6 % of studies")):
        votes = votes_of(Truth(people=people, datasets=1))
        assert share in said(analyse(votes, AnalysisSettings(adaptive_pairs=True)), "limits")


@pytest.mark.slow
def test_what_simulations_find_cautious_or_bold_is_said_where_it_is_printed(analyses: Analysed) -> None:
    _, few = analyses["no difference, few people"]
    assert "2 to 5 % of studies without one" in said(few, "limits")
    assert "10 points too high" in said(few, "ranks")
    assert "cautious where conditions hardly differ" in said(few, "agreement")
    assert "a cautious test with few datasets" in said(few, "told apart")
    _, clear = analyses["clear, a clicker"]
    assert "cautious for one" in said(clear, "difference")
    for about in ("limits", "ranks", "agreement"):
        assert "5 % of studies" not in said(clear, about)
        assert "points too high" not in said(clear, about)
        assert "hardly differ" not in said(clear, about)


@pytest.mark.slow
def test_intervals_with_lapse_rates_are_said_to_be_narrow_where_people_lie_far_apart() -> None:
    for spread, is_said in ((0.3, False), (1.2, True)):
        analysis = analyse(votes_of(Truth(CLEAR, spread=spread)), AnalysisSettings(lapses=True))
        assert ("these intervals may be too narrow" in said(analysis, "lapses")) is is_said


@pytest.mark.parametrize(
    ("datasets", "said"),
    [
        (("",), "measures: with 5"),
        ((ALL,), "measures: with 5"),
        (("x", ALL), "measures, dataset x: with 5"),
        (("x",), "measures, dataset x: with 5"),
    ],
)
def test_measures_of_no_named_dataset_are_not_said_to_be_of_one(datasets: Sequence[str], said: str) -> None:
    rows = [{"dataset": dataset, "n_conditions": 5, "p_smallest": 0.0083} for dataset in datasets]
    (warning,) = measure_warnings(rows)
    assert warning.startswith(said)
