"""A study's results: scores, figures and tables, and whether there is anything new."""

from __future__ import annotations

import csv
import html
import io
import re
from collections.abc import Callable
from typing import Any

import pytest
from fastapi import Request

from app.analysis import AnalysisSettings, analyse, votes_from_rows
from app.web.admin.results.scores_view import decimal, p_value, results_view
from tests.app.web.admin.dashboard_client import Dashboard


@pytest.mark.slow
def test_results_show_scores_triads_and_downloads(experimenter: Dashboard, taken: dict[str, Any]) -> None:
    page = experimenter.results(f"/admin/studies/{taken['slug']}/results")
    assert "Circular triads" in page
    assert "P003" in page
    slug = taken["slug"]
    findings = experimenter.get(f"/api/v1/studies/{slug}/analysis").json()["findings"]
    assert len(findings) > 3
    assert all(row["text"] in html.unescape(page) for row in findings)
    order = re.compile(r'<th scope="row">(P\d+)</th>')
    by_name = experimenter.results(f"/admin/studies/{slug}/results", triads_sort="participant")
    names = order.findall(by_name[by_name.index('id="triads"') :])
    assert names == sorted(names)
    for path in (f"/admin/studies/{slug}/figures/scores.svg", f"/api/v1/studies/{slug}/votes?format=csv"):
        assert path in page
        assert experimenter.get(path).status_code == 200


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scores", "scores_depth", "levels_depth", "preferences", "triads"])
def test_every_figure_is_there_as_picture_print_and_numbers(
    experimenter: Dashboard, taken: dict[str, Any], name: str
) -> None:
    figure = f"/admin/studies/{taken['slug']}/figures/{name}"
    drawn = experimenter.get(f"{figure}.svg")
    assert drawn.headers["content-type"] == "image/svg+xml"
    assert drawn.text.startswith("<svg")
    assert experimenter.get(f"{figure}.png").content.startswith(b"\x89PNG")
    assert experimenter.get(f"{figure}.pdf").content.startswith(b"%PDF")
    assert experimenter.get(f"{figure}.vega").json()["$schema"].startswith("https://vega.github.io/schema/vega/")
    rows = list(csv.DictReader(io.StringIO(experimenter.get(f"{figure}.csv").text)))
    assert rows
    if name in ("scores_depth", "levels_depth"):
        assert {row["item"] for row in rows} == {"id", "pm"}


@pytest.mark.slow
@pytest.mark.parametrize("choices", ["ab", "aabab", "aaab", "a"])  # none, chance's, a difference, and no vote against
@pytest.mark.parametrize("participants", [1, 24])
def test_every_result_begins_with_its_sentence_also_where_nothing_differs(choices: str, participants: int) -> None:
    votes = [
        {"participant": f"p{person}", "dataset": "ball", "item_a": a, "item_b": b}
        | {"choice": choices[(person + turn) % len(choices)], "first_shown": a}
        for person in range(participants)
        for turn, (a, b) in enumerate([("x", "y"), ("y", "z"), ("x", "z")])
    ]
    analysis = analyse(votes_from_rows(votes), AnalysisSettings(by_dataset=False))
    view = results_view(Request({"type": "http", "query_string": b"", "path": "/", "headers": []}), analysis)
    assert view["leading"][:1] == [analysis["findings"][0]["text"]]
    assert {row["text"] for row in analysis["findings"] if row["about"] == "told apart"} <= set(view["leading"])
    shown = view["leading"] + view["findings"] + view["settings"]
    assert sorted(shown) == sorted(row["text"] for row in analysis["findings"])


@pytest.mark.slow
def test_there_is_no_plot_of_nothing(experimenter: Dashboard, taken: dict[str, Any]) -> None:
    for path in (
        f"{taken['slug']}/figures/holiday.svg",
        f"{taken['slug']}/figures/scores.exe",
        "unknown/figures/scores.svg",
    ):
        assert experimenter.get(f"/admin/studies/{path}").status_code == 404


def test_results_tell_when_nothing_is_new(experimenter: Dashboard, taken: dict[str, Any]) -> None:
    results = f"/admin/studies/{taken['slug']}/results"
    digest = re.findall(r'data-digest="([0-9a-f]+)"', experimenter.get(results).text)[0]
    assert experimenter.get(results, params={"seen": digest}).status_code == 204
    assert experimenter.get(results, params={"seen": digest, "everybody": "true"}).status_code in (200, 204)


def test_results_that_count_the_excluded_tell_whom_the_downloads_leave_out(
    experimenter: Dashboard, taken: dict[str, Any]
) -> None:
    results = f"/admin/studies/{taken['slug']}/results"
    told = "These files leave out who is excluded"
    assert told not in experimenter.results(results)
    everybody = experimenter.results(results, everybody="true")
    assert told in everybody
    assert "Who is excluded counts here, too; who has withdrawn does not." in everybody


def test_a_study_without_votes_says_so(experimenter: Dashboard, new_study: Callable[[], dict[str, Any]]) -> None:
    assert "No votes yet." in experimenter.get(f"/admin/studies/{new_study()['slug']}/results").text


@pytest.mark.parametrize(("value", "text"), [(None, "–"), (1.005, "1.00"), (-0.5, "−0.50"), (-0.004, "0.00")])
def test_numbers_have_a_true_minus(value: float | None, text: str) -> None:
    assert decimal(value) == text


@pytest.mark.parametrize(("value", "text"), [(None, "–"), (0.0004, "< 0.001"), (0.0512, "0.051")])
def test_p_values_do_not_pretend_to_be_zero(value: float | None, text: str) -> None:
    assert p_value(value) == text
