"""What Chromium shows: the page as it is used, its lock, its waits, and two video elements."""

from __future__ import annotations

import asyncio
import base64
import shutil
import sys
from collections.abc import Awaitable, Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.async_api import Page, async_playwright

from playing.bars import SIZE, both_strips, difference, goes_back, latencies, read_bars
from playing.study import Study, dropped, last_viewing, summary

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.browser.playback_techniques import MISSING

USED, TALL = (1920, 1080), (1920, 2300)  # windows; in the tall one most of the strip that is not shown is seen too
PAUSES_S = (0.06, 0.10)  # between presses
WAITED_FOR = 3  # trials
LOOK_S = 5  # at each of these
STARTS, START_S = 5, 8  # of two elements, and how long each is looked at
SCREENCAST = {"format": "jpeg", "quality": 60, "maxWidth": 480, "maxHeight": 600, "everyNthFrame": 1}
NOTE_PRESSES = """
window.presses = [];
addEventListener("pointerdown", (event) => presses.push(performance.timeOrigin + event.timeStamp), { capture: true });
"""
SETTLED = "html:not([data-settling])"  # presses count, see static/js/settling.js


async def to_exposure(page: Page, study: Study) -> None:
    """From the invitation to the running film."""
    await page.goto(study.url + study.path)
    for view in ("welcome", "instructions-1", "instructions-2", "instructions-3"):
        await page.locator(f"{SETTLED} [data-view={view}]").wait_for()
        await page.keyboard.press("Enter")
    await page.locator("#trial[data-state=exposure]").wait_for()


async def vote(page: Page, study: Study) -> dict[str, Any]:
    """End the exposure and vote; the viewing record that the server has then."""
    await page.keyboard.press("Enter")
    await page.locator(f"{SETTLED} #trial[data-state=voting]").wait_for()
    await page.keyboard.press("2")
    async with page.expect_response(lambda answer: answer.url.endswith("/vote")):
        await page.keyboard.press("Enter")
    return last_viewing(study)


Picture = tuple[float, NDArray[np.uint8]]  # when it was swapped to the screen (ms since 1970), and its grey pixels


async def pictures_while(page: Page, action: Callable[[], Awaitable[None]]) -> list[Picture]:
    """Every picture that the compositor made meanwhile."""
    session = await page.context.new_cdp_session(page)
    taken: list[tuple[float, str]] = []

    def keep(event: dict[str, Any]) -> None:
        taken.append((1000 * event["metadata"]["timestamp"], event["data"]))
        task = asyncio.ensure_future(session.send("Page.screencastFrameAck", {"sessionId": event["sessionId"]}))
        task.add_done_callback(lambda done: done.exception())

    session.on("Page.screencastFrame", keep)
    await session.send("Page.startScreencast", SCREENCAST)
    await action()
    await session.send("Page.stopScreencast")
    await session.detach()
    grey = cv2.IMREAD_GRAYSCALE
    return [
        (at, np.asarray(cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), grey)))
        for at, data in sorted(taken)
    ]


def presses_of(page: Page, n: int) -> Callable[[], Awaitable[None]]:
    """n real presses of the mouse, as the browser's input thread gets them."""
    rng = np.random.default_rng(1)

    async def press() -> None:
        session = await page.context.new_cdp_session(page)
        for _ in range(n):
            await asyncio.sleep(rng.uniform(*PAUSES_S))
            where = {"x": 700, "y": page.viewport_size["height"] // 2 if page.viewport_size else 0}
            for kind in ("mousePressed", "mouseReleased"):
                event = {"type": kind, "button": "left", "clickCount": 1, **where}
                await session.send("Input.dispatchMouseEvent", event)
        await asyncio.sleep(0.5)

    return press


async def used(page: Page, study: Study, n: int) -> dict[str, Any]:
    """The page as it is."""
    await page.set_viewport_size({"width": USED[0], "height": USED[1]})
    await page.add_init_script(NOTE_PRESSES)
    await to_exposure(page, study)
    pictures = await pictures_while(page, presses_of(page, n))
    presses = await page.evaluate(f"window.presses.slice(-{n})")
    viewing = await vote(page, study)
    readings = [(at, read_bars(picture[3 * len(picture) // 4])) for at, picture in pictures]
    seen = [reading for _, reading in readings if reading]
    delays = latencies(readings, presses)
    return {
        "pictures": len(pictures),
        "switches": len(viewing["switches"]),
        "press_to_picture_ms": {**summary(delays), "missed": int(np.isnan(delays).sum())},
        "black": sum(reading is None for _, reading in readings),
        "backward": sum(goes_back(one.frame, other.frame) for one, other in pairwise(seen)),
        **dropped(viewing),
        "stalls": viewing["n_stalls"],
        "record": {
            **{name: viewing[name] for name in ("technique", "n_mismatches") if name in viewing},
            "press_to_presented_ms": summary([s["presented_ms"] - s["at_ms"] for s in viewing["switches"]]),
        },
    }


async def lock(page: Page, study: Study, n: int) -> dict[str, Any]:
    """The page with the crop lifted."""
    await page.set_viewport_size({"width": TALL[0], "height": TALL[1]})
    await to_exposure(page, study)
    await lift_crop(page)
    pictures = await pictures_while(page, presses_of(page, n))
    viewing = await vote(page, study)
    return {"switches": len(viewing["switches"]), **difference([both_strips(picture) for _, picture in pictures])}


async def lift_crop(page: Page) -> None:
    await page.evaluate("document.querySelector('.film').style.overflow = 'visible'")


async def peer(page: Page, study: Study, _n: int) -> dict[str, Any]:
    """Two elements, both in every picture; it is decided anew at each start how far they are apart."""
    await page.set_viewport_size({"width": SIZE[0], "height": 2 * SIZE[1]})
    runs = []
    for _ in range(STARTS):
        await page.goto(study.peer)
        await page.wait_for_function("() => !a.paused && !b.paused && a.currentTime > 0.2")
        await page.evaluate("document.body.className = 'both'")
        pictures = await pictures_while(page, lambda: asyncio.sleep(START_S))
        runs.append([(read_bars(p[len(p) // 4]), read_bars(p[3 * len(p) // 4])) for _, p in pictures])
    each = [difference(run)["differing_percent"] for run in runs]
    return {**difference([pair for run in runs for pair in run]), "differing_percent_of_each_start": each}


async def waits(page: Page, study: Study, _n: int) -> dict[str, Any]:
    """Trial after trial, each looked at for a while."""
    await page.set_viewport_size({"width": USED[0], "height": USED[1]})
    await to_exposure(page, study)
    waits_ms = []
    for _ in range(WAITED_FOR):
        await page.locator("#trial[data-state=exposure]").wait_for()
        await asyncio.sleep(LOOK_S)
        waits_ms.append((await vote(page, study))["wait_ms"])
    return {"first_ms": waits_ms[0], "later_ms": waits_ms[1:], "longest_later_ms": max(waits_ms[1:])}


RUNS = {"used": used, "decoded": used, "lock": lock, "peer": peer, "waits": waits}


async def run(name: str, study: Study, n: int) -> dict[str, Any]:
    async with async_playwright() as playwright:
        path = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = await playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        context = await browser.new_context(locale="en")
        context.set_default_timeout(120_000)
        page = await context.new_page()
        if name == "decoded":
            await page.add_init_script(MISSING["webcodecs"])
        try:
            return await RUNS[name](page, study, n)
        finally:
            await browser.close()
