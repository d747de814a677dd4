"""Which faults of recordings `capture check` finds, and how often it finds one where there is none.

    python bench/recordings.py [--scenes ball,box,people,standing] [--seeds 2] [--size 640x480] [--json]

Recordings of the studio by three sensors, with masks as `capture segment` makes them. Each gets one fault at a time: a
sensor late by a quarter to three frames, pictures swapped, a wrong baseline sign, a wrong lens, one to three rows,
unrelated pictures, overexposure, masks missing. A fault is found, "could not be checked", or missed. Good recordings
are plain, and with the imperfections of good cameras: noise, casts, vignetting, JPEG, a shutter of 5 ms.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

from recon.capture.checking.check import check_capture
from recon.capture.format import Capture
from recon.capture.masks.segment import segment_capture
from recon.studio import SynthParameters, synthesise
from tests.recon.capture.checking.faults import FAULTS, FAULTY, MISSED, excerpt, false_alarms, lag

QUARTERS = 4  # recorded frames to one of a film
N_FRAMES = 24
SHOTS = 4
MOST_ALARMS, FEWEST_FOUND = 0.02, 0.95
LENSES = {
    "plain": {},
    "imperfect": {"colour_cast": 0.05, "vignetting": 0.3, "compression": 92, "shutter_ms": 5.0, "distortion": -0.1},
}


def recorded(folder: Path, scene: str, seed: int, size: tuple[int, int], n_frames: int, **imaging: object) -> Capture:
    """Record a scene, and make its masks."""
    synthesise(folder, SynthParameters(scene, 3, n_frames, size, seed=seed, **imaging))  # type: ignore[arg-type]
    return segment_capture(folder)


def matrix(folder: Path, scene: str, seed: int, size: tuple[int, int]) -> Iterator[tuple[str, str]]:
    """Yield a fault and its verdict, for all faults and for recordings without one."""
    quarters = QUARTERS * N_FRAMES
    base = recorded(folder / "base", scene, seed, size, quarters)
    film, shots = list(range(0, quarters, QUARTERS)), list(range(0, quarters, quarters // SHOTS))
    for late in range(13):
        report = check_capture(excerpt(base, folder / f"late{late}", film, {FAULTY: late}).folder)
        if late:
            yield lag(late).name, lag(late).verdict(report)
        else:
            yield "none: film", "; ".join(false_alarms(report)) or "nothing"
    for number, fault in enumerate(FAULTS):
        capture = excerpt(base, folder / f"fault{number}", shots)
        fault.put(capture)
        yield fault.name, fault.verdict(check_capture(capture.folder))
    for name, imaging in LENSES.items():
        capture = recorded(folder / name, scene, seed + 100, size, SHOTS, **imaging)
        yield f"none: {name}", "; ".join(false_alarms(check_capture(capture.folder))) or "nothing"


def main() -> None:
    """Print the matrix, and the shares that count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default="ball,box,people,standing")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    width, height = map(int, asked.size.split("x"))
    verdicts: dict[str, Counter[str]] = {}
    for scene in asked.scenes.split(","):
        for seed in range(1, asked.seeds + 1):
            with tempfile.TemporaryDirectory() as folder:
                for fault, verdict in matrix(Path(folder), scene, seed, (width, height)):
                    verdicts.setdefault(fault, Counter())[verdict] += 1
                    print(f"{scene} {seed}: {fault}: {verdict}", file=sys.stderr, flush=True)
    good = {fault: counts for fault, counts in verdicts.items() if fault.startswith("none")}
    faults = {fault: counts for fault, counts in verdicts.items() if fault not in good}
    n_faults, n_missed = (sum(map(of, faults.values())) for of in (Counter.total, lambda counts: counts[MISSED]))
    n_good, n_quiet = (sum(map(of, good.values())) for of in (Counter.total, lambda counts: counts["nothing"]))
    if asked.json:
        print(json.dumps({"faults": faults, "good": good}))
        return
    for fault, counts in verdicts.items():
        print(f"{fault}: " + ", ".join(f"{verdict} {n}" for verdict, n in counts.most_common()))
    print(f"found or could not be checked: {1 - n_missed / n_faults:.1%} of {n_faults}, at least {FEWEST_FOUND:.0%}")
    print(f"false alarms: {1 - n_quiet / n_good:.1%} of {n_good}, at most {MOST_ALARMS:.0%}")


if __name__ == "__main__":
    main()
