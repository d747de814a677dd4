"""The ground truth of a synthetic capture: `truth/` in its folder.

`truth/depth/<sensor>/<side>/<frame>.png` holds the depth z in the camera's frame at each pixel's centre, 16 bit:
0 where no actor is, else z = DEPTH_FROM_MM + DEPTH_STEP_MM * value. `truth/mask/...` is 255 where an actor is at the
pixel's centre. `truth/mesh/<frame>.ply` is what was rendered. `truth/truth.json` holds the true cameras and poses.
`write_truth_models` lays the meshes out as an approach, so that they are filmed as reconstructions are.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import Capture, CaptureError
from recon.storage.files import new_folder, write_json
from recon.studio.rasterise import Visibility

DEPTH = "truth/depth/{view}/{frame:04d}.png"
MASK = "truth/mask/{view}/{frame:04d}.png"
MESH = "truth/mesh/{frame:04d}.ply"
FACTS = "truth/truth.json"
TRUTH = "truth"  # the approach whose models are true
SCENE_FILE = "scene.json"
DEPTH_FROM_MM = 1000.0
DEPTH_STEP_MM = 0.05
DEPTH_MAP_STEP_MM = 0.1  # up to 6.5 m
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE,
       cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP)  # fmt: skip


def write_view(folder: Path, view: str, frame: int, size: tuple[int, int], seen: Visibility) -> None:
    """Write depth and mask of what one camera sees.

    Parameters
    ----------
    folder : `truth/` of the capture
    view : SENSOR/SIDE
    frame : number, from 0
    size : (width, height) of the camera's image, pixels
    seen : what the camera sees
    """
    depth, mask = np.zeros(size[::-1], np.uint16), np.zeros(size[::-1], np.uint8)
    h, w = seen.nearness.shape[:2]
    window = np.s_[seen.row : seen.row + h, seen.column : seen.column + w]
    _quantise(seen.nearness, depth[window], mask[window], DEPTH_FROM_MM, DEPTH_STEP_MM)
    for pattern, picture in ((DEPTH, depth), (MASK, mask)):
        path = folder / pattern.format(view=view, frame=frame)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(cv2.imencode(".png", picture, PNG)[1].tobytes())


def write_depth_map(path: Path, size: tuple[int, int], seen: Visibility) -> None:
    """Write the depth z of what one camera sees as a depth map of a capture, in steps of `DEPTH_MAP_STEP_MM`.

    Parameters
    ----------
    path : a PNG
    size : (width, height) of the camera's image, pixels
    seen : what the camera sees
    """
    depth = np.zeros(size[::-1], np.uint16)
    h, w = seen.nearness.shape[:2]
    window = depth[seen.row : seen.row + h, seen.column : seen.column + w]
    _quantise(seen.nearness, window, np.zeros((h, w), np.uint8), 0.0, DEPTH_MAP_STEP_MM)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(".png", depth, PNG)[1].tobytes())


@numba.njit(cache=True, nogil=True)
def _quantise(
    nearness: NDArray[np.float32], depth: NDArray[np.uint16], mask: NDArray[np.uint8], from_mm: float, step_mm: float
) -> None:
    for y in range(nearness.shape[0]):
        for x in range(nearness.shape[1]):
            near = nearness[y, x, 0]
            if near > 0.0:
                value = np.rint((1.0 / near - from_mm) / step_mm)
                depth[y, x] = int(min(65535.0, max(1.0, value)))
                mask[y, x] = 255


def read_depth(capture: Capture, sensor_id: str, side: str, frame: int) -> NDArray[np.float32]:
    """Read a sensor's true depth, float32 (H, W): z in the camera's frame, mm, NaN where no actor is.

    Parameters
    ----------
    capture : a synthetic one
    sensor_id : such as S1
    side : left or right
    frame : number, from 0

    Raises
    ------
    CaptureError
        If the capture has no such truth.
    """
    path = capture.folder / DEPTH.format(view=f"{sensor_id}/{side}", frame=frame)
    values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if path.is_file() else None
    if values is None:
        raise CaptureError(f"{path}: there is no such depth; only synthetic captures have one")
    return np.where(values > 0, DEPTH_FROM_MM + DEPTH_STEP_MM * values, np.nan).astype(np.float32)


def write_truth_models(capture: Capture, out: Path, frames: range | None = None) -> list[int]:
    """Write the true meshes as a folder of models, which `render` films on the path of the capture's sensors.

    Parameters
    ----------
    capture : a synthetic one
    out : the folder, which is made; `scene.json` names the capture by its path from there
    frames : those to write; None for all

    Returns
    -------
    numbers of the frames

    Raises
    ------
    CaptureError
        If the capture has no true meshes, none of the frames is in it, or `out` is not an empty folder.
    """
    meshes = {frame: capture.folder / MESH.format(frame=frame) for frame in range(capture.n_frames)}
    missing = [path for path in meshes.values() if not path.is_file()]
    if missing:
        raise CaptureError(f"{missing[0]}: there is no such mesh; only synthetic captures have true meshes")
    wanted = range(capture.n_frames) if frames is None else frames
    chosen = [frame for frame in meshes if frame in wanted]
    if not chosen:
        raise CaptureError(
            f"{capture.folder}: has frames 0 to {capture.n_frames - 1}, none of them in {wanted.start}:{wanted.stop}"
        )
    with new_folder(out) as folder:
        (folder / TRUTH).mkdir()
        for frame in chosen:
            shutil.copyfile(meshes[frame], folder / TRUTH / meshes[frame].name)
        write_json(folder / SCENE_FILE, _scene(capture, out))
    return chosen


def _scene(capture: Capture, out: Path) -> dict[str, object]:
    """Describe a folder of models that are in the world of a capture."""
    return {
        "schema_version": 1,
        "dataset": capture.name,
        "fps": capture.fps,
        "units": "mm",
        "up": "y",
        "path": {"sensors_of": Path(os.path.relpath(capture.folder.resolve(), out.resolve())).as_posix()},
    }
