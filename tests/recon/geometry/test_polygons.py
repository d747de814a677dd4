"""Polygons of any outline are cut into triangles that cover them once, seen from the same side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.geometry.mesh_files import read_surface
from recon.geometry.polygons import cut_polygons
from recon.models.read import read_model
from tests.recon.models.model_files import IN_MM

L_SHAPE = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
# The outline, a way to the window, around it, and back.
WALL_WITH_WINDOW = [(0, 0), (4, 0), (4, 3), (0, 3), (0, 0), (1, 1), (1, 2), (3, 2), (3, 1), (1, 1)]


def flat(outline: list[tuple[float, float]]) -> NDArray[np.float64]:
    return np.column_stack([np.array(outline, float), np.zeros(len(outline))])


def areas(points: NDArray[np.float64], triangles: NDArray[np.integer]) -> NDArray[np.float64]:
    """Half the cross product of each triangle's edges, (M, 3): along its normal."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    return np.asarray(np.cross(b - a, c - a) / 2)


def cut_one(points: NDArray[np.float64]) -> NDArray[np.int64]:
    return cut_polygons(points, np.arange(len(points)), np.array([len(points)]))[0]


@pytest.mark.parametrize(("outline", "area"), [(L_SHAPE, 3.0), (WALL_WITH_WINDOW, 10.0)])
@pytest.mark.parametrize("turned", [1, -1])
def test_a_concave_polygon_is_covered_once_from_whichever_corner_it_begins(
    outline: list[tuple[float, float]], area: float, turned: int
) -> None:
    for first in range(len(outline)):
        points = flat((outline[first:] + outline[:first])[::turned])
        covered = areas(points, cut_one(points))[:, 2]
        assert covered.sum() == pytest.approx(turned * area)
        assert np.abs(covered).sum() == pytest.approx(area)


@given(st.lists(st.floats(0.2, 3), min_size=3, max_size=12), st.integers(0, 2**31), st.booleans())
def test_any_outline_around_a_point_in_any_plane_is_covered_once(
    radii: list[float], seed: int, is_reversed: bool
) -> None:
    angles = np.arange(len(radii)) * 2 * np.pi / len(radii)
    outline = np.column_stack([radii * np.cos(angles), radii * np.sin(angles), np.ones(len(radii))])
    turn = Rotation.random(random_state=seed)
    points = turn.apply(outline[::-1] if is_reversed else outline)
    wanted = 0.5 * np.sum(np.array(radii) * np.roll(radii, -1)) * np.sin(2 * np.pi / len(radii))
    along = areas(points, cut_one(points)) @ turn.apply([0, 0, -1 if is_reversed else 1])
    assert along.sum() == pytest.approx(wanted)
    assert np.abs(along).sum() == pytest.approx(wanted)


def test_convex_polygons_are_cut_around_their_first_corner_and_say_whose_triangles_they_are() -> None:
    points = flat([(0, 0), (1, 0), (1, 1), (0, 1), *L_SHAPE])
    corners = np.array([0, 1, 2, 3, 0, 1, 2, *range(5, 10), 4])
    places, polygons = cut_polygons(points, corners, np.array([4, 3, 6]))
    assert places[:3].tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6]]
    assert polygons.tolist() == [0, 0, 1, 2, 2, 2, 2]
    assert np.abs(areas(points, corners[places])[3:]).sum() == pytest.approx(3)


@pytest.mark.parametrize("name", ["l.obj", "l.ply"])
def test_every_reader_cuts_a_concave_face_of_a_file_alike(tmp_path: Path, name: str) -> None:
    outline = L_SHAPE[2:] + L_SHAPE[:2]
    rows = [f"{x} {y} 0\n" for x, y in outline]
    if name.endswith("obj"):
        text = "".join(f"v {row}" for row in rows) + "f 1 2 3 4 5 6\n"
    else:
        header = "".join(f"property float {axis}\n" for axis in "xyz") + "element face 1\n"
        text = f"ply\nformat ascii 1.0\nelement vertex 6\n{header}property list uchar int vertex_indices\nend_header\n"
        text += "".join(rows) + "6 0 1 2 3 4 5\n"
    (tmp_path / name).write_text(text)
    mesh = read_model(tmp_path / name, IN_MM).model
    assert areas(mesh.vertices.astype(float), mesh.faces).sum(axis=0) == pytest.approx([0, 0, 3])  # type: ignore[union-attr]
    assert np.abs(areas(mesh.vertices.astype(float), mesh.faces)).sum() == pytest.approx(3)  # type: ignore[union-attr]
    if name.endswith("ply"):
        points, faces = read_surface(tmp_path / name)
        assert np.abs(areas(points.astype(float), faces)).sum() == pytest.approx(3)
