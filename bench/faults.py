"""Whether acknowledged votes are kept while servers, databases and the power fail under load.

    python bench/faults.py [--votes 10000] [--kills 50] [--power-cuts 20] [--only WORDS] [--json]

Participants vote all at once; a quarter of the votes is sent again later, out of order. Meanwhile the server, or all of
PostgreSQL, is killed by SIGKILL at random moments; the disk is full; another program holds the database, or it is away
for a second; the clock jumps. For the power cuts SQLite's write-ahead log is cut back to its last sync
(tests/sqlite_disk.py). At the end of each other row everything is sent once more, and every answer must be the old one.
Prints how many votes were acknowledged, stored, lost, doubled (stored more than once) and wrong (as another choice).
"""

from __future__ import annotations

import argparse
import asyncio
import json
import resource
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import chain, count
from pathlib import Path
from random import Random
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

from sqlalchemy import select
from voters import voters_of

from app.store.database.engine import open_database
from app.store.database.tables import trial, vote
from tests import sqlite_disk
from tests.app.web.vote_senders import Letter, Tally, letters_of, send_all
from tests.postgresql import PostgresServer
from tests.study_server import StudyServer

N_VOTERS = 20
LONGEST_S = 900
AWAY_S = 1.0
RETRY_S = 0.02
JUMPING_CLOCK = ("--first", "bench.server_changes:jumping_clock")
FULL_BYTES = 60_000  # less than the log of a few votes

Rows = Iterator[tuple[str, Callable[[], dict[str, Any]]]]


def prepare(url: str, n_votes: int, rng: Random) -> list[list[Letter]]:
    """Make a database with voters and trials; returns the votes to send."""
    return [letters_of(voter, rng) for voter in voters_of(url, N_VOTERS, n_votes)]


def run_under(
    fault: Callable[[], None], n_faults: int, port: int, bundles: list[list[Letter]], rng: Random, repeat: float
) -> list[tuple[str, str, str]]:
    """Send everything while faults happen, each after a random number of votes; what was acknowledged."""
    tally, has_ended = Tally(), threading.Event()
    moments = sorted(rng.sample(range(sum(map(len, bundles))), n_faults))

    def disturb() -> None:
        for n_before in moments:
            while len(tally.acknowledged) < n_before and not has_ended.is_set():
                time.sleep(0.001)
            fault()

    with ThreadPoolExecutor() as pool:
        disturbance = pool.submit(disturb)
        try:
            again = partial(asyncio.sleep, RETRY_S)
            sending = send_all(port, bundles, again, repeat=repeat, rng=rng, timeout_s=LONGEST_S, tally=tally)
            asyncio.run(sending)
        finally:
            has_ended.set()
        disturbance.result()
    return tally.acknowledged


def compare(url: str, acknowledged: list[tuple[str, str, str]]) -> dict[str, int]:
    """What is stored beside what was acknowledged."""
    with open_database(url) as database, database.reading() as connection:
        rows = connection.execute(select(trial.c.public_id, vote.c.client_id, vote.c.choice).join(trial)).all()
    stored = Counter((row.public_id, row.client_id) for row in rows)
    choices = {row.client_id: row.choice for row in rows}
    return {
        "acknowledged": len(acknowledged),
        "stored": len(rows),
        "lost": sum(stored[(public_id, client_id)] == 0 for public_id, client_id, _ in acknowledged),
        "doubled": len(rows) - len({row.public_id for row in rows}),
        "wrong": sum(choices.get(client_id, choice) != choice for _, client_id, choice in acknowledged),
    }


Fault = Callable[[StudyServer], None]


def under(
    fault: Fault, n_faults: int, url: str, n_votes: int, rng: Random, *options: str, repeat: float = 0.25
) -> dict[str, Any]:
    """Faults under load; at last everything is sent once more, and every answer must be the old one."""
    bundles, started = prepare(url, n_votes, rng), time.perf_counter()
    with (
        tempfile.TemporaryDirectory() as folder,
        StudyServer(Path(folder), *options, database_url=url, log=subprocess.DEVNULL) as server,
    ):
        acknowledged = run_under(lambda: fault(server), n_faults, server.port, bundles, rng, repeat)
        again = asyncio.run(send_all(server.port, bundles, timeout_s=LONGEST_S))
    assert again.statuses.keys() == {200}, f"votes were taken twice: {again.statuses}"
    return {"faults": n_faults, **compare(url, acknowledged), "seconds": round(time.perf_counter() - started, 1)}


def fill_disk(server: StudyServer) -> None:
    """Let no file of the server grow for a moment: what it writes fails as on a full disk."""
    resource.prlimit(server.pid, resource.RLIMIT_FSIZE, (FULL_BYTES, resource.RLIM_INFINITY))
    time.sleep(0.5 * AWAY_S)
    resource.prlimit(server.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))


def hold_database(path: Path) -> None:
    """Be another program that writes to SQLite's file and is slow."""
    connection = sqlite3.connect(path, isolation_level=None, timeout=60)
    connection.execute("BEGIN IMMEDIATE")
    time.sleep(AWAY_S)
    connection.execute("ROLLBACK")
    connection.close()


def restart(postgres: PostgresServer, away_s: float) -> None:
    postgres.kill()
    time.sleep(away_s)
    postgres.start_again()


def power_cuts(n_cuts: int, votes_each: int, synchronous: str, rng: Random) -> dict[str, Any]:
    """Cut the power of SQLite at once after the last acknowledgement, again and again."""
    total: Counter[str] = Counter()
    for _ in range(n_cuts):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            url, safe = f"sqlite:///{folder / 'study.sqlite'}", folder / "safe"
            bundles = prepare(url, votes_each, rng)
            options = ("--safe", str(safe), "--synchronous", synchronous)
            with StudyServer(folder, *options, log=subprocess.DEVNULL) as server:
                tally = asyncio.run(send_all(server.port, bundles, rng=rng))
                server.kill_for_good()
            sqlite_disk.cut_power(folder / "study.sqlite", safe)
            total.update(compare(url, tally.acknowledged))
    return {"faults": n_cuts, **total}


def sqlite_rows(folder: Path, arguments: argparse.Namespace, rng: Random) -> Rows:
    """What each row is called, and what makes it."""
    n_votes, n_few = arguments.votes, max(arguments.kills // 5, 1)
    paths = (folder / f"{number}.sqlite" for number in count())

    def row(fault: Callable[[Path], Fault], n_faults: int, *options: str, **kept: Any) -> dict[str, Any]:
        path = next(paths)
        return under(fault(path), n_faults, f"sqlite:///{path}", n_votes, rng, *options, **kept)

    yield "SQLite, server killed", lambda: row(lambda _: StudyServer.kill, arguments.kills)
    yield "SQLite, disk full", lambda: row(lambda _: fill_disk, n_few)
    yield "SQLite, database held", lambda: row(lambda path: lambda _: hold_database(path), n_few)
    yield (
        "SQLite, clock jumps a day",
        lambda: row(lambda _: nothing, 0, *JUMPING_CLOCK),
    )
    yield "SQLite, all sent twice", lambda: row(lambda _: nothing, 0, repeat=1.0)
    if sqlite_disk.is_possible():
        yield "SQLite FULL, power cut", lambda: power_cuts(arguments.power_cuts, 500, "FULL", rng)
        yield "SQLite NORMAL, power cut", lambda: power_cuts(2, 500, "NORMAL", rng)


def postgresql_rows(arguments: argparse.Namespace, rng: Random) -> Rows:
    """As `sqlite_rows`, on a server that lives as long."""
    with PostgresServer() as postgres:
        yield from _rows_on(postgres, arguments, rng)


def _rows_on(postgres: PostgresServer, arguments: argparse.Namespace, rng: Random) -> Rows:
    n_votes, n_few, numbers = arguments.votes, max(arguments.kills // 5, 1), count()

    def row(fault: Fault, n_faults: int, *options: str, **kept: Any) -> dict[str, Any]:
        url = postgres.new_database(f"faults_{next(numbers)}")
        return under(fault, n_faults, url, n_votes, rng, *options, **kept)

    yield "PostgreSQL, server killed", lambda: row(StudyServer.kill, arguments.kills)
    yield "PostgreSQL killed", lambda: row(lambda _: restart(postgres, 0.0), arguments.kills)
    yield "PostgreSQL away for 1 s", lambda: row(lambda _: restart(postgres, AWAY_S), n_few)
    yield "PostgreSQL, clock jumps", lambda: row(nothing, 0, *JUMPING_CLOCK)
    yield "PostgreSQL, all sent twice", lambda: row(nothing, 0, repeat=1.0)


def nothing(_server: StudyServer) -> None:
    """The fault is in the clock or in the client."""


def measure(arguments: argparse.Namespace) -> Iterator[tuple[str, dict[str, Any]]]:
    rng = Random(7)
    with tempfile.TemporaryDirectory() as folder:
        rows = chain(sqlite_rows(Path(folder), arguments, rng), postgresql_rows(arguments, rng))
        for name, make in rows:
            if all(word in name for word in arguments.only):
                yield name, make()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--votes", type=int, default=10_000)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--power-cuts", type=int, default=20)
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD", help="the rows whose names hold these")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    results = {}
    for name, row in measure(arguments):
        results[name] = row
        if not arguments.json:
            print(f"{name:26}", ", ".join(f"{value} {what}" for what, value in row.items()), flush=True)
    if arguments.json:
        print(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
