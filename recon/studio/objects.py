"""Closed meshes of balls and boxes around the origin, and where validation objects may stand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LONGEST_ARC = 1.33  # of the unit icosahedron's pieces: its middle triangles grow when they are pushed outwards

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]


def ball(radius: float, edge: float) -> Mesh:
    """Make a sphere from a subdivided icosahedron with edges of at most `edge` mm."""
    vertices, faces = _icosahedron()
    while radius * LONGEST_ARC > edge:
        vertices, faces = _subdivided(vertices, faces)
        edge *= 2
    return radius * vertices, faces


def box(size: tuple[float, float, float], edge: float) -> Mesh:
    """Make a box with sharp edges: each side has its own vertices, at most `edge` mm apart."""
    half = np.asarray(size) / 2
    vertices: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1.0, 1.0):
            n_u, n_v = int(np.ceil(size[u] / edge)) + 1, int(np.ceil(size[v] / edge)) + 1
            grid_u, grid_v = np.meshgrid(np.linspace(-half[u], half[u], n_u), np.linspace(-half[v], half[v], n_v))
            side = np.empty((n_u * n_v, 3))
            side[:, axis], side[:, u], side[:, v] = sign * half[axis], grid_u.ravel(), grid_v.ravel()
            quads = (np.arange(n_v - 1)[:, None] * n_u + np.arange(n_u - 1)).ravel()
            corners = np.stack([quads, quads + 1, quads + n_u + 1, quads, quads + n_u + 1, quads + n_u], axis=1)
            triangles = corners.reshape(-1, 3) if sign > 0 else corners.reshape(-1, 3)[:, ::-1]
            faces.append(triangles + sum(len(earlier) for earlier in vertices))
            vertices.append(side)
    return np.concatenate(vertices), np.concatenate(faces).astype(np.int32)


def _icosahedron() -> Mesh:
    g = (1 + np.sqrt(5)) / 2
    corners = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g)]
    corners += [(0, -1, -g), (0, 1, -g), (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    vertices = np.array(corners)
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2)]
    faces += [(10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5)]
    faces += [(2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), np.array(faces, dtype=np.int32)


def _subdivided(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> Mesh:
    """Split every triangle of a unit sphere in four."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, inverse = np.unique(edges, axis=0, return_inverse=True)
    middles = vertices[unique].sum(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    ab, bc, ca = (inverse.reshape(3, -1) + len(vertices)).astype(np.int32)
    a, b, c = faces.T
    parts = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    return np.concatenate([vertices, middles]), np.concatenate([np.stack(part, axis=1) for part in parts])
