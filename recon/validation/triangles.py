"""Exact distances from points to a triangle mesh, signed by the side on which a point lies.

Open3D's RaycastingScene searches in float32: on a body 1.6 m high it takes a wrong triangle for 1 % of the points near
the surface and 7 % of those far away, and is off by up to 0.0001 mm even when distances are counted again in float64.
Nor is it faster: for 2.6 million triangles and a million points near them it takes 5.5 s of processor time and the tree
6.0 s; for 100 000 points far away 16.2 s and 12.6 s.

Source
------
Ericson, "Real-Time Collision Detection" (2005), section 5.1.5, for the nearest point of a triangle; Bærentzen, Aanæs,
"Signed distance computation using the angle weighted pseudonormal" (2005), for the sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.normals import area_vectors, vector_sums
from recon.runtime.workers import in_bands
from recon.validation.sampling import order_by_cells

LEAF_FACES = 4
MOST_PENDING = 64  # boxes that wait while a tree of depth 32 is searched


@dataclass(frozen=True, eq=False)
class Nearest:
    """The nearest point of a mesh for each of N points.

    Parameters
    ----------
    points : float64 (N, 3), mm, on the mesh
    normals : float64 (N, 3), of unit length; the pseudonormal there, outwards
    distances : float64 (N,), mm, never negative
    signed : float64 (N,), mm, positive outside
    faces : int64 (N,)
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    distances: NDArray[np.float64]
    signed: NDArray[np.float64]
    faces: NDArray[np.int64]


class TriangleTree:
    """Triangles in a hierarchy of boxes, to be asked for their nearest points.

    Parameters
    ----------
    vertices : floating (N, 3), mm; coincident ones count as one
    faces : integer (M, 3), counter-clockwise seen from outside; those without an area are left out

    Raises
    ------
    ValueError
        If there is no triangle with an area.
    """

    def __init__(self, vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> None:
        places, same = np.unique(np.asarray(vertices, dtype=np.float64), axis=0, return_inverse=True)
        faces = same.reshape(-1)[np.asarray(faces, dtype=np.int64)]
        has_area = np.linalg.norm(area_vectors(places, faces), axis=1) > 0
        if not has_area.any():
            raise ValueError(f"none of the mesh's {len(faces)} triangles has an area")
        self._corners = places[faces[has_area]]
        self._normals, self._features = _pseudonormals(places, faces[has_area])
        self._original = np.flatnonzero(has_area)
        self._order, self._boxes, self._ranges = _tree(self._corners)

    def nearest(self, points: NDArray[np.floating]) -> Nearest:
        """Find the nearest point of the mesh for each of points (N, 3), mm."""
        wanted = np.asarray(points, dtype=np.float64)
        order = order_by_cells(wanted)  # neighbours follow each other: the boxes of the last search are in the cache
        back = np.argsort(order, kind="stable")
        feet, (faces, features) = np.empty(wanted.shape), np.empty((2, len(wanted)), np.int64)
        search = partial(_nearest, wanted[order], self._corners, self._order, self._boxes, self._ranges)
        in_bands(len(wanted), partial(search, feet, faces, features))
        feet, faces, features = feet[back], faces[back], features[back]
        normals = self._unit_normals(faces, features)
        apart = wanted - feet
        distances = np.linalg.norm(apart, axis=1)
        signed = np.where(np.einsum("ij,ij->i", apart, normals) < 0, -distances, distances)
        return Nearest(feet, normals, distances, signed, self._original[faces])

    def _unit_normals(self, faces: NDArray[np.int64], features: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the pseudonormals (N, 3) of features (N,); the face's own where two faces lie back to back."""
        normals = self._normals[self._features[faces, features]]
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.where(length > 1e-12, normals / np.maximum(length, 1e-12), self._normals[faces])


def _pseudonormals(
    places: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Sum the normals around every face, corner and edge, (F, 3), and number those of each face, (M, 7).

    A face's are numbered in the order of the features: itself, corners a, b, c, edges ab, bc, ca.
    """
    corners = places[faces]
    inside = area_vectors(places, faces)
    inside /= np.linalg.norm(inside, axis=1, keepdims=True)
    angles, edges = np.empty(faces.shape), np.empty(faces.shape, np.int64)
    for corner in range(3):
        a, b, c = (corners[:, (corner + step) % 3] for step in range(3))
        cosine = np.einsum("ij,ij->i", b - a, c - a)
        cosine /= np.linalg.norm(b - a, axis=1) * np.linalg.norm(c - a, axis=1)
        angles[:, corner] = np.arccos(np.clip(cosine, -1, 1))
        low, high = np.sort(faces[:, [corner, (corner + 1) % 3]], axis=1).T
        edges[:, corner] = low * len(places) + high
    numbers = np.unique(edges, return_inverse=True)[1].reshape(-1, 3)
    normals = np.concatenate([inside, _sums(faces, inside, angles), _sums(numbers, inside, np.ones_like(angles))])
    n_corners = int(faces.max()) + 1
    features = [np.arange(len(faces))[:, None], len(faces) + faces, len(faces) + n_corners + numbers]
    return normals, np.concatenate(features, axis=1)


def _sums(
    numbers: NDArray[np.int64], normals: NDArray[np.float64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Sum the faces' normals (M, 3), weighted (M, 3), over the corners or edges (M, 3) of the same number."""
    weighted = (weights[..., None] * normals[:, None]).reshape(-1, 3)
    return vector_sums(weighted, numbers.ravel(), int(numbers.max()) + 1)


@njit(cache=True, nogil=True)
def _tree(corners):  # type: ignore[no-untyped-def]  # numba
    """Order the faces (M,) into boxes float64 (B, 6), each with its two children, or -1 - first and end of a leaf."""
    n = len(corners)
    order = np.arange(n)
    middles = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3
    boxes, ranges = np.empty((2 * n, 6)), np.empty((2 * n, 2), np.int64)
    pending = np.empty((MOST_PENDING, 3), np.int64)  # box, first, end
    pending[0] = 0, 0, n
    n_pending, n_boxes = 1, 1
    while n_pending:
        n_pending -= 1
        box, first, end = pending[n_pending]
        boxes[box, :3], boxes[box, 3:] = np.inf, -np.inf
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for index in range(first, end):
            for axis in range(3):
                for corner in range(3):
                    value = corners[order[index], corner, axis]
                    boxes[box, axis] = min(boxes[box, axis], value)
                    boxes[box, 3 + axis] = max(boxes[box, 3 + axis], value)
                low[axis] = min(low[axis], middles[order[index], axis])
                high[axis] = max(high[axis], middles[order[index], axis])
        if end - first <= LEAF_FACES:
            ranges[box] = -1 - first, end
            continue
        axis = int(np.argmax(high - low))
        part = order[first:end].copy()
        part = part[np.argsort(middles[part, axis], kind="mergesort")]
        order[first:end] = part
        half = (first + end) // 2
        ranges[box] = n_boxes, n_boxes + 1
        pending[n_pending] = n_boxes, first, half
        pending[n_pending + 1] = n_boxes + 1, half, end
        n_pending += 2
        n_boxes += 2
    return order, boxes[:n_boxes].copy(), ranges[:n_boxes].copy()


@njit(cache=True, nogil=True, inline="always")
def _box_distance2(box, x, y, z):  # type: ignore[no-untyped-def]  # numba
    dx = max(box[0] - x, 0.0, x - box[3])
    dy = max(box[1] - y, 0.0, y - box[4])
    dz = max(box[2] - z, 0.0, z - box[5])
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def _nearest(points, corners, order, boxes, ranges, feet, faces, features, start, stop):  # type: ignore[no-untyped-def]  # numba
    """Find the nearest places (N, 3), faces (N,) and features (N,): 0 inside, 1 to 3 corners, 4 to 6 edges."""
    for i in range(start, stop):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        pending, at = np.empty(MOST_PENDING, np.int64), np.empty(MOST_PENDING)
        pending[0], at[0] = 0, 0.0
        n_pending, best = 1, np.inf
        while n_pending:
            n_pending -= 1
            box = pending[n_pending]
            if at[n_pending] >= best:
                continue
            first, second = ranges[box, 0], ranges[box, 1]
            if first < 0:
                for index in range(-1 - first, second):
                    face = order[index]
                    px, py, pz, feature = _on_triangle(corners[face], x, y, z)
                    d2 = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
                    if d2 < best:
                        best = d2
                        feet[i, 0], feet[i, 1], feet[i, 2] = px, py, pz
                        faces[i], features[i] = face, feature
                continue
            d_first, d_second = _box_distance2(boxes[first], x, y, z), _box_distance2(boxes[second], x, y, z)
            if d_first < d_second:  # the nearer box is looked into first: it is put on top
                first, second, d_first, d_second = second, first, d_second, d_first
            if d_first < best:
                pending[n_pending], at[n_pending] = first, d_first
                n_pending += 1
            if d_second < best:
                pending[n_pending], at[n_pending] = second, d_second
                n_pending += 1


@njit(cache=True, nogil=True, inline="always")
def _on_triangle(t, x, y, z):  # type: ignore[no-untyped-def]  # numba
    """Find the place on a triangle (3, 3) nearest to a point, and which feature it lies on."""
    abx, aby, abz = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
    acx, acy, acz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
    apx, apy, apz = x - t[0, 0], y - t[0, 1], z - t[0, 2]
    d1, d2 = abx * apx + aby * apy + abz * apz, acx * apx + acy * apy + acz * apz
    if d1 <= 0 and d2 <= 0:
        return t[0, 0], t[0, 1], t[0, 2], 1
    bpx, bpy, bpz = x - t[1, 0], y - t[1, 1], z - t[1, 2]
    d3, d4 = abx * bpx + aby * bpy + abz * bpz, acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0 and d4 <= d3:
        return t[1, 0], t[1, 1], t[1, 2], 2
    vc = d1 * d4 - d3 * d2
    if vc <= 0 and d1 >= 0 and d3 <= 0:
        v = d1 / (d1 - d3)
        return t[0, 0] + v * abx, t[0, 1] + v * aby, t[0, 2] + v * abz, 4
    cpx, cpy, cpz = x - t[2, 0], y - t[2, 1], z - t[2, 2]
    d5, d6 = abx * cpx + aby * cpy + abz * cpz, acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0 and d5 <= d6:
        return t[2, 0], t[2, 1], t[2, 2], 3
    vb = d5 * d2 - d1 * d6
    if vb <= 0 and d2 >= 0 and d6 <= 0:
        w = d2 / (d2 - d6)
        return t[0, 0] + w * acx, t[0, 1] + w * acy, t[0, 2] + w * acz, 6
    va = d3 * d6 - d5 * d4
    if va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return t[1, 0] + w * (acx - abx), t[1, 1] + w * (acy - aby), t[1, 2] + w * (acz - abz), 5
    scale = 1 / (va + vb + vc)
    v, w = vb * scale, vc * scale
    return t[0, 0] + abx * v + acx * w, t[0, 1] + aby * v + acy * w, t[0, 2] + abz * v + acz * w, 0
