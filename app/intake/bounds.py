"""Read what comes from outside in a process of its own, with an end to its memory and its time.

A small file can ask for very much memory, or keep a parser busy for hours; then that process ends, and the server goes
on. Processes are forked from one that has loaded the readers (`forkserver`), which takes some 20 ms. They end with the
server, however it ends.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import ParamSpec, TypeVar

from app.errors import TooLargeError

MOST_MB = 1024  # what a reader may take besides the program; a JSON of app.files.LARGEST_JSON takes 350 MB
LONGEST_S = 900  # of computing; an upload of 64 GB unpacks in half of that
MOST_TYPED_MB, LONGEST_TYPED_S = 256, 3  # of what comes in a form: the longest study file takes a tenth of a second
READERS = (
    "app.study.options.study_file",
    "app.intake.arrivals",
    "app.intake.models",
    "app.intake.stimuli",
    "app.analysis.reading.measures_table",
    "app.analysis.reading.read_votes",
)

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def in_bounds(read: Callable[Arguments, Result], *arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
    """Call a function in a process with bounded memory and time, and return its result or raise its error.

    Parameters
    ----------
    read : a function of a module, no lambda
    arguments, named : of the function; they and the result travel between processes

    Raises
    ------
    TooLargeError
        If it needs more than the bounds.
    """
    with _process(MOST_MB, LONGEST_S) as process:
        return process.submit(read, *arguments, **named).result()


def typed_in_bounds(read: Callable[Arguments, Result], *arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
    """Call a function on what somebody typed, as `in_bounds` does with less memory and time.

    Raises
    ------
    TooLargeError
        If it needs more than these bounds.
    """
    with _process(MOST_TYPED_MB, LONGEST_TYPED_S) as process:
        return process.submit(read, *arguments, **named).result()


def load_readers() -> None:
    """Begin to load the readers, which takes seconds, unless that has begun; what is read first then waits less."""
    _processes()
    forkserver.ensure_running()


@contextmanager
def _process(most_mb: int, longest_s: int) -> Iterator[ProcessPoolExecutor]:
    with ProcessPoolExecutor(1, _processes(), _bound, (most_mb, longest_s)) as process:
        try:
            yield process
        except (MemoryError, BrokenProcessPool) as error:
            raise TooLargeError(
                f"This needs more than {most_mb} MB of memory or {longest_s} s of computing, far more "
                "than its size explains. Make it smaller, or write it again, then repeat."
            ) from error


def end_with_parent() -> None:
    """Let this process, which multiprocessing has started, be terminated when its parent is gone, even killed."""

    def wait_and_end() -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None, "another process has started this one"
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait_and_end, name="parent", daemon=True).start()


def _processes() -> ForkServerContext:
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # pyarrow's own pool begins by taking a gigabyte
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(READERS))
    return context


def _bound(most_mb: int, longest_s: int) -> None:
    """Limit this process: beyond the memory an allocation fails, beyond the time the system ends the process."""
    end_with_parent()
    resource.setrlimit(resource.RLIMIT_CPU, (longest_s, longest_s))
    statm = Path("/proc/self/statm")  # proc(5): the sixth number is what RLIMIT_DATA counts, in pages
    if statm.is_file():
        taken = int(statm.read_text().split()[5]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_DATA, (taken + most_mb * 2**20,) * 2)
