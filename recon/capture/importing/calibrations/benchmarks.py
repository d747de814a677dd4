"""Calibrations of stereo benchmarks: Middlebury 2014 and 2021, ETH3D's two-view pairs, and KITTI's.

Convention: pixel centres at integers. Middlebury and ETH3D: rectified pairs, the baseline in mm. KITTI: P = K [R t] of
rectified cameras, in metres, camera 0 left of 1 and 2 left of 3. True disparities come in as depth maps of the left
camera.

Source: Scharstein et al., "High-resolution stereo datasets with subpixel-accurate ground truth", GCPR 2014; Schoeps et
al., "A multi-view stereo benchmark", CVPR 2017; Geiger et al., "Vision meets robotics", 2013, and its devkit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError
from recon.capture.importing.calibrations.placed import (
    CAMERA_FROM_WORLD,
    Placed,
    assigned,
    calibration_in,
    find_view,
    needed_view,
    numbers,
)
from recon.capture.importing.sources import DepthSource, faults_at
from recon.capture.importing.views import View, bounds_of_depths, pictures_of
from recon.geometry.rig import Camera, rigid
from recon.runtime.files import first_of

TRUTHS = ("disp0.pfm", "disp0GT.pfm")  # Middlebury's and ETH3D's
KITTI_CAMERAS = 4
KITTI_STEP = 256.0  # of a disparity in 16 bits
KITTI_NAMES = ("calib_cam_to_cam.txt", "calib.txt", "../calib_cam_to_cam.txt")
KITTI_TRUTHS = ("disp_occ_0", "disp_noc_0", "disp_occ", "disp_noc")
DEPTH_MARGIN = 0.02  # of the depths, before and behind


def read_middlebury_pair(source: Path, unit_mm: float) -> Placed:
    """Read `calib.txt` beside `im0.png` and `im1.png`, with the true disparities where they are."""
    path = calibration_in(source, "calib.txt")
    entry, folder = assigned(path, "="), path.parent
    with faults_at(path):
        size = (int(entry["width"]), int(entry["height"]))
        baseline = float(entry["baseline"]) * unit_mm
        Ks = [numbers(entry[f"cam{side}"]).reshape(3, 3) for side in (0, 1)]
        poses = (CAMERA_FROM_WORLD, rigid(np.eye(3), (-baseline, 0, 0)) @ CAMERA_FROM_WORLD)
        left, right = (Camera(K, size, pose) for K, pose in zip(Ks, poses, strict=True))
        offset = float(entry.get("doffs", Ks[1][0, 2] - Ks[0][0, 2]))
    truth = first_of(folder, TRUTHS)
    to_depth = _depth_of(Ks[0][0, 0] * baseline, offset)
    depth = None if truth is None else DepthSource((truth,), 1.0, depth_of=to_depth)
    with faults_at(path), np.errstate(over="ignore"):
        ends = [float(entry.get("vmax", entry.get("ndisp", "nan"))), float(entry.get("vmin", 1.0))]
        near, far = to_depth(np.array(ends, np.float32)).tolist()
    images = [needed_view(folder, ("im{number}",), side) for side in (0, 1)]
    views = {0: View("im0", left, images[0], depth), 1: View("im1", right, images[1])}
    is_told = np.isfinite([near, far]).all() and 0 < near < far
    return Placed(
        views, bounds_of_depths([(left, near * (1 - DEPTH_MARGIN), far * (1 + DEPTH_MARGIN))] if is_told else [])
    )


def _depth_of(
    focal_times_baseline: float, offset: float = 0.0, step: float = 1.0
) -> Callable[[NDArray[np.float32]], NDArray[np.float32]]:
    """Return what makes depths, mm, of disparities, in pixels or steps of them."""

    def depth_of(values: NDArray[np.float32]) -> NDArray[np.float32]:
        with np.errstate(all="ignore"):
            shift = values / step + offset
            depths = np.where(shift > 0, focal_times_baseline / shift, np.nan)
        return np.asarray(depths, np.float32)

    return depth_of


def read_kitti(source: Path, unit_mm: float) -> Placed:
    """Read KITTI's calibration: of its raw recordings, odometry, objects, or a pair of its stereo benchmarks.

    Of the last two, name the pair's own file, such as `calib_cam_to_cam/000010.txt`.
    """
    path = calibration_in(source, *KITTI_NAMES)
    entry = {
        name: text for name, text in assigned(path, ":").items() if name.startswith(("P", "K_", "D_", "R_", "T_", "S_"))
    }
    root = source if source.is_dir() else path.parent
    root = root if _kitti_places(root, path.stem) else root.parent
    views: dict[int, View] = {}
    for number, image in _kitti_places(root, path.stem).items():
        with faults_at(f"{path}: camera {number}"):
            views[number] = View(
                f"image_{number}", _kitti_camera(entry, number, pictures_of(image).size, unit_mm), image
            )
    if not views:
        raise CaptureError(f"{root}: holds no pictures of KITTI; looked for image_0, image_00/data and so on")
    if 2 in views and 3 in views and (truth := first_of(root, (f"{name}/{path.stem}_10.png" for name in KITTI_TRUTHS))):
        left, right = views[2].camera, views[3].camera
        to_depth = _depth_of(left.K[0, 0] * float(np.linalg.norm(right.centre - left.centre)), step=KITTI_STEP)
        views[2] = View(views[2].name, left, views[2].image, DepthSource((truth,), 1.0, depth_of=to_depth))
    return Placed(views, up="-y")


def _kitti_places(root: Path, stem: str) -> dict[int, Path]:
    """Return where the pictures of each camera are; of a numbered calibration, those of its number."""
    names: tuple[str, ...] = ("image_0{number}/data", "image_0{number}", "image_{number}")
    if stem.isdecimal():
        names = ("image_{number}/{stem}_10", "image_{number}/{stem}")
    places = {number: find_view(root, names, number, {"stem": stem}) for number in range(KITTI_CAMERAS)}
    return {number: place for number, place in places.items() if place is not None}


def _kitti_camera(entry: Mapping[str, str], number: int, size: tuple[int, int], unit_mm: float) -> Camera:
    """Return a camera: the rectified one, or the one before if the pictures have its size."""
    name = f"{number:02d}"
    sizes = {
        key: tuple(map(int, numbers(entry[f"{key}_{name}"]))) for key in ("S", "S_rect") if f"{key}_{name}" in entry
    }
    if size == sizes.get("S") != sizes.get("S_rect"):
        R, T = numbers(entry[f"R_{name}"]).reshape(3, 3), numbers(entry[f"T_{name}"])
        return Camera(
            numbers(entry[f"K_{name}"]).reshape(3, 3), size, rigid(R, T * unit_mm), numbers(entry[f"D_{name}"])
        )
    if "S_rect" in sizes and size != sizes["S_rect"]:
        raise CaptureError(f"its pictures have {size} pixels, the calibration is for {sizes['S_rect']}")
    P = numbers(entry[f"P{number}" if f"P{number}" in entry else f"P_rect_{name}"]).reshape(3, 4)
    return Camera(P[:, :3], size, rigid(np.eye(3), np.linalg.solve(P[:, :3], P[:, 3]) * unit_mm))
