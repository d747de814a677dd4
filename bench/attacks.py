"""How quickly the server answers others while one client attacks it, without a proxy.

    python bench/attacks.py [--seconds 5] [--only files] [--json]

Each attack runs on loopback against a server of its own while `/healthz` is asked 20 times a second: first those by
connections, then small files that ask for very much (`bombs.py`). Prints the median and the longest of these answers,
how many failed, and the memory that the server took; for a file how much more the server took than before, the most
that another process took for it, and when it was refused.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

import httpx
from bombs import BOMBS, Bomb
from memory import memory_mb

from app.settings import Settings
from app.store.database.engine import open_database
from tests.app.web.admin.dashboard_client import signed_in
from tests.seeded_studies import seed_study
from tests.study_server import StudyServer

LINE = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n"
HEADER_MB = 141
N_SILENT = 1100
EVERY_S = 0.05
LOOKS_EVERY_S = 0.02
SETTLES_S = 8.0

Attack = Callable[[tuple[str, int], threading.Event], None]


def nothing(_: tuple[str, int], ended: threading.Event) -> None:
    """No attack, to compare with."""
    ended.wait()


def long_header(address: tuple[str, int], ended: threading.Event) -> None:
    """Send a header of 141 MB, again and again."""
    while not ended.is_set():
        with suppress(OSError), socket.create_connection(address) as client:
            client.sendall(LINE + b"x-long: ")
            for _ in range(HEADER_MB):
                client.sendall(b"x" * 1024 * 1024)


def many_headers(address: tuple[str, int], ended: threading.Event) -> None:
    """Send a request with 3 000 headers, again and again."""
    lines = b"".join(b"x-%d: x\r\n" % n for n in range(3000))
    while not ended.is_set():
        with suppress(OSError), socket.create_connection(address) as client:
            client.sendall(LINE + lines + b"\r\n")
            client.recv(65536)


def silence(address: tuple[str, int], ended: threading.Event) -> None:
    """Hold 1 100 connections that never finish their header, and open them again when they are closed."""
    with ExitStack() as opened:
        while not ended.is_set():
            for _ in range(N_SILENT):
                with suppress(OSError):
                    client = opened.enter_context(socket.create_connection(address, timeout=1))
                    client.sendall(LINE)
            ended.wait(1)
            opened.close()


def no_reading(address: tuple[str, int], ended: threading.Event) -> None:
    """Ask for 100 files on each of 200 connections, and read none."""
    ask = (LINE.replace(b"/healthz", b"/static/vendor/htmx.min.js") + b"\r\n") * 100
    with ExitStack() as opened:
        for _ in range(200):
            with suppress(OSError):
                opened.enter_context(socket.create_connection(address, timeout=1)).sendall(ask)
        ended.wait()


ATTACKS: tuple[Attack, ...] = (nothing, long_header, many_headers, silence, no_reading)


@dataclass
class Noticed:
    """What others noticed: how long each answer took, ms, and how many failed."""

    waits_ms: list[float] = field(default_factory=list)
    n_failed: int = 0

    def row(self) -> dict[str, Any]:
        waits = self.waits_ms
        return {
            "median_ms": round(median(waits), 1) if waits else None,
            "longest_ms": round(max(waits), 1) if waits else None,
            "failed": self.n_failed,
        }


@contextmanager
def others(server: StudyServer) -> Iterator[Noticed]:
    """Ask for `/healthz` 20 times a second while the block runs."""
    noticed, ended = Noticed(), threading.Event()

    def ask() -> None:
        with httpx.Client(timeout=60) as client:
            while not ended.is_set():
                began = time.perf_counter()
                try:
                    client.get(f"{server.base_url}/healthz").raise_for_status()
                    noticed.waits_ms.append(1000 * (time.perf_counter() - began))
                except httpx.HTTPError:
                    noticed.n_failed += 1
                ended.wait(EVERY_S)

    thread = threading.Thread(target=ask, daemon=True)
    thread.start()
    try:
        yield noticed
    finally:
        ended.set()
        thread.join(60)


def under(attack: Attack, seconds: float) -> dict[str, Any]:
    """Attack a server for some seconds; what others noticed, and the memory it had in the end."""
    ended = threading.Event()
    with tempfile.TemporaryDirectory() as folder, StudyServer(Path(folder), log=subprocess.DEVNULL) as server:
        attacker = threading.Thread(target=attack, args=(("127.0.0.1", server.port), ended), daemon=True)
        attacker.start()
        with others(server) as noticed:
            time.sleep(seconds)
        memory = round(memory_mb("VmRSS", server.pid))
        ended.set()
        attacker.join(10)
    return {"attack": (attack.__doc__ or "").rstrip("."), **noticed.row(), "memory_mb": memory}


def by_file(bomb: Bomb) -> dict[str, Any]:
    """Send a file to a server of its own; what others noticed, the memory that it took, and how soon it was refused."""
    with tempfile.TemporaryDirectory() as folder, StudyServer(Path(folder), log=subprocess.DEVNULL) as server:
        settings = Settings(data_dir=Path(folder))
        seed(settings)
        with signed_in(server.base_url, settings, "Dora") as dashboard:
            before = settled_mb(server.pid)
            with largest_of_others({server.pid, *processes_below(os.getpid())}) as largest, others(server) as noticed:
                began = time.perf_counter()
                told = bomb(dashboard, settings)
                seconds = time.perf_counter() - began
            grown = round(memory_mb("VmHWM", server.pid) - before)
    what = (bomb.__doc__ or "").rstrip(".")
    took = {"memory_mb": grown, "worker_mb": round(max(largest, default=0.0)), "seconds": round(seconds, 1)}
    return {"attack": what, **noticed.row(), **took, "refusal": told}


def seed(settings: Settings) -> None:
    """Insert a study that compares a and b in the dataset ball."""
    with open_database(settings.url) as database:
        seed_study(database, ["ball"], ["a", "b"])


@contextmanager
def largest_of_others(known: set[int]) -> Iterator[list[float]]:
    """Collect the highest memory of each process below this one, MB, besides the known ones, while the block runs."""
    largest: dict[int, float] = {}
    collected: list[float] = []
    ended = threading.Event()

    def look() -> None:
        while not ended.wait(LOOKS_EVERY_S):
            for process in processes_below(os.getpid()) - known:
                with suppress(OSError, IndexError):  # it has ended
                    largest[process] = memory_mb("VmHWM", process)

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield collected
    finally:
        ended.set()
        thread.join()
        collected.extend(largest.values())


def settled_mb(process: int) -> float:
    """Wait until a server has loaded what it loads after its start; the highest memory it had, MB."""
    before, now = 0.0, memory_mb("VmHWM", process)
    while now > before:
        time.sleep(SETTLES_S)
        before, now = now, memory_mb("VmHWM", process)
    return now


def processes_below(process: int) -> set[int]:
    """Return the processes that a process has started, and those that they have."""
    children: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent = int(path.read_text().rpartition(")")[2].split()[1])
            children.setdefault(parent, []).append(int(path.parent.name))
    below: set[int] = set()
    waiting = [process]
    while waiting:
        new = children.get(waiting.pop(), [])
        below.update(new)
        waiting.extend(new)
    return below


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each attack by connections")
    parser.add_argument("--only", choices=("connections", "files"), help="leave out the others")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = [under(attack, options.seconds) for attack in ATTACKS if options.only != "files"]
    rows += [by_file(bomb) for bomb in BOMBS if options.only != "connections"]
    if options.json:
        print(json.dumps(rows, indent=2))
        return
    print(f"{'':74} median      longest  failed  memory  of a worker  refused within")
    for row in rows:
        print(
            f"{row['attack']:70} {row['median_ms']!s:>6} ms  {row['longest_ms']!s:>7} ms  {row['failed']:6}"
            f"  {row['memory_mb']:3} MB"
            + (f"  {row['worker_mb']:8} MB  {row['seconds']:12} s" if "refusal" in row else "")
        )


if __name__ == "__main__":
    main()
