"""The synthetic studio at work: a scene becomes a capture whose depth, masks and meshes are known."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.folder import new_folder
from recon.capture.format import CameraStream, Capture, SensorStream, write_capture
from recon.execute import silent
from recon.files import write_json
from recon.mesh import write_mesh
from recon.rig import Camera
from recon.studio import truth
from recon.studio.appearance import Light, Room, noise_volume, room_plate, shade
from recon.studio.exposure import display_curve, expose, plate_values
from recon.studio.rasterise import Visibility, see
from recon.studio.rigs import arc_rig, disturbed
from recon.studio.scenes import SCENES, Scene
from recon.studio.shadow import FLOOR_CELLS, FLOOR_HALF_MM, cast, floor_shade
from recon.studio.stage import Stage, Staged

BOUNDS_MARGIN_MM = 15.0
CELL_PX = 3.0  # edge of the actors' triangles in pixels
CELLS_MM = (5.0, 12.0)  # and its limits
SMALLEST_PX = 32
WORKING_HALF_MM = 300.0  # a validation object's middle may be this far from that of the field on each axis
VALIDATION_SCENES = ("sphere", "cuboid")
SIDES = ("left", "right")
PNG_FAST = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
            cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB)  # fmt: skip
PNG_FLAT = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class SynthParameters:
    """What is recorded, and how well.

    Parameters
    ----------
    scene : a key of SCENES
    n_sensors, n_frames : the frames make one period of the motion
    size : (width, height), pixels
    noise : standard deviation of the sensor noise, grey levels
    seed : of rig, noise and exposure; the same seed makes the same bytes
    fps : frames per second
    position : mm, of a validation object from the middle of the working volume
    exposure_spread : standard deviation of the cameras' exposures, share
    calibration_error_px : standard deviation of the written calibration from the true one, pixels
    """

    scene: str = "ball"
    n_sensors: int = 3
    n_frames: int = 25
    size: tuple[int, int] = (1280, 720)
    noise: float = 1.5
    seed: int = 1
    fps: float = 25.0
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    exposure_spread: float = 0.02
    calibration_error_px: float = 0.0

    def __post_init__(self) -> None:
        if self.scene not in SCENES:
            raise ValueError(f"there is no scene {self.scene!r}; expected one of {', '.join(SCENES)}")
        for name, least in (("n_sensors", 1), ("n_frames", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} is {getattr(self, name)}, expected at least {least}")
        if min(self.size) < SMALLEST_PX:
            raise ValueError(f"size is {self.size[0]}x{self.size[1]} pixels, expected at least {SMALLEST_PX} a side")
        for name in ("noise", "exposure_spread", "calibration_error_px"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ValueError(f"{name} is {getattr(self, name)}, expected zero or more")
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise ValueError(f"fps is {self.fps}, expected more than zero")
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected zero or more")
        if not np.isfinite(self.position).all() or np.abs(self.position).max() > WORKING_HALF_MM:
            raise ValueError(f"position {self.position} is outside the working volume of +-{WORKING_HALF_MM:.0f} mm")
        if any(self.position) and self.scene not in VALIDATION_SCENES:
            raise ValueError(f"position is for {' and '.join(VALIDATION_SCENES)}, not for the scene {self.scene!r}")


def synthesise(out: Path, parameters: SynthParameters, *, progress: Progress = silent) -> Capture:
    """Record a scene into a new capture folder with clean plates and `truth/`.

    Raises
    ------
    ValueError
        If `out` is not empty.
    """
    with new_folder(out) as folder:
        capture = _Recording(folder, parameters).make(progress)
    return replace(capture, folder=out)


@dataclass(frozen=True, eq=False)
class _View:
    """A camera with all that stays the same from frame to frame."""

    name: str
    camera: Camera
    gains: NDArray[np.float64]
    plate: NDArray[np.float32]  # display values (H, W, 3)
    plate_depth: NDArray[np.float32]
    floor_map: NDArray[np.float64]


class _Recording:
    def __init__(self, folder: Path, parameters: SynthParameters) -> None:
        self._folder, self._parameters = folder, parameters
        rng = np.random.default_rng((parameters.seed, 1))
        self._scene: Scene = SCENES[parameters.scene](np.asarray(parameters.position, dtype=np.float64))
        self._rig = arc_rig(self._scene.shown, n_sensors=parameters.n_sensors, size=parameters.size, rng=rng)
        self._noise = noise_volume(np.random.default_rng((parameters.seed, 2)))
        self._light, self._room = Light(), Room()
        self._lights = self._light.table()
        self._curve = display_curve()

    def make(self, progress: Progress) -> Capture:
        parameters = self._parameters
        cell = self._cell()
        self._stage = Stage(self._scene, cell=cell, noise=self._noise)
        rng = np.random.default_rng((parameters.seed, 3))
        self._views = [
            self._view(f"{sensor.id}/{side}", getattr(sensor, side), rng)
            for sensor in self._rig.sensors
            for side in SIDES
        ]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            boxes = []
            for done, box in enumerate(pool.map(self._record_frame, range(parameters.n_frames)), start=1):
                boxes.append(box)
                progress("Recording", done, parameters.n_frames)
        for view in self._views:
            self._write_plate(view)
        self._write_truth()
        boxes_array = np.array(boxes)
        bounds = np.stack(
            [boxes_array[:, 0].min(axis=0) - BOUNDS_MARGIN_MM, boxes_array[:, 1].max(axis=0) + BOUNDS_MARGIN_MM]
        )
        return self._write_description(bounds)

    def _cell(self) -> float:
        per_pixel = (
            max(s.left.centre @ s.left.centre for s in self._rig.sensors) ** 0.5 / self._rig.sensors[0].left.K[0, 0]
        )
        return float(np.clip(CELL_PX * per_pixel, *CELLS_MM))

    def _view(self, name: str, camera: Camera, rng: np.random.Generator) -> _View:
        exposure = 1.0 + self._parameters.exposure_spread * rng.normal(size=3) * (1.0, 0.25, 0.25)
        gains = exposure[0] * np.array([exposure[1], 1.0, exposure[2]])
        width, height = camera.size
        room = self._room
        plate, depth = room_plate(
            height, width, np.linalg.inv(camera.K), np.ascontiguousarray(camera.rotation.T), camera.centre,
            room.radius, room.floor_y, np.asarray(room.curtain) ** 2.2, np.asarray(room.floor) ** 2.2, room.shift,
            self._noise,
        )  # fmt: skip
        return _View(name, camera, gains, plate_values(plate, gains), depth, _floor_map(camera, room.floor_y))

    def _record_frame(self, frame: int) -> NDArray[np.float64]:
        staged = self._stage.at(frame / self._parameters.n_frames)
        depths, light_frame = cast(staged.vertices, self._stage.faces, self._lights[2, :3])
        floor = floor_shade(staged.vertices, self._room.floor_y, self._lights[2, :3])
        for index, view in enumerate(self._views):
            visibility = see(view.camera, staged.vertices, self._stage.faces)
            actors = self._shaded(view, visibility, staged, depths, light_frame)
            key = _key(self._parameters.seed, index, frame + 1)
            picture = expose(
                view.plate, actors, visibility.column, visibility.row, view.gains, self._curve, view.floor_map, floor,
                self._parameters.noise, key,
            )  # fmt: skip
            _write_png(self._folder / f"{view.name}/{frame:04d}.png", picture, PNG_FAST)
            truth.write_view(self._folder, view.name, frame, view.camera.size, visibility)
        write_mesh(self._folder / truth.MESH.format(frame=frame), self._stage.mesh(staged))
        return np.stack([staged.vertices.min(axis=0), staged.vertices.max(axis=0)])

    def _shaded(
        self,
        view: _View,
        seen: Visibility,
        staged: Staged,
        depths: NDArray[np.float32],
        light_frame: NDArray[np.float64],
    ) -> NDArray[np.float32]:
        shaded: NDArray[np.float32] = shade(
            seen.column, seen.row, seen.faces, seen.nearness, self._stage.faces, seen.pixels, staged.surface,
            self._stage.owners, staged.looks, self._noise, self._lights, depths, light_frame, view.camera.centre,
            1.0 / view.camera.K[0, 0],
        )  # fmt: skip
        return shaded

    def _write_plate(self, view: _View) -> None:
        nothing = np.zeros((0, 0, 4), np.float32)
        even = np.ones((FLOOR_CELLS, FLOOR_CELLS), np.float32)
        key = _key(self._parameters.seed, self._views.index(view), 0)
        picture = expose(
            view.plate, nothing, 0, 0, view.gains, self._curve, view.floor_map, even, self._parameters.noise, key
        )
        _write_png(self._folder / f"{view.name}/plate.png", picture, PNG_FAST)

    def _write_truth(self) -> None:
        parameters = self._parameters
        moments = [self._scene.moment(frame / parameters.n_frames) for frame in range(parameters.n_frames)]
        content = {
            "schema_version": 1,
            "parameters": asdict(parameters),
            "depth": {"from_mm": truth.DEPTH_FROM_MM, "step_mm": truth.DEPTH_STEP_MM, "nothing": 0},
            "cameras": [
                {
                    "view": view.name,
                    "K": view.camera.K.tolist(),
                    "cam_from_world": view.camera.cam_from_world.tolist(),
                    "gains": view.gains.tolist(),
                }
                for view in self._views
            ],
            "objects": [[pose.tolist() for pose in moment.poses] for moment in moments],
        }
        write_json(self._folder / truth.FACTS, content)

    def _write_description(self, bounds: NDArray[np.float64]) -> Capture:
        parameters = self._parameters
        rig = self._rig
        if parameters.calibration_error_px > 0:
            rig = disturbed(rig, parameters.calibration_error_px, np.random.default_rng((parameters.seed, 4)))
        streams = tuple(
            SensorStream(
                sensor.id,
                CameraStream(sensor.left, f"{sensor.id}/left/{{frame:04d}}.png"),
                CameraStream(sensor.right, f"{sensor.id}/right/{{frame:04d}}.png"),
                plate=(f"{sensor.id}/left/plate.png", f"{sensor.id}/right/plate.png"),
            )
            for sensor in rig.sensors
        )
        capture = Capture(
            self._folder, self._scene.name, self._scene.kind, parameters.fps, parameters.n_frames, bounds,
            _object(self._scene), streams,
        )  # fmt: skip
        write_capture(capture)
        return capture


def _object(scene: Scene) -> dict[str, Any]:
    if scene.radius_mm is not None:
        return {"radius_mm": scene.radius_mm}
    return {"size_mm": list(scene.size_mm)} if scene.size_mm else {}


def _floor_map(camera: Camera, floor_y: float) -> NDArray[np.float64]:
    """Cell of the floor's shading from pixel (3, 3); the third row is positive where the ray goes down."""
    rays = camera.rotation.T @ np.linalg.inv(camera.K)
    eye = camera.centre
    down = -rays[1]
    # The ray eye + t d meets the floor at t = (eye_y - floor_y) / -d_y.
    x = eye[0] * down + (eye[1] - floor_y) * rays[0]
    z = eye[2] * down + (eye[1] - floor_y) * rays[2]
    scale = FLOOR_CELLS / (2 * FLOOR_HALF_MM)
    return np.stack([scale * (x + FLOOR_HALF_MM * down), scale * (z + FLOOR_HALF_MM * down), down])


def _key(seed: int, camera: int, frame: int) -> np.uint64:
    return np.uint64(np.random.SeedSequence((seed, camera, frame)).generate_state(1, np.uint64)[0])


def _write_png(path: Path, picture: NDArray[Any], options: tuple[int, ...]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    encoded, content = cv2.imencode(".png", picture, options)
    if not encoded:
        raise OSError(f"{path}: OpenCV could not encode the picture")
    path.write_bytes(content.tobytes())
