"""Browsers that cannot or will not: a calm sentence before the study, or a study that goes on all the same."""

from __future__ import annotations

import json
import logging
from datetime import timedelta
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect
from sqlalchemy import func, select, update

from app.settings import Settings
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.database.steady_clock import running_s_before
from app.store.database.tables import session
from app.study.options.options import parse_options
from tests.browser.study_visitor import NewStudy, Study, Visitor
from tests.conftest import BROWSER_OPTIONS, browser_path

pytestmark = pytest.mark.browser

NO_CODEC = "HTMLMediaElement.prototype.canPlayType = () => ''; delete window.VideoDecoder;"
NO_H264 = """const canPlay = HTMLMediaElement.prototype.canPlayType;
HTMLMediaElement.prototype.canPlayType = function (type) {
    return type.includes("avc1") ? "" : canPlay.call(this, type);
};"""
NO_STORAGE = """const refuse = () => { throw new DOMException("refused", "SecurityError"); };
for (const name of ["localStorage", "sessionStorage", "indexedDB"]) {
    Object.defineProperty(window, name, { get: refuse });
}"""
FULL_DISK = """const refuse = () => { throw new DOMException("the disk is full", "QuotaExceededError"); };
IDBObjectStore.prototype.put = refuse;
Storage.prototype.setItem = refuse;"""
LOST_DATABASE = """let n = 0;
const begin = IDBDatabase.prototype.transaction;
IDBDatabase.prototype.transaction = function (...names) {
    if ((n += 1) > 3) throw new DOMException("the connection to the database was lost", "InvalidStateError");
    return begin.apply(this, names);
};"""  # as Safari does with pages that were in the background
NO_COOKIES = json.dumps({"profile": {"default_content_setting_values": {"cookies": 2}}})
A_DAY_MS = 86_400_000
A_WEEKEND_PASSES = """() => {
    const now = performance.now.bind(performance);
    performance.now = () => now() + 3 * 864e5;
}"""
CLOCK_JUMPS = "(hours) => { const real = Date.now; Date.now = () => real() + hours * 36e5; }"


def test_a_browser_without_the_codec_is_told_before_the_study_and_uses_no_invitation_up(
    study: Study, page: Page, visitor: Visitor
) -> None:
    page.add_init_script(NO_CODEC)
    page.goto(study.address)
    visitor.sees("welcome")
    expect(page.get_by_text("cannot play the study")).to_be_visible()
    expect(page.locator("#begin")).to_be_hidden()
    page.keyboard.press("Enter")
    visitor.watches(12)
    visitor.sees("welcome")
    assert study.read("trials") == []


def test_a_browser_that_refuses_cookies_is_told_before_the_study_and_uses_no_invitation_up(
    study: Study, browser: Browser, tmp_path: Path
) -> None:
    """A real refusal, by the browser's own setting: then the server would know nobody again."""
    (tmp_path / "Default").mkdir()
    (tmp_path / "Default" / "Preferences").write_text(NO_COOKIES)
    chromium = browser.browser_type
    context = chromium.launch_persistent_context(tmp_path, executable_path=browser_path(), args=BROWSER_OPTIONS)
    page, visitor = context.pages[0], Visitor(context.pages[0])
    page.goto(study.address)
    visitor.sees("welcome")
    expect(page.get_by_text("Please allow cookies for this page")).to_be_visible()
    expect(page.locator("#begin")).to_be_hidden()
    page.keyboard.press("Enter")
    visitor.watches(12)
    visitor.sees("welcome")
    assert study.read("participants") == []
    context.close()


def test_a_browser_without_h264_sees_the_second_codec(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor
) -> None:
    page.add_init_script(NO_H264)
    study = new_study(short_films, 1.6, parse_options({"second_codec": "vp9"}))
    fetched: list[str] = []
    page.on("response", lambda answer: "/media/" in answer.url and fetched.append(answer.url))
    visitor.begin(study)
    visitor.is_in("exposure")
    assert len(visitor.reads_screen()) == 2
    visitor.votes("1")
    assert b"vp09" in httpx.get(fetched[0]).content


@pytest.mark.parametrize("storage", [NO_STORAGE, FULL_DISK, LOST_DATABASE], ids=["refused", "full", "lost"])
def test_a_study_is_finished_without_storage(
    new_study: NewStudy, short_films: Path, page: Page, visitor: Visitor, storage: str
) -> None:
    study = new_study(short_films, 1.6, parse_options({"consent": "You may stop at any time."}))
    page.add_init_script(storage)
    page.goto(study.address)
    visitor.sees("welcome")
    page.keyboard.press("Enter")
    visitor.sees("consent")
    page.get_by_label("I have read this").check()
    for view in ("consent", "instructions-1", "instructions-2", "instructions-3"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    for key in ("1", "2", "3"):
        visitor.votes(key)
        visitor.is_in("exposure") if key != "3" else visitor.sees("thanks")
    assert [vote["choice"] for vote in study.read("votes")] == ["a", "none", "b"]


def test_who_runs_out_of_time_before_the_trials_is_told_so(
    new_study: NewStudy, short_films: Path, settings: Settings, page: Page, visitor: Visitor
) -> None:
    options = {"optional_stages": ["screening"], "screening": {"tests": ["colour"]}, "limits": {"minutes": 60}}
    visitor.begin(new_study(short_films, 1.6, parse_options(options)))
    visitor.sees("screening")
    database = open_database(settings.url)
    with database.writing() as connection:
        newest = session.c.id == select(func.max(session.c.id)).scalar_subquery()
        passed = timedelta(hours=2)
        began = {"started_at": utc_now() - passed, "running_s": running_s_before(passed)}
        connection.execute(update(session).where(newest).values(**began))
    database.dispose()
    page.keyboard.press("Enter")
    visitor.sees("timed-out")


def test_a_look_in_which_the_clock_jumps_ahead_as_after_sleep_is_shown_again_and_no_record_has_the_jump(
    study: Study, page: Page, visitor: Visitor
) -> None:
    visitor.begin(study)
    visitor.is_in("exposure")
    page.evaluate(CLOCK_JUMPS, 1)
    visitor.sees("suspended")
    page.keyboard.press("Enter")
    visitor.is_in("exposure")
    page.evaluate(CLOCK_JUMPS, -2)
    page.keyboard.press("Space")
    visitor.votes("1")
    study.votes(1)
    (viewing,) = (trial["viewing"] for trial in study.read("trials") if trial["choice"])
    assert 1000 < viewing["shown_ms"] < 60_000
    assert 0 <= viewing["switches"][0]["at_ms"] < viewing["shown_ms"]
    assert viewing["response_ms"] < 60_000


def test_a_tab_left_at_the_vote_over_a_weekend_has_its_vote_taken(study: Study, page: Page, visitor: Visitor) -> None:
    visitor.begin(study)
    visitor.is_in("voting")
    page.evaluate(A_WEEKEND_PASSES)
    visitor.votes("1")
    study.votes(1)
    (viewing,) = (trial["viewing"] for trial in study.read("trials") if trial["choice"])
    assert viewing["response_ms"] == A_DAY_MS


def test_what_is_refused_is_logged_without_the_invitation(study: Study, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        httpx.get(f"{study.url}/s/nobodys-code")
        httpx.post(f"{study.url}/api/v1/studies/{study.slug}/sessions", json={"invitation": "nobodys-code"})
        httpx.put(f"{study.url}/api/v1/session/trials/some-trial/vote", json={})
    assert "an invitation's page was refused: unknown" in caplog.text
    assert f"{{'slug': '{study.slug}'}} refused: 404 There is no such invitation" in caplog.text
    assert "'some-trial'} refused" in caplog.text
    assert "nobodys-code" not in caplog.text
