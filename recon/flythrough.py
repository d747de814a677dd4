"""The fly-through: one model's video, from the same cameras and under the same light as every other approach's."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.approaches import parse_approach
from recon.artefacts import Artefacts, code_version
from recon.files import read_json, write_json
from recon.manifest import Stimulus
from recon.mesh import Mesh, read_mesh
from recon.products import camera_key
from recon.render.camera_path import camera_path
from recon.render.frames import describe_renderer, render_frames
from recon.render.quality import VideoCheck
from recon.render.scene import scene_around
from recon.render.video import probe_video, write_checked_video
from recon.run import Run, mesh_name

N_CORES = os.cpu_count() or 1
LOOPS = ("repeat", "bounce", "static")


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
        "rig": [camera_key(camera) for camera in cameras],
        "options": {name: value for name, value in asdict(options).items() if name != "workers"},
        "code": code_version("render", "flythrough.py"),
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


@lru_cache(maxsize=1)
def _mesh_once(path: Path) -> Mesh:
    """A mesh that is shown for several frames in a row is read once, and the renderer sees the same object."""
    return read_mesh(path)
