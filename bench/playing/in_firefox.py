"""What Firefox shows, without a screen and drawn by the processor: the page, and two video elements beside it."""

from __future__ import annotations

import shutil
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from playing.bars import both_strips, difference, goes_back
from playing.in_chromium import TALL
from playing.study import Study, dropped, last_viewing, summary
from tests.browser.remote_browsers import Firefox

PAUSE_S = 0.07  # between presses, besides what the protocol takes
MOST_SHOTS = 80  # a picture of the tall window takes half a second
PEER_PRESSES, PEER_SHOTS = 100, 20
HEAD = 86  # pixels of Firefox's own bars
PAINTS = """(() => {
    window.presses = []; window.paints = [];
    addEventListener("pointerdown", (event) => presses.push(event.timeStamp), { capture: true });
    addEventListener("MozAfterPaint", (event) => paints.push(event.paintTimeStamp ?? performance.now()));
})()"""
QUALITY = "(({totalVideoFrames: n_frames, droppedVideoFrames: n_dropped}) => ({n_frames, n_dropped}))"
SETTLED = "!('settling' in document.documentElement.dataset)"  # presses count, see static/js/settling.js


def run(study: Study, n: int) -> dict[str, Any]:
    """The page, then the peer; and how much faster or slower the page is than that."""
    program = shutil.which("firefox-esr") or shutil.which("firefox")
    if program is None:
        return {"skipped": "no Firefox is installed"}
    with tempfile.TemporaryDirectory() as folder:
        size = (TALL[0], TALL[1] + HEAD)  # from the beginning: a window that is resized leaves full screen
        firefox = Firefox(program, Path(folder), size=size)
        try:
            version = firefox.run("navigator.userAgent").split()[-1]
            page = _page(firefox, study, n)
            peer = _peer(firefox, study)
        finally:
            firefox.close()
    times, theirs = page["press_to_paint_ms"], peer["press_to_paint_ms"]
    slower = {name: round(times[name] / theirs[name], 2) for name in ("median", "p95")}
    return {"version": version, **page, "peer": peer, "press_to_paint_over_peers": slower}


def _page(firefox: Firefox, study: Study, n: int) -> dict[str, Any]:
    firefox.open(study.url + study.path)
    for view in ("welcome", "instructions-1", "instructions-2", "instructions-3"):
        firefox.wait_for(f"!document.querySelector('[data-view={view}]').hidden && {SETTLED}")
        firefox.press_key("\ue007")
    firefox.wait_for("document.querySelector('#trial').dataset.state === 'exposure'")
    size = firefox.run("[innerWidth, innerHeight]")
    timed = _timed(firefox, n)
    firefox.run("document.querySelector('.film').style.overflow = 'visible'")
    pairs = _shots(firefox, min(MOST_SHOTS, n))
    viewing = _vote(firefox, study)
    seen = [window for window, _ in pairs if window]
    return {
        "window": size,
        "technique": viewing["technique"],
        "switches": len(viewing["switches"]),
        **timed,
        **difference(pairs),
        "press_to_presented_ms": summary([s["presented_ms"] - s["at_ms"] for s in viewing["switches"][:n]]),
        "black": sum(window is None for window, _ in pairs),
        "backward": sum(goes_back(one.frame, other.frame) for one, other in pairwise(seen)),
    }


def _peer(firefox: Firefox, study: Study) -> dict[str, Any]:
    firefox.open(study.peer)
    firefox.wait_for("document.querySelector('#b').currentTime > 0.3")
    timed = _timed(firefox, PEER_PRESSES)
    firefox.run("document.body.className = 'both'")
    return {**timed, **difference(_shots(firefox, PEER_SHOTS))}


def _timed(firefox: Firefox, n: int) -> dict[str, Any]:
    """From each press to the paint that follows it, and what the browser meanwhile dropped."""
    before = _counts(firefox)
    firefox.run(PAINTS)
    for _ in range(n):
        firefox.press_mouse(700, 540)
        time.sleep(PAUSE_S)
    presses, paints = firefox.run("window.presses"), np.array(firefox.run("window.paints"))
    after = _counts(firefox)
    counted = {name: after[name] - before[name] for name in after}
    delays = [paints[paints > at][0] - at for at in presses if np.any(paints > at)]
    return {"press_to_paint_ms": summary(delays), **dropped(counted)}


def _counts(firefox: Firefox) -> dict[str, int]:
    """Of the page's first film."""
    counts: dict[str, int] = firefox.run(f"{QUALITY}(document.querySelector('video').getVideoPlaybackQuality())")
    return counts


def _shots(firefox: Firefox, n: int) -> list[Any]:
    pairs = []
    for _ in range(n):
        firefox.press_mouse(700, 540)
        pairs.append(both_strips(firefox.picture()))
    return pairs


def _vote(firefox: Firefox, study: Study) -> dict[str, Any]:
    firefox.press_key("\ue007")
    firefox.wait_for("document.querySelector('#trial').dataset.state === 'voting' && " + SETTLED)
    firefox.press_key("2")
    firefox.press_key("\ue007")
    firefox.wait_for("document.querySelector('#trial').dataset.state === 'exposure'")  # the next: the vote is kept
    return last_viewing(study)
