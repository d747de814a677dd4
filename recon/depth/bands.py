"""Share work between threads: kernels release the interpreter's lock, and each writes its own rows or columns.

As many threads are used as numba may (`NUMBA_NUM_THREADS`, `numba.set_num_threads`). No result depends on their number.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import numba
import numpy as np

Result = TypeVar("Result")


def in_bands(length: int, work: Callable[[int, int], None]) -> None:
    """Call `work(first, last)` for bands of the rows or columns 0 to `length`, one band for each thread."""
    edges = np.linspace(0, length, numba.get_num_threads() + 1).astype(int).tolist()
    with ThreadPoolExecutor(max_workers=len(edges) - 1) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))


def in_both(work: Callable[[int], Result]) -> tuple[Result, Result]:
    """Call `work` for the left view (0) and the right (1), at the same time if there are two threads."""
    with ThreadPoolExecutor(max_workers=min(numba.get_num_threads(), 2)) as pool:
        left, right = pool.map(work, (0, 1))
    return left, right
