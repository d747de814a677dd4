"""Find the server of a data folder: while it serves it notes its address there, so that printed links work."""

from __future__ import annotations

import fcntl
import os
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from app.files import read_json, write_json
from app.settings import Settings

NOTE_FILE = "server.json"  # in the data folder
LOCK_FILE = "server.lock"  # beside it, held while a server has the folder for itself
DEFAULT_URL = "http://127.0.0.1:8000"
LOOPBACK = {"//0.0.0.0": "//127.0.0.1", "//[::]": "//[::1]"}  # this computer, for what listens on every network
TIMEOUT_S = 5.0  # a busy server; where none is, the answer comes at once


@contextmanager
def noted(settings: Settings, url: str) -> Iterator[None]:
    """Note the address of a server while the block runs."""
    note = settings.data_dir / NOTE_FILE
    before, mine = _content_of(note), {"url": url, "process": os.getpid()}
    write_json(note, mine)
    try:
        yield
    finally:
        if _content_of(note) == mine:  # another server may have started meanwhile
            if _answers(str(before.get("url", ""))):  # one that still serves the folder
                write_json(note, before)
            else:
                note.unlink(missing_ok=True)


@contextmanager
def alone(settings: Settings) -> Iterator[None]:
    """Hold a folder with SQLite while the block runs: a second server would take the first one's work for lost.

    Raises
    ------
    ValueError
        If another server holds it.
    """
    if not settings.is_sqlite:
        yield
        return
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    with (settings.data_dir / LOCK_FILE).open("ab") as lock:  # closing it unlocks it, as the end of a process does
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ValueError(
                f"another server, at {running_url(settings) or 'an address that does not answer'}, serves "
                f"{settings.data_dir} already; stop it, or choose another folder (RECONSTUDY_DATA_DIR)"
            ) from error
        yield


def running_url(settings: Settings) -> str | None:
    """Return the address of the server that serves this data folder; None if none answers."""
    url = str(_content_of(settings.data_dir / NOTE_FILE).get("url", ""))
    return url if _answers(url) else None


def url_for_links(settings: Settings) -> str:
    """Return the address for links that are printed: the public one, that of the running server, or the usual one."""
    url = settings.public_url or running_url(settings) or DEFAULT_URL
    for every_network, loopback in LOOPBACK.items():
        url = url.replace(every_network, loopback)
    return url


def _content_of(note: Path) -> dict[str, Any]:
    try:
        return read_json(note)
    except ValueError:  # nobody serves
        return {}


def _answers(url: str) -> bool:
    try:
        with urllib.request.urlopen(f"{url}/healthz", timeout=TIMEOUT_S) as answer:
            return bool(answer.status == 200)
    except (OSError, ValueError):
        return False
