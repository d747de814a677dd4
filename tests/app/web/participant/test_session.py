"""A participant's way from the invitation to the last vote, over HTTP."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from uuid import uuid4

import httpx
import pytest

from app.errors import NoSessionError
from app.operations.studies import manage
from app.settings import Settings
from app.simulation.participants import begin
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.web.participant.session_bodies import present_view
from tests.app.web.http_checks import is_problem

VoteBody = Callable[..., dict[str, Any]]


def sessions(study: dict[str, Any]) -> str:
    return f"/api/v1/studies/{study['slug']}/sessions"


@pytest.mark.slow
def test_an_invitation_opens_a_session(client: httpx.Client, study: dict[str, Any]) -> None:
    answer = client.post(sessions(study), json={"invitation": study["invitation"]})
    assert answer.status_code == 201
    assert answer.json().keys() == {
        "session",
        "token",
        "resume_code",
        "study",
        "stage",
        "stages",
        "minutes",
        "progress",
        "was_away_long",
        "debriefing",
        "stopped",
        "debriefing_html",
        "ending",
        "language",
    }
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=lax" in cookie
    looked = client.get("/api/v1/session").json()
    assert looked == {key: value for key, value in answer.json().items() if key != "token"}
    assert looked["stage"] == "introduction"
    assert looked["progress"] == {"done": 0, "total": 6}
    assert looked["study"] == {"slug": study["slug"], "title": study["name"], "exposure_s": 0.4}


def test_a_token_serves_where_there_are_no_cookies(client: httpx.Client, study: dict[str, Any], server: str) -> None:
    token = client.post(sessions(study), json={"invitation": study["invitation"]}).json()["token"]
    bearer = {"Authorization": f"Bearer {token}"}
    assert httpx.get(f"{server}/api/v1/session", headers=bearer).status_code == 200
    page = {"Origin": server}
    assert client.post(sessions(study), json={"invitation": study["invitation"]}, headers=page).json()["token"] is None


@pytest.mark.parametrize("path", ["/api/v1/session", "/api/v1/session/trials/next"])
def test_without_a_session_there_is_nothing_to_see(client: httpx.Client, path: str) -> None:
    assert is_problem(client.get(path), 401)
    assert is_problem(client.get(path, headers={"Cookie": "session=invented"}), 401)


def test_an_unknown_invitation_is_not_found(client: httpx.Client, study: dict[str, Any]) -> None:
    assert is_problem(client.post(sessions(study), json={"invitation": "unknown"}), 404)


@pytest.mark.slow
def test_an_invitation_is_to_one_study_only(
    client: httpx.Client, study: dict[str, Any], new_study: Callable[[], dict[str, Any]]
) -> None:
    assert is_problem(client.post(sessions(new_study()), json={"invitation": study["invitation"]}), 404)


def test_a_used_invitation_is_gone_but_its_participant_goes_on(
    client: httpx.Client, study: dict[str, Any], settings: Settings, server: str
) -> None:
    code = manage.add_invitation(settings, study["slug"], places=1)["invitation"]
    assert client.get(f"/s/{code}").status_code == 200
    assert client.post(sessions(study), json={"invitation": code}).status_code == 201
    assert is_problem(client.post(sessions(study), json={"invitation": code}), 410)
    assert client.get(f"/s/{code}").status_code == 200
    assert httpx.get(f"{server}/s/{code}").status_code == 410


@pytest.mark.parametrize(
    "body", [{}, {"invitation": 1}, {"invitation": "a", "more": 1}, {"invitation": "a b"}, {"invitation": "a" * 41}, []]
)
def test_an_admission_is_taken_as_described_or_not_at_all(
    client: httpx.Client, study: dict[str, Any], body: Any
) -> None:
    assert is_problem(client.post(sessions(study), json=body), 422)


def test_a_stage_is_completed_once(client: httpx.Client, study: dict[str, Any]) -> None:
    client.post(sessions(study), json={"invitation": study["invitation"]})
    path = "/api/v1/session/stages/introduction"
    first, second = (client.put(path, json={"data": {"language": "en"}}) for _ in range(2))
    assert first.status_code == second.status_code == 200
    assert first.json() == second.json() == client.get("/api/v1/session").json()
    assert first.json()["stage"] == "trial"


@pytest.mark.parametrize(("stage", "status"), [("trial", 409), ("finished", 409), ("holiday", 404)])
def test_other_stages_cannot_be_completed(participant: httpx.Client, stage: str, status: int) -> None:
    assert is_problem(participant.put(f"/api/v1/session/stages/{stage}", json={"data": {}}), status)


def test_trials_wait_for_the_introduction(client: httpx.Client, study: dict[str, Any]) -> None:
    client.post(sessions(study), json={"invitation": study["invitation"]})
    assert is_problem(client.get("/api/v1/session/trials/next"), 409)


def test_what_comes_with_a_stage_is_bounded(client: httpx.Client, study: dict[str, Any]) -> None:
    client.post(sessions(study), json={"invitation": study["invitation"]})
    path = "/api/v1/session/stages/introduction"
    assert is_problem(client.put(path, json={"data": {"long": "x" * 220_000}}), 422)
    assert is_problem(
        client.put(path, content=b'{"data": {"x": NaN}}', headers={"Content-Type": "application/json"}), 422
    )


def test_the_next_trial_is_as_agreed(participant: httpx.Client) -> None:
    trial = participant.get("/api/v1/session/trials/next").json()
    one = {
        "trial",
        "attempt",
        "number",
        "place",
        "total",
        "is_practice",
        "exposure_s",
        "free_exposure",
        "see_both",
        "minimum_viewing_s",
        "protocol",
        "grades",
        "longest_gap_ms",
        "void_on",
        "full_screen",
        "minimum_window",
        "first_shown",
        "media",
    }
    assert trial.keys() == one | {"next_media", "following"}
    assert trial["following"].keys() == one
    assert trial["following"]["media"]["url"] == trial["next_media"]
    assert (trial["number"], trial["total"], trial["exposure_s"]) == (1, 6, 0.4)
    assert trial["first_shown"] in ("a", "b")
    media = trial["media"]
    assert media.keys() == {
        "url",
        "second",
        "lighter",
        "singles",
        "layout",
        "a",
        "width",
        "height",
        "guard_rows",
        "reference",
        "fps",
        "n_frames",
        "pixels",
    }
    assert media["layout"] == "stacked"
    assert media["a"] in ("top", "bottom")
    assert (media["width"], media["height"], media["guard_rows"]) == (64, 48, 16)
    assert (media["fps"], media["n_frames"]) == (25.0, 10)
    assert participant.head(media["url"]).status_code == participant.head(trial["next_media"]).status_code == 200


@pytest.mark.slow
def test_films_can_be_fetched_before_the_trials_begin(
    client: httpx.Client, study: dict[str, Any], vote_body: VoteBody
) -> None:
    client.post(sessions(study), json={"invitation": study["invitation"]})
    ahead = client.get("/api/v1/session/films").json()
    assert is_problem(client.get("/api/v1/session/trials/next"), 409)  # none is given out by that
    client.put("/api/v1/session/stages/introduction", json={"data": {}})
    for media in ahead:
        trial = client.get("/api/v1/session/trials/next").json()
        assert trial["media"] == media
        client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial))
    assert len(ahead) == 5
    assert len(client.get("/api/v1/session/films").json()) == 1


def test_reloading_goes_on_where_one_was(participant: httpx.Client, vote_body: VoteBody) -> None:
    first = participant.get("/api/v1/session/trials/next").json()
    assert participant.get("/api/v1/session/trials/next").json() == first
    participant.put(f"/api/v1/session/trials/{first['trial']}/vote", json=vote_body(first))
    second = participant.get("/api/v1/session/trials/next").json()
    assert second["number"] == 2
    assert second["media"]["url"] == first["next_media"]
    assert participant.get("/api/v1/session").json()["progress"] == {"done": 1, "total": 6}


def test_a_resume_code_may_be_written_in_groups_and_capitals(participant: httpx.Client, server: str) -> None:
    code = participant.get("/api/v1/session").json()["resume_code"].upper()
    grouped = {"resume_code": f"{code[:4]}-{code[4:8]} {code[8:]}"}
    assert httpx.post(f"{server}/api/v1/session/resume", json=grouped).status_code == 200


def test_a_resume_code_goes_on_in_another_browser(participant: httpx.Client, vote_body: VoteBody, server: str) -> None:
    trial = participant.get("/api/v1/session/trials/next").json()
    participant.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial))
    code = participant.get("/api/v1/session").json()["resume_code"]
    with httpx.Client(base_url=server) as elsewhere:
        answer = elsewhere.post("/api/v1/session/resume", json={"resume_code": code})
        assert answer.status_code == 200
        assert elsewhere.get("/api/v1/session").json()["progress"]["done"] == 1
        assert is_problem(elsewhere.post("/api/v1/session/resume", json={"resume_code": code}), 404)
    assert is_problem(participant.get("/api/v1/session"), 401)


def test_a_resume_whose_answer_was_lost_is_repeated_by_its_key(participant: httpx.Client, server: str) -> None:
    body = {"resume_code": participant.get("/api/v1/session").json()["resume_code"], "key": str(uuid4())}
    path = f"{server}/api/v1/session/resume"
    first, second = (httpx.post(path, json=body) for _ in range(2))
    assert (first.status_code, second.status_code) == (200, 200)
    assert first.json() == second.json()
    assert is_problem(httpx.post(path, json=body | {"key": str(uuid4())}), 404)


def test_a_session_that_went_on_elsewhere_during_a_request_is_told_as_any_that_is_not_there(settings: Settings) -> None:
    with open_database(settings.url) as database, pytest.raises(NoSessionError):
        present_view(database, "ended meanwhile", utc_now())


def test_what_is_meant_for_another_session_than_the_cookies_is_refused(
    participant: httpx.Client, vote_body: VoteBody
) -> None:
    trial, session = (participant.get(f"/api/v1/session{path}").json() for path in ("/trials/next", ""))
    of_trial, record = f"/api/v1/session/trials/{trial['trial']}", vote_body(trial)
    own, other = {"Session-Id": session["session"]}, {"Session-Id": "another"}
    for method, path, body in (
        ("GET", "/api/v1/session", None),
        ("GET", "/api/v1/session/trials/next", None),
        ("PUT", f"{of_trial}/vote", record),
        ("PUT", f"{of_trial}/void", {"reason": "hidden", "viewing": record["viewing"]}),
        ("PUT", "/api/v1/session/stages/introduction", {"data": {}}),
        ("PUT", "/api/v1/session/withdrawal", None),
    ):
        assert is_problem(participant.request(method, path, json=body, headers=other), 401)
    assert participant.get("/api/v1/session", headers=own).json() == session
    assert participant.put(f"{of_trial}/vote", json=record, headers=own).status_code == 201


def test_a_vote_of_the_session_before_waits_for_its_own_cookie(
    participant: httpx.Client, study: dict[str, Any], vote_body: VoteBody
) -> None:
    trial, session = (participant.get(f"/api/v1/session{path}").json() for path in ("/trials/next", ""))
    path, own = f"/api/v1/session/trials/{trial['trial']}/vote", {"Session-Id": session["session"]}
    participant.post(sessions(study), json={"invitation": study["invitation"]}, headers=own)
    assert is_problem(participant.put(path, json=vote_body(trial), headers=own), 401)
    participant.post("/api/v1/session/resume", json={"resume_code": session["resume_code"]}, headers=own)
    assert participant.put(path, json=vote_body(trial), headers=own).status_code == 201


def test_the_form_to_go_on_may_be_sent_twice_by_the_browser_that_has_it(participant: httpx.Client, server: str) -> None:
    code = participant.get("/api/v1/session").json()["resume_code"]

    def fill_in(browser: httpx.Client) -> httpx.Response:
        browser.get("/")
        return browser.post("/resume", data={"resume_code": code, "form_token": browser.cookies["entry"]})

    with httpx.Client(base_url=server) as elsewhere, httpx.Client(base_url=server) as stranger:
        first, second = (fill_in(elsewhere) for _ in range(2))
        assert (first.status_code, second.status_code) == (303, 303)
        assert first.headers["location"] == second.headers["location"]
        assert fill_in(stranger).status_code == 404
        assert elsewhere.get("/api/v1/session").status_code == 200


def test_a_code_from_a_browser_that_refuses_cookies_is_answered_with_what_to_do(
    participant: httpx.Client, server: str
) -> None:
    code = participant.get("/api/v1/session").json()["resume_code"]
    answer = httpx.post(f"{server}/resume", data={"resume_code": code, "form_token": "of a lost cookie"})
    assert answer.status_code == 403
    assert "Please allow cookies for this page" in answer.text
    assert "Please allow cookies for this page" not in httpx.get(server).text


@pytest.mark.slow
def test_the_way_ends_after_the_last_vote(participant: httpx.Client, vote_body: VoteBody) -> None:
    seen = set()
    for number in range(1, 7):
        trial = participant.get("/api/v1/session/trials/next").json()
        assert trial["number"] == number
        assert (trial["next_media"] is None) == (number == 6)
        seen.add(participant.get(trial["media"]["url"]).content)
        answer = participant.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial))
        assert answer.status_code == 201
    assert len(seen) == 6
    assert participant.get("/api/v1/session/trials/next").status_code == 204
    assert participant.get("/api/v1/session").json()["stage"] == "finished"


def test_a_begin_whose_answer_was_lost_is_repeated_by_its_key(
    client: httpx.Client, study: dict[str, Any], settings: Settings
) -> None:
    code = manage.add_invitation(settings, study["slug"], places=1)["invitation"]
    admission = {"invitation": code, "key": str(uuid4())}
    first, second = (client.post(sessions(study), json=admission) for _ in range(2))
    assert (first.status_code, second.status_code) == (201, 200)
    assert first.json() == second.json()
    assert is_problem(client.post(sessions(study), json=admission | {"key": str(uuid4())}), 410)


def test_a_key_does_not_bring_a_session_back_that_goes_on_elsewhere(
    client: httpx.Client, study: dict[str, Any], server: str
) -> None:
    admission = {"invitation": study["invitation"], "key": str(uuid4())}
    code = client.post(sessions(study), json=admission).json()["resume_code"]
    assert httpx.post(f"{server}/api/v1/session/resume", json={"resume_code": code}).status_code == 200
    assert is_problem(client.post(sessions(study), json=admission), 409)


def test_a_key_belongs_to_one_invitation(
    client: httpx.Client, study: dict[str, Any], new_study: Callable[[], dict[str, Any]]
) -> None:
    key, other = str(uuid4()), new_study()
    client.post(sessions(study), json={"invitation": study["invitation"], "key": key})
    assert is_problem(client.post(sessions(other), json={"invitation": other["invitation"], "key": key}), 409)


@pytest.mark.slow
def test_a_withdrawal_ends_the_session_and_marks_its_votes(
    client: httpx.Client, new_study: Callable[[], dict[str, Any]], vote_body: VoteBody, analyst: httpx.Client
) -> None:
    study = new_study()
    begin(client, study["slug"], study["invitation"])
    kept, late = (client.get("/api/v1/session/trials/next").json()[name] for name in ("trial", "following"))
    trial = client.get("/api/v1/session/trials/next").json()
    path, body = f"/api/v1/session/trials/{kept}/vote", vote_body(trial)
    assert client.put(path, json=body).status_code == 201
    first, second = (client.put("/api/v1/session/withdrawal") for _ in range(2))
    assert first.json()["stage"] == second.json()["stage"] == "withdrawn"
    assert client.put(path, json=body).status_code == 200  # what was kept may be sent again
    too_late = client.put(f"/api/v1/session/trials/{late['trial']}/vote", json=vote_body(late))
    assert is_problem(too_late, 410)
    assert is_problem(client.get("/api/v1/session/trials/next"), 410)
    assert is_problem(client.put("/api/v1/session/stages/introduction", json={"data": {}}), 409)
    (vote,) = analyst.get(f"/api/v1/studies/{study['slug']}/votes").json()
    assert (vote["excluded"], vote["reason"]) == (True, "withdrawn")


def test_an_interrupted_trial_comes_once_more_at_the_end(
    participant: httpx.Client, vote_body: VoteBody, analyst: httpx.Client, study: dict[str, Any]
) -> None:
    first = participant.get("/api/v1/session/trials/next").json()
    path = f"/api/v1/session/trials/{first['trial']}"
    record = {"reason": "hidden", "viewing": vote_body(first)["viewing"]}
    assert [participant.put(f"{path}/void", json=record).status_code for _ in range(2)] == [204, 204]
    assert is_problem(participant.put(f"{path}/vote", json=vote_body(first)), 409)
    for number in range(1, 7):
        trial = participant.get("/api/v1/session/trials/next").json()
        assert (trial["number"], trial["total"], trial["attempt"]) == (number, 6, 1 if number < 6 else 2)
        assert trial["place"] == (number + 1 if number < 6 else first["place"]), "its own number"
        if number < 6:
            participant.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial))
    assert trial["media"]["url"] != first["media"]["url"]
    again, before = (participant.get(shown["media"]["url"]).content for shown in (trial, first))
    assert again == before, "the same pair"
    again = f"/api/v1/session/trials/{trial['trial']}"
    assert is_problem(participant.put(f"{again}/void", json=record), 409)
    assert participant.put(f"{again}/vote", json=vote_body(trial)).status_code == 201
    assert participant.get("/api/v1/session").json()["stage"] == "finished"
    session = participant.get("/api/v1/session").json()["session"]
    rows = analyst.get(f"/api/v1/studies/{study['slug']}/trials", params={"session": session}).json()
    (void,) = [row for row in rows if row["voided_at"]]
    assert (void["trial"], void["void_reason"], void["viewing"]) == (first["trial"], "hidden", record["viewing"])
    assert len([row for row in rows if row["choice"]]) == 6


@pytest.mark.parametrize("change", [{"reason": "bored"}, {"viewing": None}, {"more": 1}])
def test_an_interruption_is_told_as_described_or_not_at_all(
    participant: httpx.Client, vote_body: VoteBody, change: dict[str, Any]
) -> None:
    trial = participant.get("/api/v1/session/trials/next").json()
    record = {"reason": "hidden", "viewing": vote_body(trial)["viewing"]} | change
    assert is_problem(participant.put(f"/api/v1/session/trials/{trial['trial']}/void", json=record), 422)


def test_the_following_trial_may_be_voted_on_before_it_is_asked_for(
    participant: httpx.Client, vote_body: VoteBody
) -> None:
    trial = participant.get("/api/v1/session/trials/next").json()
    for one in (trial, trial["following"]):
        answer = participant.put(f"/api/v1/session/trials/{one['trial']}/vote", json=vote_body(one))
        assert answer.status_code == 201
    assert participant.get("/api/v1/session/trials/next").json()["number"] == 3
