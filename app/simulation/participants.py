"""Simulate participants of known preference, who take the whole study over HTTP like anybody else.

They learn what a trial compares from the analyst's routes, because the participant's routes hide it.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import httpx
import numpy as np

from app.ffmpeg import Progress, no_progress
from app.operations.studies.manage import export_study, invitation_for, own_token
from app.settings import Settings
from app.simulation.known_order import KnownOrder, known_order
from app.simulation.observer import Observer
from app.simulation.preference import choose, tie_weight
from app.simulation.rating import LOG_ODDS_OF_SCALE, Rater, draw_rater
from app.simulation.screening import take_screening
from app.study.options.study_file import parse_study_file
from app.study.protocols import CCR, DCR
from app.study.questions.comprehension import right_answer
from app.study.stages import ENDS, INTERVIEW, INTRODUCTION, PRACTICE, SCREENING, TRIAL

TIMEOUT_S = 30.0
MOST_SWITCHES = 8
TYPICAL_RESPONSE_MS = 1500.0
GIVEN = "as was asked for"
NO_ANSWERS: Mapping[str, Any] = {}


@dataclass(frozen=True)
class Preference:
    """What artificial participants prefer.

    Parameters
    ----------
    abilities : natural log-odds by item, or by "dataset/item" where they are of one dataset only
    tie_rate : probability of no preference between equals (Davidson)
    """

    abilities: Mapping[str, float]
    tie_rate: float

    def ability(self, dataset: str, item: str) -> float:
        """Return an item's ability in a dataset."""
        name = f"{dataset}/{item}"
        return self.abilities[name if name in self.abilities else item]

    def missing(self, stimuli: Set[tuple[str, str]]) -> list[str]:
        """List what has no ability, of stimuli by (dataset, item): an item, or "dataset/item" if others of it have."""
        named = self.abilities.keys()
        lacking = {(dataset, item) for dataset, item in stimuli if named.isdisjoint({item, f"{dataset}/{item}"})}
        known = {item for _, item in stimuli - lacking}
        return sorted({f"{dataset}/{item}" if item in known else item for dataset, item in lacking})

    def choose(self, dataset: str, item_a: str, item_b: str, rng: np.random.Generator) -> str:
        return choose(self.ability(dataset, item_a), self.ability(dataset, item_b), self.tie_rate, rng)


@dataclass(frozen=True)
class Person:
    """One artificial participant.

    Parameters
    ----------
    abilities : this person's, as in `Preference`; None: everybody's
    observer : takes the screening
    answers : to the questionnaire, by name; other required questions get an arbitrary answer
    """

    abilities: Mapping[str, float] | None = None
    observer: Observer = field(default_factory=Observer)
    answers: Mapping[str, Any] = field(default_factory=dict)


def simulate(
    base_url: str,
    slug: str,
    invitation: str,
    token: str,
    participants: int | Sequence[Person],
    abilities: Mapping[str, float] | None = None,
    tie_rate: float = 0.1,
    seed: int = 0,
    *,
    outside_id: str = "",
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Let artificial participants take a study, one after another; returns a summary.

    Parameters
    ----------
    base_url : of the server, for example "http://127.0.0.1:8000"
    slug, invitation : of the study
    token : an analyst's bearer token
    participants : how many alike, or each person
    abilities : natural log-odds by item or "dataset/item", for all that the study compares; None: by `known_order`
    tie_rate : probability of no preference between equals, where pairs are compared
    seed : of all choices; the same seed and slots give the same choices
    outside_id : name of the parameter by which the study knows people of a recruiting platform; each gets a random id
    progress : told after each vote

    Raises
    ------
    ValueError
        If an item of the study has no ability, or the server refuses something: then the sentence is the server's.
    """
    tie_weight(tie_rate)
    started, n_votes = time.perf_counter(), 0
    people = [Person()] * participants if isinstance(participants, int) else participants
    with httpx.Client(base_url=base_url, timeout=TIMEOUT_S) as client:
        study = _ask(client, token, "GET", f"/api/v1/studies/{slug}").json()
        order = KnownOrder(abilities, GIVEN) if abilities is not None else _order(client, token, study)
        abilities = order.abilities
        preferences = [
            Preference(abilities if person.abilities is None else person.abilities, tie_rate) for person in people
        ]
        for preference in preferences:
            if missing := preference.missing({(row["dataset"], row["item"]) for row in study["stimuli"]}):
                raise ValueError(f"no ability for {missing}, expected one for every item of the study {slug!r}")
        for number, (person, preference) in enumerate(zip(people, preferences, strict=True)):
            rngs = np.random.default_rng([seed, number]), np.random.default_rng([seed, number, 1])
            session = begin(client, slug, invitation, person.observer, rngs[1], outside_id=outside_id)
            total = n_votes + (len(people) - number) * session["progress"]["total"]  # if the others see as many
            rater = draw_rater(np.random.default_rng([seed, number, 2]))
            for _ in _votes(client, slug, session, token, preference, rater, rngs[0]):
                n_votes += 1
                progress(f"votes of participant {number + 1} of {len(people)}", n_votes, total)
            now = _ask(client, session["token"], "GET", "/api/v1/session").json()
            pass_stages(client, session | now, answers=person.answers)
    seconds = time.perf_counter() - started
    return {
        "study": slug,
        "participants": len(people),
        "votes": n_votes,
        "seconds": round(seconds, 3),
        "tie_rate": tie_rate,
        "seed": seed,
        "abilities": dict(abilities),
        "order": order.reason,
        "put_in": _by_item(Preference(abilities, tie_rate), study["stimuli"]),
    }


def _by_item(preference: Preference, stimuli: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return each item's mean ability over the datasets where it is; nothing if some are only of each person."""
    if preference.missing({(row["dataset"], row["item"]) for row in stimuli}):
        return {}
    abilities: dict[str, list[float]] = {}
    for row in stimuli:
        abilities.setdefault(row["item"], []).append(preference.ability(row["dataset"], row["item"]))
    return {item: round(float(np.mean(values)), 3) for item, values in abilities.items()}


def _order(client: httpx.Client, token: str, study: Mapping[str, Any]) -> KnownOrder:
    """Find the order that people prefer unless told, from what is attached to a study."""
    return known_order(study, _ask(client, token, "GET", f"/api/v1/studies/{study['slug']}/validation").json())


def _votes(
    client: httpx.Client,
    slug: str,
    session: Mapping[str, Any],
    token: str,
    preference: Preference,
    rater: Rater,
    rng: np.random.Generator,
) -> Iterator[str | int]:
    """Vote in every trial of a session, and yield the answers; nothing where the session has ended already."""
    if session["stage"] in ENDS:
        return
    hidden = {row["trial"]: row for row in trials_of(client, slug, session["session"], token)}
    while trial := next_trial(client, session["token"]):
        compared = hidden[trial["trial"]]
        answer = _answer(trial, compared, preference, rater, rng)
        vote(client, session["token"], trial, answer, rng)
        yield answer


def _answer(
    trial: Mapping[str, Any],
    compared: Mapping[str, Any],
    preference: Preference,
    rater: Rater,
    rng: np.random.Generator,
) -> str | int:
    """Choose the better of a trial's two stimuli, or rate as its protocol asks.

    Parameters
    ----------
    trial : as the participant gets it
    compared : the analyst's row of it
    preference, rater : the participant's
    rng : Generator
    """
    dataset, item_a, item_b = (compared[name] for name in ("dataset", "item_a", "item_b"))
    if trial["grades"] is None:
        return preference.choose(dataset, item_a, item_b, rng)
    low, high = trial["grades"]["low"], trial["grades"]["high"]
    quality = preference.ability(dataset, item_b)
    if trial["protocol"] in (DCR, CCR):
        quality -= preference.ability(dataset, item_a)
    if trial["protocol"] == DCR:  # as good as the reference is the best
        quality += LOG_ODDS_OF_SCALE / 2
    return rater.rate(quality, low, high, rng)


def simulate_study(
    settings: Settings,
    base_url: str,
    slug: str,
    participants: int | Sequence[Person],
    abilities: Mapping[str, float] | None,
    tie_rate: float,
    seed: int,
    *,
    progress: Progress = no_progress,
) -> dict[str, Any]:
    """Run `simulate` on a study of this database, with its invitation and a token made for it.

    Raises
    ------
    ValueError
        If there is no such study, none of its invitations lets in as many, or as in `simulate`.
    """
    invitation = invitation_for(settings, slug, participants if isinstance(participants, int) else len(participants))
    outside_id = parse_study_file(export_study(settings, slug)).options.outside.id
    with own_token(settings, "simulate") as token:
        return simulate(
            base_url,
            slug,
            invitation,
            token,
            participants,
            abilities,
            tie_rate,
            seed,
            outside_id=outside_id,
            progress=progress,
        )


def begin(
    client: httpx.Client,
    slug: str,
    invitation: str,
    observer: Observer = Observer(),
    rng: np.random.Generator | None = None,
    *,
    outside_id: str = "",
) -> dict[str, Any]:
    """Begin a session and pass the stages before the trials; `observer` takes the screening.

    `outside_id` is as in `simulate`.
    """
    admission: dict[str, Any] = {"invitation": invitation, "key": str(uuid.uuid4())}
    if outside_id:
        admission["outside"] = {outside_id: f"simulated-{uuid.uuid4()}"}
    session: dict[str, Any] = _ask(client, None, "POST", f"/api/v1/studies/{slug}/sessions", admission).json()
    return pass_stages(client, session, observer, rng)


def pass_stages(
    client: httpx.Client,
    session: dict[str, Any],
    observer: Observer = Observer(),
    rng: np.random.Generator | None = None,
    *,
    answers: Mapping[str, Any] = NO_ANSWERS,
) -> dict[str, Any]:
    """Complete the stages before the trials, or after them up to the end."""
    rng = rng or np.random.default_rng()
    while session["stage"] not in (TRIAL, *ENDS):
        asked = _ask(client, session["token"], "GET", "/api/v1/session/asked").json()
        if session["stage"] == SCREENING:
            take_screening(partial(_ask, client, session["token"]), observer, rng)
        data = {"simulated": True, **stage_data(session["stage"], asked, answers)}
        path = f"/api/v1/session/stages/{session['stage']}"
        session = session | _ask(client, session["token"], "PUT", path, {"data": data}).json()
    return session


def stage_data(stage: str, asked: Mapping[str, Any], answers: Mapping[str, Any] = NO_ANSWERS) -> dict[str, Any]:
    """Return the data that completes a stage: consent as asked for, other answers only where required."""
    if stage == INTRODUCTION:
        consent = {"consent": asked["consent"]} if asked["consent"] else {}
        return consent | ({"comprehension": right_answer(asked["protocol"])} if asked["comprehension"] else {})
    if stage == INTERVIEW:
        needed = {question["name"]: _some_answer(question) for question in asked["questions"] if question["required"]}
        return {"answers": needed | dict(answers)}
    if stage == PRACTICE:
        rounds = range(1, asked["practice"] + 1)
        return {"rounds": [{"trial": f"practice-{number}", "n_switches": 1, "choice": "none"} for number in rounds]}
    return {}


def _some_answer(question: Mapping[str, Any]) -> Any:
    if question["kind"] == "choice":
        return question["options"][0]
    if question["kind"] == "text":
        return "simulated"
    return 1 if question["kind"] == "scale" else (question["minimum"] or question["maximum"] or 0)


def trials_of(client: httpx.Client, slug: str, session: str, token: str) -> list[dict[str, Any]]:
    """Fetch what each of a session's trials compares, as an analyst."""
    path = f"/api/v1/studies/{slug}/trials?session={session}"
    rows: list[dict[str, Any]] = _ask(client, token, "GET", path).json()
    return rows


def next_trial(client: httpx.Client, session_token: str) -> dict[str, Any] | None:
    """Fetch the next trial; None when none is left."""
    answer = _ask(client, session_token, "GET", "/api/v1/session/trials/next")
    return None if answer.status_code == 204 else answer.json()


def vote(
    client: httpx.Client, session_token: str, trial: Mapping[str, Any], answer: str | int, rng: np.random.Generator
) -> None:
    """Send a vote, a choice or a rating, with looks and pauses such as people make."""
    kind = "choice" if isinstance(answer, str) else "rating"
    body = {"id": str(uuid.uuid4()), kind: answer, "viewing": viewing(trial, rng)}
    _ask(client, session_token, "PUT", f"/api/v1/session/trials/{trial['trial']}/vote", body)


def viewing(trial: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Make up a viewing record: switches within the exposure, a log-normal pause before the answer."""
    shown_ms = 1000.0 * trial["exposure_s"]
    times = np.sort(rng.uniform(0, shown_ms, rng.integers(1, MOST_SWITCHES + 1))).round(1).tolist()
    labels = ("b", "a") if trial["first_shown"] == "a" else ("a", "b")
    if trial["media"]["layout"] == "single":
        times = []
    length_s = trial["media"]["n_frames"] / trial["media"]["fps"]
    return {
        "first_shown": trial["first_shown"],
        "shown_ms": shown_ms,
        "response_ms": round(TYPICAL_RESPONSE_MS * float(rng.lognormal(0, 0.5)), 1),
        "switches": [
            {"to": labels[turn % 2], "at_ms": at_ms, "media_time_s": round(at_ms / 1000 % length_s, 4)}
            for turn, at_ms in enumerate(times)
        ],
    }


def _ask(
    client: httpx.Client, token: str | None, method: str, path: str, body: Mapping[str, Any] | None = None
) -> httpx.Response:
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    try:
        answer = client.request(method, path, headers=headers, json=body)
    except httpx.TransportError as error:
        raise ValueError(f"{client.base_url}: the server does not answer: {error}") from error
    if answer.is_error:
        raise ValueError(f"{method} {path}: {answer.status_code}: {_detail(answer)}")
    return answer


def _detail(answer: httpx.Response) -> str:
    try:
        return str(answer.json()["detail"])
    except (ValueError, KeyError, TypeError):
        return answer.text[:200]
