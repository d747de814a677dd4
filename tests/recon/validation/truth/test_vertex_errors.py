"""Signed distances of a mesh's vertices from the truth, and its colours by them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from skimage.measure import marching_cubes

from recon.geometry.mesh import Mesh, Shape, error_colours, error_limit
from recon.geometry.mesh_files import read_mesh, write_mesh
from recon.validation.truth.evaluation import signed_distances_to
from tests.command_line import Command


@pytest.fixture(scope="module")
def ball() -> Mesh:
    """A ball of 50 mm."""
    axis = np.arange(-55.0, 56.0, 2.0)
    distance = np.sqrt(sum(np.square(part) for part in np.meshgrid(axis, axis, axis, indexing="ij"))) - 50
    vertices, faces, *_ = marching_cubes(distance, 0.0)
    vertices = vertices * 2.0 - 55
    normals = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    return Mesh(vertices, faces.astype(np.int32), normals, np.full((len(vertices), 3), 90, np.uint8))


def shape_of(mesh: Mesh) -> Shape:
    return Shape(mesh.vertices.astype(np.float64), mesh.faces)


@pytest.mark.parametrize("by", [-3.0, -0.1, 0.0, 0.2, 4.0])
def test_errors_are_the_distance_positive_outside(ball: Mesh, by: float) -> None:
    moved = replace(ball, vertices=ball.vertices + np.float32(by) * ball.normals)
    assert np.abs(signed_distances_to(shape_of(ball), moved.vertices) - by).max() < 0.02


def test_beyond_the_truths_edge_the_error_is_the_whole_distance(ball: Mesh) -> None:
    kept = ball.faces[(ball.vertices[ball.faces][:, :, 2] > 0).all(axis=1)]
    errors = signed_distances_to(shape_of(replace(ball, faces=kept)), ball.vertices)
    pole = np.argmin(ball.vertices[:, 2])
    assert abs(errors[pole]) == pytest.approx(50 * 2**0.5, rel=0.05)


def test_red_is_outside_and_blue_is_inside() -> None:
    outside, inside = (error_colours(np.full(9, by), error_limit(np.full(9, by))) for by in (5.0, -5.0))
    assert (outside[:, 0] > outside[:, 2]).all()
    assert (inside[:, 2] > inside[:, 0]).all()
    rounding = np.full(9, 1e-12)
    assert error_limit(rounding) > 0
    assert (error_colours(rounding, error_limit(rounding)) == 255).all()


@pytest.mark.slow
def test_a_mesh_is_exported_coloured_by_error(command: Command, ball: Mesh, tmp_path: Path) -> None:
    truth = write_mesh(tmp_path / "truth.ply", ball)
    measured = write_mesh(tmp_path / "mesh.ply", replace(ball, vertices=ball.vertices * np.float32(1.02)))
    told = command("export", measured, tmp_path / "errors.ply", "--truth", truth, "--limit", 2, "--json")
    assert told.code == 0, told.err
    assert json.loads(told.out)["mean_mm"] == pytest.approx(1.0, abs=0.01)
    colours = read_mesh(tmp_path / "errors.ply").colours
    assert np.ptp(colours, axis=0).max() < 3
    assert colours[0, 0] > colours[0, 2]
    assert command("export", measured, tmp_path / "errors.glb", "--limit", 2).code == 2


@pytest.mark.slow
def test_a_truth_needs_faces_but_neither_normals_nor_colours(command: Command, ball: Mesh, tmp_path: Path) -> None:
    measured = write_mesh(tmp_path / "mesh.ply", replace(ball, vertices=ball.vertices * np.float32(1.02)))
    rows = "".join(f"v {x} {y} {z}\n" for x, y, z in ball.vertices.tolist())
    corners = "".join(f"f {a} {b} {c}\n" for a, b, c in (ball.faces + 1).tolist())
    for content, code, sentence in ((rows + corners, 0, '"mean_mm": 0.999'), (rows, 1, "truth.obj: holds no faces")):
        (tmp_path / "truth.obj").write_text(content)
        told = command("export", measured, tmp_path / "errors.ply", "--truth", tmp_path / "truth.obj", "--json")
        assert told.code == code, told.err
        assert sentence in told.out + told.err
