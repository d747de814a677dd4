"""A vote over HTTP: once, whole, and by its owner."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import httpx
import pytest

from tests.app.web.http_checks import is_problem

VoteBody = Callable[..., dict[str, Any]]


@pytest.fixture
def trial(participant: httpx.Client) -> dict[str, Any]:
    trial: dict[str, Any] = participant.get("/api/v1/session/trials/next").json()
    return trial


def path(trial: dict[str, Any]) -> str:
    return f"/api/v1/session/trials/{trial['trial']}/vote"


@pytest.mark.slow
def test_a_vote_that_is_sent_again_gets_the_same_answer(
    participant: httpx.Client, trial: dict[str, Any], vote_body: VoteBody
) -> None:
    body = vote_body(trial)
    first, second = (participant.put(path(trial), json=body) for _ in range(2))
    assert (first.status_code, second.status_code) == (201, 200)
    assert first.json() == second.json()
    assert first.json()["id"] == body["id"]
    assert participant.get("/api/v1/session").json()["progress"]["done"] == 1


def test_null_says_as_much_as_leaving_out(
    participant: httpx.Client, trial: dict[str, Any], vote_body: VoteBody
) -> None:
    body, other = vote_body(trial), "b" if trial["first_shown"] == "a" else "a"
    seen = switch(other, 1.0)
    viewing = body["viewing"] | {"switches": [seen], "dwell_ms": {"a": 1.0, "b": 2.0}}
    with_nulls = viewing | {
        "switches": [seen | {"frame": None}],
        "dwell_ms": {"a": 1.0, "b": 2.0, "reference": None},
        "display": None,
        "n_stalls": None,
    }
    assert participant.put(path(trial), json=body | {"viewing": with_nulls}).status_code == 201
    assert participant.put(path(trial), json=body | {"viewing": viewing}).status_code == 200


def test_another_body_or_a_second_id_is_a_conflict(
    participant: httpx.Client, trial: dict[str, Any], vote_body: VoteBody
) -> None:
    body = vote_body(trial)
    participant.put(path(trial), json=body)
    assert is_problem(participant.put(path(trial), json=body | {"choice": "b"}), 409)
    longer = body["viewing"] | {"shown_ms": 401.0}
    assert is_problem(participant.put(path(trial), json=body | {"viewing": longer}), 409)
    assert is_problem(participant.put(path(trial), json=vote_body(trial)), 409)


def test_an_invented_trial_is_not_found(participant: httpx.Client, trial: dict[str, Any], vote_body: VoteBody) -> None:
    assert is_problem(participant.put("/api/v1/session/trials/invented/vote", json=vote_body(trial)), 404)
    assert is_problem(participant.put(f"/api/v1/session/trials/{'x' * 33}/vote", json=vote_body(trial)), 422)


def switch(to: str, at_ms: float, media_time_s: float = 0.0) -> dict[str, Any]:
    return {"to": to, "at_ms": at_ms, "media_time_s": media_time_s}


@pytest.mark.parametrize(
    "changes",
    [
        {"choice": "c"},
        {"choice": None},
        {"choice": True},
        {"id": "not-a-uuid"},
        {"id": 1},
        {"id": "6F1C2E0A-6D3B-4F5E-9A51-0C6B7F3D2E18"},
        {"extra": 1},
        {"viewing": None},
        {"viewing": {}},
        {"shown_ms": -1},
        {"shown_ms": True},
        {"shown_ms": "1"},
        {"shown_ms": 10**24},
        {"response_ms": math.nan},
        {"response_ms": math.inf},
        {"first_shown": "c"},
        {"more": 1},
        {"switches": [switch("c", 1)]},
        {"switches": [switch("b", 1) | {"more": 1}]},
        {"switches": [{"to": "b"}]},
        {"switches": [switch("a", 1, -1.0)]},
        {"switches": [switch("a", 1)] * 2001},
    ],
)
def test_bad_values_are_refused_and_nothing_is_kept(
    participant: httpx.Client, trial: dict[str, Any], vote_body: VoteBody, changes: dict[str, Any]
) -> None:
    body = vote_body(trial)
    outer = {key: value for key, value in changes.items() if key in ("id", "choice", "viewing", "extra")}
    inner = {key: value for key, value in changes.items() if key not in outer}
    body |= outer if outer else {"viewing": body["viewing"] | inner}
    assert is_problem(put_json(participant, path(trial), body), 422)
    assert participant.get("/api/v1/session").json()["progress"]["done"] == 0


def test_switches_must_alternate_from_what_was_shown_first(
    participant: httpx.Client, trial: dict[str, Any], vote_body: VoteBody
) -> None:
    same, other = trial["first_shown"], "b" if trial["first_shown"] == "a" else "a"
    body = vote_body(trial)

    def answer(*switches: dict[str, Any]) -> httpx.Response:
        return participant.put(path(trial), json=body | {"viewing": body["viewing"] | {"switches": list(switches)}})

    assert is_problem(answer(switch(same, 1.0)), 422)
    assert is_problem(answer(switch(other, 2.0), switch(same, 1.0)), 422)
    assert answer(switch(other, 1.0), switch(same, 2.5)).status_code == 201


def test_a_vote_keeps_how_it_was_come_to(
    participant: httpx.Client,
    trial: dict[str, Any],
    vote_body: VoteBody,
    analyst: httpx.Client,
    study: dict[str, Any],
) -> None:
    other = "b" if trial["first_shown"] == "a" else "a"
    body = vote_body(trial, choice="none")
    body["viewing"]["switches"] = [switch(other, 123.4, 0.12)]
    participant.put(path(trial), json=body)
    session = participant.get("/api/v1/session").json()["session"]
    rows = analyst.get(f"/api/v1/studies/{study['slug']}/trials", params={"session": session}).json()
    assert len(rows) == 6
    row = next(row for row in rows if row["trial"] == trial["trial"])
    assert row["viewing"] == body["viewing"]
    assert (row["choice"], row["n_switches"], row["shown_ms"], row["response_ms"]) == ("none", 1, 400.5, 900.0)
    assert row["first_shown"] == row[f"item_{trial['first_shown']}"]
    assert row["served_at"] <= row["voted_at"]


@pytest.mark.parametrize(
    ("content", "statuses"),
    [
        (b"", {422}),
        (b"{", {422}),
        (b"\xff", {400}),
        (b'{"id": ' + b"[" * 5000, {400, 422}),  # some Pythons read so deep
    ],
)
def test_a_body_that_is_not_json_is_refused(
    participant: httpx.Client, trial: dict[str, Any], content: bytes, statuses: set[int]
) -> None:
    headers = {"Content-Type": "application/json"}
    answer = participant.put(path(trial), content=content, headers=headers)
    assert answer.status_code in statuses
    assert is_problem(answer, answer.status_code)
    assert "body" in answer.json()["detail"]


def test_a_body_that_does_not_say_that_it_is_json_is_refused(
    participant: httpx.Client, trial: dict[str, Any], vote_body: VoteBody
) -> None:
    content = json.dumps(vote_body(trial)).encode()
    for headers in ({}, {"Content-Type": "text/plain"}):
        answer = participant.put(path(trial), content=content, headers=headers)
        assert is_problem(answer, 422)
        assert [error["at"] for error in answer.json()["errors"]] == ["body"]
    headers = {"Content-Type": "Application/JSON; charset=utf-8"}
    assert participant.put(path(trial), content=content, headers=headers).status_code == 201


def test_a_huge_body_is_refused(participant: httpx.Client, trial: dict[str, Any]) -> None:
    headers = {"Content-Type": "application/json"}
    assert is_problem(participant.put(path(trial), content=b" " * 300_000, headers=headers), 413)


def put_json(client: httpx.Client, path: str, body: dict[str, Any]) -> httpx.Response:
    """As a careless client would: Python's json writes NaN and Infinity, which httpx refuses."""
    return client.put(path, content=json.dumps(body).encode(), headers={"Content-Type": "application/json"})
