"""Small holes of a mesh closed, for those who prefer an invented patch to a gap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh


def close_holes(mesh: Mesh, longest_rim: float) -> Mesh:
    """Close every hole whose rim is at most `longest_rim` mm long by a fan around the rim's mean.

    Raises
    ------
    ValueError
        If the length is not positive, or the mesh has a texture: it has no place for a patch.
    """
    if mesh.texture is not None:
        raise ValueError("the mesh has a texture, which has no colours for patches; only meshes without can be closed")
    if not longest_rim > 0:
        raise ValueError(f"longest_rim is {longest_rim} mm, expected a length above 0")
    vertices = mesh.vertices.astype(np.float64)
    patches = [rim for rim in rims(mesh.faces) if _length(vertices[rim]) <= longest_rim]
    if not patches:
        return mesh
    centres = np.arange(len(patches)) + len(mesh.vertices)
    fans = [
        np.column_stack([rim, np.roll(rim, -1), np.full(len(rim), centre)])
        for rim, centre in zip(patches, centres, strict=True)
    ]
    normals = np.stack([_mean_direction(mesh.normals[rim]) for rim in patches])
    colours = np.stack([np.rint(mesh.colours[rim].mean(axis=0)) for rim in patches])
    return Mesh(
        np.concatenate([mesh.vertices, np.stack([vertices[rim].mean(axis=0) for rim in patches])]),
        np.concatenate([mesh.faces, *fans]),
        np.concatenate([mesh.normals, normals]),
        np.concatenate([mesh.colours, colours.astype(np.uint8)]),
    )


def rims(faces: NDArray[np.int32]) -> list[NDArray[np.int64]]:
    """Follow the rim of each hole of faces (M, 3): its vertices (R,), in the direction of the triangles to fill it."""
    following: dict[int, list[int]] = {}
    for start, end in rim_edges(faces)[:, ::-1].tolist():
        following.setdefault(start, []).append(end)
    loops = []
    for first in sorted(following):
        while following[first]:
            loop = [first]
            while (vertex := following[loop[-1]].pop()) != first:
                loop.append(vertex)
            loops.append(np.array(loop))
    return loops


def rim_edges(faces: NDArray[np.int32]) -> NDArray[np.int64]:
    """List the edges (E, 2) that belong to a single one of faces (M, 3), in its direction."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    keys, opposite = np.sort(edges[:, 0] << 32 | edges[:, 1]), edges[:, 1] << 32 | edges[:, 0]
    place = np.searchsorted(keys[:-1], opposite)  # the last of the keys stands for all that are larger
    return np.asarray(edges[keys[place] != opposite])  # `np.isin` hashes such keys, which takes ten times as long


def _length(corners: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).sum())


def _mean_direction(normals: NDArray[np.float32]) -> NDArray[np.float64]:
    total: NDArray[np.float64] = normals.sum(axis=0, dtype=np.float64)
    length = float(np.linalg.norm(total))
    return np.asarray(total / length if length > 0 else normals[0])
