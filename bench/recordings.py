"""Which faults of recordings `capture check` finds, and how often it finds one where there is none.

    python bench/recordings.py [--scenes ball,box,people,standing] [--seeds 2] [--size 640x480] [--good N] [--json]
    python bench/recordings.py --real ../shared/data

Recordings of the studio by three sensors, with masks as `capture segment` makes them. Each gets one fault at a time: a
sensor late by a quarter to three frames, pictures swapped, a wrong baseline sign, a wrong lens, one to three rows,
unrelated pictures, overexposure, masks missing. A fault is found, "could not be checked", or missed. Good recordings
are plain, and with the imperfections of good cameras: noise, casts, vignetting, JPEG, a shutter of 5 ms; `--good` adds
so many of each scene alone. With `--real`, the temple, the sphere, Teddy, Cloth and Tsukuba are taken, the same faults
put into them; a fault counts where it is new. Good ones are they with less light, noise and JPEG.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent))

from recon.capture.checking.check import check_capture
from recon.capture.format import (
    CameraStream,
    Capture,
    SensorStream,
    frame_pictures,
    image_path,
    read_capture,
    write_capture,
)
from recon.capture.images import read_image, write_picture
from recon.capture.importing.json_file import import_json
from recon.capture.importing.middlebury import import_middlebury
from recon.capture.importing.sources import ImportOptions
from recon.capture.masks.segment import segment_capture
from recon.geometry.rig import Camera
from recon.studio import SynthParameters, synthesise
from tests.recon.capture.checking.faults import FAULTS, FAULTY, MISSED, excerpt, false_alarms, lag, plain, swapped

QUARTERS = 4  # recorded frames to one of a film
N_FRAMES = 24
SHOTS = 4
MOST_ALARMS, FEWEST_FOUND = 0.02, 0.95
PAIRS = {  # files, a focal length, and disparities between which the pair lies, pixels
    "teddy": (("im2.png", "im6.png"), 800.0, (12.0, 54.0)),
    "Cloth3": (("view1.png", "view5.png"), 1200.0, (20.0, 95.0)),
    "tsukuba": (("im3.png", "im4.png"), 600.0, (4.0, 15.0)),
}
PAIR_BASELINE = 160.0  # mm
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
    yield from good_ones(folder, scene, 1, size, seed)


def good_ones(folder: Path, scene: str, count: int, size: tuple[int, int], first: int = 1) -> Iterator[tuple[str, str]]:
    """Yield what is said of recordings without a fault."""
    for seed in range(first, first + count):
        for name, imaging in LENSES.items():
            capture = recorded(folder / f"{name}{seed}", scene, seed + 100, size, SHOTS, **imaging)
            yield f"none: {name}", "; ".join(false_alarms(check_capture(capture.folder))) or "nothing"


def real_recordings(data: Path, folder: Path) -> Iterator[Capture]:
    """Import the real recordings, of which one sensor is S2."""
    temple = import_middlebury(data / "temple", folder / "temple", n_frames=3)
    yield segment_capture(temple.folder)
    bounds = np.array([[-700.0, -400, -7300], [800, 550, -4700]])
    ball = import_json(data / "sphere/calibration.json", folder / "sphere", ImportOptions(bounds=bounds))
    write_capture(replace(ball, sensors=(replace(ball.sensors[0], id=FAULTY),)))
    yield read_capture(ball.folder)
    for name, (files, focal, disparities) in PAIRS.items():
        yield _pair(folder / name, [data / "stereo_pairs" / name / file for file in files], focal, disparities)


def _pair(folder: Path, files: list[Path], focal: float, disparities: tuple[float, float]) -> Capture:
    """Make a recording of a rectified pair; its focal length is a guess, as its benchmark tells none."""
    pixels = [read_image(file) for file in files]
    height, width = pixels[0].shape[:2]
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    streams = []
    for side, x in (("left", 0.0), ("right", PAIR_BASELINE)):
        pose = np.diag([1.0, -1, -1, 1])
        pose[0, 3] = -x
        streams.append(CameraStream(Camera(K, (width, height), pose), f"{FAULTY}/{side}/{{frame:04d}}.png"))
    near, far = (focal * PAIR_BASELINE / disparity for disparity in reversed(disparities))
    across = np.array([width, height]) / focal / 2 * far
    bounds = np.array([[-across[0], -across[1], -far], [across[0], across[1], -near]])
    capture = Capture(
        folder, folder.name, "scene", 25.0, 1, bounds, {}, (SensorStream(FAULTY, streams[0], streams[1]),)
    )
    for stream, picture in zip(streams, pixels, strict=True):
        write_picture(image_path(folder, stream.image, 0), picture)
    write_capture(capture)
    return capture


def changed(base: Capture, out: Path, change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Capture:
    """Write a recording whose pictures, 0 to 255, are changed."""
    capture = excerpt(base, out, list(range(base.n_frames)))
    for stream in capture.sensors:
        for frame in range(capture.n_frames):
            for picture in frame_pictures(capture.folder, stream, frame):
                pixels = read_image(picture.path).astype(np.float64)
                picture.path.unlink()
                write_picture(picture.path, np.clip(np.rint(change(pixels)), 0, 255).astype(np.uint8))
    return capture


def _jpeg(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    packed = cv2.imencode(".jpg", pixels.astype(np.uint8), (cv2.IMWRITE_JPEG_QUALITY, 90))[1]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.float64)


def real_matrix(base: Capture, folder: Path) -> Iterator[tuple[str, str]]:
    """Yield a fault and its verdict, for the faults that a real recording can have."""
    rng = np.random.default_rng(0)
    n, several = base.n_frames, len(base.sensors) > 1
    base = excerpt(base, folder / "base", list(range(n)))
    before = check_capture(base.folder)
    known = (*before.problems, *before.warnings)
    print(f"{base.name}: as it is: {'; '.join(known) or 'nothing'}", file=sys.stderr)
    for name, change in {
        "darker": lambda pixels: pixels * 0.8,
        "noisy": lambda pixels: pixels + rng.normal(0, 2, pixels.shape),
        "JPEG": _jpeg,
    }.items():
        capture = changed(base, folder / name, change)
        alarms = {*map(plain, false_alarms(check_capture(capture.folder)))} - {*map(plain, known)}
        yield f"none: {name}", "; ".join(alarms) or "nothing"
    faults = [fault for fault in FAULTS if not fault.name.startswith(("shots", "masks"))]
    faults += [swapped(range(n), "S2.*(swapped|order of left)")]
    faults += [swapped(range(1, 2), "S2: left and right are swapped in frame 1")] * (n > 1)
    faults += [fault for fault in FAULTS if fault.name.startswith("masks") and several]
    for number, fault in enumerate(faults):
        capture = excerpt(base, folder / f"fault{number}", list(range(n)))
        fault.put(capture)
        yield fault.name.replace(f"0 to {n - 1}", "all"), fault.verdict(check_capture(capture.folder), known)
    if several:
        capture = excerpt(base, folder / "late", list(range(n)), {FAULTY: 1})
        yield lag(QUARTERS).name, lag(QUARTERS).verdict(check_capture(capture.folder))


def main() -> None:
    """Print the matrix, and the shares that count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default="ball,box,people,standing")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--good", type=int, default=0)
    parser.add_argument("--real", type=Path)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    width, height = map(int, asked.size.split("x"))
    verdicts: dict[str, Counter[str]] = {}

    def add(place: str, rows: Iterator[tuple[str, str]]) -> None:
        for fault, verdict in rows:
            verdicts.setdefault(fault, Counter())[verdict] += 1
            print(f"{place}: {fault}: {verdict}", file=sys.stderr, flush=True)

    if asked.real:
        with tempfile.TemporaryDirectory() as folder:
            for base in real_recordings(asked.real, Path(folder)):
                add(base.name, real_matrix(base, Path(folder) / f"{base.name}_faults"))
    for scene in asked.scenes.split(",") if not asked.real else ():
        for seed in range(1, asked.seeds + 1):
            with tempfile.TemporaryDirectory() as folder:
                add(f"{scene} {seed}", matrix(Path(folder), scene, seed, (width, height)))
        with tempfile.TemporaryDirectory() as folder:
            add(scene, good_ones(Path(folder), scene, asked.good, (width, height)))
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
