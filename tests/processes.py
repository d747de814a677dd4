"""Killing processes and waiting for their end."""

from __future__ import annotations

import os
import select
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

END_TIMEOUT_S = 60


def kill(*pids: int) -> None:
    """Kill processes, in this order; none of them runs when this returns."""
    with until_ended(*pids):
        for pid in pids:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


@contextmanager
def until_ended(*pids: int) -> Iterator[None]:
    """Wait at the end of the block until none of these processes runs any more."""
    ends = []
    for pid in pids:
        with suppress(ProcessLookupError):
            ends.append(os.pidfd_open(pid))
    try:
        yield
        for end in ends:
            if not select.select([end], [], [], END_TIMEOUT_S)[0]:
                raise RuntimeError(f"one of the processes {pids} did not end within {END_TIMEOUT_S} s")
    finally:
        for end in ends:
            os.close(end)
