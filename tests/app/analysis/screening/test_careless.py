"""Careless people are named, honest ones are not, and failed checks reach everything that speaks of a participant."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.analysis import analyse, read_votes
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.reading.votes_table import VotesTable
from app.analysis.report.page import report_page
from app.analysis.report.write import table_csv
from app.analysis.screening.attention_checks import check_rows
from app.analysis.screening.careless import FALSE_ALARMS, Careless, careless_answers, false_alarms

SCORES = np.linspace(1.6, -1.6, 6)


def panel(seed: int, scores: Any = SCORES, **plan: Any) -> VotesTable:
    return simulate_votes(StudyPlan(6, 5, 22, **plan), np.asarray(scores), np.random.default_rng(seed))


def with_clicker(votes: VotesTable, seed: int) -> VotesTable:
    """The last participant throws a coin."""
    clicks = np.random.default_rng(seed).integers(0, 2, len(votes))
    return replace(votes, choice=np.where(votes.participant == 21, clicks, votes.choice).astype(np.int8))


def named(votes: VotesTable) -> set[str]:
    return {name for name, verdict in careless_answers(votes.used(), check_rows(votes)).items() if verdict.is_named}


def test_a_random_clicker_is_named_and_nobody_else() -> None:
    assert [named(with_clicker(panel(seed), seed)) for seed in range(5)] == [{"21"}] * 5


@pytest.mark.parametrize("scores", [SCORES, 0 * SCORES])
@pytest.mark.parametrize("spread", [0.0, 0.4, 1.0])
def test_honest_people_are_named_in_hardly_any_study(scores: Any, spread: float) -> None:
    """In one of twenty at most; two of six would be the thirtieth of such chances."""
    assert sum(bool(named(panel(seed, scores, spread=spread))) for seed in range(6)) <= 1


def test_who_stands_out_is_no_honest_person_when_the_next_is_judged() -> None:
    chance = np.array([0.02, 1e-6, 0.9, 0.001])
    assert false_alarms(chance) == pytest.approx([0.04, 4e-6, 0.9, 0.003])


def test_votes_say_nothing_where_nothing_differs() -> None:
    found = careless_answers(with_clicker(panel(1, 0 * SCORES, spread=0.0), 1), [])
    assert max(abs(verdict.parts["votes"]) for verdict in found.values()) < 4
    assert not any(verdict.is_named for verdict in found.values())


def test_the_chance_of_an_honest_person_is_never_above_the_inverse_ratio() -> None:
    """Markov's inequality: of honest people, at most one in e^x reaches a log likelihood ratio of x."""
    for verdict in careless_answers(with_clicker(panel(2), 2), []).values():
        assert verdict.false_alarms <= 1.14 * 22 * min(1.0, np.exp(-verdict.log_ratio)) + 1e-12  # 1 + (8 / 22)^2
        assert verdict.is_named == (verdict.log_ratio > 0 and verdict.false_alarms < FALSE_ALARMS)


def test_three_votes_of_each_of_a_few_people_name_nobody() -> None:
    studies = (simulate_votes(StudyPlan(3, 1, 8), np.zeros(3), np.random.default_rng(seed)) for seed in range(20))
    assert [named(votes) for votes in studies] == [set()] * 20


def test_with_fewer_than_five_people_nobody_is_judged() -> None:
    votes = panel(1)
    assert careless_answers(votes.where(votes.participant < 4), []) == {}


def test_failing_every_check_reaches_flag_sentence_table_and_page(real_data: Path) -> None:
    votes = read_votes(real_data / "foreign" / "verdicts" / "failed_checks.csv")
    analysis = analyse(votes)
    flagged = {row["participant"]: row["flags"] for row in analysis["observers"] if row["flags"]}
    assert flagged == {"P003": ["answers carelessly"]}
    said = {row["about"]: row["text"] for row in analysis["findings"]}
    assert said["participants"].startswith("Participant P003 (answers carelessly) stands out")
    assert "5 of 5 identical pairs told apart" in said["participants"]
    assert "most by P003 (10 of 10)" in said["checks"]
    assert "5 of 5 identical pairs told apart" in table_csv(analysis["observers"], ("participant", "flags"))
    assert "5 of 5 identical pairs told apart" in report_page("report.md", analysis, [], "votes")


@pytest.mark.parametrize("name", ["nodiff", "clear", "null_alike_0", "two_camps", "camps_24", "order_effect"])
def test_honest_people_of_these_studies_do_not_stand_out(real_data: Path, name: str) -> None:
    analysis = analyse(read_votes(real_data / "foreign" / "verdicts" / f"{name}.csv"))
    (said,) = (row["text"] for row in analysis["findings"] if row["about"] == "participants")
    assert said.startswith(f"Nobody of {analysis['votes']['participants']} stands out.")


def test_a_verdict_is_named_only_below_the_limit() -> None:
    verdict = Careless(8.0, {"votes": 8.0}, 0.04, ())
    assert verdict.is_named
    assert not replace(verdict, false_alarms=0.06).is_named
    assert not replace(verdict, log_ratio=-1.0).is_named
