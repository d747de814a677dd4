"""Foreground masks: what differs from the clean plate, is brighter than a dark background, or follows from scribbles.

Masks are PNG files (255 foreground, 0 background) beside the images, and `capture.json` names them.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import (
    CAPTURE_FILE,
    Capture,
    CaptureError,
    SensorStream,
    frame_pictures,
    image_path,
    read_capture,
    read_frame,
    read_picture,
    read_plates,
)
from recon.capture.images import write_picture
from recon.capture.masks.evidence import (
    MIN_DIFFERENCE,
    dark_background_threshold,
    evidence_of,
    found_threshold,
    smoothed,
)
from recon.capture.masks.outline import (
    KEPT,
    edge_share,
    grown,
    hides_plate,
    likeness,
    tightened,
    without_lit_background,
)
from recon.capture.masks.scribbles import Strokes, mask_of_key_frame, propagated, read_scribbles
from recon.capture.noise import largest_channel
from recon.capture.recording import MASK
from recon.runtime.files import check_not_read, check_suffix, files_like, read_json, write_json
from recon.runtime.workers import Progress, no_progress


@dataclass(frozen=True)
class CleanUp:
    """Limits for the clean-up of a raw mask.

    Parameters
    ----------
    max_hole : share of the picture; background enclosed by the object is a crevice below it, a true gap above
    opening_px : diameter of the specks and threads that are dropped
    closing_px : diameter of the gaps that are closed
    min_part : share of the picture; smaller parts of the foreground are dropped
    """

    max_hole: float
    opening_px: int = 3
    closing_px: int = 5
    min_part: float = 1e-3


FAINT = 0.5  # of the evidence that tells an object alone: enough where the plate's pattern is gone, too
MAX_EDGE = 0.5  # of a picture's edge that an object before a dark background reaches
SCRIBBLES = CleanUp(max_hole=2e-4)
FRAMES_AT_ONCE = min(os.cpu_count() or 1, 4)  # each needs 0.2 GB at full HD
_Plates = list[NDArray[np.float32] | None]
_Mask = tuple[SensorStream, int, int, NDArray[np.bool_]]  # stream, side, frame, mask
METHODS = {"plate": CleanUp(max_hole=2e-4), "threshold": CleanUp(max_hole=3e-3)}  # dark crevices look like background


def segment_capture(
    folder: Path,
    *,
    method: str | None = None,
    threshold: float | None = None,
    scribbles: Path | None = None,
    progress: Progress = no_progress,
) -> Capture:
    """Write the foreground masks of all sensors and frames, then name them in `capture.json`.

    Parameters
    ----------
    folder : the capture's folder
    method : "plate" (difference from the clean plate and its shadows), "threshold" (brighter than a dark
        background), or None: "plate" if every sensor has one, else "threshold"
    threshold : grey levels of difference or brightness above which a pixel is foreground, None to find one for
        each sensor
    scribbles : folder or JSON file of strokes on key frames; then they make the masks, without a method
    progress : called with ("masks", done, total)

    Raises
    ------
    CaptureError
        If the method is unknown, a plate or image is missing or unreadable, scribbles are wrong, a mask is empty, or a
        background without plate is not dark; `capture.json` is as it was, then.
    """
    capture = read_capture(folder, with_masks=False)  # those it has give way
    if scribbles is not None:
        masks = _by_scribbles(capture, read_scribbles(scribbles, capture))
    else:
        masks = _by_evidence(capture, _method(capture, method), threshold)
    n_pictures = sum(len(stream.sides) for stream in capture.sensors) * capture.n_frames
    with _staged(folder) as staging:
        for n_done, (stream, side, frame, mask) in enumerate(masks, start=1):
            name = image_path(Path(), _mask_patterns(stream)[side], frame)
            if not mask.any():
                raise CaptureError(f"{folder / name}: no foreground is found")
            _write_mask(staging / name, mask)
            progress("masks", n_done, n_pictures)
    content = read_json(folder / CAPTURE_FILE)  # which may hold keys of other programs
    for entry, stream in zip(content["sensors"], capture.sensors, strict=True):
        entry["mask"] = dict(zip(stream.sides, _mask_patterns(stream), strict=True))
    write_json(folder / CAPTURE_FILE, content)
    return replace(capture, sensors=tuple(replace(s, mask=_mask_patterns(s)) for s in capture.sensors))


def try_strokes(folder: Path, scribbles: Path, place: tuple[str, str, int], out: Path) -> NDArray[np.bool_]:
    """Write the mask of a picture that has strokes, to see what they do before all frames are segmented.

    Parameters
    ----------
    folder : the capture's folder
    scribbles : folder or JSON file of strokes; only those on the picture count
    place : sensor, side and frame of the picture
    out : the mask's PNG file, 255 foreground, 0 background

    Returns
    -------
    mask : bool (H, W)

    Raises
    ------
    ValueError
        If `out` is no PNG file, or one of the sensor's pictures or of the strokes, there is no such picture, it has no
        strokes of both kinds, or the mask is empty.
    """
    check_suffix(out, (".png",))
    capture = read_capture(folder)
    sensor_id, side, frame = place
    stream = capture.stream(sensor_id)
    if side not in stream.sides or not 0 <= frame < capture.n_frames:
        raise CaptureError(
            f"{folder}: has no picture {sensor_id}/{side}, frame {frame}; the sensor has {' and '.join(stream.sides)}, "
            f"frames 0 to {capture.n_frames - 1}"
        )
    recorded = frame_pictures(folder, stream, frame)[stream.sides.index(side)]
    pictures = (picture.path for at in range(capture.n_frames) for picture in frame_pictures(folder, stream, at))
    check_not_read(out, (*pictures, *files_like(scribbles, "*/*/*.png")))
    picture = read_picture(recorded)
    mask = clean_mask(mask_of_key_frame(picture, scribbles, capture, place), SCRIBBLES)
    if not mask.any():
        raise CaptureError(f"{sensor_id}/{side}, frame {frame}: no foreground is found; draw more on the object")
    _write_mask(out, mask)
    return mask


def _by_evidence(capture: Capture, method: str, threshold: float | None) -> Iterator[_Mask]:
    for stream in capture.sensors:
        plates: _Plates = _smoothed_plates(capture, stream) if method == "plate" else [None] * len(stream.sides)
        limit = found_threshold(capture, stream, plates) if threshold is None else threshold
        masks_of = partial(_frame_masks, capture, stream, plates, limit)
        with ThreadPoolExecutor(FRAMES_AT_ONCE) as pool:
            for frame, masks in enumerate(pool.map(masks_of, range(capture.n_frames))):
                for side, mask in enumerate(masks):
                    yield stream, side, frame, mask


def _frame_masks(
    capture: Capture, stream: SensorStream, plates: _Plates, limit: float, frame: int
) -> list[NDArray[np.bool_]]:
    masks = []
    for side, picture, plate in zip(stream.sides, read_frame(capture, stream.id, frame), plates, strict=True):
        masks.append(mask := _mask(picture, smoothed(picture), plate, limit))
        if plate is None and (share := edge_share(mask)) > MAX_EDGE:
            raise CaptureError(
                f"{stream.id}/{side}, frame {frame}: {share:.0%} of the picture's edge is brighter than {limit:.0f} "
                "grey levels, so the background is not dark; record clean plates, or draw strokes (--scribbles)"
            )
    return masks


def _smoothed_plates(capture: Capture, stream: SensorStream) -> _Plates:
    plates = read_plates(capture, stream.id)
    assert plates is not None, "the method was chosen with plates"
    return [smoothed(plate) for plate in plates]


def mask_on_dark(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Mask the object of a picture, uint8 (H, W, 3), before a dark background, as the method "threshold" does."""
    smooth = smoothed(picture)
    histogram = np.bincount(evidence_of(smooth, None).astype(np.uint8).ravel(), minlength=256)
    return _mask(picture, smooth, None, dark_background_threshold(histogram))


def _mask(
    picture: NDArray[np.uint8], smooth: NDArray[np.float32], plate: NDArray[np.float32] | None, limit: float
) -> NDArray[np.bool_]:
    """Mask the object of a picture before its plate, both smoothed, too; before a dark background without a plate."""
    evidence, clean_up = evidence_of(smooth, plate), METHODS["threshold" if plate is None else "plate"]
    differs = evidence > limit
    if plate is not None:
        changed = largest_channel(np.abs(smooth - plate)) > limit
        differs |= hides_plate(smooth, plate, evidence > FAINT * limit, changed)
    mask = tightened(clean_mask(differs, clean_up), evidence)
    if not mask.any():
        return mask
    if plate is None:
        doubtful = _not_background(mask, evidence)
    else:
        doubtful = changed & ~(likeness(smooth, plate, mask, changed) > KEPT)
    whole = clean_mask(grown(picture, mask, doubtful), clean_up)
    return whole if plate is not None else clean_mask(without_lit_background(whole, evidence, limit), clean_up)


def _not_background(mask: NDArray[np.bool_], evidence: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Mark what is brighter than most of the background: the object's own shadows, and what stray light falls on."""
    background = evidence[~mask]
    if not background.size:
        return np.zeros_like(mask)
    return np.asarray(evidence > float(np.median(background)) + MIN_DIFFERENCE)


def _by_scribbles(capture: Capture, strokes: Strokes) -> Iterator[_Mask]:
    for stream in capture.sensors:
        for side, name in enumerate(stream.sides):

            def read(frame: int, stream: SensorStream = stream, side: int = side) -> NDArray[np.uint8]:
                return read_picture(frame_pictures(capture.folder, stream, frame)[side])

            for frame, mask in propagated(read, strokes[stream.id, name], capture.n_frames):
                yield stream, side, frame, clean_mask(mask, SCRIBBLES)


def clean_mask(raw: NDArray[np.bool_], clean_up: CleanUp) -> NDArray[np.bool_]:
    """Drop specks, close narrow gaps, drop small parts and fill small holes of a mask, bool (H, W)."""
    mask = cv2.morphologyEx(raw.astype(np.uint8), cv2.MORPH_OPEN, _disc(clean_up.opening_px))
    mask = _closed(mask, clean_up.closing_px)
    mask = _without_small_parts(mask, round(clean_up.min_part * mask.size), connectivity=8)
    background = _without_small_parts(1 - mask, round(clean_up.max_hole * mask.size), connectivity=4)
    return np.asarray(background == 0)


def _method(capture: Capture, method: str | None) -> str:
    without = [stream.id for stream in capture.sensors if stream.plate is None]
    if method is None:
        return "threshold" if without else "plate"
    if method not in METHODS:
        raise CaptureError(f"method is {method!r}, expected one of {', '.join(METHODS)}")
    if method == "plate" and without:
        raise CaptureError(f"{capture.folder}: {', '.join(without)} has no clean plate; use the method threshold")
    return method


def _disc(diameter: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (diameter, diameter)))


def _closed(mask: NDArray[np.uint8], diameter: int) -> NDArray[np.uint8]:
    # an object may leave the picture
    padded = cv2.copyMakeBorder(mask, diameter, diameter, diameter, diameter, cv2.BORDER_REPLICATE)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, _disc(diameter))
    return np.asarray(closed[diameter:-diameter, diameter:-diameter])


def _without_small_parts(mask: NDArray[np.uint8], min_area: int, *, connectivity: int) -> NDArray[np.uint8]:
    _, labels, facts, _ = cv2.connectedComponentsWithStats(mask, connectivity=connectivity)
    kept = facts[:, cv2.CC_STAT_AREA] >= min_area
    kept[0] = False  # what is not in the mask
    return np.asarray(kept[labels], dtype=np.uint8)


def _mask_patterns(stream: SensorStream) -> tuple[str, ...]:
    return tuple(MASK.format(sensor=stream.id, side=side) for side in stream.sides)


def _write_mask(path: Path, mask: NDArray[np.bool_]) -> None:
    write_picture(path, np.where(mask, np.uint8(255), np.uint8(0)))


@contextmanager
def _staged(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder whose files move to `folder` if the block ends without an error."""
    staging = folder / f".masks.{os.getpid()}.part"
    shutil.rmtree(staging, ignore_errors=True)  # a killed process, in a container, may have had the same number
    try:
        yield staging
        for path in sorted(path for path in staging.rglob("*") if path.is_file()):
            target = folder / path.relative_to(staging)
            target.parent.mkdir(parents=True, exist_ok=True)
            path.replace(target)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
