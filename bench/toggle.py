"""Frame lock and speed of the toggle, read from pixels: `python bench/toggle.py [--switches N] [--only NAME]`.

Full HD films of 15 s at 25 frames a second hold their condition and frame number as bars. The real study page shows
them, real presses switch, and every composited picture is read back. Three runs in Chromium, then Firefox:

- used: the page as participants see it: press to composited picture, black, backward, dropped
- lock: the same with the film's crop lifted, so that A and B are both in every picture: does their frame differ?
- peer: two video elements that are started together, both in every picture
- firefox: lock, by screenshots between real presses, and press to paint

Other work on the machine delays pictures: the load stands beside the numbers.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import cv2
import httpx
import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray
from playwright.async_api import Page, Route, async_playwright

from app.main import running_server
from app.operate import add_token, create_study
from app.settings import Settings
from app.stimuli import file_digest
from app.study.options import parse_options

SIZE, FPS, SECONDS = (1920, 1080), 25, 15
N_FRAMES = FPS * SECONDS
FRAME_BITS = 9
N_BARS = FRAME_BITS + 2  # an even parity bar and the condition before the frame's number
DARK, LIGHT, TOLERANCE = 40, 216, 45
USED, TALL = (1920, 1080), (1920, 2300)  # windows; in the tall one most of the strip that is not shown is seen too
PAUSES_S = (0.10, 0.18)  # between presses
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
class Reading:
    """What one strip of a picture shows."""

    condition: int
    frame: int


@dataclass(frozen=True)
class Study:
    """Where the films are seen, and read about."""

    url: str
    path: str
    slug: str
    token: str
    films: Path


def bars(condition: int, frame: int) -> NDArray[np.uint8]:
    """A picture of vertical bars, uint8 (H, W)."""
    code = condition << FRAME_BITS | frame
    code |= (code.bit_count() % 2) << (FRAME_BITS + 1)
    bits = np.array([code >> bit & 1 for bit in reversed(range(N_BARS))], dtype=bool)
    columns = np.arange(SIZE[0]) * N_BARS // SIZE[0]
    return np.broadcast_to(np.where(bits[columns], LIGHT, DARK).astype(np.uint8), SIZE[::-1])


def read_bars(row: NDArray[np.uint8]) -> Reading | None:
    """What `bars` wrote, from a row of pixels; None where there are no such bars."""
    centres = ((np.arange(N_BARS) + 0.5) * len(row) / N_BARS).astype(int)
    levels = row[centres].astype(int)
    if np.any(np.minimum(abs(levels - DARK), abs(levels - LIGHT)) > TOLERANCE):
        return None
    code = int("".join("1" if level > 128 else "0" for level in levels), 2)
    if code.bit_count() % 2:
        return None
    return Reading(code >> FRAME_BITS & 1, code & ((1 << FRAME_BITS) - 1))


def write_films(folder: Path) -> Path:
    """A stimulus set of two conditions."""
    stimuli = []
    for condition, name in enumerate(("one", "other")):
        path = folder / f"{name}.mp4"
        writer = imageio_ffmpeg.write_frames(
            str(path), SIZE, pix_fmt_in="gray", fps=FPS, codec="libx264", quality=None, macro_block_size=2,
            output_params=["-crf", "12", "-preset", "ultrafast"],
        )  # fmt: skip
        writer.send(None)
        for frame in range(N_FRAMES):
            writer.send(np.ascontiguousarray(bars(condition, frame)))
        writer.close()
        facts = {"width": SIZE[0], "height": SIZE[1], "fps": float(FPS), "n_frames": N_FRAMES}
        stimuli.append({"dataset": "bars", "approach": name, "video": path.name, "sha256": file_digest(path), **facts})
    content = {"schema_version": 1, "name": "bars", "stimuli": stimuli}
    (folder / "manifest.json").write_text(json.dumps(content))
    return folder


@contextmanager
def study() -> Iterator[Study]:
    """A study of one pair, whose exposure the participant ends, on a server of its own."""
    with tempfile.TemporaryDirectory() as folder:
        films = Path(folder) / "films"
        films.mkdir()
        settings = Settings(data_dir=Path(folder) / "server")
        options = parse_options({"free_exposure": True, "second_codec": "vp9"})
        made = create_study(settings, write_films(films), "Bars", exposure_s=SECONDS, seed=1, options=options)
        token = add_token(settings, "bench")["token"]
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
    await page.keyboard.press("Enter")
    await page.locator("[data-view=thanks]").wait_for()
    return last_viewing(of)


def last_viewing(of: Study) -> dict[str, Any]:
    rows = httpx.get(
        f"{of.url}/api/v1/studies/{of.slug}/trials?format=json", headers={"Authorization": f"Bearer {of.token}"}
    ).json()
    viewing: dict[str, Any] = rows[-1]["viewing"]
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


def goes_back(before: int, after: int) -> bool:
    """Whether a film went back, other than to its beginning."""
    is_new_pass = before > 0.9 * N_FRAMES and after < 0.1 * N_FRAMES
    return after < before and not is_new_pass


def latencies(pictures: Sequence[tuple[float, Reading | None]], presses: Sequence[float]) -> NDArray[np.float64]:
    """From each press to the swap of the first picture of the other condition, ms; NaN where none came in time."""
    found = []
    for number, pressed in enumerate(presses):
        until = presses[number + 1] if number + 1 < len(presses) else np.inf
        before = [reading.condition for at, reading in pictures if at < pressed and reading][-1:]
        changed = [
            at for at, reading in pictures if pressed <= at < until and reading and [reading.condition] != before
        ]
        found.append(changed[0] - pressed if changed and before else np.nan)
    return np.array(found)


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
        "press_to_picture_ms": {
            "median": round(float(np.nanmedian(delays)), 1),
            "p95": round(float(np.nanpercentile(delays, 95)), 1),
            "max": round(float(np.nanmax(delays)), 1),
            "missed": int(np.isnan(delays).sum()),
        },
        "black": sum(reading is None for _, reading in readings),
        "backward": sum(goes_back(one.frame, other.frame) for one, other in pairwise(seen)),
        "drops": f"{viewing['n_dropped']} of {viewing['n_frames']}",
        "stalls": viewing["n_stalls"],
        "record": {name: viewing[name] for name in ("technique", "n_mismatches") if name in viewing},
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


def both_strips(picture: NDArray[np.uint8]) -> tuple[Reading | None, Reading | None]:
    """What is in the film's window, and what lies above or below it."""
    at = [read_bars(picture[int(share * len(picture))]) for share in (0.05, 0.5, 0.95)]
    return at[1], at[0] or at[2]


def difference(pairs: Sequence[tuple[Reading | None, Reading | None]]) -> dict[str, Any]:
    """In how many pictures the two strips show different frames."""
    read = [(one, other) for one, other in pairs if one and other and one.condition != other.condition]
    differing = sum(one.frame != other.frame for one, other in read)
    return {
        "pictures": len(pairs),
        "unreadable": len(pairs) - len(read),
        "differing": differing,
        "differing_percent": round(100 * differing / max(1, len(read)), 2),
    }


RUNS = {"used": used, "lock": lock, "peer": peer}


async def in_chromium(name: str, of: Study, n: int) -> dict[str, Any]:
    async with async_playwright() as playwright:
        path = shutil.which("chromium") or shutil.which("chromium-browser")
        browser = await playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        context = await browser.new_context(locale="en")
        page = await context.new_page()
        try:
            return await RUNS[name](page, of, n)
        finally:
            await browser.close()


class Firefox:
    """Firefox by its own protocol, Marionette: packets of JSON with their length before them."""

    PREFERENCES: ClassVar[dict[str, Any]] = {
        "marionette.port": 0,
        "media.autoplay.default": 0,
        "dom.send_after_paint_to_content": True,
        "privacy.reduceTimerPrecision": False,
        "browser.shell.checkDefaultBrowser": False,
    }

    def __init__(self, program: str, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        preferences = {**self.PREFERENCES, "marionette.port": port}
        lines = [f"user_pref({json.dumps(name)}, {json.dumps(value)});" for name, value in preferences.items()]
        (folder / "user.js").write_text("\n".join(lines))
        command = [program, "--headless", "--marionette", "--profile", str(folder), "--no-remote"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.stream = self._connect(port)
        self.number = 0
        self._receive()  # a greeting
        self.tell("WebDriver:NewSession")

    def _connect(self, port: int) -> Any:
        for _ in range(600):
            try:
                return socket.create_connection(("127.0.0.1", port), timeout=60).makefile("rwb")
            except OSError:
                time.sleep(0.1)
        raise RuntimeError("Firefox does not open its port within a minute")

    def tell(self, command: str, **parameters: Any) -> Any:
        self.number += 1
        message = json.dumps([0, self.number, command, parameters]).encode()
        self.stream.write(str(len(message)).encode() + b":" + message)
        self.stream.flush()
        _, _, error, result = self._receive()
        if error:
            raise RuntimeError(f"{command}: {error['message']}")
        return result.get("value") if isinstance(result, dict) else result

    def _receive(self) -> Any:
        length = b""
        while (digit := self.stream.read(1)) != b":":
            length += digit
        return json.loads(self.stream.read(int(length)))

    def run(self, script: str) -> Any:
        return self.tell("WebDriver:ExecuteScript", script=f"return {script}", args=[])

    def wait_for(self, condition: str) -> None:
        for _ in range(600):
            if self.run(condition):
                return
            time.sleep(0.05)
        raise RuntimeError(f"Firefox: {condition} does not come true; it shows {self.run('document.body.innerText')!r}")

    def press_key(self, key: str) -> None:
        actions = [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        self.tell("WebDriver:PerformActions", actions=[{"type": "key", "id": "keyboard", "actions": actions}])

    def press_mouse(self, x: int, y: int) -> None:
        actions = [
            {"type": "pointerMove", "x": x, "y": y, "duration": 0},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerUp", "button": 0},
        ]
        self.tell("WebDriver:PerformActions", actions=[{"type": "pointer", "id": "mouse", "actions": actions}])

    def picture(self) -> NDArray[np.uint8]:
        png = base64.b64decode(self.tell("WebDriver:TakeScreenshot", full=False))
        return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE), np.uint8)

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(30)


PAINTS = """(() => {
    window.presses = []; window.paints = [];
    addEventListener("pointerdown", (event) => presses.push(event.timeStamp), { capture: true });
    addEventListener("MozAfterPaint", (event) => paints.push(event.paintTimeStamp));
})()"""


def in_firefox(of: Study, n: int) -> dict[str, Any]:
    """Screenshots between presses; and from each press to the paint that follows it."""
    program = shutil.which("firefox-esr") or shutil.which("firefox")
    if program is None:
        return {"skipped": "no Firefox is installed"}
    with tempfile.TemporaryDirectory() as folder:
        firefox = Firefox(program, Path(folder))
        try:
            return _firefox_run(firefox, of, n)
        finally:
            firefox.close()


def _firefox_run(firefox: Firefox, of: Study, n: int) -> dict[str, Any]:
    version = firefox.run("navigator.userAgent").split()[-1]
    firefox.tell("WebDriver:SetWindowRect", width=TALL[0], height=TALL[1] + 90)
    firefox.tell("WebDriver:Navigate", url=of.url + of.path)
    for view in ("welcome", "instructions-1", "instructions-2", "instructions-3"):
        firefox.wait_for(f"!document.querySelector('[data-view={view}]').hidden")
        firefox.press_key("\ue007")
    firefox.wait_for("document.querySelector('#trial').dataset.state === 'exposure'")
    firefox.run("document.querySelector('.film').style.overflow = 'visible'")
    firefox.run(PAINTS)
    pairs = []
    for _ in range(n):
        firefox.press_mouse(700, 1100)
        pairs.append(both_strips(firefox.picture()))
    presses, paints = firefox.run("window.presses"), np.array(firefox.run("window.paints"))
    firefox.press_key("\ue007")
    firefox.wait_for("document.querySelector('#trial').dataset.state === 'voting'")
    firefox.press_key("2")
    firefox.press_key("\ue007")
    firefox.wait_for("!document.querySelector('[data-view=thanks]').hidden")
    viewing = last_viewing(of)
    delays = [paints[paints > pressed][0] - pressed for pressed in presses if np.any(paints > pressed)]
    seen = [window for window, _ in pairs if window]
    return {
        "version": version,
        "switches": len(viewing["switches"]),
        **difference(pairs),
        "press_to_paint_ms": {
            "median": round(float(np.median(delays)), 1),
            "p95": round(float(np.percentile(delays, 95)), 1),
            "max": round(float(max(delays)), 1),
        }
        if delays
        else None,
        "black": sum(window is None for window, _ in pairs),
        "backward": sum(goes_back(one.frame, other.frame) for one, other in pairwise(seen)),
        "drops": f"{viewing['n_dropped']} of {viewing['n_frames']}",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--switches", type=int, default=1000)
    parser.add_argument("--only", choices=(*RUNS, "firefox"), action="append")
    arguments = parser.parse_args()
    with study() as of:
        for name in arguments.only or (*RUNS, "firefox"):
            load = os.getloadavg()[0]
            if name == "firefox":
                result = in_firefox(of, arguments.switches)
            else:
                result = asyncio.run(in_chromium(name, of, arguments.switches))
            result |= {"load_before": round(load, 1), "load_after": round(os.getloadavg()[0], 1)}
            sys.stdout.write(json.dumps({name: result}, indent=2) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
