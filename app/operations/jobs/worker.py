"""The worker: takes jobs from the queue and runs their commands, `reconstudy work`."""

from __future__ import annotations

import logging
import os
import secrets
import signal
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime

from app.errors import StudyError, UnavailableError
from app.operations.database import open_store
from app.operations.extras import has_extra
from app.operations.jobs.chains import go_on
from app.operations.jobs.command import Command, job_folder, was_done
from app.operations.jobs.fields import place
from app.operations.jobs.kinds import KINDS, in_page_words, job_kind
from app.operations.jobs.queueing import must_wait
from app.settings import Settings
from app.store.database.engine import Database, Transaction
from app.store.database.keys import utc_now
from app.store.queue import (
    JobProgress,
    JobState,
    QueuedJob,
    Worker,
    beat,
    end_job,
    give_back,
    jobs_of,
    leave,
    list_jobs,
    take_job,
    tell_progress,
)

QUEUED: JobState = "queued"
LOOKS_EVERY_S = 0.5
BEATS_EVERY_S = 5.0
ENDS_WITHIN_S = 5.0  # after it was asked to; then a command is killed

log = logging.getLogger(__name__)


def kinds_here() -> tuple[str, ...]:
    """Return the kinds of jobs that this installation can run."""
    is_whole = has_extra("recon")
    return tuple(name for name, kind in KINDS.items() if is_whole or not kind.needs_recon)


@dataclass
class _Running:
    job: QueuedJob
    command: Command
    told: JobProgress
    was_ended: bool = False  # by a signal of somebody else's; one to this worker may follow


class JobWorker:
    """Runs jobs one after another, or several at a time.

    Parameters
    ----------
    settings, database : where entries lie, and the queue
    n_at_once : how many jobs to run at a time
    clock : tells the time
    """

    def __init__(
        self, settings: Settings, database: Database, n_at_once: int = 1, clock: Callable[[], datetime] = utc_now
    ) -> None:
        self._settings, self._database, self._clock = settings, database, clock
        name = f"{socket.gethostname()} {os.getpid()} {secrets.token_hex(2)}"
        self._me = Worker(name, kinds_here(), n_at_once, clock(), clock())
        self._running: dict[str, _Running] = {}
        self._beaten_s = -BEATS_EVERY_S
        self._threads = max(1, (os.cpu_count() or 1) // n_at_once)

    def work(self, stop: threading.Event, *, once: bool = False) -> None:
        """Run jobs until told to stop, or `once` the queue is empty; what still runs then is queued again.

        Parameters
        ----------
        stop : set to stop
        once : whether to end when there is nothing to do
        """
        try:
            while not stop.is_set():
                with suppress(UnavailableError):  # logged already; commands go on meanwhile
                    self.look()
                    if once and self._is_idle():
                        break
                stop.wait(LOOKS_EVERY_S)
        finally:
            self._leave()

    def look(self) -> None:
        """Look once after everything: the sign of life, running jobs, and new ones."""
        if time.monotonic() - self._beaten_s >= BEATS_EVERY_S:
            beat(self._database, self._me, self._clock())
            self._beaten_s = time.monotonic()
        with self._database.reading() as connection:
            mine = jobs_of(connection, self._me.name)
        if lost := mine.keys() - self._running.keys():  # their end could not be stored
            give_back(self._database, self._me.name, lost, self._clock())
        for running in list(self._running.values()):
            self._look_after(running, mine.get(running.job.public_id))
        while len(self._running) < self._me.n_at_once:
            job = take_job(self._database, self._me.name, self._me.kinds, self._clock(), must_wait)
            if job is None:
                break
            self._begin(job)

    def _is_idle(self) -> bool:
        """Whether nothing runs here and nothing waits that could."""
        if self._running:
            return False
        with self._database.reading() as connection:
            waiting = list_jobs(connection, states=(QUEUED,))
        return not any(job.kind in self._me.kinds for job in waiting)

    def _begin(self, job: QueuedJob) -> None:
        folder = job_folder(self._settings, job.public_id)
        if job.attempt > 1 and was_done(folder):
            self._end_done(job)
            return
        try:
            arguments = job_kind(job.kind).argv(job.arguments, self._settings)
            below = [path.resolve() for path in (self._settings.intake_dir, self._settings.sets_dir)]
            command = Command(folder, arguments, self._threads, self._clock(), below)
        except (StudyError, OSError, ValueError, KeyError) as error:
            self._end(job, "failed", str(error))
            return
        log.info("job %s begins: %s, %s", job.public_id, job.kind, job.output)
        self._running[job.public_id] = _Running(job, command, JobProgress())

    def _look_after(self, running: _Running, is_cancelling: bool | None) -> None:
        """Store what a job's command says, stop it, or store its end.

        Parameters
        ----------
        is_cancelling : whether it is to be stopped; None: it is this worker's no longer
        """
        job, command = running.job, running.command
        if is_cancelling is None:
            command.kill()
            del self._running[job.public_id]
            return
        status = command.status
        if status is None:
            if is_cancelling or self._is_too_long(command):
                command.stop(ENDS_WITHIN_S)
            elif (progress := command.progress()) != running.told:
                tell_progress(self._database, self._me.name, job.public_id, progress)
                running.told = progress
            return
        if self._is_too_long(command) and status != 0 and not is_cancelling:
            command.kill()
            longest = f"{self._settings.longest_job_h:g} h"
            self._end(job, "failed", f"It was ended after {longest}; RECONSTUDY_LONGEST_JOB_H allows more.")
            del self._running[job.public_id]
            return
        if status == -signal.SIGTERM and not is_cancelling and not running.was_ended:
            running.was_ended = True  # a machine that shuts down ends all processes: then the job is given back
            return
        if is_cancelling:
            command.kill()  # what is left of its processes
        if status == 0:
            self._end_done(job, command)
        elif is_cancelling:
            self._end(job, "cancelled", "")
        else:
            self._end(job, "failed", in_page_words(self._without_folders(command.outcome())))
        del self._running[job.public_id]

    def _is_too_long(self, command: Command) -> bool:
        return command.took_s > 3600 * self._settings.longest_job_h

    def _end_done(self, job: QueuedJob, command: Command | None = None) -> None:
        """Store that a job is done, and how far its command said it is; None: that of an earlier attempt did all."""
        if command is not None:
            tell_progress(self._database, self._me.name, job.public_id, command.progress())
        now = self._clock()

        def goes_on(connection: Transaction) -> str:
            return go_on(self._settings, connection, job, now)

        end_job(self._database, self._me.name, job.public_id, "done", "", now, goes_on)
        log.info("job %s is done", job.public_id)

    def _end(self, job: QueuedJob, state: JobState, detail: str) -> None:
        shelf, _, name = job.output.partition("/")
        with suppress(OSError, StudyError):  # it holds something, or was never made
            (place(self._settings, shelf) / name).rmdir()
        end_job(self._database, self._me.name, job.public_id, state, detail, self._clock())
        log.info("job %s is %s%s", job.public_id, state, f": {detail}" if detail else "")

    def _without_folders(self, sentence: str) -> str:
        """Name entries as the dashboard does, without the server's folders."""
        for folder in (self._settings.intake_dir, self._settings.sets_dir.parent):
            sentence = sentence.replace(f"{folder.absolute()}/", "")
        return sentence

    def _leave(self) -> None:
        """Stop the commands and give back the jobs of those that were not done."""
        ends_s = time.monotonic() + ENDS_WITHIN_S
        while any(running.command.status is None for running in self._running.values()) and time.monotonic() < ends_s:
            for running in self._running.values():
                running.command.stop(ENDS_WITHIN_S)
            time.sleep(0.05)
        for running in self._running.values():
            running.command.kill()
        with suppress(UnavailableError):  # else they are queued again when this worker is found to be silent
            for running in self._running.values():
                if running.command.status == 0:  # since the last look
                    self._end_done(running.job, running.command)
            leave(self._database, self._me.name, self._clock())


def work(settings: Settings, n_at_once: int = 1, *, once: bool = False, parent: int | None = None) -> None:
    """Run jobs until this process is told to end (SIGTERM or Ctrl-C).

    Parameters
    ----------
    settings : where entries lie, and the queue
    n_at_once : how many jobs to run at a time
    once : whether to end when the queue is empty
    parent : the process that this one ends with, if any
    """
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s")
    logging.getLogger("alembic").setLevel(logging.WARNING)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    if parent is not None:
        threading.Thread(target=_stop_with, args=(parent, stop), name="parent", daemon=True).start()
    with open_store(settings) as database:
        JobWorker(settings, database, n_at_once).work(stop, once=once)


def _stop_with(parent: int, stop: threading.Event) -> None:
    while os.getppid() == parent and not stop.wait(LOOKS_EVERY_S):
        pass
    stop.set()
