"""Photographs with known cameras, as structure from motion gives them: chosen ones become sensors of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import IMAGE_SUFFIXES, CaptureError
from recon.capture.importing.sources import DepthSource, Recording, SensorSource
from recon.capture.pictures import Pictures, find_pictures
from recon.geometry.rig import Camera

HALF_PIXEL = 0.5  # added to the principal point of programs whose pixel centres are at halves
BOUNDS_SHARE = (0.02, 0.98)  # of the points, on each axis: reconstructions have stray ones
BOUNDS_MARGIN = 0.05  # of the longest edge


@dataclass(frozen=True, eq=False)
class View:
    """A photograph of the source.

    Parameters
    ----------
    name : as the source calls it
    camera : pose in mm, in the source's world
    image : its file; a folder or a video named as the file without its suffix holds the frames of this camera
    depth : its depth maps, or None
    is_test : whether the source keeps it for checks of new views
    """

    name: str
    camera: Camera
    image: Path
    depth: DepthSource | None = None
    is_test: bool = False


def choose_sensors(
    source: Path,
    views: Mapping[int, View],
    pairs: Sequence[tuple[int, int]],
    bounds: NDArray[np.float64] | None,
    up: str = "y",
) -> Recording:
    """Make stereo sensors of the pairs, and sensors with depth maps of all other views that have some.

    If every camera has recorded a single image, the views that are no sensors are held out.

    Parameters
    ----------
    source : file or folder, for the recording's name and messages
    views : by their numbers in the source
    pairs : numbers of each stereo sensor's (left, right)
    bounds : float64 (2, 3), mm, in the source's world; None if the source says nothing
    up : axis of the source's world that points upwards

    Raises
    ------
    CaptureError
        If a pair names an unknown view, there is no sensor at all, or pictures are missing.
    """
    in_pairs = [number for pair in pairs for number in pair]
    alone = [number for number, view in views.items() if view.depth and not view.is_test and number not in in_pairs]
    if not set(in_pairs) <= views.keys() or not (pairs or alone):
        listed = ", ".join(f"{number} {view.name}" for number, view in views.items())
        given = f"the pairs name {sorted(set(in_pairs))}" if in_pairs else "no pairs are given"
        raise CaptureError(f"{source}: {given}, expected LEFT-RIGHT of each pair out of: {listed}")
    chosen = [*pairs, *((number,) for number in alone)]
    sensors = tuple(
        _sensor(f"S{place}", [views[number] for number in numbers]) for place, numbers in enumerate(chosen, start=1)
    )
    is_still = all(len(side.files) == 1 and not side.is_video for sensor in sensors for side in sensor.pictures)
    others = [view for number, view in views.items() if number not in {*in_pairs, *alone} and is_still]
    held_out = tuple((view.camera, view.image) for view in others if view.image.is_file())
    name = source.stem if source.is_file() else source.resolve().name
    return Recording(name, sensors, bounds=bounds, held_out=held_out, up=up)


def bounds_of_points(points: NDArray[np.floating]) -> NDArray[np.float64] | None:
    """Return bounds (2, 3) around most of the points (N, 3), in their unit; None for fewer than two."""
    if len(points) < 2:
        return None
    box = np.quantile(points, BOUNDS_SHARE, axis=0)
    margin = BOUNDS_MARGIN * float((box[1] - box[0]).max())
    return np.asarray(box + np.array([[-margin], [margin]]))


def _sensor(sensor_id: str, views: Sequence[View]) -> SensorSource:
    pictures = tuple(pictures_of(view.image) for view in views)
    if len(views) == 1:
        return SensorSource(sensor_id, views[0].camera, None, pictures, views[0].depth)
    left, right = views
    return SensorSource(sensor_id, left.camera, right.camera, pictures)


def pictures_of(image: Path) -> Pictures:
    """Find what the camera of an image recorded: a folder or a video of its name, else the image alone."""
    return find_pictures(image.with_suffix("") if image.suffix.lower() in IMAGE_SUFFIXES else image, instead_of=image)
