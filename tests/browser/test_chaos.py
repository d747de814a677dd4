"""Nothing that a page has kept is lost or doubled while tabs, connections and the server die at random."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random

import pytest

from app.store.database.engine import open_database
from app.store.database.migrate import upgrade
from tests.browser.crashing_tabs import Seen, compare, vote_in_chaos
from tests.seeded_studies import seed_voters
from tests.study_server import StudyServer

pytestmark = [pytest.mark.browser, pytest.mark.slow]


def test_what_a_page_kept_is_stored_once_whatever_dies(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'study.sqlite'}"
    database = open_database(url)
    upgrade(database)
    voters = seed_voters(database, 3, 14)
    database.dispose()

    def run() -> Seen:
        with StudyServer(tmp_path) as server:
            return asyncio.run(vote_in_chaos(server, voters, Random(3)))

    with ThreadPoolExecutor(1) as pool:  # the other browser tests keep an event loop in this thread
        seen = pool.submit(run).result()
    assert compare(url, seen) == {"kept": 273, "stored": 273, "lost": 0, "doubled": 0, "wrong": 0}
    assert seen.happened["server killed"] > 0
