"""Comparison category ratings against a regression by hand and simulated people."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from app.analysis.findings.ratings import rating_findings
from app.analysis.ratings.comparisons import analyse_comparisons
from app.analysis.ratings.table import ComparisonTable

ITEMS = (("d", "c0"), ("d", "c1"), ("d", "c2"))


def comparisons(rows: list[tuple[int, int, int, float, bool]]) -> ComparisonTable:
    person, a, b, rating, a_first = (np.array(column) for column in zip(*rows, strict=True))
    names = tuple(f"p{index}" for index in range(int(person.max()) + 1))
    return ComparisonTable(names, ITEMS, person, a, b, rating.astype(float), a_first.astype(bool))


def test_exchanged_orders_cancel_in_a_pairs_mean() -> None:
    table = comparisons([(0, 0, 1, 2, True), (1, 0, 1, 0, False), (2, 1, 0, -2, False), (3, 1, 0, 0, True)])
    tables = analyse_comparisons(table)
    (pair,) = tables["comparison_pairs"]
    assert (pair["item_a"], pair["item_b"], pair["n_ratings"], pair["n_a_first"]) == ("c0", "c1", 4, 2)
    assert pair["cmos"] == pytest.approx(1)  # c1 is better by 1; being shown second adds 1
    assert tables["comparison_models"][0]["order_effect"] == pytest.approx(1)
    assert pair["sd"] == pytest.approx(0, abs=1e-12)


def test_naming_the_items_the_other_way_round_changes_nothing() -> None:
    rng = np.random.default_rng(1)
    rows = [
        (p, a, b, float(rng.integers(-3, 4)), bool(rng.integers(2)))
        for p in range(6)
        for a, b in ((0, 1), (0, 2), (1, 2))
    ]
    turned = [(p, b, a, -rating, not first) for p, a, b, rating, first in rows]
    for name in ("comparison_pairs", "comparison_items"):
        for row, other in zip(
            analyse_comparisons(comparisons(rows))[name], analyse_comparisons(comparisons(turned))[name], strict=True
        ):
            for key in ("cmos", "score", "ci_low", "ci_high"):
                if key in row:
                    assert other[key] == pytest.approx(row[key])


def test_scores_are_the_least_squares_of_the_pairs_and_differences_predict_ratings() -> None:
    rows = [(p, a, b, r, p % 2 == 0) for p in range(4) for a, b, r in ((0, 1, 1.0), (1, 2, 1.0), (0, 2, 2.0))]
    tables = analyse_comparisons(comparisons(rows))
    scores = {row["condition"]: row["score"] for row in tables["comparison_items"]}
    assert scores == pytest.approx({"c0": -1, "c1": 0, "c2": 1})


@pytest.mark.slow
def test_intervals_cover_the_truth_where_people_differ() -> None:
    rng, covered, orders = np.random.default_rng(7), [], []
    truth = np.array([-0.6, 0.1, 0.5])
    for _ in range(200):
        rows = []
        for p in range(14):
            taste = truth + rng.normal(0, 0.4, 3)
            for a, b in ((0, 1), (0, 2), (1, 2)):
                first = bool(rng.integers(2))
                rating = taste[b] - taste[a] + (0.3 if first else -0.3) + rng.normal(0, 0.4)
                rows.append((p, a, b, float(np.clip(rating, -3, 3)), first))
        tables = analyse_comparisons(comparisons(rows))
        covered += [
            row["ci_low"] < value < row["ci_high"] for row, value in zip(tables["comparison_items"], truth, strict=True)
        ]
        orders.append(tables["comparison_models"][0]["order_effect"])
    assert 0.92 < np.mean(covered) < 0.98
    assert np.mean(orders) == pytest.approx(0.3, abs=0.03)


@pytest.mark.slow
def test_intervals_of_few_people_who_rated_different_pairs_cover_the_truth() -> None:
    rng, covered = np.random.default_rng(9), []
    pairs = np.array(list(combinations(range(6), 2)))
    truth = np.linspace(-0.6, 0.6, 6)
    for _ in range(200):
        person = np.repeat(np.arange(8), 3)
        a, b = pairs[np.concatenate([rng.choice(15, 3, replace=False) for _ in range(8)])].T
        taste = truth + rng.normal(0, 0.3, (8, 6))
        rating = np.clip(taste[person, b] - taste[person, a] + rng.normal(0, 0.6, 24), -3, 3)
        items, names = tuple(("d", f"c{n}") for n in range(6)), tuple(f"p{n}" for n in range(8))
        tables = analyse_comparisons(ComparisonTable(names, items, person, a, b, rating, rng.random(24) < 0.5))
        covered += [
            row["ci_low"] < truth[int(row["condition"][1])] < row["ci_high"] for row in tables["comparison_items"]
        ]
    assert 0.93 < np.mean(covered) < 0.98


@pytest.mark.slow
def test_a_pairs_interval_holds_what_is_uncertain_about_the_order_effect_taken_off() -> None:
    rng, covered = np.random.default_rng(3), []
    for _ in range(200):
        rows = []
        for p in range(20):
            for a, b in ((0, 1), (0, 2), (1, 2)):
                first = a == 0 or bool(rng.integers(2))  # c0 always stands first, so one pair tells the order effect
                rating = (b - a) / 2 + (0.4 if first else -0.4) + rng.normal(0, 0.4)
                rows.append((p, a, b, float(np.clip(rating, -3, 3)), first))
        pairs = analyse_comparisons(comparisons(rows))["comparison_pairs"]
        covered += [row["ci_low"] < truth < row["ci_high"] for row, truth in zip(pairs, (0.5, 1, 0.5), strict=True)]
    assert 0.92 < np.mean(covered) < 0.98


def test_a_pair_in_one_order_cannot_tell_the_order_from_the_items() -> None:
    tables = analyse_comparisons(comparisons([(0, 0, 1, 2, True), (1, 0, 1, 1, True)]))
    assert tables["comparison_models"][0]["order_effect"] is None
    assert tables["comparison_pairs"][0]["cmos"] == pytest.approx(1.5)
    assert "show each pair in both orders" in tables["rating_warnings"][0]["warning"]
    assert "least squares scale in grades, 95 % intervals" in rating_findings(tables)[-1]["text"]
    both_orders = analyse_comparisons(comparisons([(0, 0, 1, 2, True), (1, 0, 1, 1, False)]))
    assert "with the order effect taken off" in rating_findings(both_orders)[-1]["text"]


def test_the_settings_name_the_unit_of_the_scale() -> None:
    table = replace(comparisons([(0, 0, 1, 2, True), (1, 0, 1, 1, True)]), high=100.0)
    assert "least squares scale in points" in rating_findings(analyse_comparisons(table))[-1]["text"]


def test_datasets_are_scored_alone_and_together() -> None:
    items = (("x", "c0"), ("x", "c1"), ("y", "c0"), ("y", "c1"))
    a, b = np.array([0, 0, 2, 2]), np.array([1, 1, 3, 3])
    table = ComparisonTable(
        ("p0", "p1"), items, np.array([0, 1, 0, 1]), a, b, np.array([1.0, 1, 3, 3]), np.array([True, False] * 2)
    )
    tables = analyse_comparisons(table)
    scores = {(row["dataset"], row["condition"]): row["score"] for row in tables["comparison_items"]}
    assert (scores["x", "c1"], scores["y", "c1"], scores["all", "c1"]) == pytest.approx((0.5, 1.5, 1.0))


def test_conditions_that_no_pair_links_have_no_scores() -> None:
    items = tuple(("d", f"c{index}") for index in range(4))
    table = ComparisonTable(
        ("p0",),
        items,
        np.zeros(2, int),
        np.array([0, 2]),
        np.array([1, 3]),
        np.array([1.0, 1.0]),
        np.array([True, False]),
    )
    tables = analyse_comparisons(table)
    assert tables["comparison_items"] == []
    assert tables["comparison_models"][0]["status"] == "disconnected"


def test_comparisons_on_which_all_agree_exactly_have_no_interval() -> None:
    pairs = ((0, 1, 1.0), (1, 2, 1.0), (0, 2, 2.0))
    tables = analyse_comparisons(comparisons([(p, a, b, r, p % 2 == 0) for p in range(14) for a, b, r in pairs]))
    for row in (*tables["comparison_pairs"], *tables["comparison_items"]):
        assert (row["ci_low"], row["ci_high"], row.get("se")) == (None, None, None)
    assert tables["comparison_models"][0]["order_se"] is None
    (warning,) = (row["warning"] for row in tables["rating_warnings"])
    said = " ".join(row["text"] for row in rating_findings(tables))
    assert "not tested: all participants agree exactly." in said
    assert "intervals of these" not in said
    assert warning.startswith("comparisons, dataset d: no interval of c0, c1 and c2, on which all agree exactly")


def test_what_to_know_of_several_datasets_is_said_once_with_their_names() -> None:
    items = tuple((dataset, condition) for dataset in ("ball", "box", "bust") for condition in ("c0", "c1"))
    a = np.array([0, 2, 4])
    table = ComparisonTable(("p0",), items, np.zeros(3, int), a, a + 1, np.ones(3), np.ones(3, bool))
    (warning,) = (row["warning"] for row in analyse_comparisons(table)["rating_warnings"])
    assert warning.startswith("comparisons, datasets ball, box and bust, all datasets together: the orders cannot tell")


def test_of_a_single_participant_no_intervals_are_promised() -> None:
    tables = analyse_comparisons(comparisons([(0, 0, 1, 1, True), (0, 1, 2, 2, False)]))
    said = " ".join(row["text"] for row in rating_findings(tables))
    assert "not tested: a single participant rated." in said
    assert "A single participant rated: nothing can be concluded about other people." in said
    assert "without intervals" in said
    assert "95 % intervals" not in said


def test_scores_of_datasets_that_no_pair_links_are_said_with_their_datasets() -> None:
    items = (("x", "c0"), ("x", "c1"), ("y", "c2"), ("y", "c3"))
    person, a = np.array([0, 1, 0, 1]), np.array([0, 0, 2, 2])
    table = ComparisonTable(("p0", "p1"), items, person, a, a + 1, np.array([1.0, 2, 1, 3]), np.array([True] * 4))
    ranked = [row["text"] for row in rating_findings(analyse_comparisons(table)) if row["about"] == "ranking"]
    assert ["comparison rating on x" in ranked[0], "comparison rating on y" in ranked[1]] == [True, True]


def test_conditions_that_no_pair_links_are_not_passed_over_in_silence() -> None:
    items = tuple(("", f"c{number}") for number in range(4))
    person, a = np.array([0, 1, 0, 1]), np.array([0, 0, 2, 2])
    table = ComparisonTable(("p0", "p1"), items, person, a, a + 1, np.array([1.0, 2, 1, 3]), np.array([True] * 4))
    said = rating_findings(analyse_comparisons(table))
    assert said[0]["text"].startswith("No pair links some conditions to the others, so there is no ranking")


@pytest.mark.parametrize(("rating", "has_order", "helps"), [(1.0, True, True), (1.0, False, False), (3.0, True, False)])
def test_both_orders_are_asked_for_only_where_they_would_tell_the_order_effect(
    rating: float, has_order: bool, helps: bool
) -> None:
    person, zeros = np.arange(4), np.zeros(4, int)
    first = person % 2 == 0 if rating == 3 else zeros == 0
    table = ComparisonTable(
        tuple(f"p{number}" for number in range(4)), (("", "c0"), ("", "c1")), person, zeros, zeros + 1,
        np.full(4, rating), first, has_order=has_order,
    )  # fmt: skip
    tables = analyse_comparisons(table)
    warning, agreed = (row["warning"] for row in tables["rating_warnings"])
    assert warning.startswith("comparisons: ")
    assert agreed.startswith("comparisons: no interval of c0 and c1")
    assert ("show each pair in both orders" in warning) == helps
    assert (tables["comparison_models"][0]["n_first_better"] is not None) == has_order
    assert (tables["comparison_pairs"][0]["n_a_first"] is not None) == has_order
