"""Studies are managed over REST as on the dashboard, with a token's scopes, and the audit log tells of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any
from uuid import uuid4

import httpx
import pytest

from app.operations.studies import manage
from app.settings import Settings
from app.simulation.participants import simulate
from tests.app.conftest import ABILITIES

PROBLEM = "application/problem+json"


@pytest.fixture
def manager(server: str, settings: Settings) -> Iterator[httpx.Client]:
    """A program whose token may change studies, and read."""
    scopes = ("read", "personal", "audit", "studies:write", "participants:write")
    token = manage.add_token(settings, f"manager {uuid4()}", scopes)["token"]
    headers = {"Authorization": f"Bearer {token}"}
    with httpx.Client(base_url=f"{server}/api/v1/", headers=headers, timeout=60) as client:
        yield client


@pytest.mark.slow
def test_a_study_is_created_edited_opened_copied_and_deleted(own_server: str, own: Settings) -> None:
    scopes = ("studies:write", "audit", "read")
    token = manage.add_token(own, "whole life", scopes)["token"]
    headers = {"Authorization": f"Bearer {token}"}
    with httpx.Client(base_url=f"{own_server}/api/v1/", headers=headers, timeout=60) as client:
        body = {"name": "Over REST", "stimulus_set": "tiny", "exposure_s": 0.4, "options": {"break_every": 7}}
        made = client.post("studies", json=body)
        assert (made.status_code, made.headers["location"]) == (201, "/api/v1/studies/over-rest")
        assert {"state": "paused", "n_votes": 0, "exposure_s": 0.4}.items() <= made.json().items()
        assert made.json()["options"]["break_every"] == 7
        assert client.post("studies", json=body).status_code == 422, "a second one of the same name"
        assert client.post("studies", json=body | {"name": "X", "stimulus_set": "no such"}).status_code == 404
        wrong = client.post("studies", json=body | {"name": "X", "options": {"brake_every": 7}})
        assert (wrong.status_code, wrong.headers["content-type"]) == (422, PROBLEM)
        assert "brake_every" in wrong.json()["detail"]

        revision = client.get("studies/over-rest").json()["revision"]
        assert revision == made.json()["revision"]
        edited = client.patch("studies/over-rest", json={"revision": revision, "options": {"break_every": 9}}).json()
        assert (edited["options"]["break_every"], edited["name"]) == (9, "Over REST")
        assert client.patch("studies/over-rest", json={"revision": revision, "name": "late"}).status_code == 409

        for _ in range(2):
            opened = client.put("studies/over-rest/state", json={"state": "open"})
            assert opened.json()["state"] == "open"
        copied = client.post("studies/over-rest/duplicate", json={"name": "Second round"})
        assert (copied.status_code, copied.json()["slug"]) == (201, "second-round")
        invited = client.post("studies/second-round/invitations", json={"places": 1, "number": 3}).json()
        assert all(each["link"].endswith(each["path"]) and each["link"].startswith("http") for each in invited)
        assert [row["places"] for row in invited] == [1, 1, 1]
        listed = client.get("studies/second-round/invitations").json()
        assert {row["code"] for row in invited} < {row["code"] for row in listed}
        assert client.delete(f"studies/second-round/invitations/{invited[0]['code']}").status_code == 204
        assert len(client.get("studies/second-round/invitations").json()) == len(listed) - 1

        assert [client.delete("studies/second-round").status_code for _ in range(2)] == [204, 404]
        done = [entry["action"] for entry in client.get("audit").json() if entry["actor"] == "token whole life"]
        assert done.count("study open") == 1
        assert {"study created", "study edited", "study open", "invitations made", "study deleted"} <= set(done)


@pytest.mark.parametrize("options", [{"without": ["nobody"]}, {"reference": "nobody"}, {"practice_dataset": "none"}])
def test_an_option_that_does_not_fit_the_films_is_refused(
    manager: httpx.Client, new_study: Callable[[], dict[str, Any]], options: dict[str, Any]
) -> None:
    """Only the making of the films finds it."""
    slug = new_study()["slug"]
    revision = manager.get(f"studies/{slug}").json()["revision"]
    answer = manager.patch(f"studies/{slug}", json={"revision": revision, "options": options})
    assert (answer.status_code, answer.headers["content-type"]) == (422, PROBLEM)
    assert answer.json()["detail"].startswith("Nothing was changed: ")
    assert manager.get(f"studies/{slug}").json()["revision"] == revision


def test_a_renamed_study_takes_the_address_of_its_name(
    manager: httpx.Client, new_study: Callable[[], dict[str, Any]]
) -> None:
    slug, name = new_study()["slug"], f"Renamed {uuid4()}"
    revision = manager.get(f"studies/{slug}").json()["revision"]
    assert manager.patch(f"studies/{slug}", json={"revision": revision, "name": name}).json()["slug"] == slug
    wanted = name.lower().replace(" ", "-")
    assert manager.put(f"studies/{slug}/address").json()["slug"] == wanted
    assert manager.get(f"studies/{wanted}").json()["name"] == name
    assert manager.get(f"studies/{slug}").status_code == 404


@pytest.mark.slow
def test_what_an_edit_leaves_out_of_a_table_stays(
    manager: httpx.Client, new_study: Callable[[], dict[str, Any]]
) -> None:
    slug = new_study()["slug"]

    def edit(options: dict[str, Any]) -> dict[str, Any]:
        revision = manager.get(f"studies/{slug}").json()["revision"]
        answer = manager.patch(f"studies/{slug}", json={"revision": revision, "options": options})
        assert answer.status_code == 200, answer.text
        edited: dict[str, Any] = answer.json()["options"]
        return edited

    edit({"limits": {"finished": 30, "under_way": 5}, "lab_sheet": {"display": "ASUS VG278", "size_inch": 27}})
    edited = edit({"limits": {"minutes": 60}, "lab_sheet": {"room_light": "dark"}})
    assert edited["limits"] == {"finished": 30, "under_way": 5, "open_until": "", "minutes": 60}
    assert edited["lab_sheet"] == {"display": "ASUS VG278", "size_inch": 27.0, "room_light": "dark"}
    assert "size_inch" not in edit({"lab_sheet": {"size_inch": None}})["lab_sheet"]


@pytest.mark.slow
def test_results_of_fewer_than_may_finish_are_interim_until_the_study_closes(
    server: str, token: str, manager: httpx.Client, new_study: Callable[[], dict[str, Any]]
) -> None:
    study = new_study()
    slug = study["slug"]
    simulate(server, slug, study["invitation"], token, 2, ABILITIES, 0.2, seed=4)

    def is_interim() -> bool:
        findings = manager.get(f"studies/{slug}/analysis").json()["findings"]
        return any(finding["text"].startswith("Interim: 2 of 30 planned") for finding in findings)

    assert not is_interim()
    revision = manager.get(f"studies/{slug}").json()["revision"]
    edited = manager.patch(f"studies/{slug}", json={"revision": revision, "options": {"limits": {"finished": 30}}})
    assert edited.status_code == 200
    assert is_interim()
    assert manager.put(f"studies/{slug}/state", json={"state": "closed"}).status_code == 200
    assert not is_interim()


@pytest.mark.slow
def test_a_study_with_votes_is_deleted_only_from_the_archive(
    server: str, settings: Settings, token: str, manager: httpx.Client, new_study: Callable[[], dict[str, Any]]
) -> None:
    study, kept = new_study(), new_study()
    for each in (study, kept):
        simulate(server, each["slug"], each["invitation"], token, 1, ABILITIES, 0.2, seed=4)
    n_votes = len(manager.get(f"studies/{kept['slug']}/votes").json())
    refused = manager.delete(f"studies/{study['slug']}")
    assert refused.status_code == 409
    assert "Archive it first" in refused.json()["detail"]
    manager.put(f"studies/{study['slug']}/state", json={"state": "archived"}).raise_for_status()
    assert manager.delete(f"studies/{study['slug']}").status_code == 204
    assert manager.get(f"studies/{study['slug']}").status_code == 404
    assert len(manager.get(f"studies/{kept['slug']}/votes").json()) == n_votes > 0
    with pytest.raises(ValueError, match="there is no study"):
        manage.remove_study(settings, study["slug"])


def test_an_exclusion_takes_its_own_scope_and_may_be_sent_twice(
    server: str, settings: Settings, manager: httpx.Client, taken: dict[str, Any]
) -> None:
    path = f"studies/{taken['slug']}/participants/P002/exclusion"
    assert manager.put(path, json={"reason": " " * 5}).status_code == 422
    for _ in range(2):
        excluded = manager.put(path, json={"reason": "looked away "})
        assert excluded.json().items() >= {"participant": "P002", "reason": "looked away"}.items()
    assert manager.put(path, json={"reason": "slept"}).status_code == 409
    votes = manager.get(f"studies/{taken['slug']}/votes", params={"participant": "P002"}).json()
    assert {row["reason"] for row in votes} == {"looked away"}
    assert [manager.delete(path).status_code for _ in range(2)] == [204, 204]
    token = manage.add_token(settings, f"reader {uuid4()}", ("read", "studies:write"))["token"]
    headers = {"Authorization": f"Bearer {token}"}
    answer = httpx.put(f"{server}/api/v1/{path}", json={"reason": "slept"}, headers=headers)
    assert answer.status_code == 403
    assert "participants:write" in answer.json()["detail"]


def test_a_cookie_changes_nothing_without_the_forms_token(experimenter: Any, taken: dict[str, Any]) -> None:
    path = f"/api/v1/studies/{taken['slug']}/state"
    assert experimenter.put(path, json={"state": "open"}).status_code == 403
    headers = {"X-CSRF-Token": experimenter.form_token}
    assert experimenter.put(path, json={"state": "open"}, headers=headers).status_code == 200


@pytest.mark.slow
def test_the_page_of_the_interface_shows_every_route(client: httpx.Client) -> None:
    page = client.get("/docs")
    described = client.get("/api/v1/openapi.json").json()
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            assert f'id="{operation["operationId"]}"' in page.text, (method, path)
    assert "curl -X DELETE" in page.text
    assert "<script" not in page.text
    assert "style=" not in page.text
