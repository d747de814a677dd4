"""What all tests share: where the real recordings lie, one browser, and databases of both kinds."""

from __future__ import annotations

import gc
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from functools import cache
from itertools import count
from pathlib import Path

import httpx
import pytest
from hypothesis import settings
from playwright.sync_api import Browser, expect, sync_playwright
from sqlalchemy import make_url

import app.films.pairs
import app.intake.stimuli
import app.operations.database
import app.operations.studies.manage
from app.films.strips import make_film
from app.store.database.engine import Database, open_database
from app.store.database.migrate import upgrade
from tests.command_line import Command, command_line
from tests.encoded_films import decoded_once, made_once
from tests.migrated_databases import copied_where_new
from tests.postgresql import PostgresServer, empty

# How long an example takes is the machine's business.
settings.register_profile("no deadline", deadline=None, max_examples=50)
settings.register_profile("quick", deadline=None, max_examples=20)
settings.load_profile("no deadline")

ROOT = Path(__file__).parent.parent
os.environ.setdefault("RECONSTUDY_CHECK_BROWSER", "none")  # each study's films would be played before its test
NUMBERS = count(1)
QUICK = "not slow and not browser"
WITHOUT_QUICK = re.compile(r"^pytestmark = .*pytest\.mark\.(slow|browser)\b", re.MULTILINE)
BROWSER_TIMEOUT_MS = 60_000
# Each window would draw pages of the browser's own besides, which takes more than ours.
BROWSER_OPTIONS = ("--no-sandbox", "--disable-gpu", "--disable-features=WebUIOmniboxPopup,WebUIOmniboxAimPopup")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real recordings, which are never part of the project; absent, the test is skipped."""
    folder = Path(os.environ.get("RECONSTUDY_REAL_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder}; set RECONSTUDY_REAL_DATA to a folder that has them")
    return folder


@pytest.fixture(scope="session", autouse=True)
def no_certificates(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Spare every HTTP client the 20 ms of reading certificates: no test speaks TLS."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("SSL_CERT_FILE", raising=False)
        patch.setenv("SSL_CERT_DIR", str(tmp_path_factory.mktemp("no_certificates")))
        yield


@pytest.fixture(scope="session", autouse=True)
def patient_clients() -> Iterator[None]:
    """Give a server as long for an answer as a page has in a browser: how fast it is here is the machine's business."""
    with pytest.MonkeyPatch.context() as patch:
        for part in ("connect", "read", "write"):
            patch.setattr(httpx._config.DEFAULT_TIMEOUT_CONFIG, part, BROWSER_TIMEOUT_MS / 1000)
        yield


@pytest.fixture(scope="session", autouse=True)
def films_encoded_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Spare each further study of the same tiny videos four runs of ffmpeg a film; workers share what they made."""
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(app.films.pairs, "make_film", made_once(make_film, folder / "encoded_films"))
        patch.setattr(app.intake.stimuli, "decode", decoded_once())
        yield


@pytest.fixture(scope="session", autouse=True)
def databases_migrated_once(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Spare each server's new SQLite file all migrations, which the tests of migrations go through."""
    upgrade_or_copy = copied_where_new(tmp_path_factory.mktemp("migrated") / "template.sqlite")
    with pytest.MonkeyPatch.context() as patch:
        for module in (app.operations.database, app.operations.studies.manage):
            patch.setattr(module, "upgrade", upgrade_or_copy)
        yield


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Command:
    """`reconstudy ARGUMENTS…` with its database in a folder of its own."""
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(tmp_path / "study"))
    return command_line(monkeypatch, capsys)


@cache
def browser_path() -> str:
    """Find a Chromium that runs, as a stub of Ubuntu's snap does not in containers; absent, the test is skipped."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        path = shutil.which(name)
        if path and subprocess.run([path, "--version"], capture_output=True, check=False).returncode == 0:
            return path
    pytest.skip("no Chromium runs here; `make setup` installs it, or says what to do")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """A Chromium; one for all tests, because its event loop stays in this thread until the end."""
    expect.set_options(timeout=BROWSER_TIMEOUT_MS)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path(), args=BROWSER_OPTIONS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def postgres() -> Iterator[PostgresServer]:
    with PostgresServer() as server:
        yield server


@pytest.fixture(scope="session", params=["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)])
def new_database_url(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Callable[[], str]:
    """Gives URLs of empty databases; whatever asks for it is tested on SQLite and on PostgreSQL."""
    if request.param == "sqlite":
        folder = tmp_path_factory.mktemp("databases")
        return lambda: f"sqlite:///{folder / f'{next(NUMBERS)}.sqlite'}"
    server: PostgresServer = request.getfixturevalue("postgres")
    return lambda: server.new_database(f"test_{next(NUMBERS)}")


@pytest.fixture(scope="session")
def new_migrated_url(request: pytest.FixtureRequest, new_database_url: Callable[[], str]) -> Callable[[], str]:
    """Gives URLs of databases with all tables and no rows: copies of one, as migrating each takes longer."""
    template = make_url(new_database_url())
    database = open_database(template.render_as_string(hide_password=False))
    upgrade(database)
    database.dispose()
    if template.get_backend_name() == "sqlite":
        return lambda: f"sqlite:///{shutil.copy(str(template.database), f'{template.database}-{next(NUMBERS)}')}"
    server: PostgresServer = request.getfixturevalue("postgres")
    return lambda: server.new_database(f"test_{next(NUMBERS)}", template=str(template.database))


@pytest.fixture(scope="session")
def emptied(new_migrated_url: Callable[[], str]) -> list[str]:  # noqa: ARG001  # a list for each kind of database
    """URLs of databases that tests have left; PostgreSQL takes longer to create one than to empty it."""
    return []


@pytest.fixture
def database(new_migrated_url: Callable[[], str], emptied: list[str]) -> Iterator[Database]:
    """A database with all tables and no rows."""
    url = emptied.pop() if emptied else new_migrated_url()
    with open_database(url) as database:
        yield database
    if url.startswith("postgresql") and empty(url):
        emptied.append(url)


def pytest_configure(config: pytest.Config) -> None:
    if config.option.markexpr == QUICK:
        settings.load_profile("quick")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Spare quick runs what files without a quick test would import."""
    is_file = collection_path.suffix == ".py" and config.option.markexpr == QUICK
    return True if is_file and WITHOUT_QUICK.search(collection_path.read_text(encoding="utf-8")) else None


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Spread the files that wait for a browser evenly between those that compute, where processes share the cores."""
    if not hasattr(config, "workerinput"):
        return
    files: dict[Path, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    waits = {path: any(item.get_closest_marker("browser") for item in found) for path, found in files.items()}
    places: dict[Path, float] = {}
    for kind in (True, False):
        paths = [path for path in files if waits[path] is kind]
        places |= {path: (number + 0.5) / len(paths) for number, path in enumerate(paths)}
    items[:] = [item for path in sorted(files, key=places.__getitem__) for item in files[path]]


def pytest_collection_finish() -> None:
    """Keep what was imported and collected out of every later search for unused objects."""
    gc.collect()
    gc.freeze()
