"""Small files that ask for very much, sent by somebody who is signed in; each returns the sentence that refuses it."""

from __future__ import annotations

import html
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from zipfile import ZIP_STORED

import httpx

from app.settings import Settings
from tests.app.intake.test_bombs import glb, ply, png, runs
from tests.app.intake.test_bombs import zipped as packed
from tests.app.web.admin.dashboard_client import Dashboard, zipped

MB = 1024 * 1024
STUDY = "/admin/studies/test"
LOOKS_EVERY_S = 0.05
LOOKS_FOR_S = 15.0
LISTS = b'{"measures": [' + b"[]," * (5 * MB - 10) + b"[]]}"
REFUSAL = re.compile(r'<p class="warning" role="alert">(.*?)</p>', re.DOTALL)

Bomb = Callable[[Dashboard, Settings], str]


def nothing(dashboard: Dashboard, _: Settings) -> str:
    """No file, to compare with."""
    until = time.monotonic() + LOOKS_FOR_S
    while time.monotonic() < until:
        dashboard.get(f"{STUDY}/objective").raise_for_status()
        time.sleep(LOOKS_EVERY_S)
    return ""


def many_lists(dashboard: Dashboard, _: Settings) -> str:
    """A report in an archive of 15 kB, 15 MB of empty lists."""
    return attach(dashboard, zipped({"report.json": LISTS}))


def stored_lists(dashboard: Dashboard, settings: Settings) -> str:
    """The same in an archive of 15 MB."""
    files = {"report.json": LISTS}
    return attach(dashboard, packed(settings.data_dir / "packed.zip", files, ZIP_STORED).read_bytes())


def far_too_long(dashboard: Dashboard, _: Settings) -> str:
    """A report in an archive of 117 kB, 120 MB of empty lists."""
    return attach(dashboard, zipped({"report.json": b"[]," * (40 * MB)}))


def points(dashboard: Dashboard, _: Settings) -> str:
    """A PLY whose header promises 10⁹ points, to attach to a study."""
    return attach(dashboard, zipped({"clouds/ball/a.ply": ply(10**9)}))


def columns(dashboard: Dashboard, _: Settings) -> str:
    """A table of measures with a million columns, 7 MB."""
    names = ",".join(map(str, range(10**6)))
    return attach(dashboard, f"{names}\n1\n".encode())


def model(dashboard: Dashboard, settings: Settings) -> str:
    """A GLB whose header promises 10⁹ points, to film."""
    scene = {"schema_version": 1, "dataset": "ball", "fps": 25, "units": "m", "up": "y", "path": {"orbit": {}}}
    files = {"scene.json": json.dumps(scene).encode(), "a/0000.glb": glb(10**9)}
    shelve(dashboard, "models", "bomb", zipped(files))
    job = dashboard.act("/admin/work/new/render", sources="models/bomb", name="bomb").url.path
    work = [sys.executable, "-m", "app.cli", "work", "--once"]
    subprocess.run(work, env=environment(settings), check=True, capture_output=True)
    return refusal(dashboard.get(job))


def picture(dashboard: Dashboard, _: Settings) -> str:
    """A PNG whose header says 20 000 × 20 000, to look at."""
    camera = {"image": "{frame}.png", "size": [20_000, 20_000]}
    content = {"name": "bomb", "n_frames": 1, "fps": 25, "sensors": [{"id": "S1", "left": camera}]}
    files = {"capture.json": json.dumps(content).encode(), "0.png": png(20_000, 20_000)}
    shelve(dashboard, "captures", "bomb", zipped(files))
    address = "/admin/files/captures/bomb/pictures/S1/left/0.jpg"
    return str(dashboard.get(address, headers={"Accept": "application/json"}).json()["detail"])


def table(_: Dashboard, settings: Settings) -> str:
    """A Parquet file of 30 kB with 60 million votes, to analyse."""
    path = settings.data_dir / "votes.parquet"
    path.write_bytes(runs(60 * 10**6))
    command = [sys.executable, "-m", "app.cli", "analyse", str(path), "-o", str(settings.data_dir / "out")]
    done = subprocess.run(command, env=environment(settings), check=False, capture_output=True, text=True)
    assert done.returncode == 1, done
    return done.stderr.strip()


BOMBS: tuple[Bomb, ...] = (nothing, many_lists, stored_lists, far_too_long, points, model, picture, columns, table)


def environment(settings: Settings) -> Mapping[str, str]:
    return os.environ | settings.as_environment() | {"PYTHONPATH": str(Path(__file__).parent.parent)}


def attach(dashboard: Dashboard, content: bytes) -> str:
    """Upload results to a study."""
    headers = {"X-CSRF-Token": dashboard.form_token, "Accept": "application/json"}
    sent = dashboard.put(f"{STUDY}/upload", content=content, headers=headers)
    return refusal(after(dashboard, sent.json()["task"])) if sent.status_code == 202 else str(sent.json()["detail"])


def shelve(dashboard: Dashboard, kind: str, name: str, content: bytes) -> None:
    """Upload a file in one part, and wait until it is on its shelf."""
    headers = {"X-CSRF-Token": dashboard.form_token, "Accept": "application/json"}
    wanted = {"kind": kind, "name": name, "file": "file.zip", "size": len(content)}
    upload = dashboard.post("/admin/files/upload", json=wanted, headers=headers).json()["upload"]
    sent = dashboard.patch(upload, content=content, headers=headers | {"Upload-Offset": "0"})
    shown = after(dashboard, sent.json()["task"])
    assert shown.url.path == f"/admin/files/{kind}/{name}", shown.text


def after(dashboard: Dashboard, job: str) -> httpx.Response:
    """Wait for the end of some work; the page that comes then."""
    while 'http-equiv="refresh"' in (page := dashboard.get(job)).text:
        time.sleep(LOOKS_EVERY_S)
    return page


def refusal(page: httpx.Response) -> str:
    """Return the sentence in which a page says what is wrong."""
    told = REFUSAL.search(page.text)
    assert told, page.text
    return html.unescape(re.sub("<[^>]+>", "", told[1])).strip()
