"""Connected components of a mesh."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh


def drop_small_components(mesh: Mesh, share: float) -> Mesh:
    """Keep the components with at least `share` of the largest one's faces, and no vertex without a face."""
    labels = component_labels(mesh.faces, len(mesh.vertices))
    sizes = np.bincount(labels[mesh.faces[:, 0]], minlength=len(mesh.vertices))
    kept = sizes >= max(share * sizes.max(), 1)
    is_vertex = kept[labels]
    number = np.cumsum(is_vertex) - 1
    faces = mesh.faces[is_vertex[mesh.faces[:, 0]]]
    return Mesh(mesh.vertices[is_vertex], number[faces], mesh.normals[is_vertex], mesh.colours[is_vertex])


@njit(cache=True)
def component_labels(faces: NDArray[np.int32], n_vertices: int) -> NDArray[np.int32]:
    """int32 (N,): the lowest vertex that each vertex is connected to by faces."""
    parent = np.arange(n_vertices).astype(np.int32)
    for face in range(len(faces)):
        a = faces[face, 0]
        while parent[a] != a:
            parent[a] = parent[parent[a]]
            a = parent[a]
        for place in range(1, 3):
            b = faces[face, place]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            if b < a:
                a, b = b, a
            parent[b] = a
    for vertex in range(n_vertices):  # a parent's number is lower, so that it already holds its root
        parent[vertex] = parent[parent[vertex]]
    return parent
