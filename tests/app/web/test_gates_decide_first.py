"""Whoever may not see a study learns nothing of it by invalid values, in production as anywhere."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.main import create_app, running_server
from app.operations.studies import create, manage
from app.settings import Settings
from app.store.access.rights import SCOPES
from app.web.roles import AStudy
from tests.app.web.http_checks import all_routes, ask

pytestmark = pytest.mark.slow

PUBLIC_URL = "https://study.example.org"
LONG = 5000 * "x"
MADE_UP = "no-such-study"
BODIES: list[dict[str, Any]] = [
    {"content": b"{", "headers": {"Content-Type": "application/json"}},
    {"content": b"[[]]", "headers": {"Content-Type": "application/json"}},
    {"content": b"form_token=%ED%A0%80&form_token=" + LONG.encode(), "headers": {"Content-Type": "text/plain"}},
]


@pytest.fixture(scope="module")
def in_production(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return Settings(
        data_dir=tmp_path_factory.mktemp("production"), public_url=PUBLIC_URL, api_requests_per_minute=10**6
    )


@pytest.fixture(scope="module")
def studies(in_production: Settings, production: str, stimulus_set: Path) -> tuple[str, str]:
    """One to see, and another."""
    assert production  # whose database it has made
    mine, other = (create.create_study(in_production, stimulus_set, name, exposure_s=0.4) for name in ("Mine", "Other"))
    return mine["slug"], other["slug"]


@pytest.fixture(scope="module")
def production(in_production: Settings) -> Iterator[str]:
    manage.upgrade_database(in_production)
    with running_server(in_production) as url:
        yield url


def routes_of_studies(settings: Settings) -> list[Any]:
    app = create_app(settings)
    app.state.database.dispose()
    return [route for route in all_routes(app.routes) if "{slug}" in route.path]


def names_read(dependant: Any, kind: str) -> set[str]:
    """Names of all values of a kind (header, query, body) that a route and what it depends on read."""
    below = (names_read(other, kind) for other in dependant.dependencies)
    return {field.alias for field in getattr(dependant, f"{kind}_params")}.union(*below)


def invalid_requests(route: Any) -> Iterator[dict[str, Any]]:
    """Requests whose headers, forms, queries and bodies are invalid wherever a route or its gates read any."""
    long = {kind: dict.fromkeys(names_read(route.dependant, kind), LONG) for kind in ("header", "query", "body")}
    headers, params = long["header"] | {"X-CSRF-Token": LONG, "Session-Id": LONG}, long["query"]
    form = long["body"] | {"form_token": LONG}
    yield {"headers": headers, "params": params, "data": form}
    yield {"headers": headers, "params": params, "files": dict.fromkeys(form, ("name.txt", b"text"))}
    for body in BODIES:
        yield {"params": params, **body, "headers": headers | body["headers"]}


def answer_to(client: httpx.Client, method: str, route: Any, slug: str, asked: dict[str, Any]) -> tuple[int, str]:
    path = re.sub(r"\{[^}]*\}", 300 * "x", route.path.replace("{slug}", slug))
    answer = client.request(method, path, **asked)
    return answer.status_code, answer.text.replace(slug, "SLUG")


@pytest.mark.parametrize("who", ["nobody", "the bearer of another study's token"])
def test_a_study_that_one_may_not_see_answers_as_one_that_is_not_there(
    who: str, production: str, in_production: Settings, studies: tuple[str, str]
) -> None:
    mine, other = studies
    token = manage.add_token(in_production, f"{who} of {mine}", list(SCOPES), [mine])["token"]
    identity = {} if who == "nobody" else {"Authorization": f"Bearer {token}"}
    routes = routes_of_studies(in_production)
    assert len(routes) > 60
    with httpx.Client(base_url=production, headers=identity, timeout=60) as client:
        for route in routes:
            for method in sorted(route.methods - {"HEAD"}):
                for asked in invalid_requests(route):
                    status, text = answer_to(client, method, route, other, asked)
                    assert status < 500, (method, route.path, asked.keys(), text)
                    made_up = answer_to(client, method, route, MADE_UP, asked)
                    assert (status, text) == made_up, (method, route.path, asked.keys())


def test_a_route_that_was_given_no_gate_shows_no_study(in_production: Settings, studies: tuple[str, str]) -> None:
    app = create_app(in_production)

    @app.get("/forgotten/{slug}")
    def forgotten(study: AStudy) -> str:
        return study.name

    answer = ask(app, f"/forgotten/{studies[0]}", {"Host": "study.example.org"})
    app.state.database.dispose()
    assert answer.status_code == 401
    assert "Mine" not in answer.text


def test_log_and_metrics_name_the_route_behind_a_public_address(
    production: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", logger="app.web.monitoring.request_log")
    httpx.get(f"{production}/admin/studies/{MADE_UP}")
    assert "/admin/studies/{slug}: 401" in caplog.text
    assert 'route="/admin/studies/{slug}"' in httpx.get(f"{production}/metrics").text
