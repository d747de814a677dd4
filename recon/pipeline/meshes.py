"""The stage that makes meshes of clouds, as `recon.pipeline.stages` makes these: they agree, are filled, are fused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from recon.capture.format import mask_pictures
from recon.capture.rectify import Rectification
from recon.cloud import merge_clouds
from recon.fusion import view_of_cloud
from recon.fusion.agreement import agreed
from recon.fusion.filling import fill_holes
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.mesh_files import write_mesh
from recon.methods.approaches import Approach
from recon.methods.plugins import PluginError
from recon.pipeline.job import Job
from recon.pipeline.keys import camera_key, digest_once, files_key
from recon.pipeline.methods import fuse, fusion_key, needs_views
from recon.pipeline.run import COLOURS_NAME, View, fusion_folder
from recon.pipeline.stages import cloud_key, clouds_of, compared_method, rectified_view, store_program_log
from recon.runtime.artefacts import code_version, key_of
from recon.runtime.files import read_json
from recon.runtime.programs import ProgramError
from recon.runtime.remote import fetched
from recon.surface import NoSurfaceError
from recon.surface.colours import SensorColours, balance_colours
from recon.surface.outlines import Sight, believed, drop_outside, follow_masks, read_sights
from recon.surface.photographs import read_photographs
from recon.surface.vertex_colours import Beside, beside, supports

Fused = tuple[Mesh, list[str]]  # and a sentence on each cloud that was left out


@dataclass(frozen=True, eq=False)
class Prepared:
    """What the sensors measured of a frame by a depth method, ready to be fused in any order.

    Parameters
    ----------
    measured : one per sensor, made to agree, each as bright as the others
    filled : what fills the holes, one per sensor; none where holes stay
    sights : of the sensors, if outlines follow their masks; else none
    voxel_mm : of the surface
    reach_mm : how far beside a mask a place may lie
    reasons : a sentence for each sensor whose masks are not believed
    warnings : a sentence for each sensor that sees nothing, where no cloud says so
    """

    measured: list[Cloud]
    filled: list[Cloud]
    sights: list[Sight]
    voxel_mm: float
    reach_mm: float
    reasons: list[str]
    warnings: list[str]

    @cached_property
    def inside(self) -> list[Cloud]:
        """What was measured inside all masks."""
        return drop_outside(self.sights, self.reach_mm)

    @cached_property
    def points(self) -> Beside:
        """What was measured, and what fills the holes, to tell which of them a vertex has beside it."""
        clouds = (merge_clouds([cloud for cloud in kind if len(cloud)]) for kind in (self.measured, self.filled))
        return beside(list(clouds), self.voxel_mm)

    def marked(self, mesh: Mesh) -> Mesh:
        """Mark the vertices beside which more was filled than measured."""
        holes = [cloud for cloud in self.filled if len(cloud)]
        if not holes:
            return mesh
        near = np.flatnonzero(supports(mesh, [merge_clouds(holes)], self.voxel_mm)[:, 0])
        of_seen, of_holes = self.points.gather(mesh.vertices[near], mesh.normals[near], mesh.colours[near])[1].T
        filled = np.zeros(len(mesh.vertices), bool)
        filled[near] = of_holes > of_seen
        return replace(mesh, filled=filled)


def make_meshes(job: Job, approaches: Sequence[Approach], frame: int) -> list[str]:
    """Fuse the clouds of all sensors into one mesh for each approach; what these share is made once.

    Parameters
    ----------
    job : whose clouds are finished, and whose colours are compared if they are to be balanced
    approaches, frame : how to fuse the clouds, all of one depth method, and which clouds
    """
    prepared = cache(partial(_prepared, job, approaches[0].depth, frame))
    return [name for approach in approaches for name in _make_mesh(job, approach, frame, prepared)]


def _make_mesh(job: Job, approach: Approach, frame: int, prepared: Callable[[], Prepared]) -> list[str]:
    options, fusion = job.options, job.options.methods.fusion[approach.fusion]
    surface = job.surface(approach.depth)
    key = {
        "clouds": _clouds_key(job, approach.depth, frame),
        "colours": job.artefacts.digest(COLOURS_NAME) if options.balance_colours else None,
        "fusion": fusion_key(fusion, surface),
        "outlines": _outlines_key(job, approach.depth, frame) if options.outlines else None,
        "agreement": options.agreement,
        "filled": _filled_key(job, approach.depth, frame) if options.fill_px else None,
        "code": code_version("surface", "fusion", "geometry"),
    }
    folder = fusion_folder(str(approach), frame)

    def write(path: Path) -> list[str]:
        sensors = prepared()

        def made_of(inside: Sequence[Cloud]) -> Fused:
            views = None
            if needs_views(fusion):
                cameras = [view.left for view in _rectifications(job, approach.depth, frame)]
                views = [view_of_cloud(cloud, camera) for cloud, camera in zip(inside, cameras, strict=True)]
            filled = sensors.filled
            wholes = [_merged(*clouds) for clouds in zip(inside, filled, strict=True)] if filled else inside
            return fuse(fusion, wholes, surface, views=views, folder=job.artefacts.folder / folder)

        try:
            mesh, left_out = _outlined(sensors, made_of)
        except NoSurfaceError as error:
            raise NoSurfaceError(f"{approach}: frame {frame} has no model: {error}") from error
        except (ProgramError, PluginError) as error:
            store_program_log(job, folder)
            raise type(error)(f"{approach}: frame {frame}: {error}") from error
        write_mesh(path, sensors.marked(mesh))
        return [*sensors.warnings, *(f"{approach}: frame {frame}: {reason}" for reason in left_out)]

    return job.make_mesh(approach, frame, key, write)


def _prepared(job: Job, method: str, frame: int) -> Prepared:
    options = job.options
    (clouds, warnings), filled = clouds_of(job, method, frame), []
    if options.agreement:
        clouds = agreed(clouds, [view.left for view in _rectifications(job, method, frame)])
    if options.fill_px:
        for stream in job.capture.sensors_for(method):
            photographs = read_photographs(job.capture, stream, frame)
            filled.append(merge_clouds(fill_holes(clouds, photographs, options.fill_px)))
    if options.balance_colours:
        colours = _colours(job, method)
        clouds, filled = balance_colours(clouds, colours), balance_colours(filled, colours) if filled else []
    sights: list[Sight] = []
    reasons: list[str] = []
    if options.outlines:
        sights = read_sights(job.capture, job.capture.sensors_for(method), clouds, frame)
        sights, reasons = believed(sights, job.step_mm)
    voxel = job.surface(method).voxel_mm
    assert voxel is not None
    return Prepared(clouds, filled, sights, voxel, job.step_mm, reasons, warnings)


def _merged(measured: Cloud, filled: Cloud) -> Cloud:
    return merge_clouds([measured, filled]) if len(filled) else measured


def _outlined(sensors: Prepared, made_of: Callable[[Sequence[Cloud]], Fused]) -> Fused:
    """Make a mesh of what was measured; where outlines are asked for, they follow the masks."""
    if not sensors.sights:
        return made_of(sensors.measured)
    mesh, left_out = made_of(sensors.inside)
    mesh = follow_masks(mesh, sensors.sights, sensors.reach_mm)
    if not len(mesh.faces):
        raise NoSurfaceError(
            "nothing of its surface lies inside the sensors' masks; expected coordinates of the clouds, in mm, and "
            "masks that are white on the object"
        )
    return mesh, [*left_out, *sensors.reasons]


def _outlines_key(job: Job, method: str, frame: int) -> dict[str, Any]:
    """Describe what outlines depend on beside the clouds: the masks of the sensors, their cameras and the voxel."""
    streams = job.capture.sensors_for(method)
    masks = [mask.path for stream in streams for mask in mask_pictures(job.capture.folder, stream, frame)]
    return {
        "masks": [digest_once(fetched(path)) for path in masks],
        "cameras": [camera_key(side.camera) for stream in streams for side in stream.cameras],
        "frame": frame,
        "voxel_mm": job.step_mm,
    }


def _clouds_key(job: Job, method: str, frame: int) -> list[str]:
    """Describe the clouds of all sensors by what they are made of, since few of them stay on disk."""
    return [key_of(cloud_key(job, view)) for view in job.views(method, frame)]


def _filled_key(job: Job, method: str, frame: int) -> dict[str, Any]:
    """Describe what holes are filled by: pictures and masks of the sensors, and how far."""
    pictures = [
        files_key(job.capture, View(method, stream.id, frame), stream.cameras, stream.mask or ())
        for stream in job.capture.sensors_for(method)
    ]
    return {"pictures": pictures, "reach_px": job.options.fill_px}


def _rectifications(job: Job, method: str, frame: int) -> list[Rectification]:
    return [rectified_view(job.capture, View(method, stream.id, frame)) for stream in job.capture.sensors_for(method)]


def _colours(job: Job, method: str) -> SensorColours:
    """Read the correction of the sensors that a depth method uses."""
    content = read_json(job.artefacts.path(COLOURS_NAME))
    known = [stream.id for stream in job.capture.sensors_for(compared_method(job))]
    rows = [known.index(stream.id) for stream in job.capture.sensors_for(method)]
    return SensorColours(np.array(content["gain"])[rows], np.array(content["offset"])[rows])
