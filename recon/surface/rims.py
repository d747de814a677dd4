"""The rims of a surface: cut where a field on it falls below 0, and smoothed along themselves.

Source
------
The smoothing without shrinking is from Taubin, A signal processing approach to fair surface design, 1995.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh
from recon.surface.holes import neighbours_of, rim_edges

SMOOTHING_ROUNDS = 10
SMOOTHING_STEPS = (0.5, -0.52)  # there and back
RINGS = 2  # of vertices beside a rim, which follow it


def cut(mesh: Mesh, field: NDArray[np.floating]) -> Mesh:
    """Cut a mesh without texture where a field on its vertices, (N,), falls below 0: on the zeros along its edges."""
    is_inside = field >= 0
    n_inside = is_inside[mesh.faces].sum(axis=1)
    single = _turned(mesh.faces[n_inside == 1], is_inside)  # the vertex inside comes first
    pair = _turned(mesh.faces[n_inside == 2], ~is_inside)  # the vertex outside comes first
    crossed = np.concatenate(
        [single[:, [0, 1]], single[:, [0, 2]], pair[:, [1, 0]], pair[:, [2, 0]]]
    )  # inside, outside
    keys, places = np.unique(crossed[:, 0].astype(np.int64) << 32 | crossed[:, 1], return_inverse=True)
    edges = np.column_stack([keys >> 32, keys & 0xFFFFFFFF])
    share = (field[edges[:, 0]] / (field[edges[:, 0]] - field[edges[:, 1]]))[:, None]

    def extended(values: NDArray[np.float32] | NDArray[np.uint8]) -> NDArray[np.float32]:
        a, b = values[edges[:, 0]].astype(np.float64), values[edges[:, 1]].astype(np.float64)
        return np.concatenate([values, a + share * (b - a)]).astype(np.float32)

    normals = extended(mesh.normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    ends = np.cumsum([len(single), len(single), len(pair)])
    first, second, third, fourth = np.split(places.ravel() + len(mesh.vertices), ends)
    faces = [
        mesh.faces[n_inside == 3],
        np.column_stack([single[:, 0], first, second]),
        np.column_stack([third, pair[:, 1:]]),
        np.column_stack([third, pair[:, 2], fourth]),
    ]
    colours = np.rint(extended(mesh.colours)).astype(np.uint8)
    return Mesh(extended(mesh.vertices), np.concatenate(faces), normals, colours)


def smooth_rims(
    mesh: Mesh,
    rounds: int = SMOOTHING_ROUNDS,
    may_lie: Callable[[NDArray[np.float64]], NDArray[np.bool_]] | None = None,
) -> Mesh:
    """Smooth the open rims of a mesh along themselves, within the surface; the vertices beside them follow.

    Parameters
    ----------
    mesh : without texture
    rounds : how often; more take longer waves
    may_lie : tells for places (N, 3), mm, whether a vertex may be there, asked every tenth round; else it stays
    """
    rims = rim_edges(mesh.faces)
    is_rim = np.zeros(len(mesh.vertices), dtype=bool)
    is_rim[rims] = True
    moves = is_rim.copy()
    for _ in range(RINGS):
        moves = with_ring(mesh.faces, moves)
    starts, neighbours = neighbours_of(_links(mesh.faces, rims, is_rim, moves), len(mesh.vertices))
    rows = np.flatnonzero(np.diff(starts))
    vertices = mesh.vertices.astype(np.float64)
    for done in range(0, rounds, SMOOTHING_ROUNDS):
        before = vertices[rows]
        steps = np.array(SMOOTHING_STEPS * min(SMOOTHING_ROUNDS, rounds - done))
        _smooth(vertices, mesh.normals, rows, starts, neighbours, steps)
        if may_lie is not None:
            vertices[rows] = np.where(may_lie(vertices[rows])[:, None], vertices[rows], before)
    return replace(mesh, vertices=vertices.astype(np.float32))


@njit(cache=True)
def with_ring(faces, moves):  # type: ignore[no-untyped-def]  # numba
    """Mark the vertices of all faces (M, 3) that have a marked one, bool (N,)."""
    after = moves.copy()
    for f in range(len(faces)):
        if moves[faces[f, 0]] or moves[faces[f, 1]] or moves[faces[f, 2]]:
            after[faces[f, 0]] = after[faces[f, 1]] = after[faces[f, 2]] = True
    return after


@njit(cache=True)
def _links(faces, rims, is_rim, moves):  # type: ignore[no-untyped-def]  # numba
    """List whom each vertex that moves follows, int32 (E, 2): one of a rim those beside it there, others all around."""
    count = 2 * len(rims)
    for f in range(len(faces)):
        for corner in range(3):
            vertex = faces[f, corner]
            count += 2 if moves[vertex] and not is_rim[vertex] else 0
    links = np.empty((count, 2), np.int32)
    for edge in range(len(rims)):
        links[2 * edge, 0] = links[2 * edge + 1, 1] = rims[edge, 0]
        links[2 * edge, 1] = links[2 * edge + 1, 0] = rims[edge, 1]
    count = 2 * len(rims)
    for f in range(len(faces)):
        for corner in range(3):
            vertex = faces[f, corner]
            if moves[vertex] and not is_rim[vertex]:
                links[count, 0] = links[count + 1, 0] = vertex
                links[count, 1], links[count + 1, 1] = faces[f, corner - 1], faces[f, corner - 2]
                count += 2
    return links


@njit(cache=True)
def _smooth(vertices, normals, rows, starts, neighbours, steps):  # type: ignore[no-untyped-def]  # numba
    """Move vertices, float64 (N, 3), of some rows by steps towards the mean of their neighbours, within the surface."""
    moved, move = np.empty((len(rows), 3)), np.empty(3)
    for step in steps:
        for r in range(len(rows)):
            row = rows[r]
            first, last = starts[row], starts[row + 1]
            along = 0.0
            for axis in range(3):
                total = 0.0
                for place in range(first, last):
                    total += vertices[neighbours[place], axis]
                move[axis] = total / (last - first) - vertices[row, axis]
                along += move[axis] * normals[row, axis]
            for axis in range(3):
                moved[r, axis] = vertices[row, axis] + step * (move[axis] - along * normals[row, axis])
        for r in range(len(rows)):
            for axis in range(3):
                vertices[rows[r], axis] = moved[r, axis]


def _turned(faces: NDArray[np.int32], is_first: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Turn faces (M, 3) such that the only vertex that `is_first` (N,) says comes first."""
    start = is_first[faces].argmax(axis=1)[:, None]
    return np.take_along_axis(faces, (start + np.arange(3)) % 3, axis=1)
