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

from recon.capture.depth_maps import depth_view, given_disparity, read_depth_map
from recon.capture.format import Capture, mask_pictures, read_frame, read_masks
from recon.capture.recording import GIVEN
from recon.capture.rectify import Rectification, rectify, rectify_left, rectify_left_mask
from recon.cloud import NothingSeenError, cloud_from_disparity, crop_cloud
from recon.depth import Past, rectified_pair
from recon.depth.disparity_io import read_disparity, write_disparity
from recon.depth.temporal import TemporalParameters, filtered
from recon.fusion import DepthView, view_of_cloud
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.mesh_files import no_cloud_digest, write_cloud, write_mesh, write_no_cloud
from recon.methods.approaches import Approach
from recon.methods.plugins import PluginError
from recon.pipeline.job import Job
from recon.pipeline.keys import camera_key, digest_once, picture_key
from recon.pipeline.methods import DepthMethod, depth_key, fuse, fusion_key, is_pm, match, needs_views
from recon.pipeline.run import COLOURS_NAME, View, fusion_folder, mesh_name, read_clouds
from recon.runtime.artefacts import code_version, key_of
from recon.runtime.files import read_json, write_json
from recon.runtime.programs import LOG, ProgramError
from recon.runtime.remote import fetched, stored
from recon.surface import NoSurfaceError
from recon.surface.colours import SensorColours, balance_colours, estimate_colours
from recon.surface.outlines import read_sights, with_outlines

PLACE_VOXELS = 3  # width of the places where sensors' colours are compared


def take_frame(job: Job, view: View) -> list[str]:
    """Take the given depth map of a view where its mask shows foreground, as disparities."""
    stream = job.capture.stream(view.sensor_id)
    key = {
        "pictures": picture_key(job.capture, view),
        "code": code_version("capture/depth_maps.py", "capture/rectify.py"),
    }

    def write(path: Path) -> None:
        rectification = _rectification(job.capture, view)
        disparity = given_disparity(read_depth_map(job.capture.folder, stream, view.frame), stream, rectification)
        masks = read_masks(job.capture, view.sensor_id, view.frame)
        if masks:
            disparity[~rectify_left_mask(rectification, masks[0])] = np.nan
        write_disparity(path, disparity)

    return job.artefacts.make(view.matched, key, write)


def match_stretch(job: Job, views: Sequence[View]) -> list[str]:
    """Match the pictures of some frames of a sensor in a row; PM starts each from the one before.

    So its keys depend on the frames before, and all are matched if one is missing.
    """
    if views[0].method == GIVEN:
        return [name for view in views for name in take_frame(job, view)]
    method = job.options.methods.depth[views[0].method]
    past = Past() if is_pm(method) else None
    keys: dict[View, dict[str, Any]] = {}
    before: str | None = None
    for view in views:
        keys[view] = {
            "pictures": picture_key(job.capture, view),
            "method": depth_key(method),
            "code": code_version("depth", "capture/noise.py", "capture/rectify.py"),
        } | ({} if past is None else {"before": before})
        before = key_of(keys[view])
    missing = {view for view in views if not job.artefacts.has(view.matched, keys[view])}
    made: list[str] = []
    for view in views if past and missing else missing:
        again = None if past else _matched_before(job, view, keys[view])
        disparity, warnings = _matched(job, method, view, past) if again is None else (again, [])
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


def _matched(job: Job, method: DepthMethod, view: View, past: Past | None) -> tuple[NDArray[np.float32], list[str]]:
    """Match the pictures of a view; returns the disparities, and a sentence for each warning."""
    rectification = _rectification(job.capture, view)
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
        _store_log(job, view.program)
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
    capture, parameters = job.capture, job.options.cloud
    method, sensor_id, frame = view
    key = {
        "depth": job.artefacts.digest(view.depth),
        "pictures": picture_key(capture, view),
        "parameters": asdict(parameters),
        "code": code_version("cloud.py", "geometry", "capture/rectify.py"),
    }

    def write(path: Path) -> list[str]:
        rectification = _rectification(capture, view)
        left = rectify_left(rectification, read_frame(capture, sensor_id, frame)[0])
        disparity = read_disparity(job.artefacts.path(view.depth))
        try:
            write_cloud(
                path, crop_cloud(cloud_from_disparity(disparity, left, rectification, parameters), capture.bounds)
            )
        except NothingSeenError as error:
            write_no_cloud(path)
            reason = "its mask is empty" if _is_masked(capture, rectification, view) else error
            return [f"{method}: sensor {sensor_id} sees nothing in frame {frame}: {reason}"]
        return []

    return job.artefacts.make(view.cloud, key, write)


def frames_without_points(job: Job, method: str) -> list[int]:
    """List the frames of which no sensor has a cloud by a depth method."""
    return [
        frame
        for frame in job.frames_of(method)
        if set(job.artefacts.digests(job.clouds(method, frame))) == {no_cloud_digest()}
    ]


def compare_colours(job: Job) -> list[str]:
    """Estimate once for a run what makes the sensors' colours agree, so that all approaches get the same colours.

    The clouds of the first frame by `_compared_method` are compared, in places a few voxels wide.
    """
    method = _compared_method(job)
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


def make_mesh(job: Job, approach: Approach, frame: int) -> list[str]:
    """Fuse the clouds of all sensors into one mesh.

    Parameters
    ----------
    job : whose clouds are finished, and whose colours are compared if they are to be balanced
    approach, frame : which clouds, and how to fuse them
    """
    balanced, fusion = job.options.balance_colours, job.options.methods.fusion[approach.fusion]
    clouds, surface = job.clouds(approach.depth, frame), job.surface(approach.depth)
    key = {
        "clouds": job.artefacts.digests(clouds),
        "colours": job.artefacts.digest(COLOURS_NAME) if balanced else None,
        "fusion": fusion_key(fusion, surface),
        "outlines": _outlines_key(job, approach.depth, frame) if job.options.outlines else None,
        "code": code_version("surface", "fusion", "geometry"),
    }
    folder = fusion_folder(str(approach), frame)

    def made_of(sensors: Sequence[Cloud]) -> tuple[Mesh, list[str]]:
        views = _depth_views(job.capture, sensors, approach.depth, frame) if needs_views(fusion) else None
        return fuse(fusion, sensors, surface, views=views, folder=job.artefacts.folder / folder)

    def write(path: Path) -> list[str]:
        sensors = read_clouds(job.artefacts, clouds)
        if balanced:
            sensors = balance_colours(sensors, _colours(job, approach.depth))
        try:
            if job.options.outlines:
                sights = read_sights(job.capture, job.capture.sensors_for(approach.depth), sensors, frame)
                mesh, left_out = with_outlines(sights, job.step_mm, made_of)
                if not len(mesh.faces):
                    raise NoSurfaceError(
                        "nothing of its surface lies inside the sensors' masks; expected coordinates of the clouds, in "
                        "mm, and masks that are white on the object"
                    )
            else:
                mesh, left_out = made_of(sensors)
        except NoSurfaceError as error:
            raise NoSurfaceError(f"{approach}: frame {frame} has no model: {error}") from error
        except (ProgramError, PluginError) as error:
            _store_log(job, folder)
            raise type(error)(f"{approach}: frame {frame}: {error}") from error
        write_mesh(path, mesh)
        return [f"{approach}: frame {frame}: {reason}" for reason in left_out]

    return job.artefacts.make(mesh_name(str(approach), frame), key, write)


def _outlines_key(job: Job, method: str, frame: int) -> dict[str, Any]:
    """Describe what outlines depend on beside the clouds: the masks of the sensors, their cameras and the voxel."""
    streams = job.capture.sensors_for(method)
    masks = [mask.path for stream in streams for mask in mask_pictures(job.capture.folder, stream, frame)]
    return {
        "masks": [digest_once(fetched(path)) for path in masks],
        "cameras": [camera_key(side.camera) for stream in streams for side in stream.cameras],
        "frame": frame,
        "voxel_mm": job.step_mm,
    }


def _store_log(job: Job, folder: str) -> None:
    """Put the log of a program that failed where the run is."""
    log = job.artefacts.folder / folder / LOG
    if log.is_file():
        stored(log)


def _depth_views(capture: Capture, clouds: Sequence[Cloud], method: str, frame: int) -> list[DepthView]:
    """Return the clouds of all sensors that a depth method uses as depth maps of their rectified left pictures."""
    views = [View(method, stream.id, frame) for stream in capture.sensors_for(method)]
    return [view_of_cloud(cloud, _rectification(capture, view).left) for cloud, view in zip(clouds, views, strict=True)]


def _filtered(job: Job, views: Sequence[View]) -> Iterator[tuple[View, NDArray[np.float32]]]:
    """Yield the filtered disparity maps; the filter forgets everything where the sensor sees nothing."""
    rectification = _rectification(job.capture, views[0])
    parameters = _temporal(job, views)

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


def _compared_method(job: Job) -> str:
    """Choose the depth method whose clouds tell the sensors' colours: the last of those that use the most sensors."""
    methods = (*reversed(job.options.depths), *job.options.depth_methods)
    return max(methods, key=lambda method: len(job.capture.sensors_for(method)))


def _colours(job: Job, method: str) -> SensorColours:
    """Read the correction of the sensors that a depth method uses."""
    content = read_json(job.artefacts.path(COLOURS_NAME))
    known = [stream.id for stream in job.capture.sensors_for(_compared_method(job))]
    rows = [known.index(stream.id) for stream in job.capture.sensors_for(method)]
    return SensorColours(np.array(content["gain"])[rows], np.array(content["offset"])[rows])


def _temporal(job: Job, views: Sequence[View]) -> TemporalParameters | None:
    return None if views[0].method == GIVEN else job.temporal(views[0].method)


def _rectification(capture: Capture, view: View) -> Rectification:
    stream = capture.stream(view.sensor_id)
    return depth_view(stream, capture.bounds) if view.method == GIVEN else rectify(stream.sensor, capture.bounds)


def _is_masked(capture: Capture, rectification: Rectification, view: View) -> bool:
    """Tell whether a mask of a view, as far as the method uses it, shows no foreground."""
    if view.method != GIVEN:
        return rectified_pair(capture, rectification, view.frame) is None
    masks = read_masks(capture, view.sensor_id, view.frame)
    return masks is not None and not rectify_left_mask(rectification, masks[0]).any()
