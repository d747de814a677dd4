"""STL and OFF are read as trimesh reads them, and better where it goes wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from recon.models.read import read_contents
from recon.models.shape import read_model_shape

BALL = trimesh.creation.icosphere(subdivisions=2, radius=30.0)
L_OFF = "OFF\n# by hand\n6 1 0\n1 1 0\n1 2 0\n0 2 0\n0 0 0\n2 0 0\n2 1 0\n6 0 1 2 3 4 5\n"


def area(path: Path) -> float:
    shape = read_model_shape(path)
    a, b, c = shape.points[shape.faces].astype(float).transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "off"])
def test_meshes_are_those_that_trimesh_wrote(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"ball.{kind[:3]}"
    BALL.export(path, file_type=kind)
    shape = read_model_shape(path)
    assert shape.points.shape == BALL.vertices.shape
    assert shape.faces.shape == BALL.faces.shape
    again = trimesh.Trimesh(shape.points, shape.faces, process=False)
    assert again.is_watertight
    assert again.volume == pytest.approx(BALL.volume, rel=1e-5)


def test_concave_polygons_of_an_off_are_cut_right(tmp_path: Path) -> None:
    (tmp_path / "l.off").write_text(L_OFF)
    assert area(tmp_path / "l.off") == pytest.approx(3)


@pytest.mark.parametrize("colour", ["255 0 51", "1.0 0.0 0.2", "255 0 51 255"])
def test_colours_of_an_off_are_bytes_or_shares(tmp_path: Path, colour: str) -> None:
    rows = "".join(f"{place} 0 0 1 {colour}\n" for place in ("0 0 0", "1 0 0", "0 1 0"))
    (tmp_path / "c.off").write_text(f"CNOFF 3 1 0\n{rows}3 0 1 2\n")
    shape = read_model_shape(tmp_path / "c.off")
    assert shape.colours is not None
    assert shape.normals is not None
    np.testing.assert_array_equal(shape.colours, [[255, 0, 51]] * 3)
    np.testing.assert_array_equal(shape.normals, [[0, 0, 1]] * 3)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("a.stl", bytes(80) + (4_000_000_000).to_bytes(4, "little"), "is no whole STL: it has 84 bytes, 4000000000"),
        ("a.stl", b"solid x\nvertex 0 0 0\nvertex 1 0 0\nendsolid", "has 2 corners of triangles"),
        ("a.stl", b"solid x\n", "is no whole STL"),
        ("a.stl", b"solid x\r\n" + b"VERTEX 0 0 1\r\n" * 3, "is cut off: its text does not end with a line endsolid"),
        ("a.off", b"OFF\n3000000000 1 0\n0 0 0\n", "announces 3000000000 vertices and 1 faces, 1 lines follow"),
        ("a.off", b"OFF\n", "is cut off before the numbers of its vertices and faces"),
        ("a.off", b"OFF BINARY\n\x00\x00\x00\x04\x80", "is a binary OFF, which is not read"),
        ("a.off", b"4OFF\n1 0 0\n0 0 0 1\n", "is no OFF of three coordinates"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n", "a face has fewer than three corners"),
        ("a.off", b"OFF\n2 0 0\n0 0 0\n1 0 0 5\n", "its vertices have different numbers of values"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "a.off: "),
        ("a.xyzw", b"", "ends in '.xyzw', expected one of .ply"),
    ],
)
def test_a_damaged_file_is_named_with_its_fault(tmp_path: Path, name: str, content: bytes, sentence: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=sentence):
        read_contents(tmp_path / name)


@pytest.mark.parametrize("colour", ["255 0 51", "1.0 0.0 0.2 1.0"])
def test_colours_of_an_offs_faces_are_those_of_their_corners(tmp_path: Path, colour: str) -> None:
    (tmp_path / "l.off").write_text(L_OFF.replace("0 1 2 3 4 5", f"0 1 2 3 4 5 {colour}"))
    shape = read_model_shape(tmp_path / "l.off")
    assert shape.colours is not None
    assert np.unique(shape.colours, axis=0).tolist() == [[255, 0, 51]]
    assert area(tmp_path / "l.off") == pytest.approx(3)


def test_what_stands_behind_the_triangles_of_an_stl_is_left_out_and_said(tmp_path: Path) -> None:
    BALL.export(tmp_path / "ball.stl")
    (tmp_path / "ball.stl").write_bytes((tmp_path / "ball.stl").read_bytes() + b"\r\n")
    contents = read_contents(tmp_path / "ball.stl")
    assert contents.warnings == ["has 2 bytes behind its triangles, left out"]
    assert len(contents.parts[0].faces) == len(BALL.faces)
