"""The fly-through: a video of one approach's models, by the same cameras and light as every other approach's."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import Camera
from recon.pipeline.keys import camera_key
from recon.pipeline.manifest import Stimulus
from recon.pipeline.sources import ModelSequence, SceneSetting
from recon.render.encoding.checked import holds_checked_frames, write_checked_video
from recon.render.encoding.quality import VideoCheck
from recon.render.encoding.video import SILHOUETTE, VideoError, join_videos, probe_video, write_video
from recon.render.frames import describe_renderer, render_masked_frames
from recon.render.path_file import write_path
from recon.render.scene import check_background, scene_around
from recon.runtime.artefacts import Artefacts, code_version
from recon.runtime.files import read_json, write_json

PART_FRAMES = 50  # two groups of pictures; nothing is predicted across them, so joining parts costs no quality
PARTS = ".parts"
LARGEST_SIDE = 16384  # pixels, which x264 takes
WHERE = ("workers", "cluster", "device")  # options that say where work runs, not what is made
LIGHTS = ("studio", "flat")
FLOORS = ("model", "bounds")
LOOPS = ("repeat", "bounce", "static")


@dataclass(frozen=True)
class RenderOptions:
    """How every model of a stimulus set is shown.

    Parameters
    ----------
    size : (width, height), pixels, both even
    fps, seconds : of the videos
    background : the name of an artificial background
    floor : "model" for where the models of a scene stand, "bounds" for the bottom of its bounds, or a height in mm
    light : "studio", or "flat": meshes and clouds have the colours that they bring, as splats always do
    path : a kind of `camera_path`, or the file of one (see `recon.render.path_file`)
    loop : "repeat" starts a recording again where it ends, "bounce" plays it back and forth, "static" shows its
        first model
    loops : the same for single approaches, by name
    renderer : "auto" or the name of a renderer
    master : whether to keep a near-lossless master beside each video
    workers : local processes, each on one thread; 1 works in this process with all threads
    cluster : address of a Dask scheduler whose workers render instead; None for none
    """

    size: tuple[int, int] = (1920, 1080)
    fps: float = 25.0
    seconds: float = 15.0
    background: str = "studio"
    floor: str | float = "model"
    light: str = "studio"
    path: str | Path = "auto"
    loop: str = "bounce"
    loops: Mapping[str, str] = field(default_factory=dict)
    renderer: str = "auto"
    master: bool = True
    workers: int = 1
    cluster: str | None = None

    def __post_init__(self) -> None:
        if any(side % 2 or not 2 <= side <= LARGEST_SIDE for side in self.size):
            raise ValueError(
                f"size is {self.size[0]}x{self.size[1]}, expected even numbers of pixels from 2 to {LARGEST_SIDE}"
            )
        for name in ("fps", "seconds"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} is {getattr(self, name):g}, expected a number above 0")
        check_background(self.background)
        if not (self.floor in FLOORS or (isinstance(self.floor, float) and math.isfinite(self.floor))):
            raise ValueError(f"floor is {self.floor!r}, expected {', '.join(FLOORS)}, or a height in mm")
        if self.light not in LIGHTS:
            raise ValueError(f"light is {self.light!r}, expected one of {', '.join(LIGHTS)}")
        for loop in (self.loop, *self.loops.values()):
            if loop not in LOOPS:
                raise ValueError(f"loop is {loop!r}, expected one of {', '.join(LOOPS)}")
        if self.n_frames < 1:
            raise ValueError(f"{self.seconds:g} s at {self.fps:g} frames/s is no video; ask for one frame at least")

    @property
    def n_frames(self) -> int:
        """The number of frames of a video."""
        return round(self.seconds * self.fps)

    def loop_of(self, sequence: ModelSequence) -> str:
        """Choose how a sequence fills a video."""
        if len(sequence.files) == 1:
            return "static"
        return self.loops.get(sequence.approach, "static" if sequence.is_still else self.loop)


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

    sequence: ModelSequence
    setting: SceneSetting
    options: RenderOptions

    @property
    def dataset(self) -> str:
        """The scene's name."""
        return self.sequence.dataset

    @property
    def loop(self) -> str:
        """How the models fill the video."""
        return self.options.loop_of(self.sequence)

    @property
    def shown(self) -> list[int]:
        """The number of the model that each frame shows."""
        step = self.sequence.fps / self.options.fps
        return shown_frames(len(self.sequence.files), self.options.n_frames, step, self.loop)

    @property
    def n_models(self) -> int:
        """The number of models that the loop goes through."""
        return 1 if self.loop == "static" else len(self.sequence.files)

    @property
    def model_bytes(self) -> int | None:
        """Size of a model with its textures, the mean where the film shows several; None where it is not known."""
        sizes = self.sequence.sizes[: self.n_models]
        return round(fmean(sizes)) if sizes and all(sizes) else None

    @property
    def parts(self) -> list[range]:
        """The frames of each part."""
        n_frames = self.options.n_frames
        return [range(first, min(first + PART_FRAMES, n_frames)) for first in range(0, n_frames, PART_FRAMES)]

    @property
    def bounds(self) -> NDArray[np.float64]:
        """The bounds of the scene, float64 (2, 3), mm."""
        assert self.setting.bounds is not None, "they are known once the models were read"
        return self.setting.bounds

    @property
    def floor_y(self) -> float:
        """Height of the floor of the scene, mm."""
        return float(self.bounds[0, 1]) if self.setting.floor_y is None else self.setting.floor_y

    def cameras(self) -> tuple[Camera, ...]:
        """Place a camera for each frame, the same for every approach of the scene."""
        return self.setting.cameras(self.options.path, self.options.n_frames, self.options.size)

    def names(self, part: range | None = None) -> list[str]:
        """Name video, quality, mask and master in the stimulus set, or those of a part that is not yet joined."""
        stem = f"{self.dataset}/{self.sequence.approach}"
        if part is not None:
            stem = f"{PARTS}/{stem}/{part.start:04d}"
        masters = [f"{stem}.master.mp4"] if self.options.master else []
        return [f"{stem}.mp4", f"{stem}.quality.json", f"{stem}.mask.mp4", *masters]

    def key(self) -> dict[str, Any]:
        """Describe what the video is made from."""
        sequence, left_out = self.sequence, (*WHERE, "path", "loop", "loops", "floor")
        return {
            "models": sequence.digests[: self.n_models],
            "placement": None if sequence.placement is None else asdict(sequence.placement),
            "shown": self.shown,
            "bounds": self.bounds.tolist(),
            "floor": self.floor_y,
            "rig": [camera_key(camera) for camera in self.cameras()],
            "options": {name: value for name, value in asdict(self.options).items() if name not in left_out},
            "code": code_version("render", "models", "geometry", "pipeline/film.py", "pipeline/sources.py"),
        }

    def is_finished(self, out: Path) -> bool:
        """Return whether the video is finished in the folder of a stimulus set."""
        key = self.key()
        return all(Artefacts(out).has(name, key) for name in self.names())


def path_name(dataset: str) -> str:
    """Name the file of a scene's cameras in the stimulus set."""
    return f"paths/{dataset}.json"


def make_path(film: Film, out: Path) -> dict[str, str]:
    """Write the cameras of a scene's films for other programs, unless the file is finished; returns name and digest.

    Parameters
    ----------
    film : any of the scene's
    out : folder of the stimulus set
    """
    name, fps, cameras = path_name(film.dataset), film.options.fps, film.cameras()
    rig = [camera_key(camera) for camera in cameras]
    artefacts = Artefacts(out)
    key = {"rig": rig, "fps": fps, "code": code_version("render/path_file.py")}
    artefacts.make(name, key, partial(write_path, cameras=cameras, fps=fps))
    return {"file": name, "sha256": artefacts.digest(name)}


def make_part(film: Film, out: Path, part: range, *, threads: int) -> tuple[int, int]:
    """Render, encode and check some frames of a film, unless they are; returns how many were made, and how many found.

    Parameters
    ----------
    film, part : which frames of it
    out : folder of the stimulus set
    threads : that may be used; the frames do not depend on it
    """

    def write(paths: list[Path]) -> None:
        cameras = film.cameras()
        scene = scene_around(film.bounds, cameras, film.options.background, floor_y=film.floor_y)
        if film.options.light == "flat":
            scene = scene.without_light()
        shown = film.shown
        models = (film.sequence.read(shown[frame]) for frame in part)
        frames = render_masked_frames(
            models, cameras[part.start : part.stop], scene, renderer=film.options.renderer, threads=threads
        )
        size, fps = film.options.size, film.options.fps
        master = paths[3] if film.options.master else None
        masks: list[NDArray[np.uint8]] = []  # 50 frames of full HD take 13 MB
        pictures = _setting_masks_aside(frames, masks)
        _, check = write_checked_video(paths[0], pictures, size=size, fps=fps, master=master)
        write_json(paths[1], asdict(check))
        write_video(paths[2], map(partial(_mask_picture, size), masks), size=size, fps=fps, encoding=SILHOUETTE)

    made = Artefacts(out).make_together(film.names(part), {**film.key(), "part": [part.start, part.stop]}, write)
    return (len(part), 0) if made else (0, len(part))


def make_film(film: Film, out: Path) -> Stimulus:
    """Join the parts of a film, unless its video is finished, and describe it."""
    artefacts = Artefacts(out)
    artefacts.make_together(film.names(), film.key(), partial(_join_parts, film, artefacts))
    artefacts.remove(name for part in film.parts for name in film.names(part))
    video, quality, mask, *master = film.names()
    facts = probe_video(artefacts.path(video))
    return Stimulus(
        dataset=film.dataset,
        approach=film.sequence.approach,
        levels=dict(film.sequence.levels),
        video=video,
        master=master[0] if master else None,
        width=facts.width,
        height=facts.height,
        fps=facts.fps,
        n_frames=facts.n_frames,
        codec=facts.codec,
        renderer=describe_renderer(film.options.renderer),
        model_frames=film.n_models,
        loop=film.loop,
        model_bytes=film.model_bytes,
        quality=read_json(artefacts.path(quality)),
        mask=mask,
    )


def _join_parts(film: Film, artefacts: Artefacts, paths: list[Path]) -> None:
    names = [film.names(part) for part in film.parts]
    for number, path in enumerate(paths):
        if path.suffix == ".mp4":
            join_videos(path, [artefacts.path(part[number]) for part in names])
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


def _setting_masks_aside(
    frames: Iterable[tuple[NDArray[np.uint8], NDArray[np.bool_]]], masks: list[NDArray[np.uint8]]
) -> Iterator[NDArray[np.uint8]]:
    """Pass the pictures on, and collect their masks, eight pixels a byte."""
    for picture, mask in frames:
        masks.append(np.packbits(mask))
        yield picture


def _mask_picture(size: tuple[int, int], packed: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Draw a mask white on black."""
    width, height = size
    grey = 255 * np.unpackbits(packed, count=height * width).reshape(height, width, 1)
    return np.repeat(grey, 3, axis=2)
