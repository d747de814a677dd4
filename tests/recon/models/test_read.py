"""What models of all formats share: where they stand, their digest, their normals and textures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.geometry.normals import surface_normals
from recon.geometry.rig import Y_FROM
from recon.models.read import Placement, read_model
from tests.recon.models.model_files import (
    BLUE,
    GREEN,
    IN_METRES,
    IN_MM,
    mesh_from,
    picture,
    texels,
    text_file,
    textured_obj,
)


def test_a_digest_follows_every_file_of_a_model(tmp_path: Path) -> None:
    path = textured_obj(tmp_path)
    before = read_model(path, IN_MM).digest
    assert read_model(path, IN_MM).digest == before
    picture(tmp_path / "b.png", BLUE, size=16)
    assert read_model(path, IN_MM).digest != before


@pytest.mark.parametrize("up", Y_FROM)
def test_the_up_axis_of_a_model_becomes_the_worlds_y(up: str) -> None:
    turn = Y_FROM[up]
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1 if up.startswith("-") else 1
    assert np.array_equal(turn @ axis, [0, 1, 0])
    assert np.linalg.det(turn) == pytest.approx(1)


def test_normals_are_the_same_on_both_sides_of_a_textures_seam() -> None:
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(40, 3))
    faces = rng.integers(0, 40, (80, 3))
    whole = surface_normals(vertices, faces)
    corners = faces.ravel()
    parted = surface_normals(vertices[corners], np.arange(len(corners)).reshape(-1, 3))
    assert np.allclose(parted, whole[corners], atol=1e-5)


def test_alpha_is_left_out_of_a_texture(tmp_path: Path) -> None:
    path = textured_obj(tmp_path)
    cv2.imwrite(str(tmp_path / "b.png"), np.full((4, 4, 4), (*GREEN[::-1], 0), np.uint8))
    assert texels(mesh_from(path))[1].tolist() == list(GREEN)


def test_a_model_that_single_precision_would_blur_where_it_stands_is_refused_unless_it_is_moved(tmp_path: Path) -> None:
    east, north = 500_000, 4_500_000  # m, as surveyors' coordinates are
    corners = "".join(f"v {east + x} {north + y} {z}\n" for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1.8, 0), (0, 0, 0.5)))
    path = text_file(tmp_path, "a.obj", corners + "f 1 2 3\nf 1 3 4\n")
    with pytest.raises(ValueError, match=r"a\.obj: .*4.5e\+09 .*world_from_model"):
        read_model(path, IN_METRES)
    near = np.diag([1000.0, 1000, 1000, 1])
    near[:3, 3] = (-1000 * east, -1000 * north, 0)
    mesh = mesh_from(path, Placement("m", tuple(map(tuple, near.tolist()))))
    assert mesh.vertices.tolist() == [[0, 0, 0], [1000, 0, 0], [0, 1800, 0], [0, 0, 500]]
