"""Votes that check the participant are counted apart and change no score."""

from __future__ import annotations

from typing import Any

import pytest

from app.analysis import analyse
from app.analysis.model.settings import AnalysisSettings
from app.analysis.reading.read_votes import votes_from_rows
from app.analysis.reading.votes_table import VotesError
from app.analysis.report.page import report_page
from app.analysis.screening.attention_checks import check_rows

MAIN = [("p1", "x", "y", "a"), ("p1", "y", "z", "b"), ("p1", "x", "z", "none"), ("p2", "x", "y", "b")]


def row(participant: str, item_a: str, item_b: str, choice: str, role: str = "main", **more: Any) -> dict[str, Any]:
    return {
        "participant": participant, "dataset": "d", "item_a": item_a, "item_b": item_b, "choice": choice, "role": role,
    } | more  # fmt: skip


def rows_with_checks() -> list[dict[str, Any]]:
    return [
        *(row(*one) for one in MAIN),
        row("p1", "x", "y", "a", "repeat"),
        row("p1", "y", "z", "a", "repeat"),
        row("p1", "x", "x", "none", "identical"),
        row("p2", "z", "z", "a", "identical"),
    ]


def test_checks_are_counted_by_participant() -> None:
    assert check_rows(votes_from_rows(rows_with_checks())) == [
        {"participant": "p1", "n_identical": 1, "n_identical_none": 1, "n_repeated": 2, "n_repeated_same": 1},
        {"participant": "p2", "n_identical": 1, "n_identical_none": 0, "n_repeated": 0, "n_repeated_same": 0},
    ]


def test_the_report_tells_what_became_of_every_vote_that_was_read() -> None:
    page = report_page("report.md", analyse(votes_from_rows(rows_with_checks())), (), "votes")
    assert "8 votes read: 4 analysed (1 without preference), 0 practice, 4 attention checks, 0 excluded." in page


def test_checks_of_few_people_change_nothing_but_their_own_section_and_sentence() -> None:
    with_checks = analyse(votes_from_rows(rows_with_checks()))
    without = analyse(votes_from_rows([row(*one) for one in MAIN]))
    assert with_checks.pop("checks")
    assert without.pop("checks") == []
    assert with_checks.pop("votes") == without.pop("votes") | {"rows": 8, "votes": 8, "checks": 4}
    said = with_checks.pop("findings")
    assert [row for row in said if row["about"] != "checks"] == without.pop("findings")
    assert with_checks == without


def test_a_pair_in_both_orders_is_repeated_in_the_order_in_which_it_was() -> None:
    both = [row("p", "x", "y", "a"), row("p", "y", "x", "a"), row("p", "y", "x", "a", "repeat")]
    assert check_rows(votes_from_rows(both))[0]["n_repeated_same"] == 1


def test_practice_and_exclusions_are_no_checks() -> None:
    rows = [row(*MAIN[0]), row("p2", "x", "x", "a", "identical", excluded=True)]
    assert check_rows(votes_from_rows(rows)) == []


def test_who_is_left_out_by_the_settings_has_no_checks_either() -> None:
    analysis = analyse(votes_from_rows(rows_with_checks()), AnalysisSettings(exclude=("p2",)))
    assert [row["participant"] for row in analysis["checks"]] == ["p1"]
    assert (analysis["votes"]["checks"], analysis["votes"]["excluded"]) == (3, 2)


def test_an_item_against_itself_is_refused_where_it_is_no_check() -> None:
    with pytest.raises(VotesError, match="row 1: the item 'x' is compared with itself"):
        votes_from_rows([row("p", "x", "x", "a")])
    with pytest.raises(VotesError, match="row 1: role is 'other', expected main, repeat, identical"):
        votes_from_rows([row("p", "x", "y", "a", "other")])
