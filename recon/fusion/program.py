"""Somebody else's program as a fusion: it gets the sensors' clouds as PLY files, and writes a mesh into another one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
from scipy.spatial import cKDTree

from recon.cloud import merge_clouds
from recon.fusion.views import check_clouds, check_place, with_unit_normals
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.mesh_files import read_ply_shape, write_cloud
from recon.geometry.normals import surface_normals
from recon.runtime.programs import Program, ProgramError, Value, check_written, workplace


@dataclass(frozen=True)
class FusionProgram(Program):
    """How to call a program that fuses; its limit of time is for one mesh."""

    PLACEHOLDERS: ClassVar[tuple[str, ...]] = ("out", "voxel_mm")
    LISTS: ClassVar[tuple[str, ...]] = ("clouds",)
    OUTPUTS: ClassVar[tuple[str, ...]] = ("ply",)


def fuse_by_program(clouds: Sequence[Cloud], program: FusionProgram, voxel_mm: float, folder: Path) -> Mesh:
    """Fuse clouds by a program.

    The clouds that hold points become ``cloud-1.ply``, ``cloud-2.ply`` ... A mesh without normals gets those of its
    faces; one without colours gets at each vertex that of the nearest point.

    Parameters
    ----------
    clouds : one per sensor
    program : what to call
    voxel_mm : what {voxel_mm} stands for
    folder : where it runs; all that is in it is removed before, and if the program succeeds all but the log afterwards

    Raises
    ------
    ProgramError
        If the program fails in any way; it names the log, and the folder is left as it is, to try by hand.
    """
    check_clouds(clouds)
    seen = [cloud for cloud in clouds if len(cloud)]
    files = [folder / f"cloud-{number}.ply" for number in range(1, len(seen) + 1)]
    out = folder / "out.ply"
    values: dict[str, Value] = {"clouds": [str(file) for file in files], "out": str(out), "voxel_mm": voxel_mm}
    with workplace(folder):
        for file, cloud in zip(files, seen, strict=True):
            write_cloud(file, cloud)
        said = program.run(values, folder)
        check_written(out, said)
        try:
            return _read_mesh(out, merge_clouds(seen))
        except ValueError as error:
            raise ProgramError(f"the program's mesh cannot be used: {error}") from error


def _read_mesh(path: Path, cloud: Cloud) -> Mesh:
    shape = read_ply_shape(path)
    if not len(shape.faces):
        raise ValueError(f"{path}: holds no faces")
    points = shape.points.astype(np.float32)
    normals, colours = shape.normals, shape.colours
    if normals is None:
        normals = surface_normals(points, shape.faces)
    if colours is None:
        colours = cloud.colours[cKDTree(cloud.points).query(points)[1]]
    mesh = with_unit_normals(Mesh(points, shape.faces, normals.astype(np.float32), colours))
    check_place(mesh, [cloud])
    return mesh
