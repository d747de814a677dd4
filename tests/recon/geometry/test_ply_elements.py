"""A PLY file's elements come back as they were written, in every form, and a damaged file is named."""

from __future__ import annotations

import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from recon.geometry.ply_elements import Lists, read_elements

FORMS = ("ascii", "binary_little_endian", "binary_big_endian")
HEADER = """ply
format {form} 1.0
comment made by hand
element vertex {n_vertices}
property float x
property uchar grey
element face {n_faces}
property ushort part
property list uchar int vertex_indices
property list short float places
end_header
"""
Vertex = tuple[float, int]
Face = tuple[int, list[int], list[float]]
FLOATS = st.floats(-1e6, 1e6, width=32)
VERTICES = st.lists(st.tuples(FLOATS, st.integers(0, 255)), max_size=4)
FACES = st.lists(
    st.tuples(
        st.integers(0, 65535),
        st.lists(st.integers(-(2**31), 2**31 - 1), max_size=4),
        st.lists(FLOATS, max_size=3),
    ),
    max_size=5,
)


def written(form: str, vertices: list[Vertex], faces: list[Face]) -> bytes:
    """Write the elements number by number, as the format's description says."""
    header = HEADER.format(form=form, n_vertices=len(vertices), n_faces=len(faces)).encode()
    if form == "ascii":
        rows = [[x, grey] for x, grey in vertices]
        rows += [[part, len(corners), *corners, len(places), *places] for part, corners, places in faces]
        return header + "".join(" ".join(map(repr, row)) + "\n" for row in rows).encode()
    order = "<" if form == "binary_little_endian" else ">"
    content = b"".join(struct.pack(f"{order}fB", *vertex) for vertex in vertices)
    for part, corners, places in faces:
        content += struct.pack(f"{order}HB{len(corners)}i", part, len(corners), *corners)
        content += struct.pack(f"{order}h{len(places)}f", len(places), *places)
    return header + content


def split(lists: object) -> list[list[float]]:
    assert isinstance(lists, Lists)
    return (
        [part.tolist() for part in np.split(lists.values, np.cumsum(lists.lengths)[:-1])] if len(lists.lengths) else []
    )


@given(st.sampled_from(FORMS), VERTICES, FACES)
def test_all_elements_come_back_as_they_were_written(form: str, vertices: list[Vertex], faces: list[Face]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.ply"
        path.write_bytes(written(form, vertices, faces))
        read = read_elements(path)
        assert read.comments == ("made by hand",)
        points, polygons = read.elements["vertex"].columns, read.elements["face"].columns
        assert list(zip(np.asarray(points["x"]), np.asarray(points["grey"]), strict=True)) == vertices
        assert np.asarray(polygons["part"]).tolist() == [part for part, _, _ in faces]
        assert split(polygons["vertex_indices"]) == [corners for _, corners, _ in faces]
        assert split(polygons["places"]) == [places for _, _, places in faces]


@pytest.mark.parametrize("form", FORMS[1:])
@pytest.mark.parametrize("faces", [[(7, [0, 1, 2], [0.5])] * 3, [(7, [0, 1, 2], [0.5]), (8, [0, 1, 2, 3], [])]])
def test_a_binary_file_cut_anywhere_is_refused(tmp_path: Path, form: str, faces: list[Face]) -> None:
    whole = written(form, [(1.5, 3)], faces)
    for n_bytes in range(len(whole)):
        (tmp_path / "a.ply").write_bytes(whole[:n_bytes])
        with pytest.raises(ValueError, match=r"ends within|ends after|promises|end_header|line ply"):
            read_elements(tmp_path / "a.ply")


DAMAGED = {
    "a letter": ("7 x 0 1 2 1 0", r"row 0 of face is '7 x 0 1 2 1 0', expected numbers"),
    "short": ("7 3 0 1", "row 0 of face ends before its last property"),
    "long": ("7 3 0 1 2 1 0 5", "row 0 of face goes on after its last property"),
    "negative": ("7 -3 0", "it has -3, out of bounds for the uint8"),
    "half": ("7 2.5 0 1", "it has 2.5, out of bounds for the uint8"),
    "negative list": ("7 1 0 -2", "row 0 of face has a list of -2 numbers"),
    "no row": ("", "it ends after 0 rows of face, expected 1"),
}


@pytest.mark.parametrize(("row", "complaint"), DAMAGED.values(), ids=DAMAGED)
def test_a_row_of_text_that_is_no_face_is_named(tmp_path: Path, row: str, complaint: str) -> None:
    (tmp_path / "a.ply").write_text(HEADER.format(form="ascii", n_vertices=1, n_faces=1) + f"0 0\n{row}\n")
    with pytest.raises(ValueError, match=complaint):
        read_elements(tmp_path / "a.ply")


LIST_OF_MANY = "element face 2\nproperty list uint double vertex_indices\n"
HEADERS = {
    "format": ("element vertex 1\n", "has no line format, expected format ascii 1.0"),
    "version": ("format ascii 2.0\n", r"has the line 'format ascii 2.0', which says nothing"),
    "type": ("format ascii 1.0\nelement vertex 1\nproperty half x\n", "line 'property half x', expected a property"),
    "twice": ("format ascii 1.0\nelement v 1\nproperty int x\nproperty int x\n", "two properties x of one element"),
    "minus": ("format ascii 1.0\nelement vertex -1\n", "promises -1 rows"),
    "many": (f"format ascii 1.0\nelement vertex {10**20}\n", "promises 100000000000000000000 rows"),
    "a long list": (f"format binary_little_endian 1.0\n{LIST_OF_MANY}", "it ends within row 0 of face"),
}


@pytest.mark.parametrize(("lines", "complaint"), HEADERS.values(), ids=HEADERS)
def test_a_header_that_promises_what_cannot_be_is_named(tmp_path: Path, lines: str, complaint: str) -> None:
    (tmp_path / "a.ply").write_bytes(f"ply\n{lines}end_header\n".encode() + b"\xff" * 64)
    with pytest.raises(ValueError, match=complaint):
        read_elements(tmp_path / "a.ply")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_may_end_as_on_any_system_and_data_may_begin_like_a_line_feed(tmp_path: Path, end: str) -> None:
    header = end.join(
        ["ply", "format binary_little_endian 1.0", "element vertex 1", "property uchar x", "end_header", ""]
    )
    (tmp_path / "a.ply").write_bytes(header.encode() + b"\n")
    assert np.asarray(read_elements(tmp_path / "a.ply").elements["vertex"].columns["x"]).tolist() == [10]


def test_a_last_line_of_the_header_that_ends_otherwise_than_the_first_is_read(tmp_path: Path) -> None:
    header = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar x\nend_header\r\n"
    (tmp_path / "a.ply").write_bytes(header + b"\x07")
    assert np.asarray(read_elements(tmp_path / "a.ply").elements["vertex"].columns["x"]).tolist() == [7]


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_another_programs_mesh_is_the_same(tmp_path: Path, encoding: str) -> None:
    ball = trimesh.creation.icosphere(2)
    (tmp_path / "ball.ply").write_bytes(trimesh.exchange.ply.export_ply(ball, encoding=encoding))
    read = read_elements(tmp_path / "ball.ply")
    points = np.column_stack([np.asarray(read.elements["vertex"].columns[axis]) for axis in "xyz"])
    corners = read.elements["face"].columns["vertex_indices"]
    assert isinstance(corners, Lists)
    assert np.allclose(points, ball.vertices, atol=1e-6)
    assert np.array_equal(corners.values.reshape(-1, 3), ball.faces)
