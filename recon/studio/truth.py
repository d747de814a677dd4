"""The ground truth of a synthetic capture: `truth/` in its folder.

`truth/depth/<sensor>/<side>/<frame>.png` holds the depth z in the camera's frame at each pixel's centre, 16 bit:
0 where no actor is, else z = DEPTH_FROM_MM + DEPTH_STEP_MM * value. `truth/mask/...` is 255 where an actor is at the
pixel's centre. `truth/mesh/<frame>.ply` is what was rendered. `truth/truth.json` holds the true cameras and poses.
`truth_models` lays the meshes out as an approach, so that they are filmed as reconstructions are.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import Capture, CaptureError
from recon.studio.rasterise import Visibility

DEPTH = "truth/depth/{view}/{frame:04d}.png"
MASK = "truth/mask/{view}/{frame:04d}.png"
MESH = "truth/mesh/{frame:04d}.ply"
FACTS = "truth/truth.json"
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
    depth = _steps(seen.depths(size), DEPTH_FROM_MM, DEPTH_STEP_MM)
    for pattern, picture in ((DEPTH, depth), (MASK, np.where(depth > 0, 255, 0).astype(np.uint8))):
        _write_png(folder / pattern.format(view=view, frame=frame), picture)


def write_depth_map(path: Path, size: tuple[int, int], seen: Visibility) -> None:
    """Write the depth z of what one camera sees as a depth map of a capture, in steps of `DEPTH_MAP_STEP_MM`.

    Parameters
    ----------
    path : a PNG
    size : (width, height) of the camera's image, pixels
    seen : what the camera sees
    """
    _write_png(path, _steps(seen.depths(size), 0.0, DEPTH_MAP_STEP_MM))


def _steps(depths: NDArray[np.float64], from_mm: float, step_mm: float) -> NDArray[np.uint16]:
    """Count the steps to each depth (H, W), at least 1; 0 where there is none."""
    steps = np.clip(np.rint((depths - from_mm) / step_mm), 1, np.iinfo(np.uint16).max)
    return np.where(depths > 0, steps, 0).astype(np.uint16)


def _write_png(path: Path, picture: NDArray[np.integer]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(".png", picture, PNG)[1].tobytes())


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
