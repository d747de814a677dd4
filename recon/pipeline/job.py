"""What a reconstruction is to make: its options, and the views, clouds and models that follow from them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from recon.capture.depth_maps import depth_view
from recon.capture.format import Capture, CaptureError
from recon.capture.recording import GIVEN, chosen_frames
from recon.cloud import CloudParameters
from recon.depth import CPU, check_device
from recon.depth.temporal import TemporalParameters
from recon.methods.approaches import DEPTH_METHODS, FUSION_METHODS, VERTICES, Approach, approaches, check_colours
from recon.pipeline.methods import Methods, is_pm
from recon.pipeline.run import View, mesh_name, read_clouds
from recon.runtime.artefacts import Artefacts, Warnings
from recon.surface import SurfaceParameters, default_voxel
from recon.surface.outlines import widened

MOVING, STATIC = "moving", "static"  # what PM makes: models of all frames, or of the first alone
FEW, ALL = "few", "all"  # which clouds stay on disk
PLAIN, PACKED = "plain", "packed"  # how meshes are stored
STRETCH = 12  # frames of PM in which each starts from the one before; more would keep fewer workers busy
# A frame by PM takes as long as so many by ID or DR, and the first of a stretch as so many frames: of synthetic people
# 6.3 and 3.1 at 480x270, 5.3 and 2.8 at 1080x1920.
PM_WORK, FIRST_WORK = 6, 3


@dataclass(frozen=True)
class ReconstructOptions:
    """What to make of a capture.

    Parameters
    ----------
    depths, fusions : names of methods; every combination, with each of `colours`, is an approach. Without depths,
        `default_depths`
    further : approaches beside these combinations
    colours : where models take their colours from, of `recon.methods.approaches.COLOURS`
    methods : what these names stand for
    frames : which frames; None for all
    pm : `MOVING`, or `STATIC`, as the paper showed PM: its models are of the first frame alone
    temporal : of the filter over a sensor's frames; None for none
    cloud, surface : parameters of these stages; without a voxel size, each depth method gets one
        that suits its error and the density of its points
    clouds : `ALL`, or `FEW`: those of the first and the middle frame stay on disk, others are made when they are needed
    meshes : `PLAIN`, as PLY and GLB, or `PACKED`: all but those of the first and the middle frame as Parquet
    balance_colours : whether to make the sensors' colours agree, as estimated from what several of them saw
    agreement : whether the sensors' points are held against each other before they are fused
    steady : with how many frames before and after the rims of surfaces with photographs are averaged
    outlines : whether the surfaces' outlines follow the masks, where the capture has masks
    fill_px : how far surfaces are continued where a mask shows the object and nothing was measured, pixels of the
        photographs; 0 for not at all, as without outlines
    workers : local processes, each on one thread; 1 works in this process with all threads
    cluster : address of a Dask scheduler whose workers do the work instead; None for none
    device : where our depth methods match, of `recon.depth.DEVICES`; each worker opens the GPU of its machine
    """

    depths: tuple[str, ...] = ()
    fusions: tuple[str, ...] = FUSION_METHODS
    further: tuple[Approach, ...] = ()
    colours: tuple[str, ...] = (VERTICES,)
    methods: Methods = field(default_factory=Methods)
    frames: range | None = None
    pm: str = MOVING
    temporal: TemporalParameters | None = field(default_factory=TemporalParameters)
    cloud: CloudParameters = field(default_factory=CloudParameters)
    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    clouds: str = ALL
    meshes: str = PLAIN
    balance_colours: bool = False
    agreement: bool = True
    steady: int = 2
    outlines: bool = True
    fill_px: int = 16
    workers: int = 1
    cluster: str | None = None
    device: str = CPU

    @property
    def models(self) -> tuple[Approach, ...]:
        """All approaches."""
        return tuple(dict.fromkeys((*approaches(self.depths, self.fusions, self.colours), *self.further)))

    @property
    def surfaces(self) -> tuple[Approach, ...]:
        """Those whose meshes have coloured vertices; textures are put on copies of these."""
        further = (Approach(approach.depth, approach.fusion) for approach in self.further)
        return tuple(dict.fromkeys((*approaches(self.depths, self.fusions), *further)))

    @property
    def depth_methods(self) -> tuple[str, ...]:
        """The depth methods of all approaches."""
        return tuple(dict.fromkeys((*self.depths, *(approach.depth for approach in self.further))))

    @property
    def fusion_methods(self) -> tuple[str, ...]:
        """The fusions of all approaches."""
        return tuple(dict.fromkeys((*self.fusions, *(approach.fusion for approach in self.further))))


@dataclass(frozen=True, eq=False)
class Job:
    """A reconstruction to be made.

    Parameters
    ----------
    capture : the recording
    frames : which of its frames
    options : how to make it, with a voxel size
    artefacts : the run's files
    voxels : distance of the surfaces' samples by depth method, mm, where the options leave it open; chosen from the
        clouds (`with_voxels`)
    """

    capture: Capture
    frames: Sequence[int]
    options: ReconstructOptions
    artefacts: Artefacts
    voxels: Mapping[str, float] = field(default_factory=dict)

    @property
    def sequences(self) -> list[list[View]]:
        """The views of each sensor by each depth method, frame by frame."""
        return [
            [View(method, stream.id, frame) for frame in self.frames_of(method)]
            for method in self.options.depth_methods
            for stream in self.capture.sensors_for(method)
        ]

    @property
    def matched_sensors(self) -> list[str]:
        """The ids of the sensors whose pairs are matched by some depth method."""
        is_matched = any(method != GIVEN for method in self.options.depth_methods)
        return [stream.id for stream in self.capture.sensors if is_matched and stream.right is not None]

    def frames_of(self, method: str) -> Sequence[int]:
        """Return the frames that a depth method is to match: all, or the first where PM is to stand still."""
        is_still = self.options.pm == STATIC and is_pm(self.options.methods.depth[method])
        return self.frames[:1] if is_still else self.frames

    @property
    def stretches(self) -> list[list[View]]:
        """Group the views that are matched in one go, by frame: `STRETCH` of a sensor by PM, each alone by others."""
        stretches: list[list[View]] = []
        for sequence in self.sequences:
            length = STRETCH if is_pm(self.options.methods.depth[sequence[0].method]) else 1
            stretches += [list(group) for _, group in groupby(sequence, key=lambda view: view.frame // length)]
        return sorted(stretches, key=lambda stretch: stretch[0].frame)

    def work(self, stretch: Sequence[View]) -> int:
        """Return how much work matching a stretch is, in frames by ID or DR; what other programs take is not known."""
        if not is_pm(self.options.methods.depth[stretch[0].method]):
            return len(stretch)
        return PM_WORK * (FIRST_WORK + len(stretch) - 1)

    def surface(self, method: str) -> SurfaceParameters:
        """Return the parameters of the surfaces of a depth method, with a voxel."""
        return replace(self.options.surface, voxel_mm=self.options.surface.voxel_mm or self.voxels[method])

    @property
    def step_mm(self) -> float:
        """A third of the depth step of a pixel of disparity, or the voxel asked for: how far cameras and masks err."""
        return self.options.surface.voxel_mm or depth_resolution(self.capture)

    @property
    def models(self) -> list[tuple[Approach, int]]:
        """The approach and the frame of every model, frame by frame."""
        return self._frame_by_frame(self.options.models)

    @property
    def surfaces(self) -> list[tuple[Approach, int]]:
        """The approach and the frame of every mesh with coloured vertices, frame by frame."""
        return self._frame_by_frame(self.options.surfaces)

    def _frame_by_frame(self, approaches: Sequence[Approach]) -> list[tuple[Approach, int]]:
        return [
            (approach, frame)
            for frame in self.frames
            for approach in approaches
            if frame in self.frames_of(approach.depth)
        ]

    def temporal(self, method: str) -> TemporalParameters | None:
        """Return how the disparity maps of a depth method are filtered in time; None for not at all."""
        return self.options.methods.temporal_of(method, self.options.temporal)

    def frames_beside(self, method: str, frame: int) -> list[int]:
        """List the frames around a frame with whose rims its own are averaged: as many before it as after it."""
        frames = self.frames_of(method)
        steps = range(1, self.options.steady + 1)
        return [frame + way * step for step in steps if {frame - step, frame + step} <= {*frames} for way in (-1, 1)]

    @property
    def kept_frames(self) -> Sequence[int]:
        """The frames whose clouds stay on disk."""
        return self.frames if self.options.clouds == ALL else self._first_and_middle

    @property
    def packed_frames(self) -> Sequence[int]:
        """The frames whose meshes are packed."""
        return [frame for frame in self.frames if self.options.meshes == PACKED and frame not in self._first_and_middle]

    @property
    def _first_and_middle(self) -> tuple[int, int]:
        return self.frames[0], self.frames[len(self.frames) // 2]

    def mesh_name(self, approach: Approach, frame: int) -> str:
        """Name the mesh of a frame by an approach."""
        return mesh_name(str(approach), frame, packed=frame in self.packed_frames)

    def make_mesh(
        self, approach: Approach, frame: int, key: Mapping[str, Any], write: Callable[[Path], Warnings]
    ) -> list[str]:
        """Make a mesh as `Artefacts.make` does, and remove one that was stored in the other way.

        Parameters
        ----------
        approach, frame : which mesh
        key, write : of its file
        """
        made = self.artefacts.make(self.mesh_name(approach, frame), key, write)
        if made:
            self.artefacts.remove([mesh_name(str(approach), frame, packed=frame not in self.packed_frames)])
        return made

    def views(self, method: str, frame: int) -> list[View]:
        """List the views of all sensors that a depth method uses."""
        return [View(method, stream.id, frame) for stream in self.capture.sensors_for(method)]

    def clouds(self, method: str, frame: int) -> list[str]:
        """Name the clouds of all sensors that the depth method uses."""
        return [view.cloud for view in self.views(method, frame)]


def planned_job(capture: Capture, run: Path, options: ReconstructOptions) -> Job:
    """Complete the options for a capture, and check them.

    Parameters
    ----------
    capture : the recording
    run : folder of the run
    options : what to make; what they leave open follows from the capture

    Raises
    ------
    ValueError
        If a method, the colours or the frames are wrong, a depth method cannot be used for a sensor, or there is no
        GPU where one is asked for.
    """
    options = replace(options, depths=options.depths or default_depths(capture))
    options.methods.check(options.depth_methods, options.fusion_methods)
    if not options.fusion_methods:
        known = ", ".join(options.methods.fusion)
        raise ValueError(f"no fusion was named, so there is nothing to make; expected some of {known}")
    check_colours(options.colours)
    if options.cluster is None:
        check_device(options.device)
    check_sensors(capture, options.depth_methods)
    options = replace(options, outlines=options.outlines and any(stream.mask for stream in capture.sensors))
    options = replace(options, surface=widened(options.surface)) if options.outlines else replace(options, fill_px=0)
    frames = chosen_frames(capture.folder, range(capture.n_frames), options.frames)
    return Job(capture, frames, options, Artefacts(run))


def with_voxels(job: Job) -> Job:
    """Choose a voxel for each depth method from its clouds of the first frame, where the options give none.

    The better a method measures and the denser its points lie, the finer its surfaces. One voxel serves all frames, so
    that surfaces stay steady in time.
    """
    if job.options.surface.voxel_mm is not None:
        return job
    first = job.frames[0]
    return replace(
        job,
        voxels={
            method: default_voxel(read_clouds(job.artefacts, job.clouds(method, first)))
            for method in job.options.depth_methods
        },
    )


def default_depths(capture: Capture) -> tuple[str, ...]:
    """Return the paper's depth methods, or the given depth of a capture that holds only depth maps."""
    return DEPTH_METHODS if any(stream.right is not None for stream in capture.sensors) else (GIVEN,)


def check_sensors(capture: Capture, depths: Sequence[str]) -> None:
    """Raise a CaptureError if a depth method cannot be used for a sensor: matchers need pairs, given depth depth maps.

    Parameters
    ----------
    capture : the recording
    depths : names of methods
    """
    single = [stream.id for stream in capture.sensors if stream.right is None]
    for method in depths:
        if method == GIVEN and not capture.sensors_for(GIVEN):
            ids = ", ".join(stream.id for stream in capture.sensors)
            raise CaptureError(f"{capture.folder}: depth method {GIVEN} needs depth maps, and sensors {ids} have none")
        if method != GIVEN and single:
            raise CaptureError(
                f"{capture.folder}: depth method {method} needs stereo pairs, and sensor {single[0]} has one camera "
                f"with depth maps; use --depth {GIVEN}"
            )


def depth_resolution(capture: Capture) -> float:
    """Return a length that loses neither depth nor picture resolution at the middle of the bounds, mm.

    A third of the depth step of one pixel of disparity, so that a slice of whole disparities still meets the next,
    and not less than the width of a pixel; for depth maps without a pair, the width of a pixel. The coarsest decides.
    """
    centre = capture.bounds.mean(axis=0)
    sizes: list[float] = []
    for stream in capture.sensors:
        camera = stream.left.camera if stream.right else depth_view(stream, capture.bounds).left
        distance = float(np.linalg.norm(camera.centre - centre))
        pixel = distance / float(camera.K[0, 0])
        sizes.append(max(pixel, pixel * distance / stream.sensor.baseline / 3) if stream.right else pixel)
    return round(max(sizes), 3)
