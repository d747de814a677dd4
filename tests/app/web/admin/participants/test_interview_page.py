"""What participants write and say at the end, and who reads it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.operations.studies import create, manage
from app.settings import Settings
from app.simulation.participants import Person, begin, simulate
from app.study.options.options import parse_options
from app.study.questions.questionnaire import LONGEST_ANSWER, LONGEST_QUESTION, MOST_QUESTIONS, MOST_SPOKEN_QUESTIONS
from tests.app.web.admin.dashboard_client import Dashboard
from tests.app.web.http_checks import is_problem

SPOKEN = ("Which was easiest?", "Anything else?")
NAMES = [f"question_{number}" for number in range(MOST_QUESTIONS)]


@pytest.fixture(scope="module")
def asked(settings: Settings, stimulus_set: Path, server: str, token: str) -> dict[str, Any]:
    """A study whose first participant has answered the questionnaire."""
    question = {"name": "hand", "text": "Which hand?", "kind": "choice", "options": ["l", "r"], "required": True}
    content = {"optional_stages": ["interview"], "questions": [question], "spoken_questions": list(SPOKEN)}
    made = create.create_study(settings, stimulus_set, "Asked", exposure_s=0.4, options=parse_options(content))
    simulate(server, made["slug"], made["invitation"], token, 1)
    return made


def rows(analyst: httpx.Client, study: dict[str, Any], what: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = analyst.get(f"/api/v1/studies/{study['slug']}/{what}").json()
    return found


@pytest.mark.slow
def test_what_is_said_is_noted_changed_and_exported_with_what_was_written(
    experimenter: Dashboard, analyst: httpx.Client, asked: dict[str, Any]
) -> None:
    path = f"/admin/studies/{asked['slug']}/participants/P001/interview"
    assert all(question in experimenter.get(path).text for question in SPOKEN)
    experimenter.act(path, question=list(SPOKEN), answer=["The <ball>,\r\nI think", ""])
    assert (
        "The &lt;ball&gt;,\nI think"
        in experimenter.act(path, question=list(SPOKEN), answer=["The <ball>,\nI think", "No"]).text
    )
    written, first, second = rows(analyst, asked, "questionnaire")
    assert (written["source"], written["question"], written["answer"]) == ("written", "hand", "l")
    assert (first["source"], first["question"], first["answer"]) == ("spoken", SPOKEN[0], "The <ball>,\nI think")
    assert (second["answer"], second["participant"]) == ("No", "P001")
    assert first["experimenter"]
    text = analyst.get(f"/api/v1/studies/{asked['slug']}/questionnaire?format=csv").text
    assert text.startswith("participant,question,answer,answered_at,source,experimenter")


def test_two_who_note_at_once_lose_nothing(
    experimenter: Dashboard, asked: dict[str, Any], client: httpx.Client
) -> None:
    begin(client, asked["slug"], asked["invitation"])
    path = f"/admin/studies/{asked['slug']}/participants/P002/interview"
    noted = {"question": list(SPOKEN), "seen": ["", ""]}  # both opened the page when nothing was noted
    for _ in range(2):  # sent twice, it is kept
        assert experimenter.act(path, **noted, answer=["The ball", ""]).status_code == 200
    assert "Nothing else" in experimenter.act(path, **noted, answer=["", "Nothing else"]).text
    refused = experimenter.act(path, **noted, answer=["The box, because of its edges", ""])
    assert refused.status_code == 409
    assert "The box, because of its edges" in refused.text
    page = experimenter.get(path).text
    assert "The ball</textarea>" in page
    assert "Nothing else</textarea>" in page
    assert page.count('name="seen" value="The ball"') == 1


def test_only_what_a_study_asks_is_noted(experimenter: Dashboard, asked: dict[str, Any]) -> None:
    base = f"/admin/studies/{asked['slug']}/participants"
    assert experimenter.act(f"{base}/P001/interview", question="Who are you?", answer="x").status_code == 422
    assert experimenter.act(f"{base}/P001/interview", question=SPOKEN[0], answer="x" * 2001).status_code == 422
    assert experimenter.act(f"{base}/P001/interview", question=list(SPOKEN), answer="x").status_code == 422
    assert experimenter.get(f"{base}/P999/interview").status_code == 404


def test_participants_are_listed_with_how_far_they_are(
    client: httpx.Client, analyst: httpx.Client, new_study: Callable[[], dict[str, Any]]
) -> None:
    study = new_study()
    begin(client, study["slug"], study["invitation"])
    (row,) = rows(analyst, study, "participants")
    assert (row["participant"], row["stage"], row["n_votes"], row["n_trials"]) == ("P001", "trial", 0, 6)
    assert row["excluded"] is False


@pytest.mark.parametrize("what", ["participants", "screening", "questionnaire"])
def test_personal_data_takes_a_scope_of_its_own(
    server: str, settings: Settings, asked: dict[str, Any], what: str
) -> None:
    token = manage.add_token(settings, f"reads votes, not {what}", ["read"])["token"]
    address = f"{server}/api/v1/studies/{asked['slug']}/{what}"
    assert is_problem(httpx.get(address, headers={"Authorization": f"Bearer {token}"}), 403)
    assert is_problem(httpx.get(address), 401)


@pytest.mark.parametrize("content", ["Why?", [""], ["x" * 501], ["Why?", "Why? "], [1]])
def test_spoken_questions_are_texts(content: Any) -> None:
    with pytest.raises(ValueError, match="spoken_questions"):
        parse_options({"spoken_questions": content})


LETTERS = ("Ж", "語", "𝄞")  # of two, three and four bytes


@pytest.fixture(scope="module")
def long_winded(settings: Settings, stimulus_set: Path) -> dict[str, Any]:
    """A study that asks as much as a study may."""
    questions = [{"name": name, "text": f"{name}?", "kind": "text"} for name in NAMES]
    spoken = [f"{number:0{LONGEST_QUESTION}}" for number in range(MOST_SPOKEN_QUESTIONS)]
    content = {"optional_stages": ["interview"], "questions": questions, "spoken_questions": spoken}
    return create.create_study(settings, stimulus_set, "Long", exposure_s=0.4, options=parse_options(content))


@pytest.mark.slow
def test_the_longest_answers_are_kept_in_any_alphabet(
    server: str, token: str, analyst: httpx.Client, long_winded: dict[str, Any]
) -> None:
    people = [Person(answers=dict.fromkeys(NAMES, letter * LONGEST_ANSWER)) for letter in LETTERS]
    simulate(server, long_winded["slug"], long_winded["invitation"], token, people)
    kept = rows(analyst, long_winded, "questionnaire")
    for label, person in zip(("P001", "P002", "P003"), people, strict=True):
        assert {row["question"]: row["answer"] for row in kept if row["participant"] == label} == person.answers


def test_an_interview_may_be_as_long_as_its_answers_and_no_longer(
    client: httpx.Client, long_winded: dict[str, Any]
) -> None:
    begin(client, long_winded["slug"], long_winded["invitation"])
    escaped = json.dumps({"data": {"answers": dict.fromkeys(NAMES, "𝄞" * LONGEST_ANSWER)}})  # twelve bytes a letter
    headers = {"Content-Type": "application/json"}
    for stage, content, status in (
        ("interview", escaped, 409),
        ("interview", 2 * escaped, 413),
        ("trial", escaped, 413),
    ):
        answer = client.put(f"/api/v1/session/stages/{stage}", content=content, headers=headers)
        assert is_problem(answer, status), (stage, len(content))


@pytest.mark.slow
def test_the_longest_notes_of_an_interview_are_kept_in_any_alphabet(
    experimenter: Dashboard, client: httpx.Client, long_winded: dict[str, Any]
) -> None:
    begin(client, long_winded["slug"], long_winded["invitation"])
    path = f"/admin/studies/{long_winded['slug']}/participants/P001/interview"
    asked = re.findall(r'name="question" value="([^"]+)"', experimenter.get(path).text)
    assert len(asked) == MOST_SPOKEN_QUESTIONS
    seen = [""] * len(asked)
    for letter in LETTERS:
        said = [letter * LONGEST_ANSWER] * len(asked)
        assert experimenter.act(path, question=asked, answer=said, seen=seen).status_code == 200
        seen = said
    assert experimenter.get(path).text.count(f"{seen[0]}</textarea>") == len(asked)
