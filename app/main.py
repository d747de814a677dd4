"""The study server, put together."""

from __future__ import annotations

import gc
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
from fastapi import FastAPI
from fastapi.staticfiles import StaticFiles
from fastapi.templating import Jinja2Templates
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from sse_starlette.sse import AppStatus
from starlette.concurrency import run_in_threadpool
from uvicorn.supervisors import Multiprocess

from app.files import packaged
from app.films.object_store import MediaStore
from app.operations.leftovers import remove_leftovers
from app.operations.manage import open_store
from app.settings import Settings
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
    server,
    sign_in,
    stimulus_sets,
    studies,
    users,
)
from app.web.admin import results_page as admin_results
from app.web.admin import votes_page as admin_votes
from app.web.admin.flags import Flags
from app.web.analyst import routes
from app.web.analyst.openapi import describe
from app.web.front import front_routes
from app.web.metrics import SHARED_FOLDER, Metrics
from app.web.participant import pages, screening, session, trials
from app.web.participant.votes import vote_route
from app.web.problems import UnforeseenErrors, install_problems
from app.web.request_log import Requests, start_logging
from app.web.security import BodyLimit, RenewedSession, SameOrigin, SecurityHeaders
from app.web.throttle import new_throttle

START_TIMEOUT_S = 30
GARBAGE_AFTER = 20_000  # objects more than before; after 700 of them, as Python does, it is a sixteenth of an answer
UVICORN_OPTIONS: dict[str, Any] = {
    "log_config": None,
    "log_level": "warning",
    "access_log": False,  # addresses hold invitations and sign-in links; app/web/request_log.py logs routes
    "server_header": False,
    "timeout_graceful_shutdown": 20,  # s for downloads; votes take milliseconds
    "timeout_keep_alive": 75,  # s, longer than proxies and clients keep a connection: else they would meet a closed one
}


def create_app(settings: Settings, front: Path | None = None) -> FastAPI:
    """The whole server on one database.

    Parameters
    ----------
    front : folder of the demo's front page; None: `/` is the participants' entrance
    """

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        await run_in_threadpool(remove_leftovers, settings, app.state.clock())
        with app.state.votes, app.state.flags:
            yield
        of_votes.dispose()
        app.state.database.dispose()

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
    app.state.database = open_store(settings)
    of_votes = app.state.database.with_own_connection()
    app.state.votes = VoteWriter(of_votes)
    app.state.flags = Flags(app.state.database)
    app.state.monitors = WeakValueDictionary()  # of the studies that somebody watches
    app.state.media_store = MediaStore(settings.media_url) if settings.media_url else None
    app.state.metrics = Metrics(lambda: app.state.votes.n_waiting)
    app.state.templates = Jinja2Templates(env=_environment())
    app.state.clock = utc_now
    app.state.throttle = new_throttle()
    app.state.jobs = []
    app.state.is_stopping = False  # what streams looks at it, and ends
    settings.media_dir.mkdir(parents=True, exist_ok=True)
    if front is not None:
        app.include_router(front_routes(front))  # before the entrance
    app.router.routes.append(vote_route)  # routes are tried in this order, and votes are what comes most
    for router in (
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
        admin_votes.router,
        design.router,
        invitations.router,
        admin_results.router,
        objective.router,
        models_page.router,
        attach.router,
        edit.router,
        pages.router,
    ):
        app.include_router(router)
    app.mount("/static", StaticFiles(directory=packaged("static")), name="static")
    install_problems(app)
    describe(app)
    is_https = settings.secure_cookies
    for middleware in (BodyLimit, SameOrigin, UnforeseenErrors):  # the last one is outermost
        app.add_middleware(middleware)
    app.add_middleware(RenewedSession, is_https=is_https)
    media_origin = app.state.media_store.origin if app.state.media_store else None
    app.add_middleware(SecurityHeaders, is_https=is_https, media_origin=media_origin)
    app.add_middleware(Requests, metrics=app.state.metrics)
    return app


def serve(
    settings: Settings,
    host: str = "127.0.0.1",
    port: int = 8000,
    *,
    workers: int = 1,
    on_start: Callable[[str], None] | None = None,
) -> None:
    """Serve until interrupted; what is asked before the end is answered, and votes that wait are kept.

    Parameters
    ----------
    port : 0 for any free one
    workers : processes that share the port; more than one on PostgreSQL only
    on_start : told the base address once it takes connections

    Raises
    ------
    ValueError
        If the database does not suit, or the number of workers does not suit the database.
    """
    start_logging(settings.log_format)
    if workers == 1:
        _Server(_app_to_stay(settings), host, port, on_start).run()
    else:
        _serve_by_workers(settings, host, port, workers, on_start)


def worker_app() -> FastAPI:
    """The server in one of several processes; its settings come by the environment."""
    settings = Settings()
    start_logging(settings.log_format)
    return _app_to_stay(settings)


def _app_to_stay(settings: Settings) -> FastAPI:
    """The app of a process that does nothing else."""
    app = create_app(settings)
    gc.freeze()  # looking for garbage among all that was loaded takes 70 ms each time, in which nobody is answered
    gc.set_threshold(GARBAGE_AFTER, *gc.get_threshold()[1:])
    return app


def _serve_by_workers(
    settings: Settings, host: str, port: int, workers: int, on_start: Callable[[str], None] | None
) -> None:
    """Workers that are started again when they die; SIGHUP replaces them one by one while the port stays open."""
    if settings.is_sqlite:
        raise ValueError(
            f"--workers {workers} needs PostgreSQL (RECONSTUDY_DATABASE_URL): only one process at a time can write to "
            "SQLite, and one that waits for another process waits long; see docs/operations.md"
        )
    open_store(settings).dispose()  # what is wrong with the database is said here, not once by every worker
    os.environ |= settings.as_environment()
    several: dict[str, Any] = {"factory": True, "workers": workers, "timeout_worker_healthcheck": START_TIMEOUT_S}
    config = uvicorn.Config("app.main:worker_app", host, port, **several, **UVICORN_OPTIONS)
    with tempfile.TemporaryDirectory(prefix="reconstudy-metrics-") as folder, config.bind_socket() as bound:
        os.environ[SHARED_FOLDER] = folder
        bound.listen(config.backlog)  # who comes before the first worker is up waits
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
    """uvicorn that tells when, and on which port, it answers."""

    def __init__(self, app: FastAPI, host: str, port: int, on_start: Callable[[str], None] | None) -> None:
        super().__init__(uvicorn.Config(app, host, port, **UVICORN_OPTIONS))
        self._on_start = on_start
        self._app = app

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        AppStatus.should_exit = False  # of the whole process: an earlier server's end would end this one's live pages
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
