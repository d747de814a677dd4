"""The common start of every exporter: a frame of a capture becomes photographs with cameras in a new folder.

Pictures are copied as they are, with their distortion; frames of videos become PNG files. World and axes stay those of
the capture, lengths become metres.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.capture.depth_maps import read_depth_map
from recon.capture.format import (
    Capture,
    CaptureError,
    Picture,
    SensorStream,
    frame_pictures,
    image_path,
    mask_pictures,
    read_mask,
    read_picture,
)
from recon.capture.images import is_video, write_picture
from recon.capture.pictures import copy_file
from recon.geometry.rig import Camera
from recon.runtime.remote import fetched

MM_PER_METRE = 1000.0
WHITE = 255


@dataclass(frozen=True, eq=False)
class ExportedView:
    """A photograph of a frame.

    Parameters
    ----------
    name : of its image in the export
    picture : where it is in the capture
    mask : its foreground mask, or None
    depth_stream : the sensor whose depth maps belong to it, or None
    is_test : whether it is a held-out photograph
    """

    name: str
    picture: Picture
    mask: Picture | None = None
    depth_stream: SensorStream | None = None
    is_test: bool = False

    @property
    def camera(self) -> Camera:
        """The camera that took it, mm."""
        return self.picture.camera


def exported_views(capture: Capture, frame: int) -> list[ExportedView]:
    """List the photographs of a frame: both cameras of each sensor in turn, then those held out.

    Parameters
    ----------
    capture : the capture
    frame : number, from 0

    Raises
    ------
    CaptureError
        If there is no such frame.
    """
    capture.check_frame(frame)
    views = []
    for stream in capture.sensors:
        masks = mask_pictures(capture.folder, stream, frame)
        for place, picture in enumerate(frame_pictures(capture.folder, stream, frame)):
            mask = masks[place] if masks else None
            depth_stream = stream if place == 0 and stream.depth else None
            name = f"{stream.id}_{stream.sides[place]}{_suffix(picture.path)}"
            views.append(ExportedView(name, picture, mask, depth_stream))
    return [*views, *_held_out_views(capture, frame, [view.name for view in views])]


def _held_out_views(capture: Capture, frame: int, others: Sequence[str]) -> list[ExportedView]:
    """List the held-out photographs of a frame, numbered where names without suffix, as of masks, would be alike."""
    pictures = [
        Picture(image_path(capture.folder, shot.image, frame), frame, shot.camera)
        for shot in capture.held_out
        if shot.frame == frame
    ]
    names = ["_".join(picture.path.relative_to(capture.folder).parts) for picture in pictures]
    stems = [Path(name).stem.lower() for name in (*others, *names)]
    if len(set(stems)) < len(stems):
        names = [f"{number:04d}_{name}" for number, name in enumerate(names, start=1)]
    return [ExportedView(name, picture, is_test=True) for name, picture in zip(names, pictures, strict=True)]


def write_images(folder: Path, views: Sequence[ExportedView]) -> None:
    """Copy the views' pictures to a folder under their names; every picture is read once, to be sure of it.

    Parameters
    ----------
    folder : of the images
    views : whose pictures to copy
    """
    for view in views:
        pixels = read_picture(view.picture)
        if is_video(view.picture.path):
            write_picture(folder / view.name, pixels)
        else:
            copy_file(fetched(view.picture.path), folder / view.name)


def read_view_mask(view: ExportedView) -> NDArray[np.uint8]:
    """Return a view's mask, uint8 (H, W), 255 on the foreground; all of it where the view has none."""
    if view.mask is None:
        return np.full(view.camera.size[::-1], WHITE, np.uint8)
    return np.where(read_mask(view.mask), np.uint8(WHITE), np.uint8(0))


def read_view_depth(capture: Capture, view: ExportedView) -> NDArray[np.float32]:
    """Return a view's depth map, float32 (H, W), z in mm, 0 where there is none: everywhere if the view has none.

    Parameters
    ----------
    capture : the capture
    view : of the capture
    """
    if view.depth_stream is None:
        return np.zeros(view.camera.size[::-1], np.float32)
    return np.nan_to_num(read_depth_map(capture.folder, view.depth_stream, view.picture.frame))


def check_lens(view: ExportedView, places: Sequence[int], form: str) -> NDArray[np.float64]:
    """Return the numbers at these places of OpenCV's distortion, float64 (N,), 0 beyond its end.

    Parameters
    ----------
    view : whose camera it is
    places : that the form can hold
    form : what to call it in the message

    Raises
    ------
    CaptureError
        If another number is not 0, or the camera has skew.
    """
    camera = view.camera
    dist = np.concatenate([camera.dist, np.zeros(14 - len(camera.dist))])
    others = [place for place in range(14) if place not in places and dist[place]]
    if others or camera.K[0, 1]:
        what = f"{len(camera.dist)} distortion numbers" if others else f"skew {camera.K[0, 1]:g}"
        raise CaptureError(
            f"{view.name}: its camera has {what}, which {form} cannot describe; undistort its pictures first"
        )
    return dist[list(places)]


def names_of(views: Sequence[ExportedView], *, is_test: bool) -> Iterator[str]:
    """Yield the names of the images that are held out, or of the others.

    Parameters
    ----------
    views : all views
    is_test : which of them
    """
    return (view.name for view in views if view.is_test == is_test)


def _suffix(path: Path) -> str:
    return ".png" if is_video(path) else path.suffix.lower()
