"""Models of other programs are read as their formats say, and what is wrong with them is named."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh, Splats
from recon.geometry.mesh_files import write_mesh
from recon.geometry.normals import surface_normals
from recon.geometry.srgb import srgb_bytes
from recon.models.part import decode_picture
from recon.models.read import NEUTRAL, Placement, read_contents, read_model
from recon.rig import Y_FROM
from tests.recon.geometry.test_mesh import mesh_of

EYE = tuple(map(tuple, np.eye(4).tolist()))
IN_MM = Placement("mm", EYE, splat_mm=2.0)
IN_METRES = Placement("m", tuple(map(tuple, np.diag([1000.0, 1000, 1000, 1]).tolist())))
RED, GREEN, BLUE = (200, 10, 10), (10, 200, 10), (10, 10, 200)
SQUARE = "v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\n"
PLACES = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
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


CORNERS = ["0 0 0", "10 0 0", "10 10 0", "0 10 0"]


def text_file(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def picture(path: Path, colour: tuple[int, int, int], size: int = 8) -> None:
    assert cv2.imwrite(str(path), np.full((size, size, 3), colour[::-1], np.uint8))


def mesh_from(path: Path, placement: Placement = IN_MM) -> Mesh:
    model = read_model(path, placement).model
    assert isinstance(model, Mesh)
    return model


def texels(mesh: Mesh) -> NDArray[np.uint8]:
    """The colour of the texture in the middle of each face, (M, 3)."""
    assert mesh.texture is not None
    height, width = mesh.texture.pixels.shape[:2]
    uv = mesh.texture.uv[mesh.faces].mean(axis=1) % 1
    return mesh.texture.pixels[((1 - uv[:, 1]) * height).astype(int), (uv[:, 0] * width).astype(int)]


# PLY


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


def test_points_become_splats_of_the_stated_size(tmp_path: Path) -> None:
    path = text_file(tmp_path, "a.ply", ply(CORNERS, []))
    model = read_model(path, IN_MM).model
    assert isinstance(model, Splats)
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
        "it holds Gaussians, .* stimuli import",
    ),
    "compressed splat": (
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty uint packed_position\nproperty uint packed_color\n"
        "end_header\n7 8\n",
        "it holds Gaussians, .* stimuli import",
    ),
    "no ply": ("hello", "is not a whole PLY file"),
}


@pytest.mark.parametrize("fault", WRONG_PLY)
def test_a_wrong_ply_is_named_with_its_fault(tmp_path: Path, fault: str) -> None:
    text, sentence = WRONG_PLY[fault]
    with pytest.raises(ValueError, match=rf"a\.ply: {sentence}|a\.ply: ({sentence})"):
        read_model(text_file(tmp_path, "a.ply", text), IN_MM)


# OBJ


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


def textured_obj(folder: Path) -> Path:
    """Two textured squares and one of a plain colour, the first wrapped twice around its texture."""
    picture(folder / "skin of a.png", RED)
    picture(folder / "b.png", GREEN, size=16)
    text_file(
        folder,
        "my materials.mtl",
        "newmtl a\nKd 0 0 0\nmap_Kd -clamp off skin of a.png\nnewmtl b\nmap_Kd b.png\nnewmtl c\nKd 0.04 0.04 0.8\n",
    )
    faces = "usemtl a\nf 1/5 2/6 3/7\nusemtl b\nf 1/1/ 3/3/ 4/4/\nusemtl c\nf 4 3 2 1\n"
    wrapped = "vt 0 0\nvt 2 0\nvt 2 2\n"
    return text_file(folder, "a.obj", "mtllib my materials.mtl\n" + SQUARE + PLACES + wrapped + faces)


def test_several_materials_become_one_texture(tmp_path: Path) -> None:
    mesh = mesh_from(textured_obj(tmp_path))
    assert texels(mesh).tolist() == [list(RED), list(GREEN), [10, 10, 204], [10, 10, 204]]
    assert mesh.texture is not None
    assert mesh.texture.uv.min() > 0
    assert mesh.texture.uv.max() < 1
    assert np.array_equal(np.linalg.norm(mesh.normals, axis=1) > 0.99, np.ones(len(mesh.vertices), bool))


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


def test_a_digest_follows_every_file_of_a_model(tmp_path: Path) -> None:
    path = textured_obj(tmp_path)
    before = read_model(path, IN_MM).digest
    assert read_model(path, IN_MM).digest == before
    picture(tmp_path / "b.png", BLUE, size=16)
    assert read_model(path, IN_MM).digest != before


WRONG_OBJ = {
    "range": (SQUARE + "f 1 2 5\n", r"the face corner '5' is out of range: the file has 4 vertices"),
    "zero": (SQUARE + "f 0 1 2\n", r"the face corner '0' is out of range"),
    "line": (SQUARE + "f 1 2\n", "a face has 2 corners, expected at least 3"),
    "word": (SQUARE + "f 1 2 x\n", "its faces are not readable"),
    "number": (SQUARE + "v 1 x 2\nf 1 2 3\n", "its v number 5 is '1 x 2', expected 3 numbers"),
    "nan": (SQUARE + "v 1 nan 2\nf 1 2 5\n", "its v number 5 is '1 nan 2', expected finite numbers"),
    "material": (
        "mtllib a.mtl\n" + SQUARE + "usemtl gold\nf 1 2 3\n",
        "it uses the material 'gold', which a",
    ),
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


# glTF


def test_our_own_glb_comes_back_with_every_colour(tmp_path: Path) -> None:
    mesh = mesh_of(300, 500)
    back = mesh_from(write_mesh(tmp_path / "a.glb", mesh), IN_METRES)
    named = np.unique(mesh.faces)
    assert np.allclose(back.vertices, mesh.vertices[named], atol=1e-4)
    assert np.array_equal(back.colours, mesh.colours[named])
    assert np.allclose(back.normals, mesh.normals[named], atol=1e-5)
    assert np.array_equal(named[back.faces], mesh.faces)


def gltf(arrays: list[tuple[NDArray[Any], str]], document: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    """Complete a document by buffers and accessors of arrays."""
    kinds = {"<f4": 5126, "<u2": 5123, "|u1": 5121, "<u4": 5125}
    views, accessors, binary = [], [], b""
    for array, kind in arrays:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": array.nbytes})
        accessors.append(
            {
                "bufferView": len(accessors),
                "componentType": kinds[array.dtype.str],
                "count": len(array),
                "type": kind,
                "normalized": array.dtype.kind == "u" and kind != "SCALAR",
            }
        )
        binary += array.tobytes() + b"\0" * (-array.nbytes % 4)
    whole = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "bufferViews": views,
        "accessors": accessors,
        "buffers": [{"byteLength": len(binary)}],
    }
    return whole | document, binary


def glb(path: Path, document: dict[str, Any], binary: bytes) -> Path:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    path.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)
    return path


TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.dtype("<f4"))
UV = np.array([[0, 0], [1, 0], [0, 1]], np.dtype("<f4"))


def two_nodes() -> tuple[dict[str, Any], bytes]:
    """A triangle in two places, as linear bytes and by a factor, the second below a turned and scaled parent."""
    linear = np.array([[0, 0, 0], [55, 55, 55], [255, 255, 255]], np.uint8)
    padded = np.pad(linear, ((0, 0), (0, 1)), constant_values=255)
    turn = [0, 0, float(np.sin(np.pi / 4)), float(np.cos(np.pi / 4))]  # by 90 degrees about z
    return gltf(
        [(TRIANGLE, "VEC3"), (padded, "VEC4"), (np.array([0, 1, 2], np.dtype("<u2")), "SCALAR")],
        {
            "scenes": [{"nodes": [0, 1]}],
            "nodes": [
                {"mesh": 0, "translation": [0, 0, 5]},
                {"children": [2], "rotation": turn, "scale": [2, 2, 2]},
                {"mesh": 1, "translation": [1, 0, 0]},
            ],
            "meshes": [
                {"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2}]},
                {"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]},
            ],
            "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0, 1, 1]}}],
        },
    )


def test_every_mesh_of_a_gltf_stands_where_its_nodes_put_it(tmp_path: Path) -> None:
    path = glb(tmp_path / "a.glb", *two_nodes())
    mesh = mesh_from(path)
    expected = trimesh.load_scene(path, process=False).to_geometry()
    ours = np.sort(mesh.vertices[mesh.faces].reshape(-1, 9), axis=0)
    assert np.allclose(ours, np.sort(expected.vertices[expected.faces].reshape(-1, 9), axis=0), atol=1e-6)
    assert np.allclose(mesh.vertices[3:], [[0, 2, 0], [0, 4, 0], [-2, 2, 0]], atol=1e-6)


def rigged(path: Path, node: dict[str, Any]) -> Path:
    """A triangle whose last corner hangs on a joint that its node turned and moved, below a node that is elsewhere."""
    turn = [0, 0, float(np.sin(np.pi / 4)), float(np.cos(np.pi / 4))]  # by 90 degrees about z
    joints = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0]], np.uint8)
    weights = np.array([[1, 0, 0, 0]] * 3, np.dtype("<f4"))
    inverse = np.stack([np.eye(4), np.eye(4)])
    inverse[1, :3, 3] = (0, -1, 0)  # the joint was at (0, 1, 0) when the corner was bound to it
    by_columns = inverse.transpose(0, 2, 1).reshape(2, 16).astype("<f4")
    raised = np.array([[0, 0, 1], [0, 0, 0], [0, 0, 0]], np.dtype("<f4"))
    document, binary = gltf(
        [(TRIANGLE, "VEC3"), (joints, "VEC4"), (weights, "VEC4"), (by_columns, "MAT4"), (raised, "VEC3")],
        {
            "scenes": [{"nodes": [0, 1]}],
            "nodes": [
                {"mesh": 0, "translation": [0, 0, 50]} | node,
                {"children": [2]},
                {"translation": [3, 1, 0], "rotation": turn},
            ],
            "skins": [{"joints": [1, 2], "inverseBindMatrices": 3}],
            "meshes": [
                {
                    "primitives": [
                        {"attributes": {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}, "targets": [{"POSITION": 4}]}
                    ]
                }
            ],
        },
    )
    document["accessors"][1]["normalized"] = False
    return glb(path, document, binary)


def test_a_rigged_gltf_stands_as_its_joints_do_wherever_its_own_node_is(tmp_path: Path) -> None:
    mesh = mesh_from(rigged(tmp_path / "a.glb", {"skin": 0}))
    assert np.allclose(mesh.vertices, [[0, 0, 0], [1, 0, 0], [3, 1, 0]], atol=1e-6)


def test_a_gltf_has_the_shape_that_its_morph_weights_give_it(tmp_path: Path) -> None:
    mesh = mesh_from(rigged(tmp_path / "a.glb", {"weights": [0.5]}))
    assert np.allclose(mesh.vertices, [[0, 0, 50.5], [1, 0, 50], [0, 1, 50]], atol=1e-6)


def test_colours_of_gltf_are_linear(tmp_path: Path) -> None:
    mesh = mesh_from(glb(tmp_path / "a.glb", *two_nodes()))
    assert mesh.colours[:3].tolist() == [[0] * 3, [128] * 3, [255] * 3]
    assert mesh.colours[3:].tolist() == [[188, 0, 255]] * 3


@pytest.mark.parametrize(("shift", "is_warned_of"), [(0.0, False), (0.5, True)])
def test_a_texture_of_gltf_that_shall_not_repeat_is_pointed_out_where_it_does(
    tmp_path: Path, shift: float, is_warned_of: bool
) -> None:
    picture(tmp_path / "skin.png", RED)
    document, binary = gltf(
        [(TRIANGLE, "VEC3"), (UV + np.float32(shift), "VEC2")],
        {
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
            "textures": [{"source": 0, "sampler": 0}],
            "samplers": [{"wrapS": 33071}],
            "images": [{"uri": "skin.png"}],
        },
    )
    warnings = read_model(glb(tmp_path / "a.glb", document, binary), IN_MM).warnings
    assert any("repeated instead" in warning for warning in warnings) == is_warned_of


def test_a_texture_of_gltf_is_turned_upside_down_and_scaled_in_linear_light(tmp_path: Path) -> None:
    stripes = np.zeros((2, 2, 3), np.uint8)
    stripes[0] = 255  # the upper row, where glTF's v is 0
    cv2.imwrite(str(tmp_path / "my skin.png"), stripes)
    document, binary = gltf(
        [(TRIANGLE, "VEC3"), (UV, "VEC2")],
        {
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
            "materials": [
                {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 0.5, 0.5, 1]}}
            ],
            "textures": [{"source": 0}],
            "images": [{"uri": "my%20skin.png"}],
        },
    )
    document["buffers"][0]["uri"] = "a.bin"
    (tmp_path / "a.bin").write_bytes(binary)
    path = text_file(tmp_path, "a.gltf", json.dumps(document))
    mesh = mesh_from(path)
    assert mesh.texture is not None
    assert mesh.texture.uv.tolist() == [[0, 1], [1, 1], [0, 0]]
    assert np.unique(mesh.texture.pixels[0]).tolist() == [188]
    for missing in ("my skin.png", "a.bin"):
        content = (tmp_path / missing).read_bytes()
        (tmp_path / missing).unlink()
        with pytest.raises(ValueError, match=rf"a\.gltf: its (texture|buffer) {missing} is missing"):
            read_model(path, IN_MM)
        (tmp_path / missing).write_bytes(content)


def change(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda document: document.update({key: value})


WRONG_GLTF: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "compressed": (change("extensionsRequired", ["KHR_draco_mesh_compression"]), "needs KHR_draco_mesh_compression"),
    "node": (change("scenes", [{"nodes": [9]}]), "is not whole glTF"),
    "version": (change("asset", {"version": "1.0"}), "is not glTF of version 2"),
    "values": (lambda document: document["accessors"][0].update(count=99), "promises 99 values, more than"),
    "buffer": (lambda document: document["buffers"][0].update(byteLength=9999), "its buffer 0 is cut off"),
}


@pytest.mark.parametrize("fault", WRONG_GLTF)
def test_a_wrong_gltf_is_named_with_its_fault(tmp_path: Path, fault: str) -> None:
    document, binary = two_nodes()
    spoil, sentence = WRONG_GLTF[fault]
    spoil(document)
    with pytest.raises(ValueError, match=rf"a\.glb: .*{sentence}"):
        read_model(glb(tmp_path / "a.glb", document, binary), IN_MM)


def test_a_cut_off_glb_is_named(tmp_path: Path) -> None:
    path = glb(tmp_path / "a.glb", *two_nodes())
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ValueError, match=r"a\.glb: is cut off: it has \d+ bytes, its header says \d+"):
        read_model(path, IN_MM)


def test_linear_light_becomes_srgb_by_the_standard() -> None:
    assert srgb_bytes(np.array([0.0, 0.0031308, 0.214041, 1.0])).tolist() == [0, 10, 127, 255]


# what all formats share


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


def test_nodes_in_a_circle_are_refused_even_where_they_hold_no_mesh(tmp_path: Path) -> None:
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1]}, {"children": [0]}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    with pytest.raises(ValueError, match="circle"):
        read_contents(tmp_path / "a.gltf")


def test_notes_at_the_ends_of_an_obj_files_lines_are_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "noted.obj"
    path.write_text("v 0 0 0 # a corner\nv 1 0 0#next\nv 0 1 0\n\nf 1 2 3 # 4 5\n")
    (part,) = read_contents(path).parts
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


def test_a_texture_of_more_pixels_than_can_be_read_is_named() -> None:
    content = cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes()
    header = b"IHDR" + struct.pack(">II", 60000, 60000) + content[24:29]
    content = content[:12] + header + struct.pack(">I", zlib.crc32(header)) + content[33:]
    with pytest.raises(ValueError, match=r"its texture skin is not readable as a picture: pixels <= "):
        decode_picture(content, "skin")


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
def test_what_a_program_appends_to_a_texture_does_no_harm(suffix: str) -> None:
    content = cv2.imencode(suffix, np.full((16, 16, 3), 90, np.uint8))[1].tobytes()
    assert (decode_picture(content + b"notes" * 50, "skin") == 90).all()
    with pytest.raises(ValueError, match="its texture skin is cut off after"):
        decode_picture(content[:-8], "skin")
