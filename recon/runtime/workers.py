"""Where work runs: in this process, in local worker processes or on a Dask cluster, behind one interface.

Tasks are independent, and each writes its results to files. If a worker is lost, another one runs its task again and
writes the same file.

Within a task, threads share what kernels do that release the interpreter's lock: as many as numba may use
(`NUMBA_NUM_THREADS`, `numba.set_num_threads`). No result depends on their number.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from threading import Lock, Thread
from typing import TYPE_CHECKING, Protocol, TypeVar

from ground.progress import Progress as Progress
from ground.progress import no_progress as no_progress

if TYPE_CHECKING:
    from distributed import Client

Result = TypeVar("Result")

N_CORES = os.cpu_count() or 1
LOSSES = 3  # so often worker processes may die before the tasks are taken to be the cause
INTERRUPTED = 130  # exit status, as shells give it
ENDS_WITHIN_S = 5.0  # after it was interrupted, a worker process
RETRIES = 2  # how often a task on a cluster is tried again, unless its input is wrong
CONNECT_S = 20  # to wait for a scheduler's answer, and for a worker
NUMBA = "NUMBA_NUM_THREADS"
ONE_THREAD = (NUMBA, "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
KEPT_MEMORY = 32 * 2**20  # bytes; the most that glibc takes for M_MMAP_THRESHOLD
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # as malloc.h numbers them

_one_at_a_time = Lock()


class Pool(Protocol):
    """Where tasks run."""

    @property
    def threads(self) -> int:
        """How many threads a task may use; results do not depend on it."""

    def run(self, tasks: Sequence[partial[Result]]) -> Iterator[Result]:
        """Run every task and yield the results as they are ready.

        Raises
        ------
        Exception
            The error of the first task that fails; tasks that have not begun are not run then.
        """


class ThisProcess:
    """Runs tasks here, one after another, each on all cores."""

    threads = N_CORES

    def run(self, tasks: Sequence[partial[Result]]) -> Iterator[Result]:
        """As `Pool.run`."""
        for task in tasks:
            yield task()


class LocalProcesses:
    """Runs tasks in several processes, each on one thread; tasks of a process that dies are run again."""

    threads = 1

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._executor = self._new_executor()

    def run(self, tasks: Sequence[partial[Result]]) -> Iterator[Result]:
        """As `Pool.run`."""
        waiting = list(tasks)
        for losses in range(LOSSES):
            try:  # a process may have died already, before the tasks are given to it
                futures = {self._executor.submit(_unless_interrupted, task): task for task in waiting}
                for future in as_completed(futures):
                    result = future.result()
                    waiting.remove(futures[future])
                    yield result
                return
            except BrokenProcessPool as error:
                if losses == LOSSES - 1:
                    raise RuntimeError(
                        f"worker processes died {LOSSES} times, {len(waiting)} tasks are not done; where memory is "
                        "short, take fewer workers; what is finished is kept"
                    ) from error
                self._executor.shutdown()
                self._executor = self._new_executor()
            except BaseException:
                self._executor.shutdown(cancel_futures=True)
                raise

    def close(self) -> None:
        """End the processes."""
        self._executor.shutdown(cancel_futures=True)

    def _new_executor(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("spawn")  # fork would copy the threads and locks of numba and GL
        return ProcessPoolExecutor(self._workers, mp_context=context, initializer=_become_worker)


class DaskCluster:
    """Runs tasks on the workers of a Dask scheduler, which must see the same files under the same names.

    The scheduler gives the tasks of a lost worker to another one. A worker runs one task at a time.
    """

    threads = 1

    def __init__(self, client: Client) -> None:
        self._client = client

    def run(self, tasks: Sequence[partial[Result]]) -> Iterator[Result]:
        """As `Pool.run`."""
        from distributed import as_completed as completed

        if not tasks:
            return
        futures = self._client.map(_outcome, list(tasks), pure=False, retries=RETRIES)
        try:
            for future in completed(futures, loop=self._client.loop):
                outcome = future.result()
                if isinstance(outcome, _WrongInput):
                    raise outcome.error
                yield outcome
        finally:
            self._client.cancel(futures)


class _WrongInput:
    """The error of a task whose input is wrong: trying again would not help."""

    def __init__(self, error: ValueError) -> None:
        self.error = error


@contextmanager
def open_pool(workers: int = 1, cluster: str | None = None) -> Iterator[Pool]:
    """Open a place where tasks run: this process, `workers` local ones, or the Dask scheduler at an address.

    A ValueError says that `workers` is not positive, or that no scheduler with a worker answers at the address.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1, found {workers}")
    if cluster is not None:
        with _connected(cluster) as client:
            yield DaskCluster(client)
    elif workers == 1:
        yield ThisProcess()
    else:
        processes = LocalProcesses(workers)
        try:
            yield processes
        finally:
            processes.close()


@contextmanager
def _connected(address: str) -> Iterator[Client]:
    try:
        from distributed import Client
    except ImportError as error:
        raise ValueError(f"{address}: a cluster needs an extra package: {error}") from error
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"no Dask scheduler answers at {address!r}: {error}; start one with `dask scheduler`, expected an address "
            "such as tcp://host:8786"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError as error:
            raise ValueError(
                f"the Dask scheduler at {address} has no worker after {CONNECT_S} s; start some with "
                f"`dask worker {address} --nthreads 1`"
            ) from error
        yield client


def _outcome(task: partial[Result]) -> Result | _WrongInput:
    """Run a task and return its result, or what is wrong with its input; one at a time."""
    with _one_at_a_time:
        _use_one_thread()
        _keep_memory()
        try:
            return task()
        except ValueError as error:
            return _WrongInput(error)


def _become_worker() -> None:
    signal.signal(signal.SIGUSR1, signal.default_int_handler)  # where a shell has SIGINT ignored, too
    Thread(target=_end_with_parent, name="parent", daemon=True).start()
    for name in ONE_THREAD:  # for what is not loaded yet
        if not (name == NUMBA and "numba" in sys.modules):  # it refuses another number, when it compiles next
            os.environ[name] = "1"
    _use_one_thread()


def _end_with_parent() -> None:
    """End this worker process when the one that started it was killed: else it would wait for tasks for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os.kill(os.getpid(), signal.SIGUSR1)  # so that a program of somebody else's is stopped, too
    time.sleep(ENDS_WITHIN_S)
    os._exit(INTERRUPTED)


def _unless_interrupted(task: partial[Result]) -> Result:
    """Run a task in a worker process, which an interrupt ends: else it would begin with the next task."""
    try:
        return task()
    except KeyboardInterrupt:
        os._exit(INTERRUPTED)


def _use_one_thread() -> None:
    """Limit OpenCV in this process and numba in this thread."""
    import cv2
    import numba

    cv2.setNumThreads(1)
    numba.set_num_threads(1)


def _keep_memory() -> None:
    """Reuse the memory of arrays instead of returning it to the system.

    Dask starts its workers with malloc set to return memory at once. The system then fills new memory with zeros page
    by page, and matching takes half as long again (bench/cluster.py).
    """
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", lambda *_: 0)  # musl has none
        mallopt(M_MMAP_THRESHOLD, KEPT_MEMORY)
        mallopt(M_TRIM_THRESHOLD, KEPT_MEMORY)


def in_bands(length: int, work: Callable[[int, int], None]) -> None:
    """Call `work(first, last)` for bands of the rows, blocks or points 0 to `length`, one band for each thread."""
    n_bands = _threads()
    edges = [length * band // n_bands for band in range(n_bands + 1)]
    with ThreadPoolExecutor(max_workers=n_bands) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))


def in_both(work: Callable[[int], Result]) -> tuple[Result, Result]:
    """Call `work` for the left view (0) and the right (1), at the same time if there are two threads."""
    with ThreadPoolExecutor(max_workers=min(_threads(), 2)) as pool:
        left, right = pool.map(work, (0, 1))
    return left, right


def _threads() -> int:
    import numba

    return int(numba.get_num_threads())
