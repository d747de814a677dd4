"""Tasks give the same results here, in worker processes and on a cluster, also when workers die."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from itertools import count
from pathlib import Path

import pytest

from recon.runtime.workers import LOSSES, LocalProcesses, open_pool
from tests.processes import kill, until_ended

TASKS = [partial(math.factorial, n) for n in range(6)]


def die_once(mark: Path) -> str:
    """Kill the process that runs this, the first time."""
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "alive"


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_every_task_yields_its_result_once_and_a_pool_takes_more_tasks(workers: int) -> None:
    with open_pool(workers) as pool:
        for _ in range(2):
            assert sorted(pool.run(TASKS)) == [1, 1, 2, 6, 24, 120]
        assert list(pool.run([])) == []


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_tasks_error_reaches_the_caller(workers: int) -> None:
    with open_pool(workers) as pool, pytest.raises(ValueError, match="factorial"):
        list(pool.run([*TASKS, partial(math.factorial, -1)]))


@pytest.mark.slow
def test_the_tasks_of_a_worker_that_dies_are_run_again(tmp_path: Path) -> None:
    with open_pool(2) as pool:
        results = list(pool.run([*TASKS, partial(die_once, tmp_path / "mark")]))
    assert sorted(map(str, results)) == ["1", "1", "120", "2", "24", "6", "alive"]


@pytest.mark.slow
def test_a_worker_that_dies_between_two_runs_is_replaced() -> None:
    pool = LocalProcesses(2)
    kill(*pool.run([partial(os.getpid)]))
    with pytest.raises(BrokenProcessPool):  # as soon as the executor has noticed
        all(pool._executor.submit(os.getpid).result() for _ in count())
    assert sorted(pool.run(TASKS)) == [1, 1, 2, 6, 24, 120]
    pool.close()


@pytest.mark.slow
def test_tasks_that_kill_their_workers_again_and_again_are_given_up() -> None:
    pool = LocalProcesses(1)
    with pytest.raises(RuntimeError, match=f"died {LOSSES} times, 1 tasks are not done"):
        list(pool.run([partial(die)]))
    pool.close()


PROGRAM = """
import cv2
import numba  # before the workers are told of their threads: they load this program, too
from functools import partial
from recon.runtime.workers import open_pool
@numba.njit  # numba reads its environment again when it compiles
def double(number):
    return 2 * number
def doubled(number):
    return double(number)
if __name__ == "__main__":
    with open_pool(2) as pool:
        print(*pool.run([partial(numba.get_num_threads), partial(cv2.getNumThreads)]), *pool.run([partial(doubled, 4)]))
"""


@pytest.mark.slow
def test_a_worker_uses_one_thread_whatever_the_main_program_has_loaded(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    done = subprocess.run([sys.executable, program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, ["1", "1", "8"]), done.stderr


WAITING = """
import os
import signal
import time
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from recon.runtime.workers import open_pool
def wait(folder, number):
    (folder / str(number)).write_text(str(os.getpid()))
    time.sleep(60)
if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with open_pool(2) as pool:
        list(pool.run([partial(wait, Path(__file__).parent, number) for number in range(6)]))
"""


@pytest.mark.slow
def test_an_interrupt_ends_all_tasks_at_once(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(WAITING)
    process = subprocess.Popen([sys.executable, program], stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        while len(list(tmp_path.iterdir())) < 3:  # the program, and a file of each of two tasks
            assert process.poll() is None
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does it
        _, told = process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    assert "KeyboardInterrupt" in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0", "1", "program.py"]


@pytest.mark.slow
def test_workers_end_with_the_process_that_is_killed(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(WAITING)
    process = subprocess.Popen([sys.executable, program], stderr=subprocess.DEVNULL)
    try:
        while not all((tmp_path / name).exists() and (tmp_path / name).read_text() for name in "01"):
            assert process.poll() is None
            time.sleep(0.05)
        workers = [int((tmp_path / name).read_text()) for name in "01"]
    finally:
        process.kill()
        process.wait()
    with until_ended(*workers):
        pass


def test_no_workers_is_an_error() -> None:
    with pytest.raises(ValueError, match="at least 1, found 0"), open_pool(0):
        pass
