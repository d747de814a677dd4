"""A process has few connections to its database: readers who hold them hinder neither votes nor each other."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import anyio
import httpx
import pytest

from app.main import create_app
from app.operations.studies import manage
from app.settings import Settings
from app.store.database.engine import open_database
from tests.seeded_studies import Voter, seed_voters

N_CONNECTIONS = 15  # of a process, besides the one of its votes


@pytest.fixture
def here(tmp_path: Path, new_database_url: Callable[[], str]) -> Settings:
    settings = Settings(data_dir=tmp_path, database_url=new_database_url())
    manage.upgrade_database(settings)
    return settings


@pytest.fixture
def voter(here: Settings) -> Voter:
    database = open_database(here.url)
    (voter,) = seed_voters(database, 1, 2)
    database.dispose()
    return voter


def ask_while_held(settings: Settings, n_held: int, method: str, path: str, **request: Any) -> httpx.Response:
    """One request to a server of which readers hold so many connections."""
    app = create_app(settings)

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app=app)
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(transport=transport, base_url="http://localhost") as client,
        ):
            with ExitStack() as readers:
                for _ in range(n_held):
                    readers.enter_context(app.state.database.reading())
                return await client.request(method, path, **request)

    with ThreadPoolExecutor(1) as pool:  # the browser tests leave an event loop in this one
        return pool.submit(anyio.run, ask).result()


def test_a_vote_is_kept_while_readers_hold_every_connection(
    here: Settings, voter: Voter, vote_body: Callable[..., dict[str, Any]]
) -> None:
    trial, first_shown = voter.trials[0]
    body = vote_body({"first_shown": first_shown})
    bearer = {"Authorization": f"Bearer {voter.token}"}
    path = f"/api/v1/session/trials/{trial}/vote"
    assert ask_while_held(here, N_CONNECTIONS, "PUT", path, json=body, headers=bearer).status_code == 201


@pytest.mark.slow
@pytest.mark.usefixtures("voter")
def test_the_list_of_studies_takes_one_connection_for_all(here: Settings) -> None:
    bearer = {"Authorization": f"Bearer {manage.add_token(here, 'tests')['token']}"}
    answer = ask_while_held(here, N_CONNECTIONS - 1, "GET", "/api/v1/studies", headers=bearer)
    assert [study["slug"] for study in answer.json()] == ["test"]
