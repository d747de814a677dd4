"""Tasks give the same results here and in worker processes."""

from __future__ import annotations

import math
from functools import partial

import pytest

from recon.execute import run_tasks

TASKS = [partial(math.factorial, n) for n in range(6)]


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_every_task_yields_its_result_once(workers: int) -> None:
    assert sorted(run_tasks(TASKS, workers=workers)) == [1, 1, 2, 6, 24, 120]


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_tasks_error_reaches_the_caller(workers: int) -> None:
    with pytest.raises(ValueError, match="factorial"):
        list(run_tasks([*TASKS, partial(math.factorial, -1)], workers=workers))


def test_no_workers_is_an_error() -> None:
    with pytest.raises(ValueError, match="at least 1, found 0"):
        list(run_tasks(TASKS, workers=0))
