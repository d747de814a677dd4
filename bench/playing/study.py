"""The study in which films with bars are seen, on a server of its own, and what the server then knows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import httpx
import numpy as np
from numpy.typing import NDArray

from app.ffmpeg import run_ffmpeg
from app.main import running_server
from app.operations.studies.create import create_study
from app.operations.studies.manage import add_token
from app.settings import Settings
from app.study.options.options import parse_options
from playing.bars import SECONDS, write_films

PEER = """<!doctype html><meta charset="utf-8"><title>Two video elements</title>
<style>
  body { margin: 0; background: #808080 }
  video { position: absolute; left: 0; top: 0; width: 1920px; height: 1080px }
  .both #b { top: 1080px; opacity: 1 !important }
  .both #a { opacity: 1 !important }
</style>
<video id="a" muted loop><source src="one.mp4"><source src="one.webm"></video>
<video id="b" muted loop style="opacity: 0"><source src="other.mp4"><source src="other.webm"></video>
<script>
  const [a, b] = document.querySelectorAll("video");
  const ready = (video) => new Promise((done) => video.addEventListener("canplaythrough", done, { once: true }));
  Promise.all([ready(a), ready(b)]).then(() => { a.play(); b.play(); });
  addEventListener("pointerdown", () => {
    const other = b.style.opacity === "0";
    b.style.opacity = other ? "1" : "0";
    a.style.opacity = other ? "0" : "1";
  });
</script>"""
VP9 = ("-c:v", "libvpx-vp9", "-crf", "24", "-b:v", "0", "-deadline", "realtime", "-cpu-used", "8", "-g", "25")


@dataclass(frozen=True)
class Study:
    """Where the films are seen, and read about; `peer` is a page of two video elements."""

    url: str
    path: str
    slug: str
    token: str
    peer: str


@contextmanager
def served_study(folder: Path) -> Iterator[Study]:
    """A study of one pair in both orders and once more, whose exposures the participant ends."""
    films = folder / "films"
    films.mkdir(exist_ok=True)
    settings = Settings(data_dir=folder / "server")
    content = {
        "free_exposure": True,
        "see_both": False,
        "both_orders": True,
        "repeated_pairs": 1,
        "second_codec": "vp9",
    }
    name = f"Bars {uuid4()}"
    made = create_study(settings, write_films(films), name, exposure_s=SECONDS, seed=1, options=parse_options(content))
    token = add_token(settings, name)["token"]
    with running_server(settings) as url:
        yield Study(url, made["path"], made["slug"], token, _peer_page(films).as_uri())


def _peer_page(films: Path) -> Path:
    """The page of two video elements, and their films for browsers without H.264 too."""
    for name in ("one", "other"):
        webm = films / f"{name}.webm"
        if not webm.is_file():
            run_ffmpeg(["-i", str(films / f"{name}.mp4"), *VP9, str(webm)], f"{webm}: cannot be encoded")
    page = films / "peer.html"
    page.write_text(PEER, encoding="utf-8")
    return page


def last_viewing(study: Study) -> dict[str, Any]:
    """Of the participant who came last, the trial that was voted on last."""
    rows = httpx.get(
        f"{study.url}/api/v1/studies/{study.slug}/trials?format=json",
        headers={"Authorization": f"Bearer {study.token}"},
    ).json()
    viewing: dict[str, Any] = [row["viewing"] for row in rows if row["choice"]][-1]
    return viewing


def dropped(viewing: dict[str, Any]) -> dict[str, Any]:
    """Frames that were not shown, by the page's own record."""
    n_dropped, n_frames = viewing["n_dropped"], viewing["n_frames"]
    return {"drops": f"{n_dropped} of {n_frames}", "drops_percent": round(100 * n_dropped / max(1, n_frames), 2)}


def summary(values: Sequence[float] | NDArray[np.float64]) -> dict[str, float]:
    return {
        "median": round(float(np.nanmedian(values)), 1),
        "p95": round(float(np.nanpercentile(values, 95)), 1),
        "max": round(float(np.nanmax(values)), 1),
    }
