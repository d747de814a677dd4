"""How fast the synthetic studio records, and how well recordings are calibrated and segmented.

    python bench/capture.py [studio|calibration|segmentation]... [--scenes ball,box] [--seeds 3] [--project] [--json]

Studio: full HD, three sensors, everything included: rendering, noise, PNG, depth, masks, meshes. A sensor frame is a
left and a right picture. `steady` leaves out what is done once per capture (bodies, plates) by comparing a longer and a
shorter recording; processor time is what other work on the machine disturbs least. Calibration and segmentation: see
`bench/calibration.py`.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from calibration import BOARDS, calibration_row, segmentation_rows

from recon.studio import SCENES, SynthParameters, synthesise

Row = dict[str, float | str]
SIZE = (1920, 1080)
N_SENSORS = 3
ACTED = ("ball", "box", "people", "standing", "face")
BARS = {
    "studio": "at least 5 sensor frames a second on two cores",
    "calibration": "focal length and baseline within 0.2 %, rotations within 0.05 degrees",
    "segmentation": "mean intersection over union at least 0.97 by plate, 0.95 by scribbles",
}


def seconds(scene: str, n_frames: int, size: tuple[int, int]) -> tuple[float, float]:
    """Wall and processor time of one recording, s."""
    with tempfile.TemporaryDirectory() as folder:
        wall, processor = time.perf_counter(), time.process_time()
        synthesise(Path(folder) / "out", SynthParameters(scene, n_sensors=N_SENSORS, n_frames=n_frames, size=size))
        return time.perf_counter() - wall, time.process_time() - processor


def studio_row(scene: str, n_frames: int) -> Row:
    """Rates of one scene."""
    seconds(scene, 1, (160, 120))  # compiles
    short_wall, short_processor = seconds(scene, 2, SIZE)
    wall, processor = seconds(scene, 2 + n_frames, SIZE)
    n_more, n_all = N_SENSORS * n_frames, N_SENSORS * (2 + n_frames)
    return {
        "scene": scene,
        "sensor_frames_per_s": round(n_all / wall, 2),
        "steady_per_s": round(n_more / (wall - short_wall), 2),
        "steady_processor_s": round((processor - short_processor) / n_more, 3),
        "per_s_on_two_free_cores": round(2 * n_more / (processor - short_processor), 2),
    }


def rows_of(part: str, arguments: argparse.Namespace) -> Iterator[Row]:
    """The figures of one part, as they are measured."""
    scenes = arguments.scenes.split(",") if arguments.scenes else None
    if part == "studio":
        yield from (studio_row(scene, arguments.frames) for scene in scenes or SCENES)
    elif part == "calibration":
        for board in arguments.boards.split(","):
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                yield calibration_row(board, seed, is_drawn=not arguments.project)
    else:
        for scene in scenes or ACTED:
            yield from segmentation_rows(scene)


def show(part: str, rows: Iterable[Row]) -> None:
    """Print a table, row by row."""
    print(f"{part}; the bar: {BARS[part]}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}", flush=True)
    for number, row in enumerate(rows):
        if number == 0:
            print("  ".join(row))
        print("  ".join(f"{value!s:>{len(name)}}" for name, value in row.items()), flush=True)


def main() -> None:
    """Measure what is asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"out of {', '.join(BARS)}; all of them by default")
    parser.add_argument("--scenes", help="of the studio or of segmentation, comma between")
    parser.add_argument("--frames", type=int, default=12, help="frames of the longer recording, less two")
    parser.add_argument("--boards", default=",".join(BOARDS), help="comma between")
    parser.add_argument("--seeds", type=int, default=3, help="rigs that are calibrated by each board")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--project", action="store_true", help="corners without pictures, to try many seeds")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    arguments = parser.parse_args()
    if unknown := set(arguments.parts) - BARS.keys():
        parser.error(f"there is no part {', '.join(sorted(unknown))}; expected {', '.join(BARS)}")
    parts = arguments.parts or list(BARS)
    if arguments.json:
        print(json.dumps({"cores": os.cpu_count(), "bars": BARS} | {p: list(rows_of(p, arguments)) for p in parts}))
        return
    for part in parts:
        show(part, rows_of(part, arguments))


if __name__ == "__main__":
    main()
