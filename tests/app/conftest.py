"""A real server on a free port with a study of tiny videos, and clients of it.

Pages, routes and who takes studies by them are tested on SQLite alone: the statements lie in app/store, whose tests run
on both kinds of database. What reads the most tables, and what concerns connections and durability, runs on both, too.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any
from uuid import uuid4

import httpx
import pytest

from app.main import running_server
from app.operations.studies import create, manage
from app.settings import Settings
from app.simulation.participants import begin, simulate
from tests.app import tiny_stimuli
from tests.app.web.admin.dashboard_client import Dashboard, signed_in

HERE = Path(__file__).parent
ON_SQLITE = {"simulation", "web"}
ON_BOTH = {
    "web/admin/participants/test_participants.py",
    "web/analyst/test_archive.py",
    "web/analyst/test_results.py",
    "web/test_connections.py",
    "web/test_durability.py",
    "web/test_vote_path.py",
}
ABILITIES = {"id_fa": -1.0, "id_fb": 0.0, "pm_fb": 1.0}


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    again = {item for item in items if "[postgresql" in item.name and _is_on_sqlite(item.path)}
    config.hook.pytest_deselected(items=list(again))
    items[:] = [item for item in items if item not in again]


def _is_on_sqlite(path: Path) -> bool:
    if not path.is_relative_to(HERE):
        return False
    file = path.relative_to(HERE)
    return file.parts[0] in ON_SQLITE and file.as_posix() not in ON_BOTH


@pytest.fixture(scope="session")
def stimulus_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_stimuli.write_set(tmp_path_factory.mktemp("set"), ("ball", "box"), tiny_stimuli.APPROACHES)


@pytest.fixture(scope="session")
def settings(tmp_path_factory: pytest.TempPathFactory, new_database_url: Callable[[], str]) -> Settings:
    settings = Settings(data_dir=tmp_path_factory.mktemp("server"), database_url=new_database_url())
    manage.upgrade_database(settings)
    return settings


@pytest.fixture(scope="session")
def new_study(settings: Settings, stimulus_set: Path) -> Callable[[], dict[str, Any]]:
    """Creates a study of six trials; the pair videos are there from the second time on."""
    numbers = count(1)
    return lambda: create.create_study(settings, stimulus_set, f"Study {next(numbers)}", exposure_s=0.4, seed=1)


@pytest.fixture(scope="session")
def server(settings: Settings) -> Iterator[str]:
    with running_server(settings) as base_url:
        yield base_url


@pytest.fixture(scope="session")
def token(settings: Settings) -> str:
    return str(manage.add_token(settings, "tests")["token"])


@pytest.fixture(scope="session")
def study(new_study: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    return new_study()


@pytest.fixture(scope="session")
def taken(server: str, token: str, new_study: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """A study that four simulated participants have taken."""
    study = new_study()
    simulate(server, study["slug"], study["invitation"], token, 4, ABILITIES, 0.2, seed=4)
    return study


@pytest.fixture(scope="session")
def own(tmp_path_factory: pytest.TempPathFactory, stimulus_set: Path) -> Settings:
    """A server whose folder of stimulus sets holds one."""
    settings = Settings(data_dir=tmp_path_factory.mktemp("own"), largest_upload_mb=1)
    shutil.copytree(stimulus_set.parent, settings.sets_dir / "tiny")
    return settings


@pytest.fixture(scope="session")
def own_server(own: Settings) -> Iterator[str]:
    with running_server(own) as url:
        yield url


@pytest.fixture
def experimenter(server: str, settings: Settings) -> Iterator[Dashboard]:
    with signed_in(server, settings, "Eva Example", "experimenter") as dashboard:
        yield dashboard


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
