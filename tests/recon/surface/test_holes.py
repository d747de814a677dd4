"""Holes that are small enough are closed, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest

from recon.geometry.mesh import Mesh
from recon.surface.holes import close_holes, neighbours_of, rims


def sheet(n: int = 12) -> Mesh:
    """A square of n x n quads of 1 mm, looking up."""
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0), indexing="ij")
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    faces = np.concatenate(
        [
            np.column_stack([corner, corner + n + 1, corner + n + 2]),
            np.column_stack([corner, corner + n + 2, corner + 1]),
        ]
    )
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    up = np.tile([0.0, 0, 1], (len(vertices), 1))
    return Mesh(vertices, faces, up, np.full((len(vertices), 3), 77, np.uint8))


def without(mesh: Mesh, low: float, high: float) -> Mesh:
    """The sheet without the faces wholly inside a square."""
    corners = mesh.vertices[mesh.faces][..., :2]
    inside = ((corners >= low) & (corners <= high)).all(axis=(1, 2))
    return Mesh(mesh.vertices, mesh.faces[~inside], mesh.normals, mesh.colours)


def test_a_hole_is_closed_and_the_outer_rim_is_not() -> None:
    holed = without(sheet(), 4, 7)
    assert sorted(len(rim) for rim in rims(holed.faces)) == [12, 48]
    closed = close_holes(holed, 12.1)
    assert [len(rim) for rim in rims(closed.faces)] == [48]
    corners = closed.vertices[closed.faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    assert area.min() > 0, "the patch looks where the surface looks"
    assert area.sum() == pytest.approx(144)
    assert np.array_equal(closed.normals[-1], [0, 0, 1])
    assert np.array_equal(closed.colours[-1], [77, 77, 77])


def test_a_hole_with_a_longer_rim_stays_open() -> None:
    holed = without(sheet(), 4, 7)
    assert close_holes(holed, 11.9) is holed


def test_two_holes_that_touch_in_a_point_are_both_closed() -> None:
    holed = without(without(sheet(), 2, 4), 4, 6)
    closed = close_holes(holed, 17.0)
    assert [len(rim) for rim in rims(closed.faces)] == [48]


def test_a_closed_body_has_no_rim() -> None:
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], dtype=np.int32)
    assert rims(tetrahedron) == []


def test_a_length_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="longest_rim is 0"):
        close_holes(sheet(), 0.0)


def test_an_edge_that_three_faces_share_is_no_rim_to_follow() -> None:
    fan = np.array([[0, 1, 2], [1, 0, 3], [1, 0, 4]], dtype=np.int32)
    assert all(len(rim) >= 3 for rim in rims(fan))


def test_neighbours_are_listed_once_and_in_order() -> None:
    edges = np.random.default_rng(1).integers(0, 30, (400, 2)).astype(np.int32)
    starts, ends = neighbours_of(edges, 30)
    for vertex in range(30):
        expected = np.unique(edges[edges[:, 0] == vertex, 1])
        assert np.array_equal(ends[starts[vertex] : starts[vertex + 1]], expected)
