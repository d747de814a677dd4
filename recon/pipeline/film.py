"""The fly-through: a video of one approach's models, by the same cameras and light as every other approach's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from itertools import chain
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np

from recon.approaches import parse_approach
from recon.geometry.mesh import Mesh, read_mesh
from recon.pipeline.manifest import Stimulus
from recon.pipeline.run import Run, mesh_name
from recon.pipeline.stages import camera_key
from recon.render.camera_path import camera_path
from recon.render.checked import holds_checked_frames, write_checked_video
from recon.render.frames import describe_renderer, render_frames
from recon.render.path_file import read_path, write_path
from recon.render.quality import VideoCheck
from recon.render.scene import scene_around
from recon.render.video import VideoError, join_videos, probe_video
from recon.rig import Camera
from recon.storage.artefacts import Artefacts, code_version
from recon.storage.files import read_json, write_json
from recon.storage.remote import address_of

PART_FRAMES = 50  # two groups of pictures; nothing is predicted across them, so joining parts costs no quality
PARTS = ".parts"
WHERE = ("workers", "cluster")  # options that say where work runs, not what is made
LOOPS = ("repeat", "bounce", "static")


@dataclass(frozen=True)
class RenderOptions:
    """How every model of a stimulus set is shown.

    Parameters
    ----------
    size : (width, height), pixels, both even
    fps, seconds : of the videos
    background : the name of an artificial background
    path : a kind of `camera_path`, or the file of one (see `recon.render.path_file`)
    loop : "repeat" starts a recording again where it ends, "bounce" plays it back and forth, "static" shows its
        first frame
    renderer : "auto" or the name of a renderer
    master : whether to keep a near-lossless master beside each video
    workers : local processes, each on one thread; 1 works in this process with all threads
    cluster : address of a Dask scheduler whose workers render instead; None for none
    """

    size: tuple[int, int] = (1920, 1080)
    fps: float = 25.0
    seconds: float = 15.0
    background: str = "studio"
    path: str | Path = "auto"
    loop: str = "bounce"
    renderer: str = "auto"
    master: bool = True
    workers: int = 1
    cluster: str | None = None

    def __post_init__(self) -> None:
        if self.loop not in LOOPS:
            raise ValueError(f"loop is {self.loop!r}, expected one of {', '.join(LOOPS)}")
        if self.n_frames < 1:
            raise ValueError(f"{self.seconds:g} s at {self.fps:g} frames/s is no video; ask for one frame at least")

    @property
    def n_frames(self) -> int:
        """The number of frames of a video."""
        return round(self.seconds * self.fps)


def shown_frames(n_recorded: int, n_shown: int, step: float, loop: str) -> list[int]:
    """Choose which recorded frame each frame of a video shows.

    Parameters
    ----------
    n_recorded, n_shown : frames of the recording and of the video
    step : recorded frames from one shown frame to the next
    loop : see `RenderOptions`
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


@dataclass(frozen=True, eq=False)
class Film:
    """The fly-through of one approach: what each frame of its video shows.

    A film is made in parts of fixed length. So several processes share a video, its bytes do not depend on how many do,
    and a start that is stopped loses one part at most.
    """

    run: Run
    approach: str
    options: RenderOptions

    @property
    def meshes(self) -> list[str]:
        """The names in the run of the models that it shows, in the order of the recording."""
        return [mesh_name(self.approach, frame) for frame in self.run.frames]

    @property
    def loop(self) -> str:
        """How the models fill the video."""
        return self.options.loop if len(self.run.frames) > 1 else "static"

    @property
    def shown(self) -> list[int]:
        """The number of the model that each frame shows."""
        step = self.run.capture.fps / self.options.fps
        return shown_frames(len(self.run.frames), self.options.n_frames, step, self.loop)

    @property
    def parts(self) -> list[range]:
        """The frames of each part."""
        n_frames = self.options.n_frames
        return [range(first, min(first + PART_FRAMES, n_frames)) for first in range(0, n_frames, PART_FRAMES)]

    def cameras(self) -> tuple[Camera, ...]:
        """Place a camera for each frame, the same for every approach of the run."""
        capture, options = self.run.capture, self.options
        if isinstance(options.path, Path):
            return read_path(options.path, options.n_frames, options.size)
        return camera_path(capture.rig, capture.bounds, options.n_frames, options.size, kind=options.path)

    def camera_keys(self) -> list[Any]:
        """Describe the cameras for a key."""
        return [camera_key(camera) for camera in self.cameras()]

    def names(self, part: range | None = None) -> list[str]:
        """Name video, quality and master in the stimulus set, or those of a part that is not yet joined."""
        stem = f"{self.run.dataset}/{self.approach}"
        if part is not None:
            stem = f"{PARTS}/{stem}/{part.start:04d}"
        return [f"{stem}.mp4", f"{stem}.quality.json", *([f"{stem}.master.mp4"] if self.options.master else [])]

    def key(self) -> dict[str, Any]:
        """Describe what the video is made from."""
        return {
            "meshes": self.run.artefacts.digests(self.meshes),
            "rig": self.camera_keys(),
            "options": {name: value for name, value in asdict(self.options).items() if name not in (*WHERE, "path")},
            "code": code_version("render", "pipeline/film.py"),
        }


def make_path(films: Sequence[Film], out: Path) -> dict[str, str]:
    """Write the cameras of a dataset's films for other programs, unless the file is finished; returns name and digest.

    Parameters
    ----------
    films : of the dataset, one for each of its runs
    out : folder of the stimulus set

    Raises
    ------
    ValueError
        If the runs would have different cameras, or the cameras are read from the file that is written here.
    """
    dataset, options = films[0].run.dataset, films[0].options
    name = f"paths/{dataset}.json"
    if options.path == out / name:
        raise ValueError(f"{address_of(out / name)}: is written by this command; copy it and give --path the copy")
    rigs = [film.camera_keys() for film in films]
    if any(rig != rigs[0] for rig in rigs):
        raise ValueError(
            f"{dataset}: its runs differ in sensors or bounds, so their films would take different paths; "
            "render runs of one recording, or choose one path with --path FILE"
        )
    key = {"rig": rigs[0], "fps": options.fps, "code": code_version("render/path_file.py")}
    artefacts = Artefacts(out)
    artefacts.make(name, key, partial(write_path, cameras=films[0].cameras(), fps=options.fps))
    return {"file": name, "sha256": artefacts.digest(name)}


def is_finished(film: Film, out: Path) -> bool:
    """Return whether a film's video is finished."""
    key = film.key()
    return all(Artefacts(out).has(name, key) for name in film.names())


def make_part(film: Film, out: Path, part: range, *, threads: int) -> int:
    """Render, encode and check some frames of a film, unless they are finished; returns how many they are.

    Parameters
    ----------
    film, part : which frames of it
    out : folder of the stimulus set
    threads : that may be used; the frames do not depend on it
    """

    def write(paths: list[Path]) -> None:
        cameras = film.cameras()
        scene = scene_around(film.run.capture.bounds, cameras, film.options.background)
        models = (_mesh_once(film.run.artefacts.path(film.meshes[film.shown[frame]])) for frame in part)
        frames = render_frames(
            models, cameras[part.start : part.stop], scene, renderer=film.options.renderer, threads=threads
        )
        master = paths[2] if film.options.master else None
        _, check = write_checked_video(paths[0], frames, size=film.options.size, fps=film.options.fps, master=master)
        write_json(paths[1], asdict(check))

    Artefacts(out).make_together(film.names(part), {**film.key(), "part": [part.start, part.stop]}, write)
    return len(part)


def make_film(film: Film, out: Path) -> Stimulus:
    """Join the parts of a film, unless its video is finished, and describe it."""
    artefacts = Artefacts(out)
    artefacts.make_together(film.names(), film.key(), partial(_join_parts, film, artefacts))
    artefacts.remove(name for part in film.parts for name in film.names(part))
    video, quality, *master = film.names()
    facts = probe_video(artefacts.path(video))
    return Stimulus(
        dataset=film.run.dataset,
        approach=film.approach,
        levels=parse_approach(film.approach).levels,
        video=video,
        master=master[0] if master else None,
        width=facts.width,
        height=facts.height,
        fps=facts.fps,
        n_frames=facts.n_frames,
        codec=facts.codec,
        renderer=describe_renderer(film.options.renderer),
        model_frames=len(film.meshes),
        loop=film.loop,
        quality=read_json(artefacts.path(quality)),
    )


def _join_parts(film: Film, artefacts: Artefacts, paths: list[Path]) -> None:
    names = [film.names(part) for part in film.parts]
    for number in range(0, len(paths), 2):  # the video and its master, not the quality between them
        join_videos(paths[number], [artefacts.path(part[number]) for part in names])
    checks = [read_json(artefacts.path(part[1])) for part in names]
    check = VideoCheck(
        *(tuple(chain.from_iterable(part[name] for part in checks)) for name in ("psnr_db", "ssim", "crc32"))
    )
    if not holds_checked_frames(paths[0], check):
        parts = artefacts.folder / PARTS
        raise VideoError(f"{paths[0]}: its frames are not those of its parts; remove {parts} and render again")
    write_json(paths[1], _quality(check))


def _quality(check: VideoCheck) -> dict[str, Any]:
    """Summarise for the manifest how near the encoded frames are to the rendered ones, in luma."""
    return {
        "psnr_y_mean_db": round(fmean(check.psnr_db), 2),
        "psnr_y_worst_db": round(min(check.psnr_db), 2),
        "ssim_y_mean": round(fmean(check.ssim), 5),
        "faults": list(check.faults),
    }


@lru_cache(maxsize=1)
def _mesh_once(path: Path) -> Mesh:
    """Read a mesh once for all frames in a row that show it, so that the renderer gets the same object."""
    return read_mesh(path)
