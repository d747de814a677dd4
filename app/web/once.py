"""Results that requests share: who asks for what is being made already waits for it, and the latest are kept."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from typing import Generic, TypeVar

Value = TypeVar("Value")


class Shared(Generic[Value]):
    """The latest results by a key that stands for all that they follow from."""

    def __init__(self, n_kept: int) -> None:
        self._n_kept = n_kept
        self._results: OrderedDict[str, Future[Value]] = OrderedDict()
        self._lock = threading.Lock()

    def begun(self, key: str) -> Future[Value] | None:
        """The result of a key, there or being made; None if it is neither."""
        with self._lock:
            if key in self._results:
                self._results.move_to_end(key)
            return self._results.get(key)

    def get(self, key: str, make: Callable[[], Value]) -> Value:
        """The result of a key, made in this thread if it is not there; a failure is told to all who wait, not kept."""
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
