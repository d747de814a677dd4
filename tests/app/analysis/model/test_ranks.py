"""Probabilities to be the best, and ranks that tests leave open."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from app.analysis import analyse, votes_from_rows
from app.analysis.model.contrasts import Estimates
from app.analysis.model.ranks import best_probabilities
from tests.app.analysis.test_findings import CLEAR, sentences, votes_by


def estimates(values: list[float], sd: float, n_participants: int | None = None) -> Estimates:
    covariance = sd**2 * np.eye(len(values))
    clustered = None if n_participants is None else covariance
    return Estimates(tuple("abcdef")[: len(values)], np.array(values), covariance, clustered, n_participants, False)


@pytest.mark.slow
def test_the_highest_score_is_the_best_as_often_as_is_said_where_any_spread_is_as_likely() -> None:
    rng, error = np.random.default_rng(1), 0.25
    said, right = [], []
    for _ in range(400):
        truth = rng.uniform(0, 1) * rng.standard_normal(6)
        values = truth + error * rng.standard_normal(6)
        best = best_probabilities(estimates((values - values.mean()).tolist(), error))
        assert best is not None
        said.append(best.max())
        right.append(truth.argmax() == values.argmax())
    assert np.mean(said) == pytest.approx(np.mean(right), abs=0.04)


def test_a_clear_difference_makes_it_sure_and_none_makes_all_as_likely() -> None:
    sure, equal = best_probabilities(estimates([2.0, 0.0, 0.0], 0.1)), best_probabilities(estimates([0.0] * 5, 0.2))
    assert sure is not None
    assert sure[0] > 0.999
    assert equal == pytest.approx(0.2, abs=0.02)
    two = best_probabilities(estimates([0.5, 0.0], 0.3))
    assert two is not None
    assert 0.5 < two[0] < norm.cdf(0.5 / 0.3 / np.sqrt(2))  # without anything known of the spread before


def test_few_people_make_it_less_sure() -> None:
    many, few = (best_probabilities(estimates([0.9, 0.0, 0.0], 0.3, n)) for n in (200, 4))
    assert many is not None
    assert few is not None
    assert many[0] > few[0] > 1 / 3


def test_ranks_count_the_significant_differences() -> None:
    analysis = analyse(votes_from_rows(votes_by(CLEAR | {"fine": 1.8}, 40)))
    rows = [row for row in analysis["scores"] if row["dataset"] == "all"]
    pairs = [row for row in analysis["contrasts"] if row["dataset"] == "all" and row["p_holm"] < 0.05]
    assert pairs
    for row in rows:
        better = sum((pair["item_b"] if pair["difference"] > 0 else pair["item_a"]) == row["item"] for pair in pairs)
        worse = sum((pair["item_a"] if pair["difference"] > 0 else pair["item_b"]) == row["item"] for pair in pairs)
        assert (row["rank_low"], row["rank_high"]) == (1 + better, len(rows) - worse)
    assert sum(row["p_best"] for row in rows) == pytest.approx(1)


def test_the_sentence_names_probable_bests_and_ranks() -> None:
    text = sentences(votes_by(CLEAR, 30))["ranks"]
    assert text.startswith("Probability to have the highest true score, by these votes alone: good (")
    assert text.endswith("Possible ranks, together with at least 95 % confidence: good: 1; fair: 2; bad: 3.")
