"""A study of many people from the first page to the last: `python bench/whole_study.py --people 1000`.

Simulated participants take the introduction, 75 trials (5 datasets, 6 conditions) and the stages after them over HTTP,
on PostgreSQL and several server processes, while the dashboard's worker reconstructs recordings. They do not pause, so
the machine is as busy as it can be. Afterwards the database must hold as many votes as were sent, one of each trial.

    --workers 4      server processes
    --at-once 8      people who take the study at the same time, in processes of their own
    --no-job         nothing is reconstructed meanwhile
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))

import httpx
import numpy as np
from server import wait_for_port, wait_for_step
from sqlalchemy import func, select

from app.operations.jobs.kinds import job_kind
from app.operations.studies.manage import add_token
from app.settings import Settings
from app.simulation.participants import simulate
from app.store.database.engine import Database, open_database
from app.store.database.keys import utc_now
from app.store.database.migrate import upgrade
from app.store.database.tables import participant, session, vote
from app.store.participants.invitations import insert_invitation
from app.store.queue import enqueue, job_by_id
from recon.studio import SynthParameters, synthesise
from tests.postgresql import PostgresServer
from tests.seeded_studies import seed_study
from tests.study_server import free_port

ROOT = Path(__file__).parent.parent
DATASETS = [f"scene {number}" for number in range(1, 6)]
CONDITIONS = {"id_fa": -1.0, "id_fb": -0.6, "dr_fa": -0.2, "dr_fb": 0.2, "pm_fa": 0.6, "pm_fb": 1.0}
N_TRIALS = 75
FRAMES_OF_A_JOB, N_JOBS = 24, 20  # more than the people last

Timings = dict[str, list[float]]


def take_part(base_url: str, invitation: str, token: str, people: int, seed: int) -> tuple[int, Timings]:
    """Let people take the study one after another; the number of their votes, and milliseconds by request."""
    timings: Timings = {}
    send = httpx.Client.send

    def timed(client: httpx.Client, request: httpx.Request, **options: Any) -> httpx.Response:
        started = time.perf_counter()
        answer = send(client, request, **options)
        what = request.url.path.rsplit("/", 1)[-1] if "/trials" in request.url.path else "other"
        timings.setdefault(what, []).append(1000 * (time.perf_counter() - started))
        return answer

    httpx.Client.send = timed  # type: ignore[method-assign, assignment]
    result = simulate(base_url, "test", invitation, token, people, CONDITIONS, 0.2, seed)
    return int(result["votes"]), timings


@contextmanager
def server(settings: Settings, workers: int) -> Iterator[str]:
    """Serve by several processes and one worker for jobs, as `reconstudy serve` does."""
    port = free_port()
    command = [sys.executable, "-m", "app.cli", "serve", "--port", str(port), "--workers", str(workers)]
    environment = os.environ | settings.as_environment()
    process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)
    try:
        wait_for_port(port, process)
        yield f"http://127.0.0.1:{port}"
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


def queue_jobs(settings: Settings, database: Database) -> list[str]:
    """Record a scene into the intake folder and queue reconstructions of it, which run one after another."""
    recorded = SynthParameters(scene="ball", n_frames=FRAMES_OF_A_JOB, size=(960, 540))
    synthesise(settings.intake_dir / "captures" / "ball", recorded)
    asked = [
        job_kind("reconstruct").read({"capture": "ball", "name": f"ball-{number}"}, settings)
        for number in range(N_JOBS)
    ]
    with database.writing() as connection:
        return [enqueue(connection, job, "bench", utc_now()) for job in asked]


def measure(url: str, folder: Path, people: int, workers: int, at_once: int, *, with_job: bool) -> None:
    settings = Settings(data_dir=folder, database_url=url)
    database = open_database(url)
    upgrade(database)
    study_id = seed_study(database, DATASETS, list(CONDITIONS))
    with database.writing() as connection:
        invitation = insert_invitation(connection, study_id, None, utc_now())
    token = add_token(settings, "bench")["token"]
    jobs = queue_jobs(settings, database) if with_job else []
    with server(settings, workers) as base_url:
        if jobs:
            wait_for_step(database, jobs[0])
        share = [people // at_once + (number < people % at_once) for number in range(at_once)]
        started = time.perf_counter()
        with ProcessPoolExecutor(at_once, mp_context=get_context("spawn")) as pool:
            asked = [pool.submit(take_part, base_url, invitation, token, n, seed) for seed, n in enumerate(share) if n]
            parts = [future.result() for future in asked]
        seconds = time.perf_counter() - started
        print_counts(database, parts, seconds)
        if jobs:
            with database.reading() as connection:
                states = [job_by_id(connection, public_id).state for public_id in jobs]
            print("jobs:", ", ".join(f"{states.count(state)} {state}" for state in sorted(set(states))))
    database.dispose()


def print_counts(database: Database, parts: list[tuple[int, Timings]], seconds: float) -> None:
    with database.reading() as connection:
        n_people, n_votes = (connection.scalar(select(func.count()).select_from(t)) for t in (participant, vote))
        finished = select(func.count()).select_from(session).where(session.c.finished_at.is_not(None))
        n_finished = connection.scalar(finished)
        n_trials = connection.scalar(select(func.count(vote.c.trial_id.distinct())))
    sent = sum(n for n, _ in parts)
    print(f"{n_people} people, {n_finished} finished; {sent} votes sent, {n_votes} stored, of {n_trials} trials")
    print(f"{seconds:.0f} s, {sent / seconds:.0f} votes a second")
    if not sent == n_votes == n_trials == N_TRIALS * (n_people or 0):
        raise SystemExit("votes are lost or doubled")
    print_timings({what: [ms for _, timings in parts for ms in timings.get(what, [])] for what in ("next", "vote")})


def print_timings(timings: Mapping[str, list[float]]) -> None:
    for what, all_ms in timings.items():
        p50, p99, most = np.percentile(all_ms, [50, 99, 100]).tolist()
        print(f"{what:6} {len(all_ms)} requests, ms: median {p50:.1f}, 99 % {p99:.1f}, longest {most:.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=100)
    parser.add_argument("--workers", type=int, default=4)
    parser.add_argument("--at-once", type=int, default=8)
    parser.add_argument("--no-job", action="store_true")
    given = parser.parse_args()
    with PostgresServer() as postgres, tempfile.TemporaryDirectory() as name:
        url = postgres.new_database("study")
        measure(url, Path(name), given.people, given.workers, given.at_once, with_job=not given.no_job)


if __name__ == "__main__":
    main()
