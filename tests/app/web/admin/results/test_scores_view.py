"""How the results page groups the rows of an analysis."""

from __future__ import annotations

from app.web.admin.results.scores_view import by_dataset


def test_datasets_stand_in_one_order_whatever_their_scores() -> None:
    rows = [
        {"dataset": dataset, "item": item, "score": score}
        for dataset, item, score in (("park", "x", 0.1), ("street", "x", 2.0), ("all", "x", -1.0), ("park", "y", 0.3))
    ]
    grouped = by_dataset(rows)
    assert list(grouped) == ["all", "park", "street"]
    assert [row["item"] for row in grouped["park"]] == ["y", "x"]
