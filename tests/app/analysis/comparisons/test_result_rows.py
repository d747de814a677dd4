"""Rows of separated and of disconnected votes follow the settings, and promise nothing that votes cannot tell."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from app.analysis import AnalysisSettings, VotesTable, votes_from_rows
from app.analysis.comparisons.comparison import compare
from app.analysis.comparisons.result_rows import island_rows, score_rows, tie_model_rows
from app.analysis.reading.votes_table import joined


def votes_on(
    conditions: str, choices: str = "ab", *, best: str = "", people: tuple[str, ...] = ("",) * 8
) -> VotesTable:
    """Every pair of conditions by each person, chosen at random, but that the best one always wins."""
    rng = np.random.default_rng(0)
    rows = [
        {"item_a": a, "item_b": b, "choice": "a" if a == best else {"n": "none"}.get(c := rng.choice([*choices]), c)}
        | ({"participant": name} if name else {})
        for name in people
        for a, b in combinations(conditions, 2)
    ]
    return votes_from_rows(rows)


def test_separated_scores_of_unknown_people_are_relative_to_their_group_too() -> None:
    (comparison,) = compare(votes_on("ABCD", best="A"), AnalysisSettings())
    rows = {row["item"]: row for row in score_rows(comparison)}
    assert (rows["A"]["no_limit"], rows["A"]["ci_high"], rows["A"]["ci_low"]) == ("above", None, None)
    assert {rows[item]["ci_method"] for item in "BCD"} == {"normal on information, relative to the mean of its group"}


def test_groups_that_no_vote_links_have_the_penalty_and_the_margin_of_the_settings() -> None:
    people = tuple("pqrstu")
    first, second = votes_on("ABC", best="A", people=people), votes_on("XYZ", people=people)
    settings = AnalysisSettings(penalty="ridge", equivalence_margin=1.0)
    (comparison,) = compare(joined([first, second]), settings)
    scores, contrasts = island_rows(comparison, settings)
    assert {row["penalty"] for row in scores if row["item"] in "ABC"} == {"ridge 0.1"}
    assert None not in {row["p_equivalent"] for row in contrasts if row["item_a"] == "X"}


def test_ways_of_treating_ties_have_the_penalty_of_the_settings() -> None:
    settings = AnalysisSettings(penalty="ridge")
    (comparison,) = compare(votes_on("ABC", "abn", best="A"), settings)
    alone = {
        ties: next(iter(compare(comparison.votes, AnalysisSettings(ties=ties, penalty="ridge")))).fit.loglik
        for ties in ("half", "drop")
    }
    assert {row["ties"]: row["loglik"] for row in tie_model_rows(comparison, "ridge") if row["ties"] in alone} == alone
