"""Films come while participants read, and a wait that a slow line causes is stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, expect

from app.study.options.options import parse_options
from tests.browser.numbered_films import HEIGHT, WIDTH
from tests.browser.study_visitor import MakeFilms, NewStudy, Study, Visitor

pytestmark = [pytest.mark.browser, pytest.mark.slow]

LONGEST_WAIT_MS = 1000
N_FRAMES = 30
LINE = {"offline": False, "latency": 40, "uploadThroughput": 125_000}


@pytest.fixture(scope="module")
def large_films(films: MakeFilms) -> Path:
    """Noise, which no codec makes small: a pair has 1.8 MB."""
    return films(25.0, N_FRAMES, noise)


def noise(condition: int, frame: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng([condition, frame])
    return rng.integers(0, 256, (HEIGHT, WIDTH), np.uint8)


def is_on_a_line_of(page: Page, mbit_s: float) -> None:
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    session.send("Network.emulateNetworkConditions", LINE | {"downloadThroughput": mbit_s * 1e6 / 8})


@pytest.mark.alone  # it measures a wait
def test_films_are_fetched_from_the_instructions_on(
    new_study: NewStudy, large_films: Path, page: Page, visitor: Visitor
) -> None:
    fetched: list[str] = []
    page.on("requestfinished", lambda request: "/media/" in request.url and fetched.append(request.url))
    study = new_study(large_films, 0.8)
    page.goto(study.address)
    visitor.sees("welcome")
    is_on_a_line_of(page, 20)
    with page.expect_event("requestfinished", lambda request: "/media/" in request.url):
        page.keyboard.press("Enter")
    for number in (1, 2, 3):
        visitor.sees(f"instructions-{number}")
        page.keyboard.press("Enter")
    visitor.votes("1")
    visitor.votes("2")
    visitor.votes("3")
    visitor.sees("thanks")
    first, *_ = (trial["viewing"] for trial in sorted(study.read("trials"), key=lambda trial: trial["number"]))
    assert first["wait_ms"] <= LONGEST_WAIT_MS
    assert len(fetched) == len(set(fetched)) == 3


def test_lighter_films_are_shown_on_a_slow_line_only_and_votes_on_them_are_marked(
    new_study: NewStudy, large_films: Path, page: Page, visitor: Visitor
) -> None:
    study = new_study(large_films, 0.8, parse_options({"lighter_films": True}))
    page.goto(study.address)
    visitor.sees("welcome")
    is_on_a_line_of(page, 1)
    with page.expect_event("requestfinished", lambda request: request.url.endswith(".lighter")):
        page.keyboard.press("Enter")
    is_on_a_line_of(page, 100)
    page.reload()
    for number in (1, 2, 3):
        visitor.sees(f"instructions-{number}")
        page.keyboard.press("Enter")
    visitor.votes("1")
    study.votes(1)
    page.context.clear_cookies()
    page.goto(f"{study.address}?another")
    visitor.reads_introduction()
    visitor.votes("1")
    marks = {vote["participant"]: vote["lighter_film"] for vote in study.votes(2)}
    assert marks == {"P001": True, "P002": False}


def test_a_slow_line_is_told_before_the_trials_and_while_a_film_is_awaited(
    new_study: NewStudy, large_films: Path, page: Page, visitor: Visitor
) -> None:
    page.goto(new_study(large_films, 0.8).address)
    visitor.sees("welcome")
    is_on_a_line_of(page, 1.5)
    for view in ("welcome", "instructions-1", "instructions-2"):
        visitor.sees(view)
        page.keyboard.press("Enter")
    visitor.sees("instructions-3")
    expect(page.locator("#slow-line")).to_contain_text("Your connection is slow: before each pair you will wait")
    page.keyboard.press("Enter")
    left = page.locator("[data-left]")
    expect(left).to_contain_text("s to go")
    expect(left).to_be_visible()
    visitor.is_in("exposure")


WATCH_BEGIN = """new MutationObserver(() => {
  const begin = document.getElementById("begin");
  if (begin?.checkVisibility() && !begin.disabled) window.begunAt ??= performance.now();
}).observe(document, { subtree: true, childList: true, attributes: true });"""
SLOW_LINE = {"offline": False, "latency": 300, "downloadThroughput": 187_500, "uploadThroughput": 187_500}
LONGEST_TO_BEGIN_MS = 1200
N_TRIES = 3  # of which the fastest counts: the machine may be busy


@pytest.mark.alone  # it measures a wait
def test_begin_is_there_within_1_2_s_on_a_line_of_1_5_mbit_s_and_300_ms(study: Study, page: Page) -> None:
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    session.send("Network.setCacheDisabled", {"cacheDisabled": True})
    session.send("Network.emulateNetworkConditions", SLOW_LINE)
    page.add_init_script(WATCH_BEGIN)
    times, asked = [], []
    page.on("request", lambda request: asked.append(request.url))
    for _ in range(N_TRIES):
        page.goto(study.address)
        times.append(page.wait_for_function("window.begunAt").json_value())
    assert len(asked) <= 4 * N_TRIES, asked
    assert min(times) <= LONGEST_TO_BEGIN_MS
