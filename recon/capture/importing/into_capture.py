"""The common end of every importer: a foreign recording becomes a new capture folder.

Here pictures are counted and copied, lengths are millimetres, and the world is turned so that y is up.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.bits import used_bits
from recon.capture.depth_maps import read_depth_values
from recon.capture.format import (
    CameraStream,
    Capture,
    CaptureError,
    DepthMaps,
    HeldOut,
    SensorStream,
    depth_path,
    image_path,
    write_capture,
)
from recon.capture.images import is_video, video_times
from recon.capture.importing.copies import copied_suffix, copy_mask, copy_picture, stored
from recon.capture.importing.lenses import FisheyeCamera
from recon.capture.importing.sources import DepthSource, ImportOptions, Recording, SensorSource
from recon.capture.pictures import DEFAULT_FPS, Pictures, common_rate, copy_file
from recon.capture.recording import MASK, SIDES, check_bounds
from recon.capture.rectify import viewing_directions
from recon.geometry.rig import DIST_POWERS, Y_FROM, Camera, rigid
from recon.runtime.files import allowed, new_folder
from recon.runtime.notices import Notice

DEEP = 16  # bits
NUMBER = re.compile(r"-?\d[-+.\de]*")
MOST_OFF_MIDDLE = 0.4  # of the picture's size, from its middle to the principal point: beyond, it is at the border
BASELINES_MM = (0.5, 50_000.0)  # shorter ones are those of microscopes, longer ones of aeroplanes
MOST_APART_DEG = 60.0  # between the axes of a stereo pair
MOST_DISTORTION = (
    2.0,
    2.0,
    0.2,
    0.2,
    2.0,
)  # of k1, k2, p1, p2, k3 at the corners, 1 being as far as they are from the axis
MOST_UNDONE_PX = 1.0  # off after the distortion was undone and done
N_ANGLES = 64  # at which a fisheye is looked at
MOST_STEPS = 2  # from a picture's number to the next one's, on average; above, the numbers are times or the like


class GapWarning(Notice):
    """Numbers of pictures that leave out an instant, the same in all cameras, or do not begin alike."""


def write_recording(out: Path, recording: Recording, options: ImportOptions) -> Capture:
    """Copy a recording into a new capture folder, in mm and y up.

    Parameters
    ----------
    out : the folder, absent or empty
    recording : what the importer found
    options : what the importing person said

    Raises
    ------
    CaptureError
        If there is no sensor, pictures are missing, counts differ, folders lack pictures of different numbers, a
        video's frame rate is variable or not the others', or nothing tells the bounds. Nothing is left behind.
    """
    if not recording.sensors:
        raise CaptureError("the source names no sensors, expected at least one")
    _check_sizes(recording)
    for doubt in _doubts_once(recording.sensors):
        warnings.warn(doubt, Notice, stacklevel=2)
    turn = rigid(Y_FROM[options.up or recording.up], np.zeros(3))
    told = (options.fps, recording.fps, _video_fps(recording), DEFAULT_FPS)  # videos are checked whatever is said
    fps = next(rate for rate in told if rate is not None)
    sensors = tuple(_stream(source, turn) for source in recording.sensors)
    names = _held_out_names(recording.held_out)
    held_out = tuple(
        HeldOut(_turned(camera, turn), f"held_out/{name}", frame=0)
        for (camera, _), name in zip(recording.held_out, names, strict=True)
    )
    with new_folder(out) as folder:
        capture = Capture(
            folder=folder,
            name=options.name or recording.name,
            kind=recording.kind,
            fps=fps,
            n_frames=_n_frames(recording, options.n_frames),
            bounds=_bounds(recording, options, sensors, turn),
            object=recording.object,
            sensors=sensors,
            held_out=held_out,
        )
        bits = _bits(recording)
        for source, stream in zip(recording.sensors, sensors, strict=True):
            _copy_sensor(capture, source, stream, bits)
        for (camera, path), photograph in zip(recording.held_out, held_out, strict=True):
            copy_picture(camera, path, folder / photograph.image, bits=bits)
        write_capture(capture)
    return replace(capture, folder=out)


def _check_sizes(recording: Recording) -> None:
    """Raise a CaptureError if the first picture of a camera, or of photographs of one size, is not of its size."""
    firsts = {
        f"sensor {source.id}, {side}": (camera, pictures)
        for source in recording.sensors
        for side, camera, pictures in zip(SIDES, source.cameras, source.pictures, strict=False)
    }
    held_out = {camera.size: (camera, Pictures((path,))) for camera, path in reversed(recording.held_out)}
    for place, (camera, pictures) in [*firsts.items(), *(("held out", shot) for shot in held_out.values())]:
        if pictures.size != camera.size:
            raise CaptureError(
                f"{place}: {pictures.files[0]} has {'x'.join(map(str, pictures.size))} pixels, its calibration is for "
                f"{'x'.join(map(str, camera.size))}; take the pictures that it was made for, or calibrate these"
            )


def _doubts_once(sources: Sequence[SensorSource]) -> Iterator[str]:
    """Yield each kind of doubt once, with the numbers of the first sensor and the names of the others that have it."""
    kinds: dict[str, list[tuple[str, str]]] = {}
    for source in sources:
        for doubt in _doubts(source):
            kinds.setdefault(NUMBER.sub("", doubt), []).append((source.id, doubt))
    for (first, doubt), *others in kinds.values():
        also = f" (likewise in {', '.join(sensor for sensor, _ in others)})" if others else ""
        yield f"sensor {first}{also}: {doubt}"


def _doubts(source: SensorSource) -> Iterator[str]:
    """Yield what slips of units, of resolution or of order look like; a calibration with it may be right."""
    for side, camera in zip(SIDES, source.cameras, strict=False):
        centre, (width, height) = camera.K[:2, 2], camera.size
        if (np.abs(centre / (width - 1, height - 1) - 0.5) > MOST_OFF_MIDDLE).any():
            yield (
                f"the principal point of {side}, ({centre[0]:.6g}, {centre[1]:.6g}), is far from the middle of its "
                f"pictures of {width}x{height}; are they cut out, or of another resolution?"
            )
        elif not _is_likely_lens(camera):
            yield (
                f"the distortion of {side} is larger at the pictures' edges than a lens's, or cannot be undone there; "
                "check its numbers and model"
            )
    if source.right is None:
        return
    baseline = float(np.linalg.norm(source.right.centre - source.left.centre))
    if not BASELINES_MM[0] <= baseline <= BASELINES_MM[1]:
        yield f"its cameras are {baseline:.4g} mm apart; is the unit right?"
    apart = float(np.rad2deg(np.arccos(np.clip(source.left.rotation[2] @ source.right.rotation[2], -1, 1))))
    if apart > MOST_APART_DEG:
        yield f"its cameras look {apart:.0f} degrees apart, and hardly see the same"


def _is_likely_lens(camera: Camera) -> bool:
    """Tell whether a lens shows each place at the picture's border from one direction, and moves none too far."""
    width, height = camera.size
    border = np.array([[x, y] for x in (0, width / 2, width - 1) for y in (0, height / 2, height - 1)], np.float64)
    off_axis = float(np.linalg.norm((border - camera.K[:2, 2]) / np.diag(camera.K)[:2], axis=1).max())
    if isinstance(camera, FisheyeCamera):
        angles = np.linspace(0, np.arctan(off_axis), N_ANGLES)
        powers = angles[:, None] ** [2, 4, 6, 8]
        return bool((np.diff(angles * (1 + powers @ camera.lens)) > 0).all())
    if not camera.dist.any():
        return True
    n = camera.dist.size
    if (
        n <= len(MOST_DISTORTION)
        and (np.abs(camera.dist) * off_axis ** np.array(DIST_POWERS[:n]) > MOST_DISTORTION[:n]).any()
    ):
        return False
    directions = viewing_directions(camera, border)
    if not np.isfinite(directions).all():
        return False
    again = cv2.projectPoints(directions, np.zeros(3), np.zeros(3), camera.K, camera.dist)[0][:, 0]
    again[:, 0] += camera.K[0, 1] * directions[:, 1]
    return bool(np.abs(again - border).max() < MOST_UNDONE_PX)


def _bits(recording: Recording) -> int:
    """Return how many bits the values of all pictures with 16 fill, as all are spread alike, and say so."""
    pictures = [path for _, side in _all_pictures(recording) for path in side.files if not side.is_video]
    plates = [side.plate for _, side in _all_pictures(recording) if side.plate]
    bits = used_bits([*pictures, *plates, *(path for _, path in recording.held_out)])
    if bits < DEEP:
        warnings.warn(
            f"the pictures have 16 bits, of which their values fill {bits}; they are spread over all 16, all alike",
            Notice,
            stacklevel=2,
        )
    return bits


def _stream(source: SensorSource, turn: NDArray[np.float64]) -> SensorStream:
    sides = SIDES[: len(source.cameras)]
    left, *right = (
        CameraStream(_turned(camera, turn), _pattern(source.id, side, camera, pictures))
        for side, camera, pictures in zip(sides, source.cameras, source.pictures, strict=True)
    )
    if source.depth is not None and isinstance(source.left, FisheyeCamera):
        raise CaptureError(f"sensor {source.id}: depth maps of a fisheye are not read; undistort them and its pictures")
    plates = [pictures.plate for pictures in source.pictures]
    if any(plates) and not all(plates):
        raise CaptureError(f"sensor {source.id}: only one of its cameras has a clean plate")
    names = [
        f"{source.id}/{side}/plate{copied_suffix(camera, plate)}"
        for side, camera, plate in zip(sides, source.cameras, plates, strict=True)
        if plate
    ]
    masks = tuple(MASK.format(sensor=source.id, side=side) for side in sides) if source.masks else None
    return SensorStream(
        source.id,
        left,
        right[0] if right else None,
        tuple(names) or None,
        masks,
        depth=_depth_maps(source.id, source.depth),
    )


def _held_out_names(held_out: Sequence[tuple[Camera, Path]]) -> list[str]:
    """Return names of the copies, numbered where two files have the same: each camera's folder may hold a 0001.png."""
    names = [path.stem + copied_suffix(camera, path) for camera, path in held_out]
    is_unique = len({name.lower() for name in names}) == len(names)
    return names if is_unique else [f"{number:04d}_{name}" for number, name in enumerate(names, start=1)]


def _depth_maps(sensor_id: str, source: DepthSource | None) -> DepthMaps | None:
    if source is None:
        return None
    pattern = f"{sensor_id}/depth/{{frame:04d}}{source.suffix}"
    return DepthMaps(pattern, source.scale_mm, source.kind, source.size)


def _pattern(sensor_id: str, side: str, camera: Camera, pictures: Pictures) -> str:
    suffixes = {copied_suffix(camera, path) for path in pictures.files}
    suffix = suffixes.pop() if len(suffixes) == 1 else ".png"
    return f"{sensor_id}/{side}{suffix}" if is_video(f"{side}{suffix}") else f"{sensor_id}/{side}/{{frame:04d}}{suffix}"


def _turned(camera: Camera, turn: NDArray[np.float64]) -> Camera:
    return replace(
        stored(camera), cam_from_world=camera.cam_from_world @ turn.T
    )  # a rotation: its inverse is its transpose


def _all_pictures(recording: Recording) -> list[tuple[str, Pictures]]:
    return [
        (f"sensor {source.id}, {side}", pictures)
        for source in recording.sensors
        for side, pictures in zip(SIDES, source.pictures, strict=False)
    ]


def _n_frames(recording: Recording, wanted: int | None) -> int:
    counts = {
        place: len(video_times(pictures.files[0])) if pictures.is_video else len(pictures.files)
        for place, pictures in _all_pictures(recording)
    }
    counts |= {f"sensor {source.id}, depth": len(source.depth.files) for source in recording.sensors if source.depth}
    short = {place: count for place, count in counts.items() if count < (wanted or max(counts.values()))}
    if short:
        place, count = next(iter(short.items()))
        raise CaptureError(
            f"{place} has {count} frames, expected {wanted or max(counts.values())}; take fewer frames if the cameras "
            "were started together, else find out which frames are missing"
        )
    n_frames = wanted or max(counts.values())
    _check_gaps(recording, n_frames)
    return n_frames


def _check_gaps(recording: Recording, n_frames: int) -> None:
    """Raise a CaptureError if folders lack pictures of different numbers: one's third would stand beside a fourth.

    Where all lack the same, or begin with different numbers, there is a GapWarning.
    """
    folders = {place: pictures.files for place, pictures in _all_pictures(recording) if pictures.is_folder}
    counters = {place: counter for place, files in folders.items() if (counter := _counter(files[:n_frames]))}
    first = next(iter(counters), "")
    for place, numbers in counters.items():
        begins_later = numbers[0] - counters[first][0]
        pairs = enumerate(zip(counters[first], numbers, strict=True))
        differing = [frame for frame, (number, other) in pairs if other - number != begins_later]
        if differing:
            names = [f"{folders[where][differing[0]].name} of {where}" for where in (first, place)]
            raise CaptureError(
                f"{names[0]} would be taken for the same instant as {names[1]}, because pictures before them are "
                "missing; remove the pictures of the instants that not all cameras have"
            )
        if 0 < abs(begins_later) < n_frames:
            warnings.warn(
                f"{first} begins with {folders[first][0].name}, {place} with {folders[place][0].name}; they are taken "
                "for one instant: if the cameras count alike, remove the pictures of the instants that not all have",
                GapWarning,
                stacklevel=2,
            )
            break
    steps = np.diff(counters.get(first, []))
    if len(steps) and steps.max() > steps.min():
        before, after = folders[first][np.argmax(steps > steps.min()) :][:2]
        warnings.warn(
            f"{first}: {after.name} follows {before.name}; where pictures between them are missing in all cameras, the "
            "motion jumps",
            GapWarning,
            stacklevel=2,
        )


def _counter(files: Sequence[Path]) -> list[int]:
    """Return the numbers of files; empty where their names do not count frames, as times do not."""
    numbers = np.array([[int(part) for part in re.findall(r"\d+", path.stem)] for path in files], dtype=object)
    if numbers.ndim != 2 or not numbers.shape[1]:
        return []
    changing = [column.tolist() for column in numbers.T if (column != column[0]).any()]
    is_counter = len(changing) == 1 and 0 < changing[0][-1] - changing[0][0] < MOST_STEPS * len(files)
    return changing[0] if is_counter else []


def _video_fps(recording: Recording) -> float | None:
    videos = {place: pictures.files[0] for place, pictures in _all_pictures(recording) if pictures.is_video}
    return common_rate(videos) if videos else None


def _bounds(
    recording: Recording, options: ImportOptions, sensors: Sequence[SensorStream], turn: NDArray[np.float64]
) -> NDArray[np.float64]:
    if options.bounds is not None:
        return check_bounds(options.bounds)
    if recording.bounds is not None:
        turned = check_bounds(recording.bounds) @ turn[:3, :3].T
        return np.stack([turned.min(axis=0), turned.max(axis=0)])
    centre = sensors[0].left.camera.centre
    ahead = sensors[0].left.camera.rotation[2]
    middle = centre + 2500.0 * ahead
    example = ",".join(f"{value:.0f}" for value in (*(middle - 1000.0), *(middle + 1000.0)))
    raise CaptureError(
        "nothing tells the bounds of the space to reconstruct; give them by --bounds x0,y0,z0,x1,y1,z1 in mm (2 m "
        f"around what is 2.5 m before the first camera: --bounds={example})"
    )


def _copy_sensor(capture: Capture, source: SensorSource, stream: SensorStream, bits: int) -> None:
    if source.depth is not None and stream.depth is not None:
        for frame, path in enumerate(source.depth.files[: capture.n_frames]):
            _copy_depth(source.depth, path, depth_path(capture.folder, stream.depth, frame))
    for side, camera, pictures in zip(stream.cameras, source.cameras, source.pictures, strict=True):
        is_decoded = pictures.is_video and not is_video(side.image)
        files = pictures.files * capture.n_frames if is_decoded else pictures.files[: capture.n_frames]
        for frame, path in enumerate(files):
            copy_picture(camera, path, image_path(capture.folder, side.image, frame), frame, bits=bits)
    for pattern, camera, masks in zip(stream.mask or (), source.cameras, source.masks, strict=bool(stream.mask)):
        for frame, path in enumerate(masks[: capture.n_frames]):
            copy_mask(camera, path, image_path(capture.folder, pattern, frame))
    for name, camera, pictures in zip(stream.plate or (), source.cameras, source.pictures, strict=bool(stream.plate)):
        assert pictures.plate is not None, "both cameras have a plate, or none"
        copy_picture(camera, pictures.plate, capture.folder / name, bits=bits)


def _copy_depth(source: DepthSource, path: Path, target: Path) -> None:
    """Copy a depth map, or write what its values say where they are no depths."""
    if path.suffix.lower() == target.suffix and source.depth_of is None:
        copy_file(path, target)
        return
    values = read_depth_values(allowed(path))
    target.parent.mkdir(parents=True, exist_ok=True)
    np.save(target, values if source.depth_of is None else source.depth_of(values))
