"""An acknowledged vote outlives whatever happens to the server, its database and its disk."""

from __future__ import annotations

import asyncio
import resource
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from random import Random

import pytest
from sqlalchemy import select

from app.operations.studies import create, manage
from app.settings import Settings
from app.store.database.engine import Database, open_database
from app.store.database.tables import trial, vote
from tests import sqlite_disk
from tests.app.web import patient_people
from tests.app.web.vote_senders import Tally, letters_of, send
from tests.postgresql import PostgresServer
from tests.seeded_studies import Voter, seeded_voters
from tests.study_server import StudyServer

N_VOTERS, N_APPROACHES = 8, 7  # 21 pairs each


def stored(database: Database) -> list[tuple[str, str, str]]:
    with database.reading() as connection:
        rows = connection.execute(select(trial.c.public_id, vote.c.client_id, vote.c.choice).join(trial))
        return [tuple(row) for row in rows]


def votes_under(fault: Callable[[Tally], None], server: StudyServer, voters: list[Voter], n_faults: int) -> Tally:
    """Send all votes, some of them twice, while faults happen in another thread, at equal distances."""
    rng, tally, calm = Random(1), Tally(), threading.Event()
    bundles = [letters_of(voter, rng) for voter in voters]
    n_votes = sum(map(len, bundles))
    calm.set()

    def disturb() -> None:
        for n_before in range(n_votes // (n_faults + 1), n_votes, n_votes // (n_faults + 1))[:n_faults]:
            tally.wait_until(partial(has_acknowledged, tally, n_before))
            calm.clear()
            fault(tally)
            calm.set()

    with ThreadPoolExecutor() as pool:
        disturbance = pool.submit(disturb)
        send(server.port, bundles, lambda: asyncio.to_thread(calm.wait), repeat=0.3, rng=rng, tally=tally)
        disturbance.result()
    return tally


def has_acknowledged(tally: Tally, n_votes: int) -> bool:
    return len(tally.acknowledged) >= n_votes


@pytest.mark.slow
def test_votes_survive_kills_of_the_server(new_database_url: Callable[[], str], tmp_path: Path) -> None:
    url = new_database_url()
    voters = seeded_voters(url, N_VOTERS, N_APPROACHES)
    with StudyServer(tmp_path, database_url=url) as server:
        tally = votes_under(lambda _tally: server.kill(), server, voters, 3)
    database = open_database(url)
    assert sorted(stored(database)) == sorted(tally.acknowledged)
    assert len(tally.acknowledged) == 21 * N_VOTERS
    assert tally.n_broken > 0
    database.dispose()


@pytest.mark.slow
def test_whole_sessions_survive_kills_of_the_server(
    new_database_url: Callable[[], str], stimulus_set: Path, tmp_path: Path
) -> None:
    settings = Settings(data_dir=tmp_path, database_url=new_database_url())
    manage.upgrade_database(settings)
    study = create.create_study(settings, stimulus_set, "Killed", exposure_s=0.4, seed=1)
    tally = patient_people.Tally()

    def kill_after_more_votes() -> None:
        n_before = len(tally.acknowledged)
        while len(tally.acknowledged) < n_before + 4:
            time.sleep(0.01)
        server.kill()

    with StudyServer(tmp_path, database_url=settings.url) as server:
        take = partial(patient_people.take_part, server.base_url, study["slug"], study["invitation"], tally=tally)
        n_people = patient_people.people_under(kill_after_more_votes, 3, lambda: 0.0, take, at_once=2)
    found = patient_people.compare(settings.url, tally, n_people)
    assert found.pop("people") == n_people >= 2
    assert found.pop("acknowledged") == found.pop("stored") == 6 * n_people
    assert set(found.values()) == {0}, found
    assert tally.n_broken > 0


@pytest.fixture
def own_postgres() -> Iterator[PostgresServer]:
    with PostgresServer() as server:
        yield server


@pytest.mark.slow
def test_votes_survive_kills_of_postgresql(own_postgres: PostgresServer, tmp_path: Path) -> None:
    url = own_postgres.new_database("killed")
    voters = seeded_voters(url, N_VOTERS, N_APPROACHES)

    def crash(_tally: Tally) -> None:
        own_postgres.kill()
        own_postgres.start_again()

    with StudyServer(tmp_path, database_url=url) as server:
        tally = votes_under(crash, server, voters, 2)
    database = open_database(url)
    assert sorted(stored(database)) == sorted(tally.acknowledged)
    assert len(tally.acknowledged) == 21 * N_VOTERS
    assert tally.statuses.get(503, 0) > 0
    assert tally.statuses.keys() <= {200, 201, 503}
    database.dispose()


@pytest.mark.slow
def test_votes_wait_in_the_browser_while_the_disk_is_full(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'study.sqlite'}"
    voters = seeded_voters(url, N_VOTERS, N_APPROACHES)

    def fill_and_clear(tally: Tally) -> None:
        """No file may grow beyond 60 kB, what the log of a few votes holds, until that was noticed."""
        n_before = tally.statuses.get(503, 0)
        resource.prlimit(server.pid, resource.RLIMIT_FSIZE, (60_000, resource.RLIM_INFINITY))
        tally.wait_until(lambda: tally.statuses.get(503, 0) > n_before)
        resource.prlimit(server.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))

    with StudyServer(tmp_path) as server:
        tally = votes_under(fill_and_clear, server, voters, 2)
    database = open_database(url)
    assert sorted(stored(database)) == sorted(tally.acknowledged)
    assert len(tally.acknowledged) == 21 * N_VOTERS
    assert tally.statuses.get(503, 0) > 0
    assert tally.statuses.keys() <= {200, 201, 503}
    database.dispose()


@pytest.mark.slow
def test_votes_wait_in_the_browser_while_the_server_can_open_no_file(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'study.sqlite'}"
    voters = seeded_voters(url, N_VOTERS, N_APPROACHES)

    def let_none_be_opened(tally: Tally) -> None:
        n_before = tally.statuses.get(503, 0)
        most = resource.prlimit(server.pid, resource.RLIMIT_NOFILE)
        resource.prlimit(server.pid, resource.RLIMIT_NOFILE, (3, most[1]))
        try:
            tally.wait_until(lambda: tally.statuses.get(503, 0) > n_before)
        finally:
            resource.prlimit(server.pid, resource.RLIMIT_NOFILE, most)

    with StudyServer(tmp_path) as server:
        tally = votes_under(let_none_be_opened, server, voters, 2)
    database = open_database(url)
    assert sorted(stored(database)) == sorted(tally.acknowledged)
    assert len(tally.acknowledged) == 21 * N_VOTERS
    assert tally.statuses.keys() <= {200, 201, 503}
    database.dispose()


def lost_to_a_power_cut(folder: Path, *options: str) -> tuple[int, int]:
    """How many votes were acknowledged before the power went, and how many of them are gone."""
    folder.mkdir()
    path, safe = folder / "study.sqlite", folder / "safe"
    voters = seeded_voters(f"sqlite:///{path}", N_VOTERS, N_APPROACHES)
    rng = Random(1)
    bundles = [letters_of(voter, rng) for voter in voters]
    with StudyServer(folder, "--safe", str(safe), *options) as server:
        tally = send(server.port, bundles)
        server.kill_for_good()
    sqlite_disk.cut_power(path, safe)
    database = open_database(f"sqlite:///{path}")
    kept = set(stored(database))
    database.dispose()
    return len(tally.acknowledged), len(set(tally.acknowledged) - kept)


@pytest.mark.slow
@pytest.mark.skipif(not sqlite_disk.is_possible(), reason="Python's SQLite is not a shared library: no shim goes in")
def test_a_power_cut_takes_no_acknowledged_vote_but_would_if_the_disk_were_not_waited_for(tmp_path: Path) -> None:
    assert lost_to_a_power_cut(tmp_path / "full") == (21 * N_VOTERS, 0)
    acknowledged, lost = lost_to_a_power_cut(tmp_path / "normal", "--synchronous", "NORMAL")
    assert acknowledged == 21 * N_VOTERS
    assert lost > 0
