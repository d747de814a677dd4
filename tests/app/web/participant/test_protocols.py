"""Protocols beside pair comparison: what participants are shown, which answers count, and what analysts read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.ffmpeg import decode
from app.films.strips import GUARD_ROWS
from app.operations.studies import manage
from app.settings import Settings
from app.simulation.participants import begin, simulate
from app.study.options.options import parse_options
from tests.app import tiny_stimuli
from tests.app.web.http_checks import is_problem

pytestmark = pytest.mark.slow

Create = Callable[..., dict[str, Any]]
VoteBody = Callable[..., dict[str, Any]]
QUALITIES = {"id_fa": -1.5, "id_fb": 0.0, "pm_fb": 1.5}
RATED = {
    "ACR": {},
    "ACR-HR": {"reference": "pm_fb"},
    "DCR": {"reference": "pm_fb"},
}


def first_trial(client: httpx.Client, study: dict[str, Any]) -> dict[str, Any]:
    begin(client, study["slug"], study["invitation"])
    trial: dict[str, Any] = client.get("/api/v1/session/trials/next").json()
    return trial


def height_of(client: httpx.Client, url: str, folder: Path) -> int:
    (folder / "film.mp4").write_bytes(client.get(url).content)
    return decode(folder / "film.mp4").height


def put_vote(client: httpx.Client, trial: dict[str, Any], body: dict[str, Any]) -> httpx.Response:
    return client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=body)


def test_acr_shows_each_film_alone_and_takes_a_grade_once(
    client: httpx.Client, analyst: httpx.Client, create: Create, vote_body: VoteBody, tmp_path: Path
) -> None:
    study = create(protocol="ACR")
    assert (study["n_pairs"], study["n_trials"]) == (0, 6)
    trial = first_trial(client, study)
    assert (trial["protocol"], trial["grades"], trial["see_both"]) == ("ACR", {"low": 1, "high": 5}, False)
    assert (trial["media"]["layout"], trial["media"]["reference"], trial["total"]) == ("single", False, 6)
    assert height_of(client, trial["media"]["url"], tmp_path) == tiny_stimuli.HEIGHT
    assert [height_of(client, url, tmp_path) for url in trial["media"]["singles"]] == [tiny_stimuli.HEIGHT]
    body = vote_body(trial, choice=None, rating=4)
    assert [put_vote(client, trial, body).status_code for _ in range(2)] == [201, 200]
    assert is_problem(put_vote(client, trial, body | {"rating": 3}), 409)
    (vote,) = analyst.get(f"/api/v1/studies/{study['slug']}/votes").json()
    assert (vote["protocol"], vote["rating"], vote["choice"], vote["both_seen"]) == ("ACR", 4, None, None)
    assert vote["item_a"] == vote["item_b"]
    header, row = analyst.get(f"/api/v1/studies/{study['slug']}/votes?format=csv").text.splitlines()
    told = dict(zip(header.split(","), row.split(","), strict=True))
    assert (told["rating"], told["choice"], told["protocol"]) == ("4", "", "ACR")


@pytest.mark.parametrize(
    ("options", "wrong"),
    [
        ({"protocol": "ACR"}, [{"rating": 0}, {"rating": 6}, {"rating": 2.5}, {}, {"rating": 3, "choice": "a"}]),
        ({"protocol": "ACR", "scale": 11}, [{"rating": -1}, {"rating": 11}]),
        ({"protocol": "CCR"}, [{"rating": 4}, {"choice": "a"}, {"rating": 1, "choice": "b"}]),
        ({}, [{"rating": 1}, {"choice": "a", "rating": 1}, {}]),
    ],
)
def test_an_answer_of_another_protocol_or_off_the_scale_is_refused(
    client: httpx.Client, create: Create, vote_body: VoteBody, options: dict[str, Any], wrong: list[dict[str, Any]]
) -> None:
    trial = first_trial(client, create(**options))
    for answer in wrong:
        assert is_problem(put_vote(client, trial, vote_body(trial, choice=None) | answer), 422)
    assert client.get("/api/v1/session").json()["progress"]["done"] == 0


def test_nobody_can_have_switched_from_a_film_that_was_shown_alone(
    client: httpx.Client, create: Create, vote_body: VoteBody
) -> None:
    trial = first_trial(client, create(protocol="ACR"))
    body = vote_body(trial, choice=None, rating=4)
    body["viewing"]["switches"] = [{"to": "b", "at_ms": 10, "media_time_s": 0}]
    answer = put_vote(client, trial, body)
    assert is_problem(answer, 422)
    assert "one film" in answer.json()["detail"]


def test_dcr_shows_the_reference_first_and_the_film_below_it(
    client: httpx.Client, analyst: httpx.Client, create: Create, vote_body: VoteBody, tmp_path: Path
) -> None:
    study = create(protocol="DCR", reference="pm_fb", identical_pairs=1)
    assert study["n_trials"] == 6  # of two datasets, each with two films and the reference against itself
    trial = first_trial(client, study)
    assert (trial["first_shown"], trial["media"]["a"], trial["media"]["reference"]) == ("a", "top", False)
    assert trial["see_both"] is True
    assert height_of(client, trial["media"]["url"], tmp_path) == 2 * tiny_stimuli.HEIGHT + GUARD_ROWS
    assert put_vote(client, trial, vote_body(trial, choice=None, rating=2)).status_code == 201
    rows = analyst.get(f"/api/v1/studies/{study['slug']}/trials").json()
    assert {row["item_a"] for row in rows} == {row["first_shown"] for row in rows} == {"pm_fb"}
    assert Counter((row["item_b"], row["role"]) for row in rows) == {
        ("id_fa", "main"): 2, ("id_fb", "main"): 2, ("pm_fb", "identical"): 2,
    }  # fmt: skip


def test_a_hidden_reference_is_a_film_among_others(client: httpx.Client, analyst: httpx.Client, create: Create) -> None:
    study = create(protocol="ACR-HR", reference="pm_fb")
    first_trial(client, study)
    rows = analyst.get(f"/api/v1/studies/{study['slug']}/trials").json()
    assert Counter(row["item_b"] for row in rows) == {"id_fa": 2, "id_fb": 2, "pm_fb": 2}
    assert "pm_fb" not in client.get("/api/v1/session/trials/next").text


def test_the_sign_of_a_comparison_is_a_choice(
    client: httpx.Client, analyst: httpx.Client, create: Create, vote_body: VoteBody
) -> None:
    study = create(protocol="CCR")
    trial = first_trial(client, study)
    assert trial["grades"] == {"low": -3, "high": 3}
    for rating in (-3, 0, 1):
        body = vote_body(trial, choice=None, rating=rating)
        assert [put_vote(client, trial, body).status_code for _ in range(2)] == [201, 200]
        trial = client.get("/api/v1/session/trials/next").json()
    votes = analyst.get(f"/api/v1/studies/{study['slug']}/votes").json()
    assert [(vote["rating"], vote["choice"]) for vote in votes] == [(-3, "a"), (0, "none"), (1, "b")]


@pytest.mark.parametrize("protocol", RATED)
def test_simulated_participants_rate_what_is_better_higher(
    server: str, token: str, analyst: httpx.Client, settings: Settings, create: Create, protocol: str
) -> None:
    study = create(protocol=protocol, repeated_pairs=1, optional_stages=["practice"], **RATED[protocol])
    simulate(server, study["slug"], study["invitation"], token, 4, QUALITIES, seed=3)
    votes = analyst.get(f"/api/v1/studies/{study['slug']}/votes").json()
    mean = {
        item: sum(vote["rating"] for vote in rows) / len(rows)
        for item in QUALITIES
        if (rows := [vote for vote in votes if vote["item_b"] == item])
    }
    assert sorted(mean, key=mean.__getitem__) == sorted(mean, key=QUALITIES.__getitem__)
    assert Counter(vote["role"] for vote in votes)["repeat"] == 4 * 2
    report = manage.study_balance(settings, study["slug"])
    assert report["ok"]
    assert report["participants"]["finished"] == 4
    assert len({tuple(vote["item_b"] for vote in votes if vote["participant"] == f"P00{n}") for n in (1, 2, 3)}) > 1


def test_films_of_one_dataset_do_not_follow_each_other(
    analyst: httpx.Client, client: httpx.Client, create: Create
) -> None:
    study = create(protocol="ACR")
    first_trial(client, study)
    datasets = [row["dataset"] for row in analyst.get(f"/api/v1/studies/{study['slug']}/trials").json()]
    assert all(a != b for a, b in pairwise(datasets))
    assert sorted(datasets) == ["ball"] * 3 + ["box"] * 3


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"protocol": "MUSHRA"}, "protocol is 'MUSHRA', expected one of PC, ACR"),
        ({"protocol": "ACR", "scale": 7}, "scale is 7, expected one of 5, 9, 11, 'slider'"),
        ({"protocol": "CCR", "scale": 9}, "CCR always has seven grades"),
        ({"protocol": "DCR"}, "needs a reference"),
        ({"protocol": "ACR-HR"}, "needs a reference"),
        ({"protocol": "ACR", "reference": "pm_fb"}, "choose ACR-HR"),
        ({"protocol": "ACR", "both_orders": True}, "both_orders is True, but protocol ACR compares no pairs"),
        ({"protocol": "DCR", "reference": "pm_fb", "adaptive_pairs": 9}, "adaptive_pairs is 9"),
    ],
)
def test_options_that_contradict_the_protocol_are_named(options: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        parse_options(options)
