"""Faults that recordings have, put into good ones: for the test of the check, and for `bench/recordings.py`."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from recon.capture.checking.check import CheckReport
from recon.capture.format import (
    CameraStream,
    Capture,
    SensorStream,
    frame_pictures,
    image_path,
    mask_pictures,
    write_capture,
)
from recon.capture.mending.files import link
from recon.geometry.rig import Camera, rigid

FOUND, UNCHECKED, MISSED = "found", "could not be checked", "missed"
FAULTY = "S2"


def excerpt(base: Capture, out: Path, frames: list[int], late: Mapping[str, int] | None = None) -> Capture:
    """Make a recording of some frames of another; sensors that are late show so many frames of it earlier."""
    sensors = []
    for stream in base.sensors:
        names = {side: f"{stream.id}/{side}/{{frame:04d}}.png" for side in stream.sides}
        for place, name in enumerate(names.values()):
            for number, frame in enumerate(frames):
                shown = (frame - (late or {}).get(stream.id, 0)) % base.n_frames
                link(frame_pictures(base.folder, stream, shown)[place].path, image_path(out, name, number))
                for mask in mask_pictures(base.folder, stream, shown)[place : place + 1]:
                    link(mask.path, image_path(out, f"mask/{name}", number))
        cameras = [
            CameraStream(each.camera, names[side]) for side, each in zip(stream.sides, stream.cameras, strict=True)
        ]
        masks = tuple(f"mask/{name}" for name in names.values()) if stream.mask else None
        sensors.append(SensorStream(stream.id, cameras[0], cameras[1], mask=masks))
    made = replace(base, folder=out, n_frames=len(frames), sensors=tuple(sensors), held_out=())
    write_capture(made)
    return made


@dataclass(frozen=True)
class Fault:
    """A fault.

    Parameters
    ----------
    put : changes a recording in its folder
    told : expression that a sentence of the check must match
    unchecked : expression of the sentence that this could not be checked
    """

    name: str
    put: Callable[[Capture], None]
    told: str
    unchecked: str = f"{FAULTY}: its calibration {UNCHECKED}"

    def verdict(self, report: CheckReport, before: Collection[str] = ()) -> str:
        """Return whether a check found it, and did not say so `before` of the recording without it."""
        new = {plain(sentence) for sentence in (*report.problems, *report.warnings)} - {*map(plain, before)}
        if any(re.search(self.told, sentence) for sentence in new):
            return FOUND
        sentences = (*report.problems, *report.warnings, *report.verdicts)
        return UNCHECKED if any(re.search(self.unchecked, sentence) for sentence in sentences) else MISSED


def plain(sentence: str) -> str:
    """Return a sentence without its measures, which differ a little each time."""
    return re.sub(r"\d+\.\d+|\d+ of \d+|\d+%", "#", sentence)


def false_alarms(report: CheckReport) -> list[str]:
    """Return what a check says is wrong."""
    return [sentence for sentence in (*report.problems, *report.warnings) if UNCHECKED not in sentence]


def with_stream(capture: Capture, change: Callable[[SensorStream], SensorStream]) -> None:
    """Write a recording whose faulty sensor is changed."""
    sensors = tuple(change(each) if each.id == FAULTY else each for each in capture.sensors)
    write_capture(replace(capture, sensors=sensors))


def _with_right(capture: Capture, change: Callable[[SensorStream, Camera], Camera]) -> None:
    def changed(stream: SensorStream) -> SensorStream:
        assert stream.right is not None
        return replace(stream, right=replace(stream.right, camera=change(stream, stream.right.camera)))

    with_stream(capture, changed)


def _swap(capture: Capture, frames: range) -> None:
    stream = capture.stream(FAULTY)
    for frame in frames:
        left, right = (picture.path for picture in frame_pictures(capture.folder, stream, frame))
        content = left.read_bytes(), right.read_bytes()
        for path, other in zip((right, left), content, strict=True):
            path.unlink()  # it may be a link
            path.write_bytes(other)


def _turn(capture: Capture, rows: float) -> None:
    def turned(_stream: SensorStream, camera: Camera) -> Camera:
        turn = cv2.Rodrigues(np.array([rows / camera.K[0, 0], 0.0, 0.0]))[0]
        return replace(camera, cam_from_world=rigid(turn, np.zeros(3)) @ camera.cam_from_world)

    _with_right(capture, turned)


def _mirror_baseline(capture: Capture) -> None:
    def mirrored(stream: SensorStream, camera: Camera) -> Camera:
        left = stream.left.camera
        relative = camera.cam_from_world @ np.linalg.inv(left.cam_from_world)
        relative[:3, 3] *= -1
        return replace(camera, cam_from_world=relative @ left.cam_from_world)

    _with_right(capture, mirrored)


def _distort(capture: Capture, coefficients: tuple[float, ...]) -> None:
    def changed(stream: SensorStream) -> SensorStream:
        sides = (replace(each, camera=replace(each.camera, dist=np.array(coefficients))) for each in stream.cameras)
        left, right = sides
        return replace(stream, left=left, right=right)

    with_stream(capture, changed)


def _repaint(capture: Capture, paint: Callable[[np.ndarray, int], np.ndarray], sides: tuple[int, ...] = (0, 1)) -> None:
    for frame in range(capture.n_frames):
        for side in sides:
            path = frame_pictures(capture.folder, capture.stream(FAULTY), frame)[side].path
            picture = cv2.imread(str(path))
            assert picture is not None
            path.unlink()
            cv2.imwrite(str(path), paint(picture, frame))


def _unrelated(picture: np.ndarray, frame: int) -> np.ndarray:
    """Paint another place: blots of every size."""
    rng = np.random.default_rng(frame)
    height, width = picture.shape[:2]
    total = np.zeros((height, width, 3), np.float32)
    for size in (4, 9, 20, 60):
        coarse = rng.normal(0, 1, (height // size + 2, width // size + 2, 3)).astype(np.float32)
        total += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip(128 + 35 * total, 0, 255).astype(np.uint8)


def _overexposed(picture: np.ndarray, _frame: int) -> np.ndarray:
    return np.asarray(np.clip(picture.astype(np.float32) * 8.0, 0, 255), np.uint8)


def lag(quarters: int) -> Fault:
    """Return the fault of a sensor that is late; `excerpt` puts it in."""
    return Fault(
        f"{quarters / 4:g} frames late", lambda _capture: None, "not synchronised", f"same instants {UNCHECKED}"
    )


def turned(rows: int) -> Fault:
    """Return the fault of a camera that was turned, so that rows are apart."""
    told = "S2.*(rows are|rotated|vertically|turned)"
    return Fault(f"{rows} rows", lambda capture: _turn(capture, rows), told)


def swapped(frames: range, told: str) -> Fault:
    """Return the fault of left and right pictures exchanged in some shots."""
    return Fault(f"shots {frames.start} to {frames.stop - 1} swapped", lambda capture: _swap(capture, frames), told)


FAULTS = (
    swapped(range(4), "S2.*(swapped|order of left)"),
    swapped(range(1, 2), "S2: left and right are swapped in frame 1"),
    swapped(range(3), "S2: left and right are swapped in frames 0, 1, 2"),
    Fault("wrong baseline sign", _mirror_baseline, "S2.*(baseline|swapped|bounds)|S2 disagree|and S2|S2 and"),
    *map(turned, (1, 2, 3)),
    Fault(
        "wrong lenses",
        lambda capture: _distort(capture, (0.25, 0.1, 0.0, 0.0)),
        "S2.*(lenses|focal|rotated)",
        f"{FAULTY}: .*lenses is right {UNCHECKED}",
    ),
    Fault("unrelated pictures", lambda capture: _repaint(capture, _unrelated, (1,)), "S2.*(could not be checked)"),
    Fault(
        "colours in another order",
        lambda capture: _repaint(capture, lambda picture, _: picture[..., ::-1], (1,)),
        "sensor S2: what is red in the left pictures is blue",
    ),
    Fault("overexposed", lambda capture: _repaint(capture, _overexposed), "S2.*(bright|exposed|texture)"),
    Fault(
        "masks of a sensor missing",
        lambda capture: with_stream(capture, lambda stream: replace(stream, mask=None)),
        "S2 has no masks",
    ),
)
