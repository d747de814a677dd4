"""The study server in a process of its own that can be killed, and is there again at once.

    python -m tests.study_server DATA_DIR PORT [options]

The process loads everything, then forks the server; when that dies it forks the next. It dies with its parent.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import TracebackType
from typing import IO, Any

ROOT = Path(__file__).parent.parent
START_TIMEOUT_S = 60
PR_SET_PDEATHSIG = 1


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for_port(port: int, process: subprocess.Popen[Any]) -> None:
    """Wait until a server's process answers on its port."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return
        except OSError:
            if process.poll() is not None:
                raise RuntimeError(f"the server ended by itself: exit {process.returncode}") from None
            time.sleep(0.02)
    raise RuntimeError(f"the server on port {port} did not start within {START_TIMEOUT_S} s")


class StudyServer:
    """A server that restarts itself whenever it is killed; `pid` is that of the one that answers now.

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
        self._pid_file = data_dir / "server.pid"
        self._pid_file.unlink(missing_ok=True)

    def __enter__(self) -> StudyServer:
        self._process = subprocess.Popen(self._command, env=self._environment, stderr=self._log)
        try:
            self.wait_until_it_answers()
        except BaseException:
            self._process.kill()
            self._process.wait()
            raise
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()

    @property
    def pid(self) -> int:
        return int(self._pid_file.read_text())

    def kill(self) -> None:
        """Kill the server that answers now; nothing of it runs when this returns."""
        pid = self.pid
        os.kill(pid, signal.SIGKILL)
        while self._pid_file.exists() and self.pid == pid:
            time.sleep(0.005)

    def kill_for_good(self) -> None:
        """Kill the server and what would start it again."""
        self._process.kill()
        self._process.wait()
        pid = self.pid
        while Path(f"/proc/{pid}").exists():
            time.sleep(0.005)

    def wait_until_it_answers(self) -> None:
        wait_for_port(self.port, self._process)


def _die_with_parent() -> None:
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _jumping_clock(jump_s: float) -> Callable[[], datetime]:
    """A clock that is set wrong, right, and wrong again ten times a second."""
    offsets_s = (0.0, jump_s, -jump_s)
    return lambda: datetime.now(UTC) + timedelta(seconds=offsets_s[int(10 * time.monotonic()) % len(offsets_s)])


def _serve(arguments: argparse.Namespace) -> None:
    from sqlalchemy import Pool, event

    import app.main
    from app.settings import Settings
    from app.store import vote_writer
    from app.store.vote_records import KeptVote

    if arguments.safe or arguments.sync_ms:
        from tests import sqlite_disk

        sqlite_disk.install(arguments.safe, arguments.sync_ms / 1000)
    if arguments.batch:
        vote_writer.LARGEST_BATCH = arguments.batch
    if arguments.no_database:

        def nowhere(_database: Any, ballots: Any) -> Any:
            return [KeptVote(ballot.sent, 1, ballot.received_at, is_new=True) for ballot in ballots]

        vote_writer.keep_votes = nowhere
    if arguments.clock_jumps_s:
        app.main.utc_now = _jumping_clock(arguments.clock_jumps_s)
    if arguments.synchronous:

        def lower(connection: Any, *_: Any) -> None:
            connection.execute(f"PRAGMA synchronous={arguments.synchronous}").close()

        event.listen(Pool, "checkout", lower)
    app.main.serve(Settings(data_dir=arguments.data_dir), port=arguments.port)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data_dir", type=Path)
    parser.add_argument("port", type=int)
    parser.add_argument("--safe", type=Path, help="file that tells how much of SQLite's log is on disk")
    parser.add_argument("--sync-ms", type=float, default=0.0, help="how much longer SQLite's syncs take")
    parser.add_argument("--synchronous", help="SQLite's setting, instead of FULL")
    parser.add_argument("--batch", type=int, default=0, help="most votes in a transaction")
    parser.add_argument("--clock-jumps-s", type=float, default=0.0, help="how far the clock goes forth and back")
    parser.add_argument("--no-database", action="store_true", help="acknowledge votes without keeping them")
    arguments = parser.parse_args()
    _die_with_parent()
    import app.main  # noqa: F401  # before the fork, so that each server starts at once

    while True:
        pid = os.fork()
        if pid == 0:
            _die_with_parent()
            _serve(arguments)
            os._exit(0)
        pid_file = arguments.data_dir / "server.pid"
        pid_file.with_suffix(".part").write_text(str(pid))
        pid_file.with_suffix(".part").replace(pid_file)
        os.waitpid(pid, 0)


if __name__ == "__main__":
    main()
