"""Folders of small models: a cube for one condition, a tent for the other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.mesh_files import write_cloud, write_measured, write_mesh

RED, GREEN, BLUE = (200, 30, 30), (30, 160, 60), (30, 60, 200)


def surface(points: NDArray[np.float64], faces: NDArray[np.int64], colour: tuple[int, int, int]) -> Mesh:
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    return Mesh(
        points.astype(np.float32),
        faces.astype(np.int32),
        normals.astype(np.float32),
        np.tile(np.array(colour, np.uint8), (len(points), 1)),
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


def write_splats(folder: Path, dataset: str = "ball", condition: str = "id_fb") -> Path:
    """A ball of opaque splats, 7 mm each, as the original trainer writes them (Kerbl et al. 2023)."""
    numbers = np.arange(200)
    heights, turns = 1 - (2 * numbers + 1) / 200, numbers * 2.399963  # radians, of a Fibonacci sphere
    points = 50 * np.c_[np.sqrt(1 - heights**2) * np.cos(turns), heights, np.sqrt(1 - heights**2) * np.sin(turns)]
    colours = (np.array(BLUE) / 255 - 0.5) / 0.28209479177387814  # Y_00
    values = [*colours, 6.0, *np.log([7.0] * 3), 1.0, 0.0, 0.0, 0.0]
    names = (
        "x",
        "y",
        "z",
        *(f"f_dc_{n}" for n in range(3)),
        "opacity",
        *(f"scale_{n}" for n in range(3)),
        *(f"rot_{n}" for n in range(4)),
    )
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "element vertex 200",
        *(f"property float {name}" for name in names),
    ]
    rows = np.concatenate([points, np.tile(values, (200, 1))], axis=1).astype("<f4")
    path = folder / "splats" / dataset / f"{condition}.ply"
    path.parent.mkdir(parents=True)
    path.write_bytes("\n".join([*header, "end_header\n"]).encode() + rows.tobytes())
    return folder


def write_plain(folder: Path, dataset: str = "ball") -> Path:
    """Meshes whose errors nobody knows."""
    write_mesh(folder / f"meshes/{dataset}/id_fa.ply", cube())
    return folder
