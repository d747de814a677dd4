"""Folders of small models: a cube for one condition, a tent for the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.mesh_files import write_cloud, write_measured, write_mesh

RED, GREEN = (200, 30, 30), (30, 160, 60)


def surface(points: NDArray[np.float64], faces: NDArray[np.int64], colour: tuple[int, int, int]) -> Mesh:
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    return Mesh(
        points.astype(np.float32),
        faces.astype(np.int32),
        normals.astype(np.float32),
        np.tile(np.uint8(colour), (len(points), 1)),
    )


def cube(colour: tuple[int, int, int] = RED) -> Mesh:
    points = np.array([(x, y, z) for x in (-50, 50) for y in (-50, 50) for z in (-50, 50)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return surface(points, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]), colour)


def tent(colour: tuple[int, int, int] = GREEN) -> Mesh:
    points = np.array([(-50, -50, -50), (50, -50, -50), (0, -50, 50), (0, 50, 0)], float)
    return surface(points, np.array([(0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)]), colour)


def write_folder(folder: Path, dataset: str = "ball") -> Path:
    """A cube that lies 2 mm outside for `id_fa`, a tent 4 mm inside for `pm_fb`, and a cloud for each."""
    for condition, mesh, error in (("id_fa", cube(), 2.0), ("pm_fb", tent(), -4.0)):
        write_measured(folder / f"meshes/{dataset}/{condition}.ply", mesh, np.full(len(mesh.vertices), error))
        cloud = Cloud(mesh.vertices, mesh.normals, mesh.colours)
        write_cloud(folder / f"clouds/{dataset}/{condition}.ply", cloud)
    return folder


def write_plain(folder: Path, dataset: str = "ball") -> Path:
    """Meshes whose errors nobody knows."""
    write_mesh(folder / f"meshes/{dataset}/id_fa.ply", cube())
    return folder
