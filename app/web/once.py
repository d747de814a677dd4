"""Compute a result once for all requests that ask for it, and keep the latest results."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
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
