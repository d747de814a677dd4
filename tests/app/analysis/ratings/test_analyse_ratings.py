"""The analysis of ratings as a whole: what it warns of, and that it survives tables with next to nothing in them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from app.analysis.findings.ratings import rating_findings
from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.ratings.table import ComparisonTable, RatingTable
from tests.app.analysis.ratings.rated_tables import known_table, rating_table, simulated


def warnings_of(table: RatingTable) -> str:
    return " ".join(row["warning"] for row in analyse_ratings(table)["rating_warnings"])


@pytest.mark.parametrize(
    "table",
    [
        rating_table([0], [0], [3]),
        rating_table([0, 0, 0], [0, 1, 2], [1, 2, 3]),
        rating_table([0, 1, 2], [0, 0, 0], [3, 3, 3]),
        rating_table([0, 0, 0, 1, 1, 1], [0, 1, 2] * 2, [1, 2, 5] * 2),
        rating_table([0, 0, 0, 1, 1, 1], [0] * 6, [1, 2, 5, 3, 3, 4]),
        rating_table([0, 0, 0, 1, 1, 1], [0] * 6, [3, 3, 3, 4, 4, 4]),
        rating_table([0], [0], [3]).without(["p0"]),
    ],
    ids=["one rating", "one participant", "one item", "all agree", "one item often", "one item alike", "nobody"],
)
def test_tables_with_next_to_nothing_have_numbers_or_none(table: RatingTable) -> None:
    tables = analyse_ratings(table)
    json.dumps(tables, allow_nan=False)
    assert len(tables["rating_items"]) == len(table.items)
    assert [row["participant"] for row in tables["raters"]] == list(table.participants)


def test_a_difference_on_which_all_agree_rests_on_a_sign_test_and_has_no_interval() -> None:
    person, item = np.divmod(np.arange(24), 2)
    tables = analyse_ratings(rating_table(person, item, np.array([5.0, 3.0])[item]))
    (pair,) = tables["rating_contrasts"]
    assert (pair["difference"], pair["p_value"], pair["method"]) == (2, 2 / 2**12, "sign test over participants")
    assert (pair["se"], pair["ci_low"], pair["ci_high"]) == (None, None, None)
    said = {row["about"]: row["text"] for row in rating_findings(tables)}
    assert said["difference"] == (
        "Participants rate c0 2.00 grades above c1 (no interval, as all agree), p < 0.001 (sign test over "
        "participants, Holm)."
    )


def test_ratings_on_which_all_agree_exactly_have_no_interval_and_that_is_said() -> None:
    person, item = np.divmod(np.arange(36), 3)
    for ratings in ([5.0, 3.0, 3.0], [4.1, 1.7, 2.9]):
        table = rating_table(person, item, np.array(ratings)[item], protocol="acr-hr", references=(1,))
        tables = analyse_ratings(table)
        for row in (*tables["rating_items"], *tables["rating_conditions"]):
            assert row["mos"] == pytest.approx(row["quality"])
            limits = ("ci_low", "ci_high", "dmos_low", "dmos_high", "quality_se", "quality_low", "quality_high")
            assert [row[name] for name in limits] == [None] * 7
        assert {(row["bias_low"], row["bias_high"]) for row in tables["raters"]} == {(None, None)}
        assert "ratings: no interval of c0 of d0, c1 of d0 and c2 of d0, on which all agree exactly" in warnings_of(
            table
        )
        json.dumps(tables, allow_nan=False)
        assert "over participants without intervals; all pairs" in rating_findings(tables)[-1]["text"]
    differing = rating_table(person, item, np.where(item == 0, 5.0, 1.0 + person % 3))
    assert "no interval of c0 of d0, on which" in warnings_of(differing)
    assert [row["ci_low"] is None for row in analyse_ratings(differing)["rating_items"]] == [True, False, False]


@pytest.mark.parametrize(("high", "unit"), [(5, "grades"), (11, "grades"), (100, "points")])
def test_a_difference_is_in_the_unit_of_the_scale(high: float, unit: str) -> None:
    person, item = np.divmod(np.arange(24), 2)
    table = rating_table(person, item, np.array([5.0, 3.0])[item], scale=(1.0, high))
    said = {row["about"]: row["text"] for row in rating_findings(analyse_ratings(table))}
    assert said["difference"].startswith(f"Participants rate c0 2.00 {unit} above c1")


def test_a_condition_on_easy_datasets_alone_is_not_called_best_before_one_that_beats_it_there() -> None:
    """c0 is rated on d0 alone, where c1 is better; d1 is harder."""
    means = {(0, 0): 4.0, (0, 1): 4.6, (0, 2): 2.4, (1, 1): 2.6, (1, 2): 2.2}
    noise = np.random.default_rng(0).normal(0, 0.1, (20, len(means)))
    item = np.tile([dataset * 3 + condition for dataset, condition in means], 20)
    table = rating_table(
        np.repeat(np.arange(20), len(means)), item, (noise + list(means.values())).ravel(), n_datasets=2
    )
    said = {row["about"]: row["text"] for row in rating_findings(analyse_ratings(table))}
    assert said["best"].startswith("c0 has the highest mean rating, 3.99")
    assert said["best"].endswith("but c1 is higher where the same people judged both.")
    assert said["worst"].startswith("c2 is worst")
    turned = {
        row["about"]: row["text"] for row in rating_findings(analyse_ratings(replace(table, rating=6 - table.rating)))
    }
    assert turned["worst"].endswith("but c1 is lower where the same people judged both.")


def test_no_condition_is_called_highest_where_all_have_the_same_rating() -> None:
    table = rating_table(np.zeros(3, np.int64), np.arange(3), np.full(3, 4.0))
    said = {row["about"]: row["text"] for row in rating_findings(analyse_ratings(table))}
    assert said["ranking"].startswith("All conditions have the mean rating 4.00 (no interval). Whether")


def test_a_conditions_quality_is_the_mean_of_its_items_with_their_common_error() -> None:
    table, truth = simulated(np.random.default_rng(2), 30, 40, n_datasets=2)
    tables = analyse_ratings(table)
    assert tables["rating_model"][0]["status"] == "ok"
    for row in tables["rating_conditions"]:
        items = [item for item in tables["rating_items"] if item["condition"] == row["condition"]]
        assert row["quality"] == pytest.approx(np.mean([item["quality"] for item in items]))
        assert row["quality_se"] < max(item["quality_se"] for item in items)
    qualities = [row["quality"] for row in tables["rating_items"]]
    assert np.corrcoef(qualities, truth.quality)[0, 1] > 0.95


def test_a_study_is_told_what_it_lacks() -> None:
    assert "takes two participants" in warnings_of(rating_table([0, 0, 0], [0, 1, 2], [1, 2, 3]))
    assert "several times" in warnings_of(known_table())
    assert "look at" not in warnings_of(known_table())
    assert "p7" in [row["participant"] for row in analyse_ratings(known_table())["raters"] if row["remarks"]]
    hidden = rating_table([0, 1], [0, 0], [3, 4], protocol="acr-hr")
    assert "d0 has no reference" in warnings_of(hidden)


@pytest.mark.parametrize(("rating", "says"), [(6.0, "with 6, expected 1 to 5"), (np.nan, "with nan, expected 1 to 5")])
def test_a_rating_outside_of_the_scale_is_refused(rating: float, says: str) -> None:
    with pytest.raises(ValueError, match=f"p0 rated c0 of d0 {says}"):
        rating_table([0], [0], [rating])


def test_an_unknown_protocol_and_an_upside_down_scale_are_refused() -> None:
    with pytest.raises(ValueError, match="the protocol is 'mushra', expected one of acr, acr-hr, dcr"):
        rating_table([0], [0], [3], protocol="mushra")
    with pytest.raises(ValueError, match="from 5 to 1, expected its low end first"):
        rating_table([0], [0], [3], scale=(5.0, 1.0))


def test_a_comparison_across_datasets_is_refused() -> None:
    with pytest.raises(ValueError, match="x of ball is compared with y of box"):
        ComparisonTable(
            ("p0",),
            (("ball", "x"), ("box", "y")),
            *(np.array([index]) for index in (0, 0, 1)),
            np.ones(1),
            np.ones(1, bool),
        )


def test_where_all_means_are_the_same_none_is_highest() -> None:
    table = rating_table(np.repeat(range(7), 3), [0, 1, 2] * 7, [3.0] * 21)
    said = {row["about"]: row["text"] for row in rating_findings(analyse_ratings(table))}
    assert said["ranking"] == "All 3 conditions have the same mean rating, 3.00."
    assert "told apart" not in said


def test_where_nobody_can_be_compared_nobody_is_said_not_to_stand_out() -> None:
    few_items = rating_table(np.repeat(range(8), 2), [0, 1] * 8, [4.0, 2.0, 3.0, 2.0] * 4)
    said = {row["about"]: row["text"] for row in rating_findings(analyse_ratings(few_items))}
    assert "stands out" not in said["participants"]
    assert said["participants"].startswith("Nobody's ratings can be compared with the others'")
