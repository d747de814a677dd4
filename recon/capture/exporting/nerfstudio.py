"""A frame of a capture as a nerfstudio dataset: `transforms.json`, images, masks, depth maps and points.

The world is the capture's turned so that z is up, in metres; `applied_transform` says so, and nerfstudio hands it on in
`dataparser_transforms.json`. So the camera paths of `render`, in the capture's world, lead to the same places.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.exporting.views import (
    MM_PER_METRE,
    ExportedView,
    check_lens,
    exported_views,
    names_of,
    read_view_depth,
    read_view_mask,
    write_images,
)
from recon.capture.format import Capture
from recon.capture.images import write_picture
from recon.capture.importing.nerfstudio import DISTORTION, TRANSFORMS
from recon.capture.importing.views import HALF_PIXEL
from recon.geometry.mesh import Cloud
from recon.geometry.mesh_files import write_cloud
from recon.geometry.rig import OPENGL
from recon.runtime.files import new_folder, write_json

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # nerfstudio's world from the capture's
PLACES = (0, 1, 2, 3, 4)  # of DISTORTION in OpenCV's numbers
POINTS = "points.ply"


def export_nerfstudio(capture: Capture, out: Path, *, frame: int = 0, points: Cloud | None = None) -> None:
    """Write a frame of a capture as a nerfstudio dataset, whole or not at all.

    Masks and depth maps are written for every image if any has one, because nerfstudio wants them for all or none: an
    image without mask gets a white one, an image without depth zeros, which say nothing.

    Parameters
    ----------
    capture : the capture
    out : the dataset's folder, absent or empty
    frame : number, from 0
    points : a cloud from which splats may start, mm

    Raises
    ------
    CaptureError
        If there is no such frame, a file is missing, or a camera has distortion that nerfstudio does not know.
    """
    views = exported_views(capture, frame)
    with new_folder(out) as folder:
        write_images(folder / "images", views)
        entries = [_entry(view) for view in views]
        if any(view.mask for view in views):
            for entry, view in zip(entries, views, strict=True):
                entry["mask_path"] = f"masks/{Path(view.name).stem}.png"
                write_picture(folder / entry["mask_path"], read_view_mask(view))
        if any(view.depth_stream for view in views):
            (folder / "depths").mkdir()
            for entry, view in zip(entries, views, strict=True):
                entry["depth_file_path"] = f"depths/{Path(view.name).stem}.npy"
                np.save(folder / entry["depth_file_path"], read_view_depth(capture, view))
        content = _header(capture, views) | {"frames": entries}
        if points is not None:
            moved = Cloud(points.points @ Z_UP.T / MM_PER_METRE, points.normals @ Z_UP.T, points.colours)
            write_cloud(folder / POINTS, moved)
            content["ply_file_path"] = POINTS
        write_json(folder / TRANSFORMS, content)


def _header(capture: Capture, views: Sequence[ExportedView]) -> dict[str, Any]:
    content: dict[str, Any] = {
        "camera_model": "OPENCV",
        "units": "m",
        "bounds": (capture.bounds / MM_PER_METRE).tolist(),
        "applied_transform": np.column_stack([Z_UP, np.zeros(3)]).tolist(),
    }
    test = [f"images/{name}" for name in names_of(views, is_test=True)]
    if test:
        content["train_filenames"] = [f"images/{name}" for name in names_of(views, is_test=False)]
        content["val_filenames"] = content["test_filenames"] = test
    return content


def _entry(view: ExportedView) -> dict[str, Any]:
    camera = view.camera
    numbers = check_lens(view, PLACES, "nerfstudio")
    return {
        "file_path": f"images/{view.name}",
        "fl_x": camera.K[0, 0],
        "fl_y": camera.K[1, 1],
        "cx": camera.K[0, 2] + HALF_PIXEL,
        "cy": camera.K[1, 2] + HALF_PIXEL,
        "w": camera.size[0],
        "h": camera.size[1],
        **dict(zip(DISTORTION, numbers.tolist(), strict=True)),
        "transform_matrix": _pose(camera.rotation, camera.centre).tolist(),
    }


def _pose(rotation: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, :3] = Z_UP @ rotation.T * OPENGL + 0.0  # no -0.0
    pose[:3, 3] = Z_UP @ centre / MM_PER_METRE
    return pose
