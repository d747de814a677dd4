"""Where a model stands that was trained on photographs: found by the files that the training read or wrote.

nerfstudio's `dataparser_transforms.json` says how it moved the world of its photographs; that of our own export is the
capture's, in metres. A `transforms.json` or a COLMAP model has the cameras themselves, in whatever world and unit. In
our own export they have the names of the capture's photographs, and the capture knows where these stand.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from recon.capture.exporting.views import MM_PER_METRE, exported_views
from recon.capture.format import Capture
from recon.capture.importing.colmap_model import find_model, read_model
from recon.capture.importing.nerfstudio import TRANSFORMS
from recon.geometry.rig import OPENGL
from recon.runtime.files import read_json

DATAPARSER = "dataparser_transforms.json"
FAR_OFF = 0.02  # of the cameras' distances from their middle: where they do not stand as the capture's do
MIN_CAMERAS = 2


def beside(model: Path) -> Path | None:
    """Find the file beside a model that says where it stands; None if there is none."""
    return next((path for name in (DATAPARSER, TRANSFORMS) if (path := model.parent / name).is_file()), None)


def world_from_trained(path: Path, capture: Capture | None) -> NDArray[np.float64]:
    """Return the transform, float64 (4, 4), from the unit and axes of a trained model to the capture's world, mm.

    Parameters
    ----------
    path : a `dataparser_transforms.json`, a `transforms.json`, or the folder of a COLMAP model or project
    capture : that the photographs are of; None where that is not known

    Raises
    ------
    ValueError
        If the file does not say where the model stands; the message begins with the path.
    """
    try:
        if path.name.endswith(".json"):
            content = read_json(path)
            if "frames" not in content:
                return _world_from_moved(content)
            return _world_from_cameras(_nerfstudio_cameras(content), capture)
        model = read_model(path if any(path.glob("cameras.*")) else find_model(path))
        poses = {image.name: np.asarray(np.linalg.inv(image.pose), np.float64) for image in model.images.values()}
        return _world_from_cameras(poses, capture)
    except (KeyError, TypeError, np.linalg.LinAlgError) as error:
        raise ValueError(f"{path}: is not the file of a training: {error}") from error
    except ValueError as error:
        raise ValueError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from error


def _world_from_moved(content: Mapping[str, object]) -> NDArray[np.float64]:
    """Undo what nerfstudio did with the world of our export: turned, moved, then scaled."""
    transform, scale = np.array(content["transform"], np.float64), np.float64(content["scale"])  # type: ignore[arg-type]  # checked by shape
    if transform.shape not in ((3, 4), (4, 4)) or not scale > 0:
        raise ValueError(
            f"transform has shape {transform.shape} and scale {scale:g}, expected (3, 4) and a scale above 0"
        )
    moved = np.vstack([transform[:3], [0.0, 0, 0, 1]])
    moved[:3] *= scale
    return np.asarray(np.diag([MM_PER_METRE] * 3 + [1.0]) @ np.linalg.inv(moved))


def _nerfstudio_cameras(content: Mapping[str, object]) -> dict[str, NDArray[np.float64]]:
    """Return the pose of each image by its name, from the camera in OpenCV's frame to the file's world."""
    frames = content["frames"]
    if not isinstance(frames, list):
        raise ValueError(f"frames is {frames!r:.80}, expected a list of images")
    cameras = {}
    for frame in frames:
        pose = np.vstack([np.array(frame["transform_matrix"], np.float64)[:3], [0.0, 0, 0, 1]])
        pose[:3, :3] *= OPENGL
        cameras[PurePosixPath(str(frame["file_path"])).name] = pose
    return cameras


def _world_from_cameras(cameras: Mapping[str, NDArray[np.float64]], capture: Capture | None) -> NDArray[np.float64]:
    """Compare cameras with those of the capture's photographs by their names.

    Their axes give the turn, which places alone would not where all cameras stand in a row.
    """
    if capture is None:
        raise ValueError("has cameras, but it is not known of what; name the capture as path.sensors_of in scene.json")
    frames = {0, *(photograph.frame for photograph in capture.held_out)}
    known = {view.name: view.camera for frame in frames for view in exported_views(capture, frame)}
    shared = sorted(known.keys() & cameras.keys())
    if len(shared) < MIN_CAMERAS:
        raise ValueError(
            f"has {len(cameras)} images, of which {len(shared)} have names of photographs of {capture.name}, such as "
            f"{next(iter(known))}; train on what `capture export` wrote"
        )
    u, _, vt = np.linalg.svd(sum(known[name].rotation.T @ cameras[name][:3, :3].T for name in shared))
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    places = np.array([known[name].centre for name in shared])
    theirs = np.array([cameras[name][:3, 3] for name in shared]) @ rotation.T
    spread, their_spread = places - places.mean(axis=0), theirs - theirs.mean(axis=0)
    scale = float((spread * their_spread).sum() / max((their_spread**2).sum(), 1e-300))
    transform = np.eye(4)
    transform[:3, :3] = scale * rotation
    transform[:3, 3] = places.mean(axis=0) - scale * theirs.mean(axis=0)
    off = float(np.linalg.norm(scale * their_spread - spread, axis=1).max() / np.linalg.norm(spread, axis=1).max())
    if scale <= 0 or off > FAR_OFF:
        raise ValueError(
            f"its cameras do not stand as those of {capture.name} do: moved and scaled to fit, they are "
            f"{100 * off:.0f} % off; name the files of the training on this capture"
        )
    return transform
