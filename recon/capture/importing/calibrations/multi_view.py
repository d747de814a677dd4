"""Calibrations of multi-view sets: Strecha's `.camera`, MVSNet's and DTU's `cam.txt`, and MPEG's MIV (JSON).

Convention: Strecha: x = K [R^T | -R^T t] X, metres, pixel centres at integers. MVSNet: `extrinsic` is the camera from
the world, pixel centres as its matrices have them. MIV: metres; a camera looks along x with y to the left and z up,
turned by yaw, pitch and roll about z, y and x; pixel centres at halves.

Source: Strecha et al., "On benchmarking camera calibration and multi-view stereo", CVPR 2008; Yao et al., "MVSNet",
ECCV 2018; ISO/IEC 23090-12 and its test model's manual.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from recon.capture.images import PICTURE_SUFFIXES, CaptureError
from recon.capture.importing.calibrations.placed import (
    Placed,
    calibration_in,
    find_view,
    numbers,
    pinhole,
    read_text,
)
from recon.capture.importing.sources import DepthSource, faults_at
from recon.capture.importing.views import HALF_PIXEL, View, bounds_of_depths, pictures_of, tell_absent
from recon.geometry.rig import Camera, rigid
from recon.runtime.files import files_like, first_of, read_json

STRECHA_NUMBERS = 26  # K, three of distortion, R, t and the size
BYTE_BITS = 8
STRECHA_IMAGES = ("", "images", "../images")
MVSNET_IMAGES = ("images", "blended_images", "../images", "../Rectified")
MVSNET_DEPTHS = ("rendered_depth_maps", "depths", "depth_est")
OFF_MIDDLE = 0.25  # of the picture's size; cameras of another resolution have their principal point farther off
MOST_DEEP = 20.0  # times the least depth; sets write 1000 m where they mean no end
METRE = 1000.0
MIV_SAYS = r'"Projection"'
MIV_VIEW = ("{name}", "{name}_texture", "textures/{name}")
OPENCV_FROM_MIV = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])


def read_strecha(source: Path, unit_mm: float) -> Placed:
    """Read `0000.jpg.camera` and so on; their pictures are beside them or in `images`."""
    folder = source if source.is_dir() else source.parent
    paths = files_like(folder, "*.camera", "cameras/*.camera")
    views, absent = [], []
    for path in paths:
        with faults_at(path):
            values = numbers(read_text(path))
            if len(values) != STRECHA_NUMBERS:
                raise CaptureError(
                    f"holds {len(values)} numbers, expected {STRECHA_NUMBERS}: K, distortion, R, t, size"
                )
            if values[9:12].any():
                raise CaptureError("has distortion, whose model the format does not tell; undistort the pictures")
            K, R, t = values[:9].reshape(3, 3), values[12:21].reshape(3, 3), values[21:24] * unit_mm
            camera = Camera(K, (int(values[24]), int(values[25])), rigid(R.T, -R.T @ t))
        name = path.stem
        files = (name, *(Path(name).stem + suffix for suffix in PICTURE_SUFFIXES))  # it may have got another suffix
        image = first_of(folder, (Path(place, file) for place in STRECHA_IMAGES for file in files))
        if image is None:
            absent.append(name)
            continue
        views.append(View(name, camera, image))
    tell_absent(folder, absent)
    return Placed(_numbered(views), is_rig=False)


def read_mvsnet(source: Path, unit_mm: float | None) -> Placed:
    """Read `cams/00000000_cam.txt` and so on, with `images` and perhaps depth maps beside `cams`."""
    folder = source if source.is_dir() else source.parent
    cams = first_of(folder, ["cams"]) or folder
    root = folder if cams != folder else folder.parent
    paths = files_like(cams, "*_cam.txt")
    if unit_mm is None:
        raise CaptureError(f"{cams}: nothing tells the unit; give its length in mm by --units (mm for DTU)")
    views, ranges, absent = [], [], []
    for path in paths:
        stem = path.stem[: -len("_cam")]
        image = find_view(root, tuple(f"{name}/{stem}" for name in MVSNET_IMAGES), 0)
        if image is None:
            absent.append(stem)
            continue
        with faults_at(path):
            camera, depths = _mvsnet_camera(path, pictures_of(image).size, unit_mm)
        if len(depths) >= 2:
            far = depths[3] if len(depths) > 3 else depths[0] + depths[1] * (depths[2] if len(depths) > 2 else 192)
            ranges.append((camera, depths[0] * unit_mm, far * unit_mm))
        truth = first_of(root, (f"{name}/{stem}.pfm" for name in MVSNET_DEPTHS))
        depth = None if truth is None else DepthSource((truth,), unit_mm)
        views.append(View(stem, camera, image, depth))
    tell_absent(cams, absent)
    return Placed(_numbered(views), bounds_of_depths(ranges), is_rig=False)


def _mvsnet_camera(path: Path, size: tuple[int, int], unit_mm: float) -> tuple[Camera, list[float]]:
    """Return a camera, and the line of depths: the least, the step, their number, the largest."""
    words = read_text(path).split()
    start, middle = words.index("extrinsic") + 1, words.index("intrinsic") + 1
    pose = np.array(words[start : start + 16], np.float64).reshape(4, 4)
    K = np.array(words[middle : middle + 9], np.float64).reshape(3, 3)
    if (np.abs(K[:2, 2] / np.array(size) - 0.5) > OFF_MIDDLE).any():
        raise CaptureError(
            f"its principal point {K[:2, 2].tolist()} is far from the middle of pictures of {size[0]}x{size[1]} "
            "pixels: the cameras are of another resolution; take the pictures that belong to them"
        )
    camera = Camera(K, size, rigid(pose[:3, :3], pose[:3, 3] * unit_mm))
    return camera, [float(word) for word in words[middle + 9 :]]


def read_miv(source: Path, unit_mm: float | None) -> Placed:
    """Read the cameras of an MIV content's JSON; pictures or a video of each have its name, v0 and so on."""
    path = calibration_in(source, "*.json", holds=MIV_SAYS)
    content, views, ranges, absent = read_json(path), [], [], []
    if unit_mm is None and content.get("lengthsInMeters") is False:
        raise CaptureError(f"{path}: says that its lengths are not in metres; give the unit's length by --units")
    unit_mm = unit_mm or METRE
    with faults_at(path):
        entries = list(enumerate(content["cameras"]))
    for place, entry in entries:
        with faults_at(f"{path}: camera {place}"):
            name = str(entry["Name"])
            image = find_view(path.parent, MIV_VIEW, place, {"name": name})
            if image is None:
                _refuse_raw(path.parent, name, entry, content)
                absent.append(name)
                continue
            camera = _miv_camera(entry, unit_mm)
            if "Depth_range" in entry:
                near, far = (float(end) * unit_mm for end in entry["Depth_range"])
                ranges.append((camera, near, min(far, near * MOST_DEEP)))
        views.append(View(name, camera, image))
    tell_absent(path, absent)
    return Placed(_numbered(views), bounds_of_depths(ranges), "z", content.get("Fps"), is_rig=False)


def _miv_camera(entry: Mapping[str, Any], unit_mm: float) -> Camera:
    if (projection := entry.get("Projection", "Perspective")) != "Perspective":
        raise CaptureError(f"its projection is {projection}, expected Perspective")
    turn = Rotation.from_euler("ZYX", entry["Rotation"], degrees=True).as_matrix()
    rotation = OPENCV_FROM_MIV @ turn.T
    (fx, fy), (cx, cy) = entry["Focal"], entry["Principle_point"]
    pose = rigid(rotation, -rotation @ np.array(entry["Position"], np.float64) * unit_mm)
    width, height = entry["Resolution"]
    return Camera(pinhole((fx, fy, cx - HALF_PIXEL, cy - HALF_PIXEL)), (int(width), int(height)), pose)


def _refuse_raw(folder: Path, name: str, entry: Mapping[str, Any], content: Mapping[str, Any]) -> None:
    """Say how to bring in raw YUV, which says nothing of itself."""
    raw = next(iter(files_like(folder, f"{name}_*.yuv")), None)
    if raw is not None:
        width, height = entry["Resolution"]
        bits = int(entry.get("BitDepthColor", 10))
        kind = "yuv420p" if bits <= BYTE_BITS else f"yuv420p{bits}le"
        raise CaptureError(
            f"{raw.name} is raw; convert it: ffmpeg -f rawvideo -pix_fmt {kind} -s {width}x{height} -r "
            f"{content.get('Fps', 25)} -i {raw.name} -c:v ffv1 {name}.mkv"
        )


def _numbered(views: Sequence[View]) -> dict[int, View]:
    """Number views by the digits of their names where these tell all of them apart, else in their order."""
    digits = ["".join(filter(str.isdecimal, Path(view.name).stem)) for view in views]
    told = {int(each) for each in digits if each}
    return dict(zip(map(int, digits) if len(told) == len(views) else range(len(views)), views, strict=True))
