"""Describe pictures, masks, depth maps and cameras for keys: what a file is made of, by the digests of its contents."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from recon.capture.depth_maps import depth_maps_of
from recon.capture.format import CameraStream, Capture, SensorStream, depth_path, image_path
from recon.capture.recording import GIVEN
from recon.geometry.rig import Camera
from recon.pipeline.run import View
from recon.runtime.artefacts import file_digest
from recon.runtime.remote import fetched


def picture_key(capture: Capture, view: View) -> dict[str, Any]:
    """Describe the pictures and depth maps of a view for a key: their files, cameras and bounds."""
    stream = capture.stream(view.sensor_id)
    if view.method == GIVEN:
        return files_key(capture, view, (stream.left,), (stream.mask or ())[:1]) | _depth_key(
            capture, stream, view.frame
        )
    return files_key(capture, view, stream.cameras, stream.mask or ())


def files_key(capture: Capture, view: View, cameras: Sequence[CameraStream], masks: Sequence[str]) -> dict[str, Any]:
    """Describe pictures of a view for a key: the files of cameras and of masks.

    Parameters
    ----------
    capture : the recording
    view : which frame of it
    cameras : whose pictures
    masks : patterns of the masks' files
    """
    patterns = (*(camera.image for camera in cameras), *masks)
    return {
        "files": [digest_once(fetched(image_path(capture.folder, pattern, view.frame))) for pattern in patterns],
        "frame": view.frame,
        "cameras": [camera_key(stream.camera) for stream in cameras],
        "bounds": capture.bounds.tolist(),
    }


def _depth_key(capture: Capture, stream: SensorStream, frame: int) -> dict[str, Any]:
    depth = depth_maps_of(stream)
    meaning = {"scale_mm": depth.scale_mm, "kind": depth.kind, "size": depth.size}
    return {"depth": digest_once(fetched(depth_path(capture.folder, depth, frame))), "meaning": meaning}


def camera_key(camera: Camera) -> list[Any]:
    """Describe a camera for a key."""
    return [camera.K.tolist(), camera.dist.tolist(), camera.size, camera.cam_from_world.tolist()]


@cache
def _digest_of(path: Path, _changed_ns: int, _n_bytes: int) -> str:
    return file_digest(path)


def digest_once(path: Path) -> str:
    """Digest a file, again only when it changed."""
    facts = path.stat()
    return _digest_of(path, facts.st_mtime_ns, facts.st_size)
