"""PLY models of other programs are read as the format says, and what is wrong with them is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from recon.geometry.mesh import Discs, Mesh
from recon.models.read import NEUTRAL, Placement, read_model
from tests.recon.models.model_files import BLUE, CORNERS, EYE, GREEN, IN_MM, RED, mesh_from, picture, texels, text_file

PLY = """ply
format ascii 1.0
{comments}element vertex 4
property float x
property float y
property float z
{properties}element face {n_faces}
property list uchar int vertex_indices
{face_properties}end_header
{rows}"""


def ply(
    rows: list[str], faces: list[str], *, properties: str = "", face_properties: str = "", comments: str = ""
) -> str:
    return PLY.format(
        comments=comments,
        properties=properties,
        n_faces=len(faces),
        face_properties=face_properties,
        rows="\n".join([*rows, *faces, ""]),
    )


@pytest.mark.parametrize("binary", [False, True])
def test_a_ply_of_bytes_is_read_as_it_is_and_normals_are_computed(tmp_path: Path, binary: bool) -> None:
    made = trimesh.Trimesh(np.eye(3) * 10, [[0, 1, 2]], vertex_colors=[RED, GREEN, BLUE], process=False)
    (tmp_path / "a.ply").write_bytes(
        trimesh.exchange.ply.export_ply(made, encoding="binary" if binary else "ascii", vertex_normal=False)
    )
    mesh = mesh_from(tmp_path / "a.ply")
    assert np.array_equal(mesh.vertices, np.eye(3) * 10)
    assert np.array_equal(mesh.colours, [RED, GREEN, BLUE])
    assert np.allclose(mesh.normals, np.full((3, 3), 1 / np.sqrt(3)))


def test_colours_as_floats_or_by_their_old_names_are_the_same(tmp_path: Path) -> None:
    by_float = "property float red\nproperty float green\nproperty float blue\n"
    rows = [f"{corner} 0.2 0.4 1" for corner in CORNERS]
    text = ply(rows, ["3 0 1 2"], properties=by_float)
    assert np.unique(mesh_from(text_file(tmp_path, "a.ply", text)).colours, axis=0).tolist() == [[51, 102, 255]]
    old = "".join(f"property uchar diffuse_{name}\n" for name in ("red", "green", "blue"))
    text = ply([f"{corner} 51 102 255" for corner in CORNERS], ["3 0 1 2"], properties=old)
    assert np.unique(mesh_from(text_file(tmp_path, "b.ply", text)).colours, axis=0).tolist() == [[51, 102, 255]]


def test_polygons_are_cut_into_triangles(tmp_path: Path) -> None:
    mesh = mesh_from(text_file(tmp_path, "a.ply", ply(CORNERS, ["4 0 1 2 3"])))
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    made = mesh_from(text_file(tmp_path, "b.ply", ply(CORNERS, ["4 0 1 2 3", "3 0 1 2"])))
    assert made.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]


def test_a_model_without_colours_is_neutral_grey_and_says_so(tmp_path: Path) -> None:
    read = read_model(text_file(tmp_path, "a.ply", ply(CORNERS, ["3 0 1 2"])), IN_MM)
    assert isinstance(read.model, Mesh)
    assert (read.model.colours == NEUTRAL).all()
    assert len(read.model.vertices) == 3, "a vertex that no face names is left out"
    assert read.warnings == ("has no colours and is shown in neutral grey",)


def test_points_become_discs_of_the_stated_size(tmp_path: Path) -> None:
    path = text_file(tmp_path, "a.ply", ply(CORNERS, []))
    model = read_model(path, IN_MM).model
    assert isinstance(model, Discs)
    assert (len(model.cloud), model.radius_mm) == (4, 2.0)
    with pytest.raises(ValueError, match=r'a\.ply: has points and no faces; state .* "splat_mm": 3, or add'):
        read_model(path, Placement("mm", EYE))


def test_a_ply_with_a_texture_at_its_faces_corners_is_textured(tmp_path: Path) -> None:
    picture(tmp_path / "skin 1.png", RED)
    places = "property list uchar float texcoord\n"
    text = ply(
        CORNERS,
        ["3 0 1 2 6 0 0 1 0 1 1", "3 0 2 3 6 0 0 1 1 0 1"],
        face_properties=places,
        comments="comment TextureFile skin 1.png\n",
    )
    mesh = mesh_from(text_file(tmp_path, "a.ply", text))
    assert (texels(mesh) == RED).all()
    assert mesh.texture is not None
    assert mesh.texture.uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]
    assert np.allclose(mesh.normals, [0, 0, 1])
    (tmp_path / "skin 1.png").unlink()
    with pytest.raises(ValueError, match=r"a\.ply: its texture skin 1\.png is missing, expected at .*skin 1\.png"):
        read_model(tmp_path / "a.ply", IN_MM)


WRONG_PLY = {
    "nan": (
        ply(["0 0 nan", *CORNERS[1:]], ["3 0 1 2"]),
        r"vertex 0 is \[0.0, 0.0, nan\], expected finite numbers",
    ),
    "range": (ply(CORNERS, ["3 0 1 2", "3 1 2 4"]), r"face 1 names vertices \[1, 2, 4\], but there are 4 \(0 to 3\)"),
    "two corners": (ply(CORNERS, ["2 0 1"]), "face 0 has 2 corners, expected at least 3"),
    "cut": (ply(CORNERS, ["3 0 1 2", "3 0 2 3"])[:-8], "is not a whole PLY file"),
    "empty": (ply(CORNERS, []).replace("element vertex 4", "element vertex 0"), "is not a whole PLY|holds no points"),
    "splat": (
        ply([f"{corner} 0" for corner in CORNERS], [], properties="property float f_dc_0\n"),
        "its splats have no property scale_0",
    ),
    "compressed splat": (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty uint packed_position\nproperty uint packed_color\n"
        "end_header\n7 8\n",
        "it has bounds of 0 chunks, expected 1 for 1 splats",
    ),
    "no ply": ("hello", "is not a whole PLY file"),
}


@pytest.mark.parametrize("fault", WRONG_PLY)
def test_a_wrong_ply_is_named_with_its_fault(tmp_path: Path, fault: str) -> None:
    text, sentence = WRONG_PLY[fault]
    with pytest.raises(ValueError, match=rf"a\.ply: {sentence}|a\.ply: ({sentence})"):
        read_model(text_file(tmp_path, "a.ply", text), IN_MM)


def test_a_ply_with_colours_of_its_faces_has_them(tmp_path: Path) -> None:
    colours = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    text = ply(CORNERS, ["4 0 1 2 3 200 10 10", "3 0 1 2 10 10 200"], face_properties=colours)
    mesh = mesh_from(text_file(tmp_path, "a.ply", text))
    assert mesh.colours[mesh.faces[:, 0]].tolist() == [list(RED), list(RED), list(BLUE)]
    assert mesh.vertices[mesh.faces[1]].tolist() == [[0, 0, 0], [10, 10, 0], [0, 10, 0]]
    lists = colours.replace("uchar", "list uchar uchar")
    text = ply(CORNERS, ["3 0 1 2 1 200 1 10 1 10", "3 0 1 2 1 10 2 1 1 1 9"], face_properties=lists)
    with pytest.raises(ValueError, match="its faces have lists where numbers are expected"):
        read_model(text_file(tmp_path, "b.ply", text), IN_MM)


def test_points_without_finite_coordinates_are_left_out_and_counted(tmp_path: Path) -> None:
    path = text_file(tmp_path, "a.ply", ply([CORNERS[0], "nan nan nan", CORNERS[1], "0 inf 0"], []))
    read = read_model(path, IN_MM)
    assert isinstance(read.model, Discs)
    assert len(read.model.cloud.points) == 2
    assert "has 2 of 4 points without finite coordinates, left out" in read.warnings
    with pytest.raises(ValueError, match="none of its 4 points has finite coordinates"):
        read_model(text_file(tmp_path, "b.ply", ply(["nan 0 0"] * 4, [])), IN_MM)


def test_strips_of_a_ply_are_triangles_of_one_side(tmp_path: Path) -> None:
    text = ply(["0 0 0", "1 0 0", "0 1 0", "1 1 0"], ["11 0 1 2 3 3 -1 2 1 3 -1 -1", "4 0 1 2 3", "0"])
    mesh = mesh_from(text_file(tmp_path, "a.ply", text.replace("element face", "element tristrips")))
    a, b, c = mesh.vertices[mesh.faces].astype(float).transpose(1, 0, 2)
    np.testing.assert_array_equal(np.cross(b - a, c - a), [[0, 0, 1]] * 5)


def test_points_without_finite_coordinates_that_no_face_names_are_left_out_and_counted(tmp_path: Path) -> None:
    path = text_file(tmp_path, "a.ply", ply(["nan nan nan", *CORNERS[1:]], ["3 1 2 3"]))
    assert mesh_from(path).vertices[mesh_from(path).faces[0]].tolist() == [[10, 0, 0], [10, 10, 0], [0, 10, 0]]
    assert "has 1 points without finite coordinates that no face names, left out" in read_model(path, IN_MM).warnings
