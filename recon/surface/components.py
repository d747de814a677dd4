"""Connected components of a mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from recon.geometry.mesh import Mesh


def drop_small_components(mesh: Mesh, share: float) -> Mesh:
    """Keep the components with at least `share` of the largest one's faces, and no vertex without a face."""
    labels = component_labels(mesh.faces, len(mesh.vertices))
    return _of_size(mesh, labels, share * np.bincount(labels[mesh.faces[:, 0]]).max())


def drop_islands(mesh: Mesh, n_faces: float) -> Mesh:
    """Keep the components with at least `n_faces` faces, at least one, and no vertex without a face."""
    return _of_size(mesh, component_labels(mesh.faces, len(mesh.vertices)), n_faces)


def _of_size(mesh: Mesh, labels: NDArray[np.int32], n_faces: float) -> Mesh:
    sizes = np.bincount(labels[mesh.faces[:, 0]], minlength=len(mesh.vertices))
    return whole_components(mesh, (sizes >= max(n_faces, 1))[labels])


def whole_components(mesh: Mesh, is_vertex: NDArray[np.bool_]) -> Mesh:
    """Keep the vertices (N,) of some components, and their faces."""
    number = np.cumsum(is_vertex, dtype=np.int32) - np.int32(1)
    faces = mesh.faces[is_vertex[mesh.faces[:, 0]]]
    texture = mesh.texture and replace(mesh.texture, uv=mesh.texture.uv[is_vertex])
    return Mesh(mesh.vertices[is_vertex], number[faces], mesh.normals[is_vertex], mesh.colours[is_vertex], texture)


def component_labels(faces: NDArray[np.int32], n_vertices: int) -> NDArray[np.int32]:
    """Number the components that faces (M, 3) connect: int32 (N,), the same for vertices of the same component."""
    first, others = np.repeat(faces[:, 0], 2), faces[:, 1:].ravel()
    graph = coo_array((np.ones(len(first), np.int8), (first, others)), shape=(n_vertices, n_vertices))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int32)
