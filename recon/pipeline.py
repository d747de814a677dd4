"""The whole way from a capture to a stimulus set: one straight function per product.

Every artefact is keyed by what it was made from, so a run that was stopped is resumed where it stopped.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache, partial
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.approaches import FUSION_METHODS, Approach, approaches, parse_approach
from recon.artefacts import Artefacts, code_version, file_digest
from recon.capture.format import Capture, image_path, read_capture, read_frame, read_masks
from recon.capture.images import read_image
from recon.capture.rectify import Rectification, rectify, rectify_images, rectify_masks
from recon.cloud import CloudParameters, cloud_from_disparity, crop_cloud
from recon.depth import MATCHERS, StereoPair
from recon.depth.disparity_io import read_disparity, write_disparity
from recon.execute import Progress, run_tasks, silent
from recon.files import read_json, write_json
from recon.fusion import FUSIONS
from recon.manifest import Stimulus, write_manifest
from recon.mesh import Mesh, read_cloud, read_mesh, write_cloud, write_mesh
from recon.render.camera_path import camera_path
from recon.render.frames import choose_renderer, describe_renderer, render_frames
from recon.render.quality import VideoCheck
from recon.render.scene import scene_around
from recon.render.video import probe_video, write_checked_video
from recon.rig import Camera
from recon.run import Run, cloud_name, depth_name, log, mesh_name, read_run, versions, write_run
from recon.surface import SurfaceParameters

N_CORES = os.cpu_count() or 1
LOOPS = ("repeat", "bounce", "static")


@dataclass(frozen=True)
class ReconstructOptions:
    """What to make of a capture.

    Parameters
    ----------
    depths, fusions : the methods; every combination is an approach
    frames : which frames; None for all
    cloud, surface : parameters of these stages; without a voxel size, one that suits the depth resolution
    workers : local processes; 1 works in this process with all threads
    """

    depths: tuple[str, ...] = tuple(MATCHERS)
    fusions: tuple[str, ...] = FUSION_METHODS
    frames: range | None = None
    cloud: CloudParameters = field(default_factory=CloudParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    workers: int = 1


def match_files(
    left: Path, right: Path, out: Path, *, method: str, n_disparities: int, min_disparity: int = 0
) -> dict[str, Any]:
    """Match the images of two files, write the disparity, and say how it went.

    Raises
    ------
    ValueError
        If the method is unknown or the images cannot be matched; nothing is written then.
    """
    pair = StereoPair(read_image(left), read_image(right), n_disparities, min_disparity)
    started = time.perf_counter()
    disparity = _matcher(method)(pair)
    seconds = time.perf_counter() - started
    write_disparity(out, disparity)
    return {
        "out": str(out),
        "method": method,
        "seconds": seconds,
        "density": float(np.isfinite(disparity).mean()),
        "size": [pair.width, pair.height],
        "parameters": {"n_disparities": n_disparities, "min_disparity": min_disparity},
    }


def reconstruct(
    capture_folder: Path, run: Path, options: ReconstructOptions, progress: Progress = silent
) -> dict[str, Any]:
    """Make depth maps, clouds and meshes of a capture, and return the content of ``run.json``.

    Raises
    ------
    ValueError
        If the capture, a method or the frames are wrong; `run` then holds only whole files.
    """
    capture = read_capture(capture_folder)
    wanted = approaches(options.depths, options.fusions)
    for method in options.depths:
        _matcher(method)
    frames = _chosen_frames(capture, options.frames)
    surface = replace(options.surface, voxel_mm=options.surface.voxel_mm or depth_resolution(capture))
    views = [(method, stream.id, frame) for method in options.depths for stream in capture.sensors for frame in frames]

    run.mkdir(parents=True, exist_ok=True)
    stages = {
        "depth maps": [partial(make_depth, capture, run, *view) for view in views],
        "clouds": [partial(make_cloud, capture, run, *view, options.cloud) for view in views],
        "meshes": [
            partial(make_mesh, capture, run, approach, frame, surface) for approach in wanted for frame in frames
        ],
    }
    timings = {stage: _run_stage(stage, tasks, run, options.workers, progress) for stage, tasks in stages.items()}
    finished = Run(run, capture, tuple(map(str, wanted)), tuple(frames), versions())
    return write_run(finished, options=_as_json(replace(options, surface=surface)), timings=timings)


def make_depth(capture: Capture, run: Path, method: str, sensor_id: str, frame: int) -> str | None:
    """Match one frame of one sensor; returns the artefact's name, or None if it was finished before."""
    key = {
        "pictures": _picture_key(capture, sensor_id, frame),
        "method": method,
        "code": code_version("depth", "capture/rectify.py"),
    }

    def write(path: Path) -> None:
        pair = _stereo_pair(capture, _rectification(capture, sensor_id), sensor_id, frame)
        write_disparity(path, _matcher(method)(pair))

    name = depth_name(method, sensor_id, frame)
    return name if Artefacts(run).make(name, key, write) else None


def make_cloud(
    capture: Capture, run: Path, method: str, sensor_id: str, frame: int, parameters: CloudParameters
) -> str | None:
    """Turn one disparity map into a cloud; returns the artefact's name, or None if it was finished before."""
    depth = depth_name(method, sensor_id, frame)
    key = {
        "depth": Artefacts(run).digest(depth),
        "pictures": _picture_key(capture, sensor_id, frame),
        "parameters": asdict(parameters),
        "code": code_version("cloud.py", "mesh.py", "capture/rectify.py"),
    }

    def write(path: Path) -> None:
        rectification = _rectification(capture, sensor_id)
        left, _ = rectify_images(rectification, *read_frame(capture, sensor_id, frame))
        cloud = cloud_from_disparity(read_disparity(run / depth), left, rectification, parameters)
        write_cloud(path, crop_cloud(cloud, capture.bounds))

    name = cloud_name(method, sensor_id, frame)
    return name if Artefacts(run).make(name, key, write) else None


def make_mesh(capture: Capture, run: Path, approach: Approach, frame: int, parameters: SurfaceParameters) -> str | None:
    """Fuse one frame's clouds into a mesh; returns the artefact's name, or None if it was finished before."""
    clouds = [cloud_name(approach.depth, stream.id, frame) for stream in capture.sensors]
    key = {
        "clouds": Artefacts(run).digests(clouds),
        "fusion": approach.fusion,
        "parameters": asdict(parameters),
        "code": code_version("surface", "fusion.py", "mesh.py"),
    }

    def write(path: Path) -> None:
        write_mesh(path, FUSIONS[approach.fusion]([read_cloud(run / cloud) for cloud in clouds], parameters))

    name = mesh_name(str(approach), frame)
    return name if Artefacts(run).make(name, key, write) else None


def depth_resolution(capture: Capture) -> float:
    """A voxel size that loses neither depth nor picture resolution at the middle of the bounds, mm.

    A third of the depth step of one pixel of disparity, so that a slice of whole disparities still meets the next,
    and not less than the width of a pixel; the coarsest of the sensors decides.
    """
    centre = capture.bounds.mean(axis=0)
    sizes: list[float] = []
    for stream in capture.sensors:
        camera = stream.left.camera
        distance = float(np.linalg.norm(camera.centre - centre))
        pixel = distance / float(camera.K[0, 0])
        sizes.append(max(pixel, pixel * distance / stream.sensor.baseline / 3))
    return round(max(sizes), 3)


@dataclass(frozen=True)
class RenderOptions:
    """How every model of a stimulus set is shown.

    Parameters
    ----------
    size : (width, height), pixels, both even
    fps, seconds : of the videos
    background : the name of an artificial background
    loop : "repeat" starts a recording again where it ends, "bounce" plays it back and forth, "static" shows its
        first frame
    renderer : "auto" or the name of a renderer
    master : whether to keep a near-lossless master beside each video
    workers : local processes, one video each
    """

    size: tuple[int, int] = (1920, 1080)
    fps: float = 25.0
    seconds: float = 15.0
    background: str = "studio"
    loop: str = "bounce"
    renderer: str = "auto"
    master: bool = True
    workers: int = 1

    def __post_init__(self) -> None:
        if self.loop not in LOOPS:
            raise ValueError(f"loop is {self.loop!r}, expected one of {', '.join(LOOPS)}")
        if self.n_frames < 1:
            raise ValueError(f"{self.seconds:g} s at {self.fps:g} frames/s is no video; ask for one frame at least")

    @property
    def n_frames(self) -> int:
        """How many frames a video has."""
        return round(self.seconds * self.fps)


def shown_frames(n_recorded: int, n_shown: int, step: float, loop: str) -> list[int]:
    """Which of the recorded frames each frame of a video shows.

    `step` is how many recorded frames pass from one shown frame to the next.
    """
    at = np.floor(np.arange(n_shown) * step + 1e-6).astype(int)
    if loop == "static" or n_recorded == 1:
        at[:] = 0
    elif loop == "repeat":
        at %= n_recorded
    else:
        period = 2 * n_recorded - 2
        at = np.minimum(at % period, period - at % period)
    return [int(index) for index in at]


def render(runs: Sequence[Path], out: Path, options: RenderOptions, progress: Progress = silent) -> Path:
    """Make a video of every approach of every run, and the manifest; returns the manifest's path.

    Path, light, background, renderer and encoder settings are the same for all approaches of a scene.

    Raises
    ------
    ValueError
        If a folder is not a run, or two runs are of the same scene.
    """
    options = replace(options, renderer=choose_renderer(options.renderer))
    read = [read_run(run) for run in runs]
    tasks = [partial(make_video, run, out, approach, options) for run in read for approach in run.approaches]
    stimuli: list[Stimulus] = []
    progress("videos", 0, len(tasks))
    for stimulus in run_tasks(tasks, workers=options.workers):
        stimuli.append(stimulus)
        progress("videos", len(stimuli), len(tasks))
    provenance = {
        "runs": [{"dataset": run.dataset, "versions": run.versions} for run in read],
        "render": {name: value for name, value in asdict(options).items() if name != "workers"},
        "versions": versions(),
    }
    stimuli.sort(key=lambda stimulus: (stimulus.dataset, stimulus.approach))
    return write_manifest(out, out.resolve().name, stimuli, provenance)


def make_video(run: Run, out: Path, approach: str, options: RenderOptions) -> Stimulus:
    """Render and encode one model's fly-through, unless it is there already."""
    meshes = [mesh_name(approach, frame) for frame in run.frames]
    loop = options.loop if len(meshes) > 1 else "static"
    shown = shown_frames(len(meshes), options.n_frames, run.capture.fps / options.fps, loop)
    cameras = camera_path(run.capture.rig, run.capture.bounds, options.n_frames, options.size)
    scene = scene_around(run.capture.bounds, cameras, options.background)
    threads = 1 if options.workers > 1 else N_CORES

    def frames() -> Iterator[NDArray[np.uint8]]:
        models = (_mesh_once(run.folder / meshes[index]) for index in shown)
        return render_frames(models, cameras, scene, renderer=options.renderer, threads=threads)

    stem = f"{run.dataset}/{approach}"
    video, quality, master = f"{stem}.mp4", f"{stem}.quality.json", f"{stem}.master.mp4"
    key = {
        "meshes": Artefacts(run.folder).digests(meshes),
        "rig": [_camera_key(camera) for camera in cameras],
        "options": {name: value for name, value in asdict(options).items() if name != "workers"},
        "code": code_version("render", "pipeline.py"),
    }

    def write(paths: list[Path]) -> None:
        masters = paths[2] if options.master else None
        _, check = write_checked_video(paths[0], frames(), size=options.size, fps=options.fps, master=masters)
        write_json(paths[1], _quality(check))

    Artefacts(out).make_together([video, quality, *([master] if options.master else [])], key, write)
    facts = probe_video(out / video)
    return Stimulus(
        dataset=run.dataset,
        approach=approach,
        levels=parse_approach(approach).levels,
        video=video,
        master=master if options.master else None,
        width=facts.width,
        height=facts.height,
        fps=facts.fps,
        n_frames=facts.n_frames,
        codec=facts.codec,
        renderer=describe_renderer(options.renderer),
        model_frames=len(meshes),
        loop=loop,
        quality=read_json(out / quality),
    )


def _quality(check: VideoCheck) -> dict[str, Any]:
    """How near the encoded frames are to the rendered ones, in luma, for the manifest."""
    return {
        "psnr_y_mean_db": round(fmean(check.psnr_db), 2),
        "psnr_y_worst_db": round(min(check.psnr_db), 2),
        "ssim_y_mean": round(fmean(check.ssim), 5),
        "faults": list(check.faults),
    }


def _matcher(method: str) -> Callable[[StereoPair], NDArray[np.float32]]:
    if method not in MATCHERS:
        raise ValueError(f"unknown depth method {method!r}, expected one of {', '.join(MATCHERS)}")
    return MATCHERS[method]


def _chosen_frames(capture: Capture, wanted: range | None) -> list[int]:
    frames = [frame for frame in range(capture.n_frames) if wanted is None or frame in wanted]
    if not frames:
        raise ValueError(f"{capture.folder}: has frames 0 to {capture.n_frames - 1}, none of them in {wanted}")
    return frames


def _rectification(capture: Capture, sensor_id: str) -> Rectification:
    return rectify(capture.stream(sensor_id).sensor, capture.bounds)


def _as_json(options: ReconstructOptions) -> dict[str, Any]:
    return {name: value for name, value in asdict(options).items() if name not in ("frames", "workers")}


def _stereo_pair(capture: Capture, rectification: Rectification, sensor_id: str, frame: int) -> StereoPair:
    left, right = rectify_images(rectification, *read_frame(capture, sensor_id, frame))
    masks = read_masks(capture, sensor_id, frame)
    left_mask, right_mask = rectify_masks(rectification, *masks) if masks else (None, None)
    return StereoPair(left, right, rectification.n_disparities, left_mask=left_mask, right_mask=right_mask)


@lru_cache(maxsize=1)
def _mesh_once(path: Path) -> Mesh:
    """A mesh that is shown for several frames in a row is read once, and the renderer sees the same object."""
    return read_mesh(path)


def _camera_key(camera: Camera) -> list[Any]:
    return [camera.K.tolist(), camera.dist.tolist(), camera.size, camera.cam_from_world.tolist()]


def _picture_key(capture: Capture, sensor_id: str, frame: int) -> dict[str, Any]:
    """What a frame of a sensor is made of: its files, its cameras and the bounds."""
    stream = capture.stream(sensor_id)
    patterns = (stream.left.image, stream.right.image, *(stream.mask or ()))
    cameras = (stream.left.camera, stream.right.camera)
    return {
        "files": [_digest_once(image_path(capture.folder, pattern, frame)) for pattern in patterns],
        "frame": frame,
        "cameras": [_camera_key(camera) for camera in cameras],
        "bounds": capture.bounds.tolist(),
    }


def _run_stage(stage: str, tasks: Sequence[partial[str | None]], run: Path, workers: int, progress: Progress) -> float:
    started = time.perf_counter()
    progress(stage, 0, len(tasks))
    for done, name in enumerate(run_tasks(tasks, workers=workers), start=1):
        if name is not None:
            log(run, {"time": time.time(), "made": name})
        progress(stage, done, len(tasks))
    return time.perf_counter() - started


@cache
def _digest_of(path: Path, _changed_ns: int, _n_bytes: int) -> str:
    return file_digest(path)


def _digest_once(path: Path) -> str:
    """Digest of a file that is read again only when it changed."""
    facts = path.stat()
    return _digest_of(path, facts.st_mtime_ns, facts.st_size)
