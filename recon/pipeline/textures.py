"""The stages that put the sensors' photographs on surfaces, as `recon.pipeline.stages` makes these."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from recon.geometry.mesh_files import read_mesh, write_mesh
from recon.methods.approaches import VERTICES, Approach
from recon.pipeline.job import Job
from recon.pipeline.keys import files_key
from recon.pipeline.run import EXPOSURES_NAME, View
from recon.runtime.artefacts import code_version
from recon.runtime.files import read_json, write_json
from recon.surface.exposures import Exposure, compare_exposures, exposed
from recon.surface.photographs import Photograph, read_photographs
from recon.surface.steadying import steady_rims
from recon.surface.texturing import textured

TOLERANCE_STEPS = 3  # a step is a third of the depth of a pixel of disparity


def compare_photographs(job: Job) -> list[str]:
    """Estimate once for a run what makes all cameras agree, from the first frame's surface by the last approach."""
    approach, frame = job.surfaces[-1][0], job.frames[0]
    mesh_file = job.mesh_name(approach, frame)
    key = {
        "mesh": job.artefacts.digest(mesh_file),
        "pictures": _all_pictures_key(job, frame),
        "tolerance_mm": _tolerance(job),
        "code": code_version("surface/photographs.py", "surface/exposures.py", "capture/rectify.py"),
    }

    def write(path: Path) -> None:
        mesh = read_mesh(job.artefacts.path(mesh_file))
        exposures = compare_exposures(mesh, _photographs(job, frame), _tolerance(job))
        matrices = [None if each.matrix is None else each.matrix.tolist() for each in exposures]
        write_json(path, {"gain": [each.gain.tolist() for each in exposures], "matrix": matrices})

    return job.artefacts.make(EXPOSURES_NAME, key, write)


def make_textures(job: Job, approaches: Sequence[Approach], frame: int) -> list[str]:
    """Texture the surfaces of a frame by the photographs of all sensors, which are read once.

    Parameters
    ----------
    job : whose surfaces are finished, and whose photographs are compared
    approaches, frame : which surfaces
    """

    @cache
    def photographs() -> list[Photograph]:
        content = read_json(job.artefacts.path(EXPOSURES_NAME))
        matrices = [None if matrix is None else np.array(matrix) for matrix in content["matrix"]]
        exposures = map(Exposure, np.array(content["gain"]), matrices)
        return [exposed(*each) for each in zip(_photographs(job, frame), exposures, strict=True)]

    return [name for approach in approaches for name in _make_textured(job, approach, frame, photographs)]


def _make_textured(job: Job, approach: Approach, frame: int, photographs: Callable[[], list[Photograph]]) -> list[str]:
    uncoloured = replace(approach, colour=VERTICES)
    surface = job.mesh_name(uncoloured, frame)
    beside = [job.mesh_name(uncoloured, other) for other in job.frames_beside(approach.depth, frame)]
    key = {
        "mesh": job.artefacts.digest(surface),
        "beside": [job.artefacts.digest(each) for each in beside],
        "exposures": job.artefacts.digest(EXPOSURES_NAME),
        "pictures": _all_pictures_key(job, frame),
        "tolerance_mm": _tolerance(job),
        "code": code_version("surface", "models/atlas.py", "geometry", "capture/rectify.py"),
    }

    def write(path: Path) -> None:
        mesh, *others = (read_mesh(job.artefacts.path(each)) for each in (surface, *beside))
        voxel = job.surface(approach.depth).voxel_mm
        assert voxel is not None
        write_mesh(path, textured(steady_rims(mesh, others, voxel), photographs(), _tolerance(job)))

    return job.make_mesh(approach, frame, key, write)


def _photographs(job: Job, frame: int) -> list[Photograph]:
    """Read what all cameras saw, those of sensors without depth maps included."""
    return [photograph for stream in job.capture.sensors for photograph in read_photographs(job.capture, stream, frame)]


def _tolerance(job: Job) -> float:
    """Return how far surfaces may lie behind each other and count as one, mm: about a pixel of disparity."""
    return TOLERANCE_STEPS * job.step_mm


def _all_pictures_key(job: Job, frame: int) -> list[dict[str, Any]]:
    return [
        files_key(job.capture, View("", stream.id, frame), stream.cameras, stream.mask or ())
        for stream in job.capture.sensors
    ]
