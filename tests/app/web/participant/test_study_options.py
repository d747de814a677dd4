"""Repetitions, a reference and free exposure, from the study's options to the votes and their analysis."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.typing import NDArray

from app.ffmpeg import decode
from app.films.pairs import FilmMaker, prepare_pairs, split_reference
from app.films.strips import GUARD_ROWS
from app.intake.stimuli import read_stimulus_set
from app.operations.studies import manage
from app.settings import Settings
from app.simulation.participants import begin, simulate
from tests.app import tiny_stimuli
from tests.app.tiny_stimuli import frames
from tests.app.web.admin.dashboard_client import signed_in
from tests.app.web.http_checks import is_problem

Create = Callable[..., dict[str, Any]]
ABILITIES = {"id_fa": -2.0, "id_fb": 0.0, "pm_fb": 2.0}


@pytest.mark.slow
def test_checks_are_shown_and_recorded_and_change_no_score(
    server: str, token: str, analyst: httpx.Client, create: Create
) -> None:
    study = create(both_orders=True, repeated_pairs=1, identical_pairs=2)
    assert study["n_pairs"] == 6
    told: list[tuple[int, int]] = []
    result = simulate(
        server, study["slug"], study["invitation"], token, 2, ABILITIES, 0.0,
        progress=lambda _, done, total: told.append((done, total)),
    )  # fmt: skip
    assert result["votes"] == 2 * 2 * (2 * 3 + 1 + 2)
    assert told[-1] == (36, 36)
    path = f"/api/v1/studies/{study['slug']}"
    votes = analyst.get(f"{path}/votes").json()
    assert Counter(vote["role"] for vote in votes) == {"main": 24, "repeat": 4, "identical": 8}
    assert all((vote["item_a"] == vote["item_b"]) == (vote["role"] == "identical") for vote in votes)
    analysis = analyst.get(f"{path}/analysis").json()
    assert analysis["votes"]["analysed"] == 24
    (row,) = {row["n_votes"] for row in analysis["scores"] if row["dataset"] == "all" and row["comparison"] == "all"}
    assert row == 16  # of two participants, two datasets, two pairs, both orders
    for check in analysis["checks"]:
        assert (check["n_identical"], check["n_repeated"]) == (4, 2)


@pytest.mark.slow
def test_a_study_with_all_repetitions_is_balanced(server: str, token: str, settings: Settings, create: Create) -> None:
    study = create(both_orders=True, repeated_pairs=1, identical_pairs=1)
    simulate(server, study["slug"], study["invitation"], token, 3, ABILITIES, 0.0)
    report = manage.study_balance(settings, study["slug"])
    assert report["ok"]
    assert report["participants"]["finished"] == 3
    assert {(row["n_shown"], row["n_1_is_a"], row["n_1_is_first"]) for row in report["pairs"]} == {(6, 3, 3)}


@pytest.mark.slow
def test_a_reference_lies_below_each_pair_and_is_not_compared(
    client: httpx.Client, settings: Settings, create: Create, vote_body: Callable[..., dict[str, Any]]
) -> None:
    study = create(reference="id_fb")
    assert study["n_pairs"] == 2
    begin(client, study["slug"], study["invitation"])
    trial = client.get("/api/v1/session/trials/next").json()
    assert trial["media"]["reference"] is True
    film = client.get(trial["media"]["url"])
    (settings.data_dir / "film.mp4").write_bytes(film.content)
    assert decode(settings.data_dir / "film.mp4").height == 3 * tiny_stimuli.HEIGHT + 2 * GUARD_ROWS
    viewing = {
        "first_shown": trial["first_shown"], "shown_ms": 400, "response_ms": 1,
        "switches": [{"to": "reference", "at_ms": 10, "media_time_s": 0}],
        "dwell_ms": {"a": 10, "b": 0, "reference": 390},
    }  # fmt: skip
    path = f"/api/v1/session/trials/{trial['trial']}/vote"
    assert client.put(path, json=vote_body(trial, viewing=viewing)).status_code == 201


@pytest.mark.slow
def test_a_condition_that_is_left_out_is_not_compared(create: Create) -> None:
    study = create(without=["id_fb"], identical_pairs=1)
    assert (study["n_datasets"], study["n_conditions"], study["n_pairs"]) == (2, 2, 2)
    assert study["without"] == ["id_fb"]


@pytest.mark.parametrize(
    ("left_out", "message"),
    [
        (["truth"], "'truth' cannot be left out: it is none of the set's conditions, id_fa, id_fb, pm_fb"),
        (["id_fa", "pm_fb"], "ball has 1 stimuli without id_fa, pm_fb, expected at least two"),
        ("id_fa", "without is 'id_fa', expected a list of names"),
    ],
)
def test_what_cannot_be_left_out_is_named(create: Create, left_out: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        create(without=left_out)


def test_a_reference_that_was_not_there_cannot_have_been_looked_at(
    participant: httpx.Client, vote_body: Callable[..., dict[str, Any]]
) -> None:
    trial = participant.get("/api/v1/session/trials/next").json()
    body = vote_body(trial)
    body["viewing"]["switches"] = [{"to": "reference", "at_ms": 10, "media_time_s": 0}]
    assert is_problem(participant.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=body), 422)


@pytest.mark.slow
def test_each_strip_of_a_film_is_its_stimulus(stimulus_set: Path, tmp_path: Path) -> None:
    compared, references = split_reference(read_stimulus_set(stimulus_set), "pm_fb")
    for pair in prepare_pairs(compared, FilmMaker(tmp_path), references):
        film = frames(tmp_path / pair.file)
        below = references[pair.top.dataset]
        for strip, one in enumerate((pair.top, pair.bottom, below)):
            start = strip * (tiny_stimuli.HEIGHT + GUARD_ROWS)
            grey = frames(compared.folder / one.video)[0, 0, 0]
            assert np.abs(film[:, start : start + tiny_stimuli.HEIGHT].astype(int) - int(grey)).max() <= 3


def test_free_exposure_is_told_to_every_client(client: httpx.Client, create: Create) -> None:
    study = create(free_exposure=True)
    begin(client, study["slug"], study["invitation"])
    assert client.get("/api/v1/session/trials/next").json()["free_exposure"] is True


def decoded(client: httpx.Client, url: str, folder: Path) -> NDArray[np.uint8]:
    (folder / "film.mp4").write_bytes(client.get(url).content)
    return frames(folder / "film.mp4")


@pytest.mark.slow
def test_each_strip_alone_is_served_under_names_that_tell_nothing(
    client: httpx.Client, create: Create, tmp_path: Path
) -> None:
    study = create(optional_stages=["practice"], reference="pm_fb")
    names: list[str] = []
    tags: list[str] = []
    for _ in range(2):
        begin(client, study["slug"], study["invitation"])
        trial = client.get("/api/v1/session/trials/next").json()
        names += trial["media"]["singles"]
        answers = [client.get(url) for url in trial["media"]["singles"]]
        assert [answer.status_code for answer in answers] == [200] * 3
        tags += [answer.headers["etag"] for answer in answers]
        assert {answer.headers["last-modified"] for answer in answers} == {"Sat, 01 Jan 2000 00:00:00 GMT"}
        film, *strips = (decoded(client, url, tmp_path) for url in [trial["media"]["url"], *trial["media"]["singles"]])
        for strip, found in enumerate(strips):
            start = strip * (tiny_stimuli.HEIGHT + GUARD_ROWS)
            assert np.abs(film[:, start : start + tiny_stimuli.HEIGHT].astype(int) - found).max() <= 4
    assert len(set(names)) == len(set(tags)) == 6
    practice = client.get("/api/v1/session/practice").json()
    assert all(client.get(url).status_code == 200 for one in practice for url in one["media"]["singles"])
    assert len(practice[0]["media"]["singles"]) == 2
    for wrong in ("left", "reference", ""):
        assert is_problem(client.get(f"/media/{names[0].split('/')[-1].split('.')[0]}x.{wrong}"), 404)


@pytest.mark.slow
def test_four_participants_practise_a_pair_with_either_film_as_a_and_either_first(
    client: httpx.Client, create: Create
) -> None:
    study = create(optional_stages=["practice"])
    ways = set()
    for _ in range(4):
        begin(client, study["slug"], study["invitation"])
        first = client.get("/api/v1/session/practice").json()[0]
        ways.add((first["media"]["a"], first["first_shown"]))
    assert ways == {("top", "a"), ("top", "b"), ("bottom", "a"), ("bottom", "b")}


def test_a_study_without_a_fallback_has_no_single_films(client: httpx.Client, create: Create) -> None:
    study = create(fallback="")
    assert 'data-fallback=""' in client.get(f"/s/{study['invitation']}").text
    begin(client, study["slug"], study["invitation"])
    trial = client.get("/api/v1/session/trials/next").json()
    assert trial["media"]["singles"] is None
    assert is_problem(client.get(f"/media/{trial['trial']}.top"), 404)


@pytest.mark.slow
def test_a_vote_tells_analysts_how_the_pair_was_shown(
    analyst: httpx.Client,
    client: httpx.Client,
    create: Create,
    vote_body: Callable[..., dict[str, Any]],
    settings: Settings,
    server: str,
) -> None:
    study = create(fallback="two videos")
    begin(client, study["slug"], study["invitation"])
    for technique in ("stacked", "webcodecs", "two videos", None):
        trial = client.get("/api/v1/session/trials/next").json()
        body = vote_body(trial)
        body["viewing"] |= {"technique": technique, "n_mismatches": 3} if technique else {}
        assert client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=body).status_code == 201
    path = f"/api/v1/studies/{study['slug']}"
    found = [(vote["technique"], vote["frame_locked"]) for vote in analyst.get(f"{path}/votes").json()]
    assert found == [("stacked", True), ("webcodecs", True), ("two videos", False), (None, None)]
    table = analyst.get(f"{path}/votes?format=csv").text.splitlines()
    assert "technique,frame_locked" in table[0]
    assert "two videos,FALSE" in table[3]
    assert [trial["n_mismatches"] for trial in analyst.get(f"{path}/trials").json()][:4] == [3, 3, 3, None]
    with signed_in(server, settings, "Grace") as grace:
        page = grace.get(f"/admin/studies/{study['slug']}/votes").text
    assert page.count(">two videos<") == 1


@pytest.mark.slow
def test_a_second_codec_and_a_lighter_film_are_offered_and_served(client: httpx.Client, create: Create) -> None:
    study = create(second_codec="vp9", lighter_films=True, optional_stages=["practice"])
    assert "vp09.00.51.08" in client.get(f"/s/{study['invitation']}").text
    begin(client, study["slug"], study["invitation"])
    trials = [client.get("/api/v1/session/trials/next").json(), *client.get("/api/v1/session/practice").json()]
    for trial in trials:
        second = trial["media"]["second"]
        assert second["type"] == 'video/mp4; codecs="vp09.00.51.08"'
        film = client.get(second["url"])
        assert film.status_code == 200
        assert b"vp09" in film.content
        whole, lighter = (client.get(trial["media"][name]) for name in ("url", "lighter"))
        assert lighter.status_code == 200
        assert lighter.headers["etag"] != whole.headers["etag"]
