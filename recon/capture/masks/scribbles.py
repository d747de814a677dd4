"""Semi-automatic masks: strokes on a few key frames, GrabCut there, optical flow to the frames between.

Strokes are pictures in a folder, `<sensor>/<side>/<frame>.png` of the camera's size: green (0, 255, 0) is foreground,
red (255, 0, 0) background, all else says nothing. Or a JSON file {"strokes": [{"sensor", "side", "frame", "label":
"foreground" | "background", "points": [[column, row], ...], "width": pixels}, ...]}.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import Capture
from recon.capture.images import CaptureError, read_image
from recon.capture.importing.sources import faults_at
from recon.capture.masks.outline import Models, cut
from recon.capture.noise import largest_channel
from recon.runtime.files import check_exists, files_like, in_any_case, read_json

COLOURS = {"foreground": (0, 255, 0), "background": (255, 0, 0)}
LABELS = {"foreground": cv2.GC_FGD, "background": cv2.GC_BGD}
NOTHING = 255
KEY_ROUNDS = 5
STEP_ROUNDS = 2
BAND_PX = 14  # how far flow may be wrong from a frame to the next, at 1000 pixels of picture height
TRUSTED_BAND_PX = 4  # and where the picture before, moved by it, is the same
TRUST_WINDOW_PX = 5  # over which two pictures are compared
SAME_FACTOR = 4.0  # times the usual difference, which is noise
MIN_DIFFERENCE = 3.0  # grey levels, where there is no noise
SURROUNDINGS = 0.3  # of the size of the strokes on the foreground: how far beyond them the object may reach
MAX_ENCLOSED = 0.6  # of the picture; a larger area is not enclosed by strokes
DEFAULT_WIDTH, LARGEST_WIDTH = 5, 1000  # pixels

Strokes = Mapping[tuple[str, str], Mapping[int, NDArray[np.uint8]]]
"""By (sensor, side) and frame: uint8 (H, W), GC_FGD, GC_BGD or NOTHING."""


def read_scribbles(path: Path, capture: Capture) -> Strokes:
    """Read the strokes of a folder or JSON file.

    A CaptureError says that a camera has none, or strokes are of the wrong size, for an unknown camera or frame, or of
    one kind only.
    """
    strokes = _read(path, capture)
    for stream in capture.sensors:
        for side in stream.sides:
            if not strokes.get((stream.id, side)):
                raise CaptureError(
                    f"{path}: no strokes for {stream.id}/{side}; every camera needs at least one key frame"
                )
    for (sensor_id, side), by_frame in strokes.items():
        for frame, labels in by_frame.items():
            _check_labels(path, labels, f"{sensor_id}/{side}, frame {frame}")
    return strokes


def mask_of_key_frame(
    picture: NDArray[np.uint8], path: Path, capture: Capture, place: tuple[str, str, int]
) -> NDArray[np.bool_]:
    """Cut out the foreground of a key frame alone, bool (H, W), as the masks of all frames begin.

    Parameters
    ----------
    picture : of the key frame, uint8 (H, W, 3)
    path : the strokes' folder or JSON file; other cameras may have none yet
    capture : the recording
    place : sensor, side and frame of the picture

    Raises
    ------
    CaptureError
        If the picture has no strokes, or of one kind only.
    """
    sensor_id, side, frame = place
    labels = _read(path, capture).get((sensor_id, side), {}).get(frame)
    if labels is None:
        raise CaptureError(f"{path}: no strokes for {sensor_id}/{side}, frame {frame}")
    _check_labels(path, labels, f"{sensor_id}/{side}, frame {frame}")
    return cut(picture, _key_seeds(labels), KEY_ROUNDS)[0]


def _read(path: Path, capture: Capture) -> Strokes:
    check_exists(path)
    return _from_json(path, capture) if path.is_file() else _from_folder(path, capture)


def _check_labels(path: Path, labels: NDArray[np.uint8], place: str) -> None:
    missing = [name for name, label in LABELS.items() if not (labels == label).any()]
    if missing:
        raise CaptureError(f"{path}: {place} has no {missing[0]} stroke")


def propagated(
    read: Callable[[int], NDArray[np.uint8]], key_frames: Mapping[int, NDArray[np.uint8]], n_frames: int
) -> Iterator[tuple[int, NDArray[np.bool_]]]:
    """Yield the masks of all frames of one camera, each from the nearest key frame, as (frame, bool (H, W)).

    Parameters
    ----------
    read : the picture of a frame, uint8 (H, W, 3)
    key_frames : strokes by frame, uint8 (H, W)
    n_frames : of the camera

    Source of the flow: Kroeger, Timofte, Dai, Van Gool, "Fast optical flow using dense inverse search", 2016.
    """
    keys = sorted(key_frames)
    for number, key in enumerate(keys):
        first = 0 if number == 0 else (keys[number - 1] + key) // 2 + 1
        last = n_frames - 1 if number == len(keys) - 1 else (key + keys[number + 1]) // 2
        picture = read(key)
        mask, models = cut(picture, _key_seeds(key_frames[key]), KEY_ROUNDS)
        yield key, mask
        for frames in (range(key + 1, last + 1), range(key - 1, first - 1, -1)):
            yield from _followed(read, frames, picture, mask, models)


def _followed(
    read: Callable[[int], NDArray[np.uint8]],
    frames: range,
    picture: NDArray[np.uint8],
    mask: NDArray[np.bool_],
    models: Models,
) -> Iterator[tuple[int, NDArray[np.bool_]]]:
    flow_of = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    for frame in frames:
        now = read(frame)
        greys = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (now, picture)]
        flow = flow_of.calc(greys[0], greys[1], None)  # from now to where it was
        mask = _warped(mask.astype(np.float32), flow) > 0.5
        if mask.any():
            seeds = _step_seeds(mask, _trusted(now, _warped(picture, flow)))
            mask = cut(now, seeds, STEP_ROUNDS, (models[0].copy(), models[1].copy()))[0]
        picture = now
        yield frame, mask


def _warped(picture: NDArray[Any], flow: NDArray[np.float32]) -> NDArray[Any]:
    rows, columns = np.indices(picture.shape[:2], dtype=np.float32)
    moved = cv2.remap(
        picture, columns + flow[..., 0], rows + flow[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(moved)


def _trusted(picture: NDArray[np.uint8], moved: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Mark where the flow is right, bool (H, W): the picture before, moved by it, shows the same."""
    window = (TRUST_WINDOW_PX, TRUST_WINDOW_PX)
    difference = cv2.blur(largest_channel(cv2.absdiff(picture, moved)).astype(np.float32), window)
    differs = difference > max(MIN_DIFFERENCE, SAME_FACTOR * float(np.median(difference)))
    return np.asarray(cv2.dilate(differs.astype(np.uint8), np.ones(window, np.uint8)) == 0)


def _key_seeds(strokes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Seed GrabCut from strokes: what strokes on the background enclose is likely foreground.

    Without an enclosure, only little around the strokes is. Enclosed is what can be reached from strokes on the
    foreground without crossing one on the background.
    """
    _, parts = cv2.connectedComponents((strokes != cv2.GC_BGD).astype(np.uint8), connectivity=4)
    enclosed = np.isin(parts, np.unique(parts[strokes == cv2.GC_FGD]))
    seeds = np.full(strokes.shape, cv2.GC_BGD, dtype=np.uint8)
    if enclosed.mean() < MAX_ENCLOSED:
        seeds[enclosed] = cv2.GC_PR_FGD
    else:
        spots = np.argwhere(strokes == cv2.GC_FGD)
        low, high = spots.min(axis=0), spots.max(axis=0)
        reach = round(SURROUNDINGS * float((high - low).max())) + 1
        rows, columns = (slice(max(a - reach, 0), b + reach + 1) for a, b in zip(low, high, strict=True))
        seeds[rows, columns] = cv2.GC_PR_BGD
    seeds[strokes != NOTHING] = strokes[strokes != NOTHING]
    return seeds


def _step_seeds(moved: NDArray[np.bool_], trusted: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Seed GrabCut from a mask that the flow moved here: nothing is sure in a band along its outline."""
    seeds = np.where(moved, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    for band_px, where in ((BAND_PX, True), (TRUSTED_BAND_PX, trusted)):
        band = max(2, round(band_px * moved.shape[0] / 1000))
        seeds[_within(moved, band) & where] = cv2.GC_FGD
        seeds[_within(~moved, band) & where] = cv2.GC_BGD
    return seeds


def _within(mask: NDArray[np.bool_], band: int) -> NDArray[np.bool_]:
    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=band) > 0)


def _from_folder(folder: Path, capture: Capture) -> Strokes:
    strokes: dict[tuple[str, str], dict[int, NDArray[np.uint8]]] = {}
    for stream in capture.sensors:
        for side, camera in zip(stream.sides, stream.cameras, strict=True):
            for path in files_like(in_any_case(folder / stream.id / side), "*.png"):
                frame = _frame(path.stem, capture, str(path))
                picture = read_image(path)
                _check_size(path, picture, camera.camera.size)
                labels = np.full(picture.shape[:2], NOTHING, dtype=np.uint8)
                for name, colour in COLOURS.items():
                    labels[(picture == colour).all(axis=2)] = LABELS[name]
                strokes.setdefault((stream.id, side), {})[frame] = labels
    return strokes


def _from_json(path: Path, capture: Capture) -> Strokes:
    strokes: dict[tuple[str, str], dict[int, NDArray[np.uint8]]] = {}
    entries = read_json(path).get("strokes")
    if not isinstance(entries, list):
        raise CaptureError(f"{path}: strokes is {entries!r:.80}, expected a list of strokes")
    for number, entry in enumerate(entries, start=1):
        place = f"{path}, stroke {number}"
        with faults_at(place):
            stream = capture.stream(entry["sensor"])
            camera = stream.cameras[stream.sides.index(_known(entry["side"], stream.sides))].camera
            label = LABELS[_known(entry["label"], LABELS)]
            points = np.array(entry["points"], dtype=np.float64)
            if points.ndim != 2 or points.shape[1] != 2:
                raise CaptureError(f"points has shape {points.shape}, expected a list of [column, row]")
            frame, width = _frame(str(entry["frame"]), capture, place), entry.get("width", DEFAULT_WIDTH)
            if not 1 <= width <= LARGEST_WIDTH:
                raise CaptureError(f"width is {width!r}, expected 1 to {LARGEST_WIDTH} pixels")
        if not ((points >= 0) & (points < camera.size)).all():
            raise CaptureError(f"{place}: a point lies outside the picture of {camera.size[0]}x{camera.size[1]} pixels")
        by_frame = strokes.setdefault((entry["sensor"], entry["side"]), {})
        labels = by_frame.setdefault(frame, np.full(camera.size[::-1], NOTHING, dtype=np.uint8))
        is_dot = len(points) == 1  # of which only a closed line is drawn
        cv2.polylines(labels, [np.round(points).astype(np.int32)], is_dot, label, int(width))
    return strokes


def _known(value: Any, expected: Any) -> str:
    if value not in expected:
        raise CaptureError(f"{value!r}, expected one of {', '.join(expected)}")
    return str(value)


def _frame(text: str, capture: Capture, place: str) -> int:
    if not text.isdecimal() or int(text) >= capture.n_frames:
        raise CaptureError(f"{place}: there is no frame {text!r}, frames are 0 to {capture.n_frames - 1}")
    return int(text)


def _check_size(path: Path, picture: NDArray[np.uint8], size: tuple[int, int]) -> None:
    height, width = picture.shape[:2]
    if (width, height) != size:
        raise CaptureError(f"{path}: scribbles are {width}x{height} pixels, the camera's pictures {size[0]}x{size[1]}")
