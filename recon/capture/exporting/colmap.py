"""A frame of a capture as a COLMAP project: images, masks, and a model in COLMAP's binary form.

The binary form is the one that COLMAP itself and the programs for splats look for first, and it keeps every digit. The
world is the capture's with its axes, in metres.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from recon.capture.exporting.views import (
    MM_PER_METRE,
    ExportedView,
    check_lens,
    exported_views,
    names_of,
    read_view_mask,
    write_images,
)
from recon.capture.format import Capture
from recon.capture.images import write_picture
from recon.capture.importing.colmap_model import MODEL_NAMES, MODELS
from recon.capture.importing.views import HALF_PIXEL
from recon.geometry.mesh import Cloud
from recon.runtime.files import new_folder

MODEL = "sparse/0"


def export_colmap(capture: Capture, out: Path, *, frame: int = 0, points: Cloud | None = None) -> None:
    """Write a frame of a capture as a COLMAP project, whole or not at all.

    `sparse/0/test.txt` names the held-out photographs, as programs for splats read it. COLMAP's form has no place for
    given depth maps: they are left out.

    Parameters
    ----------
    capture : the capture
    out : the project's folder, absent or empty
    frame : number, from 0
    points : a cloud from which splats may start, mm; without it the model has no points

    Raises
    ------
    CaptureError
        If there is no such frame, a file is missing, or a camera has distortion that COLMAP does not know.
    """
    views = exported_views(capture, frame)
    with new_folder(out) as folder:
        write_images(folder / "images", views)
        for view in views:
            if view.mask is not None:
                write_picture(folder / f"masks/{view.name}.png", read_view_mask(view))
        model = folder / MODEL
        model.mkdir(parents=True)
        (model / "cameras.bin").write_bytes(_cameras(views))
        (model / "images.bin").write_bytes(_images(views))
        (model / "points3D.bin").write_bytes(_points(points))
        test = list(names_of(views, is_test=True))
        if test:
            (model / "test.txt").write_text("\n".join(test) + "\n", encoding="utf-8")


def _cameras(views: Sequence[ExportedView]) -> bytes:
    parts = [struct.pack("<Q", len(views))]
    for number, view in enumerate(views, start=1):
        K = view.camera.K
        model = _model_for(view)
        dist = check_lens(view, MODELS["FULL_OPENCV"][1], "COLMAP")[: len(MODELS[model][1])]
        values = [K[0, 0], K[1, 1], K[0, 2] + HALF_PIXEL, K[1, 2] + HALF_PIXEL, *dist]
        parts.append(struct.pack("<IiQQ", number, MODEL_NAMES.index(model), *view.camera.size))
        parts.append(struct.pack(f"<{len(values)}d", *values))
    return b"".join(parts)


def _model_for(view: ExportedView) -> str:
    """Choose the simplest model that holds the camera's distortion."""
    dist = view.camera.dist
    if not dist.any():
        return "PINHOLE"
    return "OPENCV" if not dist[4:].any() else "FULL_OPENCV"


def _images(views: Sequence[ExportedView]) -> bytes:
    parts = [struct.pack("<Q", len(views))]
    for number, view in enumerate(views, start=1):
        x, y, z, w = Rotation.from_matrix(view.camera.rotation).as_quat()
        translation = view.camera.cam_from_world[:3, 3] / MM_PER_METRE
        parts.append(struct.pack("<I7dI", number, w, x, y, z, *translation, number))
        parts.append(view.name.encode("utf-8") + b"\0" + struct.pack("<Q", 0))
    return b"".join(parts)


def _points(cloud: Cloud | None) -> bytes:
    n = 0 if cloud is None else len(cloud)
    kind = [("id", "<u8"), ("point", "<f8", 3), ("colour", "u1", 3), ("error", "<f8"), ("n_images", "<u8")]
    table = np.zeros(n, np.dtype(kind))
    if cloud is not None:
        table["id"] = np.arange(1, n + 1)
        table["point"] = cloud.points / MM_PER_METRE
        table["colour"] = cloud.colours
    return struct.pack("<Q", n) + table.tobytes()
