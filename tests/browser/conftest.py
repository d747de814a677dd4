"""What browser tests share: the real server with a study of tiny films, Debian's Chromium, a page, and its visitor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path
from threading import Condition

import pytest
from playwright.sync_api import Browser, BrowserContext, Page

from app.errors import StudyError
from app.main import running_server
from app.operations.studies.create import create_study
from app.operations.studies.manage import add_token
from app.settings import Settings
from app.store.database.engine import Database
from app.store.trials import vote_writer
from app.store.trials.vote_records import KeptVote, Vote, keep_votes
from app.study.options.options import StudyOptions
from app.study.trial import smoothness
from tests.browser.numbered_films import squares, write_films
from tests.browser.study_visitor import MakeFilms, NewStudy, Study, Visitor
from tests.conftest import BROWSER_TIMEOUT_MS

BUSY_S = 60.0
VIEWPORT = {"width": 960, "height": 540}  # three times a film, so that it fills the window


@pytest.fixture(scope="session")
def films(tmp_path_factory: pytest.TempPathFactory) -> MakeFilms:
    return lambda fps, n_frames, draw: write_films(tmp_path_factory.mktemp("films"), fps, n_frames, draw)


@pytest.fixture(scope="session")
def settings(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return Settings(data_dir=tmp_path_factory.mktemp("server"))


@pytest.fixture(scope="session")
def votes_kept() -> Iterator[Condition]:
    """Notified whenever a server of this process has kept votes."""
    kept = Condition()

    def keep_and_tell(database: Database, votes: Sequence[Vote]) -> list[KeptVote | StudyError]:
        outcomes = keep_votes(database, votes)
        with kept:
            kept.notify_all()
        return outcomes

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(vote_writer, "keep_votes", keep_and_tell)
        yield kept


@pytest.fixture(scope="session")
def server(settings: Settings) -> Iterator[str]:
    with running_server(settings) as url:
        yield url


@pytest.fixture(autouse=True)
def patient_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let looks stand any gap: pages of a busy machine are often late, which but some tests are about."""
    monkeypatch.setattr(smoothness, "LONGEST_GAP_S", BUSY_S)


@pytest.fixture(scope="session")
def short_films(films: MakeFilms) -> Path:
    return films(25.0, 20, squares)


@pytest.fixture(scope="session")
def new_study(settings: Settings, server: str, votes_kept: Condition) -> NewStudy:
    """Creates studies of three trials; most visitors do not look at both sides."""
    numbers = count(1)
    token = add_token(settings, "browser tests")["token"]

    def create(
        folder: Path, exposure_s: float, options: StudyOptions | None = None, *, see_both: bool = False
    ) -> Study:
        name = f"Study {next(numbers)}"
        chosen = (options or StudyOptions()).but(see_both=see_both)
        made = create_study(settings, folder, name, exposure_s=exposure_s, seed=1, options=chosen)
        return Study(server, made["slug"], made["invitation"], token, votes_kept)

    return create


@pytest.fixture
def study(new_study: NewStudy, short_films: Path) -> Study:
    """Films of 0.8 s, shown for 1.6 s: they begin a second time."""
    return new_study(short_films, 1.6)


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    context = browser.new_context(viewport=VIEWPORT)
    context.set_default_timeout(BROWSER_TIMEOUT_MS)
    yield context
    context.close()


@pytest.fixture
def page(context: BrowserContext) -> Iterator[Page]:
    """A page on which no script may fail and no policy may be violated."""
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda message: "Security Policy" in message.text and errors.append(message.text))
    yield page
    assert errors == []


@pytest.fixture
def visitor(page: Page) -> Visitor:
    return Visitor(page)
