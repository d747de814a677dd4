"""The way of a vote is short enough to be read at a sitting."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import FrameType
from typing import Any

import anyio
import httpx
import pytest

from app.main import create_app
from app.operations.studies import manage
from app.settings import Settings
from app.store.database.engine import open_database
from tests.seeded_studies import Voter, seed_voters

pytestmark = pytest.mark.slow

MIDDLEWARE = {  # every request's
    "app.web.limits.hosts",
    "app.web.monitoring.metrics",
    "app.web.problems",
    "app.web.monitoring.request_log",
    "app.web.security",
}
PATH = {
    "app.web.gates",
    "app.web.participant.votes",
    "app.store.trials.vote_writer",
    "app.store.trials.vote_records",
    "app.store.database.keys",
    "app.store.database.engine",
    "app.study.trial.valid_vote",
    "app.study.trial.smoothness",
}


def test_a_vote_passes_eight_modules_on_its_way_to_disk(
    tmp_path: Path, new_database_url: Callable[[], str], vote_body: Callable[..., dict[str, Any]]
) -> None:
    settings = Settings(data_dir=tmp_path, database_url=new_database_url())
    manage.upgrade_database(settings)
    database = open_database(settings.url)
    (voter,) = seed_voters(database, 1, 3)
    database.dispose()
    assert modules_entered(settings, voter, vote_body) - MIDDLEWARE == PATH
    assert len(PATH) <= 8


def modules_entered(settings: Settings, voter: Voter, vote_body: Callable[..., dict[str, Any]]) -> set[str]:
    """Modules of ours whose functions run while a server answers a vote, in whatever thread."""
    entered: set[str] = set()
    is_watching = threading.Event()

    def note(frame: FrameType, event: str, _argument: object) -> None:
        name = frame.f_globals.get("__name__", "")
        if event == "call" and is_watching.is_set() and name.startswith("app."):
            entered.add(name)

    async def ask() -> None:
        app = create_app(settings)
        bearer = {"Authorization": f"Bearer {voter.token}"}
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(
                transport=httpx.ASGITransport(app=app), base_url="http://localhost", headers=bearer
            ) as client,
        ):
            for trial, first_shown in voter.trials[:2]:  # what is done once was done for the first
                body = vote_body({"first_shown": first_shown})
                answer = await client.put(f"/api/v1/session/trials/{trial}/vote", json=body)
                assert answer.status_code == 201
                is_watching.set()
            is_watching.clear()

    threading.setprofile(note)  # of threads that begin from now on: the writer's, and the event loop's
    try:
        with ThreadPoolExecutor(1) as pool:
            pool.submit(anyio.run, ask).result()
    finally:
        threading.setprofile(None)
    return entered
