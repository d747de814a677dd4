"""A small recording with labelled points, as every importer takes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.capture.format import Capture
from recon.capture.importing.opencv import import_opencv, write_calibration
from recon.capture.importing.sources import ImportOptions
from recon.geometry.rig import Camera, Rig, Sensor, look_at

SIZE = (320, 240)
BOUNDS = np.array([[-500.0, -500, -500], [500, 500, 500]])
POINTS = np.array([[0.0, 0, 0], [120, 30, -40], [-60, 90, 50], [40, -110, 70]])  # mm, labelled in the pictures below
OPTIONS = ImportOptions(bounds=BOUNDS)
TURNED = np.diag([1.0, -1.0, -1.0])  # the world where nobody tells one: the first left camera, y up


def camera(x: float, dist: list[float] | None = None) -> Camera:
    K = np.array([[410.0 + x / 10, 0, 158.5], [0, 405.0, 121.25], [0, 0, 1]])
    return Camera(K, SIZE, look_at((x, 40.0, 1500.0), (0, 0, 0)), np.array(dist or []))


RIG = Rig(
    tuple(
        Sensor(name, camera(x, [-0.1, 0.05, 0.001, -0.002]), camera(x + 150.0, [-0.12, 0.03, -0.001, 0.0005]))
        for name, x in (("S1", -300.0), ("S2", 200.0))
    )
)


def seen(view: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The labels: where a picture shows world points, by OpenCV."""
    pose = view.cam_from_world
    dist = view.dist if view.dist.size else np.zeros(5)
    return np.asarray(cv2.projectPoints(points, cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3], view.K, dist)[0][:, 0])


def write_picture(path: Path, grey: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((SIZE[1], SIZE[0], 3), grey, dtype=np.uint8))


def write_video(path: Path, greys: list[int], fps: float = 25.0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), fps, SIZE)
    for grey in greys:
        writer.write(np.full((SIZE[1], SIZE[0], 3), grey, dtype=np.uint8))
    writer.release()


def record(folder: Path, *, n_frames: int = 2) -> None:
    """Pictures of the rig beside a calibration: `S1/left/7.png` and so on."""
    for number, sensor in enumerate(RIG.sensors):
        for side, grey in (("left", 50), ("right", 100)):
            for frame in range(n_frames):
                write_picture(folder / sensor.id / side / f"{frame + 9}.png", grey + 10 * number + frame)
            write_picture(folder / sensor.id / side / "plate.png", 7)


def colmap_model(folder: Path, *, unit_mm: float = 1000.0, model: str = "OPENCV") -> Path:
    """The rig as COLMAP writes it: principal points half a pixel further, poses as quaternions, any unit."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras, images = ["# cameras"], ["# images"]
    sides = [(sensor.id, side, getattr(sensor, side)) for sensor in RIG.sensors for side in ("left", "right")]
    for number, (name, side, view) in enumerate(sides, start=1):
        focal = [view.K[0, 0], view.K[1, 1]]
        numbers = [*focal, view.K[0, 2] + 0.5, view.K[1, 2] + 0.5, *view.dist]
        cameras.append(f"{number} {model} {SIZE[0]} {SIZE[1]} " + " ".join(map(str, numbers)))
        x, y, z, w = Rotation.from_matrix(view.rotation).as_quat()
        t = view.cam_from_world[:3, 3] / unit_mm
        images += [f"{10 + number} {w} {x} {y} {z} {t[0]} {t[1]} {t[2]} {number} {name}_{side}.png", "1.0 2.0 -1"]
        write_picture(folder / "images" / f"{name}_{side}.png", 50 * number)
    points = [f"{number} {x} {y} {z} 0 0 0 0.1" for number, (x, y, z) in enumerate(POINTS / unit_mm)]
    for name, lines in (("cameras", cameras), ("images", images), ("points3D", points)):
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


def described(folder: Path, *, unit_mm: float = 1.0, pose: str = "cam_from_world", right: str | None = None) -> Path:
    """The rig in the full JSON form."""
    entries = []
    for sensor in RIG.sensors:
        entry: dict[str, Any] = {"id": sensor.id}
        for side in ("left", "right"):
            view = getattr(sensor, side)
            transforms = {
                "cam_from_world": view.cam_from_world,
                "world_from_cam": np.linalg.inv(view.cam_from_world),
                "right_from_left": view.cam_from_world @ np.linalg.inv(sensor.left.cam_from_world),
                "left_from_right": sensor.left.cam_from_world @ np.linalg.inv(view.cam_from_world),
            }
            key = right if right and side == "right" else pose
            transform = transforms[key].copy()
            transform[:3, 3] /= unit_mm
            entry[side] = {"K": view.K.tolist(), "dist": view.dist.tolist(), key: transform.tolist()}
            entry[side]["image"] = f"{sensor.id}/{side}"
        entries.append(entry)
    content = {"units": {1.0: "mm", 1000.0: "m"}[unit_mm], "bounds": (BOUNDS / unit_mm).tolist()}
    (folder / "recording.json").write_text(json.dumps({**content, "sensors": entries}))
    return folder / "recording.json"


def from_opencv(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    write_calibration(tmp_path / "source/calibration.yml", RIG)
    return import_opencv(tmp_path / "source", tmp_path / "out", OPTIONS)
