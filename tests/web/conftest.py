"""A real server on a free port with a study of tiny videos, and clients of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any
from uuid import uuid4

import clips
import httpx
import pytest

from app import operate
from app.main import running_server
from app.settings import Settings
from app.simulate import begin


@pytest.fixture(scope="session")
def stimulus_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return clips.write_set(tmp_path_factory.mktemp("set"), ("ball", "box"), clips.APPROACHES)


@pytest.fixture(scope="session")
def settings(tmp_path_factory: pytest.TempPathFactory, new_database_url: Callable[[], str]) -> Settings:
    settings = Settings(data_dir=tmp_path_factory.mktemp("server"), database_url=new_database_url())
    operate.upgrade_database(settings)
    return settings


@pytest.fixture(scope="session")
def new_study(settings: Settings, stimulus_set: Path) -> Callable[[], dict[str, Any]]:
    """Creates a study of six trials; the pair videos are there from the second time on."""
    numbers = count(1)
    return lambda: operate.create_study(settings, stimulus_set, f"Study {next(numbers)}", exposure_s=0.4, seed=1)


@pytest.fixture(scope="session")
def server(settings: Settings) -> Iterator[str]:
    with running_server(settings) as base_url:
        yield base_url


@pytest.fixture(scope="session")
def token(settings: Settings) -> str:
    return str(operate.add_token(settings, "tests")["token"])


@pytest.fixture(scope="session")
def study(new_study: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    return new_study()


@pytest.fixture
def client(server: str) -> Iterator[httpx.Client]:
    """A browser that has not been here."""
    with httpx.Client(base_url=server, timeout=30) as client:
        yield client


@pytest.fixture
def participant(client: httpx.Client, study: dict[str, Any]) -> httpx.Client:
    """A browser whose participant has read the introduction."""
    begin(client, study["slug"], study["invitation"])
    return client


@pytest.fixture
def analyst(server: str, token: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=server, timeout=60, headers={"Authorization": f"Bearer {token}"}) as client:
        yield client


@pytest.fixture
def vote_body() -> Callable[..., dict[str, Any]]:
    """A valid vote on a trial, with changes."""

    def make(trial: dict[str, Any], **changes: Any) -> dict[str, Any]:
        viewing = {"first_shown": trial["first_shown"], "shown_ms": 400.5, "response_ms": 900, "switches": []}
        return {"id": str(uuid4()), "choice": "a", "viewing": viewing} | changes

    return make
