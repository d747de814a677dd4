"""The command of a job: a process group of its own, its log, and how far it is.

A job's folder, `work/ID` in the data folder, holds `log.txt`, `progress.json`, `steps.json` (when each step ended, in
seconds since the command began), `lock`, and `done` once the command has done all. The command keeps the lock for as
long as it lives, also when its worker dies: nobody begins the job again beside it.
"""

from __future__ import annotations

import fcntl
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from app.errors import ConflictError
from app.files import read_json, write_json
from app.settings import Settings
from app.store.queue import JobProgress

PROGRAM = (sys.executable, "-P", "-m", "app.cli")  # -P: imports nothing from where the server was started
LOG, PROGRESS, STEPS, LOCK, DONE = "log.txt", "progress.json", "steps.json", "lock", "done"
PROGRESS_FILE = "RECONSTUDY_PROGRESS_FILE"  # as recon/cli/console.py reads it
DONE_FILE = "RECONSTUDY_DONE_FILE"  # as app/cli reads it
FILES_BELOW = "RECONSTUDY_FILES_BELOW"  # as recon/runtime/files.py reads it
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
LOWEST_PRIORITY = 19  # whatever else runs here, such as the server, comes first
LEFTOVER_ENDS_WITHIN_S = 10
# What a program of ours needs from its environment. All else stays away: passwords of databases, keys of clouds.
NEEDED = re.compile(
    "PATH|HOME|USER|LOGNAME|TMPDIR|TZ|LANG|LANGUAGE|LC_.*|VIRTUAL_ENV|LD_LIBRARY_PATH|PYTHON.*|COVERAGE.*|XDG_.*"
    "|NUMBA_.*|OMP_.*|OPENBLAS_.*|MKL_.*|OPENCV_.*|CUDA_.*|NVIDIA_.*|PYOPENGL_PLATFORM|EGL_.*|LIBGL_.*|MESA_.*|GALLIUM_.*"
)
# OpenCV opens a recording alone, as what it is: a playlist that is called a film would lead it to other files.
# An image of a few bytes may announce gigabytes of pixels.
IMAGES = {
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(2**27),
    "OPENCV_FFMPEG_CAPTURE_OPTIONS": "protocol_whitelist;file|format_whitelist;mov,matroska,webm,avi",
}
LOG_END = 64 * 1024  # bytes that are looked at
LONGEST_LINE = 500


def job_folder(settings: Settings, public_id: str) -> Path:
    """Return the folder of a job's log."""
    return (settings.data_dir / "work" / public_id).absolute()


def log_tail(folder: Path, n_lines: int) -> list[str]:
    """Return the last lines of a job's log; none before it has begun."""
    try:
        with (folder / LOG).open("rb") as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - LOG_END))
            end = file.read(LOG_END)
    except FileNotFoundError:
        return []
    lines = end.decode("utf-8", errors="replace").replace("\r", "\n").splitlines()
    return [line[:LONGEST_LINE] for line in lines[-n_lines:]]


def step_ends(folder: Path) -> dict[str, float]:
    """Return the steps that a job's command came through, and when each ended, s since the command began."""
    try:
        ends: dict[str, float] = read_json(folder / STEPS)
    except ValueError:
        return {}
    return ends


def was_done(folder: Path) -> bool:
    """Say whether the command of an earlier attempt, whose worker died meanwhile, did all that it was to do."""
    return (folder / DONE).is_file()


class Command:
    """A running command line of this program.

    Parameters
    ----------
    folder : the job's
    arguments : of the command line
    threads : how many it may use
    began_at : for the log
    below : absolute folders in which it may read what a file names

    Raises
    ------
    ConflictError
        If the command of an earlier attempt still runs and cannot be ended from here.
    """

    def __init__(
        self, folder: Path, arguments: Sequence[str], threads: int, began_at: datetime, below: Sequence[Path] = ()
    ) -> None:
        self._folder = folder
        self._terminated_s: float | None = None
        self._began_s = time.monotonic()
        self._step_ends: dict[str, float] = {}
        folder.mkdir(parents=True, exist_ok=True)
        (folder / PROGRESS).unlink(missing_ok=True)
        lock = _lock(folder / LOCK)
        try:
            with (folder / LOG).open("ab") as log:
                log.write(f"[{began_at:%Y-%m-%d %H:%M:%S} UTC] reconstudy {' '.join(arguments)}\n".encode())
                log.flush()
                self._process = subprocess.Popen(
                    [*PROGRAM, *arguments],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    env=_environment(folder, threads, below),
                    process_group=0,  # no session of its own: priorities count within a session where Linux groups so
                    pass_fds=(lock,),
                )
            with suppress(ProcessLookupError):
                os.setpriority(os.PRIO_PROCESS, self._process.pid, LOWEST_PRIORITY)
                _limit_memory(self._process.pid)
            os.pwrite(lock, f"{socket.gethostname()} {self._process.pid}\n".encode(), 0)
        finally:
            os.close(lock)  # the command has it still

    @property
    def took_s(self) -> float:
        """How long the command has run, by a clock that nobody sets."""
        return time.monotonic() - self._began_s

    @property
    def status(self) -> int | None:
        """How the command ended: 0 done, negative by a signal; None while it runs."""
        return self._process.poll()

    def progress(self) -> JobProgress:
        """Return how far the command said it is, and keep when its steps ended."""
        has_ended = self.status is not None
        try:
            progress = JobProgress(**read_json(self._folder / PROGRESS))
        except (ValueError, TypeError):
            return JobProgress()
        is_new = progress.step not in self._step_ends
        self._step_ends[progress.step] = self.took_s
        if is_new or has_ended:
            with suppress(OSError):  # such as a full disk: later estimates miss it, and the job needs it not
                write_json(self._folder / STEPS, self._step_ends)
        return progress

    def stop(self, patience_s: float) -> None:
        """Ask all of the command's processes to end; called again, kill them when they have had their time."""
        if self._terminated_s is None:
            self._terminated_s = time.monotonic()
            self._signal(signal.SIGTERM)
        elif time.monotonic() - self._terminated_s >= patience_s:
            self._signal(signal.SIGKILL)

    def kill(self) -> None:
        """End what is left of the command's processes."""
        self._signal(signal.SIGKILL)
        self._process.wait()

    def outcome(self) -> str:
        """Say why the command failed: its own last words, or the signal that ended it."""
        status = self._process.returncode
        if status < 0:
            memory = ", which the system sends where memory runs out" if status == -signal.SIGKILL else ""
            return f"The command was ended by signal {-status} ({signal.strsignal(-status)}){memory}."
        last = next((line for line in reversed(log_tail(self._folder, 20)) if line.strip()), "")
        return last.removeprefix("reconstudy: ").removeprefix("Error: ").removeprefix("Invalid value: ")

    def _signal(self, number: int) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, number)


def needed_environment() -> dict[str, str]:
    """Return what a program that reads people's files needs of the environment: no setting or secret of a server.

    What a picture or film may make OpenCV do is limited in it.
    """
    return {name: value for name, value in os.environ.items() if NEEDED.fullmatch(name)} | IMAGES


def _environment(folder: Path, threads: int, below: Sequence[Path]) -> dict[str, str]:
    """Return the command's environment: it never finds the studies' database."""
    limits = {name: str(threads) for name in THREADS}
    ours = {
        "RECONSTUDY_DATA_DIR": str(folder / "none"),
        PROGRESS_FILE: str(folder / PROGRESS),
        DONE_FILE: str(folder / DONE),
        FILES_BELOW: os.pathsep.join(map(str, below)),
        "PYTHONUNBUFFERED": "1",
        "TYPER_USE_RICH": "0",  # what the command line refuses is a sentence then, not a frame around one
    }
    return limits | needed_environment() | ours


def _limit_memory(process: int) -> None:
    """Let an allocation fail beyond what the machine has: the command says so, and nothing else is ended."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with suppress(AttributeError):  # only Linux has it
        resource.prlimit(process, resource.RLIMIT_DATA, (memory, memory))


def _lock(path: Path) -> int:
    """Take a job's lock and return its open file; a command that still has it on this machine is ended first."""
    lock = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    ends_s = time.monotonic() + LEFTOVER_ENDS_WITHIN_S
    while True:
        with suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        host, _, pid = os.pread(lock, 300, 0).decode().strip().rpartition(" ")
        if host == socket.gethostname() and pid.isdigit():
            with suppress(ProcessLookupError):
                os.killpg(int(pid), signal.SIGKILL)  # it holds the lock, so the number is still its own
        if time.monotonic() > ends_s:
            os.close(lock)
            raise ConflictError(
                f"Its command of an earlier attempt still runs on {host or 'another machine'} (process {pid or '?'}), "
                "whose worker died. End that process, then try again."
            )
        time.sleep(0.05)
