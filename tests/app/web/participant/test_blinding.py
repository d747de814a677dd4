"""Nothing that reaches a participant tells what is compared."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import urljoin
from uuid import uuid4

import httpx
import numpy as np
import pytest

from app.operations.studies import create
from app.settings import Settings
from app.simulation.participants import next_trial, pass_stages, vote
from app.study.options.options import StudyOptions
from tests.app import tiny_stimuli

DATASETS = ("walrus", "teapot")
DEBRIEFING = "Some of the models had holes."
SECRETS = (*tiny_stimuli.APPROACHES, *DATASETS, "depth", "fusion", tiny_stimuli.TITLE)
LINKS = re.compile(rb'(?:href|src|action|url|picture|next_media|from|import)"?[=: (]*["\']([./][^"\'#]*)["\']')
TEXTS = ("text/", "application/json", "image/svg", "javascript")


class Crawler:
    """Follows whatever an answer to a participant leads to, and keeps every byte of every answer, headers too."""

    def __init__(self, client: httpx.Client) -> None:
        self.heard: list[bytes] = []
        self._seen: set[str] = set()
        self._client = client
        client.event_hooks["response"].append(self._listen)

    def _listen(self, answer: httpx.Response) -> None:
        answer.read()
        head = b"\n".join(name + b": " + value for name, value in answer.headers.raw)
        self.heard.append(str(answer.url).encode() + b"\n" + head + b"\n\n" + answer.content)
        if answer.headers.get("content-type", "").startswith(TEXTS):
            for link in LINKS.findall(answer.content):
                self._follow(urljoin(str(answer.url), link.decode()))

    def _follow(self, url: str) -> None:
        if url.startswith(str(self._client.base_url)) and url not in self._seen:
            self._seen.add(url)
            self._client.get(url)

    def assert_silent(self) -> None:
        for secret in SECRETS:
            pattern = re.compile(rb"(?<![\w-])" + secret.encode() + rb"(?![\w-])")
            told = [heard[:300] for heard in self.heard if pattern.search(heard)]
            assert not told, f"{secret!r} in {told[0]!r}"

    def heard_of(self, part: str) -> int:
        """How many answers came from addresses with this part."""
        return sum(part in heard.split(b"\n", 1)[0].decode() for heard in self.heard)


@pytest.fixture
def crawler(client: httpx.Client) -> Crawler:
    return Crawler(client)


@pytest.mark.slow
def test_a_whole_session_of_every_stage_names_no_dataset_and_no_condition_and_debriefs_at_its_end(
    client: httpx.Client, crawler: Crawler, settings: Settings, tmp_path: Path
) -> None:
    options = StudyOptions(
        optional_stages=("screening", "practice", "interview"),
        consent="I take part of my own will.",
        consent_version="1",
        comprehension=True,
        debriefing=DEBRIEFING,
    )
    stimuli = tiny_stimuli.write_set(tmp_path, DATASETS, tiny_stimuli.APPROACHES)
    study = create.create_study(settings, stimuli, f"Crawl {uuid4().hex[:6]}", exposure_s=0.4, options=options)
    rng = np.random.default_rng(1)
    client.get("/")
    client.get(f"/s/{study['invitation']}")
    admission = {"invitation": study["invitation"], "key": str(uuid4())}
    session = client.post(f"/api/v1/studies/{study['slug']}/sessions", json=admission).json()
    client.get("/api/v1/session/asked")
    client.put("/api/v1/session/comprehension", json={"answer": "skip"})
    begun = client.put("/api/v1/session/stages/practice", json={"data": {}})  # out of turn
    assert begun.is_client_error
    session = pass_stages(client, session, rng=rng)
    client.get("/api/v1/session/practice")
    client.get("/api/v1/session/films")
    while (trial := next_trial(client, session["token"])) is not None:
        client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json={"id": "wrong"})
        vote(client, session["token"], trial, "b", rng)
    state = client.get("/api/v1/session").json()
    assert state["stage"] == "interview"
    client.get(f"/s/{study['invitation']}")
    assert not [heard[:300] for heard in crawler.heard if DEBRIEFING.encode() in heard]
    session = pass_stages(client, session | state, rng=rng)
    assert (session["stage"], session["debriefing"]) == ("finished", DEBRIEFING)
    client.get(f"/s/{study['invitation']}")
    client.get("/api/v1/studies/nothing/votes")
    assert crawler.heard_of("/media/") >= 6
    assert crawler.heard_of("/static/joined/") >= 2
    assert crawler.heard_of("/session/screening/") > 10
    assert len(crawler.heard) > 100
    crawler.assert_silent()


@pytest.mark.slow
def test_two_trials_of_a_dataset_differ_in_nothing_but_their_pictures(
    client: httpx.Client, settings: Settings, tmp_path: Path
) -> None:
    sources = {"id_fa": tiny_stimuli.flat("gray"), "id_fb": "testsrc=size=64x48", "pm_fb": "mandelbrot=size=64x48"}
    for approach, source in sources.items():
        tiny_stimuli.encode(tmp_path / f"ball/{approach}.mp4", source)
    entries = [tiny_stimuli.stimulus(tmp_path, "ball", approach) for approach in sources]
    stimuli = tiny_stimuli.write_manifest(tmp_path, entries)
    options = StudyOptions(fallback="two videos", lighter_films=True, identical_pairs=2, repeated_pairs=2)
    study = create.create_study(settings, stimuli, f"Blind {uuid4().hex[:6]}", options=options)
    admission = {"invitation": study["invitation"], "key": str(uuid4())}
    session = client.post(f"/api/v1/studies/{study['slug']}/sessions", json=admission).json()
    pass_stages(client, session)
    heard: dict[str, list[httpx.Response]] = {"url": [], "lighter": [], "singles": []}
    told = []
    while (trial := next_trial(client, session["token"])) is not None:
        media = trial["media"]
        told.append({**trial, "media": media | dict.fromkeys((*heard, "a"))})
        for kind in heard:
            heard[kind] += [client.get(url) for url in ([media[kind]] if isinstance(media[kind], str) else media[kind])]
        vote(client, session["token"], trial, "b", np.random.default_rng(1))
    of_each_trial = {"trial", "number", "place", "first_shown", "next_media", "following"}
    assert len({str({k: v for k, v in each.items() if k not in of_each_trial}) for each in told}) == 1
    for answers in heard.values():
        assert len({answer.content for answer in answers}) < len(answers), "some show the same"
        assert len({answer.headers["etag"] for answer in answers}) == len({str(answer.url) for answer in answers})
        assert len(answers) == len({str(answer.url) for answer in answers})
        unlike = {"etag", "date", "x-request-id"}
        heads = {str(sorted((k, v) for k, v in answer.headers.items() if k not in unlike)) for answer in answers}
        assert len(heads) == 1, "sizes and times among them"


def test_a_name_that_tells_a_condition_is_pointed_out(settings: Settings, stimulus_set: Path) -> None:
    assert "notes" not in create.create_study(settings, stimulus_set, f"Statues {uuid4().hex[:6]}")
    (note,) = create.create_study(settings, stimulus_set, f"ID_FA and others {uuid4().hex[:6]}")["notes"]
    assert "holds id_fa, and participants see it" in note
    assert "its page Settings changes both" in note


def test_a_crawler_hears_what_is_told(client: httpx.Client, crawler: Crawler, study: dict[str, Any]) -> None:
    client.get(f"/s/{study['invitation']}?walrus")
    with pytest.raises(AssertionError, match="walrus"):
        crawler.assert_silent()


def test_participants_cannot_read_results(participant: httpx.Client, study: dict[str, Any]) -> None:
    for name in ("", "/votes", "/trials", "/scores", "/triads", "/analysis"):
        assert participant.get(f"/api/v1/studies/{study['slug']}{name}").status_code == 401
    token = participant.cookies["session"]
    bearer = {"Authorization": f"Bearer {token}"}
    assert participant.get("/api/v1/studies", headers=bearer).status_code == 401
    assert participant.get("/admin").status_code == 401
