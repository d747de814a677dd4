"""Keep a worker process beside the server: start it again when it dies, and end it with the server."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from app.operations.jobs.command import needed_environment
from app.operations.jobs.worker import ENDS_WITHIN_S, work
from app.settings import Settings
from app.store.database.engine import holds_password

SHORTEST_PAUSE_S, LONGEST_PAUSE_S = 1.0, 60.0  # before a worker that died is started again
LOOKS_EVERY_S = 0.2

log = logging.getLogger(__name__)


@contextmanager
def worker_beside(settings: Settings, n_at_once: int) -> Iterator[None]:
    """Keep a worker running while the block runs.

    It is a process of its own, so that no job slows the server's threads. When it ends, its jobs are stopped and queued
    again: the next server takes them up. It also ends when this process is killed.

    Parameters
    ----------
    settings : of the server
    n_at_once : how many jobs to run at a time; 0: none, and no worker is started
    """
    stop = threading.Event()
    keeper = threading.Thread(target=_keep, args=(settings, n_at_once, stop), name="job-worker")
    if n_at_once:
        keeper.start()
    try:
        yield
    finally:
        stop.set()
        if n_at_once:
            keeper.join()


class _Terminated(BaseException):
    """The process was told to end."""


@contextmanager
def ends_in_order() -> Iterator[None]:
    """Leave the blocks inside before this process dies of SIGTERM, which uvicorn raises again when it has stopped."""

    def leave(_number: int, _frame: FrameType | None) -> None:
        raise _Terminated

    before = signal.signal(signal.SIGTERM, leave)
    is_terminated = False
    try:
        yield
    except _Terminated:
        is_terminated = True
    finally:
        signal.signal(signal.SIGTERM, before)
    if is_terminated:
        signal.raise_signal(signal.SIGTERM)


def _keep(settings: Settings, n_at_once: int, stop: threading.Event) -> None:
    pause_s = SHORTEST_PAUSE_S
    while not stop.is_set():
        process = _start(settings, n_at_once)
        while process.poll() is None and not stop.wait(LOOKS_EVERY_S):
            pass
        if stop.is_set():
            _end(process)
            return
        log.warning("the worker for jobs ended (status %s); it is started again in %g s", process.returncode, pause_s)
        stop.wait(pause_s)
        pause_s = min(2 * pause_s, LONGEST_PAUSE_S)


def _start(settings: Settings, n_at_once: int) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-P", "-m", __name__, str(n_at_once), str(os.getpid())],
        stdin=subprocess.DEVNULL,
        env=_environment(settings),
        process_group=0,  # Ctrl-C reaches the server alone, which then ends the worker
    )


def _environment(settings: Settings) -> dict[str, str]:
    """Return the settings and what a program needs; of PostgreSQL's names the password only if the address has none."""
    needed = needed_environment() | settings.as_environment()
    if not settings.is_sqlite:
        needed |= {name: value for name, value in os.environ.items() if name.startswith("PG")}
        if holds_password(settings.url):
            needed.pop("PGPASSWORD", None)
    return needed


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(2 * ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


if __name__ == "__main__":
    work(Settings(), int(sys.argv[1]), parent=int(sys.argv[2]))
