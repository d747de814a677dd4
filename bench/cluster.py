"""How much faster two workers match and render than one, when each task uses one thread.

    python bench/cluster.py [--frames 10] [--size 1280x720] [--seconds 2] [--repeats 3] [--json]

The same tasks run on one and on two local processes, and on a Dask cluster of one and of two workers, in turn; a pool
is warm (modules loaded, kernels compiled) before its clock starts. Prints the median of seconds and of the speed-ups of
neighbouring runs, and checks that all wrote the same bytes. Each worker has a core of its own, or one would encode its
video on the other. Arithmetic that needs no memory tells what the machine gives at most: where other programs take a
core, two workers cannot be twice as fast.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from distributed import LocalCluster

from recon.capture.format import Capture, read_capture
from recon.cli.options import parse_size
from recon.pipeline.film import Film, RenderOptions, make_part
from recon.pipeline.job import ReconstructOptions, planned_job
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.run import read_run
from recon.pipeline.sources import run_source
from recon.pipeline.stages import match_stretch, measure_rows
from recon.runtime.artefacts import file_digest
from recon.runtime.workers import LocalProcesses, Pool, open_pool
from recon.studio import SynthParameters, synthesise

Tasks = Callable[[Path], Sequence[partial[Any]]]
"""The tasks of a stage, given the folder into which they write."""


@contextmanager
def local(n_workers: int) -> Iterator[Pool]:
    pool = LocalProcesses(n_workers)
    try:
        yield pool
    finally:
        pool.close()


@contextmanager
def dask(n_workers: int) -> Iterator[Pool]:
    options = {"threads_per_worker": 1, "processes": True, "dashboard_address": ":0", "silence_logs": 50}
    with LocalCluster(n_workers=n_workers, **options) as cluster, open_pool(cluster=cluster.scheduler_address) as pool:
        yield pool


POOLS = {"local processes": local, "Dask": dask}


def matching(capture: Capture, folder: Path) -> list[partial[Any]]:
    job = planned_job(capture, folder, ReconstructOptions(depths=("id",)))
    for sensor in job.matched_sensors:
        measure_rows(job, sensor)
    return [partial(match_stretch, job, stretch) for stretch in job.stretches]


def rendering(run: Path, options: RenderOptions, folder: Path) -> list[partial[Any]]:
    source = run_source(read_run(run))
    films = [Film(sequence, source.setting, options) for sequence in source.sequences]
    return [partial(make_part, film, folder, part, threads=1) for film in films for part in film.parts]


def arithmetic(folder: Path) -> list[partial[Any]]:
    """Tasks that share nothing, not even memory: what two cores of this machine give at most."""
    return [partial(add_up, folder / f"{number}", 1_500_000) for number in range(20)]


def add_up(file: Path, n: int) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(str(sum(range(n)) + sum(number * number for number in range(n))))


def warm(task: partial[Any], meeting: Path, n_workers: int) -> None:
    """Run a task, wait for as many workers as there are, so that none does it for all, and take a core each."""
    task()
    meeting.mkdir(parents=True, exist_ok=True)
    (meeting / str(os.getpid())).touch()
    while len(workers := sorted(int(file.name) for file in meeting.iterdir())) < n_workers:
        time.sleep(0.01)
    os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[workers.index(os.getpid())]})


def seconds(pool: Pool, tasks: Sequence[partial[Any]]) -> float:
    started = time.perf_counter()
    for _ in pool.run(tasks):
        pass
    return time.perf_counter() - started


def digests(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file() and ".finished" not in path.parts)
    return {str(path.relative_to(folder)): file_digest(path) for path in files}


def measure(tasks_in: Tasks, new_pool: Callable[[int], Any], n_repeats: int) -> dict[str, Any]:
    """Seconds of one and of two workers, and how much faster two were."""
    times: dict[int, list[float]] = {1: [], 2: []}
    made = []
    with tempfile.TemporaryDirectory() as name:
        for repeat in range(n_repeats):
            for n_workers in times:
                folder = Path(name) / f"{repeat} {n_workers}"
                with new_pool(n_workers) as pool:
                    tasks = tasks_in(folder / "warm")[:n_workers]
                    seconds(pool, [partial(warm, task, folder / "meeting", n_workers) for task in tasks])
                    times[n_workers].append(seconds(pool, tasks_in(folder / "made")))
                made.append(digests(folder / "made"))
    assert all(one == made[0] for one in made), "one and two workers wrote different bytes"
    speed_ups = [one / two for one, two in zip(*times.values(), strict=True)]
    return {
        "tasks": len(tasks_in(Path())),
        "one_s": round(median(times[1]), 2),
        "two_s": round(median(times[2]), 2),
        "speed_up": round(median(speed_ups), 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--size", type=parse_size, default=(1280, 720))
    parser.add_argument("--seconds", type=float, default=2.0, help="of each video")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory() as name:
        top = Path(name)
        parameters = SynthParameters(scene="ball", n_sensors=2, n_frames=arguments.frames, size=arguments.size)
        synthesise(top / "ball", parameters)
        reconstruct(top / "ball", top / "run", ReconstructOptions(depths=("id",), frames=range(2)))
        shown = RenderOptions(size=arguments.size, seconds=arguments.seconds, renderer="software")
        stages: dict[str, Tasks] = {
            "arithmetic": arithmetic,
            "matching": partial(matching, read_capture(top / "ball")),
            "rendering": partial(rendering, top / "run", shown),
        }
        for where, new_pool in POOLS.items():
            for stage, tasks_in in stages.items():
                row = results[f"{stage}, {where}"] = measure(tasks_in, new_pool, arguments.repeats)
                if not arguments.json:
                    print(f"{stage + ', ' + where:28}", ", ".join(f"{what} {value}" for what, value in row.items()))
    if arguments.json:
        print(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
