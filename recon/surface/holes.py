"""Small holes of a mesh closed, for those who prefer an invented patch to a gap."""

from __future__ import annotations

import numpy as np
from numba import njit
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
    edges = rim_edges(faces)
    numbers, places = np.unique(edges, return_inverse=True)  # of the vertices on rims
    loops, starts = _follow(places.reshape(-1, 2), len(numbers))
    return np.split(numbers[loops], starts) if len(edges) else []


def rim_edges(faces: NDArray[np.int32]) -> NDArray[np.int64]:
    """List the edges (E, 2) that belong to a single one of faces (M, 3), in its direction."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    if not len(edges):
        return edges.astype(np.int64)
    return np.asarray(edges[_has_no_opposite(edges, int(edges.max()) + 1)], np.int64)


@njit(cache=True)
def _has_no_opposite(edges, n_vertices):  # type: ignore[no-untyped-def]  # numba
    """Mark the directed edges (E, 2) whose opposite is not among them: each is looked up at the vertex it ends at."""
    ends, starts = _by_start(edges, n_vertices)
    alone = np.ones(len(edges), np.bool_)
    for edge in range(len(edges)):
        start, end = edges[edge, 0], edges[edge, 1]
        for place in range(starts[end], starts[end + 1]):
            if edges[ends[place], 1] == start:
                alone[edge] = False
                break
    return alone


@njit(cache=True)
def _by_start(edges, n_vertices):  # type: ignore[no-untyped-def]  # numba
    """Sort the numbers of edges (E, 2) by the vertex they start at, and count those before each vertex."""
    starts = np.zeros(n_vertices + 1, np.int64)
    for edge in range(len(edges)):
        starts[edges[edge, 0] + 1] += 1
    for vertex in range(n_vertices):
        starts[vertex + 1] += starts[vertex]
    following, order = starts[:-1].copy(), np.empty(len(edges), np.int64)
    for edge in range(len(edges)):
        order[following[edges[edge, 0]]] = edge
        following[edges[edge, 0]] += 1
    return order, starts


@njit(cache=True)
def neighbours_of(edges, n_vertices):  # type: ignore[no-untyped-def]  # numba
    """List the ends of the directed edges (E, 2) from each vertex, once each and in order.

    Returns
    -------
    starts, ends : int64 (n_vertices + 1,) and (F,), those of vertex v are `ends[starts[v] : starts[v + 1]]`
    """
    order, before = _by_start(edges, n_vertices)
    starts, ends, count = np.zeros(n_vertices + 1, np.int64), np.empty(len(edges), np.int64), 0
    for vertex in range(n_vertices):
        first = count
        for place in range(before[vertex], before[vertex + 1]):
            end = edges[order[place], 1]
            at = count
            while at > first and ends[at - 1] > end:
                at -= 1
            if at > first and ends[at - 1] == end:
                continue
            for later in range(count, at, -1):
                ends[later] = ends[later - 1]
            ends[at] = end
            count += 1
        starts[vertex + 1] = count
    return starts, ends[:count].copy()


@njit(cache=True)
def _follow(edges, n_vertices):  # type: ignore[no-untyped-def]  # numba
    """Follow directed edges (E, 2) backwards into loops: their vertices (E,), and where each but the first begins."""
    turned = edges[:, ::-1].copy()
    order, starts = _by_start(turned, n_vertices)
    left = starts[1:].copy()  # beyond the last edge of each vertex that was not followed yet
    loops, begins = np.empty(len(edges), np.int64), [0 for _ in range(0)]  # numbers, though there are none yet
    count = 0
    for first in range(n_vertices):
        while left[first] > starts[first]:
            begins.append(count)
            vertex = first
            while left[vertex] > starts[vertex]:
                loops[count] = vertex
                count += 1
                left[vertex] -= 1
                vertex = turned[order[left[vertex]], 1]
                if vertex == first:
                    break
            else:  # no loop: three faces share an edge
                count = begins.pop()
    return loops[:count], np.array(begins[1:], np.int64)


def _length(corners: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).sum())


def _mean_direction(normals: NDArray[np.float32]) -> NDArray[np.float64]:
    total: NDArray[np.float64] = normals.sum(axis=0, dtype=np.float64)
    length = float(np.linalg.norm(total))
    return np.asarray(total / length if length > 0 else normals[0])
