"""How fast the synthetic studio records: `python bench/capture.py`.

Full HD, three sensors, everything included: rendering, noise, PNG, depth, masks, meshes. A sensor frame is a left and
a right picture. `steady` leaves out what is done once per capture (bodies, plates) by comparing a longer and a shorter
recording; processor time is what other work on the machine disturbs least.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

from recon.studio import SCENES, SynthParameters, synthesise

SIZE = (1920, 1080)
N_SENSORS = 3
BAR_PER_S = 5.0  # sensor frames on two cores


def seconds(scene: str, n_frames: int, size: tuple[int, int]) -> tuple[float, float]:
    """Wall and processor time of one recording, s."""
    with tempfile.TemporaryDirectory() as folder:
        wall, processor = time.perf_counter(), time.process_time()
        synthesise(Path(folder) / "out", SynthParameters(scene, n_sensors=N_SENSORS, n_frames=n_frames, size=size))
        return time.perf_counter() - wall, time.process_time() - processor


def measure(scene: str, n_frames: int) -> dict[str, float | str]:
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


def main() -> None:
    """Measure every scene and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default=",".join(SCENES), help="comma between")
    parser.add_argument("--frames", type=int, default=12, help="frames of the longer recording, less two")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    arguments = parser.parse_args()
    rows = [measure(scene, arguments.frames) for scene in arguments.scenes.split(",")]
    if arguments.json:
        print(json.dumps({"cores": os.cpu_count(), "bar_per_s": BAR_PER_S, "studio": rows}))
        return
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; the bar is {BAR_PER_S:g} sensor frames/s")
    print("  ".join(rows[0]))
    for row in rows:
        print("  ".join(f"{value!s:>{len(name)}}" for name, value in row.items()))


if __name__ == "__main__":
    main()
