"""The rules that name participants, against a slow transcription and cases whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kurtosis

from app.analysis.ratings.outliers import correlations_with_means, screen_observers
from app.analysis.ratings.table import RatingTable
from tests.app.analysis.ratings.rated_tables import rating_table


def slow_counts(table: RatingTable) -> tuple[list[int], list[int]]:
    """P and Q of BT.500, presentation by presentation; no repeated ratings."""
    above, below = [0] * len(table.participants), [0] * len(table.participants)
    for item in range(len(table.items)):
        rows = np.flatnonzero(table.item == item)
        scores = table.rating[rows]
        mean, deviation = scores.mean(), scores.std(ddof=1)
        if deviation == 0:
            continue
        factor = 2 if 2 <= kurtosis(scores, fisher=False) <= 4 else 20**0.5
        for row in rows:
            above[table.person[row]] += int(table.rating[row] >= mean + factor * deviation)
            below[table.person[row]] += int(table.rating[row] <= mean - factor * deviation)
    return above, below


def noisy_panel(rng: np.random.Generator) -> RatingTable:
    """18 participants on 40 items; p16 rates at random, p17 rates 2 higher than everybody."""
    person, item = np.divmod(np.arange(18 * 40), 40)
    quality = rng.uniform(20, 80, 40)
    rating = quality[item] + rng.normal(0, 14, len(item))
    rating[person == 16] = rng.uniform(0, 100, 40)
    rating[person == 17] += 30
    return rating_table(person, item, np.clip(rating, 0, 100), scale=(0.0, 100.0))


@pytest.mark.parametrize("seed", range(5))
def test_counts_are_those_of_the_recommendation_step_by_step(seed: int) -> None:
    table = noisy_panel(np.random.default_rng(seed))
    screening = screen_observers(table)
    assert (screening.above.tolist(), screening.below.tolist()) == slow_counts(table)
    assert screening.above.sum() > 0


def test_who_rates_at_random_is_named_and_who_rates_high_is_not() -> None:
    screening = screen_observers(noisy_panel(np.random.default_rng(0)))
    assert np.flatnonzero(screening.is_outlier).tolist() == [16]
    assert screening.share[17] > 0.05
    assert screening.imbalance[17] == 1.0


def test_an_item_that_all_rate_alike_counts_for_nobody() -> None:
    screening = screen_observers(rating_table([0, 1, 2], [0, 0, 0], [3, 3, 3]))
    assert screening.above.tolist() == screening.below.tolist() == [0, 0, 0]


def test_a_second_rating_belongs_to_a_presentation_of_its_own() -> None:
    people = list(range(12))
    first = [5.0] * 11 + [1.0]
    table = rating_table(people + people, [0] * 24, first + [3.0] * 12)
    alone = rating_table(people, [0] * 12, first)
    assert screen_observers(table).below.tolist() == screen_observers(alone).below.tolist()


def test_correlations_are_with_everybodys_means() -> None:
    table = noisy_panel(np.random.default_rng(0))
    correlations = correlations_with_means(table)
    values = table.rating.reshape(18, 40)
    expected = [np.corrcoef(row, values.mean(axis=0))[0, 1] for row in values]
    assert correlations == pytest.approx(expected)
    assert np.argmin(np.array(correlations, float)) == 16


def test_who_always_gives_the_same_rating_has_no_correlation() -> None:
    table = rating_table([0] * 4 + [1] * 4, [0, 1, 2, 3] * 2, [3, 3, 3, 3, 1, 2, 4, 5])
    assert correlations_with_means(table)[0] is None
