"""Frame lock and speed of the toggle, read from pixels: `python bench/toggle.py [--switches N] [--only NAME]`.

Full HD films of 15 s at 25 frames a second hold their condition and frame number as bars. The real study page shows
them, real presses switch, and every composited picture is read back. Runs in Chromium, then in Firefox:

- used: the page as participants see it: press to composited picture, black, backward, dropped
- decoded: the same where the browser plays no film of both, so that the page decodes a film of each (WebCodecs)
- lock: used with the film's crop lifted, so that A and B are both in every picture: does their frame differ?
- peer: two video elements that are started together, both in every picture
- waits: from Next to the fixation of the next trial, whose film is fetched meanwhile
- firefox: lock, by screenshots between real presses, and press to paint

Other work on the machine delays pictures: the load stands beside the numbers. `--keep FOLDER` keeps the films.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any
from uuid import uuid4

import cv2
import httpx
import numpy as np
from numpy.typing import NDArray
from playing.bars import SECONDS, SIZE, both_strips, difference, goes_back, latencies, read_bars, write_films
from playing.firefox import Firefox
from playwright.async_api import Page, Route, async_playwright

from app.main import running_server
from app.operate import add_token, create_study
from app.settings import Settings
from app.study.options import parse_options

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "browser"))

from techniques import MISSING

USED, TALL = (1920, 1080), (1920, 2300)  # windows; in the tall one most of the strip that is not shown is seen too
PAUSES_S = (0.10, 0.18)  # between presses
WAITED_FOR = 3  # trials
LOOK_S = 5  # at each of these
SHOTS = 5  # presses in Firefox for each that is followed by a screenshot
SCREENCAST = {"format": "jpeg", "quality": 60, "maxWidth": 480, "maxHeight": 600, "everyNthFrame": 1}
NOTE_PRESSES = """
window.presses = [];
addEventListener("pointerdown", (event) => presses.push(performance.timeOrigin + event.timeStamp), { capture: true });
"""
PEER = """<style>body { margin: 0 } video { position: absolute; left: 0; width: 100% }</style>
<video id="a" muted loop src="/a.mp4"></video><video id="b" muted loop src="/b.mp4"></video>
<script>
  b.style.top = "50%";
  const ready = (video) => new Promise((done) => video.addEventListener("canplaythrough", done, { once: true }));
  Promise.all([ready(a), ready(b)]).then(() => { a.play(); b.play(); });
</script>"""


@dataclass(frozen=True)
class Study:
    """Where the films are seen, and read about."""

    url: str
    path: str
    slug: str
    token: str
    films: Path


@contextmanager
def study(folder: Path) -> Iterator[Study]:
    """A study of one pair in both orders and once more, whose exposures the participant ends, on its own server."""
    films = folder / "films"
    films.mkdir(exist_ok=True)
    settings = Settings(data_dir=folder / "server")
    content = {"free_exposure": True, "both_orders": True, "repeated_pairs": 1, "second_codec": "vp9"}
    name = f"Bars {uuid4()}"
    made = create_study(settings, write_films(films), name, exposure_s=SECONDS, seed=1, options=parse_options(content))
    token = add_token(settings, name)["token"]
    with running_server(settings) as url:
        yield Study(url, made["path"], made["slug"], token, films)


async def to_exposure(page: Page, of: Study) -> None:
    """From the invitation to the running film."""
    await page.goto(of.url + of.path)
    for view in ("welcome", "instructions-1", "instructions-2", "instructions-3"):
        await page.locator(f"[data-view={view}]").wait_for()
        await page.keyboard.press("Enter")
    await page.locator("#trial[data-state=exposure]").wait_for()


async def vote(page: Page, of: Study) -> dict[str, Any]:
    """End the exposure and vote; the viewing record that the server has then."""
    await page.keyboard.press("Enter")
    await page.locator("#trial[data-state=voting]").wait_for()
    await page.keyboard.press("2")
    async with page.expect_response(lambda answer: answer.url.endswith("/vote")):
        await page.keyboard.press("Enter")
    return last_viewing(of)


def last_viewing(of: Study) -> dict[str, Any]:
    """Of the participant who came last, the trial that was voted on last."""
    rows = httpx.get(
        f"{of.url}/api/v1/studies/{of.slug}/trials?format=json", headers={"Authorization": f"Bearer {of.token}"}
    ).json()
    viewing: dict[str, Any] = [row["viewing"] for row in rows if row["choice"]][-1]
    return viewing


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
    return [(at, cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), grey)) for at, data in sorted(taken)]


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


async def used(page: Page, of: Study, n: int) -> dict[str, Any]:
    """The page as it is."""
    await page.set_viewport_size({"width": USED[0], "height": USED[1]})
    await page.add_init_script(NOTE_PRESSES)
    await to_exposure(page, of)
    pictures = await pictures_while(page, presses_of(page, n))
    presses = await page.evaluate(f"window.presses.slice(-{n})")
    viewing = await vote(page, of)
    readings = [(at, read_bars(picture[3 * len(picture) // 4])) for at, picture in pictures]
    seen = [reading for _, reading in readings if reading]
    delays = latencies(readings, presses)
    return {
        "pictures": len(pictures),
        "switches": len(viewing["switches"]),
        "press_to_picture_ms": {**summary(delays), "missed": int(np.isnan(delays).sum())},
        "black": sum(reading is None for _, reading in readings),
        "backward": sum(goes_back(one.frame, other.frame) for one, other in pairwise(seen)),
        "drops": f"{viewing['n_dropped']} of {viewing['n_frames']}",
        "stalls": viewing["n_stalls"],
        "record": {
            **{name: viewing[name] for name in ("technique", "n_mismatches") if name in viewing},
            "press_to_animation_frame_ms": summary([s["frame_ms"] - s["at_ms"] for s in viewing["switches"]]),
        },
    }


async def lock(page: Page, of: Study, n: int) -> dict[str, Any]:
    """The page with the crop lifted."""
    await page.set_viewport_size({"width": TALL[0], "height": TALL[1]})
    await to_exposure(page, of)
    await lift_crop(page)
    pictures = await pictures_while(page, presses_of(page, n))
    viewing = await vote(page, of)
    return {"switches": len(viewing["switches"]), **difference([both_strips(picture) for _, picture in pictures])}


async def lift_crop(page: Page) -> None:
    await page.evaluate("document.querySelector('.film').style.overflow = 'visible'")


async def send_file(path: Path, route: Route) -> None:
    await route.fulfill(path=path, content_type="video/mp4")


async def peer(page: Page, of: Study, n: int) -> dict[str, Any]:
    """Two elements."""
    await page.set_viewport_size({"width": TALL[0], "height": 2 * SIZE[1]})
    await page.route("http://peer/", lambda route: route.fulfill(body=PEER, content_type="text/html"))
    for name, film in (("a", "one"), ("b", "other")):
        await page.route(f"http://peer/{name}.mp4", partial(send_file, of.films / f"{film}.mp4"))
    runs = []
    for _ in range(5):  # it is decided anew at each start how far they are apart
        await page.goto("http://peer/")
        await page.wait_for_function("!a.paused && !b.paused && a.currentTime > 0.2")
        pictures = await pictures_while(page, lambda: asyncio.sleep(n / 5 * sum(PAUSES_S) / 2))
        runs.append([(read_bars(p[len(p) // 4]), read_bars(p[3 * len(p) // 4])) for _, p in pictures])
    each = [difference(run)["differing_percent"] for run in runs]
    return {**difference([pair for run in runs for pair in run]), "differing_percent_of_each_start": each}


async def waits(page: Page, of: Study, _n: int) -> dict[str, Any]:
    """Trial after trial, each looked at for a while."""
    await page.set_viewport_size({"width": USED[0], "height": USED[1]})
    await to_exposure(page, of)
    found = []
    for _ in range(WAITED_FOR):
        await page.locator("#trial[data-state=exposure]").wait_for()
        await asyncio.sleep(LOOK_S)
        found.append((await vote(page, of))["wait_ms"])
    return {"first_ms": found[0], "later_ms": found[1:]}


def summary(values: Sequence[float] | NDArray[np.float64]) -> dict[str, float]:
    return {
        "median": round(float(np.nanmedian(values)), 1),
        "p95": round(float(np.nanpercentile(values, 95)), 1),
        "max": round(float(np.nanmax(values)), 1),
    }


RUNS = {"used": used, "decoded": used, "lock": lock, "peer": peer, "waits": waits}


async def in_chromium(name: str, of: Study, n: int) -> dict[str, Any]:
    async with async_playwright() as playwright:
        path = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = await playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        context = await browser.new_context(locale="en")
        context.set_default_timeout(120_000)
        page = await context.new_page()
        if name == "decoded":
            await page.add_init_script(MISSING["webcodecs"])
        try:
            return await RUNS[name](page, of, n)
        finally:
            await browser.close()


PAINTS = """(() => {
    window.presses = []; window.paints = [];
    addEventListener("pointerdown", (event) => presses.push(event.timeStamp), { capture: true });
    addEventListener("MozAfterPaint", (event) => paints.push(event.paintTimeStamp ?? performance.now()));
})()"""


def in_firefox(of: Study, n: int) -> dict[str, Any]:
    """From each press to the paint that follows it; then screenshots between presses."""
    program = shutil.which("firefox-esr") or shutil.which("firefox")
    if program is None:
        return {"skipped": "no Firefox is installed"}
    with tempfile.TemporaryDirectory() as folder:
        firefox = Firefox(program, Path(folder), size=(TALL[0], TALL[1] + 90))
        try:
            return _firefox_run(firefox, of, n)
        finally:
            firefox.close()


def _firefox_run(firefox: Firefox, of: Study, n: int) -> dict[str, Any]:
    version, size = firefox.run("navigator.userAgent").split()[-1], firefox.run("[innerWidth, innerHeight]")
    firefox.tell("WebDriver:Navigate", url=of.url + of.path)
    for view in ("welcome", "instructions-1", "instructions-2", "instructions-3"):
        firefox.wait_for(f"!document.querySelector('[data-view={view}]').hidden")
        firefox.press_key("\ue007")
    firefox.wait_for("document.querySelector('#trial').dataset.state === 'exposure'")
    firefox.run(PAINTS)
    for _ in range(n):
        firefox.press_mouse(700, 1100)
        time.sleep(PAUSES_S[0])
    presses, paints = firefox.run("window.presses"), np.array(firefox.run("window.paints"))
    firefox.run("document.querySelector('.film').style.overflow = 'visible'")
    pairs = []
    for _ in range(n // SHOTS):
        firefox.press_mouse(700, 1100)
        pairs.append(both_strips(firefox.picture()))
    viewing = _firefox_vote(firefox, of)
    seen = [window for window, _ in pairs if window]
    return {
        "version": version,
        "window": size,
        "technique": viewing["technique"],
        "switches": len(viewing["switches"]),
        **difference(pairs),
        "press_to_paint_ms": summary([paints[paints > at][0] - at for at in presses if np.any(paints > at)]),
        "press_to_animation_frame_ms": summary([s["frame_ms"] - s["at_ms"] for s in viewing["switches"][:n]]),
        "black": sum(window is None for window, _ in pairs),
        "backward": sum(goes_back(one.frame, other.frame) for one, other in pairwise(seen)),
        "drops": f"{viewing['n_dropped']} of {viewing['n_frames']}",
    }


def _firefox_vote(firefox: Firefox, of: Study) -> dict[str, Any]:
    firefox.press_key("\ue007")
    firefox.wait_for("document.querySelector('#trial').dataset.state === 'voting'")
    firefox.press_key("2")
    firefox.press_key("\ue007")
    firefox.wait_for("document.querySelector('#trial').dataset.state === 'exposure'")  # the next: the vote is kept
    return last_viewing(of)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--switches", type=int, default=1000)
    parser.add_argument("--only", choices=(*RUNS, "firefox"), action="append")
    parser.add_argument("--keep", type=Path, help="folder in which the films are kept for the next time")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        with study(folder) as of:
            for name in arguments.only or (*RUNS, "firefox"):
                tell(name, of, arguments.switches)


def tell(name: str, of: Study, n: int) -> None:
    """Print what a run found, and how busy the machine was."""
    before = os.getloadavg()[0]
    result = in_firefox(of, n) if name == "firefox" else asyncio.run(in_chromium(name, of, n))
    result |= {"load_before": round(before, 1), "load_after": round(os.getloadavg()[0], 1)}
    sys.stdout.write(json.dumps({name: result}, indent=2) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
