"""Compute a result once for all requests that ask for it, and keep the latest results."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Generic, TypeVar

Value = TypeVar("Value")


class Shared(Generic[Value]):
    """A cache of results by the digest of their inputs."""

    def __init__(self, n_kept: int) -> None:
        self._n_kept = n_kept
        self._results: OrderedDict[str, Future[Value]] = OrderedDict()
        self._lock = threading.Lock()

    def begun(self, key: str) -> Future[Value] | None:
        """Return the result that is kept or being computed for a key; None if there is neither."""
        with self._lock:
            if key in self._results:
                self._results.move_to_end(key)
            return self._results.get(key)

    def get(self, key: str, make: Callable[[], Value]) -> Value:
        """Return the result of a key, and compute it in this thread if it is new.

        Requests for a result that is being computed wait for it. A failure is raised in all of them and not kept.
        """
        with self._lock:
            is_new = key not in self._results
            result = self._results.setdefault(key, Future())
            self._results.move_to_end(key)
            while len(self._results) > self._n_kept:
                self._results.popitem(last=False)
        if is_new:
            self._make(key, result, make)
        return result.result()

    def _make(self, key: str, result: Future[Value], make: Callable[[], Value]) -> None:
        try:
            result.set_result(make())
        except BaseException as error:
            with self._lock:
                if self._results.get(key) is result:
                    del self._results[key]
            result.set_exception(error)


class Latest(Generic[Value]):
    """Results that are made in the background, one after the other, and the latest there is of each."""

    def __init__(self, name: str) -> None:
        self._worker = ThreadPoolExecutor(1, name)
        self._lock = threading.Lock()
        self._work: dict[Hashable, Future[Value]] = {}
        self._latest: dict[Hashable, Value] = {}

    def get(self, key: Hashable, make: Callable[[], Value], patience_s: float) -> tuple[Value | None, bool]:
        """Make a result and return it with True, or the latest of its key (None: none yet) with False if it takes long.

        A failure is raised where somebody waits for it.

        Parameters
        ----------
        key : of the thing that changes, not of its state
        patience_s : how long to wait; the work then goes on without the caller
        """
        with self._lock:
            work = self._work.get(key)
            if work is not None and work.done():
                self._finish(key, work)
                work = None
            if work is None:
                work = self._work[key] = self._worker.submit(make)
        try:
            work.result(patience_s)
        except TimeoutError:
            return self._latest.get(key), False
        finally:
            with self._lock:
                if work.done() and self._work.get(key) is work:
                    self._finish(key, work)
        return work.result(), True

    def _finish(self, key: Hashable, work: Future[Value]) -> None:
        del self._work[key]
        if work.exception() is None:
            self._latest[key] = work.result()
