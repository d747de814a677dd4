"""People from a recruiting platform: one session for each id, the way back, and nothing of it among the scores."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import Any
from uuid import uuid4
from zipfile import ZipFile

import httpx
import pytest
from sqlalchemy import update

from app.operations.studies.create import create_study
from app.operations.studies.manage import add_invitation
from app.settings import Settings
from app.simulation.participants import begin, next_trial, simulate
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.database.steady_clock import running_s
from app.store.database.tables import session
from app.store.studies.studies import edit_study, set_standing, study_by_slug
from app.store.trials.admission import begin_preview
from app.study.options.options import parse_options
from app.study.options.platforms import PLATFORMS, link_query
from app.study.stages import FINISHED
from tests.app.web.admin.dashboard_client import Dashboard
from tests.app.web.http_checks import is_problem
from tests.recruiting_platform import OPTIONS, Platform

pytestmark = pytest.mark.slow

URLS = ("complete_url", "screened_out_url", "no_consent_url", "full_url")
Create = Callable[..., dict[str, Any]]
VoteBody = Callable[..., dict[str, Any]]


@pytest.fixture
def platform() -> Platform:
    return Platform()


@pytest.fixture
def create(settings: Settings, stimulus_set: Any) -> Create:
    def make(outside: dict[str, Any] | None = None, **options: Any) -> dict[str, Any]:
        content = {"outside": OPTIONS | (outside or {}), **options}
        return create_study(settings, stimulus_set, f"S {uuid4()}", exposure_s=0.4, options=parse_options(content))

    return make


@contextmanager
def a_browser(server: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=server, timeout=30) as browser:
        yield browser


def enters(browser: httpx.Client, study: dict[str, Any], person: str, **changes: Any) -> httpx.Response:
    """What the page's Begin sends."""
    body = {"invitation": study["invitation"], "key": str(uuid4()), "outside": {"PERSON": person, "TASK": "task-7"}}
    return browser.post(f"/api/v1/studies/{study['slug']}/sessions", json=body | changes)


def goes_through(browser: httpx.Client, vote_body: VoteBody) -> dict[str, Any]:
    """From the introduction to the end; the session as it is then."""
    browser.put("/api/v1/session/stages/introduction", json={"data": {}})
    while (answer := browser.get("/api/v1/session/trials/next")).status_code == 200:
        trial = answer.json()
        sent = browser.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial))
        assert sent.status_code == 201
    ended: dict[str, Any] = browser.get("/api/v1/session").json()
    return ended


def test_who_is_sent_in_comes_back_with_a_code_that_the_experimenter_can_check(
    client: httpx.Client, create: Create, platform: Platform, vote_body: VoteBody, experimenter: Dashboard
) -> None:
    study = create()
    page = client.get(platform.link(study["path"], "p-1"))
    assert page.status_code == 200
    assert "UNASKED" not in page.text.replace("&#34;", '"').partition("data-outside")[2].partition(">")[0]
    begun = enters(client, study, "p-1").json()
    assert begun["ending"] is None
    ending = goes_through(client, vote_body)["ending"]
    assert platform.receive(ending["url"]).status_code == 200
    assert (platform.states, platform.codes) == ({"p-1": "complete"}, {"p-1": ending["code"]})
    base = f"/admin/studies/{study['slug']}/participants"
    table = experimenter.get(f"{base}/outside-ids.csv").text
    assert table == f"participant,outside_id,state,completion_code\r\nP001,p-1,finished,{ending['code']}\r\n"
    shown = experimenter.get(f"{base}/P001").text
    assert all(f">{text}" in shown for text in ("p-1", "task-7", ending["code"]))
    assert "p-1" in experimenter.get(base).text


def test_everybody_gets_another_code_unless_the_study_has_one_for_all(
    server: str, create: Create, vote_body: VoteBody
) -> None:
    codes = []
    for study in (create(), create({"random_codes": False, "code": "C0DE"})):
        for person in ("p-1", "p-2"):
            with a_browser(server) as browser:
                enters(browser, study, person)
                codes.append(goes_through(browser, vote_body)["ending"]["code"])
    assert len(set(codes[:2])) == 2
    assert codes[2:] == ["C0DE", "C0DE"]


def test_the_same_link_in_another_browser_leads_to_the_same_session(
    client: httpx.Client, server: str, create: Create, platform: Platform, vote_body: VoteBody
) -> None:
    study = create()
    first = enters(client, study, "p-1").json()
    client.put("/api/v1/session/stages/introduction", json={"data": {}})
    trial = client.get("/api/v1/session/trials/next").json()
    client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial))
    with a_browser(server) as other:
        page = other.get(platform.link(study["path"], "p-1"))
        assert 'data-state="known"' in page.text
        again = enters(other, study, "p-1")
        assert again.status_code == 200
        assert (again.json()["session"], again.json()["progress"]["done"]) == (first["session"], 1)
        assert is_problem(client.get("/api/v1/session"), 401)  # the older browser is signed out
        assert goes_through(other, vote_body)["ending"]["url"]
        assert enters(client, study, "p-1").json()["ending"]["code"]  # who lost the code finds it again


def test_two_tabs_and_a_request_sent_twice_are_one_session(client: httpx.Client, create: Create) -> None:
    study = create()
    key = str(uuid4())
    answers = [enters(client, study, "p-1", key=key) for _ in range(2)] + [enters(client, study, "p-1")]
    assert [answer.status_code for answer in answers] == [201, 200, 200]
    assert len({answer.json()["session"] for answer in answers}) == 1
    assert client.get("/api/v1/session").json()["session"] == answers[0].json()["session"]


def test_another_id_at_the_same_browser_is_another_person(
    client: httpx.Client, create: Create, platform: Platform
) -> None:
    study = create()
    enters(client, study, "p-1")
    assert 'data-state="mine"' in client.get(platform.link(study["path"], "p-1")).text
    assert 'data-state="mine"' in client.get(study["path"]).text  # loaded again: the page drops the parameters
    assert 'data-state="open"' in client.get(platform.link(study["path"], "p-2")).text
    assert enters(client, study, "p-2").status_code == 201


def test_a_study_may_let_an_id_go_on_only_where_it_began(
    client: httpx.Client, server: str, create: Create, platform: Platform
) -> None:
    study = create({"resume": "same browser"})
    code = enters(client, study, "p-1").json()["resume_code"]
    with a_browser(server) as other:
        refused = other.get(platform.link(study["path"], "p-1"))
        assert refused.status_code == 409
        assert 'name="resume_code"' in refused.text
        assert is_problem(enters(other, study, "p-1"), 409)
        assert client.get("/api/v1/session").status_code == 200
        assert other.post("/api/v1/session/resume", json={"resume_code": code}).status_code == 200
    with a_browser(server) as holder:
        holder.cookies = other.cookies
        assert enters(holder, study, "p-1").status_code == 200


@pytest.mark.parametrize("person", ["", "{{%PERSON%}}", "x" * 101])
def test_a_link_that_does_not_say_who_comes_is_refused(client: httpx.Client, create: Create, person: str) -> None:
    study = create()
    assert client.get(study["path"], params={"PERSON": person}).status_code == 422
    assert is_problem(enters(client, study, person), 422)
    assert client.get(study["path"]).status_code == 422


@pytest.mark.parametrize("name", ["PERSON", "TASK"])
def test_a_link_that_says_two_different_things_is_refused(client: httpx.Client, create: Create, name: str) -> None:
    path = create()["path"]
    rest = "PERSON=p-1&" if name == "TASK" else ""
    assert client.get(f"{path}?{rest}{name}=a&{name}=a").status_code == 200
    assert client.get(f"{path}?{rest}{name}=a&{name}=b").status_code == 422


def test_ids_and_codes_are_in_no_table_that_analysts_read(
    client: httpx.Client, analyst: httpx.Client, create: Create, vote_body: VoteBody
) -> None:
    study = create()
    enters(client, study, "p-secret-1")
    code = goes_through(client, vote_body)["ending"]["code"]
    base = f"/api/v1/studies/{study['slug']}"
    names = ("votes", "trials", "participants", "questionnaire", "scores", "audit")
    answers = [analyst.get(base + table) for table in ("", *(f"/{name}" for name in names))]
    assert [answer.status_code for answer in answers] == [200] * len(answers)
    archive = ZipFile(io.BytesIO(analyst.get(f"{base}/archive.zip").content))
    for content in (*(answer.content for answer in answers), *map(archive.read, archive.namelist())):
        assert b"p-secret-1" not in content
        assert code.encode() not in content


def test_the_code_of_everybody_and_the_ways_back_are_in_no_archive_and_no_audit_log(
    analyst: httpx.Client, create: Create, experimenter: Dashboard
) -> None:
    study = create({"random_codes": False, "code": "F1RST"})
    page = experimenter.get(f"/admin/studies/{study['slug']}/edit").text
    revision = re.search(r'name="revision" value="(\d+)"', page)
    assert revision
    url = "https://platform.test/complete?credit_token=T0KEN&person={id}"
    given = {"outside.code": "S3COND", "outside.complete_url": url, "revision": revision[1]}
    assert experimenter.act(f"/admin/studies/{study['slug']}/edit", **given).status_code == 200
    base = f"/api/v1/studies/{study['slug']}"
    archive = ZipFile(io.BytesIO(analyst.get(f"{base}/archive.zip").content))
    contents = {name: archive.read(name).decode("utf-8", "replace") for name in archive.namelist()}
    contents["audit"] = analyst.get(f"{base}/audit").text
    assert "study edited" in contents["audit"]
    assert "PERSON" in contents[f"{study['slug']}/study.toml"]
    for name, content in contents.items():
        for secret in ("F1RST", "S3COND", "T0KEN"):
            assert secret not in content, (name, secret)


def test_who_is_screened_out_goes_back_without_a_code(client: httpx.Client, create: Create, platform: Platform) -> None:
    study = create(optional_stages=["screening"], screening={"tests": ["acuity"], "on_failure": "stop"})
    platform.link(study["path"], "p-1")
    enters(client, study, "p-1")
    client.put("/api/v1/session/stages/introduction", json={"data": {}})
    assert client.put("/api/v1/session/screening/acuity/skip", json={"reason": "no card"}).is_success
    ended = client.put("/api/v1/session/stages/screening", json={"data": {}}).json()
    assert (ended["stage"], ended["ending"]["code"]) == ("screened_out", None)
    platform.receive(ended["ending"]["url"])
    assert platform.states == {"p-1": "screened-out"}
    assert enters(client, study, "p-1").json()["stage"] == "screened_out"  # and stays so


def test_a_study_takes_in_as_many_as_may_finish_and_sends_others_back(
    server: str, create: Create, platform: Platform, vote_body: VoteBody, experimenter: Dashboard
) -> None:
    study = create(limits={"finished": 2})
    with a_browser(server) as first, a_browser(server) as second, a_browser(server) as third:
        enters(first, study, "p-1")
        enters(second, study, "p-2")
        goes_through(first, vote_body)
        refused = enters(third, study, "p-3")
        assert is_problem(refused, 403)
        assert refused.json()["standing"] == "full"
        page = third.get(platform.link(study["path"], "p-3"))
        assert page.status_code == 403
        assert 'href="https://platform.test/full?person=p-3"' in page.text
        assert enters(second, study, "p-2").status_code == 200  # who has begun goes on
        overview = experimenter.get(f"/admin/studies/{study['slug']}").text
        assert "Full: nobody more is taken in now." in overview
        assert "1 finished, 1 under way; at most 2 finish" in overview
        second.put("/api/v1/session/withdrawal")
        assert enters(third, study, "p-3").status_code == 201


def test_who_takes_too_long_reads_so_and_the_place_is_given_out_again(
    client: httpx.Client, server: str, settings: Settings, create: Create
) -> None:
    study = create(limits={"finished": 1, "minutes": 30})
    enters(client, study, "p-1")
    client.put("/api/v1/session/stages/introduction", json={"data": {}})
    assert client.get("/api/v1/session/trials/next").status_code == 200
    database = open_database(settings.url)
    with database.writing() as connection:
        public_id = client.get("/api/v1/session").json()["session"]
        late = update(session).where(session.c.public_id == public_id)
        connection.execute(late.values(started_at=utc_now() - timedelta(days=2), running_s=running_s() - 29 * 60))
    assert client.get("/api/v1/session").json()["stage"] == "trial"  # the clock was set; no two days have passed
    with a_browser(server) as other:
        assert is_problem(enters(other, study, "p-3"), 403)
    with database.writing() as connection:
        connection.execute(late.values(started_at=utc_now(), running_s=running_s() - 31 * 60))
    database.dispose()
    with a_browser(server) as other:
        assert enters(other, study, "p-2").status_code == 201
    assert client.get("/api/v1/session").json()["stage"] == "timed_out"
    assert client.get("/api/v1/session/trials/next").status_code == 204
    assert is_problem(client.put("/api/v1/session/stages/introduction", json={"data": {}}), 409)


def test_who_has_begun_goes_on_when_the_study_is_closed(
    client: httpx.Client, server: str, settings: Settings, create: Create, platform: Platform
) -> None:
    study = create()
    enters(client, study, "p-1")
    database = open_database(settings.url)
    with database.writing() as connection:
        known = study_by_slug(connection, study["slug"])
        assert known is not None
        set_standing(connection, known.id, "closed", utc_now())
    database.dispose()
    with a_browser(server) as other:
        assert other.get(platform.link(study["path"], "p-1")).status_code == 200
        assert enters(other, study, "p-1").status_code == 200
        assert other.get(platform.link(study["path"], "p-2")).status_code == 403


def test_erasing_a_participant_erases_the_id(client: httpx.Client, create: Create, experimenter: Dashboard) -> None:
    study = create()
    first = enters(client, study, "p-1").json()["session"]
    base = f"/admin/studies/{study['slug']}/participants"
    assert "p-1" in experimenter.get(f"{base}/P001/export.json").text
    experimenter.act(f"{base}/P001/erase", again="P001")
    assert "p-1" not in experimenter.get(f"{base}/P001").text + experimenter.get(f"{base}/outside-ids.csv").text
    assert enters(client, study, "p-1").json()["session"] != first


def test_the_form_changes_how_people_come_even_after_some_have(
    client: httpx.Client, create: Create, experimenter: Dashboard
) -> None:
    study = create()
    enters(client, study, "p-1")
    path = f"/admin/studies/{study['slug']}/edit"
    fields = {
        "revision": "1", "name": study["name"], "outside.id": "RID", "outside.keep": "SID, WAVE",
        "outside.resume": "same browser", "outside.code": "DONE", "outside.redirect_after_s": "0",
        "outside.complete_url": "https://example.org/?r={RID}&c={code}", "limits.finished": "20",
        "limits.under_way": "5", "limits.open_until": "", "limits.minutes": "45", "field": "outside.random_codes",
    }  # fmt: skip
    refused = experimenter.act(path, **fields)
    assert refused.status_code == 422
    assert "Address at the end holds {RID}, expected {id}, {SID}, {WAVE}, {code}" in refused.text
    fields["outside.complete_url"] = "https://example.org/?r={id}&c={code}"
    saved = experimenter.act(path, **fields)
    assert saved.status_code == 200
    for text in ('name="outside.id" maxlength="1000" value="RID"', 'value="SID WAVE"', 'value="45"'):
        assert text in saved.text


def test_who_began_before_a_study_took_ids_finds_its_code_at_the_end_and_a_preview_none(
    client: httpx.Client, settings: Settings, create: Create, vote_body: VoteBody, server: str
) -> None:
    study = create({"id": "", "keep": [], "random_codes": False, **dict.fromkeys(URLS, ""), "code": "C0DE"})
    enters(client, study, "p-1")
    with open_database(settings.url) as database:
        with database.writing() as connection:
            made = study_by_slug(connection, study["slug"])
            assert made is not None
            outside = {"id": "PERSON", "code": "C0DE", "complete_url": "https://platform.test/?c={code}"}
            edit_study(connection, made.id, made.revision, {"options": {**made.options, "outside": outside}})
        preview = begin_preview(database, made, utc_now(), FINISHED)
    assert goes_through(client, vote_body)["ending"] == {
        "code": "C0DE", "url": "https://platform.test/?c=C0DE", "after_s": 10
    }  # fmt: skip
    seen = httpx.get(f"{server}/api/v1/session", headers={"Authorization": f"Bearer {preview}"}).json()
    assert (seen["stage"], seen["ending"]) == ("finished", None)


def test_simulated_participants_of_such_a_study_have_ids_too(
    server: str, token: str, create: Create, client: httpx.Client
) -> None:
    study = create()
    with pytest.raises(ValueError, match="the link has no PERSON"):
        begin(client, study["slug"], study["invitation"])
    abilities = {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}
    made = simulate(server, study["slug"], study["invitation"], token, 1, abilities, 0.0, outside_id="PERSON")
    assert made["votes"] == 6
    assert next_trial(client, begin(client, study["slug"], study["invitation"], outside_id="PERSON")["token"])


def test_the_link_for_the_platform_is_whole_on_every_page(server: str, create: Create, experimenter: Dashboard) -> None:
    prolific = {"id": "PROLIFIC_PID", "keep": ["STUDY_ID"], "code": "C1", "complete_url": "https://a.test/?cc={code}"}
    study = create(
        {**dict.fromkeys(("screened_out_url", "no_consent_url", "full_url"), ""), "random_codes": False} | prolific
    )
    link = f"{server}/s/{study['invitation']}?PROLIFIC_PID={{{{%PROLIFIC_PID%}}}}&STUDY_ID={{{{%STUDY_ID%}}}}"
    base = f"/admin/studies/{study['slug']}"
    for page in (base, f"{base}/invitations", f"{base}/invitations/print"):
        assert link in html.unescape(experimenter.get(page).text)
    assert link in experimenter.get(f"{base}/invitations/invitations.csv").text


def test_a_platform_that_fills_in_no_links_is_given_lines_for_its_own_page(
    create: Create, experimenter: Dashboard
) -> None:
    mturk = PLATFORMS["mturk"].outside
    base = f"/admin/studies/{create({**mturk, 'complete_url': ''})['slug']}"
    assert "brackets are left to fill in" in experimenter.get(base).text
    page = html.unescape(experimenter.get(f"{base}/invitations").text)
    assert "MTurk, which fills in no links" in page
    assert 'for (const name of ["workerId", "assignmentId"]) ids.set(name' in page
    other = f"/admin/studies/{create()['slug']}/invitations"
    assert "the platform’s own placeholder in the place of <code>[PERSON]</code>" in experimenter.get(other).text


def test_who_comes_again_by_a_new_link_goes_back_with_its_parameters(server: str, create: Create) -> None:
    study = create(
        {"complete_url": "https://platform.test/?task={TASK}", "withdrawn_url": "https://a.test/?task={TASK}"}
    )
    with a_browser(server) as browser:
        enters(browser, study, "p-1", outside={"PERSON": "p-1", "TASK": "first"})
        page = browser.get(f"/s/{study['invitation']}", params={"PERSON": "p-1", "TASK": "second"}).text
        assert 'data-state="known"' in page
        enters(browser, study, "p-1", outside={"PERSON": "p-1", "TASK": "second"})
        left = browser.put("/api/v1/session/withdrawal").json()
        assert left["ending"]["url"] == "https://a.test/?task=second"


def test_what_a_preset_leaves_to_fill_in_is_refused(create: Create) -> None:
    with pytest.raises(ValueError, match="screened_out_url holds YOUR-SCREENED-OUT-CODE, which stands for what"):
        create({"screened_out_url": "https://app.prolific.com/submissions/complete?cc=YOUR-SCREENED-OUT-CODE"})


@pytest.mark.parametrize("name", PLATFORMS)
def test_a_platforms_preset_fills_in_what_a_study_takes(name: str) -> None:
    filled = {
        key: re.sub("YOUR-[A-Z-]+[A-Z]", "filled", value) if isinstance(value, str) else value
        for key, value in PLATFORMS[name].outside.items()
    }
    code = {"code": "C1"} if "{code}" in filled.get("complete_url", "") else {}
    options = parse_options({"outside": {**filled, **code}})
    assert link_query(options.outside).startswith("?" if options.outside.id else "")


def test_who_is_let_in_again_begins_anew_by_the_same_link_and_counts_once(
    server: str, create: Create, experimenter: Dashboard, vote_body: VoteBody
) -> None:
    study = create()
    with a_browser(server) as browser:
        assert enters(browser, study, "p-1").status_code == 201
        goes_through(browser, vote_body)
        assert enters(browser, study, "p-1").json()["stage"] == "finished"
        page = experimenter.act(f"/admin/studies/{study['slug']}/participants/P001/again").text
        assert "takes part again" in page
        again = enters(browser, study, "p-1")
        assert (again.status_code, again.json()["stage"]) == (201, "introduction")
    base = f"/admin/studies/{study['slug']}/participants"
    assert "P001,p-1#P001,finished" in experimenter.get(f"{base}/outside-ids.csv").text
    assert ["Count again" in experimenter.get(f"{base}/{label}").text for label in ("P001", "P002")] == [True, False]


def test_an_invitation_for_one_lets_in_again_who_is_told_to(
    server: str, settings: Settings, experimenter: Dashboard, stimulus_set: Any
) -> None:
    study = create_study(settings, stimulus_set, f"S {uuid4()}", exposure_s=0.4)
    code = add_invitation(settings, study["slug"], places=1)["invitation"]
    with a_browser(server) as browser:
        body = {"invitation": code, "key": str(uuid4())}
        address = f"/api/v1/studies/{study['slug']}/sessions"
        assert browser.post(address, json=body).status_code == 201
        assert browser.post(address, json=body | {"key": str(uuid4())}).status_code == 410
        experimenter.act(f"/admin/studies/{study['slug']}/participants/P001/again")
        assert browser.post(address, json=body | {"key": str(uuid4())}).status_code == 201
        page = experimenter.get(f"/admin/studies/{study['slug']}/participants/P001").text
        assert "was let take part again by the same link, once" in page
        assert "P001/again" not in page
        assert "P001/resume-code" not in page
        assert browser.post(address, json=body | {"key": str(uuid4())}).status_code == 410
