"""Where work runs: in this process, or in local worker processes. Tasks are independent, so order does not matter."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from typing import TypeVar

Result = TypeVar("Result")


def run_tasks(tasks: Sequence[partial[Result]], *, workers: int) -> Iterator[Result]:
    """Run every task and yield the results as they are ready.

    With one worker the tasks run here, one after another, and may use every core themselves; with more, each
    runs in a process of its own on one thread.

    Raises
    ------
    ValueError
        If `workers` is not positive.
    """
    if workers < 1:
        raise ValueError(f"workers must be at least 1, found {workers}")
    if workers == 1 or len(tasks) < 2:
        for task in tasks:
            yield task()
        return
    context = multiprocessing.get_context("spawn")  # fork would copy the threads and locks of numba and GL
    with ProcessPoolExecutor(min(workers, len(tasks)), mp_context=context, initializer=_use_one_thread) as pool:
        try:
            for future in as_completed([pool.submit(task) for task in tasks]):
                yield future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _use_one_thread() -> None:
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"


Progress = Callable[[str, int, int], None]
"""Called as (what is being done, how many are done, how many there are)."""


def silent(_what: str, _done: int, _total: int) -> None:
    """Progress that nobody watches."""
