"""Several processes share the work; one may die or be replaced and nobody notices."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random

import httpx
import pytest
from sqlalchemy import func, select

from app.main import serve
from app.operations.studies import manage
from app.settings import Settings
from app.store.database.engine import open_database
from app.store.database.tables import vote
from tests.app.web.admin.dashboard_client import signed_in
from tests.app.web.vote_senders import letters_of, send
from tests.postgresql import PostgresServer
from tests.processes import until_ended
from tests.seeded_studies import seeded_voters

ROOT = Path(__file__).parents[3]
SERVER = """
from uvicorn.supervisors import multiprocess
from app.main import serve
from app.settings import Settings

start = multiprocess.Process.start

def start_and_tell(worker):
    start(worker)
    print(worker.pid, flush=True)

multiprocess.Process.start = start_and_tell
serve(Settings(), port=0, workers=2, on_start=lambda base_url: print(base_url, flush=True))
"""
N_VOTERS, N_APPROACHES = 8, 6
N_VOTES = 15 * N_VOTERS
START_TIMEOUT_S = 60
N_PAGES = 6


@pytest.fixture
def url(postgres: PostgresServer, request: pytest.FixtureRequest) -> str:
    return postgres.new_database(request.node.name)


@contextmanager
def two_workers(url: str, folder: Path) -> Iterator[tuple[httpx.Client, subprocess.Popen[str]]]:
    """A client of two workers and their supervisor, whose log goes to `log` in the folder."""
    environment = os.environ | Settings(data_dir=folder, database_url=url, log_format="json").as_environment()
    command = [sys.executable, "-c", SERVER]
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=log, text=True)
        try:
            assert process.stdout is not None
            base_url = process.stdout.readline().strip()
            with httpx.Client(base_url=base_url, timeout=START_TIMEOUT_S) as client:
                yield client, process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
            process.communicate(timeout=START_TIMEOUT_S)


def started_workers(supervisor: subprocess.Popen[str]) -> list[int]:
    """Wait until the supervisor has started two workers more; their processes' numbers."""
    assert supervisor.stdout is not None
    return [int(supervisor.stdout.readline()) for _ in range(2)]


@pytest.mark.slow
def test_nobody_notices_that_workers_are_replaced_or_die(url: str, tmp_path: Path) -> None:
    voters, rng = seeded_voters(url, N_VOTERS, N_APPROACHES), Random(1)
    bundles = [letters_of(voter, rng) for voter in voters]
    with two_workers(url, tmp_path) as (client, supervisor):
        client.get("/readyz").raise_for_status()
        port = client.base_url.port
        assert port is not None
        first = started_workers(supervisor)
        with until_ended(*first), ThreadPoolExecutor() as pool:
            sending = pool.submit(send, port, bundles, repeat=0.2, rng=rng)
            os.kill(first[0], signal.SIGKILL)
            supervisor.send_signal(signal.SIGHUP)
            tally = sending.result()
            second = started_workers(supervisor)
            assert not set(second) & set(first)
        with until_ended(*second):
            supervisor.kill()  # nobody is left who holds the port
    assert tally.statuses.keys() <= {200, 201}
    assert len(tally.acknowledged) == N_VOTES
    database = open_database(url)
    with database.reading() as connection:
        assert connection.scalar(select(func.count()).select_from(vote)) == N_VOTES
    database.dispose()


@pytest.mark.slow
def test_counts_and_logs_of_all_workers_name_routes_and_no_secrets(url: str, tmp_path: Path) -> None:
    voters, rng = seeded_voters(url, N_VOTERS, N_APPROACHES), Random(1)
    bundles = [letters_of(voter, rng) for voter in voters]
    settings = Settings(data_dir=tmp_path, database_url=url)
    with two_workers(url, tmp_path) as (client, supervisor), ExitStack() as stack:
        port = client.base_url.port
        assert port is not None
        send(port, bundles)
        unknown = client.get("/s/invented-code", headers={"X-Request-ID": "abcdef123456"})
        assert (unknown.status_code, unknown.headers["x-request-id"]) == (404, "abcdef123456")
        metrics = client.get("/metrics").text
        dashboard = stack.enter_context(signed_in(str(client.base_url), settings, "ada"))
        live = f"/admin/studies/{manage.list_studies(settings)[0]['slug']}/live"
        pages = [stack.enter_context(dashboard.stream("GET", live)).iter_lines() for _ in range(N_PAGES)]
        assert [next(page) for page in pages] == ["event: monitor"] * N_PAGES
        supervisor.send_signal(signal.SIGTERM)
        for page in pages:
            assert not [line for line in page if line.startswith("event")]  # and ends as a whole answer does
        assert supervisor.wait(START_TIMEOUT_S) == 0
    text = (tmp_path / "log").read_text()
    route = "/api/v1/session/trials/{trial}/vote"
    line = f'reconstudy_requests_total{{method="PUT",route="{route}",status="201"}} {float(N_VOTES)}'
    assert line in metrics.splitlines()
    lines = [json.loads(line) for line in text.splitlines()]
    votes = [line for line in lines if line.get("route") == route]
    assert len(votes) == N_VOTES
    assert len({line["request_id"] for line in votes}) == len(votes)
    ended = [line for line in lines if "status" in line]
    assert [line["status"] for line in ended if line["request_id"] == "abcdef123456"] == [404]
    assert "invented-code" not in text + metrics
    assert not [voter for voter in voters if voter.token in text or voter.trials[0][0] in text]


def test_more_than_one_process_is_refused_on_sqlite(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--workers 2 needs PostgreSQL"):
        serve(Settings(data_dir=tmp_path), port=0, workers=2)
