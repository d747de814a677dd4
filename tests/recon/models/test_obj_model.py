"""OBJ models of other programs are read as the format says, and what is wrong with them is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recon.models.part import NEUTRAL
from recon.models.read import read_contents, read_model
from tests.recon.models.model_files import (
    BLUE,
    CORNERS,
    GREEN,
    IN_MM,
    PLACES,
    RED,
    SQUARE,
    mesh_from,
    picture,
    texels,
    text_file,
    textured_obj,
)


def test_vertex_colours_of_an_obj_are_kept_and_quads_are_cut(tmp_path: Path) -> None:
    lines = [f"v {corner} {share} 0 1" for corner, share in zip(CORNERS, (0, 0.2, 0.4, 1), strict=True)]
    mesh = mesh_from(text_file(tmp_path, "a.obj", "\n".join([*lines, "f 1 2 3 4", ""])))
    assert mesh.colours.tolist() == [[0, 0, 255], [51, 0, 255], [102, 0, 255], [255, 0, 255]]
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_negative_indices_count_back_from_where_they_stand(tmp_path: Path) -> None:
    second = SQUARE.replace("v 0 0 0", "v 0 0 5").replace("v 10 10 0", "v 10 10 5")
    forwards = text_file(tmp_path, "a.obj", SQUARE + "f 1 2 3\n" + second + "f 5 6 7 8\n")
    back = text_file(tmp_path, "b.obj", SQUARE + "f -4 -3 -2\n" + second + "f -4 -3 -2 -1\n")
    a, b = mesh_from(forwards), mesh_from(back)
    assert np.array_equal(a.vertices[a.faces], b.vertices[b.faces])
    assert len(a.faces) == 3


def test_several_materials_become_one_texture(tmp_path: Path) -> None:
    mesh = mesh_from(textured_obj(tmp_path))
    assert texels(mesh).tolist() == [list(RED), list(GREEN), [10, 10, 204], [10, 10, 204]]
    assert mesh.texture is not None
    assert mesh.texture.uv.min() > 0
    assert mesh.texture.uv.max() < 1
    assert np.array_equal(np.linalg.norm(mesh.normals, axis=1) > 0.99, np.ones(len(mesh.vertices), bool))


def test_materials_that_share_a_picture_share_the_texture(tmp_path: Path) -> None:
    picture(tmp_path / "skin.png", RED, size=16)
    text_file(tmp_path, "a.mtl", "newmtl head\nmap_Kd skin.png\nnewmtl hand\nmap_Kd ./skin.png\n")
    faces = "usemtl head\nf 1/1 2/2 3/3\nusemtl hand\nf 1/1 3/3 4/4\n"
    mesh = mesh_from(text_file(tmp_path, "a.obj", "mtllib a.mtl\n" + SQUARE + PLACES + faces))
    assert mesh.texture is not None
    assert mesh.texture.pixels.shape == (16, 16, 3)


def test_a_texture_that_no_face_uses_may_be_missing(tmp_path: Path) -> None:
    text_file(tmp_path, "a.mtl", "newmtl plain\nKd 1 0 0\nnewmtl unused\nmap_Kd gone.png\n")
    lines = ["mtllib a.mtl", *(f"v {corner}" for corner in CORNERS), "usemtl plain", "f 1 2 3 4", ""]
    assert mesh_from(text_file(tmp_path, "a.obj", "\n".join(lines))).colours.tolist() == [[255, 0, 0]] * 4


def test_the_only_texture_is_taken_as_it_is_and_repeats(tmp_path: Path) -> None:
    path = textured_obj(tmp_path)
    path.write_text(path.read_text().split("usemtl b")[0])
    mesh = mesh_from(path)
    assert mesh.texture is not None
    assert mesh.texture.pixels.shape == (8, 8, 3)
    assert mesh.texture.uv.max() == 2


@pytest.mark.parametrize(
    ("missing", "sentence"),
    [
        ("my materials.mtl", r"its material file my materials\.mtl is missing, expected at .*my materials\.mtl"),
        ("skin of a.png", r"its texture skin of a\.png is missing, expected at .*skin of a\.png"),
    ],
)
def test_a_file_that_an_obj_needs_is_named_where_it_is_missing(tmp_path: Path, missing: str, sentence: str) -> None:
    path = textured_obj(tmp_path)
    (tmp_path / missing).unlink()
    with pytest.raises(ValueError, match=rf"a\.obj: {sentence}"):
        read_model(path, IN_MM)


WRONG_OBJ = {
    "range": (SQUARE + "f 1 2 5\n", r"the face corner '5' is out of range: the file has 4 vertices"),
    "zero": (SQUARE + "f 0 1 2\n", r"the face corner '0' is out of range"),
    "line": (SQUARE + "f 1 2\n", "a face has 2 corners, expected at least 3"),
    "word": (SQUARE + "f 1 2 x\n", "its faces are not readable"),
    "number": (SQUARE + "v 1 x 2\nf 1 2 3\n", "its v number 5 is '1 x 2', expected 3 numbers"),
    "nan": (SQUARE + "v 1 nan 2\nf 1 2 5\n", "its v number 5 is '1 nan 2', expected finite numbers"),
    "places": (
        "mtllib a.mtl\n" + SQUARE + "usemtl skin\nf 1 2 3\n",
        "faces of its textured material 'skin' have no texture coordinates",
    ),
    "empty": ("# nothing\n", "holds neither faces nor points"),
}


@pytest.mark.parametrize("fault", WRONG_OBJ)
def test_a_wrong_obj_is_named_with_its_fault(tmp_path: Path, fault: str) -> None:
    picture(tmp_path / "a.png", RED)
    text_file(tmp_path, "a.mtl", "newmtl skin\nmap_Kd a.png\n")
    text, sentence = WRONG_OBJ[fault]
    with pytest.raises(ValueError, match=rf"a\.obj: {sentence}"):
        read_model(text_file(tmp_path, "a.obj", text), IN_MM)


def test_a_cut_off_texture_is_named(tmp_path: Path) -> None:
    path = textured_obj(tmp_path)
    whole = (tmp_path / "b.png").read_bytes()
    (tmp_path / "b.png").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"a\.obj: its texture b\.png is cut off after \d+ bytes"):
        read_model(path, IN_MM)


def test_textures_beside_vertex_colours_are_refused(tmp_path: Path) -> None:
    path = textured_obj(tmp_path)
    coloured = "\n".join(f"v {corner} {share} 0 0" for corner, share in zip(CORNERS, (0, 0.5, 1, 0), strict=True))
    path.write_text(path.read_text().replace(SQUARE, coloured + "\n"))
    with pytest.raises(ValueError, match="parts with textures and parts with vertex colours; bake both"):
        read_model(path, IN_MM)


def test_notes_at_the_ends_of_an_obj_files_lines_are_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "noted.obj"
    path.write_text("v 0 0 0 # a corner\nv 1 0 0#next\nv 0 1 0\n\nf 1 2 3 # 4 5\n")
    (part,) = read_contents(path).parts
    assert part.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert part.faces.tolist() == [[0, 1, 2]]


def test_a_note_in_an_obj_file_that_ends_in_a_backslash_does_not_hide_the_next_line(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("# out of C:\\models\\\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n3\n")
    (part,) = read_contents(tmp_path / "a.obj").parts
    assert part.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert part.faces.tolist() == [[0, 1, 2]]


def test_an_obj_file_may_part_its_words_by_tabs(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v\t0 0 0\nv\t1 0 0\nv \t0 1 0\nf\t1 2\t3\n")
    (part,) = read_contents(tmp_path / "a.obj").parts
    assert part.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert part.faces.tolist() == [[0, 1, 2]]


def test_an_obj_file_and_its_materials_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    text_file(tmp_path, "a.mtl", "\ufeffnewmtl red\nKd 1 0 0\n")
    mesh = mesh_from(text_file(tmp_path, "a.obj", f"\ufeffmtllib a.mtl\n{SQUARE}usemtl red\nf 1 2 3 4\n"))
    assert mesh.colours.tolist() == [[255, 0, 0]] * 4
    assert mesh_from(text_file(tmp_path, "b.obj", f"\ufeff{SQUARE}f 1 2 3 4\n")).vertices[0].tolist() == [0, 0, 0]


def test_materials_may_part_their_words_by_tabs(tmp_path: Path) -> None:
    picture(tmp_path / "skin.png", BLUE)
    text_file(tmp_path, "a.mtl", "newmtl\tred\nKd\t1 0 0\nnewmtl blue\n\tmap_Kd\tskin.png\n")
    head = f"mtllib a.mtl\n{SQUARE}{PLACES}"
    assert mesh_from(text_file(tmp_path, "a.obj", f"{head}usemtl red\nf 1 2 3\n")).colours[0].tolist() == [255, 0, 0]
    assert texels(mesh_from(text_file(tmp_path, "b.obj", f"{head}usemtl blue\nf 1/1 2/2 3/3\n"))).tolist() == [
        list(BLUE)
    ]


@pytest.mark.parametrize(("line", "is_warned_of"), [("d 0.5", True), ("Tr 0.5", True), ("Tr 0", False), ("d 1", False)])
def test_transparency_is_pointed_out_by_either_name(tmp_path: Path, line: str, is_warned_of: bool) -> None:
    text_file(tmp_path, "a.mtl", f"newmtl red\nKd 1 0 0\n{line}\n")
    path = text_file(tmp_path, "a.obj", f"mtllib a.mtl\n{SQUARE}usemtl red\nf 1 2 3\n")
    warnings = read_model(path, IN_MM).warnings
    assert any("transparent" in warning for warning in warnings) == is_warned_of


def test_what_a_material_file_does_not_define_is_grey_with_a_warning(tmp_path: Path) -> None:
    text_file(tmp_path, "a.mtl", "newmtl red\nKd 1 0 0\n")
    path = text_file(tmp_path, "a.obj", f"mtllib a.mtl\n{SQUARE}usemtl gold\nf 1 2 3\n")
    assert any(
        "uses the material 'gold', which a.mtl does not define" in told for told in read_model(path, IN_MM).warnings
    )
    assert (mesh_from(path).colours == NEUTRAL).all()


def test_one_line_names_several_material_files(tmp_path: Path) -> None:
    text_file(tmp_path, "a.mtl", "newmtl red\nKd 1 0 0\n")
    text_file(tmp_path, "b.mtl", "newmtl blue\nKd 0 0 1\n")
    path = text_file(tmp_path, "a.obj", f"mtllib a.mtl b.mtl\n{SQUARE}usemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n")
    assert {tuple(colour) for colour in mesh_from(path).colours.tolist()} == {(255, 0, 0), (0, 0, 255)}


def test_options_of_a_texture_that_are_words_are_no_part_of_its_name(tmp_path: Path) -> None:
    picture(tmp_path / "skin.png", BLUE)
    options = (
        "-colorspace sRGB -clamp on -imfchan l -o 0 0 0 -s 1.000 1 1"  # the last two as programs write that move none
    )
    text_file(tmp_path, "a.mtl", f'newmtl blue\nmap_Kd {options} "skin.png"\n')
    path = text_file(tmp_path, "a.obj", f"mtllib a.mtl\n{SQUARE}{PLACES}usemtl blue\nf 1/1 2/2 3/3\n")
    assert texels(mesh_from(path)).tolist() == [list(BLUE)]


def test_vertices_without_a_colour_among_coloured_ones_are_grey_and_counted(tmp_path: Path) -> None:
    path = text_file(tmp_path, "a.obj", "v 0 0 0 1 0 0\nv 1 0 0\nv 1 1 0 1 0 0\nf 1 2 3\n")
    assert mesh_from(path).colours.tolist() == [[255, 0, 0], [NEUTRAL] * 3, [255, 0, 0]]
    assert "has no colour at 1 of 3 vertices, which are shown grey" in read_model(path, IN_MM).warnings


@pytest.mark.parametrize("name", [r"C:\work\Skin.PNG", "/home/somebody/skin.png", "../../skin.png", "SKIN.png"])
def test_a_texture_beside_the_model_is_taken_for_one_of_another_computer_or_case(tmp_path: Path, name: str) -> None:
    picture(tmp_path / "skin.png", BLUE)
    text_file(tmp_path, "a.mtl", f"newmtl blue\nmap_Kd {name}\n")
    path = text_file(tmp_path, "a.obj", f"mtllib a.mtl\n{SQUARE}{PLACES}usemtl blue\nf 1/1 2/2 3/3\n")
    assert texels(mesh_from(path)).tolist() == [list(BLUE)]
    (told,) = read_model(path, IN_MM).warnings
    assert told.endswith("and skin.png is taken for it")


def test_points_of_an_obj_without_finite_coordinates_are_left_out_and_counted(tmp_path: Path) -> None:
    contents = read_contents(text_file(tmp_path, "a.obj", "v 0 0 0\nv nan 1 2\nv 1 1 1\n"))
    assert contents.parts[0].vertices.tolist() == [[0, 0, 0], [1, 1, 1]]
    assert contents.warnings == ["has 1 of 3 points without finite coordinates, left out"]


def test_a_texture_is_scaled_and_moved_as_its_material_says(tmp_path: Path) -> None:
    picture(tmp_path / "skin.png", BLUE)
    text_file(tmp_path, "a.mtl", "newmtl blue\nmap_Kd -s 2 3 1 -o 0.25 -0.5 skin.png\n")
    path = text_file(tmp_path, "a.obj", f"mtllib a.mtl\n{SQUARE}{PLACES}usemtl blue\nf 1/1 2/2 3/3\n")
    uv = read_contents(path).parts[0].uv
    assert uv is not None
    places = np.array([line.split()[1:3] for line in PLACES.splitlines()[:3]], float)
    np.testing.assert_allclose(uv, places * (2, 3) + (0.25, -0.5))


@pytest.mark.parametrize("numbers", ["1 1 0 0", "1 1 0 0 1"])
def test_colours_may_stand_behind_a_weight(tmp_path: Path, numbers: str) -> None:
    path = text_file(tmp_path, "a.obj", "".join(f"v {corner} {numbers}\n" for corner in CORNERS) + "f 1 2 3\n")
    assert mesh_from(path).colours.tolist() == [[255, 0, 0]] * 3
