"""Repetitions, a reference and free exposure, from the study's options to the votes and their analysis."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any
from uuid import uuid4

import clips
import httpx
import numpy as np
import pytest
from http_checks import is_problem

from app import operate
from app.films import GUARD_ROWS, FilmMaker, prepare_pairs, split_reference
from app.settings import Settings
from app.simulate import begin, simulate
from app.stimuli import decode, read_stimulus_set
from app.study.options import parse_options

Create = Callable[..., dict[str, Any]]
ABILITIES = {"id_fa": -2.0, "id_fb": 0.0, "pm_fb": 2.0}


@pytest.fixture
def create(settings: Settings, stimulus_set: Path) -> Create:
    def make(**options: Any) -> dict[str, Any]:
        name = f"Study {uuid4()}"
        return operate.create_study(settings, stimulus_set, name, exposure_s=0.4, options=parse_options(options))

    return make


def test_checks_are_shown_and_recorded_and_change_no_score(
    server: str, token: str, analyst: httpx.Client, create: Create
) -> None:
    study = create(both_orders=True, repeated_pairs=1, identical_pairs=2)
    assert study["n_pairs"] == 6
    told: list[tuple[int, int]] = []
    result = simulate(
        server, study["slug"], study["invitation"], token, 2, ABILITIES, 0.0,
        progress=lambda done, total, _: told.append((done, total)),
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


def test_a_study_with_all_repetitions_is_balanced(server: str, token: str, settings: Settings, create: Create) -> None:
    study = create(both_orders=True, repeated_pairs=1, identical_pairs=1)
    simulate(server, study["slug"], study["invitation"], token, 3, ABILITIES, 0.0)
    report = operate.study_balance(settings, study["slug"])
    assert report["ok"]
    assert report["participants"]["finished"] == 3
    assert {(row["n_shown"], row["n_1_is_a"], row["n_1_is_first"]) for row in report["pairs"]} == {(6, 3, 3)}


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
    assert decode(settings.data_dir / "film.mp4").height == 3 * clips.HEIGHT + 2 * GUARD_ROWS
    viewing = {
        "first_shown": trial["first_shown"], "shown_ms": 400, "response_ms": 1,
        "switches": [{"to": "reference", "at_ms": 10, "media_time_s": 0}],
        "dwell_ms": {"a": 10, "b": 0, "reference": 390},
    }  # fmt: skip
    path = f"/api/v1/session/trials/{trial['trial']}/vote"
    assert client.put(path, json=vote_body(trial, viewing=viewing)).status_code == 201


def test_a_reference_that_was_not_there_cannot_have_been_looked_at(
    participant: httpx.Client, vote_body: Callable[..., dict[str, Any]]
) -> None:
    trial = participant.get("/api/v1/session/trials/next").json()
    body = vote_body(trial)
    body["viewing"]["switches"] = [{"to": "reference", "at_ms": 10, "media_time_s": 0}]
    assert is_problem(participant.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=body), 422)


def test_each_strip_of_a_film_is_its_stimulus(stimulus_set: Path, tmp_path: Path) -> None:
    from test_stimuli import frames

    compared, references = split_reference(read_stimulus_set(stimulus_set), "pm_fb")
    for pair in prepare_pairs(compared, FilmMaker(tmp_path), references):
        film = frames(tmp_path / pair.file)
        below = references[pair.top.dataset]
        for strip, one in enumerate((pair.top, pair.bottom, below)):
            start = strip * (clips.HEIGHT + GUARD_ROWS)
            grey = frames(compared.folder / one.video)[0, 0, 0]
            assert np.abs(film[:, start : start + clips.HEIGHT].astype(int) - int(grey)).max() <= 3


def test_free_exposure_is_told_to_every_client(client: httpx.Client, create: Create) -> None:
    study = create(free_exposure=True)
    begin(client, study["slug"], study["invitation"])
    assert client.get("/api/v1/session/trials/next").json()["free_exposure"] is True


def test_a_second_codec_is_offered_to_browsers_and_served(client: httpx.Client, create: Create) -> None:
    study = create(second_codec="vp9", optional_stages=["practice"])
    assert "vp09.00.51.08" in client.get(f"/s/{study['invitation']}").text
    begin(client, study["slug"], study["invitation"])
    trials = [client.get("/api/v1/session/trials/next").json(), *client.get("/api/v1/session/practice").json()]
    for trial in trials:
        second = trial["media"]["second"]
        assert second["type"] == 'video/mp4; codecs="vp09.00.51.08"'
        film = client.get(second["url"])
        assert film.status_code == 200
        assert b"vp09" in film.content
