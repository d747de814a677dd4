"""The stage that makes meshes of clouds, as `recon.pipeline.stages` makes these: they agree, are filled, are fused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
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
from recon.pipeline.run import COLOURS_NAME, View, fusion_folder, mesh_name, read_clouds
from recon.pipeline.stages import compared_method, rectified_view, store_program_log
from recon.runtime.artefacts import code_version
from recon.runtime.files import read_json
from recon.runtime.programs import ProgramError
from recon.runtime.remote import fetched
from recon.surface import NoSurfaceError
from recon.surface.colours import SensorColours, balance_colours
from recon.surface.outlines import read_sights, with_outlines
from recon.surface.photographs import read_photographs
from recon.surface.vertex_colours import supports

Fused = tuple[Mesh, list[str]]  # and a sentence on each cloud that was left out


def make_mesh(job: Job, approach: Approach, frame: int) -> list[str]:
    """Fuse the clouds of all sensors into one mesh.

    Parameters
    ----------
    job : whose clouds are finished, and whose colours are compared if they are to be balanced
    approach, frame : which clouds, and how to fuse them
    """
    options, fusion = job.options, job.options.methods.fusion[approach.fusion]
    names, surface = job.clouds(approach.depth, frame), job.surface(approach.depth)
    key = {
        "clouds": job.artefacts.digests(names),
        "colours": job.artefacts.digest(COLOURS_NAME) if options.balance_colours else None,
        "fusion": fusion_key(fusion, surface),
        "outlines": _outlines_key(job, approach.depth, frame) if options.outlines else None,
        "agreement": options.agreement,
        "filled": _filled_key(job, approach.depth, frame) if options.fill_px else None,
        "code": code_version("surface", "fusion", "geometry"),
    }
    folder = fusion_folder(str(approach), frame)

    def write(path: Path) -> list[str]:
        measured, filled = _prepared(job, approach.depth, frame, read_clouds(job.artefacts, names))

        def made_of(sensors: Sequence[Cloud]) -> Fused:
            views = None
            if needs_views(fusion):
                cameras = [view.left for view in _rectifications(job, approach.depth, frame)]
                views = [view_of_cloud(cloud, camera) for cloud, camera in zip(sensors, cameras, strict=True)]
            wholes = [_merged(*clouds) for clouds in zip(sensors, filled, strict=True)] if filled else sensors
            return fuse(fusion, wholes, surface, views=views, folder=job.artefacts.folder / folder)

        try:
            mesh, left_out = _outlined(job, approach.depth, frame, measured, made_of)
        except NoSurfaceError as error:
            raise NoSurfaceError(f"{approach}: frame {frame} has no model: {error}") from error
        except (ProgramError, PluginError) as error:
            store_program_log(job, folder)
            raise type(error)(f"{approach}: frame {frame}: {error}") from error
        assert surface.voxel_mm is not None
        write_mesh(path, _marked(mesh, measured, filled, surface.voxel_mm))
        return [f"{approach}: frame {frame}: {reason}" for reason in left_out]

    return job.artefacts.make(mesh_name(str(approach), frame), key, write)


def _prepared(job: Job, method: str, frame: int, clouds: list[Cloud]) -> tuple[list[Cloud], list[Cloud]]:
    """Return what the sensors measured, made to agree, and what fills its holes, each one cloud per sensor or none."""
    options, filled = job.options, []
    if options.agreement:
        clouds = agreed(clouds, [view.left for view in _rectifications(job, method, frame)])
    if options.fill_px:
        for stream in job.capture.sensors_for(method):
            photographs = read_photographs(job.capture, stream, frame)
            filled.append(merge_clouds(fill_holes(clouds, photographs, options.fill_px)))
    if options.balance_colours:
        colours = _colours(job, method)
        clouds, filled = balance_colours(clouds, colours), balance_colours(filled, colours) if filled else []
    return clouds, filled


def _merged(measured: Cloud, filled: Cloud) -> Cloud:
    return merge_clouds([measured, filled]) if len(filled) else measured


def _marked(mesh: Mesh, measured: Sequence[Cloud], filled: Sequence[Cloud], voxel: float) -> Mesh:
    """Mark the vertices beside which more was filled than measured."""
    holes = [cloud for cloud in filled if len(cloud)]
    if not holes:
        return mesh
    seen = merge_clouds([cloud for cloud in measured if len(cloud)])
    of_seen, of_holes = supports(mesh, [seen, merge_clouds(holes)], voxel).T
    return replace(mesh, filled=of_holes > of_seen)


def _outlined(
    job: Job, method: str, frame: int, measured: Sequence[Cloud], made_of: Callable[[Sequence[Cloud]], Fused]
) -> Fused:
    """Make a mesh of what was measured; where outlines are asked for, they follow the masks."""
    if not job.options.outlines:
        return made_of(measured)
    sights = read_sights(job.capture, job.capture.sensors_for(method), measured, frame)
    mesh, left_out = with_outlines(sights, job.step_mm, made_of)
    if not len(mesh.faces):
        raise NoSurfaceError(
            "nothing of its surface lies inside the sensors' masks; expected coordinates of the clouds, in mm, and "
            "masks that are white on the object"
        )
    return mesh, left_out


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
