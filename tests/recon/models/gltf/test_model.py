"""glTF models of other programs are read as the format says, and what is wrong with them is named."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from recon.geometry.mesh_files import write_mesh
from recon.geometry.srgb import srgb_bytes
from recon.models.gltf.data import chunks
from recon.models.read import read_contents, read_model
from tests.recon.geometry.test_mesh import mesh_of
from tests.recon.models.model_files import IN_METRES, IN_MM, RED, mesh_from, picture, text_file


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


def rigged(path: Path, node: dict[str, Any], n_joints: int = 3) -> Path:
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
    document["accessors"][1] |= {"normalized": False, "count": n_joints}
    return glb(path, document, binary)


def test_a_rigged_gltf_stands_as_its_joints_do_wherever_its_own_node_is(tmp_path: Path) -> None:
    mesh = mesh_from(rigged(tmp_path / "a.glb", {"skin": 0}))
    assert np.allclose(mesh.vertices, [[0, 0, 0], [1, 0, 0], [3, 1, 0]], atol=1e-6)


def test_a_rigged_gltf_that_promises_more_joints_than_memory_holds_is_named(tmp_path: Path) -> None:
    path = rigged(tmp_path / "a.glb", {"skin": 0}, n_joints=10**12)
    with pytest.raises(ValueError, match=r"a\.glb: its accessor 1 promises 1000000000000 values, more than"):
        read_model(path, IN_MM)


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


def test_textures_of_gltf_that_share_a_picture_are_one(tmp_path: Path) -> None:
    picture(tmp_path / "skin.png", RED)
    attributes = {"POSITION": 0, "TEXCOORD_0": 1}
    document, binary = gltf(
        [(TRIANGLE, "VEC3"), (UV, "VEC2")],
        {
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": attributes, "material": number} for number in (0, 1)]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": number}}} for number in (0, 1)],
            "textures": [{"source": 0}, {"source": 0}],
            "images": [{"uri": "skin.png"}],
        },
    )
    mesh = mesh_from(glb(tmp_path / "a.glb", document, binary))
    assert mesh.texture is not None
    assert mesh.texture.pixels.shape == (8, 8, 3)


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


@pytest.mark.parametrize("base", [{}, {"baseColorTexture": {"index": 1}}])
def test_a_gltf_that_is_black_but_for_what_it_emits_shows_that(tmp_path: Path, base: dict[str, Any]) -> None:
    picture(tmp_path / "glow.png", (10, 200, 30))
    picture(tmp_path / "base.png", RED)
    emitting = {"emissiveTexture": {"index": 0}, "emissiveFactor": [1, 1, 1]}
    document, binary = gltf(
        [(TRIANGLE, "VEC3"), (UV, "VEC2")],
        {
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], **base}, **emitting}],
            "textures": [{"source": 0}, {"source": 1}],
            "images": [{"uri": "glow.png"}, {"uri": "base.png"}],
        },
    )
    mesh = mesh_from(glb(tmp_path / "a.glb", document, binary))
    assert mesh.texture is not None
    assert np.unique(mesh.texture.pixels.reshape(-1, 3), axis=0).tolist() == [[10, 200, 30]]
    del document["materials"][0]["emissiveTexture"]
    document["materials"][0]["emissiveFactor"] = [0, 1, 0]
    assert np.unique(mesh_from(glb(tmp_path / "a.glb", document, binary)).colours, axis=0).tolist() == [[0, 255, 0]]


def change(key: str, value: Any) -> Callable[[dict[str, Any]], None]:
    return lambda document: document.update({key: value})


WRONG_GLTF: dict[str, tuple[Callable[[dict[str, Any]], Any], str]] = {
    "compressed": (change("extensionsRequired", ["KHR_draco_mesh_compression"]), "needs KHR_draco_mesh_compression"),
    "node": (change("scenes", [{"nodes": [9]}]), "it refers to number 9 of nodes, of which it has 3"),
    "kind": (change("nodes", [3, 4]), "is not whole glTF: a value is of another kind than it must be"),
    "number": (lambda document: document["accessors"][0].update(componentType=7), "glTF: 7 is missing, or is no value"),
    "version": (change("asset", {"version": "1.0"}), "is not glTF of version 2"),
    "values": (lambda document: document["accessors"][0].update(count=99), "promises 99 values, more than"),
    "before": (lambda document: document["accessors"][0].update(byteOffset=-4), "accessor 0 promises"),
    "turn": (lambda document: document["nodes"][0].update(rotation=[0, 0, 0, 0]), r"rotation of a node is \[0\.0, 0"),
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


def test_nodes_that_share_children_are_refused_at_once(tmp_path: Path) -> None:
    shared = [{"children": [level + 1, level + 1]} for level in range(40)]
    document = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [*shared, {}]}
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    with pytest.raises(ValueError, match="its node 1 has two parents"):
        read_contents(tmp_path / "a.gltf")


def test_nodes_in_a_circle_are_refused_even_where_they_hold_no_mesh(tmp_path: Path) -> None:
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1]}, {"children": [0]}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    with pytest.raises(ValueError, match="circle"):
        read_contents(tmp_path / "a.gltf")


def test_instances_of_a_mesh_stand_where_their_extension_says(tmp_path: Path) -> None:
    moves = np.array([[0, 0, 0], [5, 0, 0], [0, 7, 0]], np.dtype("<f4"))
    scales = np.array([[1, 1, 1], [2, 2, 2], [1, 1, 1]], np.dtype("<f4"))
    instances = {"attributes": {"TRANSLATION": 1, "SCALE": 2}}
    document, binary = gltf(
        [(TRIANGLE, "VEC3"), (moves, "VEC3"), (scales, "VEC3")],
        {
            "nodes": [{"mesh": 0, "translation": [0, 0, 1], "extensions": {"EXT_mesh_gpu_instancing": instances}}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "extensionsRequired": ["EXT_mesh_gpu_instancing"],
        },
    )
    vertices = mesh_from(glb(tmp_path / "a.glb", document, binary)).vertices.reshape(3, 3, 3)
    for number in range(3):
        np.testing.assert_allclose(vertices[number], TRIANGLE * scales[number] + moves[number] + (0, 0, 1))


def test_nodes_that_a_file_hides_are_not_shown(tmp_path: Path) -> None:
    document, binary = two_nodes()
    n_shown = len(mesh_from(glb(tmp_path / "a.glb", document, binary)).faces)
    document["nodes"][1]["extensions"] = {"KHR_node_visibility": {"visible": False}}
    path = glb(tmp_path / "b.glb", document, binary)
    assert len(mesh_from(path).faces) == n_shown - 1
    assert any("nodes that are hidden" in warning for warning in read_model(path, IN_MM).warnings)


@pytest.mark.parametrize("writer", ["https://github.com/mikedh/trimesh", "Open3D"])
def test_colours_that_a_program_writes_as_srgb_are_warned_of_and_right_where_scene_json_says_so(
    tmp_path: Path, writer: str
) -> None:
    bytes_written = np.array([[128, 200, 254, 255], [0, 1, 2, 255], [255, 64, 37, 255]], np.uint8)
    document, binary = gltf(
        [(TRIANGLE, "VEC3"), (bytes_written, "VEC4")],
        {
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}}]}],
        },
    )
    document["asset"]["generator"] = writer
    document["accessors"][1]["normalized"] = True
    path = glb(tmp_path / "a.glb", document, binary)
    assert any("stores the colours of vertices as sRGB" in warning for warning in read_model(path, IN_MM).warnings)
    told = replace(IN_MM, vertex_colours="srgb")
    assert mesh_from(path, told).colours.tolist() == bytes_written[:, :3].tolist()
    assert read_model(path, told).warnings == read_model(path, replace(IN_MM, vertex_colours="linear")).warnings == ()


@pytest.mark.parametrize(
    ("extension", "way"),
    [
        ("KHR_texture_basisu", "textures as KTX2, which are not read; export them as PNG"),
        ("KHR_gaussian_splatting", "splats in glTF, which are not read; save them as PLY"),
        ("VENDOR_unheard_of", "an extension of glTF that is not read; export it without"),
    ],
)
def test_an_extension_that_is_needed_and_not_read_has_its_own_sentence(
    tmp_path: Path, extension: str, way: str
) -> None:
    (tmp_path / "a.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "extensionsRequired": [extension]}))
    with pytest.raises(ValueError, match=f"it needs {extension}, {way}"):
        read_contents(tmp_path / "a.gltf")


def test_levels_of_detail_are_pointed_out(tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "extensionsUsed": ["MSFT_lod"]}))
    assert read_contents(tmp_path / "a.gltf").warnings == ["has levels of detail, of which the finest is shown"]


def test_sparse_values_of_a_gltf_stand_in_the_places_that_they_name(tmp_path: Path) -> None:
    document, binary = gltf(
        [(TRIANGLE, "VEC3"), (np.array([2], "<u2"), "SCALAR"), (np.array([[0, 9, 4]], "<f4"), "VEC3")],
        {"nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]},
    )
    sparse = {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 2}}
    document["accessors"][0]["sparse"] = sparse
    (part,) = read_contents(glb(tmp_path / "a.glb", document, binary)).parts
    np.testing.assert_array_equal(part.vertices, [*TRIANGLE[:2], [0, 9, 4]])
    del document["accessors"][0]["bufferView"]
    (part,) = read_contents(glb(tmp_path / "b.glb", document, binary)).parts
    np.testing.assert_array_equal(part.vertices, [[0, 0, 0], [0, 0, 0], [0, 9, 4]])
    sparse["indices"] = {"bufferView": 1, "componentType": 5125}
    with pytest.raises(ValueError, match="accessor 0 promises 1 values, more than its buffer holds"):
        read_contents(glb(tmp_path / "c.glb", document, binary))


def unpacked(path: Path) -> tuple[dict[str, Any], bytes]:
    """Return the document and the binary part of a GLB."""
    text, binary = chunks(path.read_bytes())
    return json.loads(text), binary or b""


def textured() -> tuple[dict[str, Any], bytes]:
    document, binary = gltf(
        [(TRIANGLE, "VEC3"), (UV, "VEC2")],
        {
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {}}}}],
            "textures": [{"source": 0}],
            "images": [{"uri": "skin.png"}],
        },
    )
    return document, binary


def moved_texture(**transform: Any) -> Callable[[dict[str, Any]], None]:
    def spoil(document: dict[str, Any]) -> None:
        texture = document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
        texture["extensions"]["KHR_texture_transform"] = transform

    return spoil


# What is wrong with which file, and what of it is said.
DAMAGED: dict[str, tuple[Callable[[], tuple[dict[str, Any], bytes]], Callable[[dict[str, Any]], Any], str]] = {
    "translation": (
        two_nodes,
        lambda document: document["nodes"][0].update(translation=["a"]),
        r"translation of a node is \['a'\], expected 3 finite numbers",
    ),
    "scale": (two_nodes, lambda document: document["nodes"][1].update(scale=[1, 2]), "scale of a node is .*expected 3"),
    "rotation": (two_nodes, lambda document: document["nodes"][0].update(rotation=[1, 0]), "of a node is .*expected 4"),
    "matrix": (
        two_nodes,
        lambda document: document["nodes"][0].update(matrix=[1]),
        "of a node is .*expected 16",
    ),
    "factor": (
        two_nodes,
        lambda document: document["materials"][0]["pbrMetallicRoughness"].update(baseColorFactor="red!"),
        "baseColorFactor of a material is 'red', expected 3",
    ),
    "offset": (textured, moved_texture(offset=[0, [1]]), "offset of a texture is .*expected 2"),
    "angle": (textured, moved_texture(rotation=float("inf")), r"rotation of a texture is \[inf\], expected 1 finite"),
    "weights": (
        two_nodes,
        lambda document: document["meshes"][0].update(weights=[[1, 2]]),
        "weights of a mesh is .*expected 1 finite number",
    ),
    "width": (
        two_nodes,
        lambda document: document["accessors"][0].update(type="VEC2"),
        "its accessor 0 holds VEC2, expected VEC3",
    ),
    "accessor": (
        two_nodes,
        lambda document: document["meshes"][0]["primitives"][0].update(indices=-1),
        "it refers to number -1 of accessors, of which it has 3",
    ),
    "view": (
        two_nodes,
        lambda document: document["accessors"][1].update(bufferView=7),
        "it refers to number 7 of bufferViews, of which it has 3",
    ),
    "end": (
        two_nodes,
        lambda document: document["bufferViews"][1].update(byteOffset=50),
        "its bufferView 1 ends at byte 62 of a buffer of 56",
    ),
    "count": (
        two_nodes,
        lambda document: document["accessors"][1].update(count="three"),
        "a value is of another kind than it must be, in its accessor 1",
    ),
    "name": (
        two_nodes,
        lambda document: document["buffers"][0].update(uri="a\0b"),
        r"its buffer 'a\\x00b' is no name of a file",
    ),
    "base64": (two_nodes, lambda document: document["buffers"][0].update(uri="data:,A"), "its buffer is no base64"),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_gltf_is_named_with_the_part_that_is_wrong(tmp_path: Path, damage: str) -> None:
    picture(tmp_path / "skin.png", RED)
    make, spoil, sentence = DAMAGED[damage]
    document, binary = make()
    spoil(document)
    with pytest.raises(ValueError, match=rf"a\.glb: .*{sentence}"):
        read_model(glb(tmp_path / "a.glb", document, binary), IN_MM)


def test_parts_of_a_rig_that_do_not_belong_together_are_named(tmp_path: Path) -> None:
    path = rigged(tmp_path / "a.glb", {"skin": 0}, n_joints=2)
    with pytest.raises(ValueError, match="its accessor 1 has 2 rows, expected 3"):
        read_contents(path)
    document, binary = unpacked(rigged(tmp_path / "b.glb", {"skin": 0}))
    document["accessors"].append(document["accessors"][0] | {"count": 2})
    document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 5
    with pytest.raises(ValueError, match="its accessor 5 has 2 rows, expected 3"):
        read_contents(glb(tmp_path / "b.glb", document, binary))


def test_a_rig_without_joints_is_refused_in_words(tmp_path: Path) -> None:
    document, binary = unpacked(rigged(tmp_path / "a.glb", {"skin": 0}))
    document["skins"][0]["joints"] = []
    with pytest.raises(ValueError, match="it refers to a part it lacks"):
        read_contents(glb(tmp_path / "a.glb", document, binary))


def test_numbers_that_are_none_are_named_by_their_vertex_and_nothing_is_printed(tmp_path: Path) -> None:
    signalling = np.array([0x7F800001, 0, 0], "<u4").view("<f4")  # a NaN that casts complain of
    document, binary = gltf(
        [(np.stack([signalling, *TRIANGLE[1:]]), "VEC3")],
        {"nodes": [{"mesh": 0}], "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]},
    )
    with pytest.raises(ValueError, match=r"vertex 0 is \[nan"):
        read_contents(glb(tmp_path / "a.glb", document, binary))


def test_more_instances_than_are_shown_are_refused_before_they_are_made(tmp_path: Path) -> None:
    instances = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 1}}}
    document, binary = gltf(
        [(TRIANGLE, "VEC3")],
        {
            "nodes": [{"mesh": 0, "extensions": instances}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        },
    )
    document["accessors"].append({"componentType": 5126, "count": 10_000_000, "type": "VEC3"})
    with pytest.raises(ValueError, match="it shows 10000000 parts, expected at most 100000"):
        read_contents(glb(tmp_path / "a.glb", document, binary))
