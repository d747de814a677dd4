"""Calibrations of robots: ROS camera_info, Kalibr's camchain, and EuRoC's sensor.yaml, all in metres.

Convention: pixel centres at integers. ROS: R turns a camera into the rectified one, whose P[:, 3] = P[:, :3] t places
it beside the left one. Kalibr: T_cn_cnm1 is camera n from camera n - 1. EuRoC: T_BS is the body from the camera.

Source: `sensor_msgs/CameraInfo.msg`; Kalibr's wiki "YAML formats"; Burri et al., "The EuRoC micro aerial vehicle
datasets", 2016.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import CaptureError
from recon.capture.importing.calibrations.placed import (
    CAMERA_FROM_WORLD,
    Placed,
    check_alike,
    lens_camera,
    needed_view,
    pinhole,
    read_yaml,
)
from recon.capture.importing.sources import faults_at
from recon.capture.importing.views import View
from recon.capture.recording import SIDES
from recon.geometry.rig import rigid
from recon.runtime.files import files_like, first_of

ROS_KEYS = {
    "K": ("camera_matrix", "K", "k"),
    "D": ("distortion_coefficients", "D", "d"),
    "R": ("rectification_matrix", "R", "r"),
    "P": ("projection_matrix", "P", "p"),
}
SMALLEST_SHIFT = 1e-9  # of P's last column: a left camera has 0
KALIBR_PLACES = ("cam{number}", "cam{number}/data", "cam{number}/image_raw", "mav0/cam{number}/data")
CAMERA_KEYS = ("camera_model", "intrinsics", "distortion_model", "distortion_coeffs", "resolution", "T_cn_cnm1")
SIDE_PLACES = (("left", "cam0"), ("right", "cam1"))


def read_ros(source: Path, unit_mm: float) -> Placed:
    """Read a pair of ROS's camera_info, `left.yaml` and `right.yaml`, or two messages as `rostopic echo` prints them.

    Which is the left one, the projection matrices say. Each camera's pictures have its file's name, or `left`, `right`.
    """
    folder = source if source.is_dir() else source.parent
    contents = {path: read_yaml(path) for path in files_like(folder, "*.yaml", "*.yml")}
    infos = {path: content for path, content in contents.items() if not content.keys().isdisjoint(ROS_KEYS["P"])}
    named = {path: info for path, info in infos.items() if path.stem.lower() in SIDES}
    infos = named if len(named) == 2 else infos  # not the ost.yaml of one camera beside them
    if len(infos) != 2:
        names = f" ({', '.join(path.name for path in infos)})" if infos else ""
        raise CaptureError(
            f"{folder}: expected two files of camera_info, left.yaml and right.yaml, found {len(infos)}{names}"
        )
    facts = {path: _ros_facts(path, content) for path, content in infos.items()}
    left, right = sorted(facts, key=lambda path: bool(np.abs(facts[path]["shift"]).max() > SMALLEST_SHIFT))
    shifts = [facts[path]["shift"] for path in (left, right)]
    if not np.abs(shifts[1] - shifts[0]).max() > SMALLEST_SHIFT:
        raise CaptureError(
            f"{right}: the projection matrices of both cameras are alike, so that nothing tells the baseline; "
            "calibrate them as a stereo pair, which writes it into the right one's"
        )
    right_from_left = np.linalg.inv(rigid(facts[right]["R"], np.zeros(3))) @ rigid(
        facts[left]["R"], (shifts[1] - shifts[0]) * unit_mm
    )
    poses = {left: CAMERA_FROM_WORLD, right: right_from_left @ CAMERA_FROM_WORLD}
    views = {}
    for number, (path, pose) in enumerate(poses.items()):
        content, fact = infos[path], facts[path]
        size = (content.get(f"image_{name}", content.get(name)) for name in ("width", "height"))
        camera = lens_camera(path, content, fact["K"], size, pose, fact["D"])
        views[number] = View(path.name, camera, needed_view(folder, (path.stem, *SIDE_PLACES[number]), number))
    return Placed(views)


def _ros_facts(path: Path, content: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
    """Return K, D, R and where the rectified camera stands, in its own unit, relative to the left one."""
    facts = {}
    with faults_at(path):
        for name, keys in ROS_KEYS.items():
            value = next(content[key] for key in (*keys, "") if key in content or not key)
            facts[name] = np.array(value["data"] if isinstance(value, Mapping) else value, np.float64)
        facts["K"], facts["R"] = facts["K"].reshape(3, 3), facts["R"].reshape(3, 3)
        P = facts["P"].reshape(3, 4)
        facts["shift"] = np.asarray(np.linalg.solve(P[:, :3], P[:, 3]), np.float64)
    return facts


def read_kalibr(source: Path, unit_mm: float) -> Placed:
    """Read a camchain of Kalibr: cam0, cam1 and so on, each placed from the one before; neighbours are pairs."""
    paths = [source] if source.is_file() else files_like(source, "*camchain*.yaml", "*.yaml")
    chains = {path: chain for path in paths if "cam0" in (chain := read_yaml(path))}
    if not chains:
        raise CaptureError(f"{source}: holds no camchain, a YAML file with cam0, cam1 and so on")
    check_alike(source, {path: _of_cameras(chain) for path, chain in chains.items()})
    path, chain = next(iter(chains.items()))
    folder = path.parent
    pose, views = CAMERA_FROM_WORLD, {}
    for number in range(sum(name.startswith("cam") for name in chain)):
        with faults_at(f"{path}: cam{number}"):
            entry = chain[f"cam{number}"]
            if number:
                pose = _scaled(entry["T_cn_cnm1"], unit_mm) @ pose
            places = (*KALIBR_PLACES, *(SIDE_PLACES[number][:1] if number < len(SIDE_PLACES) else ()))
            views[number] = _view(f"{path}: cam{number}", entry, pose, needed_view(folder, places, number), "coeffs")
    return Placed(views)


def _of_cameras(chain: Mapping[str, Any]) -> dict[tuple[str, str], Any]:
    """Return what a camchain says of its cameras alone, without the clock and place of an inertial sensor."""
    return {(name, key): camera[key] for name, camera in chain.items() for key in CAMERA_KEYS if key in camera}


def read_euroc(source: Path, unit_mm: float) -> Placed:
    """Read EuRoC's `mav0/cam0/sensor.yaml` and so on, with the pictures in `data`; neighbours are pairs."""
    base = source.parent.parent if source.is_file() else first_of(source, ["mav0"]) or source
    views: dict[int, View] = {}
    first, fps = np.eye(4), None
    for path in files_like(base, "cam[0-9]/sensor.yaml"):
        number, entry = int(path.parent.name[-1]), read_yaml(path)
        with faults_at(path):
            body_from_camera = _scaled(entry["T_BS"], unit_mm)
            fps = float(entry["rate_hz"]) if "rate_hz" in entry else fps
            first = first if views else body_from_camera
            pose = np.linalg.inv(body_from_camera) @ first @ CAMERA_FROM_WORLD
            views[number] = _view(path, entry, pose, needed_view(path.parent, ("data",), number), "coefficients")
    return Placed(views, fps=fps)


def _view(place: object, entry: Mapping[str, Any], pose: NDArray[np.float64], image: Path, lens: str) -> View:
    """Return the view of a camera of Kalibr or EuRoC, who call all but the lens's numbers alike."""
    if (model := entry.get("camera_model", "pinhole")) != "pinhole":
        raise CaptureError(f"the camera model is {model}, expected pinhole; undistort the pictures, or calibrate so")
    lens_name = {"distortion_model": entry["distortion_model"]}
    camera = lens_camera(
        place, lens_name, pinhole(entry["intrinsics"]), entry["resolution"], pose, entry[f"distortion_{lens}"]
    )
    return View(image.name, camera, image)


def _scaled(transform: Any, unit_mm: float) -> NDArray[np.float64]:
    """Return a transform (4, 4) in mm: of rows, of which the last one may lack, or of rows, cols and data."""
    told = np.array(transform["data"] if isinstance(transform, Mapping) else transform, np.float64)
    matrix = (np.append(told, (0, 0, 0, 1)) if told.size == 12 else told).reshape(4, 4).copy()
    matrix[:3, 3] *= unit_mm
    return matrix
