"""Distances to triangles against a slow reference and against shapes whose distance is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from recon.studio.objects import ball, box
from recon.validation.triangles import TriangleTree


def slow_distances(points: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each point to the nearest triangle: to its plane where the foot lies inside, else to its edges."""
    found = np.full(len(points), np.inf)
    for a, b, c in corners:
        normal = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
        height = (points - a) @ normal
        foot = points - height[:, None] * normal
        inside = np.ones(len(points), bool)
        for p, q in ((a, b), (b, c), (c, a)):
            inside &= np.cross(q - p, foot - p) @ normal >= 0
            share = np.clip((points - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
            found = np.minimum(found, np.linalg.norm(points - (p + share[:, None] * (q - p)), axis=1))
        found = np.where(inside, np.minimum(found, np.abs(height)), found)
    return found


def test_distances_are_those_of_the_full_search() -> None:
    rng = np.random.default_rng(1)
    vertices, faces = rng.normal(0, 10, (60, 3)), rng.permutation(60).reshape(20, 3)
    points = rng.normal(0, 15, (500, 3))
    nearest = TriangleTree(vertices, faces).nearest(points)
    assert np.allclose(nearest.distances, slow_distances(points, vertices[faces]), atol=1e-9)
    assert np.allclose(np.linalg.norm(points - nearest.points, axis=1), nearest.distances)


def test_signs_are_those_of_a_box_also_at_its_edges_and_corners() -> None:
    tree = TriangleTree(*box((100.0, 200.0, 300.0), 60.0))
    points = np.random.default_rng(2).uniform(-250, 250, (5000, 3))
    outside = np.abs(points) - (50, 100, 150)
    expected = np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0)
    assert np.allclose(tree.nearest(points).signed, expected, atol=1e-9)


def test_signs_are_right_where_faces_meet_at_a_sharp_angle() -> None:
    vertices = np.array([[0, 0, 0], [10, 0, 0], [5, 1, 0.0], [5, 0.5, 40]])  # a spike
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    tip = np.random.default_rng(3).normal((5, 0.5, 41), 0.3, (200, 3))
    assert (TriangleTree(vertices, faces).nearest(tip).signed > 0).all()


def test_faces_without_an_area_are_left_out_and_faces_keep_their_numbers() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0.0]])
    nearest = TriangleTree(vertices, np.array([[0, 1, 3], [0, 1, 2]])).nearest(np.array([[0.2, 0.2, 3.0]]))
    assert (nearest.faces[0], nearest.distances[0]) == (1, 3.0)
    with pytest.raises(ValueError, match="none of the mesh's 1 triangles has an area"):
        TriangleTree(vertices, np.array([[0, 1, 3]]))


def test_normals_of_a_ball_point_outwards() -> None:
    vertices, faces = ball(50.0, 6.0)
    points = 60 * vertices / 50
    assert (np.einsum("ij,ij->i", TriangleTree(vertices, faces).nearest(points).normals, vertices / 50) > 0.99).all()
