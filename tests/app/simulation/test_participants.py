"""Artificial participants take a real study."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.operations.studies import create, manage
from app.settings import Settings
from app.simulation.observer import Observer
from app.simulation.participants import Person, pass_stages, simulate, simulate_study
from app.store.database.engine import open_database
from app.store.participants.invitations import end_invitation
from app.store.studies.studies import study_by_slug
from app.study.options.options import parse_options
from app.study.stages import ENDS
from tests.app import tiny_stimuli
from tests.app.web.http_checks import is_problem

NewStudy = Callable[[], dict[str, Any]]
ABILITIES = {"id_fa": -12.0, "id_fb": 0.0, "pm_fb": 12.0}


@pytest.mark.slow
def test_the_better_item_wins_whatever_its_label(
    server: str, token: str, analyst: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    told: list[tuple[int, int]] = []
    result = simulate(
        server,
        study["slug"],
        study["invitation"],
        token,
        4,
        ABILITIES,
        0.0,
        progress=lambda _, done, total: told.append((done, total)),
    )
    assert result["votes"] == 24
    assert told == [(done, 24) for done in range(1, 25)]
    votes = analyst.get(f"/api/v1/studies/{study['slug']}/votes").json()
    assert len(votes) == 24
    for vote in votes:
        assert ABILITIES[vote[f"item_{vote['choice']}"]] == max(ABILITIES[vote["item_a"]], ABILITIES[vote["item_b"]])
    assert Counter(vote["choice"] for vote in votes) == {"a": 12, "b": 12}  # labels are balanced over four


@pytest.mark.slow
def test_an_invitation_is_taken_that_has_places_left(server: str, settings: Settings, new_study: NewStudy) -> None:
    study = new_study()
    with open_database(settings.url) as database, database.writing() as connection:
        made = study_by_slug(connection, study["slug"])
        assert made is not None
        end_invitation(connection, made.id, study["invitation"])
    with pytest.raises(ValueError, match=f"no invitation of .* 2 more; `reconstudy study invite {study['slug']}`"):
        simulate_study(settings, server, study["slug"], 2, ABILITIES, 0.0, 0)
    for places in (1, None):
        manage.add_invitation(settings, study["slug"], places=places)
    assert simulate_study(settings, server, study["slug"], 2, ABILITIES, 0.0, 0)["votes"] == 12


@pytest.mark.parametrize("stage", ENDS)
def test_a_session_that_has_ended_has_no_stages_left(stage: str) -> None:
    session = {"stage": stage, "token": "any"}
    with httpx.Client(
        base_url="http://localhost", transport=httpx.MockTransport(lambda _: httpx.Response(404))
    ) as client:
        assert pass_stages(client, session) == session


@pytest.mark.slow
def test_the_same_seed_makes_the_same_choices(
    server: str, token: str, analyst: httpx.Client, new_study: NewStudy
) -> None:
    choices = []
    for _ in range(2):
        study = new_study()
        simulate(server, study["slug"], study["invitation"], token, 2, dict.fromkeys(ABILITIES, 0.0), 0.3, seed=9)
        choices.append([vote["choice"] for vote in analyst.get(f"/api/v1/studies/{study['slug']}/votes").json()])
    assert choices[0] == choices[1]
    assert len(set(choices[0])) == 3


@pytest.mark.slow
def test_an_item_without_an_ability_is_named(server: str, token: str, study: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"no ability for \['pm_fb'\]"):
        simulate(server, study["slug"], study["invitation"], token, 1, {"id_fa": 0.0, "id_fb": 0.0})


def test_a_preference_may_differ_between_datasets(
    server: str, token: str, analyst: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    own = {"ball/id_fa": 24.0, "box/id_fa": -24.0}
    rest = {item: ability for item, ability in ABILITIES.items() if item != "id_fa"}
    simulate(server, study["slug"], study["invitation"], token, 1, own | rest, 0.0)
    for vote in analyst.get(f"/api/v1/studies/{study['slug']}/votes").json():
        if "id_fa" in (vote["item_a"], vote["item_b"]):
            preferred = vote[f"item_{vote['choice']}"]
            assert (preferred == "id_fa") == (vote["dataset"] == "ball")
    with pytest.raises(ValueError, match=r"no ability for \['box/id_fa'\]"):
        simulate(server, study["slug"], study["invitation"], token, 1, {"ball/id_fa": 1.0} | rest)


def test_an_ability_is_needed_for_what_a_dataset_has_only(
    server: str, token: str, settings: Settings, tmp_path: Path
) -> None:
    tiny_stimuli.write_set(tmp_path, ("ball", "box"), ABILITIES)
    shown = [("ball", "id_fa"), ("ball", "id_fb"), ("box", "id_fb"), ("box", "pm_fb")]
    tiny_stimuli.write_manifest(tmp_path, [tiny_stimuli.stimulus(tmp_path, *each) for each in shown])
    study = create.create_study(settings, tmp_path, "Some of each", exposure_s=0.4)
    own = {f"{dataset}/{item}": ABILITIES[item] for dataset, item in shown}
    lacking = {name: own[name] for name in ("ball/id_fb", "box/pm_fb")}
    with pytest.raises(ValueError, match=r"no ability for \['box/id_fb', 'id_fa'\]"):
        simulate(server, study["slug"], study["invitation"], token, 1, lacking)
    assert simulate(server, study["slug"], study["invitation"], token, 1, own)["votes"] == 2


@pytest.mark.slow
def test_progress_ends_with_all_votes_where_groups_see_different_datasets(
    server: str, token: str, settings: Settings, stimulus_set: Path
) -> None:
    options = parse_options({"groups": [{"name": "ball", "datasets": ["ball"]}, {"name": "both"}]})
    study = create.create_study(settings, stimulus_set, "Groups", exposure_s=0.4, options=options)
    told: list[tuple[int, int]] = []
    simulate(
        server,
        study["slug"],
        study["invitation"],
        token,
        4,
        progress=lambda _, done, total: told.append((done, total)),
    )
    assert [done for done, _ in told] == list(range(1, 19))
    assert told[-1] == (18, 18)
    assert all(done < total for done, total in told[:-1])


@pytest.mark.slow
def test_everybody_may_be_somebody_else(
    server: str, token: str, analyst: httpx.Client, settings: Settings, stimulus_set: Path
) -> None:
    content = {
        "optional_stages": ["screening", "interview"],
        "screening": {"tests": ["colour"], "colour_axes": ["deutan"], "on_failure": "stop"},
        "questions": [{"name": "age", "kind": "number", "minimum": 16}],
    }
    study = create.create_study(settings, stimulus_set, "People", exposure_s=0.4, options=parse_options(content))
    mirrored = {item: -ability for item, ability in ABILITIES.items()}
    people = [
        Person(answers={"age": 31}),
        Person(observer=Observer(lacks="deutan")),
        Person(mirrored, answers={"age": 59}),
    ]
    result = simulate(server, study["slug"], study["invitation"], token, people, ABILITIES, 0.0)
    assert (result["participants"], result["votes"]) == (3, 12)
    votes = analyst.get(f"/api/v1/studies/{study['slug']}/votes").json()
    first, last = ({v["participant"]: 0 for v in votes}).keys()
    chosen = {(v["participant"], v["dataset"], v["item_a"], v["item_b"]): v[f"item_{v['choice']}"] for v in votes}
    for (participant, _, item_a, item_b), item in chosen.items():
        best = max if participant == first else min
        assert item == best((item_a, item_b), key=lambda one: ABILITIES[one])
    answers = analyst.get(f"/api/v1/studies/{study['slug']}/questionnaire").json()
    assert {row["participant"]: row["answer"] for row in answers} == {first: 31, last: 59}


def test_a_refusal_is_passed_on_in_the_servers_words(server: str, token: str, study: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="404: There is no such invitation"):
        simulate(server, study["slug"], "unknown", token, 1, ABILITIES)
    with pytest.raises(ValueError, match="401: This token is not known"):
        simulate(server, study["slug"], study["invitation"], "unknown", 1, ABILITIES)


def test_a_server_that_is_not_there_is_named(token: str) -> None:
    with pytest.raises(ValueError, match=r"http://127\.0\.0\.1:9.*does not answer"):
        simulate("http://127.0.0.1:9", "x", "x", token, 1, ABILITIES)


@pytest.mark.slow
def test_artificial_participants_take_every_stage_that_a_study_has(
    server: str, token: str, settings: Settings, stimulus_set: Path
) -> None:
    content = {
        "optional_stages": ["practice", "interview"],
        "consent": "I agree.",
        "questions": [
            {"name": "hand", "text": "Which hand?", "kind": "choice", "options": ["l", "r"], "required": True}
        ],
    }
    study = create.create_study(settings, stimulus_set, "All stages", exposure_s=0.4, options=parse_options(content))
    result = simulate(server, study["slug"], study["invitation"], token, 1, ABILITIES)
    assert result["votes"] == 6
    (listed,) = [one for one in manage.list_studies(settings) if one["slug"] == study["slug"]]
    assert listed["n_finished"] == 1


@pytest.mark.slow
def test_a_stage_is_not_completed_without_what_it_asks_for(
    client: httpx.Client, settings: Settings, stimulus_set: Path
) -> None:
    content = {"optional_stages": ["practice", "interview"], "consent": "I agree."}
    study = create.create_study(settings, stimulus_set, "Strict", exposure_s=0.4, options=parse_options(content))
    begun = client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": study["invitation"]}).json()
    assert begun["stages"] == ["introduction", "practice", "trial", "interview", "finished"]
    introduction, practice = (f"/api/v1/session/stages/{stage}" for stage in ("introduction", "practice"))
    assert is_problem(client.put(introduction, json={"data": {}}), 422)
    consent = client.get("/api/v1/session/asked").json()["consent"]
    assert is_problem(client.put(introduction, json={"data": {"consent": consent | {"version": "x"}}}), 422)
    assert client.put(introduction, json={"data": {"consent": consent}}).json()["stage"] == "practice"
    pairs = client.get("/api/v1/session/practice").json()
    assert [client.head(one["media"]["url"]).status_code for one in pairs] == [200, 200]
    rounds = [{"n_switches": 1}, {"n_switches": 0}]
    assert is_problem(client.put(practice, json={"data": {"rounds": rounds}}), 422)
    assert client.put(practice, json={"data": {"rounds": rounds[:1] * 2}}).json()["stage"] == "trial"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("consent = ", "options.toml"),
        ("stages = []", "'stages' is not known"),
        ("[options]", "study import"),
        (None, "no such file"),
    ],
)
def test_an_options_file_that_is_not_right_is_named(tmp_path: Path, text: str | None, complaint: str) -> None:
    path = tmp_path / "options.toml"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=complaint):
        create.read_options(path, {})
