"""Whether people who take a whole study lose anything while everything around them is killed.

    python bench/sessions.py [--kills 60] [--only WORDS] [--json]

Artificial people begin, agree, take the eye tests, vote and answer the questionnaire over HTTP, several at once. At
random moments, every few seconds, one of these happens: the server, a worker of it, the worker of jobs or all of
PostgreSQL is killed by SIGKILL; the server's clock jumps a day forward or back (the study has a time limit of an hour);
the next server finds the disk read-only (a tmpfs, where mounts are allowed). Jobs make stimulus sets meanwhile. Prints
what was acknowledged and what is stored.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import cycle
from pathlib import Path
from random import Random
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

import httpx
from attacks import processes_below
from faults import restart
from server_changes import CLOCK

from app.operations.jobs.kinds import job_kind
from app.operations.studies import create, manage
from app.settings import Settings
from app.store.database.engine import open_database
from app.store.database.keys import utc_now
from app.store.queue import enqueue, list_jobs
from app.study.options.options import parse_options
from tests.app import tiny_stimuli
from tests.app.web.patient_people import Tally, compare, people_under, take_part
from tests.postgresql import PostgresServer
from tests.processes import kill
from tests.study_server import StudyServer

os.environ |= {"RECONSTUDY_SESSIONS_PER_MINUTE": "100000", "RECONSTUDY_CHECK_BROWSER": "none"}
OPTIONS = {"screening": {"tests": ["acuity", "colour"]}, "limits": {"minutes": 60}}
DAY_S = 86_400
CLOCK_OF_A_FILE = ["--first", "bench.server_changes:clock_of_a_file"]
N_JOBS = 3
READ_ONLY_S = 1.0
DISK_IS_FREE_WITHIN_S = 30.0
PAUSE_S = (0.2, 2.0)  # from the start of a server to the next fault
AT_ONCE = 4
JOBS_END_WITHIN_S = 300.0
ANSWERS_WITHIN_S = 180.0

Fault = Callable[[], None]


@contextmanager
def mounted(folder: Path) -> Iterator[bool]:
    """Have a disk of its own at a folder while the block runs; whether that may be done here."""
    may = (
        subprocess.run(["mount", "-t", "tmpfs", "tmpfs", str(folder)], capture_output=True, check=False).returncode == 0
    )
    try:
        yield may
    finally:
        if may:
            subprocess.run(["umount", "-l", str(folder)], check=True)


def start_on_read_only(server: StudyServer, folder: Path) -> None:
    """Kill the server, and let the next ones find the disk read-only for a moment, as after a bad block."""
    with server.killed():
        ends_s = time.monotonic() + DISK_IS_FREE_WITHIN_S  # what the dead server had started ends with it
        while subprocess.run(["mount", "-o", "remount,ro", str(folder)], capture_output=True, check=False).returncode:
            assert time.monotonic() < ends_s, f"{folder} is in use"
            time.sleep(0.05)
        back = threading.Timer(
            READ_ONLY_S, subprocess.run, [["mount", "-o", "remount,rw", str(folder)]], {"check": True}
        )
        back.start()
    back.join()


def jump(clock: Path, rng: Random) -> None:
    """Set the server's clock a day ahead, right, or a day back."""
    clock.write_text(f"{rng.choice((-DAY_S, 0, DAY_S))}")


def kill_one(pid: int, words: str) -> None:
    """Kill one of a process's children whose command line holds these words, if there is one."""
    for child in sorted(processes_below(pid)):
        with suppress(OSError):
            if words in Path(f"/proc/{child}/cmdline").read_bytes().replace(b"\0", b" ").decode():
                kill(child)
                return


def new_study(settings: Settings, folder: Path) -> dict[str, Any]:
    manage.upgrade_database(settings)
    stimuli = tiny_stimuli.write_set(folder / "set", ("ball", "box"), tiny_stimuli.APPROACHES)
    return create.create_study(settings, stimuli, "Killed", exposure_s=0.4, seed=1, options=parse_options(OPTIONS))


def queue_jobs(settings: Settings) -> None:
    """Queue imports of folders of films."""
    for number in range(N_JOBS):
        films = settings.intake_dir / "films" / f"films-{number}" / "ball"
        for approach in tiny_stimuli.APPROACHES:
            tiny_stimuli.encode(films / f"{approach}.mp4", tiny_stimuli.flat("gray"))
        new = job_kind("import-films").read({"films": f"films-{number}"}, settings)
        with open_database(settings.url) as database, database.writing() as connection:
            enqueue(connection, new, "bench", utc_now())


def jobs_done(settings: Settings) -> dict[str, int]:
    """Wait until no job waits or runs; how many are done, and how many sets there are."""
    ends_s = time.monotonic() + JOBS_END_WITHIN_S
    with open_database(settings.url) as database:
        while True:
            with database.reading() as connection:
                states = Counter(job.state for job in list_jobs(connection))
            if not {"queued", "running"} & states.keys() or time.monotonic() > ends_s:
                return {
                    "jobs": N_JOBS,
                    "jobs_not_done": N_JOBS - states["done"],
                    "sets": len(list(settings.sets_dir.iterdir())),
                }
            time.sleep(0.5)


def wait_for_answer(base_url: str) -> None:
    """Wait until a server answers: its workers begin after it has said that it is there."""
    ends_s = time.monotonic() + ANSWERS_WITHIN_S
    while True:
        with suppress(httpx.TransportError):
            if httpx.get(f"{base_url}/readyz").status_code == httpx.codes.OK:
                return
        assert time.monotonic() < ends_s, "no server answers"
        time.sleep(0.1)


def under(names: tuple[str, ...], arguments: argparse.Namespace, postgres: PostgresServer | None) -> dict[str, Any]:
    """Let people take a study while these faults happen."""
    rng, tally, happened = Random(arguments.seed), Tally(), Counter[str]()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        data = folder / "data"
        data.mkdir()
        has_disk = stack.enter_context(mounted(data)) if "read-only" in names else False
        url = postgres.new_database("sessions" + "".join(names).replace(" ", "")) if postgres else ""
        settings = Settings(data_dir=data, database_url=url or None)
        study = new_study(settings, folder)
        queue_jobs(settings)
        clock = folder / "clock"
        clock.write_text("0")
        os.environ[CLOCK] = str(clock)
        options = ["--again", "--jobs", "1", *(["--workers", "2"] if "worker" in names else CLOCK_OF_A_FILE)]
        log = stack.enter_context(arguments.log.open("a")) if arguments.log else subprocess.DEVNULL
        server = stack.enter_context(StudyServer(data, *options, database_url=settings.url, log=log))
        faults: dict[str, Fault] = {
            "server": server.kill,
            "worker": lambda: kill_one(server.pid, "multiprocessing.spawn"),
            "job worker": lambda: kill_one(server.pid, "beside_server"),
            **({"postgresql": partial(restart, postgres, 0.0)} if postgres else {}),
            "clock": partial(jump, clock, rng),
            **({"read-only": partial(start_on_read_only, server, data)} if has_disk else {}),
        }
        possible = [name for name in names if name in faults]
        order = cycle(possible)

        def fault() -> None:
            name = next(order)
            faults[name]()
            happened[name] += 1
            wait_for_answer(server.base_url)

        def take(number: int) -> None:
            take_part(server.base_url, study["slug"], study["invitation"], number, tally)

        began_s = time.monotonic()
        n_people = people_under(fault, arguments.kills, lambda: rng.uniform(*PAUSE_S), take, at_once=AT_ONCE)
        clock.write_text("0")
        found = compare(settings.url, tally, n_people) | jobs_done(settings)
        seconds = round(time.monotonic() - began_s)
    left_out = sorted(set(names) - set(possible))
    return {
        **dict(happened),
        **found,
        "broken": tally.n_broken,
        "not_now": sum(tally.statuses[status] for status in (502, 503)),
        "seconds": seconds,
        **({"left_out": left_out} if left_out else {}),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=60, help="and other faults, in each row")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD", help="the rows whose names hold these")
    parser.add_argument("--log", type=Path, help="file for what servers say")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = {
        "SQLite, killed": ("server", "job worker"),
        "SQLite, clock": ("server", "clock"),
        "SQLite, read-only": ("server", "read-only"),
        "PostgreSQL, killed": ("server", "worker", "job worker", "postgresql"),
        "PostgreSQL, clock": ("postgresql", "clock"),
    }
    results = {}
    with PostgresServer() as postgres:
        for name, names in rows.items():
            if all(word in name for word in arguments.only):
                results[name] = under(names, arguments, postgres if name.startswith("P") else None)
                if not arguments.json:
                    told = ", ".join(f"{value} {what}" for what, value in results[name].items())
                    print(f"{name:20}", told, flush=True)
    if arguments.json:
        print(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
