"""Clouds and meshes come back from their files as they were, and files that are not whole are refused."""

from __future__ import annotations

import errno
import json
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from recon.geometry.mesh import Cloud, Mesh, Texture, error_colours, measured_part, merge_meshes
from recon.geometry.mesh_files import (
    read_cloud,
    read_mesh,
    read_ply_shape,
    read_points,
    write_cloud,
    write_measured,
    write_mesh,
)
from recon.models.read import read_contents
from recon.surface.components import drop_small_components
from recon.surface.holes import close_holes

COORDINATES = st.floats(-1e6, 1e6, width=32)


def cloud_of(n: int, seed: int = 0, *, sigma: bool = False) -> Cloud:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    colours = rng.integers(0, 256, (n, 3), dtype=np.uint8)
    return Cloud(rng.normal(size=(n, 3)), normals, colours, rng.uniform(0.1, 3, n) if sigma else None)


def mesh_of(n: int, n_faces: int, seed: int = 0) -> Mesh:
    cloud = cloud_of(n, seed)
    faces = np.random.default_rng(seed).integers(0, n, (n_faces, 3))
    return Mesh(cloud.points, faces, cloud.normals, cloud.colours)


def textured_mesh(n: int, n_faces: int, *, height: int = 5, width: int = 7, seed: int = 0) -> Mesh:
    mesh, rng = mesh_of(n, n_faces, seed), np.random.default_rng(seed)
    pixels = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    return replace(mesh, texture=Texture(pixels, rng.uniform(-1, 2, (n, 2)).astype(np.float32)))


def same_mesh(a: Mesh, b: Mesh) -> bool:
    return all(
        np.array_equal(getattr(a, name), getattr(b, name)) for name in ("vertices", "faces", "normals", "colours")
    )


@settings(max_examples=30, deadline=None)
@given(
    points=arrays.arrays(np.float32, st.tuples(st.integers(1, 20), st.just(3)), elements=COORDINATES),
    seed=st.integers(0, 1000),
    sigma=st.booleans(),
)
def test_a_cloud_comes_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, points: np.ndarray, seed: int, sigma: bool
) -> None:
    other = cloud_of(len(points), seed, sigma=sigma)
    cloud = Cloud(points, other.normals, other.colours, other.sigma)
    back = read_cloud(write_cloud(tmp_path_factory.mktemp("ply") / "a.ply", cloud))
    assert np.array_equal(back.points, cloud.points)
    assert np.array_equal(back.normals, cloud.normals)
    assert np.array_equal(back.colours, cloud.colours)
    assert (back.sigma is None) == (cloud.sigma is None)
    assert cloud.sigma is None or np.array_equal(back.sigma, cloud.sigma)


def test_a_mesh_comes_back_bit_for_bit_with_coincident_vertices(tmp_path: Path) -> None:
    mesh = mesh_of(30, 50)
    doubled = Mesh(np.repeat(mesh.vertices[:15], 2, axis=0), mesh.faces, mesh.normals, mesh.colours)
    assert same_mesh(read_mesh(write_mesh(tmp_path / "a.ply", doubled)), doubled)


@pytest.mark.parametrize(
    ("suffix", "made"), [(".ply", mesh_of), (".glb", mesh_of), (".glb", textured_mesh), (".obj", textured_mesh)]
)
def test_the_same_mesh_gives_the_same_bytes(tmp_path: Path, suffix: str, made: Callable[[int, int], Mesh]) -> None:
    paths = [tmp_path / folder / f"a{suffix}" for folder in ("first", "second")]
    first, second = (write_mesh(path, made(30, 50)).read_bytes() for path in paths)
    assert first == second


def test_other_programs_read_what_we_write(tmp_path: Path) -> None:
    import trimesh

    mesh = mesh_of(30, 50)
    ply = trimesh.load(write_mesh(tmp_path / "a.ply", mesh), process=False)
    assert np.array_equal(ply.vertices, mesh.vertices)
    assert np.array_equal(ply.faces, mesh.faces)
    assert np.array_equal(ply.visual.vertex_colors[:, :3], mesh.colours)
    scene = trimesh.load(write_mesh(tmp_path / "a.glb", mesh), process=False)
    placed = scene.to_geometry()
    assert np.allclose(placed.vertices, mesh.vertices * 0.001, atol=1e-9), "glTF counts in metres"
    assert np.array_equal(placed.faces, mesh.faces)


def test_a_glb_holds_linear_colours_from_which_the_bytes_come_back(tmp_path: Path) -> None:
    grey = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    mesh = Mesh(
        np.random.default_rng(0).normal(size=(256, 3)), np.array([[0, 1, 2]]), np.eye(3)[np.arange(256) % 3], grey
    )
    content = write_mesh(tmp_path / "a.glb", mesh).read_bytes()
    magic, version, length = struct.unpack_from("<4sII", content)
    assert (magic, version, length) == (b"glTF", 2, len(content))
    (json_length,) = struct.unpack_from("<I", content, 12)
    document = json.loads(content[20 : 20 + json_length])
    view = document["bufferViews"][document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
    start = 20 + json_length + 8 + view["byteOffset"]
    linear = np.frombuffer(content[start : start + view["byteLength"]], "<u2").reshape(-1, 4) / 65535
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert np.array_equal(np.rint(encoded[:, :3] * 255), grey)
    assert (linear[:, 3] == 1).all()


def test_a_glb_of_ours_comes_back(tmp_path: Path) -> None:
    plain, mesh = mesh_of(30, 50), textured_mesh(30, 50)
    assert same_mesh(read_mesh(write_mesh(tmp_path / "plain.glb", plain)), plain)
    back = read_mesh(write_mesh(tmp_path / "a.glb", mesh))
    assert mesh.texture is not None
    assert back.texture is not None
    assert same_mesh(replace(back, colours=mesh.colours), mesh)
    assert np.array_equal(back.texture.pixels, mesh.texture.pixels)
    assert np.allclose(back.texture.uv, mesh.texture.uv, atol=1e-7)


def test_a_glb_of_another_program_or_a_damaged_one_is_named(tmp_path: Path) -> None:
    path = write_mesh(tmp_path / "a.glb", textured_mesh(30, 50))
    content = path.read_bytes()
    others = (content.replace(b"reconstudy", b"somewhere!"), content.replace(b"POSITION", b"POSITIOM"))
    for damaged in (content[:-9], *others, b"", b"glTF" + bytes(40)):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"a\.glb: is no whole GLB that reconstudy wrote"):
            read_mesh(path)
    path.unlink()
    with pytest.raises(ValueError, match=r"a\.glb: there is no such file"):
        read_mesh(path)


def test_a_textured_glb_opens_elsewhere_with_the_same_picture_at_the_same_places(tmp_path: Path) -> None:
    import trimesh

    mesh = textured_mesh(30, 50)
    assert mesh.texture is not None
    back = trimesh.load(write_mesh(tmp_path / "a.glb", mesh), process=False).to_geometry()
    assert np.array_equal(np.asarray(back.visual.material.baseColorTexture.convert("RGB")), mesh.texture.pixels)
    assert np.allclose(back.visual.uv, mesh.texture.uv, atol=1e-6)
    assert np.allclose(back.vertices, mesh.vertices * 0.001, atol=1e-9), "glTF counts in metres"
    assert np.array_equal(back.faces, mesh.faces)


def test_a_textured_glb_is_whole_and_unlit(tmp_path: Path) -> None:
    content = write_mesh(tmp_path / "a.glb", textured_mesh(3, 1, height=1, width=1)).read_bytes()
    (json_length,) = struct.unpack_from("<I", content, 12)
    document = json.loads(content[20 : 20 + json_length])
    (binary_length,) = struct.unpack_from("<I", content, 20 + json_length)
    assert len(content) == 28 + json_length + binary_length
    assert binary_length % 4 == 0
    assert binary_length - document["buffers"][0]["byteLength"] in range(4)
    assert set(document["meshes"][0]["primitives"][0]["attributes"]) == {"POSITION", "NORMAL", "TEXCOORD_0"}
    assert "KHR_materials_unlit" in document["materials"][0]["extensions"]
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    start = 28 + json_length + view["byteOffset"]
    assert content[start : start + 4] == b"\x89PNG"


def test_a_textured_obj_opens_elsewhere_as_it_was(tmp_path: Path) -> None:
    import trimesh

    mesh = textured_mesh(30, 50)
    assert mesh.texture is not None
    path = write_mesh(tmp_path / "my model.obj", mesh)
    assert {file.name for file in tmp_path.iterdir()} == {"my model.obj", "my_model.mtl", "my_model.png"}
    back = trimesh.load(path, process=False, maintain_order=True)
    assert np.array_equal(np.asarray(back.visual.material.image.convert("RGB")), mesh.texture.pixels)
    assert np.array_equal(back.vertices[back.faces].astype(np.float32), mesh.vertices[mesh.faces])
    assert np.array_equal(back.visual.uv[back.faces].astype(np.float32), mesh.texture.uv[mesh.faces])


def test_what_cannot_keep_a_texture_refuses_it(tmp_path: Path) -> None:
    mesh, plain = textured_mesh(30, 50), mesh_of(30, 50)
    with pytest.raises(ValueError, match=r"a\.ply: the mesh has a texture, which PLY cannot hold; write it as \.glb"):
        write_mesh(tmp_path / "a.ply", mesh)
    with pytest.raises(ValueError, match=r"a\.ply: the mesh has a texture"):
        write_measured(tmp_path / "a.ply", mesh, np.zeros(30))
    with pytest.raises(ValueError, match=r"a\.obj: OBJ holds colours as a texture, and the mesh has none"):
        write_mesh(tmp_path / "a.obj", plain)
    with pytest.raises(ValueError, match="mesh 2 of 2 has a texture; only meshes without can be merged"):
        merge_meshes([plain, mesh])
    with pytest.raises(ValueError, match="has no colours for patches"):
        close_holes(mesh, 10.0)
    assert not list(tmp_path.iterdir())


def test_a_textured_mesh_without_its_small_parts_keeps_its_texture() -> None:
    mesh = replace(textured_mesh(9, 3), faces=np.array([[0, 1, 2], [2, 1, 8], [4, 5, 6]], np.int32))
    kept = drop_small_components(mesh, 0.9)
    assert mesh.texture is not None
    assert kept.texture is not None
    assert np.array_equal(kept.texture.pixels, mesh.texture.pixels)
    assert np.array_equal(kept.texture.uv[kept.faces], mesh.texture.uv[mesh.faces[:2]])


def test_a_texture_has_a_place_for_every_vertex_and_three_channels() -> None:
    mesh = textured_mesh(5, 2)
    assert mesh.texture is not None
    with pytest.raises(ValueError, match="the texture has places for 4 vertices, expected 5"):
        replace(mesh, texture=replace(mesh.texture, uv=mesh.texture.uv[:4]))
    with pytest.raises(ValueError, match=r"pixels are uint8 \(5, 7, 4\), expected uint8 \(H, W, 3\) in sRGB"):
        Texture(np.zeros((5, 7, 4), np.uint8), mesh.texture.uv)
    with pytest.raises(ValueError, match="uv hold values that are not finite"):
        Texture(mesh.texture.pixels, np.full((5, 2), np.nan, np.float32))


@pytest.mark.parametrize(("suffix", "made"), [(".ply", mesh_of), (".glb", mesh_of), (".glb", textured_mesh)])
def test_filled_holes_come_back_with_their_mark(tmp_path: Path, suffix: str, made: Callable[[int, int], Mesh]) -> None:
    mesh = made(9, 12)
    marked = replace(mesh, filled=np.arange(9) % 3 == 0)
    for number, each in enumerate((mesh, marked)):
        path = write_mesh(tmp_path / f"{number}{suffix}", each)
        again = read_mesh(path)
        assert np.array_equal(again.filled, each.filled) if number else again.filled is None
        assert same_mesh(again, each) or suffix == ".glb"
        read_contents(path)  # as another program's


def test_the_measured_part_lacks_the_faces_on_filled_vertices_alone() -> None:
    mesh = replace(mesh_of(4, 3), faces=np.array([[0, 1, 2], [1, 2, 3], [3, 2, 0]], np.int32))
    marked = replace(mesh, filled=np.array([True, True, True, False]))
    assert measured_part(marked).faces.tolist() == [[1, 2, 3], [3, 2, 0]]
    assert measured_part(mesh) is mesh


def test_merged_meshes_keep_every_triangle() -> None:
    parts = [mesh_of(10, 5, seed) for seed in range(3)]
    merged = merge_meshes(parts)
    assert np.array_equal(merged.vertices[merged.faces], np.concatenate([part.vertices[part.faces] for part in parts]))
    assert np.array_equal(merged.colours, np.concatenate([part.colours for part in parts]))


def test_points_are_read_from_an_ascii_file_that_holds_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    header = (
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\nend_header\n"
    )
    path.write_text(header + "1 2 3\n4 5 6.5\n")
    assert np.array_equal(read_points(path), [[1, 2, 3], [4, 5, 6.5]])
    with pytest.raises(ValueError, match=r"scan\.ply: its points have no nx"):
        read_cloud(path)


def ply(kind: str, *, comment: str = "", face: tuple[int, ...] = (0, 1, 2), red: int = 9, n_points: int = 3) -> bytes:
    """A triangle as another program might write it."""
    header = f"ply\nformat {kind} 1.0\ncomment {comment}\nelement vertex {n_points}\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    header += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    header += "element face 1\nproperty list uchar uint vertex_index\nend_header\n"
    rows = [(0, 0, 0, 0, 0, 1, red, 9, 9), (1, 0, 0, 0, 0, 1, 9, 9, 9), (0, 1, 0, 0, 0, 1, 9, 9, 9)]
    if kind == "ascii":
        return (header + "".join(" ".join(map(str, row)) + "\n" for row in [*rows, (len(face), *face)])).encode()
    order = ">" if kind == "binary_big_endian" else "<"
    body = b"".join(struct.pack(f"{order}6f3B", *row) for row in rows)
    return header.encode() + body + struct.pack(f"{order}B{len(face)}I", len(face), *face)


KINDS = ("ascii", "binary_little_endian", "binary_big_endian")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("comment", ["by a scanner", "von Jörg"])
def test_every_kind_of_ply_is_read(tmp_path: Path, kind: str, comment: str) -> None:
    (tmp_path / "a.ply").write_bytes(ply(kind, comment=comment))
    mesh = read_mesh(tmp_path / "a.ply")
    assert np.array_equal(mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert np.array_equal(mesh.faces, [[0, 1, 2]])
    assert np.array_equal(mesh.colours, np.full((3, 3), 9))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ({"face": (0, 1)}, "face 0 has 2 corners, expected at least 3"),
        ({"face": (0, 1, 7)}, "faces name vertices 0 to 7, but there are 3"),
        ({"n_points": 2_000_000_000}, "its header promises 2000000000 rows, but the file has only"),
    ],
)
def test_a_bad_ply_is_refused_in_every_kind(tmp_path: Path, kind: str, content: Any, complaint: str) -> None:
    (tmp_path / "bad.ply").write_bytes(ply(kind, **content))
    with pytest.raises(ValueError, match=rf"bad\.ply: .*({complaint})"):
        read_mesh(tmp_path / "bad.ply")


@pytest.mark.parametrize(
    ("element", "complaint"),
    [
        ("element face 1\nproperty list int int corners", "faces have corners, expected vertex_indices or vertex_ind"),
    ],
)
def test_triangles_in_another_form_make_no_cloud_of_a_mesh(tmp_path: Path, element: str, complaint: str) -> None:
    points = "element vertex 3\nproperty float x\nproperty float y\nproperty float z"
    text = f"ply\nformat ascii 1.0\n{points}\n{element}\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    (tmp_path / "mesh.ply").write_text(text, encoding="ascii")
    for read in (read_ply_shape, read_contents):
        with pytest.raises(ValueError, match=rf"mesh.ply: its {complaint}"):
            read(tmp_path / "mesh.ply")
    assert len(read_points(tmp_path / "mesh.ply")) == 3


def test_values_that_their_property_cannot_hold_are_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.ply").write_bytes(ply("ascii", red=300))
    with pytest.raises(ValueError, match=r"bad\.ply: .*300, out of bounds"):
        read_mesh(tmp_path / "bad.ply")


def test_bytes_after_the_last_element_are_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.ply").write_bytes(ply("binary_little_endian") + b"more")
    with pytest.raises(ValueError, match=r"bad\.ply: .*it goes on after its last element"):
        read_mesh(tmp_path / "bad.ply")


@pytest.mark.parametrize("content", [b"", b"ply\n", b"hello", b"ply\nformat binary_little_endian 1.0\nend_header\n"])
def test_a_file_that_is_no_cloud_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "odd.ply"
    path.write_bytes(content)
    for read in (read_cloud, read_mesh, read_points):
        with pytest.raises(ValueError, match=r"odd\.ply"):
            read(path)


def test_normals_of_a_cloud_by_another_program_get_unit_length(tmp_path: Path) -> None:
    cloud = cloud_of(50)
    scale = np.array([0, 1e-30, 1e30, *np.linspace(0.1, 4, 47)], np.float32)[:, None]
    back = read_cloud(write_cloud(tmp_path / "a.ply", replace(cloud, normals=scale * cloud.normals)))
    assert not back.normals[0].any()  # what has no direction is given none
    np.testing.assert_allclose(back.normals[1:], cloud.normals[1:], atol=1e-6)


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"gone\.ply: there is no such file"):
        read_cloud(tmp_path / "gone.ply")


def test_a_file_that_may_not_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_cloud(tmp_path / "a.ply", cloud_of(3))

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", "a.ply")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(ValueError, match=r"a\.ply: cannot be read: permission denied$"):
        read_points(tmp_path / "a.ply")


@pytest.mark.parametrize("cut", [1, 15, 300])
def test_a_file_cut_short_is_refused(tmp_path: Path, cut: int) -> None:
    path = write_mesh(tmp_path / "short.ply", mesh_of(30, 50))
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(ValueError, match=r"short\.ply"):
        read_mesh(path)


def test_a_cloud_is_no_mesh(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds no faces") as refused:
        read_mesh(write_cloud(tmp_path / "a.ply", cloud_of(5)))
    assert refused.value.__cause__ is not refused.value  # else whoever follows the causes never ends


def test_coordinates_that_are_not_numbers_are_refused(tmp_path: Path) -> None:
    cloud = cloud_of(5)
    path = write_cloud(tmp_path / "nan.ply", cloud)
    content = bytearray(path.read_bytes())
    start = content.index(b"end_header\n") + len(b"end_header\n")
    content[start + 27 : start + 31] = struct.pack("<f", float("nan"))  # x of the second point
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"nan\.ply: points hold values that are not finite numbers: row 1"):
        read_cloud(path)
    for value in (np.inf, 1e300):  # which single precision does not hold
        with pytest.raises(ValueError, match="not finite"):
            Cloud(np.full((2, 3), value), cloud.normals[:2], cloud.colours[:2])


def test_arrays_that_do_not_belong_together_are_refused() -> None:
    cloud = cloud_of(5)
    with pytest.raises(ValueError, match="normals have shape"):
        Cloud(cloud.points, cloud.normals[:4], cloud.colours)
    with pytest.raises(ValueError, match="colours are float64"):
        Cloud(cloud.points, cloud.normals, cloud.colours / 255)
    with pytest.raises(ValueError, match="faces name vertices 0 to 5, but there are 5"):
        Mesh(cloud.points, np.array([[0, 1, 5]]), cloud.normals, cloud.colours)
    with pytest.raises(ValueError, match="sigma"):
        Cloud(cloud.points, cloud.normals, cloud.colours, np.zeros(5))


def test_nothing_empty_is_written_and_nothing_half(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="empty"):
        write_cloud(tmp_path / "a.ply", cloud_of(0))
    with pytest.raises(ValueError, match="no face"):
        write_mesh(tmp_path / "a.ply", mesh_of(3, 0))
    with pytest.raises(ValueError, match=r"a\.stl: unknown kind of file"):
        write_mesh(tmp_path / "a.stl", mesh_of(3, 1))
    assert not list(tmp_path.iterdir())


def test_errors_are_blue_below_white_at_nothing_and_red_above() -> None:
    colours = error_colours(np.array([-9.0, -1.0, 0.0, 0.5, 1.0, 9.0, np.nan]), 1.0).astype(int)
    assert np.array_equal(colours[0], colours[1])
    assert np.array_equal(colours[4], colours[5])
    assert np.array_equal(colours[2], [255, 255, 255])
    assert np.array_equal(colours[6], [128, 128, 128])
    assert colours[1, 2] > colours[1, 0]
    assert colours[4, 0] > colours[3, 0] - 60 > colours[4, 2]
    for limit in (0.0, np.inf, np.nan):
        with pytest.raises(ValueError, match=f"limit is {limit}, expected an error above 0"):
            error_colours(np.zeros(2), limit)
