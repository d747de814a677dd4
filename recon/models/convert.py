"""Models of any format written anew: meshes, clouds, and splats, each as what it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from recon.geometry.mesh import Discs, Mesh, Model
from recon.geometry.mesh_files import write_cloud, write_mesh
from recon.models.read import GLTF_SUFFIXES, Placement, ReadModel, read_model
from recon.models.shape import GLTF_MM
from recon.models.splats.ply import write_splat_ply

ANY_RADIUS_MM = 1.0  # of points, which are written as points


def read_as_it_stands(path: Path) -> ReadModel:
    """Read a model in its own axes and unit, glTF in mm; a ValueError as of `read_model`."""
    scale = GLTF_MM if path.suffix.lower() in GLTF_SUFFIXES else 1.0
    matrix = np.diag([scale, scale, scale, 1.0])
    return read_model(path, Placement("mm", tuple(map(tuple, matrix.tolist())), ANY_RADIUS_MM))


def write_model(path: Path, model: Model) -> Path:
    """Write a mesh as PLY, GLB or OBJ, a cloud as PLY, and splats as the PLY of their trainer.

    A ValueError says that the format cannot hold the model.
    """
    if isinstance(model, Mesh):
        return write_mesh(path, model)
    if isinstance(model, Discs):
        if path.suffix.lower() != ".ply":
            raise ValueError(f"{path}: the model is points without faces, which are written as .ply")
        return write_cloud(path, model.cloud)
    return write_splat_ply(path, model)


def size_of(model: Model) -> tuple[int, int]:
    """Return the numbers of vertices, points or splats, and of faces."""
    if isinstance(model, Mesh):
        return len(model.vertices), len(model.faces)
    return (len(model.cloud) if isinstance(model, Discs) else len(model.centres)), 0
