"""Whatever cannot be done is refused with a sentence, the right status and a line in the log, and nothing is lost."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from app.operations.studies import manage
from app.settings import Settings
from app.simulation.participants import begin
from tests.app.web.admin.dashboard_client import signed_in
from tests.app.web.http_checks import is_problem

VoteBody = Callable[..., dict[str, Any]]
NewStudy = Callable[[], dict[str, Any]]
ELSEWHERE = {"X-Forwarded-For": "192.0.2.7"}  # other tests' refusals may fill what is noted of this address


def sessions(study: dict[str, Any]) -> str:
    return f"/api/v1/studies/{study['slug']}/sessions"


def is_refused(answer: httpx.Response, status: int, sentence: str, log: str) -> bool:
    return is_problem(answer, status) and sentence in answer.json()["detail"] and f"refused: {status} {sentence}" in log


def test_an_unknown_invitation(client: httpx.Client, study: dict[str, Any], caplog: pytest.LogCaptureFixture) -> None:
    answer = client.post(sessions(study), json={"invitation": "nobodys"})
    assert is_refused(answer, 404, "There is no such invitation.", caplog.text)
    page = client.get("/s/nobodys")
    assert page.status_code == 404
    assert "We do not know this invitation" in page.text
    assert "an invitation's page was refused: unknown" in caplog.text
    assert "nobodys" not in caplog.text


def test_a_used_invitation_or_a_study_that_is_full(
    client: httpx.Client, study: dict[str, Any], settings: Settings, server: str, caplog: pytest.LogCaptureFixture
) -> None:
    code = manage.add_invitation(settings, study["slug"], places=1)["invitation"]
    assert client.post(sessions(study), json={"invitation": code}).status_code == 201
    answer = httpx.post(server + sessions(study), json={"invitation": code})
    assert is_refused(answer, 410, "This invitation has been used.", caplog.text)
    page = httpx.get(f"{server}/s/{code}")
    assert page.status_code == 410
    assert "This invitation has already been used" in page.text
    assert "an invitation's page was refused: used" in caplog.text


@pytest.mark.slow
def test_a_study_that_is_closed(
    client: httpx.Client,
    new_study: NewStudy,
    settings: Settings,
    server: str,
    vote_body: VoteBody,
    caplog: pytest.LogCaptureFixture,
) -> None:
    study = new_study()
    begin(client, study["slug"], study["invitation"])
    with signed_in(server, settings, "Ada") as ada:
        ada.act(f"/admin/studies/{study['slug']}/state", state="closed")
        answer = httpx.post(server + sessions(study), json={"invitation": study["invitation"]}, headers=ELSEWHERE)
        assert is_refused(answer, 403, "This study is closed.", caplog.text)
        assert "This study is closed." in ada.get("/admin/audit?search=not+taken+in").text
    page = httpx.get(f"{server}/s/{study['invitation']}", headers=ELSEWHERE)
    assert page.status_code == 403
    assert "This study is closed" in page.text
    with signed_in(server, settings, "Ada") as ada:
        entries = ada.get("/api/v1/audit?search=not+taken+in").json()
    assert [entry["detail"]["reason"] for entry in entries[:2]] == [
        "invitation closed",
        "This study is closed. Thank you for your interest.",
    ]
    trial = client.get("/api/v1/session/trials/next").json()  # who has begun goes on
    assert client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial)).status_code == 201


def test_a_vote_for_somebody_elses_trial(
    participant: httpx.Client,
    study: dict[str, Any],
    server: str,
    vote_body: VoteBody,
    caplog: pytest.LogCaptureFixture,
) -> None:
    trial = participant.get("/api/v1/session/trials/next").json()
    path = f"/api/v1/session/trials/{trial['trial']}/vote"
    with httpx.Client(base_url=server) as other:
        begin(other, study["slug"], study["invitation"])
        answer = other.put(path, json=vote_body(trial))
        assert is_refused(answer, 404, "This session has no such trial.", caplog.text)
    assert participant.put(path, json=vote_body(trial)).status_code == 201


def test_a_vote_after_withdrawal(
    client: httpx.Client, study: dict[str, Any], vote_body: VoteBody, caplog: pytest.LogCaptureFixture
) -> None:
    begin(client, study["slug"], study["invitation"])
    trial = client.get("/api/v1/session/trials/next").json()
    with caplog.at_level(logging.INFO):
        client.put("/api/v1/session/withdrawal")
    assert ": withdrawn" in caplog.text
    answer = client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial))
    assert is_refused(answer, 410, "You have withdrawn from the study", caplog.text)


def test_a_film_that_could_not_be_shown_is_logged(participant: httpx.Client, caplog: pytest.LogCaptureFixture) -> None:
    trial = participant.get("/api/v1/session/trials/next").json()["trial"]
    path = f"/api/v1/session/trials/{trial}/trouble"
    assert participant.put(path, json={"why": "the film\nstands still"}).status_code == 204
    assert "the film of a trial was not shown" in caplog.text
    assert "stands still" not in caplog.text  # a browser's words stand at the alarm, where they can be erased
    assert is_problem(participant.put(path, json={"why": "x" * 301}), 422)


def test_a_browser_that_was_turned_away_is_logged_and_uses_nothing_up(
    client: httpx.Client, study: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    path = f"/api/v1/studies/{study['slug']}/turned-away"
    answer = client.post(path, json={"invitation": study["invitation"]}, headers={"User-Agent": "Old Browser"})
    assert answer.status_code == 204
    assert f"study {study['slug']}: turned away (films): 'Old Browser'" in caplog.text
    assert client.post(path, json={"invitation": study["invitation"], "why": "cookies"}).status_code == 204
    assert "turned away (cookies)" in caplog.text
    assert is_problem(client.post(path, json={"invitation": "nobodys"}), 404)


def test_forged_ids_and_used_invitations_leave_an_entry(
    participant: httpx.Client, study: dict[str, Any], settings: Settings, server: str, vote_body: VoteBody
) -> None:
    code = manage.add_invitation(settings, study["slug"], places=1)["invitation"]
    for _ in range(2):
        httpx.post(server + sessions(study), json={"invitation": code}, headers=ELSEWHERE)
    body = vote_body({"first_shown": "a"})
    forged = participant.put("/api/v1/session/trials/no-such-trial/vote", json=body, headers=ELSEWHERE)
    assert forged.status_code == 404
    with signed_in(server, settings, "Auditor", "experimenter") as dashboard:
        dashboard.headers.update(ELSEWHERE)
        base = f"/admin/studies/{study['slug']}"
        assert dashboard.get(f"{base}/participants/P999").status_code == 404
        assert dashboard.get(f"{base}/invitations/of-another-study/qr.svg").status_code == 404
        log = dashboard.get("/admin/audit?search=not+found").text
    assert "P999" in log
    assert "Auditor" in log
    assert "no-such-trial" in log
    assert "This invitation has been used." in log
    assert code not in log
    assert "of-another-study" not in log
