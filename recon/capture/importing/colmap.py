"""COLMAP models as captures: pairs of registered images are stereo sensors.

COLMAP's scale is arbitrary, so that the unit's length has to be given. Its world is kept except for the axis that
points upwards.

Source: Schoenberger, Frahm, "Structure-from-motion revisited", CVPR 2016.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from recon.capture.format import Capture
from recon.capture.images import CaptureError
from recon.capture.importing.colmap_model import find_model, read_model
from recon.capture.importing.into_capture import write_recording
from recon.capture.importing.sources import ImportOptions, faults_at
from recon.capture.importing.views import View, bounds_of_points, choose_sensors
from recon.geometry.rig import rigid
from recon.runtime.files import first_of, in_any_case
from recon.runtime.notices import Notice


def import_colmap(
    source: Path, out: Path, pairs: Sequence[tuple[int, int]] | None, options: ImportOptions | None = None
) -> Capture:
    """Turn a COLMAP model and its images into a capture.

    Parameters
    ----------
    source : folder with `cameras`, `images` and perhaps `points3D`, from which the bounds come, all `.bin` or `.txt`,
        in itself or in `sparse/0`; the images lie in `images` in it or above the model, or in itself, their masks in
        `masks` beside these. A folder or a
        video named as an image without its suffix holds the frames that this camera recorded; else the image is the
        only frame, and images that no pair uses are held out
    out : the capture's folder, absent or empty
    pairs : IMAGE_ID of each sensor's (left, right)
    options : the unit's length has to be given

    Raises
    ------
    CaptureError
        Naming the file, the place in it and what is wrong. Nothing is left behind.
    """
    options = options or ImportOptions()
    if options.unit_mm is None:
        raise CaptureError(f"{source}: COLMAP's scale is arbitrary; give the length of its unit in mm by --units")
    folder = find_model(source)
    model = read_model(folder)
    images = _image_folder(source, folder)
    masks = in_any_case(images.with_name("masks"))
    views = {}
    for number, image in model.images.items():
        with faults_at(f"{folder}: image {number} {image.name}"):
            pose = rigid(image.pose[:3, :3], image.pose[:3, 3] * options.unit_mm)
            camera = replace(model.cameras[image.camera], cam_from_world=pose)
        names = (f"{image.name}.png", Path(image.name).with_suffix(".png"))  # COLMAP takes either
        mask = first_of(masks, names)
        views[number] = View(image.name, camera, images / image.name, mask=mask)
    if masks.is_dir() and all(view.mask is None for view in views.values()):
        warnings.warn(f"{masks}: holds no mask of an image's name, such as NAME.jpg.png", Notice, stacklevel=2)
    bounds = bounds_of_points(model.points * options.unit_mm)
    return write_recording(out, choose_sensors(source, views, pairs or (), bounds), options)


def _image_folder(source: Path, model: Path) -> Path:
    folders = (source / "images", model / "images", model.resolve().parent.parent / "images")
    return first_of(source, folders) or source
