"""Let the checks of uploads wait for one another, in all processes of a server.

Each may take a core and a gigabyte for many minutes, and votes are to be kept meanwhile.
"""

from __future__ import annotations

import fcntl
import hashlib
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from app.ffmpeg import Progress

FOLDER = "turns"
MOST_AT_ONCE = 2
LOOKS_EVERY_S = 0.5


@contextmanager
def in_turn(data_dir: Path, person: str, progress: Progress) -> Iterator[None]:
    """Wait for the end of this person's earlier check and for a place, and keep both while the block runs.

    Parameters
    ----------
    data_dir : of the server; a folder in it holds the locks, which end with their process
    person : who has sent the upload
    progress : is told of the wait, and may end it by raising an error
    """
    folder = data_dir / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256(person.encode()).hexdigest()[:32]
    places = [folder / f"place-{number}" for number in range(MOST_AT_ONCE)]
    with _one_of([folder / f"person-{name}"], progress), _one_of(places, progress):
        yield


@contextmanager
def _one_of(paths: Sequence[Path], progress: Progress) -> Iterator[None]:
    while True:
        for path in paths:
            with path.open("ab") as lock:  # closing it unlocks it, as the end of a process does
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    continue
                yield
                return
        progress("waiting for other uploads", 0, 1)
        time.sleep(LOOKS_EVERY_S)
