"""Participants are looked after over REST as on the dashboard."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any
from uuid import uuid4

import httpx
import pytest

from app.operations.studies import manage
from app.settings import Settings
from app.simulation.participants import begin, simulate
from app.store.access.rights import SCOPES
from tests.app.conftest import ABILITIES
from tests.app.web.http_checks import is_problem

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def lent(server: str, token: str, new_study: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """A study with two participants who have finished, and one who has begun."""
    study = new_study()
    simulate(server, study["slug"], study["invitation"], token, 2, ABILITIES, 0.2, seed=4)
    with httpx.Client(base_url=server) as client:
        begin(client, study["slug"], study["invitation"])
    return study


def with_scopes(server: str, settings: Settings, *scopes: str) -> httpx.Client:
    token = manage.add_token(settings, f"people {uuid4()}", scopes)["token"]
    return httpx.Client(base_url=f"{server}/api/v1/", headers={"Authorization": f"Bearer {token}"}, timeout=60)


@pytest.fixture
def manager(server: str, settings: Settings) -> Iterator[httpx.Client]:
    with with_scopes(server, settings, *SCOPES) as client:
        yield client


def test_who_withdraws_counts_no_more_and_who_is_erased_is_gone(manager: httpx.Client, lent: dict[str, Any]) -> None:
    base = f"studies/{lent['slug']}"
    assert [manager.put(f"{base}/participants/P001/withdrawal").status_code for _ in range(2)] == [204, 204]
    assert {row["reason"] for row in manager.get(f"{base}/votes").json() if row["participant"] == "P001"} == {
        "withdrawn"
    }
    assert manager.get(f"{base}/participants/P001").json()["label"] == "P001"
    assert manager.put(f"{base}/participants/P001/erasure").status_code == 204
    assert is_problem(manager.put(f"{base}/participants/P001/erasure"), 409)
    assert "P001" not in {row["participant"] for row in manager.get(f"{base}/votes").json()}
    assert is_problem(manager.put(f"{base}/participants/P099/erasure"), 404)


@pytest.mark.parametrize("what", ["withdrawal", "erasure"])
def test_what_cannot_be_undone_takes_a_scope_of_its_own(
    server: str, settings: Settings, lent: dict[str, Any], what: str
) -> None:
    with with_scopes(server, settings, "read", "personal", "participants:write", "studies:write") as client:
        answer = client.put(f"studies/{lent['slug']}/participants/P002/{what}")
    assert is_problem(answer, 403)
    assert "participants:erase" in answer.json()["detail"]


def test_a_new_code_lets_a_participant_go_on(server: str, manager: httpx.Client, lent: dict[str, Any]) -> None:
    made = manager.post(f"studies/{lent['slug']}/participants/P003/resume-code")
    assert (made.status_code, made.json()["participant"]) == (201, "P003")
    with httpx.Client(base_url=server) as browser:
        assert browser.post("/api/v1/session/resume", json={"resume_code": made.json()["code"]}).status_code == 200
    assert is_problem(manager.post(f"studies/{lent['slug']}/participants/P002/resume-code"), 409)


def test_a_result_of_a_printed_chart_is_entered(manager: httpx.Client, lent: dict[str, Any]) -> None:
    path = f"studies/{lent['slug']}/participants/P002/screening"
    body = {"test": "acuity", "instrument": "Landolt C at 4 m", "result": "0.1", "verdict": "passed", "logmar": 0.1}
    assert manager.post(path, json=body).status_code == 204
    (row,) = manager.get(f"studies/{lent['slug']}/screening").json()
    assert (row["participant"], row["instrument"], row["logmar"]) == ("P002", "Landolt C at 4 m", 0.1)
    assert manager.post(path, json={**body, "verdict": "perhaps"}).status_code == 422


def test_outside_ids_take_the_scope_that_gives_out_codes(
    server: str, settings: Settings, manager: httpx.Client, lent: dict[str, Any]
) -> None:
    assert manager.get(f"studies/{lent['slug']}/outside-ids").json() == []
    with with_scopes(server, settings, "read", "personal") as client:
        assert is_problem(client.get(f"studies/{lent['slug']}/outside-ids"), 403)


def test_an_invitation_is_labelled_over_rest(manager: httpx.Client, lent: dict[str, Any]) -> None:
    path = f"studies/{lent['slug']}/invitations"
    (made,) = manager.post(path, json={"places": 1, "label": "Ada"}).json()
    assert made["label"] == "Ada"
    assert manager.patch(f"{path}/{made['code']}", json={"label": "Ada  Example"}).status_code == 204
    assert {row["label"] for row in manager.get(path).json() if row["code"] == made["code"]} == {"Ada Example"}
    assert is_problem(manager.patch(f"{path}/nosuchcode", json={"label": ""}), 404)


def test_what_was_said_in_an_interview_is_noted_over_rest(
    manager: httpx.Client, new_study: Callable[[], dict[str, Any]], server: str, token: str
) -> None:
    study = new_study()
    question = "What did you look at?"
    base = f"studies/{study['slug']}"
    asked = {"optional_stages": ["interview"], "spoken_questions": [question]}
    wanted = {"revision": manager.get(base).json()["revision"], "options": asked}
    assert manager.patch(base, json=wanted).status_code == 200
    simulate(server, study["slug"], study["invitation"], token, 1, ABILITIES, 0.2, seed=4)
    person = f"{base}/participants/P001"
    assert manager.put(f"{person}/interview", json={"answers": {question: "Faces."}}).status_code == 204
    said = [row for row in manager.get(f"{base}/questionnaire").json() if row["source"] == "spoken"]
    assert [(row["participant"], row["question"], row["answer"]) for row in said] == [("P001", question, "Faces.")]
    assert is_problem(manager.put(f"{person}/interview", json={"answers": {"Another?": "No."}}), 422)


def test_who_had_bad_luck_may_begin_anew_over_rest(manager: httpx.Client, lent: dict[str, Any]) -> None:
    person = f"studies/{lent['slug']}/participants/P002"
    assert manager.post(f"{person}/again").status_code == 204
    rows = {row["participant"]: row for row in manager.get(f"studies/{lent['slug']}/participants").json()}
    assert rows["P002"]["excluded"] is True
    again = manager.post(f"{person}/again")
    assert is_problem(again, 409)
    assert again.json()["detail"] == "P002 may take part again already, by the same link."


def test_comments_are_noted_and_coded_over_rest(
    manager: httpx.Client, new_study: Callable[[], dict[str, Any]], server: str, token: str
) -> None:
    study = new_study()
    base = f"studies/{study['slug']}"
    simulate(server, study["slug"], study["invitation"], token, 1, ABILITIES, 0.2, seed=4)
    trial = manager.get(f"{base}/trials").json()[0]["trial"]
    assert manager.put(f"{base}/trials/{trial}/comment", json={"comment": "Waxy."}).status_code == 204
    assert is_problem(manager.put(f"{base}/trials/no-such/comment", json={"comment": "Waxy."}), 404)
    (row,) = manager.get(f"{base}/comments").json()
    place = {name: row[name] for name in ("participant", "source", "subject")}
    assert place == {"participant": "P001", "source": "trial", "subject": trial}

    def tags() -> list[dict[str, Any]]:
        return list(manager.get(f"{base}/comment_tags").json())

    for _ in range(2):
        assert manager.put(f"{base}/comment_tags/skin%2Fhair").status_code == 204
        assert manager.put(f"{base}/comments/tag", params={**place, "tag": "faces"}).status_code == 204
    assert [(each["tag"], each["n_comments"]) for each in tags()] == [("faces", 1), ("skin/hair", 0)]
    assert manager.patch(f"{base}/comment_tags/faces", json={"tag": "heads"}).status_code == 204
    assert manager.get(f"{base}/comments").json()[0]["tags"] == ["heads"]
    assert is_problem(manager.patch(f"{base}/comment_tags/heads", json={"tag": "skin/hair"}), 409)
    assert is_problem(manager.put(f"{base}/comments/tag", params={**place, "subject": "x", "tag": "y"}), 404)
    assert manager.delete(f"{base}/comments/tag", params={**place, "tag": "heads"}).status_code == 204
    assert manager.delete(f"{base}/comment_tags/heads").status_code == 204
    assert [each["tag"] for each in tags()] == ["skin/hair"]
    assert is_problem(manager.delete(f"{base}/comment_tags/heads"), 404)
    actions = {row["action"] for row in manager.get(f"{base}/audit").json()}
    assert {"tag added", "comment tagged", "tag renamed", "tag taken off", "tag deleted"} <= actions


def test_groups_are_set_over_rest_by_the_rules_of_the_form(
    manager: httpx.Client, new_study: Callable[[], dict[str, Any]]
) -> None:
    base = f"studies/{new_study()['slug']}"
    known = manager.get(base).json()
    groups = [{"name": "near", "datasets": [known["datasets"][0]]}, {"name": "far", "datasets": []}]
    wanted = {"revision": known["revision"], "options": {"groups": groups}}
    unknown = [groups[0], {"name": "far", "datasets": ["nowhere"]}]
    refused = manager.patch(base, json={**wanted, "options": {"groups": unknown}})
    assert is_problem(refused, 422)
    assert "group 'far': there is no dataset 'nowhere'" in refused.json()["detail"]
    assert manager.patch(base, json=wanted).json()["options"]["groups"] == groups
    assert is_problem(manager.patch(base, json=wanted), 409), "somebody has changed it since"
