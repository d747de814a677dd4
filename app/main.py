"""Put the study server together and run it."""

from __future__ import annotations

import os
import socket
import tempfile
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import uvicorn
from fastapi import Depends, FastAPI
from fastapi.staticfiles import StaticFiles
from fastapi.templating import Jinja2Templates
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from sse_starlette.sse import AppStatus
from starlette.concurrency import run_in_threadpool
from uvicorn.supervisors import Multiprocess

from app.files import packaged
from app.films.object_store import MediaStore
from app.operations.languages import read_languages
from app.operations.leftovers import remove_leftovers
from app.operations.manage import open_store
from app.settings import Settings
from app.store.engine import open_database
from app.store.keys import utc_now
from app.store.vote_writer import VoteWriter
from app.web import health, media
from app.web.admin import (
    attach,
    design,
    edit,
    interview,
    invitations,
    models_page,
    objective,
    overview,
    participants,
    results_page,
    server,
    sign_in,
    stimulus_sets,
    studies,
    texts,
    users,
    votes_page,
)
from app.web.admin.flags import Flags
from app.web.analyst import routes
from app.web.analyst.openapi import describe
from app.web.front import front_routes
from app.web.gates import check_request_text
from app.web.metrics import SHARED_FOLDER, Metrics
from app.web.participant import pages, screening, session, trials, votes
from app.web.problems import UnforeseenErrors, install_problems
from app.web.request_log import Requests, start_logging
from app.web.security import BodyLimit, RenewedSession, SameOrigin, SecurityHeaders
from app.web.throttle import new_throttle

START_TIMEOUT_S = 30
ROUTERS = (
    trials.router,
    session.router,
    screening.router,
    routes.router,
    media.router,
    health.router,
    sign_in.router,
    users.router,
    server.router,
    stimulus_sets.router,
    studies.router,  # before those of one study: "new" is no study
    overview.router,
    participants.router,
    interview.router,
    votes_page.router,
    design.router,
    invitations.router,
    results_page.router,
    objective.router,
    models_page.router,
    attach.router,
    edit.router,
    texts.router,
    pages.router,
)
UVICORN_OPTIONS: dict[str, Any] = {
    "log_config": None,
    "log_level": "warning",
    "access_log": False,  # addresses hold invitations and sign-in links; app/web/request_log.py logs routes
    "server_header": False,
    "timeout_graceful_shutdown": 20,  # s for downloads; votes take milliseconds
    "timeout_keep_alive": 75,  # s, longer than proxies and clients keep a connection: else they would meet a closed one
}


def create_app(settings: Settings, front: Path | None = None) -> FastAPI:
    """Make the whole server on one database.

    Parameters
    ----------
    front : folder of the demo's front page; None: `/` is the participants' entrance
    """
    database = open_store(settings)
    votes_database = open_database(settings.url)  # whose connections no reader can take

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        await run_in_threadpool(remove_leftovers, settings, app.state.clock())
        with app.state.votes, app.state.flags:
            yield
        votes_database.dispose()
        database.dispose()

    app = FastAPI(
        title="reconstudy",
        summary="Pair comparisons of 3D reconstructions: sessions, votes and scores",
        version="1",
        openapi_url="/api/v1/openapi.json",
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
        telemetry={"tracing": False, "metrics": False, "logs": False},  # it names addresses, which hold invitations
    )
    app.state.settings = settings
    app.state.languages = read_languages(settings)
    app.state.database = database
    app.state.votes = VoteWriter(votes_database)
    app.state.flags = Flags(database)
    app.state.monitors = WeakValueDictionary()  # by study, while somebody watches its live page
    app.state.media_store = MediaStore(settings.media_url) if settings.media_url else None
    app.state.metrics = Metrics(lambda: app.state.votes.n_waiting)
    app.state.templates = Jinja2Templates(env=_environment())
    app.state.clock = utc_now
    app.state.throttle = new_throttle()
    app.state.is_stopping = False  # live pages end when it is set
    settings.media_dir.mkdir(parents=True, exist_ok=True)
    if front is not None:
        app.include_router(front_routes(front))  # before the entrance, which has the same address
    app.include_router(votes.router)  # whose bodies hold no free text
    for router in ROUTERS:
        app.include_router(router, dependencies=[Depends(check_request_text)])
    app.mount("/static", StaticFiles(directory=packaged("static")), name="static")
    install_problems(app)
    describe(app)
    _add_middleware(app)
    return app


def _add_middleware(app: FastAPI) -> None:
    """Add what every request passes, the innermost first."""
    is_https = app.state.settings.secure_cookies
    media_origin = app.state.media_store.origin if app.state.media_store else None
    app.add_middleware(BodyLimit)
    app.add_middleware(SameOrigin)
    app.add_middleware(UnforeseenErrors)
    app.add_middleware(RenewedSession, is_https=is_https)
    app.add_middleware(SecurityHeaders, is_https=is_https, media_origin=media_origin)
    app.add_middleware(Requests, metrics=app.state.metrics)


def serve(
    settings: Settings,
    host: str = "127.0.0.1",
    port: int = 8000,
    *,
    workers: int = 1,
    on_start: Callable[[str], None] | None = None,
) -> None:
    """Serve until interrupted; requests at hand are answered and waiting votes are kept.

    Parameters
    ----------
    port : 0 for any free one
    workers : processes that share the port; more than one on PostgreSQL only
    on_start : called with the base address once the server takes connections

    Raises
    ------
    ValueError
        If the database cannot be used, or not by several workers.
    """
    start_logging(settings.log_format)
    if workers == 1:
        _Server(create_app(settings), host, port, on_start).run()
    else:
        _serve_by_workers(settings, host, port, workers, on_start)


def worker_app() -> FastAPI:
    """Make the server of one of several processes; its settings come by the environment."""
    settings = Settings()
    start_logging(settings.log_format)
    return create_app(settings)


def _serve_by_workers(
    settings: Settings, host: str, port: int, workers: int, on_start: Callable[[str], None] | None
) -> None:
    """Start workers again when they die; SIGHUP replaces them one by one while the port stays open."""
    if settings.is_sqlite:
        raise ValueError(
            f"--workers {workers} needs PostgreSQL (RECONSTUDY_DATABASE_URL): only one process at a time can write to "
            "SQLite, and one that waits for another process waits long; see docs/operations.md"
        )
    open_store(settings).dispose()  # a fault of the database is reported here, not once by every worker
    os.environ |= settings.as_environment()
    several: dict[str, Any] = {"factory": True, "workers": workers, "timeout_worker_healthcheck": START_TIMEOUT_S}
    config = uvicorn.Config("app.main:worker_app", host, port, **several, **UVICORN_OPTIONS)
    with tempfile.TemporaryDirectory(prefix="reconstudy-metrics-") as folder, config.bind_socket() as bound:
        os.environ[SHARED_FOLDER] = folder
        bound.listen(config.backlog)  # early requests wait for the first worker
        if on_start is not None:
            on_start(_address(bound))
        Multiprocess(config, sockets=[bound]).run()


@contextmanager
def running_server(
    settings: Settings, host: str = "127.0.0.1", port: int = 0, front: Path | None = None
) -> Iterator[str]:
    """Serve from a thread of this process while the block runs; yields the base address. `front` as in `create_app`."""
    started = threading.Event()
    address: list[str] = []

    def on_start(base_url: str) -> None:
        address.append(base_url)
        started.set()

    server = _Server(create_app(settings, front), host, port, on_start)
    thread = threading.Thread(target=server.run, name="reconstudy-server", daemon=True)
    thread.start()
    try:
        if not started.wait(START_TIMEOUT_S):
            raise RuntimeError(f"the server on {host}:{port} did not start within {START_TIMEOUT_S} s")
        yield address[0]
    finally:
        server.should_exit = True
        thread.join()


class _Server(uvicorn.Server):
    """A uvicorn that calls `on_start` with its address, and ends live pages when it stops."""

    def __init__(self, app: FastAPI, host: str, port: int, on_start: Callable[[str], None] | None) -> None:
        super().__init__(uvicorn.Config(app, host, port, **UVICORN_OPTIONS))
        self._on_start = on_start
        self._app = app

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        AppStatus.should_exit = False  # an earlier server of this process left it set, which would end live pages
        await super().startup(sockets)
        if self.started and self._on_start is not None:
            self._on_start(_address(self.servers[0].sockets[0]))

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._app.state.is_stopping = True
        await super().shutdown(sockets)


def _address(bound: Any) -> str:
    host, port = bound.getsockname()[:2]
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(packaged("templates")),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["has_browser_packages"] = (packaged("static") / "vendor" / "htmx.min.js").is_file()
    return environment
