"""Put the study server together and run it."""

from __future__ import annotations

import errno
import os
import socket
import tempfile
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any
from weakref import WeakValueDictionary

import anyio
import uvicorn
from fastapi import Depends, FastAPI
from fastapi.staticfiles import StaticFiles
from fastapi.templating import Jinja2Templates
from jinja2 import Environment
from sse_starlette.sse import AppStatus
from starlette.concurrency import run_in_threadpool
from uvicorn.supervisors import Multiprocess

from app.errors import StudyError
from app.files import packaged, page_templates, private_folder
from app.films.object_store import MediaStore
from app.intake.bounds import end_with_parent
from app.operations.database import open_store
from app.operations.jobs.beside_server import worker_beside
from app.operations.jobs.chains import STUDY_OF_SET
from app.operations.running import alone
from app.operations.studies.creation import CREATION, create_of_set, go_on_creating
from app.operations.studies.languages import read_languages
from app.operations.tasks import resume_tasks
from app.operations.upkeep.housekeeping import EVERY_S, Housekeeper
from app.settings import Settings
from app.store.database.engine import Database, open_database
from app.store.database.keys import utc_now
from app.store.trials.vote_writer import VoteWriter
from app.web.admin.flags import Flags
from app.web.analyst.openapi import describe
from app.web.gates import check_request_text
from app.web.limits.connections import GuardedProtocol, open_files
from app.web.limits.hosts import KnownHosts
from app.web.limits.throttle import Throttle
from app.web.markdown import with_code
from app.web.monitoring.metrics import SHARED_FOLDER, Metrics
from app.web.monitoring.request_log import Requests, start_logging
from app.web.participant import votes
from app.web.participant.front import front_routes
from app.web.problems import UnforeseenErrors, install_problems
from app.web.routers import ROUTERS, joined_routers
from app.web.security import BodyLimit, RenewedSession, SameOrigin, SecurityHeaders

START_TIMEOUT_S = 30
LOOKS_FOR_TASKS_EVERY_S = 5  # a worker leaves the study at the end of a chain of jobs
FOR_OTHERS = 0o027  # what a server's new files do not allow: others nothing, the group (nginx) reading alone
UVICORN_OPTIONS: dict[str, Any] = {
    "http": GuardedProtocol,
    "ws": "none",
    "log_config": None,
    "log_level": "warning",
    "access_log": False,  # addresses hold invitations and sign-in links; app/web/monitoring/request_log.py logs routes
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
        keeper = Housekeeper(settings, database)
        await run_in_threadpool(keeper.keep_house, app.state.clock())
        await run_in_threadpool(_take_up, app, is_alone=settings.is_sqlite)
        with app.state.votes, app.state.flags:
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(_keep_house, app, keeper)
                tasks.start_soon(_look_for_lost_tasks, app)
                yield
                tasks.cancel_scope.cancel()
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
    _set_state(app, settings, database, VoteWriter(votes_database))
    settings.media_dir.mkdir(parents=True, exist_ok=True)
    for folder in settings.private_dirs:
        private_folder(folder)
    if front is not None:
        app.include_router(front_routes(front))  # before the entrance, which has the same address
    app.include_router(votes.router)  # whose bodies hold no free text
    app.include_router(joined_routers(ROUTERS), dependencies=[Depends(check_request_text)])
    app.mount("/static", StaticFiles(directory=packaged("static")), name="static")
    install_problems(app)
    describe(app, [route for router in (votes.router, *ROUTERS) for route in router.routes])
    _add_middleware(app)
    return app


def _set_state(app: FastAPI, settings: Settings, database: Database, writer: VoteWriter) -> None:
    """Set what all requests share; app/web/gates.py reads it."""
    app.state.settings = settings
    app.state.languages = read_languages(settings)
    app.state.database = database
    app.state.votes = writer
    app.state.flags = Flags(database)
    app.state.monitors = WeakValueDictionary()  # by study and role, while somebody watches its live page
    app.state.media_store = MediaStore(settings.media_url) if settings.media_url else None
    app.state.metrics = Metrics(lambda: app.state.votes.n_waiting)
    app.state.templates = Jinja2Templates(env=_environment())
    app.state.clock = utc_now
    app.state.throttle = Throttle()
    app.state.is_stopping = False  # live pages end when it is set


def _take_up(app: FastAPI, *, is_alone: bool) -> None:
    """Take up what a stopped server was making."""
    server, database = app.state.settings, app.state.database
    works = {
        CREATION: partial(go_on_creating, server, database),
        STUDY_OF_SET: partial(create_of_set, server, database),
    }
    resume_tasks(database, works, app.state.clock(), is_alone=is_alone)


async def _look_for_lost_tasks(app: FastAPI) -> None:
    while True:
        await anyio.sleep(LOOKS_FOR_TASKS_EVERY_S)
        with suppress(StudyError):  # logged where it happened; the next look may get through
            await run_in_threadpool(_take_up, app, is_alone=False)


async def _keep_house(app: FastAPI, keeper: Housekeeper) -> None:
    while True:
        await anyio.sleep(EVERY_S)
        await run_in_threadpool(keeper.keep_house, app.state.clock())


def _add_middleware(app: FastAPI) -> None:
    """Add what every request passes, the innermost first."""
    settings: Settings = app.state.settings
    is_https = settings.secure_cookies
    media_origin = app.state.media_store.origin if app.state.media_store else None
    app.add_middleware(KnownHosts, allowed=settings.allowed_hosts, public_url=settings.public_url)
    app.add_middleware(BodyLimit)
    app.add_middleware(SameOrigin)
    app.add_middleware(UnforeseenErrors)
    app.add_middleware(RenewedSession)
    below = settings.hsts_subdomains
    app.add_middleware(SecurityHeaders, is_https=is_https, with_subdomains=below, media_origin=media_origin)
    app.add_middleware(Requests, metrics=app.state.metrics)


def serve(
    settings: Settings,
    host: str = "127.0.0.1",
    port: int = 8000,
    *,
    workers: int = 1,
    n_jobs: int = 0,
    on_start: Callable[[str], None] | None = None,
) -> None:
    """Serve until interrupted; requests at hand are answered and waiting votes are kept.

    Parameters
    ----------
    port : 0 for any free one
    workers : processes that share the port; more than one on PostgreSQL only
    n_jobs : how many of the dashboard's jobs to run at a time, in another process
    on_start : called with the base address once the server takes connections

    Raises
    ------
    ValueError
        If the database cannot be used, or not by several workers, another program has the port, or another server the
        folder.
    """
    _check_port(host, port)
    os.umask(os.umask(0) | FOR_OTHERS)
    start_logging(settings.log_format)
    open_files()
    if workers == 1:
        with alone(settings):
            server = _Server(create_app(settings), host, port, on_start)
            with worker_beside(settings, n_jobs):
                server.run()
    else:
        _serve_by_workers(settings, host, port, workers, n_jobs, on_start)


def worker_app() -> FastAPI:
    """Make the server of one of several processes; its settings come by the environment."""
    end_with_parent()
    settings = Settings()
    start_logging(settings.log_format)
    return create_app(settings)


def _serve_by_workers(
    settings: Settings, host: str, port: int, workers: int, n_jobs: int, on_start: Callable[[str], None] | None
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
        with worker_beside(settings, n_jobs):
            Multiprocess(config, sockets=[bound]).run()


@contextmanager
def running_server(settings: Settings, port: int = 0, front: Path | None = None) -> Iterator[str]:
    """Serve from a thread of this process while the block runs; yields the base address. `front` as in `create_app`."""
    started = threading.Event()
    address: list[str] = []

    def on_start(base_url: str) -> None:
        address.append(base_url)
        started.set()

    server = _Server(create_app(settings, front), "127.0.0.1", port, on_start)
    thread = threading.Thread(target=server.run, name="reconstudy-server", daemon=True)
    thread.start()
    try:
        if not started.wait(START_TIMEOUT_S):
            raise RuntimeError(f"the server on port {port} did not start within {START_TIMEOUT_S} s")
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


def _check_port(host: str, port: int) -> None:
    """Check that the server can have a port.

    Raises
    ------
    ValueError
        If another program has it, or this machine has no such address.
    """
    try:
        socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET).close()
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise ValueError(f"cannot listen on {host} port {port}: {error.strerror or error}") from error
        raise ValueError(
            f"port {port} is in use: another program, or another `reconstudy serve`, listens there; stop it, or choose "
            "another port, such as --port 0 for any free one"
        ) from error


def _address(bound: Any) -> str:
    host, port = bound.getsockname()[:2]
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def _environment() -> Environment:
    environment = page_templates("templates")
    environment.filters["with_code"] = with_code
    environment.globals["has_browser_packages"] = (packaged("static") / "vendor" / "htmx.min.js").is_file()
    return environment
