"""The study server in a process of its own that can be killed, and is there again at once.

    python -m tests.study_server DATA_DIR PORT [options]

The process loads everything, then forks the server; when that is killed it forks the next. Each prints the number of
its process once it takes connections. All of them die with their parent.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import IO, Any

from tests import sqlite_disk
from tests.processes import kill

ROOT = Path(__file__).parent.parent
START_TIMEOUT_S = 180
PR_SET_PDEATHSIG = 1
AGAIN_S = 0.2  # before a server that ended by itself is started again


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class StudyServer:
    """A server that is started again whenever it is killed; `pid` is that of the one that answers now.

    Its log goes to standard error, or to the file `log`, open or subprocess.DEVNULL.
    """

    def __init__(
        self, data_dir: Path, *options: str, database_url: str | None = None, log: IO[str] | int | None = None
    ) -> None:
        self._log = log
        self.port = free_port()
        self.base_url = f"http://127.0.0.1:{self.port}"
        self._command = [sys.executable, "-m", "tests.study_server", str(data_dir), str(self.port), *options]
        url = {"RECONSTUDY_DATABASE_URL": database_url} if database_url else {}
        self._environment = os.environ | {"PYTHONPATH": str(ROOT)} | url

    def __enter__(self) -> StudyServer:
        self._process = subprocess.Popen(
            self._command, env=self._environment, stdout=subprocess.PIPE, stderr=self._log, text=True
        )
        try:
            self.pid = self._next_pid()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._end()

    def kill(self) -> None:
        """Kill the server that answers now, and wait until the next one does."""
        kill(self.pid)
        self.pid = self._next_pid()

    @contextmanager
    def killed(self) -> Iterator[None]:
        """Kill the server; the next one begins after the block, and answers when this ends."""
        os.kill(self._process.pid, signal.SIGSTOP)
        kill(self.pid)
        yield
        os.kill(self._process.pid, signal.SIGCONT)
        self.pid = self._next_pid()

    def kill_for_good(self) -> None:
        """Kill what would start the server again, and the server."""
        kill(self._process.pid, self.pid)

    def _next_pid(self) -> int:
        assert self._process.stdout is not None
        if not select.select([self._process.stdout], [], [], START_TIMEOUT_S)[0]:
            raise RuntimeError(f"the server did not start within {START_TIMEOUT_S} s")
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"the server ended by itself: exit {self._process.wait()}")
        return int(line)

    def _end(self) -> None:
        self._process.kill()
        self._process.communicate()


def _die_with_parent() -> None:
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _serve(arguments: argparse.Namespace) -> None:
    from sqlalchemy import Pool, event

    import app.main
    from app.settings import Settings

    if arguments.safe:
        sqlite_disk.install(arguments.safe)
    if arguments.synchronous:

        def lower(connection: Any, *_: Any) -> None:
            connection.execute(f"PRAGMA synchronous={arguments.synchronous}").close()

        event.listen(Pool, "checkout", lower)
    for name in arguments.first:
        module, _, function = name.partition(":")
        getattr(import_module(module), function)()
    settings = Settings(data_dir=arguments.data_dir)
    app.main.serve(
        settings,
        port=arguments.port,
        workers=arguments.workers,
        n_jobs=arguments.jobs,
        on_start=lambda _url: print(os.getpid(), flush=True),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir", type=Path)
    parser.add_argument("port", type=int)
    parser.add_argument("--safe", type=Path, help="file that tells how much of SQLite's log is on disk")
    parser.add_argument("--synchronous", help="SQLite's setting, instead of FULL")
    parser.add_argument(
        "--again", action="store_true", help="start it again, too, when it ends by itself, as systemd does"
    )
    parser.add_argument(
        "--workers", type=int, default=1, help="processes that answer; the one that starts them is told"
    )
    parser.add_argument("--jobs", type=int, default=0, help="jobs at a time, in a worker beside the server")
    parser.add_argument("--first", nargs="*", default=[], metavar="MODULE:FUNCTION", help="to call before serving")
    arguments = parser.parse_args()
    _die_with_parent()
    import app.main  # noqa: F401  # before the fork, so that each server starts at once

    status = -signal.SIGKILL
    while status == -signal.SIGKILL or (arguments.again and status):
        pid = os.fork()
        if pid == 0:
            _die_with_parent()
            _serve(arguments)
            os._exit(0)
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        if status != -signal.SIGKILL:
            time.sleep(AGAIN_S)
    sys.exit(status)


if __name__ == "__main__":
    main()
