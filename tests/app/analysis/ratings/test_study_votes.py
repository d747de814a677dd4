from __future__ import annotations

from app.analysis.ratings.study_votes import with_films
from app.analysis.reading.read_votes import votes_from_rows


def test_who_rated_films_that_did_not_run_is_flagged_where_it_is_known() -> None:
    row = {"dataset": "d", "item_a": "x", "item_b": "y", "choice": "a"}
    ran = [{"participant": "P1", "shown_smoothly": smooth, **row} for smooth in (True, False, True)]
    votes = votes_from_rows([*ran, {"participant": "P2", **row}])
    raters = [{"participant": name, "flags": ["correlation 0.50"]} for name in ("P1", "P2")]
    first, second = with_films(raters, votes)
    assert first["not_smooth"] == 1
    assert first["flags"] == ["correlation 0.50", "films not shown smoothly in 1 of 3 votes"]
    assert (second["not_smooth"], second["flags"]) == (None, ["correlation 0.50"])
