"""Errors, headers and limits that hold for every address."""

from __future__ import annotations

import errno
import logging
import re
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest

from app.main import create_app
from app.settings import Settings
from app.web.security import is_foreign
from tests.app.web.http_checks import ask, is_problem


@pytest.mark.parametrize("path", ["/api/v1/nothing", "/media/nothing", "/nothing", "/static/nothing.css"])
def test_an_unknown_address_is_a_problem(client: httpx.Client, path: str) -> None:
    assert is_problem(client.get(path), 404)


@pytest.mark.parametrize("method", ["DELETE", "TRACE"])
@pytest.mark.parametrize("path", ["/api/v1/session", "/healthz", "/media/x"])
def test_a_wrong_method_is_a_problem(client: httpx.Client, path: str, method: str) -> None:
    answer = client.request(method, path)
    assert is_problem(answer, 405)
    assert "GET" in answer.headers["allow"]


@pytest.mark.parametrize("path", ["/", "/healthz", "/readyz"])
def test_head_tells_of_a_page_what_get_would(client: httpx.Client, path: str) -> None:
    """Monitors and checks of links ask so."""
    read, asked = client.get(path), client.head(path)
    assert (asked.status_code, asked.content) == (200, b"")
    assert asked.headers["content-length"] == str(len(read.content))
    assert asked.headers["content-type"] == read.headers["content-type"]


def test_a_person_reads_a_page_instead(client: httpx.Client) -> None:
    answer = client.get("/nothing", headers={"Accept": "text/html"})
    assert answer.status_code == 404
    assert answer.headers["content-type"].startswith("text/html")
    assert "There is nothing at this address." in answer.text
    assert "<h1>Not found</h1>" in answer.text
    assert 'href="/"' in answer.text


def test_a_page_of_the_dashboard_that_is_refused_leads_on_to_the_studies(client: httpx.Client) -> None:
    answer = client.get("/admin/nothing", headers={"Accept": "text/html"})
    assert answer.status_code == 404
    assert 'href="/admin"' in answer.text


@pytest.mark.parametrize(
    ("path", "sent", "at", "message"),
    [
        ("sessions", {}, "body.invitation", "is missing"),
        ("sessions", {"invitation": "a/b"}, "body.invitation",
         "is 'a/b', expected a text of at most 40 characters that matches ^[A-Za-z0-9_-]+$"),
        ("sessions", {"invitation": "a", "key": "1"}, "body.key", "is '1', expected a UUID in lower case"),
        ("sessions", {"invitation": "a", "lang": "de"}, "body.lang",
         "is unknown, expected one of invitation, key, outside, language, texts_sha256"),
        ("sessions", [], "body", "is [], expected an object with keys"),
        ("turned-away", {"invitation": "a", "why": "x"}, "body.why",
         "is 'x', expected one of films, cookies, phone, screen, full_screen"),
    ],
)  # fmt: skip
def test_a_wrong_request_is_told_in_the_words_of_all_refusals(
    client: httpx.Client, path: str, sent: Any, at: str, message: str
) -> None:
    answer = client.post(f"/api/v1/studies/x/{path}", json=sent)
    assert is_problem(answer, 422)
    assert answer.json()["errors"] == [{"at": at, "message": message}]
    assert answer.json()["detail"] == f"The request is not as described: {at} {message}."


@pytest.mark.slow
def test_a_full_disk_is_told_as_such_and_any_other_error_of_the_system_is_not(tmp_path: Path) -> None:
    app = create_app(Settings(data_dir=tmp_path))

    @app.get("/api/v1/fails/{number}")
    def fails(number: int) -> None:
        raise OSError(number, "secret detail")

    full = ask(app, f"/api/v1/fails/{errno.ENOSPC}")
    assert is_problem(full, 507)
    assert "disk is full" in full.text
    assert is_problem(ask(app, f"/api/v1/fails/{errno.EIO}"), 500)


def test_a_server_without_room_for_votes_is_not_ready(client: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: SimpleNamespace(free=3 * 2**20))
    answer = client.get("/readyz")
    assert is_problem(answer, 503)
    assert "3 MB free, expected 16" in answer.text


@pytest.mark.slow
@pytest.mark.parametrize("accept", ["application/json", "text/html"])
def test_who_comes_while_no_file_can_be_opened_is_asked_to_come_again(tmp_path: Path, accept: str) -> None:
    app = create_app(Settings(data_dir=tmp_path))

    @app.get("/crowded")
    def crowded() -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    answer = ask(app, "/crowded", {"Accept": accept})
    assert answer.status_code == 503
    assert int(answer.headers["retry-after"]) > 0
    assert "too many at once" in answer.text
    assert "content-security-policy" in answer.headers


@pytest.mark.slow
def test_what_nobody_foresaw_is_logged_and_not_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    app = create_app(Settings(data_dir=tmp_path))

    @app.get("/api/v1/broken")
    def broken() -> None:
        raise RuntimeError("secret detail")

    with caplog.at_level(logging.ERROR):
        answer = ask(app, "/api/v1/broken")
    assert is_problem(answer, 500)
    assert "secret" not in answer.text
    assert "secret detail" in caplog.text
    assert "content-security-policy" in answer.headers


@pytest.mark.parametrize("path", ["/", "/healthz", "/static/css/tokens.css", "/api/v1/nothing", "/admin"])
def test_every_answer_carries_security_headers(client: httpx.Client, path: str) -> None:
    headers = client.get(path).headers
    is_data = path.startswith("/api/")
    policy = dict(part.split(" ", 1) for part in headers["content-security-policy"].split("; "))
    closed = ("default-src", "frame-ancestors") if is_data else ("object-src", "base-uri", "frame-ancestors")
    assert {name: policy.pop(name) for name in closed} == dict.fromkeys(closed, "'none'")
    assert is_data or {"default-src", "form-action"} <= policy.keys()
    assert [name for name, sources in policy.items() if not set(sources.split()) <= {"'self'", "blob:"}] == []
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"
    assert headers["cross-origin-resource-policy"] == "same-origin"
    assert headers.get("referrer-policy") == headers.get("cross-origin-opener-policy")
    assert headers.get("referrer-policy") == (None if is_data else "same-origin")
    assert "server" not in headers


def test_no_page_has_inline_script_or_style(client: httpx.Client) -> None:
    templates = Path(__file__).parents[3] / "templates"
    for template in (*templates.glob("*.html"), *templates.glob("admin/*.html"), *templates.glob("participant/*.html")):
        text = template.read_text(encoding="utf-8")
        inline = re.findall(r"<script(?![^>]*\bsrc=)[^>]*>|<style|\sstyle=|\son[a-z]+=", text)
        assert [tag for tag in inline if 'type="application/json"' not in tag] == [], template.name
    assert client.get("/").status_code == 200


def test_no_script_of_a_page_names_a_command() -> None:
    for script in (Path(__file__).parents[3] / "static" / "js").glob("*.js"):
        named = re.findall(r'"[^"\n]*`(?:reconstudy |capture |study |stimuli |validate )[^"\n]*"', script.read_text())
        assert named == [], script.name


@pytest.mark.parametrize(
    ("headers", "expected"),
    [
        ({}, False),
        ({"sec-fetch-site": "same-origin"}, False),
        ({"sec-fetch-site": "none"}, False),
        ({"sec-fetch-site": "cross-site"}, True),
        ({"sec-fetch-site": "same-site"}, True),
        ({"origin": "http://here:1", "host": "here:1"}, False),
        ({"origin": "http://there", "host": "here:1"}, True),
        ({"origin": "null", "host": "here:1"}, True),
    ],
)
def test_what_another_site_asks_for_is_foreign(headers: dict[str, str], expected: bool) -> None:
    assert is_foreign({name.lower().encode(): value.encode() for name, value in headers.items()}) is expected


def test_another_site_cannot_act_for_a_participant(participant: httpx.Client) -> None:
    path = "/api/v1/session/stages/introduction"
    assert is_problem(participant.put(path, json={"data": {}}, headers={"Sec-Fetch-Site": "cross-site"}), 403)
    assert participant.get("/api/v1/session", headers={"Sec-Fetch-Site": "cross-site"}).status_code == 200


def test_a_form_cannot_pass_for_json(participant: httpx.Client) -> None:
    for kind in ({"Content-Type": "text/plain"}, {}):  # which browsers send to other sites unasked
        answer = participant.put("/api/v1/session/stages/introduction", content=b'{"data": {}}', headers=kind)
        assert is_problem(answer, 422)


def test_health_and_readiness_are_told(client: httpx.Client) -> None:
    assert client.get("/healthz").json() == {"status": "ok"}
    assert client.get("/readyz").json() == {"status": "ready"}


def test_the_api_describes_itself(client: httpx.Client) -> None:
    description = client.get("/api/v1/openapi.json").json()
    assert description["openapi"].startswith("3.1")
    assert "/api/v1/session/trials/{trial}/vote" in description["paths"]
    assert not [path for path in description["paths"] if not path.startswith("/api/v1/")]
    assert client.get("/redoc").status_code == 404
