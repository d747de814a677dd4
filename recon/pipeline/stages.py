"""The stages of a reconstruction, one function for each kind of file: made from the files of the stage before.

Every function makes only what is not finished, and returns the names of the files that it had to make.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.checking.rows import RowFit, pivot_of, rows_of, with_rows
from recon.capture.depth_maps import depth_view, given_disparity, read_depth_map
from recon.capture.format import Capture, read_frame, read_masks
from recon.capture.recording import GIVEN, evenly_chosen
from recon.capture.rectify import Rectification, rectify, rectify_left, rectify_left_mask
from recon.cloud import NothingSeenError, cloud_from_disparity, crop_cloud
from recon.depth import Past, StereoPair, rectified_pair
from recon.depth.disparity_io import read_disparity, write_disparity
from recon.depth.temporal import TemporalParameters, filtered
from recon.geometry.mesh import Cloud
from recon.geometry.mesh_files import no_cloud_digest, write_cloud, write_no_cloud
from recon.methods.plugins import PluginError
from recon.pipeline.job import Job
from recon.pipeline.keys import picture_key
from recon.pipeline.methods import DepthMethod, depth_key, is_pm, match
from recon.pipeline.run import COLOURS_NAME, NO_CLOUD, ROWS_NAME, View, read_clouds
from recon.runtime.artefacts import code_version, key_of
from recon.runtime.files import read_json, write_json
from recon.runtime.programs import LOG, ProgramError
from recon.runtime.remote import stored
from recon.surface.colours import estimate_colours

ROWS_FRAMES = 3  # first, middle, last
PLACE_VOXELS = 3  # width of the places where sensors' colours are compared


def take_frame(job: Job, view: View) -> list[str]:
    """Take the given depth map of a view where its mask shows foreground, as disparities."""
    stream = job.capture.stream(view.sensor_id)
    key = {
        "pictures": picture_key(job.capture, view),
        "code": code_version("capture/depth_maps.py", "capture/rectify.py"),
    }

    def write(path: Path) -> None:
        rectification = rectified_view(job.capture, view)
        disparity = given_disparity(read_depth_map(job.capture.folder, stream, view.frame), stream, rectification)
        masks = read_masks(job.capture, view.sensor_id, view.frame)
        if masks:
            disparity[~rectify_left_mask(rectification, masks[0])] = np.nan
        write_disparity(path, disparity)

    return job.artefacts.make(view.matched, key, write)


def measure_rows(job: Job, sensor_id: str) -> list[str]:
    """Measure on a few frames how far the rows of a sensor's rectified pictures are apart, to match them so."""
    capture = job.capture
    frames = evenly_chosen(capture.n_frames, ROWS_FRAMES)
    key = {
        "pictures": [picture_key(capture, View("", sensor_id, frame)) for frame in frames],
        "code": code_version("capture/checking", "capture/rectify.py"),
    }

    def write(path: Path) -> list[str]:
        rectification = rectify(capture.stream(sensor_id).sensor, capture.bounds)
        pairs = (rectified_pair(capture, rectification, frame) for frame in frames)
        pictures = ((pair.left, pair.right, _masks(pair)) for pair in pairs if pair is not None)
        fit = rows_of(pictures, pivot_of(rectification))
        write_json(path, {"rows": None if fit is None else asdict(fit)})
        return [f"sensor {sensor_id}: {fit}"] if fit is not None and fit.is_off else []

    return job.artefacts.make(ROWS_NAME.format(sensor=sensor_id), key, write)


def match_stretch(job: Job, views: Sequence[View]) -> list[str]:
    """Match the pictures of some frames of a sensor in a row; PM starts each from the one before.

    So its keys depend on the frames before, and all are matched if one is missing.
    """
    if views[0].method == GIVEN:
        return [name for view in views for name in take_frame(job, view)]
    method = job.options.methods.depth[views[0].method]
    past = Past() if is_pm(method) else None
    rows = _rows(job, views[0].sensor_id)
    keys: dict[View, dict[str, Any]] = {}
    before: str | None = None
    for view in views:
        keys[view] = {
            "pictures": picture_key(job.capture, view),
            "method": depth_key(method),
            "rows": _rows_key(rows),
            "code": code_version("depth", "capture/noise.py", "capture/rectify.py"),
        } | ({} if past is None else {"before": before})
        before = key_of(keys[view])
    missing = {view for view in views if not job.artefacts.has(view.matched, keys[view])}
    made: list[str] = []
    for view in views if past and missing else missing:
        again = None if past else _matched_before(job, view, keys[view])
        disparity, warnings = _matched(job, method, view, rows, past) if again is None else (again, [])
        if view in missing:
            write = partial(_write_matched, disparity, warnings)
            made += job.artefacts.make(view.matched, keys[view], write)
    return made


def _matched_before(job: Job, view: View, key: dict[str, Any]) -> NDArray[np.float32] | None:
    """Return the disparities of the frame before if its pictures are the same, and it is matched without a warning."""
    before = view._replace(frame=view.frame - 1)
    key = key | {"pictures": key["pictures"] | {"frame": before.frame}}
    if job.artefacts.has(before.matched, key) and not job.artefacts.warnings([before.matched]):
        return read_disparity(job.artefacts.path(before.matched))
    return None


def _matched(
    job: Job, method: DepthMethod, view: View, rows: RowFit | None, past: Past | None
) -> tuple[NDArray[np.float32], list[str]]:
    """Match the pictures of a view; returns the disparities, and a sentence for each warning."""
    rectification = with_rows(rectified_view(job.capture, view), rows)
    pair = rectified_pair(job.capture, rectification, view.frame)
    if pair is None:
        if past:
            past.traces = None
        width, height = rectification.left.size
        return np.full((height, width), np.nan, np.float32), []
    where = f"{view.method}: sensor {view.sensor_id}, frame {view.frame}"
    try:
        disparity, warnings = match(method, pair, job.artefacts.folder / view.program, job.options.device, past)
    except (ProgramError, PluginError) as error:
        store_program_log(job, view.program)
        raise type(error)(f"{where}: {error}") from error
    return disparity, [f"{where}: {warning}" for warning in warnings]


def _write_matched(disparity: NDArray[np.float32], warnings: list[str], path: Path) -> list[str]:
    write_disparity(path, disparity)
    return warnings


def filter_sequence(job: Job, views: Sequence[View]) -> list[str]:
    """Filter the disparity maps of one sensor in time; without parameters for it, leave them as they were matched.

    Given depth is left as it is: its errors may be filtered already, and pictures say nothing about them. A frame is
    filtered with all frames before it, so its key depends on theirs.
    """
    parameters = _temporal(job, views)
    keys: dict[View, dict[str, Any]] = {}
    before: str | None = None
    for view in views:
        keys[view] = {
            "before": before,
            "matched": job.artefacts.digest(view.matched),
            "pictures": None if parameters is None else picture_key(job.capture, view),
            "parameters": None if parameters is None else asdict(parameters),
            "code": code_version("depth", "capture/noise.py"),
        }
        before = key_of(keys[view])
    missing = {view for view in views if not job.artefacts.has(view.depth, keys[view])}
    filtered = _filtered(job, views) if missing else ()
    for view, disparity in filtered:
        if view in missing:
            job.artefacts.make(view.depth, keys[view], partial(write_disparity, disparity=disparity))
    return [view.depth for view in views if view in missing]


def make_cloud(job: Job, view: View) -> list[str]:
    """Make the cloud of a disparity map within the capture's bounds; a file without points where nothing is seen."""

    def write(path: Path) -> list[str]:
        cloud, warnings = _measured(job, view)
        write_cloud(path, cloud) if len(cloud) else write_no_cloud(path)
        return warnings

    return job.artefacts.make(view.cloud, cloud_key(job, view), write)


def cloud_key(job: Job, view: View) -> dict[str, Any]:
    """Describe what a cloud is made of."""
    return {
        "depth": job.artefacts.digest(view.depth),
        "pictures": picture_key(job.capture, view),
        "parameters": asdict(job.options.cloud),
        "code": code_version("cloud.py", "geometry", "capture/rectify.py"),
    }


def clouds_of(job: Job, method: str, frame: int) -> tuple[list[Cloud], list[str]]:
    """Read the sensors' clouds where they are kept, else make them; also a sentence for each sensor that sees nothing.

    Parameters
    ----------
    job : whose depth maps are finished
    method, frame : which clouds

    Raises
    ------
    ValueError
        If no sensor sees anything.
    """
    if frame in job.kept_frames:
        return read_clouds(job.artefacts, job.clouds(method, frame)), []
    made = [_measured(job, view) for view in job.views(method, frame)]
    if not any(len(cloud) for cloud, _ in made):
        raise nothing_seen(job, method, [frame])
    return [cloud for cloud, _ in made], [warning for _, warnings in made for warning in warnings]


def nothing_seen(job: Job, method: str, frames: Sequence[int]) -> ValueError:
    """Say that there is no model to show of frames.

    Parameters
    ----------
    job : whose recording it is
    method, frames : by which depth method, and of what nothing is seen
    """
    named = ", ".join(map(str, frames))
    return ValueError(
        f"{job.capture.folder}: no sensor sees anything in frame {named} (depth method {method}), so that there is no "
        "model to show; look at the masks and pictures, or choose other frames with --frames A:B"
    )


def frames_without_points(job: Job, method: str) -> list[int]:
    """List the frames of which no sensor has a cloud by a depth method; no depth either, where clouds are not kept."""
    return [frame for frame in job.frames_of(method) if not any(_sees(job, view) for view in job.views(method, frame))]


def _sees(job: Job, view: View) -> bool:
    if view.frame in job.kept_frames:
        return job.artefacts.digest(view.cloud) != no_cloud_digest()
    return bool(np.isfinite(read_disparity(job.artefacts.path(view.depth))).any())


def _measured(job: Job, view: View) -> tuple[Cloud, list[str]]:
    """Make the cloud of a view, without points where nothing is seen; and a sentence that says so."""
    capture, (method, sensor_id, frame) = job.capture, view
    rectification = rectified_view(capture, view)
    left = rectify_left(rectification, read_frame(capture, sensor_id, frame)[0])
    disparity = read_disparity(job.artefacts.path(view.depth))
    try:
        cloud = cloud_from_disparity(disparity, left, rectification, job.options.cloud)
        return crop_cloud(cloud, capture.bounds), []
    except NothingSeenError as error:
        reason = "its mask is empty" if _is_masked(capture, rectification, view) else error
        return NO_CLOUD, [f"{method}: sensor {sensor_id} sees nothing in frame {frame}: {reason}"]


def store_program_log(job: Job, folder: str) -> None:
    """Put the log of a program that failed where the run is."""
    log = job.artefacts.folder / folder / LOG
    if log.is_file():
        stored(log)


def compare_colours(job: Job) -> list[str]:
    """Estimate once for a run what makes the sensors' colours agree, so that all approaches get the same colours.

    The clouds of the first frame by `compared_method` are compared, in places a few voxels wide.
    """
    method = compared_method(job)
    clouds = job.clouds(method, job.frames[0])
    voxel = job.surface(method).voxel_mm
    assert voxel is not None
    place_mm = PLACE_VOXELS * voxel
    key = {
        "clouds": job.artefacts.digests(clouds),
        "place_mm": place_mm,
        "code": code_version("surface/colours.py"),
    }

    def write(path: Path) -> None:
        colours = estimate_colours(read_clouds(job.artefacts, clouds), place_mm)
        write_json(path, {"gain": colours.gain.tolist(), "offset": colours.offset.tolist()})

    return job.artefacts.make(COLOURS_NAME, key, write)


def _filtered(job: Job, views: Sequence[View]) -> Iterator[tuple[View, NDArray[np.float32]]]:
    """Yield the filtered disparity maps; the filter forgets everything where the sensor sees nothing."""
    rectification = rectified_view(job.capture, views[0])
    parameters = _temporal(job, views)
    if parameters is not None:
        rectification = with_rows(rectification, _rows(job, views[0].sensor_id))

    def matched(view: View) -> NDArray[np.float32]:
        return read_disparity(job.artefacts.path(view.matched))

    for sees, group in groupby(views, key=lambda view: bool(np.isfinite(matched(view)).any())):
        stretch = list(group)
        disparities = map(matched, stretch)
        if parameters is None or not sees:
            yield from zip(stretch, disparities, strict=True)
            continue
        maybe = (rectified_pair(job.capture, rectification, view.frame) for view in stretch)
        pairs = (pair for pair in maybe if pair is not None)  # there is one where something was matched
        yield from zip(stretch, filtered(pairs, disparities, parameters), strict=True)


def _masks(pair: StereoPair) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
    return None if pair.left_mask is None or pair.right_mask is None else (pair.left_mask, pair.right_mask)


def _rows(job: Job, sensor_id: str) -> RowFit | None:
    content = read_json(job.artefacts.path(ROWS_NAME.format(sensor=sensor_id)))["rows"]
    return None if content is None else RowFit(**content | {"pivot": tuple(content["pivot"])})


def _rows_key(fit: RowFit | None) -> dict[str, Any] | None:
    """Describe for a key how a sensor's right pictures are moved; None where they are not."""
    return asdict(fit) if fit is not None and fit.is_off else None


def compared_method(job: Job) -> str:
    """Choose the depth method whose clouds tell the sensors' colours: the last of those that use the most sensors."""
    methods = (*reversed(job.options.depths), *job.options.depth_methods)
    return max(methods, key=lambda method: len(job.capture.sensors_for(method)))


def _temporal(job: Job, views: Sequence[View]) -> TemporalParameters | None:
    return None if views[0].method == GIVEN else job.temporal(views[0].method)


def rectified_view(capture: Capture, view: View) -> Rectification:
    """Return the rectified pair of a view, the imagined one where its depth was given."""
    stream = capture.stream(view.sensor_id)
    return depth_view(stream, capture.bounds) if view.method == GIVEN else rectify(stream.sensor, capture.bounds)


def _is_masked(capture: Capture, rectification: Rectification, view: View) -> bool:
    """Tell whether a mask of a view, as far as the method uses it, shows no foreground."""
    if view.method != GIVEN:
        return rectified_pair(capture, rectification, view.frame) is None
    masks = read_masks(capture, view.sensor_id, view.frame)
    return masks is not None and not rectify_left_mask(rectification, masks[0]).any()
