"""The experimenter's pages."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from app.operations import create, manage
from app.settings import Settings
from app.web.admin.results_view import decimal, p_value
from tests.app.web.admin.dashboard_client import Dashboard, signed_in


def test_the_link_signs_in_and_leaves_the_address(client: httpx.Client, settings: Settings) -> None:
    answer = client.get(manage.add_experimenter(settings, "Ben Example")["path"])
    assert answer.status_code == 303
    assert answer.headers["location"] == "/admin"
    assert "HttpOnly" in answer.headers["set-cookie"]
    page = client.get("/admin")
    assert page.status_code == 200
    assert "Ben Example" in page.text


def test_a_new_link_ends_the_old_one(client: httpx.Client, settings: Settings) -> None:
    old, new = (manage.add_experimenter(settings, "Cleo Example")["path"] for _ in range(2))
    assert client.get(old).status_code == 401
    assert client.get(new).status_code == 303


def test_nobody_sees_the_pages_without_signing_in(client: httpx.Client, study: dict[str, Any]) -> None:
    results = f"/admin/studies/{study['slug']}"
    for path in ("/admin", results, f"{results}/figures/scores.svg"):
        answer = client.get(path, headers={"Accept": "text/html"})
        assert answer.status_code == 401
        assert "You are not signed in." in answer.text
        assert study["name"] not in answer.text
    assert client.post(f"{results}/state", data={"state": "closed"}).status_code == 401


def test_signing_out_ends_the_session(experimenter: Dashboard) -> None:
    cookie = experimenter.cookies["experimenter"]
    assert experimenter.act("/admin/logout").status_code == 200
    assert experimenter.get("/admin", headers={"Cookie": f"experimenter={cookie}"}).status_code == 401


def test_all_studies_are_listed_and_lead_to_their_invitations(experimenter: Dashboard, study: dict[str, Any]) -> None:
    assert study["name"] in experimenter.get("/admin").text
    page = experimenter.get(f"/admin/studies/{study['slug']}").text
    assert f"{experimenter.base_url}/s/{study['invitation']}".replace("//s/", "/s/") in page


@pytest.mark.slow
def test_results_show_scores_triads_and_downloads(experimenter: Dashboard, taken: dict[str, Any]) -> None:
    page = experimenter.get(f"/admin/studies/{taken['slug']}/results").text
    assert "Circular triads" in page
    assert "P003" in page
    slug = taken["slug"]
    for path in (f"/admin/studies/{slug}/figures/scores.svg", f"/api/v1/studies/{slug}/votes?format=csv"):
        assert path in page
        assert experimenter.get(path).status_code == 200


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scores", "scores_depth", "preferences", "triads"])
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
    if name == "scores_depth":
        assert {row["item"] for row in rows} == {"id", "pm"}


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


def test_a_study_without_votes_says_so(experimenter: Dashboard, new_study: Callable[[], dict[str, Any]]) -> None:
    assert "No votes yet." in experimenter.get(f"/admin/studies/{new_study()['slug']}/results").text


def test_a_closed_study_lets_nobody_in_until_it_is_opened_again(
    experimenter: Dashboard, client: httpx.Client, new_study: Callable[[], dict[str, Any]]
) -> None:
    study = new_study()
    change = f"/admin/studies/{study['slug']}/state"
    begin = f"/api/v1/studies/{study['slug']}/sessions"
    assert "Open again" in experimenter.act(change, state="closed").text
    assert client.post(begin, json={"invitation": study["invitation"]}).status_code == 403
    assert client.get(f"/s/{study['invitation']}").status_code == 403
    experimenter.act(change, state="open")
    assert client.post(begin, json={"invitation": study["invitation"]}).status_code == 201


def test_the_server_page_keeps_the_database_address_to_itself(server: str, settings: Settings) -> None:
    with signed_in(server, settings, "Olga", "owner") as olga:
        page = olga.get("/admin/settings").text
    assert "RECONSTUDY_DATA_DIR" in page
    assert "sqlite:///" not in page


def test_another_site_cannot_close_a_study(experimenter: Dashboard, study: dict[str, Any]) -> None:
    foreign = {"Origin": "http://elsewhere.example"}
    answer = experimenter.post(f"/admin/studies/{study['slug']}/state", data={"state": "closed"}, headers=foreign)
    assert answer.status_code == 403


def test_names_are_escaped(experimenter: Dashboard, settings: Settings, stimulus_set: Any) -> None:
    create.create_study(settings, stimulus_set, "<script>alert(1)</script> study")
    page = experimenter.get("/admin").text
    assert "<script>" not in page
    assert "&lt;script&gt;" in page


@pytest.mark.parametrize(("value", "text"), [(None, "–"), (1.005, "1.00"), (-0.5, "−0.50")])
def test_numbers_have_a_true_minus(value: float | None, text: str) -> None:
    assert decimal(value) == text


@pytest.mark.parametrize(("value", "text"), [(None, "–"), (0.0004, "< 0.001"), (0.0512, "0.051")])
def test_p_values_do_not_pretend_to_be_zero(value: float | None, text: str) -> None:
    assert p_value(value) == text
