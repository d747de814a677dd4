"""How much faster two workers match and render than one, when each task uses one thread.

    python bench/cluster.py [--frames 8] [--size 640x480] [--seconds 8] [--repeats 3] [--json]

The same tasks run on one and on two local processes, and on a Dask cluster of one and of two workers, in turn; a pool
is warm (modules loaded, kernels compiled) before its clock starts. Prints the median of seconds and of the speed-ups of
neighbouring runs, and checks that all wrote the same bytes. Run it on a machine that does nothing else: where other
programs take a core, two workers cannot be twice as fast.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from distributed import LocalCluster

from recon.artefacts import file_digest
from recon.capture.format import Capture, read_capture
from recon.execute import LocalProcesses, Pool, open_pool
from recon.flythrough import Film, RenderOptions, make_part
from recon.options import parse_size
from recon.pipeline import ReconstructOptions, reconstruct
from recon.products import match_frame
from recon.run import read_run
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
    views = [(stream.id, frame) for frame in range(capture.n_frames) for stream in capture.sensors]
    return [partial(match_frame, capture, folder, "id", *view) for view in views]


def rendering(run: Path, options: RenderOptions, folder: Path) -> list[partial[Any]]:
    found = read_run(run)
    films = [Film(found, approach, options) for approach in found.approaches]
    return [partial(make_part, film, folder, part, threads=1) for film in films for part in film.parts]


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
                    seconds(pool, tasks_in(folder / "warm")[: 2 * n_workers])
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
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--size", type=parse_size, default=(640, 480))
    parser.add_argument("--seconds", type=float, default=8.0, help="of each video, in parts of two")
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
        stages = {
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
