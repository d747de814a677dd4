"""How many votes a second one server process keeps, and how long participants wait for the answer.

    python bench/server.py [--votes 4000] [--rounds 3] [--only WORDS] [--json]

One server process (tests/study_server.py), one client process, all on this machine; each row has a fresh database.
"A commit each" is the same server with one vote in a transaction; "as avrateNG" is bench/avrateng.py, where bottle is
installed (`pip install bottle`). The slow disk takes 5 ms more for every sync. The row beside video sends 300 votes a
second while a third process fetches video over eight lines of 14.1 MB/s: what 140 participants watch; the row beside a
reconstruction sends them while a worker runs such a job of the dashboard. Rows are measured
in turn, several rounds, each with new servers; medians are shown, and the bars come last. `stolen_percent` is what a
virtual machine's host took of the processors' time meanwhile.
"""

from __future__ import annotations

import argparse
import asyncio
import importlib.util
import json
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from http.client import HTTPConnection
from itertools import count
from multiprocessing import get_context
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from random import Random
from statistics import median
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

import numpy as np
from voters import voters_of

from app.operations.jobs.beside_server import worker_beside
from app.operations.jobs.kinds import job_kind
from app.settings import Settings
from app.store.database.engine import Database, open_database
from app.store.database.keys import utc_now
from app.store.database.tables import pair
from app.store.queue import enqueue, job_by_id
from recon.studio import SynthParameters, synthesise
from tests import sqlite_disk
from tests.app.web.vote_senders import Letter, Line, Tally, letters_of, send_all
from tests.postgresql import PostgresServer
from tests.study_server import START_TIMEOUT_S, StudyServer, free_port

AVRATENG_SERVER = Path(__file__).parent / "avrateng.py"
A_COMMIT_EACH, SLOW_DISK = "bench.server_changes:a_commit_each", "bench.server_changes:slow_disk"
SLOW_EACH, SLOW_OURS = "slow disk, a commit each, 32", "slow disk, our writer, 32"
BESIDE = "300/s beside video"
BESIDE_WORK = "300/s beside a reconstruction"
VIDEO_BYTES = 15_000_000
RATE_PER_S = 300.0
N_WATCHERS, WATCHED_MB_S = 8, 14.1  # a little over the bar
WARM_UP_S = 3.0  # until all of them watch
JOB_BEGINS_WITHIN_S = 300

Row = dict[str, Any]


def prepare(url: str, n_connections: int, n_votes: int) -> list[list[Letter]]:
    """Make a database and the votes for it, one bundle for each connection."""
    voters, rng = voters_of(url, n_connections, n_votes), Random(1)
    with open_database(url) as database, database.writing() as connection:
        connection.execute(pair.update().values(file="film.mp4"))
        if connection.dialect.name == "postgresql":
            connection.exec_driver_sql("ANALYZE")  # by itself it does so within a minute
    return [letters_of(voter, rng)[: n_votes // n_connections] for voter in voters]


def row_of(tally: Tally) -> Row:
    p50, p99 = np.percentile(tally.latencies_ms, [50, 99]).tolist()
    n_refused = sum(n for status, n in tally.statuses.items() if status not in (200, 201))
    return {
        "votes_per_s": round(len(tally.latencies_ms) / tally.seconds),
        "p50_ms": round(p50, 2),
        "p99_ms": round(p99, 2),
        "errors": n_refused + tally.n_broken,
    }


def load(n_connections: int, n_votes: int, *options: str, url: str | None = None) -> Row:
    """All votes as fast as they are answered."""
    with tempfile.TemporaryDirectory() as folder:
        bundles = prepare(url or f"sqlite:///{folder}/study.sqlite", n_connections, n_votes)
        with StudyServer(Path(folder), *options, database_url=url) as server:
            return row_of(asyncio.run(send_all(server.port, bundles)))


def as_avrateng(n_votes: int) -> Row:
    port = free_port()
    with tempfile.TemporaryDirectory() as folder:
        bundles = prepare(f"sqlite:///{folder}/study.sqlite", 16, n_votes)
        command = [sys.executable, str(AVRATENG_SERVER), str(port), f"{folder}/ratings.sqlite"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            wait_for_port(port, process)
            return row_of(asyncio.run(send_all(port, bundles)))
        finally:
            process.kill()
            process.wait()


def wait_for_port(port: int, process: subprocess.Popen[bytes]) -> None:
    """Wait until a process answers on its port."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while True:
        with suppress(OSError):
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return
        if process.poll() is not None or time.monotonic() > deadline:
            raise RuntimeError(f"the server on port {port} did not start: exit {process.returncode}")
        time.sleep(0.02)


def watch(port: int, video: str, n_received: Synchronized[int]) -> None:
    """Fetch a video again and again over lines of a limited rate, as browsers do that fetch films whole."""
    with ThreadPoolExecutor(N_WATCHERS) as pool:
        for number in range(N_WATCHERS):
            pool.submit(_watch_over_a_line, port, video, n_received, number / N_WATCHERS)


def _watch_over_a_line(port: int, video: str, n_received: Synchronized[int], first_s: float) -> None:
    time.sleep(first_s)
    line = HTTPConnection("127.0.0.1", port)
    started, n_read, chunk = time.perf_counter(), 0, bytearray(2**18)
    while True:
        line.request("GET", video)
        answer = line.getresponse()
        while n := answer.readinto(chunk):
            n_read += n
            with n_received.get_lock():
                n_received.value += n
            time.sleep(max(0.0, n_read / (1e6 * WATCHED_MB_S) - (time.perf_counter() - started)))


async def send_at_rate(port: int, bundles: Sequence[Sequence[Letter]], per_s: float) -> Tally:
    """Send votes at a rate, each bundle over a connection of its own."""
    tally, rng = Tally(), Random(1)
    started = time.perf_counter()
    pause_s = len(bundles) / per_s
    async with asyncio.TaskGroup() as group:
        for number, bundle in enumerate(bundles):
            group.create_task(_send_slowly(port, bundle, tally, pause_s, rng.uniform(0, pause_s) + 0.001 * number))
    tally.seconds = time.perf_counter() - started
    return tally


async def _send_slowly(port: int, bundle: Sequence[Letter], tally: Tally, pause_s: float, first_s: float) -> None:
    line, due = Line(port, tally), time.perf_counter() + first_s
    for letter in bundle:
        await asyncio.sleep(max(0.0, due - time.perf_counter()))
        await line.deliver(letter)
        due += pause_s
    await line.close()


def beside_video(n_votes: int) -> Row:
    """300 votes a second while browsers fetch films from the same process."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bundles = prepare(f"sqlite:///{folder}/study.sqlite", 16, n_votes)
        (folder / "pairs").mkdir()
        (folder / "pairs" / "film.mp4").write_bytes(bytes(VIDEO_BYTES))
        with open_database(f"sqlite:///{folder}/study.sqlite") as database, database.reading() as connection:
            media = connection.scalar(pair.select().with_only_columns(pair.c.media).limit(1))
        with StudyServer(folder) as server:
            context = get_context("spawn")
            n_received: Synchronized[int] = context.Value("q", 0)
            watchers = context.Process(target=watch, args=(server.port, f"/media/{media}", n_received), daemon=True)
            watchers.start()
            try:
                time.sleep(WARM_UP_S)
                before = n_received.value
                tally = asyncio.run(send_at_rate(server.port, bundles, RATE_PER_S))
                n_bytes = n_received.value - before
            finally:
                watchers.kill()
                watchers.join()
        return {**row_of(tally), "video_MB_per_s": round(n_bytes / tally.seconds / 1e6, 1)}


def beside_work(n_votes: int) -> Row:
    """300 votes a second while a worker reconstructs a capture, as a job of the dashboard."""
    with tempfile.TemporaryDirectory() as name:
        here = Settings(data_dir=Path(name))
        bundles = prepare(here.url, 16, n_votes)
        recorded = SynthParameters(scene="ball", n_frames=8, size=(960, 540))
        synthesise(here.intake_dir / "captures" / "ball", recorded)
        database = open_database(here.url)
        with database.writing() as connection:
            public_id = enqueue(connection, job_kind("reconstruct").read({"capture": "ball"}, here), "bench", utc_now())
        with StudyServer(here.data_dir) as server, worker_beside(here, 1):
            wait_for_step(database, public_id)
            tally = asyncio.run(send_at_rate(server.port, bundles, RATE_PER_S))
            with database.reading() as connection:
                assert job_by_id(connection, public_id).state == "running", "it ended too early; record more frames"
        database.dispose()
        return row_of(tally)


def wait_for_step(database: Database, public_id: str) -> None:
    """Wait until a job has matched its first pictures: then all its code is compiled."""
    deadline = time.monotonic() + JOB_BEGINS_WITHIN_S
    while time.monotonic() < deadline:
        with database.reading() as connection:
            if job_by_id(connection, public_id).done > 1:
                return
        time.sleep(0.2)
    raise RuntimeError(f"the reconstruction did not begin within {JOB_BEGINS_WITHIN_S} s")


def cases(n_votes: int, new_postgresql: Callable[[], str]) -> Iterator[tuple[str, Callable[[], Row]]]:
    """What each row is called, and what measures it."""
    each, n_few = ("--first", A_COMMIT_EACH), max(n_votes // 8, 32)
    yield "SQLite, a commit each, 16", lambda: load(16, n_few, *each)
    yield "SQLite, our writer, 16", lambda: load(16, n_votes)
    if importlib.util.find_spec("bottle"):
        yield "as avrateNG, 16", lambda: as_avrateng(max(n_votes // 2, 16))
    if sqlite_disk.is_possible():
        yield SLOW_EACH, lambda: load(32, n_few, *each, SLOW_DISK)
        yield SLOW_OURS, lambda: load(32, n_votes, "--first", SLOW_DISK)
    yield "PostgreSQL, a commit each, 16", lambda: load(16, n_few, *each, url=new_postgresql())
    yield "PostgreSQL, our writer, 16", lambda: load(16, n_votes, url=new_postgresql())
    yield BESIDE, lambda: beside_video(n_votes)
    yield BESIDE_WORK, lambda: beside_work(n_votes)


def measured(case: Callable[[], Row]) -> Row:
    stolen, total = stolen_and_total()
    row = case()
    stolen_after, total_after = stolen_and_total()
    return row | {"stolen_percent": round(100 * (stolen_after - stolen) / (total_after - total), 1)}


def stolen_and_total() -> tuple[int, int]:
    """Processor time since the machine's start that its host took away, and all, in ticks (proc(5), /proc/stat)."""
    ticks = [int(field) for field in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
    return ticks[7], sum(ticks)


def verdicts(rounds: Mapping[str, Sequence[Row]]) -> Iterator[tuple[str, float, float, bool]]:
    """What was reached in the median of the rounds, the bar for it, and whether it was passed."""
    if {SLOW_EACH, SLOW_OURS} <= rounds.keys():
        pairs = zip(rounds[SLOW_OURS], rounds[SLOW_EACH], strict=True)
        times = median(ours["votes_per_s"] / each["votes_per_s"] for ours, each in pairs)
        yield "times a commit each, slow disk", round(times, 2), 6, times >= 6
    if BESIDE in rounds:
        beside = middle(rounds[BESIDE])
        fetched, p99_ms = beside["video_MB_per_s"], beside["p99_ms"]
        yield "MB/s of video beside 300 votes/s", fetched, 100, fetched >= 100 and beside["votes_per_s"] >= 299
        yield "ms p99 of these votes", p99_ms, 50, p99_ms <= 50 and beside["errors"] == 0
    if BESIDE_WORK in rounds:
        beside = middle(rounds[BESIDE_WORK])
        p99_ms = beside["p99_ms"]
        yield "ms p99 of votes beside a reconstruction", p99_ms, 50, p99_ms <= 50 and beside["errors"] == 0


def middle(rows: Sequence[Row]) -> Row:
    """The median of each figure; of the errors, all."""
    return {what: sum(r[what] for r in rows) if what == "errors" else median(r[what] for r in rows) for what in rows[0]}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--votes", type=int, default=4000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD", help="the rows whose names hold these")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rounds: dict[str, list[Row]] = {}
    numbers = count()
    with PostgresServer() as postgres:
        for _ in range(arguments.rounds):
            for name, case in cases(arguments.votes, lambda: postgres.new_database(f"study{next(numbers)}")):
                if all(word in name for word in arguments.only):
                    rounds.setdefault(name, []).append(measured(case))
    rows = {name: middle(measurements) for name, measurements in rounds.items()}
    bars = [dict(zip(("what", "reached", "bar", "passed"), bar, strict=True)) for bar in verdicts(rounds)]
    if arguments.json:
        print(json.dumps({"rows": rows, "rounds": rounds, "bars": bars}, indent=2))
        return
    for name, row in rows.items():
        print(f"{name:30}", ", ".join(f"{value} {what}" for what, value in row.items()))
    for bar in bars:
        print("passed" if bar["passed"] else "MISSED", f"{bar['reached']} {bar['what']} (bar {bar['bar']})")


if __name__ == "__main__":
    main()
