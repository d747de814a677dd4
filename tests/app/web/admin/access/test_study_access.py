"""Who may see some studies only sees and changes nothing of the others, by any address."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest

from app.errors import ConflictError, NotFoundError
from app.main import create_app
from app.operations.studies import manage
from app.settings import Settings
from app.store.access.rights import SCOPES
from tests.app.web.admin.dashboard_client import Dashboard, ends, signed_in
from tests.app.web.http_checks import all_routes

pytestmark = pytest.mark.slow

NewStudy = Callable[[], dict[str, Any]]
NOBODYS = r"/admin/(setup/|login/|sign-in)|/api/v1/(studies/\{slug\}/(sessions|turned-away)|session|openapi)"
TASKS = r"(/admin/(tasks|jobs)|/api/v1/tasks)/\{task\}(/cancel)?"
EVERYBODYS = rf"(GET|POST) /admin(/account.*|/logout|/manual.*|/studies)?|GET /api/v1/studies|\w+ {TASKS}"


def gated_routes(settings: Settings) -> list[tuple[str, str]]:
    """All routes that take an experimenter or a token."""
    app = create_app(settings)
    app.state.database.dispose()
    paths = [route for route in all_routes(app.routes) if re.match("/admin|/api/v1/", route.path)]
    return [
        (method, route.path)
        for route in paths
        if not re.match(NOBODYS, route.path)
        for method in sorted(route.methods - {"HEAD"})
    ]


@pytest.fixture(scope="module")
def studies(new_study: NewStudy) -> tuple[str, str]:
    """One to see, and another."""
    return new_study()["slug"], new_study()["slug"]


@pytest.fixture
def guest(server: str, settings: Settings, studies: tuple[str, str]) -> Iterator[Dashboard]:
    """An experimenter who sees the first study."""
    with signed_in(server, settings, "Gustav Guest", "experimenter") as dashboard:
        dashboard.enter(manage.add_experimenter(settings, "Gustav Guest", None, [studies[0]])["path"])
        yield dashboard


def test_every_route_of_another_study_is_unknown_and_what_is_of_none_is_refused(
    server: str, settings: Settings, guest: Dashboard, studies: tuple[str, str]
) -> None:
    mine, other = studies
    by_form = {"X-CSRF-Token": guest.form_token, "Accept": "application/json"}
    token = manage.add_token(settings, f"guest of {mine}", list(SCOPES), [mine])["token"]
    by_token = {"Authorization": f"Bearer {token}"}
    routes = gated_routes(settings)
    assert len(routes) > 120
    with httpx.Client(base_url=server, timeout=60) as bearer:
        for method, path in routes:
            if re.fullmatch(EVERYBODYS, f"{method} {path}"):
                continue
            is_of_study = "{slug}" in path and not path.endswith("/duplicate")
            needs_owner = re.match("/admin/(users|tokens|settings)", path)
            asked = re.sub(r"\{[^}]*\}", "x", path.replace("{slug}", other))
            answer = guest.request(method, asked, headers=by_form)
            assert answer.status_code == (404 if is_of_study else 403), (method, path, answer.text)
            if is_of_study:
                assert answer.json()["detail"] == "There is no such study.", (method, path)
            elif not needs_owner:
                assert "some studies only" in answer.json()["detail"], (method, path)
            if path.startswith("/api/"):
                status = bearer.request(method, asked, headers=by_token).status_code
                assert status == (404 if is_of_study else 403), (method, path)


def test_a_guest_works_in_their_study_and_sees_no_other(
    server: str, settings: Settings, guest: Dashboard, studies: tuple[str, str]
) -> None:
    mine, other = studies
    listed = guest.get("/admin").text
    assert f"/admin/studies/{mine}" in listed
    assert f"/admin/studies/{other}" not in listed
    assert "/admin/sets" not in listed
    for page in ("", "/results", "/participants", "/invitations", "/edit", "/design"):
        assert guest.get(f"/admin/studies/{mine}{page}").status_code == 200, page
    guest.act(f"/admin/studies/{mine}/invitations", places="1").raise_for_status()
    token = manage.add_token(settings, f"reader of {mine}", ["read"], [mine])["token"]
    with httpx.Client(base_url=server, headers={"Authorization": f"Bearer {token}"}) as bearer:
        assert [row["slug"] for row in bearer.get("/api/v1/studies").json()] == [mine]
        assert bearer.get(f"/api/v1/studies/{mine}/votes").status_code == 200


def test_a_guest_follows_their_own_work_and_reads_the_manual(
    server: str, settings: Settings, guest: Dashboard, studies: tuple[str, str]
) -> None:
    mine, _ = studies
    assert guest.get("/admin/manual/studies").status_code == 200
    begun = guest.act(f"/admin/studies/{mine}/stimuli")
    assert begun.status_code == 200, begun.text
    ends(guest, begun.url.path)
    assert guest.act(f"{begun.url.path}/cancel").status_code == 200
    names = ("own", "other")
    secrets = [manage.add_token(settings, f"{name} of {mine}", list(SCOPES), [mine])["token"] for name in names]
    own, other = ({"Authorization": f"Bearer {secret}"} for secret in secrets)
    task = httpx.post(f"{server}/api/v1/studies/{mine}/check", headers=own, timeout=60).json()["task"]
    address = f"{server}/api/v1/tasks/{task}"
    assert httpx.get(address, headers=own).json()["study"] == mine
    assert [httpx.request(method, address, headers=other).status_code for method in ("GET", "DELETE")] == [404, 404]
    assert guest.get(f"/admin/tasks/{task}").status_code == 404


def test_access_changes_at_once_and_with_it_that_of_tokens_made_before(
    server: str, settings: Settings, studies: tuple[str, str]
) -> None:
    mine, other = studies
    with (
        signed_in(server, settings, "Olga Owner", "owner") as olga,
        signed_in(server, settings, "Omar", "owner") as omar,
    ):
        made = re.findall(r"<code>([\w-]{40,})</code>", omar.act("/admin/tokens", name="of Omar", scope="read").text)
        omar_reads = {"Authorization": f"Bearer {made[0]}"}
        assert httpx.get(f"{server}/api/v1/studies/{other}/votes", headers=omar_reads).status_code == 200
        assert olga.act("/admin/users/studies", name="Omar", study=mine).status_code == 409
        olga.act("/admin/users/role", name="Omar", role="viewer")
        shown = olga.act("/admin/users/studies", name="Omar", study=mine).text
        assert f"<summary>{mine}</summary>" in shown
        assert omar.get(f"/admin/studies/{other}").status_code == 401  # signed out: it holds at once
        assert httpx.get(f"{server}/api/v1/studies/{other}/votes", headers=omar_reads).status_code == 404
        assert httpx.get(f"{server}/api/v1/studies/{mine}/votes", headers=omar_reads).status_code == 200
        assert olga.act("/admin/users/studies", name="Omar", study="forged").status_code == 404
        manage.add_experimenter(settings, "Omar", None, ["*"])
    assert {row["name"]: row["studies"] for row in manage.list_experimenters(settings)}["Omar"] is None
    with pytest.raises(ConflictError, match="is an owner, who sees all studies"):
        manage.add_experimenter(settings, "Olga Owner", None, [mine])
    with pytest.raises(NotFoundError, match="There is no study 'forged'"):
        manage.add_token(settings, "forged", ["read"], ["forged"])


def test_tokens_do_no_more_than_their_maker_may_and_end_with_their_makers_access(
    server: str, settings: Settings, studies: tuple[str, str]
) -> None:
    path = f"{server}/api/v1/studies/{studies[0]}"
    with (
        signed_in(server, settings, "Olga Owner", "owner") as olga,
        signed_in(server, settings, "Tim", "owner") as tim,
    ):
        page = tim.act("/admin/tokens", name="of Tim", scope=["read", "personal", "audit"]).text
        (secret,) = re.findall(r"<code>([\w-]{40,})</code>", page)
        tim_reads = {"Authorization": f"Bearer {secret}"}
        assert httpx.get(f"{path}/participants", headers=tim_reads).status_code == 200
        olga.act("/admin/users/role", name="Tim", role="viewer")
        assert httpx.get(f"{path}/participants", headers=tim_reads).status_code == 403
        assert httpx.get(f"{path}/votes", headers=tim_reads).status_code == 200
        olga.act("/admin/users/disable", name="Tim")
        assert httpx.get(f"{path}/votes", headers=tim_reads).status_code == 401
        shown = olga.get("/admin/audit?search=access+ended").text
        assert "of Tim" in shown
    assert {row["name"]: row["state"] for row in manage.list_tokens(settings)}["of Tim"] == "revoked"
    manage.add_experimenter(settings, "Tim")
    assert httpx.get(f"{path}/votes", headers=tim_reads).status_code == 401


def test_who_saw_a_deleted_study_does_not_see_another_of_its_name(settings: Settings, new_study: NewStudy) -> None:
    gone = new_study()["slug"]
    manage.add_experimenter(settings, "Last Guest", "viewer", [gone])
    manage.add_token(settings, f"of {gone}", ["read"], [gone])
    manage.remove_study(settings, gone)
    assert {row["name"]: row["studies"] for row in manage.list_experimenters(settings)}["Last Guest"] == ()
    assert {row["name"]: row["studies"] for row in manage.list_tokens(settings)}[f"of {gone}"] == ()
