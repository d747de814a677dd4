"""Which faults of recordings `capture check` finds, and how often it finds one where there is none.

    python bench/recordings.py [--scenes ball,box,people,standing] [--seeds 1-2] [--size 320x240] [--good 1-9]
    python bench/recordings.py --real ../shared/data [--kept F]

Recordings of the studio by three sensors, with masks as `capture segment` makes them. Each gets one fault at a time: a
sensor late by a quarter to three frames, pictures swapped, a wrong baseline sign, a wrong lens, one to three rows,
unrelated pictures, overexposure, masks missing. A fault is found, "could not be checked", or missed. `--good` records
good ones by number, each drawn anew: two to four sensors, films and shots, any scene, noise, exposures, casts,
vignetting, flicker, JPEG, a shutter, distortion and errors of the calibration as good cameras have them. With `--real`,
the temple, the sphere, Teddy, Cloth and Tsukuba are taken, the same faults put into them; a fault counts where it is
new. Good ones are they with less light, noise and JPEG. Verdicts are kept in a file, with which a next run goes on.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent.parent))

from recon.capture.checking.check import CheckReport, check_capture
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
from tests.recon.capture.checking.faults import (
    FAULTS,
    FAULTY,
    MISSED,
    UNCHECKED,
    Fault,
    excerpt,
    false_alarms,
    lag,
    plain,
    swapped,
)

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
SCENES = ("ball", "box", "people", "standing", "face")
CHECKS = {"instants": "same instants", "a calibration": "its calibration", "lenses": "of its lenses is right"}
ALIKE = ("ball", "box", "people", "standing")  # seen by three sensors as people are

Cells = Iterator[tuple[str, Callable[[], str]]]
"""What is put into a recording, or "none" and a word, and what tells the verdict of the check."""


def recorded(folder: Path, parameters: SynthParameters) -> Capture:
    """Record a scene, and make its masks."""
    synthesise(folder, parameters)
    return segment_capture(folder)


def matrix(folder: Path, scene: str, seed: int, size: tuple[int, int]) -> Cells:
    """Yield all faults of one recording, and none; it is made when the first is asked for."""
    quarters = QUARTERS * N_FRAMES
    film, shots = list(range(0, quarters, QUARTERS)), list(range(0, quarters, quarters // SHOTS))
    base = cache(lambda: recorded(folder / "base", SynthParameters(scene, 3, quarters, size, seed=seed)))

    def checked(fault: Fault, frames: list[int], late: int = 0) -> CheckReport:
        capture = excerpt(base(), folder / fault.name, frames, {FAULTY: late})
        fault.put(capture)
        return check_capture(capture.folder)

    yield "none: film", lambda: _alarms(checked(lag(0), film))
    for late in range(1, 13):
        yield lag(late).name, partial(lambda late: lag(late).verdict(checked(lag(late), film, late)), late)
    for fault in FAULTS:
        yield fault.name, partial(lambda fault: fault.verdict(checked(fault, shots)), fault)


def good_ones(folder: Path, numbers: range, size: tuple[int, int]) -> Cells:
    """Yield recordings without a fault, each drawn by its number, and then what could not be checked of it."""

    @cache
    def checked(number: int) -> CheckReport:
        return check_capture(_good(folder / f"{number}", number, size).folder)

    for number in numbers:
        yield f"none: {number}", partial(lambda n: _alarms(checked(n)), number)
        yield f"unchecked: {number}", partial(lambda n: _unchecked(checked(n)), number)


def _good(folder: Path, number: int, size: tuple[int, int]) -> Capture:
    rng = np.random.default_rng((58, number))
    drawn = SynthParameters(
        str(rng.choice(SCENES)), int(rng.integers(2, 5)), int(rng.choice((1, 4, 13))), size, seed=1000 + number,
        noise=rng.uniform(0.3, 3.0), exposure_spread=rng.uniform(0, 0.03), calibration_error_px=rng.uniform(0, 0.1),
        distortion=rng.uniform(-0.2, 0.1), colour_cast=rng.uniform(0, 0.04), vignetting=rng.uniform(0, 0.3),
        flicker=rng.uniform(0, 0.02), shutter_ms=rng.uniform(0, 5), gloss=rng.uniform(0, 1.5),
        compression=(None, 85, 92, 97)[rng.integers(4)],
    )  # fmt: skip
    return recorded(folder, drawn)


def _alarms(report: CheckReport) -> str:
    return "; ".join(false_alarms(report)) or "nothing"


def _unchecked(report: CheckReport) -> str:
    sentences = [text for text in (*report.warnings, *report.verdicts) if UNCHECKED in text]
    return ", ".join(name for name, words in CHECKS.items() if any(words in text for text in sentences)) or "nothing"


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


def real_matrix(base: Capture, folder: Path) -> Cells:
    """Yield the faults that a real recording can have, and none."""
    frames, several = list(range(base.n_frames)), len(base.sensors) > 1
    before = cache(lambda: check_capture(excerpt(base, folder / "as it is", frames).folder))

    def known() -> tuple[str, ...]:
        return (*before().problems, *before().warnings)

    def good(name: str) -> str:
        alarms = false_alarms(check_capture(changed(base, folder / name, CHANGES[name]).folder))
        return "; ".join({*map(plain, alarms)} - {*map(plain, known())}) or "nothing"

    def verdict(fault: Fault, late: int = 0) -> str:
        capture = excerpt(base, folder / fault.name, frames, {FAULTY: late})
        fault.put(capture)
        return fault.verdict(check_capture(capture.folder), known())

    for name in CHANGES:
        yield f"none: {name}", partial(good, name)
    faults = [fault for fault in FAULTS if not fault.name.startswith("shots")]
    faults += [replace(swapped(range(len(frames)), "S2.*(swapped|order of left)"), name="all shots swapped")]
    faults += [swapped(range(1, 2), "S2: left and right are swapped in frame 1")] * (len(frames) > 1)
    for fault in faults:
        if several or not fault.name.startswith("masks"):
            yield fault.name, partial(verdict, fault)
    if several:
        yield lag(QUARTERS).name, partial(verdict, lag(QUARTERS), 1)


CHANGES = {
    "darker": lambda pixels: pixels * 0.8,
    "noisy": lambda pixels: pixels + np.random.default_rng(0).normal(0, 2, pixels.shape),
    "JPEG": _jpeg,
}


@dataclass(frozen=True)
class Kept:
    """Verdicts by recording and fault, in memory and, if there is one, in a file of a line of JSON each."""

    verdicts: dict[tuple[str, str], str]
    file: Path | None

    @classmethod
    def read(cls, file: Path | None) -> Kept:
        """Read those of a run before."""
        lines = file.read_text().splitlines() if file is not None and file.exists() else []
        return cls({(place, fault): verdict for place, fault, verdict in map(json.loads, lines)}, file)

    def add(self, place: str, cells: Cells) -> None:
        """Judge what is not known yet."""
        for fault, verdict in cells:
            if (place, fault) in self.verdicts:
                continue
            told = self.verdicts[place, fault] = verdict()
            print(f"{place}: {fault}: {told}", file=sys.stderr, flush=True)
            if self.file is not None:
                with self.file.open("a") as file:
                    file.write(json.dumps([place, fault, told]) + "\n")

    def told(self) -> Iterator[str]:
        """Say each fault's verdicts, and the shares that count."""
        by_fault: dict[str, Counter[str]] = {}
        for (_, fault), verdict in self.verdicts.items():
            name = fault.partition(":")[0]
            by_fault.setdefault(name, Counter())[verdict] += 1
        for fault, counts in by_fault.items():
            yield f"{fault}: " + ", ".join(f"{verdict} {n}" for verdict, n in counts.most_common())
        good = by_fault.pop("none", Counter())
        by_fault.pop("unchecked", None)
        n_faults = sum(map(Counter.total, by_fault.values()))
        n_missed = sum(counts[MISSED] for counts in by_fault.values())
        if n_faults:
            share = f"{1 - n_missed / n_faults:.1%} of {n_faults}"
            yield f"found or could not be checked: {share}, at least {FEWEST_FOUND:.0%}"
        if good:
            share = f"{1 - good['nothing'] / good.total():.1%} of {good.total()}"
            yield f"false alarms: {share}, at most {MOST_ALARMS:.0%}"


def _numbers(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def main() -> None:
    """Print the matrix, and the shares that count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default=",".join(ALIKE))
    parser.add_argument("--seeds", default=range(1, 3), type=_numbers, help="first and last, as in 1-2")
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--good", default=range(0), type=_numbers, help="numbers of good recordings, as in 1-9")
    parser.add_argument("--real", type=Path)
    parser.add_argument("--kept", type=Path)
    asked = parser.parse_args()
    width, height = map(int, asked.size.split("x"))
    kept = Kept.read(asked.kept)
    with tempfile.TemporaryDirectory() as folder:
        for base in real_recordings(asked.real, Path(folder)) if asked.real else ():
            kept.add(base.name, real_matrix(base, Path(folder) / f"{base.name} changed"))
        if not asked.real:
            kept.add(f"good {asked.size}", good_ones(Path(folder), asked.good, (width, height)))
    for scene in asked.scenes.split(",") if not asked.real else ():
        for seed in asked.seeds:
            with tempfile.TemporaryDirectory() as folder:
                kept.add(f"{scene} {seed} {asked.size}", matrix(Path(folder), scene, seed, (width, height)))
    print(*kept.told(), sep="\n")


if __name__ == "__main__":
    main()
