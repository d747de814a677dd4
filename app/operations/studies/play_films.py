"""Play films in a headless browser of this machine: what it cannot show, participants of this browser cannot see.

A small server for this machine alone hands out the list, the films and the player's own scripts under an address that
nobody can guess; the browser tells it of each film.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from app.errors import UnavailableError
from app.ffmpeg import Progress, no_progress
from app.files import packaged

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge")
LONGEST_SILENCE_S = 90.0  # of the browser, which tells of every film
LARGEST_TOLD = 10_000  # bytes
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Films</title>
<body><p id="status"></p><script type="module" src="js/check-films.js"></script></body></html>"""
TYPES = {".js": "text/javascript", ".json": "application/json", ".mp4": "video/mp4", ".html": "text/html"}


@dataclass(frozen=True)
class PlayedFilm:
    """A film as a player expects it.

    Parameters
    ----------
    path : the file
    by : what shows it: the browser's video element, or its decoder picture by picture
    type : its media type with the codec
    width, height : pixels of the whole film
    """

    path: Path
    by: Literal["video", "decoder"]
    type: str
    width: int
    height: int
    n_frames: int
    fps: float


def find_browser(wanted: str) -> str | None:
    """Return the path of a browser that runs here; None: there is none, or none is wanted.

    Parameters
    ----------
    wanted : "auto", "none" or a path
    """
    if wanted == "none":
        return None
    for name in BROWSERS if wanted == "auto" else (wanted,):
        path = shutil.which(name)
        if path and subprocess.run([path, "--version"], capture_output=True, check=False).returncode == 0:
            return path
    return None


def browser_version(path: str) -> str:
    """Return what a browser calls itself, for example "Chromium 140.0"."""
    return subprocess.run([path, "--version"], capture_output=True, check=False, text=True).stdout.strip()[:80]


def play_films(browser: str, films: Sequence[PlayedFilm], progress: Progress = no_progress) -> list[str]:
    """Play films in a browser and return what is wrong with each; empty: it plays to its end in the expected size.

    Raises
    ------
    UnavailableError
        If the browser does not start, or falls silent.
    """
    faults: list[str | None] = [None] * len(films)
    heard = threading.Condition()

    def hear(number: int, fault: str) -> None:
        with heard:
            if 0 <= number < len(faults):
                faults[number] = fault
            heard.notify_all()

    progress("", 0, len(films))
    with _served(films, hear) as address, _running(browser, address) as process:
        told_at, n_before = time.monotonic(), 0
        while (n := sum(fault is not None for fault in faults)) < len(films):
            if n > n_before:
                told_at, n_before = time.monotonic(), n
                progress("playing films in a browser", n, len(films))
            if process.poll() not in (None, 0) or time.monotonic() - told_at > LONGEST_SILENCE_S:
                raise UnavailableError(f"{browser} could not be used to play the films; it ended or fell silent")
            with heard:
                heard.wait(1.0)
    return [fault or "" for fault in faults]


@contextmanager
def _served(films: Sequence[PlayedFilm], hear: Any) -> Iterator[str]:
    """Serve the page, the scripts and the films on this machine; yields the address."""
    secret = secrets.token_urlsafe(18)
    listed = [{**asdict(film), "path": None, "url": f"film/{number}.mp4"} for number, film in enumerate(films)]
    known: dict[str, bytes | Path] = {
        "index.html": PAGE.encode(),
        "films.json": json.dumps(listed).encode(),
        **{f"js/{script.name}": script for script in (packaged("static") / "js").glob("*.js")},
        **{f"film/{number}.mp4": film.path for number, film in enumerate(films)},
    }
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Answers, f"/{secret}/", known, hear))
    threading.Thread(target=server.serve_forever, name="films for a browser", daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/{secret}/index.html"
    finally:
        server.shutdown()
        server.server_close()


class _Answers(BaseHTTPRequestHandler):
    """Answers the browser: known places below the secret, and what it tells."""

    def __init__(self, base: str, known: dict[str, bytes | Path], hear: Any, *args: Any) -> None:
        self.base, self.known, self.hear = base, known, hear
        super().__init__(*args)

    def do_GET(self) -> None:
        place = self.path.removeprefix(self.base) if self.path.startswith(self.base) else ""
        content = self.known.get(place)
        try:
            body = content.read_bytes() if isinstance(content, Path) else content
        except OSError:
            body = None
        self._answer(404 if body is None else 200, body or b"", TYPES.get(Path(place).suffix, "text/plain"))

    def do_POST(self) -> None:
        size = int(self.headers.get("Content-Length") or 0)
        if self.path != f"{self.base}told" or not 0 < size <= LARGEST_TOLD:
            self._answer(404, b"", "text/plain")
            return
        try:
            told = json.loads(self.rfile.read(size))
            self.hear(int(told["number"]), str(told["fault"])[:500])
        except (ValueError, KeyError, TypeError):
            self._answer(422, b"", "text/plain")
            return
        self._answer(204, b"", "text/plain")

    def _answer(self, status: int, body: bytes, kind: str) -> None:
        with suppress(ConnectionError):
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

    def log_message(self, *_args: Any) -> None:
        """Keep standard error to what people need."""


@contextmanager
def _running(browser: str, address: str) -> Iterator[subprocess.Popen[bytes]]:
    """Open a page in a headless browser with a profile of its own; it ends with the block, and all its processes."""
    sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []  # Chromium refuses to run as root with it
    with TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        arguments = [
            *("--headless=new", "--mute-audio", "--no-first-run", "--disable-gpu", "--disable-background-networking"),
            *("--autoplay-policy=no-user-gesture-required", f"--user-data-dir={profile}", *sandbox, address),
        ]
        process = subprocess.Popen(
            [browser, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
