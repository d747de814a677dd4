"""An experimenter invites, watches, excludes and erases participants, and sees their votes again."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from uuid import uuid4

import anyio
import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from app.films.strips import GUARD_ROWS
from app.operations.studies.create import create_study
from app.settings import Settings
from app.simulation.participants import begin, next_trial, simulate
from app.study.options.options import StudyOptions
from app.web.admin import listing
from app.web.admin.flags import Flags
from app.web.admin.participants.votes_page import looks_of
from app.web.admin.studies.overview_page import SharedMonitor
from tests.app import tiny_stimuli
from tests.app.web.admin.dashboard_client import Dashboard, link_of, sign_in, signed_in, until

NewStudy = Callable[[], dict[str, Any]]
ABILITIES = {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}
PASSWORD = "correct horse battery"
LONGEST_WAIT_S = 30
# The part of its film, from the top, at which each figure's window begins.
WINDOWS = """() => [...document.querySelectorAll("#replay .half")].map((half) => {
    const window = half.getBoundingClientRect(), film = half.querySelector("video").getBoundingClientRect();
    return (window.top - film.top) / film.height;
})"""


def test_invitations_are_made_shown_as_qr_and_ended(
    experimenter: Dashboard, client: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    base = f"/admin/studies/{study['slug']}/invitations"
    codes = set(re.findall(r"/s/([a-z0-9]+)<", experimenter.act(base, places="1", number="3").text))
    assert len(codes - {study["invitation"]}) == 3
    assert "<svg" in experimenter.get(f"{base}/{study['invitation']}/qr.svg").text
    assert experimenter.get(f"{base}/forged/qr.svg").status_code == 404
    (unused, *_) = codes - {study["invitation"]}
    begin(client, study["slug"], study["invitation"])
    for code in (unused, study["invitation"]):
        assert experimenter.act(f"{base}/{code}/end").status_code == 200
        refused = client.post(f"/api/v1/studies/{study['slug']}/sessions", json={"invitation": code})
        assert refused.status_code in (404, 410)


@pytest.mark.slow
def test_the_monitor_follows_a_participant_by_server_sent_events(
    experimenter: Dashboard, client: httpx.Client, vote_body: Callable[..., dict[str, Any]], new_study: NewStudy
) -> None:
    study = new_study()
    session = begin(client, study["slug"], study["invitation"])
    with experimenter.stream("GET", f"/admin/studies/{study['slug']}/live", timeout=LONGEST_WAIT_S) as stream:
        lines = stream.iter_lines()
        until(lines, "0 of 6")
        trial = next_trial(client, session["token"])
        assert trial is not None
        client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=vote_body(trial))
        until(lines, "1 of 6")


@pytest.mark.slow
def test_a_monitor_is_shown_no_longer_than_the_access_of_who_watches(
    server: str, settings: Settings, client: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    path = f"/admin/studies/{study['slug']}/live"
    with ExitStack() as stack:
        dashboards = [
            stack.enter_context(signed_in(server, settings, name, role))
            for name, role in (("Olga", "owner"), ("Lea", "viewer"), ("Max", "viewer"), ("Ned", "viewer"))
        ]
        olga, lea, _, ned = dashboards
        ned.act("/admin/account/password", password=PASSWORD, again=PASSWORD)
        streams = [stack.enter_context(one.stream("GET", path, timeout=LONGEST_WAIT_S)) for one in dashboards]
        hers, *theirs = [stream.iter_lines() for stream in streams]
        for lines in (hers, *theirs):
            until(lines, "Nobody has begun yet")
        lea.act("/admin/logout")
        olga.act("/admin/users/disable", name="Max")
        olga.act("/admin/users/link", name="Ned")
        for lines in theirs:
            assert not [line for line in lines if line.startswith("event")]  # and ends as a whole answer does
        begin(client, study["slug"], study["invitation"])
        until(hers, "P001")


def test_a_monitor_that_many_watch_is_made_once_a_second() -> None:
    made: list[float] = []

    async def watch() -> None:
        monitor = SharedMonitor()

        async def look(at: float) -> None:
            def render() -> str:
                made.append(at)
                return f"at {at}"

            assert await monitor.at(at, render) == f"at {at}"

        for second in (7.0, 8.0):
            async with anyio.create_task_group() as pages:
                for _ in range(20):
                    pages.start_soon(look, second)

    with ThreadPoolExecutor(1) as pool:  # the browser tests leave an event loop in this one
        pool.submit(anyio.run, watch).result()
    assert made == [7.0, 8.0]


def test_a_stranger_gets_no_live_events(client: httpx.Client, taken: dict[str, Any]) -> None:
    assert client.get(f"/admin/studies/{taken['slug']}/live").status_code == 401


@pytest.mark.slow
def test_an_exclusion_needs_a_reason_counts_at_once_and_can_be_undone(
    experimenter: Dashboard, analyst: httpx.Client, taken: dict[str, Any]
) -> None:
    person = f"/admin/studies/{taken['slug']}/participants/P002"
    assert experimenter.act(f"{person}/exclude", reason="").status_code == 422
    page = experimenter.act(f"{person}/exclude", reason="=cmd() looked at a telephone")
    assert "looked at a telephone" in page.text
    assert experimenter.act(f"{person}/exclude", reason="again").status_code == 409
    votes = analyst.get(f"/api/v1/studies/{taken['slug']}/votes").json()
    assert {vote["participant"] for vote in votes if vote["excluded"]} == {"P002"}
    results = f"/admin/studies/{taken['slug']}/results"
    assert "6 votes are left out" in experimenter.results(results)
    assert "Who is excluded counts here, too" in experimenter.results(results, everybody="true")
    experimenter.act(f"{person}/include")
    assert "Every vote is counted" in experimenter.results(results)
    assert "undone by Eva Example" in experimenter.get(person).text
    assert experimenter.act(f"{person}/include").status_code == 409


def test_who_lost_the_code_to_go_on_gets_a_new_one_that_is_shown_once(
    experimenter: Dashboard, client: httpx.Client, new_study: NewStudy
) -> None:
    study = new_study()
    begun = begin(client, study["slug"], study["invitation"])
    person = f"/admin/studies/{study['slug']}/participants/P001"
    (code,) = re.findall(r"<code>(\w+)</code>", experimenter.act(f"{person}/resume-code").text)
    assert code not in experimenter.get(person).text
    assert "new code to go on" in (log := experimenter.get("/admin/audit", params={"search": "P001"}).text)
    assert code not in log
    for lost in (begun["resume_code"], "abc"):
        assert client.post("/api/v1/session/resume", json={"resume_code": lost}).status_code == 404
    assert client.get("/api/v1/session").status_code == 401  # whoever has the lost computer does not go on either
    resumed = client.post("/api/v1/session/resume", json={"resume_code": code}).json()
    assert resumed["session"] == begun["session"]
    assert experimenter.post(f"{person}/resume-code", data={"form_token": "forged"}).status_code == 403
    assert client.get("/api/v1/session").status_code == 200


@pytest.mark.slow
def test_a_session_that_has_ended_gets_no_code_to_go_on(
    experimenter: Dashboard, client: httpx.Client, taken: dict[str, Any], new_study: NewStudy
) -> None:
    study = new_study()
    begin(client, study["slug"], study["invitation"])
    client.put("/api/v1/session/withdrawal")
    for slug in (study["slug"], taken["slug"]):
        person = f"/admin/studies/{slug}/participants/P001"
        assert "New code to go on" not in experimenter.get(person).text
        assert experimenter.act(f"{person}/resume-code").status_code == 409


@pytest.mark.slow
def test_what_a_participant_gave_can_be_exported_and_erased(
    experimenter: Dashboard, analyst: httpx.Client, server: str, token: str, new_study: NewStudy
) -> None:
    study = new_study()
    simulate(server, study["slug"], study["invitation"], token, 2, ABILITIES, seed=1)
    person = f"/admin/studies/{study['slug']}/participants/P001"
    given = experimenter.get(f"{person}/export.json").json()
    assert len(given["vote"]) == 6
    assert not re.search(r"_hash|token", str(given.keys()) + str(given["session"]))
    assert experimenter.act(f"{person}/erase", again="P002").status_code == 422
    assert "erased" in experimenter.act(f"{person}/erase", again="P001").text
    assert experimenter.get(f"{person}/export.json").json()["vote"] == []
    votes = analyst.get(f"/api/v1/studies/{study['slug']}/votes").json()
    assert {vote["participant"] for vote in votes} == {"P002"}
    assert experimenter.act(f"{person}/erase", again="P001").status_code == 409


def test_votes_are_filtered_and_replayed(experimenter: Dashboard, taken: dict[str, Any]) -> None:
    base = f"/admin/studies/{taken['slug']}/votes"
    page = experimenter.get(base, params={"participant": "P003", "dataset": "ball"}).text
    assert "3 trials" in page
    trial = re.findall(rf'href="({base}/[^"?]+)"', page)[0]
    replay = experimenter.get(trial).text
    assert set(re.findall(r'<rect class="look" data-label="(\w+)"', replay)) <= {"a", "b"}
    assert replay.count("<figure data-label=") == 2
    assert "/media/" in replay
    assert experimenter.get(f"{base}/forged").status_code == 404


@pytest.fixture
def looked_at_reference(
    settings: Settings, stimulus_set: Path, client: httpx.Client, vote_body: Callable[..., dict[str, Any]]
) -> str:
    """The page of a trial in which the participant looked at the reference for 390 of 400 ms."""
    study = create_study(
        settings, stimulus_set, f"Study {uuid4()}", exposure_s=0.4, options=StudyOptions(reference="id_fb")
    )
    session = begin(client, study["slug"], study["invitation"])
    trial = next_trial(client, session["token"])
    assert trial is not None
    viewing = {
        "first_shown": trial["first_shown"],
        "shown_ms": 400,
        "response_ms": 1,
        "switches": [{"to": "reference", "at_ms": 10, "media_time_s": 0}],
    }
    body = vote_body(trial, viewing=viewing)
    assert client.put(f"/api/v1/session/trials/{trial['trial']}/vote", json=body).status_code == 201
    return f"/admin/studies/{study['slug']}/votes/{trial['trial']}"


def test_a_look_at_the_reference_is_replayed_as_such(experimenter: Dashboard, looked_at_reference: str) -> None:
    replay = experimenter.get(looked_at_reference).text
    looks = re.findall(r'<rect class="look" data-label="(\w+)"', replay)
    assert looks in (["a", "reference"], ["b", "reference"])
    seconds = dict(re.findall(r'<figure data-label="(\w+)".*?on screen ([0-9.]+) s', replay, re.DOTALL))
    assert seconds == {"a": "0.0", "b": "0.0", "reference": "0.4"}
    stills = re.findall(r'src="(/admin/[^"]+\.jpg)"', replay)
    assert len(stills) == len({experimenter.get(still).content for still in stills}) == 3


@pytest.fixture
def owners_page(browser: Browser, server: str, settings: Settings) -> Iterator[Page]:
    """A browser's page, signed in to the dashboard."""
    page = browser.new_page(base_url=server)
    sign_in(page, settings)
    yield page
    page.close()


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.parametrize("new_database_url", ["sqlite"], indirect=True)
def test_the_browser_marks_the_reference_while_it_was_on_screen(owners_page: Page, looked_at_reference: str) -> None:
    page = owners_page
    page.goto(looked_at_reference)
    marked = page.locator(".is-on-screen")
    expect(marked).to_have_attribute("data-label", re.compile("^[ab]$"))
    page.locator("#replay-seek").click()  # in its middle
    expect(marked).to_have_attribute("data-label", "reference")
    page.keyboard.press("Home")
    expect(marked).to_have_attribute("data-label", re.compile("^[ab]$"))
    page.keyboard.press("ArrowRight")
    expect(marked).to_have_attribute("data-label", "reference")
    film_height = 3 * tiny_stimuli.HEIGHT + 2 * GUARD_ROWS
    strips = [number * (tiny_stimuli.HEIGHT + GUARD_ROWS) / film_height for number in range(3)]
    *compared, reference = page.evaluate(WINDOWS)
    assert [*sorted(compared), reference] == pytest.approx(strips, abs=0.01)


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.parametrize("new_database_url", ["sqlite"], indirect=True)
def test_a_replay_whose_film_cannot_be_played_says_so(owners_page: Page, looked_at_reference: str) -> None:
    page = owners_page
    page.route("**/media/**", lambda route: route.fulfill(body=b"no film", content_type="video/mp4"))
    page.goto(looked_at_reference)
    page.get_by_role("button", name="Play").click()
    expect(page.get_by_role("alert")).to_contain_text("could not play the film")
    expect(page.get_by_role("button", name="Play")).to_be_visible()


def test_participants_are_searched_sorted_and_shown_a_page_at_a_time(
    experimenter: Dashboard, taken: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listing, "ROWS_ON_A_PAGE", 3)
    base = f"/admin/studies/{taken['slug']}/participants"
    first = experimenter.get(base, params={"search": "p0", "standing": "finished"})
    assert "4 participants, in order of arrival" in first.text
    assert _linked_on(first) == ["P001", "P002", "P003"]
    assert "Previous" not in first.text
    second = experimenter.get(first.url.join(link_of(first, "Next")))
    assert _linked_on(second) == ["P004"]
    assert ' value="p0"' in second.text
    assert "Next" not in second.text
    assert _linked_on(experimenter.get(second.url.join(link_of(second, "Previous")))) == _linked_on(first)
    ascending = experimenter.get(second.url.join(link_of(second, "Participant")))
    latest = experimenter.get(ascending.url.join(link_of(ascending, "Participant")))  # the other way round
    assert _linked_on(latest) == ["P004", "P003", "P002"]
    assert 'aria-sort="descending"' in latest.text
    for link in re.findall(r'class="sort" href="([^"]+)"', first.text):
        assert len(_linked_on(experimenter.get(first.url.join(html.unescape(link))))) == 3
    assert _linked_on(experimenter.get(base, params={"search": " 003 "})) == ["P003"]
    assert _linked_on(experimenter.get(base, params={"page": "99"})) == ["P004"]
    assert _linked_on(experimenter.get(base, params={"page": "x", "sort": "label; DROP"})) == _linked_on(first)


def test_participants_with_anything_unusual_are_found(
    experimenter: Dashboard, taken: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Flags, "of", lambda *_: {"P002": ("always A",), "P003": ()})
    page = experimenter.get(f"/admin/studies/{taken['slug']}/participants", params={"standing": "unusual"})
    assert _linked_on(page) == ["P002"]


def test_older_votes_stay_filtered(
    experimenter: Dashboard, analyst: httpx.Client, taken: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listing, "ROWS_ON_A_PAGE", 5)
    filters = {"dataset": "ball", "participant": "", "what": ""}
    rows = analyst.get(f"/api/v1/studies/{taken['slug']}/trials", params={"dataset": "ball"}).json()
    rows.sort(key=lambda row: row["voted_at"] or row["voided_at"], reverse=True)
    base = f"/admin/studies/{taken['slug']}/votes"
    shown, page = [], experimenter.get(base, params=filters)
    for _ in range(2):
        shown.extend(_linked_on(page))
        page = experimenter.get(page.url.join(link_of(page, "Next")))
    shown.extend(_linked_on(page))
    assert shown == [row["trial"] for row in rows]
    assert "Next" not in page.text
    assert _linked_on(experimenter.get(page.url.join(link_of(page, "Previous")))) == shown[5:10]


def _linked_on(page: httpx.Response) -> list[str]:
    return re.findall(rf'href="{page.url.path}/([^"?]+)"', page.text.partition("<tbody>")[2])


def test_a_replay_divides_the_time_between_the_two() -> None:
    switches = [{"to": "b", "at_ms": 300.0}, {"to": "a", "at_ms": 700.0}]
    looks = looks_of({"first_shown": "a", "shown_ms": 1000.0, "switches": switches}, 0)
    assert [(look.label, look.from_ms, look.to_ms) for look in looks] == [
        ("a", 0.0, 300.0),
        ("b", 300.0, 700.0),
        ("a", 700.0, 1000.0),
    ]
    assert looks_of({}, 1000) == ()
