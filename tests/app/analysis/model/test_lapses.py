"""Scores in which careless answers are weighted down, by a lapse rate for each participant."""

from __future__ import annotations

import numpy as np
import pytest

from app.analysis import AnalysisSettings, VotesTable, analyse
from app.analysis.comparisons.comparison import compare
from app.analysis.comparisons.lapse_rows import lapse_tables
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.model.bradley_terry import fit_scores
from app.analysis.model.lapses import Lapses, fit_lapses
from app.analysis.model.likelihood.newton import Search, maximise
from app.analysis.reading.votes_table import NONE

SCORES = np.linspace(-1.6, 1.6, 6)


def votes_with(clickers: int, *, seed: int = 1, spread: float = 0.3, scores: np.ndarray = SCORES) -> VotesTable:
    """Twenty-two people, of whom the last ones click at random."""
    rng = np.random.default_rng(seed)
    votes = simulate_votes(StudyPlan(6, 5, 22, spread=spread), scores, rng)
    at_random = rng.choice(3, len(votes), p=(0.4, 0.4, 0.2)).astype(np.int8)
    choice = np.where(votes.participant >= 22 - clickers, at_random, votes.choice)
    return VotesTable(**{**vars(votes), "choice": choice})


def fitted(votes: VotesTable, ties: str = "davidson") -> Lapses:
    lapses = fit_lapses(fit_scores(votes, ties=ties), votes)
    assert isinstance(lapses, Lapses)
    return lapses


@pytest.mark.parametrize("ties", ["davidson", "rao-kupper", "drop"])
def test_clickers_get_high_rates_and_scores_are_no_longer_shrunk(ties: str) -> None:
    votes = votes_with(4)
    lapses, shrunk = fitted(votes, ties), fit_scores(votes, ties=ties).scores
    assert shrunk is not None
    assert lapses.rates[-4:].min() > 0.7
    assert lapses.rates[:-4].max() < 0.3
    truth = fit_scores(votes.where(votes.participant < 18), ties=ties).scores
    assert np.abs(lapses.scores - truth).max() < 0.15 < np.abs(shrunk - truth).max()


def test_people_who_vote_alike_leave_no_errors_of_scores_with_lapse_rates() -> None:
    votes = simulate_votes(StudyPlan(4, 6, 2, spread=0.3), np.linspace(-0.5, 0.5, 4), np.random.default_rng(1))
    votes = votes.where(votes.participant == 0)
    rows = [(person, row) for person in range(9) for row in range(len(votes))]
    person, row = np.array(rows).T
    names = tuple(f"p{number}" for number in range(9))
    same = VotesTable(**{**vars(votes.where(row)), "participant": person.astype(np.int32), "participants": names})
    tables, _ = lapse_tables(list(compare(same, AnalysisSettings())))
    assert tables["lapse_scores"]
    assert {(row["se"], row["ci_low"], row["ci_high"]) for row in tables["lapse_scores"]} == {(None, None, None)}


def test_of_honest_people_scores_and_errors_hardly_change() -> None:
    votes = votes_with(0)
    lapses, fit = fitted(votes), fit_scores(votes)
    assert fit.scores is not None
    assert fit.participant_covariance is not None
    assert lapses.scores == pytest.approx(fit.scores, abs=0.1)
    assert lapses.errors == pytest.approx(np.sqrt(np.diag(fit.participant_covariance)[:6]), rel=0.25)
    assert lapses.rates.max() < 0.3


def test_the_maximum_is_one_of_the_likelihood_of_all_rates() -> None:
    """No small change of the scores makes the votes likelier, rates being distributed as they were found."""
    votes = votes_with(3, seed=4)
    lapses = fitted(votes, "drop")
    decided = votes.where(votes.choice != NONE)
    rates, people = lapses.rates, decided.participant

    def loglik(scores: np.ndarray) -> float:
        d = scores[decided.item_a] - scores[decided.item_b]
        p = 1 / (1 + np.exp(np.where(decided.choice == 0, -d, d)))
        return float(np.log((1 - rates[people]) * p + rates[people] / 2).sum())

    slopes = [
        loglik(lapses.scores + 1e-4 * (np.arange(6) == item)) - loglik(lapses.scores - 1e-4 * (np.arange(6) == item))
        for item in range(6)
    ]
    assert np.abs(np.array(slopes) / 2e-4).max() < 3  # votes; with rates of their means, not all that are likely
    shrunk = fit_scores(votes, ties="drop").scores
    assert shrunk is not None
    assert loglik(lapses.scores) > loglik(shrunk)


def test_why_there_are_none_is_said() -> None:
    few = votes_with(0)
    assert fit_lapses(fit_scores(few), few.where(few.participant < 3)) == "they need 5 participants or more"
    alone = analyse(few.where(few.participant < 3), AnalysisSettings(lapses=True, by_dataset=False))
    assert "there are no scores with lapse rates: they need 5 participants or more" in alone["warnings"]


def test_two_camps_are_not_taken_for_careless_people() -> None:
    votes = votes_with(0, spread=0.2)
    choice = np.where((votes.participant % 2 == 1) & (votes.choice != NONE), 1 - votes.choice, votes.choice)
    camps = VotesTable(**{**vars(votes), "choice": choice.astype(np.int8)})
    why = fit_lapses(fit_scores(camps), camps)
    assert isinstance(why, str)
    assert "whose opinions differ rather" in why


def test_somebody_without_a_preference_has_no_rate_where_ties_are_dropped() -> None:
    votes = votes_with(0)
    none = np.where(votes.participant == 3, NONE, votes.choice).astype(np.int8)
    settings = AnalysisSettings(ties="drop", by_dataset=False)
    tables, _ = lapse_tables(list(compare(VotesTable(**{**vars(votes), "choice": none}), settings)))
    others = [name for name in votes.participants if name != "3"]
    assert [row["participant"] for row in tables["lapse_rates"]] == others


def test_an_analysis_has_them_where_they_are_asked_for() -> None:
    votes = votes_with(2)
    assert analyse(votes, AnalysisSettings(by_dataset=False))["lapse_scores"] == []
    analysis = analyse(votes, AnalysisSettings(by_dataset=False, lapses=True))
    assert len(analysis["lapse_scores"]) == 6
    rates = {row["participant"]: row["lapse_rate"] for row in analysis["lapse_rates"]}
    (text,) = (row["text"] for row in analysis["findings"] if row["about"] == "lapses")
    high = sorted(name for name, rate in rates.items() if rate >= 0.2)
    assert {"20", "21"} <= set(high)
    assert all(f"{name} (" in text for name in high)
    best = max(analysis["lapse_scores"], key=lambda row: row["score"])
    assert f"the highest score is that of {best['item']}," in text


def test_tables_that_start_at_their_maximum_among_others_are_found_to_be_there() -> None:
    """Steps of the size of rounding errors seem to overshoot; halving them over and over is no search."""
    fit = fit_scores(votes_with(2))
    noise = 1 + 1e-3 * np.random.default_rng(1).standard_normal((20, len(fit.counts.wins)))
    table = [part * noise for part in (fit.counts.wins, fit.counts.losses, fit.counts.ties)]
    start = maximise(fit.design, *table, search=Search(tolerance=1e-12)).theta
    start[::3] = start[1::3] = 0
    again = maximise(fit.design, *table, start=start, search=Search(tolerance=1e-5))
    assert again.converged.all()
    assert again.iterations < 10
