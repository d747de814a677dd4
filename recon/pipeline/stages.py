"""The artefacts of a reconstruction, one function each: made from what stands before it, unless it is there already.

Every function returns the names of the artefacts that it had to make.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import cache, partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.approaches import Approach
from recon.capture.format import Capture, image_path, read_frame, read_masks
from recon.capture.rectify import Rectification, rectify, rectify_images, rectify_masks
from recon.cloud import CloudParameters, NothingSeenError, cloud_from_disparity, crop_cloud
from recon.depth import StereoPair, matched
from recon.depth.disparity_io import read_disparity, write_disparity
from recon.depth.temporal import TemporalParameters, match_sequence
from recon.fusion import fused
from recon.geometry.mesh import no_cloud_digest, write_cloud, write_mesh, write_no_cloud
from recon.pipeline.run import COLOURS_NAME, cloud_name, depth_name, matched_name, mesh_name, read_clouds
from recon.rig import Camera
from recon.storage.artefacts import Artefacts, code_version, file_digest, key_of
from recon.storage.files import read_json, write_json
from recon.storage.remote import fetched
from recon.surface import NoSurfaceError, SurfaceParameters
from recon.surface.colours import SensorColours, balance_colours, estimate_colours


def match_frame(capture: Capture, run: Path, method: str, sensor_id: str, frame: int) -> list[str]:
    """The disparities of one frame of one sensor by itself."""
    key = {
        "pictures": _picture_key(capture, sensor_id, frame),
        "method": method,
        "code": code_version("depth", "capture/rectify.py"),
    }

    def write(path: Path) -> list[str]:
        rectification = _rectification(capture, sensor_id)
        pair = _stereo_pair(capture, rectification, sensor_id, frame)
        if pair is None:
            width, height = rectification.left.size
            write_disparity(path, np.full((height, width), np.nan, np.float32))
            return []
        disparity, warnings = matched(method, pair)
        write_disparity(path, disparity)
        return [f"{method}: sensor {sensor_id}, frame {frame}: {warning}" for warning in warnings]

    name = matched_name(method, sensor_id, frame)
    return [name] if Artefacts(run).make(name, key, write) else []


def filter_sequence(
    capture: Capture,
    run: Path,
    method: str,
    sensor_id: str,
    frames: Sequence[int],
    parameters: TemporalParameters | None,
) -> list[str]:
    """The depth maps of one sensor, filtered in time; without parameters, as they were matched.

    A frame depends on all before it, so its key does too.
    """
    artefacts = Artefacts(run)
    keys: dict[int, dict[str, Any]] = {}
    before: str | None = None
    for frame in frames:
        keys[frame] = {
            "before": before,
            "matched": artefacts.digest(matched_name(method, sensor_id, frame)),
            "parameters": None if parameters is None else asdict(parameters),
            "code": code_version("depth"),
        }
        before = key_of(keys[frame])
    missing = [frame for frame in frames if not artefacts.has(depth_name(method, sensor_id, frame), keys[frame])]
    if not missing:
        return []
    for frame, disparity in _filtered(capture, run, method, sensor_id, frames, parameters):
        if frame in missing:
            name = depth_name(method, sensor_id, frame)
            artefacts.make(name, keys[frame], partial(write_disparity, disparity=disparity))
    return [depth_name(method, sensor_id, frame) for frame in missing]


def make_cloud(
    capture: Capture, run: Path, method: str, sensor_id: str, frame: int, parameters: CloudParameters
) -> list[str]:
    """The cloud of one depth map, within the capture's bounds; a file without points where nothing is seen."""
    depth = depth_name(method, sensor_id, frame)
    key = {
        "depth": Artefacts(run).digest(depth),
        "pictures": _picture_key(capture, sensor_id, frame),
        "parameters": asdict(parameters),
        "code": code_version("cloud.py", "geometry", "capture/rectify.py"),
    }

    def write(path: Path) -> list[str]:
        rectification = _rectification(capture, sensor_id)
        left, _ = rectify_images(rectification, *read_frame(capture, sensor_id, frame))
        try:
            cloud = cloud_from_disparity(read_disparity(fetched(run / depth)), left, rectification, parameters)
            write_cloud(path, crop_cloud(cloud, capture.bounds))
        except NothingSeenError as error:
            write_no_cloud(path)
            is_masked = _stereo_pair(capture, rectification, sensor_id, frame) is None
            reason = "its mask is empty" if is_masked else error
            return [f"{method}: sensor {sensor_id} sees nothing in frame {frame}: {reason}"]
        return []

    name = cloud_name(method, sensor_id, frame)
    return [name] if Artefacts(run).make(name, key, write) else []


def frames_without_points(capture: Capture, run: Path, method: str, frames: Sequence[int]) -> list[int]:
    """The frames of which no sensor has a cloud."""

    def has_none(frame: int) -> bool:
        clouds = [cloud_name(method, stream.id, frame) for stream in capture.sensors]
        return set(Artefacts(run).digests(clouds)) == {no_cloud_digest()}

    return [frame for frame in frames if has_none(frame)]


def compare_colours(capture: Capture, run: Path, method: str, frame: int, place_mm: float) -> list[str]:
    """What makes the sensors' colours agree, estimated once for a run, so that all approaches get the same colours."""
    clouds = [cloud_name(method, stream.id, frame) for stream in capture.sensors]
    key = {
        "clouds": Artefacts(run).digests(clouds),
        "place_mm": place_mm,
        "code": code_version("surface/colours.py"),
    }

    def write(path: Path) -> None:
        colours = estimate_colours(read_clouds(run, clouds), place_mm)
        write_json(path, {"gain": colours.gain.tolist(), "offset": colours.offset.tolist()})

    return [COLOURS_NAME] if Artefacts(run).make(COLOURS_NAME, key, write) else []


def make_mesh(
    capture: Capture, run: Path, approach: Approach, frame: int, parameters: SurfaceParameters, *, balanced: bool
) -> list[str]:
    """The mesh that one approach fuses from the clouds of all sensors, their colours made to agree if `balanced`."""
    clouds = [cloud_name(approach.depth, stream.id, frame) for stream in capture.sensors]
    key = {
        "clouds": Artefacts(run).digests(clouds),
        "colours": Artefacts(run).digest(COLOURS_NAME) if balanced else None,
        "fusion": approach.fusion,
        "parameters": asdict(parameters),
        "code": code_version("surface", "fusion.py", "geometry"),
    }

    def write(path: Path) -> list[str]:
        sensors = read_clouds(run, clouds)
        if balanced:
            sensors = balance_colours(sensors, _colours(run))
        try:
            mesh, left_out = fused(approach.fusion, sensors, parameters)
        except NoSurfaceError as error:
            raise NoSurfaceError(f"{approach}: frame {frame} has no model: {error}") from error
        write_mesh(path, mesh)
        return [f"{approach}: frame {frame}: {reason}" for reason in left_out]

    name = mesh_name(str(approach), frame)
    return [name] if Artefacts(run).make(name, key, write) else []


def _filtered(
    capture: Capture,
    run: Path,
    method: str,
    sensor_id: str,
    frames: Sequence[int],
    parameters: TemporalParameters | None,
) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """The depth maps of frames; the filter forgets everything where the sensor sees nothing."""
    rectification = _rectification(capture, sensor_id)

    def matched(frame: int) -> NDArray[np.float32]:
        return read_disparity(fetched(run / matched_name(method, sensor_id, frame)))

    for sees, group in groupby(frames, key=lambda frame: bool(np.isfinite(matched(frame)).any())):
        stretch = list(group)
        disparities = map(matched, stretch)
        if parameters is None or not sees:
            yield from zip(stretch, disparities, strict=True)
            continue
        found = (_stereo_pair(capture, rectification, sensor_id, frame) for frame in stretch)
        pairs = (pair for pair in found if pair is not None)  # there is one where something was matched
        known = partial(_next_of, disparities)
        yield from zip(stretch, match_sequence(pairs, known, parameters), strict=True)


def _next_of(disparities: Iterator[NDArray[np.float32]], _pair: StereoPair) -> NDArray[np.float32]:
    """The disparities of a pair as they were matched before."""
    return next(disparities)


def _colours(run: Path) -> SensorColours:
    content = read_json(fetched(run / COLOURS_NAME))
    return SensorColours(np.array(content["gain"]), np.array(content["offset"]))


def _rectification(capture: Capture, sensor_id: str) -> Rectification:
    return rectify(capture.stream(sensor_id).sensor, capture.bounds)


def _stereo_pair(capture: Capture, rectification: Rectification, sensor_id: str, frame: int) -> StereoPair | None:
    """The rectified pictures of a frame; None where a mask shows no foreground."""
    masks = read_masks(capture, sensor_id, frame)
    left_mask, right_mask = rectify_masks(rectification, *masks) if masks else (None, None)
    if any(mask is not None and not mask.any() for mask in (left_mask, right_mask)):
        return None
    left, right = rectify_images(rectification, *read_frame(capture, sensor_id, frame))
    return StereoPair(left, right, rectification.n_disparities, left_mask=left_mask, right_mask=right_mask)


def _picture_key(capture: Capture, sensor_id: str, frame: int) -> dict[str, Any]:
    """What a frame of a sensor is made of: its files, its cameras and the bounds."""
    stream = capture.stream(sensor_id)
    patterns = (stream.left.image, stream.right.image, *(stream.mask or ()))
    cameras = (stream.left.camera, stream.right.camera)
    return {
        "files": [_digest_once(fetched(image_path(capture.folder, pattern, frame))) for pattern in patterns],
        "frame": frame,
        "cameras": [camera_key(camera) for camera in cameras],
        "bounds": capture.bounds.tolist(),
    }


def camera_key(camera: Camera) -> list[Any]:
    """What a camera is, for the key of an artefact."""
    return [camera.K.tolist(), camera.dist.tolist(), camera.size, camera.cam_from_world.tolist()]


@cache
def _digest_of(path: Path, _changed_ns: int, _n_bytes: int) -> str:
    return file_digest(path)


def _digest_once(path: Path) -> str:
    """Digest of a file that is read again only when it changed."""
    facts = path.stat()
    return _digest_of(path, facts.st_mtime_ns, facts.st_size)
