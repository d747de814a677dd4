"""The recording of the synthetic studio: a scene becomes a capture whose depth, masks and meshes are known."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import CameraStream, Capture, DepthMaps, HeldOut, SensorStream, image_path, write_capture
from recon.capture.recording import SIDES
from recon.geometry.mesh_files import write_mesh
from recon.geometry.rig import Camera, Rig, Sensor
from recon.runtime.files import new_folder, write_json
from recon.runtime.workers import Progress, no_progress
from recon.studio import truth
from recon.studio.imaging import Imaging, Window, averaged, defocused, defocused_plate, rolled
from recon.studio.light.appearance import Actors, shade
from recon.studio.light.exposure import display_curve, expose
from recon.studio.light.lighting import lit
from recon.studio.light.looks import light_table, noise_volume
from recon.studio.light.shadow import FLOOR_CELLS, floor_shade
from recon.studio.rasterise import Visibility, see
from recon.studio.rigs import arc_rig, between, distorted, disturbed
from recon.studio.scenes import SCENES, Scene
from recon.studio.stage import Stage, Staged
from recon.studio.views import FLOOR_Y_MM, View, empty_view

BOUNDS_MARGIN_MM = 15.0
CELL_PX = 5.0  # edge of the actors' triangles in pixels
CELLS_MM = (8.0, 13.0)  # and its limits
SMALLEST_PX = 32
STRONGEST_DISTORTION = 0.3  # beyond, lenses are fisheyes, and the polynomial folds back inside the picture
WORKING_HALF_MM = 300.0  # a validation object's middle may be this far from that of the field on each axis
SHINE = 6  # the column of `lighting.lit`'s result
VALIDATION_SCENES = ("sphere", "cuboid")
HELD_OUT_FRAME = 0
DEPTH_MAPS = "{sensor}/depth/{{frame:04d}}.png"
# Noise repeats nothing: without a search for repetitions, a picture of 1280 x 720 takes 24 ms and 1.24 MB instead of
# 27 ms and 1.32 MB.
NOISY_PNG = (cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
             cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_AVG)  # fmt: skip


@dataclass(frozen=True)
class SynthParameters(Imaging):
    """The parameters of a synthetic recording; those of `Imaging` are given by name.

    Parameters
    ----------
    scene : a key of SCENES
    n_sensors, n_frames : the frames make one period of the motion
    size : (width, height), pixels
    noise : standard deviation of the sensor noise, grey levels
    seed : of rig, noise, exposure and texture; the same seed makes the same bytes
    fps : frames per second
    position : mm, of a validation object from the middle of the working volume
    exposure_spread : standard deviation of the cameras' exposures, share
    calibration_error_px : standard deviation of the written calibration from the true one, pixels
    distortion : k1 of the sensors' lenses (OpenCV's), about; below zero are barrels, 0 is none
    depth_maps : record by cameras with depth maps instead of by pairs: the left ones, with their true depth
    late : sensors whose pictures show what was some frames earlier, and how many, which need not be whole

    Raises
    ------
    ValueError
        Naming the first value that cannot be.
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
    distortion: float = 0.0
    depth_maps: bool = False
    late: tuple[tuple[str, float], ...] = ()

    def __post_init__(self) -> None:
        if self.scene not in SCENES:
            raise ValueError(f"there is no scene {self.scene!r}; expected one of {', '.join(SCENES)}")
        for name in ("n_sensors", "n_frames"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, expected at least 1")
        if min(self.size) < SMALLEST_PX:
            raise ValueError(f"size is {self.size[0]}x{self.size[1]} pixels, expected at least {SMALLEST_PX} a side")
        for name in ("noise", "exposure_spread", "calibration_error_px"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise ValueError(f"{name} is {getattr(self, name)}, expected zero or more")
        if not (np.isfinite(self.fps) and self.fps > 0):
            raise ValueError(f"fps is {self.fps}, expected more than zero")
        if not abs(self.distortion) <= STRONGEST_DISTORTION:
            raise ValueError(
                f"distortion is {self.distortion}, expected -{STRONGEST_DISTORTION} to {STRONGEST_DISTORTION}"
            )
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, expected zero or more")
        sensors = [f"S{number + 1}" for number in range(self.n_sensors)]
        for name, frames in self.late:
            if name not in sensors or not abs(frames) < self.n_frames:
                raise ValueError(
                    f"late is {name}={frames:g}, expected one of {', '.join(sensors)} and fewer frames than all"
                )
        self.check(self.fps, sensors)
        self._check_position()

    def _check_position(self) -> None:
        if not np.isfinite(self.position).all() or np.abs(self.position).max() > WORKING_HALF_MM:
            raise ValueError(f"position {self.position} is outside the working volume of +-{WORKING_HALF_MM:.0f} mm")
        if any(self.position) and self.scene not in VALIDATION_SCENES:
            raise ValueError(f"position is for {' and '.join(VALIDATION_SCENES)}, not for the scene {self.scene!r}")


def synthesise(out: Path, parameters: SynthParameters, *, progress: Progress = no_progress) -> Capture:
    """Record a scene into a new capture folder with clean plates, held-out photographs and `truth/`.

    Parameters
    ----------
    out : the folder, which is made
    parameters : what is recorded
    progress : told after each camera's picture of the empty room, then after each frame

    Raises
    ------
    ValueError
        If `out` exists and is not an empty folder.
    """
    with new_folder(out) as folder:
        capture = _Recording(folder, parameters).make(progress)
    return replace(capture, folder=out)


def restaged(parameters: SynthParameters) -> tuple[Stage, float]:
    """Return the bodies of a recording as they stood in it, and the size of a sensor's pixel on them, mm."""
    recording = _Recording(Path(), parameters)
    return recording.stage(), _pixel(recording.rig)


class _Recording:
    """One scene, its rig and its light, from which frames are recorded independently of each other."""

    def __init__(self, folder: Path, parameters: SynthParameters) -> None:
        self._folder, self._parameters = folder, parameters
        self._scene: Scene = SCENES[parameters.scene](np.asarray(parameters.position, dtype=np.float64))
        self.rig = arc_rig(self._scene.shown, n_sensors=parameters.n_sensors, size=parameters.size, rng=self._rng(1))
        if parameters.distortion:
            self.rig = distorted(self.rig, parameters.distortion, self._rng(6))
        self._noise = noise_volume(self._rng(2))
        self._lights, self._curve = light_table(), display_curve()
        self._towards_key = self._lights[2, :3]

    def make(self, progress: Progress) -> Capture:
        n_frames = self._parameters.n_frames
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            self._stage = self.stage()
            self._views = []
            cameras = self._cameras()
            progress("Placing cameras", 0, len(cameras))
            for view in pool.map(self._empty_view, cameras.items()):
                self._views.append(view)
                progress("Placing cameras", len(self._views), len(cameras))
            progress("Recording", 0, n_frames)
            extents = []
            for done, extent in enumerate(pool.map(self._record_frame, range(n_frames)), start=1):
                extents.append(extent)
                progress("Recording", done, n_frames)
        self._write_truth()
        return self._write_capture(_bounds(extents, self._scene))

    def stage(self) -> Stage:
        return Stage(self._scene, cell=_cell(self.rig), noise=self._noise, towards_key=self._towards_key)

    def _rng(self, stream: int, *more: int) -> np.random.Generator:
        return np.random.default_rng((self._parameters.seed, stream, *more))

    def _cameras(self) -> dict[str, Camera]:
        """Return every camera by the name of its folder: the sensors, then one half way between each two neighbours."""
        sides = SIDES[:1] if self._parameters.depth_maps else SIDES
        cameras = {f"{sensor.id}/{side}": getattr(sensor, side) for sensor in self.rig.sensors for side in sides}
        return cameras | {
            f"held_out/{first.id}_{second.id}": between(first, second, self._scene.shown)
            for first, second in zip(self.rig.sensors, self.rig.sensors[1:], strict=False)
        }

    def _empty_view(self, named: tuple[str, Camera]) -> View:
        name, camera = named
        index = list(self._cameras()).index(name)
        view = empty_view(
            name, camera, self._noise, self._rng(3, index),
            spread=self._parameters.exposure_spread, cast=self._parameters.cast(self._rng(7, index)),
        )  # fmt: skip
        if sigma := self._defocus(view):
            view = replace(view, plate=defocused_plate(view.plate, sigma))
        if not name.startswith("held_out"):
            self._expose(view, (np.zeros((0, 0, 4), np.float32), 0, 0), None, (index, -1, 0.0))
        return view

    def _record_frame(self, frame: int) -> NDArray[np.float64]:
        """Write all that belongs to a frame; return the actors' extent (2, 3), mm."""
        moments = _Moments(self._stage, self._parameters.n_frames, self._towards_key)
        offsets = self._parameters.offsets(self._parameters.fps, self._speed(frame, moments))
        late = dict(self._parameters.late)
        for index, view in enumerate(self._views):
            if view.name.startswith("held_out") and frame != HELD_OUT_FRAME:
                continue
            instant = frame - late.get(view.name.partition("/")[0], 0.0)
            shots = [self._shot(view, instant + offset, moments) for offset in offsets]
            actors, seen = averaged([window for window, _ in shots]), shots[len(shots) // 2][1]
            if sigma := self._defocus(view):
                actors = defocused(actors, sigma, view.camera.size)
            self._expose(view, actors, moments.floor(instant), (index, frame, instant))
            truth.write_view(self._folder, view.name, frame, view.camera.size, seen)
            if self._parameters.depth_maps and not view.name.startswith("held_out"):
                path = image_path(self._folder, DEPTH_MAPS.format(sensor=PurePosixPath(view.name).parent), frame)
                truth.write_depth_map(path, view.camera.size, seen)
        staged = moments.at(frame)
        write_mesh(self._folder / truth.MESH.format(frame=frame), self._stage.mesh(staged))
        return np.stack([staged.vertices.min(axis=0), staged.vertices.max(axis=0)])

    def _speed(self, frame: int, moments: _Moments) -> float:
        """Return the largest motion within a frame, pixels; 0 where no shutter is open so that nobody asks."""
        if not self._parameters.shutter_ms:
            return 0.0
        way = moments.at(frame + 0.25).vertices - moments.at(frame - 0.25).vertices
        return 2 * float(np.linalg.norm(way, axis=1).max()) / _pixel(self.rig)

    def _shot(self, view: View, instant: float, moments: _Moments) -> tuple[Window, Visibility]:
        """Return what a camera sees at one instant."""
        readout = self._parameters.readout(self._parameters.fps)
        staged = moments.at(instant)
        if readout:
            around = moments.at(instant - readout / 2), staged, moments.at(instant + readout / 2)
            staged = rolled(view.camera, around)
        seen = see(view.camera, staged.vertices, self._stage.faces)
        return (self._shade(view, seen, staged), seen.column, seen.row), seen

    def _defocus(self, view: View) -> float:
        return dict(self._parameters.defocus).get(view.name.partition("/")[0], 0.0)

    def _shade(self, view: View, seen: Visibility, staged: Staged) -> NDArray[np.float32]:
        light = lit(staged.surface, self._lights, view.camera.centre)
        light[:, SHINE] *= np.float32(self._parameters.gloss)
        actors = Actors(self._stage.faces, light, self._stage.owners, staged.looks, self._noise)
        shaded: NDArray[np.float32] = shade(seen, actors, 1.0 / view.camera.K[0, 0])
        return shaded

    def _expose(
        self, view: View, actors: Window, floor: NDArray[np.float32] | None, shot: tuple[int, int, float]
    ) -> None:
        """Write the picture of a camera; `shot` is the camera's number, the frame (-1: the plate) and the instant."""
        index, frame, instant = shot
        parameters = self._parameters
        dimming = parameters.dimming(view.camera.size, instant / parameters.fps, parameters.fps)
        shade = np.ones((FLOOR_CELLS, FLOOR_CELLS), np.float32) if floor is None else floor
        dimmed = np.ones((0, 0), np.float32) if dimming is None else dimming
        ground, key = (view.floor_cells, shade), self._key(index, frame + 1)
        picture = expose(view.plate, actors, view.gains, self._curve, ground, dimmed, parameters.noise, key)
        path = self._folder / f"{view.name}/{'plate' if frame < 0 else f'{frame:04d}'}{parameters.suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(parameters.encoded(picture, NOISY_PNG))

    def _key(self, view: int, picture: int) -> np.uint64:
        return np.uint64(self._rng(4, view, picture).integers(0, 2**64, dtype=np.uint64))

    def _write_truth(self) -> None:
        n_frames = self._parameters.n_frames
        moments = [self._scene.moment(frame / n_frames) for frame in range(n_frames)]
        content = {
            "schema_version": 1,
            "parameters": asdict(self._parameters),
            "depth": {"from_mm": truth.DEPTH_FROM_MM, "step_mm": truth.DEPTH_STEP_MM, "nothing": 0},
            "cameras": [view.as_json() for view in self._views],
            "objects": [[pose.tolist() for pose in moment.poses] for moment in moments],
        }
        write_json(self._folder / truth.FACTS, content)

    def _write_capture(self, bounds: NDArray[np.float64]) -> Capture:
        scene, parameters, rig = self._scene, self._parameters, self.rig
        if parameters.calibration_error_px > 0:
            rig = disturbed(rig, parameters.calibration_error_px, self._rng(5))
        capture = Capture(
            self._folder, scene.name, scene.kind, parameters.fps, parameters.n_frames, bounds, scene.object,
            tuple((_depth_stream if parameters.depth_maps else _stream)(sensor, parameters.suffix)
                  for sensor in rig.sensors),
            tuple(
                HeldOut(view.camera, f"{view.name}/{HELD_OUT_FRAME:04d}{parameters.suffix}", HELD_OUT_FRAME)
                for view in self._views
                if view.name.startswith("held_out")
            ),
        )  # fmt: skip
        write_capture(capture)
        return capture


class _Moments:
    """The bodies and the floor's shade at the instants of a frame, each made once."""

    def __init__(self, stage: Stage, n_frames: int, towards_key: NDArray[np.float64]) -> None:
        self._stage, self._n_frames, self._towards_key = stage, n_frames, towards_key
        self._staged: dict[float, Staged] = {}
        self._floors: dict[float, NDArray[np.float32]] = {}

    def at(self, instant: float) -> Staged:
        """Return the bodies at an instant, frames."""
        key = round(instant, 6)
        if key not in self._staged:
            self._staged[key] = self._stage.at(key / self._n_frames % 1.0)
        return self._staged[key]

    def floor(self, instant: float) -> NDArray[np.float32]:
        """Return how much the bodies darken the floor at an instant, as in `floor_shade`."""
        key = round(instant, 6)
        if key not in self._floors:
            self._floors[key] = floor_shade(self.at(instant).vertices, FLOOR_Y_MM, self._towards_key)
        return self._floors[key]


def _stream(sensor: Sensor, suffix: str) -> SensorStream:
    left, right = (CameraStream(getattr(sensor, side), f"{sensor.id}/{side}/{{frame:04d}}{suffix}") for side in SIDES)
    plates = f"{sensor.id}/left/plate{suffix}", f"{sensor.id}/right/plate{suffix}"
    return SensorStream(sensor.id, left, right, plate=plates)


def _depth_stream(sensor: Sensor, suffix: str) -> SensorStream:
    camera = CameraStream(sensor.left, f"{sensor.id}/left/{{frame:04d}}{suffix}")
    depth = DepthMaps(DEPTH_MAPS.format(sensor=sensor.id), truth.DEPTH_MAP_STEP_MM)
    return SensorStream(sensor.id, camera, None, plate=(f"{sensor.id}/left/plate{suffix}",), depth=depth)


def _pixel(rig: Rig) -> float:
    """Return the size of a pixel at the actors, mm."""
    camera = rig.sensors[0].left
    return float(np.linalg.norm(camera.centre)) / float(camera.K[0, 0])


def _cell(rig: Rig) -> float:
    """Choose the edge of the actors' triangles on the trunk, mm."""
    return float(np.clip(CELL_PX * _pixel(rig), *CELLS_MM))


def _bounds(extents: list[NDArray[np.float64]], scene: Scene) -> NDArray[np.float64]:
    """Return bounds around the actors at all frames, as far as the cameras show them."""
    low = np.min([extent[0] for extent in extents], axis=0) - BOUNDS_MARGIN_MM
    high = np.max([extent[1] for extent in extents], axis=0) + BOUNDS_MARGIN_MM
    half = np.array([scene.shown.width, scene.shown.height, np.inf]) / 2
    return np.stack([np.maximum(low, scene.shown.centre - half), np.minimum(high, scene.shown.centre + half)])
