"""The report's sentences on ratings."""

from __future__ import annotations

import numpy as np

from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.report.rating_sections import rating_sections
from tests.app.analysis.ratings.rated_tables import simulated


def test_beside_two_intervals_it_is_said_for_whose_ratings_each_holds() -> None:
    table, _ = simulated(np.random.default_rng(2), 30, 6)
    opinions, *_ = rating_sections(analyse_ratings(table), {})
    (text,) = opinions["paragraphs"]
    assert "The quality's interval holds for ratings by these participants, that of the MOS for other people's" in text
