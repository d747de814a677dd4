"""Photographs with known cameras, as structure from motion and calibrations give them: chosen ones become sensors."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import PICTURE_SUFFIXES, CaptureError
from recon.capture.importing.sources import DepthSource, Recording, SensorSource
from recon.capture.pictures import Pictures, find_pictures
from recon.capture.rectify import viewing_directions
from recon.geometry.rig import Camera, transformed
from recon.runtime.files import in_any_case
from recon.runtime.notices import Notice

HALF_PIXEL = 0.5  # added to the principal point of programs whose pixel centres are at halves
BOUNDS_SHARE = (0.02, 0.98)  # of the points, on each axis: reconstructions have stray ones
BOUNDS_MARGIN = 0.05  # of the longest edge
MOST_NAMED = 8  # of absent pictures


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
    mask : file of the photograph's mask, or None
    """

    name: str
    camera: Camera
    image: Path
    depth: DepthSource | None = None
    is_test: bool = False
    mask: Path | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "image", in_any_case(self.image))
        object.__setattr__(self, "mask", self.mask and in_any_case(self.mask))


def choose_sensors(
    source: Path,
    views: Mapping[int, View],
    pairs: Sequence[tuple[int, int]],
    bounds: NDArray[np.float64] | None,
    up: str = "y",
) -> Recording:
    """Make stereo sensors of the pairs, and sensors with depth maps of all other views that have some.

    If every camera has recorded a single image, the views that are no sensors are held out. Absent ones are named.

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
    tell_absent(source, [view.name for view in others if not view.image.exists()])
    held_out = tuple((view.camera, view.image) for view in others if view.image.is_file())
    name = source.stem if source.is_file() else source.resolve().name
    return Recording(name, sensors, bounds=bounds, held_out=held_out, up=up)


def tell_absent(source: Path, names: Sequence[str]) -> None:
    """Warn of pictures that a source lists and that are not there, by their names."""
    if names:
        more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
        warnings.warn(
            f"{source}: lists pictures that are not there, and that are left out: "
            f"{', '.join(names[:MOST_NAMED])}{more}",
            Notice,
            stacklevel=2,
        )


def bounds_of_points(points: NDArray[np.floating]) -> NDArray[np.float64] | None:
    """Return bounds (2, 3) around most of the points (N, 3), in their unit; None for fewer than two."""
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) < 2:
        return None
    box = np.quantile(points, BOUNDS_SHARE, axis=0)
    margin = BOUNDS_MARGIN * float((box[1] - box[0]).max())
    return np.asarray(box + np.array([[-margin], [margin]]))


def bounds_of_depths(ranges: Iterable[tuple[Camera, float, float]]) -> NDArray[np.float64] | None:
    """Return bounds (2, 3), mm, of what all cameras see between their least and largest depth; None for nothing.

    Parameters
    ----------
    ranges : camera, least and largest depth, mm
    """
    boxes = []
    for camera, near, far in ranges:
        if not np.isfinite([near, far]).all():
            continue
        width, height = camera.size
        corners = viewing_directions(camera, np.array([[0.0, 0], [width, 0], [0, height], [width, height]]))
        seen = transformed(np.concatenate([corners * near, corners * far]), np.linalg.inv(camera.cam_from_world))
        boxes.append((seen.min(axis=0), seen.max(axis=0)))
    if not boxes:
        return None
    low, high = np.max([box[0] for box in boxes], axis=0), np.min([box[1] for box in boxes], axis=0)
    if (low < high).all():
        return np.array([low, high])
    return np.array([np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)])


def _sensor(sensor_id: str, views: Sequence[View]) -> SensorSource:
    pictures = tuple(pictures_of(view.image) for view in views)
    masks = tuple((view.mask,) for view in views if view.mask is not None)
    if masks and (len(masks) < len(views) or any(len(side.files) > 1 or side.is_video for side in pictures)):
        warnings.warn(
            f"sensor {sensor_id}: its masks are left out, as not each camera has one picture and its mask",
            Notice,
            stacklevel=2,
        )
        masks = ()
    right = views[1].camera if len(views) > 1 else None
    return SensorSource(sensor_id, views[0].camera, right, pictures, views[0].depth, masks)


def pictures_of(image: Path) -> Pictures:
    """Find what the camera of an image recorded: a folder or a video of its name, else the image alone."""
    return find_pictures(image.with_suffix("") if image.suffix.lower() in PICTURE_SUFFIXES else image, instead_of=image)
