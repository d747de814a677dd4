"""What cannot be stored is refused at the server's door; what was stored before there was one can be read."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from app.settings import Settings
from app.simulation.participants import begin
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.studies.audit import Entry, audit_records, record
from tests.app.web.admin.dashboard_client import Dashboard
from tests.app.web.http_checks import is_problem

JSON = {"Content-Type": "application/json"}
COMPLETE = "/api/v1/session/stages/introduction"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (rb'{"data": {"language": "\ud800"}}', "data.language holds half of a character"),
        (rb'{"data": {"language": "e\u0000n"}}', "data.language holds a NUL character"),
        (b'{"data": {"deep": ' + 30 * b"[" + 30 * b"]" + b"}}", "more than 16 lists within one another"),
    ],
    ids=["surrogate", "nul", "deep"],
)
def test_an_answer_that_cannot_be_stored_is_refused(
    client: httpx.Client, study: dict[str, Any], content: bytes, told: str
) -> None:
    opened = client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": study["invitation"]}).json()
    answer = client.put(COMPLETE, content=content, headers=JSON)
    assert is_problem(answer, 422)
    assert told in answer.json()["detail"]
    assert client.get("/api/v1/session").json()["stage"] == opened["stage"]


def test_a_body_too_deep_to_be_read_is_refused(participant: httpx.Client) -> None:
    content = b'{"data": ' + 50_000 * b"[" + 50_000 * b"]" + b"}"
    assert is_problem(participant.put(COMPLETE, content=content, headers=JSON), 400)


def test_a_body_too_deep_to_be_read_is_refused_where_none_is_expected(client: httpx.Client) -> None:
    answer = client.request("GET", "/api/v1/session", content=50_000 * b"[", headers=JSON)
    assert is_problem(answer, 422)


def test_a_name_with_a_nul_character_is_refused(experimenter: Dashboard, study: dict[str, Any]) -> None:
    answer = experimenter.act(f"/admin/studies/{study['slug']}/duplicate", name="Twin\0")
    assert answer.status_code == 422
    assert "name holds a NUL character" in answer.text


def test_every_value_of_a_field_that_is_sent_twice_is_looked_at(experimenter: Dashboard, study: dict[str, Any]) -> None:
    answer = experimenter.act(f"/admin/studies/{study['slug']}/duplicate", name=["Twin\0", "Twin"])
    assert answer.status_code == 422
    assert "name holds a NUL character" in answer.text


def test_a_form_in_parts_passes_the_same_gate(experimenter: Dashboard, study: dict[str, Any]) -> None:
    for field, told in (
        ({"name": "Twin\0"}, "name holds a NUL character"),
        ({"nam": "Twin"}, "no field &#39;nam&#39;"),
    ):
        parts = {name: (None, text) for name, text in {"form_token": experimenter.form_token, **field}.items()}
        answer = experimenter.post(f"/admin/studies/{study['slug']}/duplicate", files=parts)
        assert answer.status_code == 422
        assert told in answer.text


@pytest.mark.slow
def test_a_study_that_holds_unreadable_text_can_still_be_read_and_exported(
    client: httpx.Client,
    settings: Settings,
    new_study: Callable[[], dict[str, Any]],
    analyst: httpx.Client,
    experimenter: Dashboard,
) -> None:
    study = new_study()
    begin(client, study["slug"], study["invitation"])
    database = open_database(settings.url)
    with database.writing() as connection:
        stored = r'{"language": "en", "odd": "a\ud800b"}'
        changed = connection.execute(text("UPDATE stage_record SET data = :data"), {"data": stored}).rowcount
    database.dispose()
    assert changed > 0
    page = experimenter.get(f"/admin/studies/{study['slug']}/participants/P001")
    assert page.status_code == 200
    for kind in ("json", "csv", "parquet"):
        answer = analyst.get(f"/api/v1/studies/{study['slug']}/participants?format={kind}")
        assert answer.status_code == 200
    archive = analyst.get(f"/api/v1/studies/{study['slug']}/archive.zip")
    assert zipfile.ZipFile(io.BytesIO(archive.content)).testzip() is None


def test_a_form_with_a_field_that_it_does_not_have_does_nothing(experimenter: Dashboard, study: dict[str, Any]) -> None:
    """A misspelt field would be dropped without a word, and its default be used."""
    base = f"/admin/studies/{study['slug']}"
    before = experimenter.get(f"{base}/invitations").text.count("/qr.svg")
    refused = experimenter.act(f"{base}/invitations", place="1")
    assert refused.status_code == 422
    assert "This form has no field" in refused.text
    assert experimenter.get(f"{base}/invitations").text.count("/qr.svg") == before
    assert experimenter.act("/admin/work/new/import-films", films="none", nmae="x").status_code == 422


def test_what_no_file_can_hold_never_reaches_the_audit_log(
    client: httpx.Client, settings: Settings, experimenter: Dashboard, study: dict[str, Any]
) -> None:
    assert experimenter.get(f"/admin/studies/{study['slug']}/participants/a%00b").status_code == 404
    client.get("/api/v1/studies", headers={"Authorization": "Bearer wrong", "X-Other": "1"})
    database = open_database(settings.url)
    with database.writing() as connection:
        record(connection, "E\0va", Entry("tried", subject="a\ud800b", detail={"n\0": ["c\0d"]}), utc_now())
    with database.reading() as connection:
        entries = audit_records(connection)
    database.dispose()
    told = json.dumps(entries, default=str)
    assert "\\u0000" not in told
    assert "\\ud800" not in told
    assert (entries[0]["actor"], entries[0]["subject"], entries[0]["detail"]) == (
        "E\ufffdva",
        "a\ufffdb",
        {"n\ufffd": ["c\ufffdd"]},
    )
