"""A whole short study in Firefox and in WebKitGTK, where they are installed: what other tests show in Chromium."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import httpx
import pytest

from app.study.options.options import StudyOptions
from app.study.trial import smoothness
from tests.browser.playback_techniques import NO_STACKED
from tests.browser.remote_browsers import Firefox, Remote, WebKit, virtual_display
from tests.browser.sleeping import ASLEEP_S, descendants, sleep
from tests.browser.study_visitor import SETTLED, NewStudy, Study
from tests.browser.test_storage import NO_OPENING

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.alone]

SIZE = (1000, 700)
ENTER, ESCAPE = "\ue007", "\ue00c"
EXPOSURE_S = 1.6
MOST_CLICKS = 400  # of an impatient person until the trials: most come while presses do not count


@pytest.fixture(scope="module", params=["firefox", "webkit"])
def engine(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Remote]:
    with ExitStack() as stack:
        browser: Remote
        if request.param == "firefox":
            browser = Firefox(installed("firefox-esr", "firefox"), tmp_path_factory.mktemp("firefox"), SIZE)
        else:
            driver = installed("WebKitWebDriver")
            installed("Xvfb")
            browser = WebKit(driver, stack.enter_context(virtual_display()), SIZE)
        stack.callback(browser.close)
        yield browser


def installed(*names: str) -> str:
    for name in names:
        if path := shutil.which(name):
            return path
    packages = "firefox-esr, webkit2gtk-driver, gstreamer1.0-libav and xvfb"
    pytest.skip(f"{names[0]} is not installed; on Debian `make test` installs {packages}")


@pytest.fixture(autouse=True)
def awake_for_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit of a real study."""
    monkeypatch.setattr(smoothness, "LONGEST_GAP_S", 1.0)


def sees(engine: Remote, selector: str) -> None:
    engine.wait_for(f"document.querySelector({f'{SETTLED} {selector}'!r})?.checkVisibility()")


def begins(engine: Remote, address: str) -> None:
    engine.open(address)
    for view in ("welcome", "instructions-1", "instructions-2", "instructions-3"):
        sees(engine, f"[data-view={view}]")
        engine.press_key(ENTER)


def votes(engine: Remote, key: str) -> None:
    sees(engine, "#trial[data-state=exposure]")
    engine.press_key(" ")
    sees(engine, "#trial[data-state=voting]")
    engine.press_key(key)
    engine.press_key(ENTER)


def looks(study: Study) -> list[dict[str, Any]]:
    """Trials that were begun, by their place and attempt."""
    return [trial for trial in study.read("trials") if trial["voided_at"] or trial["voted_at"]]


def test_a_whole_study_with_a_sleep_in_mid_film(engine: Remote, new_study: NewStudy, short_films: Path) -> None:
    study = new_study(short_films, EXPOSURE_S, StudyOptions(second_codec="vp9"))
    begins(engine, study.address)
    votes(engine, "1")
    sees(engine, "#trial[data-state=exposure]")
    sleep(descendants(engine.process.pid))
    sees(engine, "[data-view=suspended]")
    engine.press_key(ENTER)
    votes(engine, "2")
    votes(engine, "3")
    sees(engine, "[data-view=thanks]")
    first, void, again, last = looks(study)
    assert [look["choice"] for look in (first, last, again)] == ["a", "none", "b"]
    assert (void["void_reason"], void["shown_smoothly"]) == ("suspended", False)
    assert void["longest_gap_ms"] > 500 * ASLEEP_S
    for look in (first, again, last):
        assert look["technique"] == "stacked"
        assert (look["both_seen"], look["mismatch_share"], look["shown_smoothly"]) == (True, 0, True)


def test_films_decoded_picture_by_picture_and_storage_that_never_answers(
    engine: Remote, new_study: NewStudy, short_films: Path
) -> None:
    study = new_study(short_films, EXPOSURE_S)
    with spoilt_server(study.url, NO_STACKED + NO_OPENING) as url:
        engine.open(study.address.replace(study.url, url))
        sees(engine, "[data-view=welcome]")
        if engine.run("!document.getElementById('no-codec').hidden"):
            pytest.skip("this browser does not decode H.264 picture by picture")
        begins(engine, study.address.replace(study.url, url))
        for key in ("1", "2", "3"):
            votes(engine, key)
        sees(engine, "[data-view=thanks]")
        sees(engine, "#not-stored")
    for look in looks(study):
        assert look["technique"] == "webcodecs"
        assert (look["both_seen"], look["mismatch_share"], look["shown_smoothly"]) == (True, 0, True)


def test_impatient_clicking_at_the_places_of_next_and_withdraw_withdraws_nobody(
    engine: Remote, new_study: NewStudy, short_films: Path
) -> None:
    study = new_study(short_films, 0.8)
    engine.open(study.address)
    sees(engine, "[data-view=welcome]")
    width = engine.run("window.innerWidth")
    x, y = engine.run(MIDDLE_OF_BEGIN)
    for number in range(MOST_CLICKS):
        engine.press_mouse(round(x), round(y))
        if number % 20 == 19:
            engine.press_mouse(width - 50, 20)
            engine.press_key(ESCAPE)
        if engine.run("document.getElementById('study').dataset.stage") == "trial":
            break
    assert [row["stage"] for row in study.read("participants")] == ["trial"]


MIDDLE_OF_BEGIN = """(({ x, y, width, height }) => [x + width / 2, y + height / 2])(
    document.getElementById("begin").getBoundingClientRect()
)"""


@pytest.fixture
def other_firefox(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Firefox]:
    browser = Firefox(installed("firefox-esr", "firefox"), tmp_path, SIZE, **request.param)
    yield browser
    browser.close()


@pytest.mark.parametrize("other_firefox", [{"network.cookie.cookieBehavior": 2}], ids=["no cookies"], indirect=True)
def test_a_firefox_that_refuses_cookies_is_told_before_the_study(
    other_firefox: Firefox, new_study: NewStudy, short_films: Path
) -> None:
    study = new_study(short_films, EXPOSURE_S)
    other_firefox.open(study.address)
    sees(other_firefox, "#no-cookies")
    assert not other_firefox.run("document.getElementById('begin').checkVisibility()")
    other_firefox.press_key(ENTER)
    assert study.read("participants") == []


FINGERS_ALONE = {"ui.primaryPointerCapabilities": 1, "ui.allPointerCapabilities": 1, "dom.w3c_touch_events.enabled": 1}


@pytest.mark.parametrize("other_firefox", [FINGERS_ALONE], ids=["fingers"], indirect=True)
def test_a_study_is_taken_by_taps_alone_in_firefox(
    other_firefox: Firefox, new_study: NewStudy, short_films: Path
) -> None:
    study = new_study(short_films, EXPOSURE_S)
    other_firefox.open(study.address)
    for view in ("welcome", "instructions-1", "instructions-2", "instructions-3"):
        sees(other_firefox, f"[data-view={view}]")
        assert not other_firefox.run("[...document.querySelectorAll('kbd')].some((key) => key.checkVisibility())")
        other_firefox.tap(f"[data-view={view}] .foot .button-primary")
    for _ in range(3):
        sees(other_firefox, "#trial[data-state=exposure]")
        other_firefox.tap("#trial .film")
        sees(other_firefox, "#trial[data-state=voting]")
        other_firefox.tap("#trial .choice")
        other_firefox.tap("#trial .next")
    sees(other_firefox, "[data-view=thanks]")
    assert [(look["choice"], len(look["viewing"]["switches"])) for look in looks(study)] == 3 * [("a", 1)]


@contextmanager
def spoilt_server(url: str, script: str) -> Iterator[str]:
    """Passes all requests on, and lets each of the page's modules begin with a script."""

    class Passing(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            headers = {name: value for name, value in self.headers.items() if name != "Accept-Encoding"}
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            answer = httpx.request(self.command, url + self.path, headers=headers, content=body)
            content = answer.content
            if "javascript" in answer.headers.get("Content-Type", ""):
                content = f"{script}\n".encode() + content
            self.send_response(answer.status_code)
            for name, value in answer.headers.multi_items():
                if name not in ("content-length", "content-encoding", "transfer-encoding", "date", "server"):
                    self.send_header(name, value)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def do_PUT(self) -> None:
            self.do_GET()

        def do_POST(self) -> None:
            self.do_GET()

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Passing) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
