"""The experimenter's pages."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from app.intake import bounds
from app.operations.studies import create, manage
from app.settings import Settings
from app.web.admin.layout import TABS
from tests.app.web.admin.dashboard_client import Dashboard, signed_in

TITLE = re.compile(r"<title>(.*?)</title>", re.DOTALL)


def test_the_link_signs_in_and_leaves_the_address(client: httpx.Client, settings: Settings) -> None:
    link = manage.add_experimenter(settings, "Ben Example")["path"]
    for _ in range(2):  # looking at the link does not use it up
        assert "Sign in as Ben Example" in client.get(link).text
    assert client.get("/admin").status_code == 401
    assert client.post(link).status_code == 403  # from elsewhere than our page
    answer = client.post(link, data={"form_token": client.cookies["entry"]})
    assert answer.status_code == 303
    assert answer.headers["location"] == "/admin"
    assert "HttpOnly" in answer.headers["set-cookie"]
    page = client.get("/admin")
    assert page.status_code == 200
    assert "Ben Example" in page.text
    assert client.post(link, data={"form_token": client.cookies["entry"]}).status_code == 401
    assert client.get(link).headers["location"] == "/admin"  # opened again by who is signed in
    client.cookies.clear()
    assert client.get(link).status_code == 401


def test_a_new_link_ends_the_old_one(client: httpx.Client, settings: Settings) -> None:
    old, new = (manage.add_experimenter(settings, "Cleo Example")["path"] for _ in range(2))
    assert client.get(old).status_code == 401
    assert client.get(new).status_code == 200


def test_nobody_sees_the_pages_without_signing_in(client: httpx.Client, study: dict[str, Any]) -> None:
    results = f"/admin/studies/{study['slug']}"
    for path in ("/admin", results, f"{results}/figures/scores.svg"):
        answer = client.get(path, headers={"Accept": "text/html"})
        assert answer.status_code == 401
        assert "You are not signed in." in answer.text
        assert study["name"] not in answer.text
    assert client.post(f"{results}/state", data={"state": "closed"}).status_code == 401


def test_a_program_without_a_token_is_told_how_to_get_one(client: httpx.Client) -> None:
    answer = client.get("/api/v1/studies")
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    assert "`Authorization: Bearer TOKEN`" in answer.json()["detail"]
    assert "password" not in answer.text


def test_who_is_not_signed_in_is_told_what_to_do_without_a_command(client: httpx.Client) -> None:
    page = client.get("/admin", headers={"Accept": "text/html"}).text
    assert "a sign-in link from an owner or whoever runs the server" in page
    assert "reconstudy " not in page
    assert "`" not in page


def test_signing_out_ends_the_session(experimenter: Dashboard) -> None:
    cookie = experimenter.cookies["experimenter"]
    assert experimenter.act("/admin/logout").status_code == 200
    assert experimenter.get("/admin", headers={"Cookie": f"experimenter={cookie}"}).status_code == 401


def test_all_studies_are_listed_and_lead_to_their_invitations(experimenter: Dashboard, study: dict[str, Any]) -> None:
    assert study["name"] in experimenter.get("/admin").text
    page = experimenter.get(f"/admin/studies/{study['slug']}").text
    assert f"{experimenter.base_url}/s/{study['invitation']}".replace("//s/", "/s/") in page


def test_every_page_of_a_study_has_a_title_of_its_own(experimenter: Dashboard, study: dict[str, Any]) -> None:
    """By which tabs are told apart, and which a screen reader says first."""
    base = f"/admin/studies/{study['slug']}"
    titles = [TITLE.findall(experimenter.get(base + address).text)[0] for address, _, _ in TABS]
    assert len({*titles}) == len(TABS), titles


@pytest.mark.slow
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


def test_who_may_send_files_finds_their_readers_loading_and_nobody_else_loads_them(
    monkeypatch: pytest.MonkeyPatch, client: httpx.Client, server: str, settings: Settings
) -> None:
    began: list[str] = []
    monkeypatch.setattr(bounds.forkserver, "ensure_running", lambda: began.append("readers"))
    client.get("/admin", headers={"Accept": "text/html"})
    with signed_in(server, settings, "Vera", "viewer") as vera:
        vera.get("/admin")
    assert began == []
    with signed_in(server, settings, "Emil", "experimenter") as emil:
        emil.get("/admin")
    assert "readers" in began
