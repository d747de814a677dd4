"""Scanners' clouds are read as the programs that wrote them mean them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from recon.models.part import NEUTRAL
from recon.models.read import read_contents
from recon.models.shape import read_model_shape
from recon.runtime.backend import open3d
from recon.runtime.notices import Notice

RNG = np.random.default_rng(5)
POINTS = RNG.uniform(-5, 5, (200, 3)).astype(np.float32)
COLOURS = RNG.integers(0, 256, (200, 3)).astype(np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ascii", "binary", "compressed"])
def test_a_pcd_of_each_kind_has_its_points_normals_and_colours(tmp_path: Path, kind: str) -> None:
    library = open3d()
    cloud = library.geometry.PointCloud(library.utility.Vector3dVector(POINTS.astype(float)))
    cloud.colors = library.utility.Vector3dVector(COLOURS / 255)
    cloud.normals = library.utility.Vector3dVector(np.tile([0.0, 0, 1], (200, 1)))
    path = tmp_path / "a.pcd"
    library.io.write_point_cloud(str(path), cloud, write_ascii=kind == "ascii", compressed=kind == "compressed")
    shape = read_model_shape(path)
    np.testing.assert_allclose(shape.points, POINTS, atol=1e-5)
    assert shape.colours is not None
    np.testing.assert_array_equal(shape.colours, COLOURS)
    assert shape.normals is not None


HEADER = (
    "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\nDATA {kind}\n"
)


@pytest.mark.slow
def test_points_that_a_depth_camera_did_not_see_are_left_out_and_counted(tmp_path: Path) -> None:
    (tmp_path / "a.pcd").write_text(HEADER.format(n=3, kind="ascii") + "0 0 1\nnan nan nan\n1 0 1\n")
    with pytest.warns(Notice, match="has 1 of 3 points without finite coordinates, left out"):
        assert len(read_model_shape(tmp_path / "a.pcd").points) == 2


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        (
            "a.pcd",
            HEADER.format(n=10**12, kind="binary") + "x" * 24,
            "announces 1000000000000 points, more than its 24",
        ),
        ("a.pcd", HEADER.format(n=10**9, kind="binary_compressed") + "x" * 24, "announces 1000000000 points, more"),
        ("a.pcd", HEADER.format(n=3, kind="binary_compressed") + "x" * 24, "announces 3 points, 0 could be read"),
        ("a.pcd", HEADER.format(n=3, kind="ascii") + "0 0 0\n", "announces 3 points, more than its 6 bytes"),
        ("a.pcd", HEADER.replace(" z", "").format(n=3, kind="ascii"), "is no PCD of points"),
        ("a.pcd", HEADER.replace("COUNT 1", "COUNT -1").format(n=3, kind="ascii"), "its header has COUNT -1 1 1"),
        ("a.pcd", HEADER.replace("SIZE 4", "SIZE 3").format(n=3, kind="ascii"), "its header has SIZE 3 4 4"),
        ("a.pcd", HEADER.replace("HEIGHT 1", "HEIGHT 2").format(n=3, kind="ascii"), "but its WIDTH and HEIGHT do not"),
        ("a.pcd", HEADER.format(n="", kind="ascii"), "its header has .* , expected a whole number from 1"),
        ("a.pcd", "no header", "is no PCD: its header has no line DATA"),
    ],
)
def test_a_damaged_pcd_is_named_before_its_size_is_believed(
    tmp_path: Path, name: str, content: str, sentence: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(ValueError, match=sentence):
        read_contents(tmp_path / name)


def test_a_las_whose_header_ends_before_what_its_version_has_is_refused(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    las = laspy.LasData(laspy.LasHeader(point_format=3, version="1.2"))
    las.x, las.y, las.z = POINTS[:3].T.astype(float)
    las.write(tmp_path / "a.las")
    content = bytearray((tmp_path / "a.las").read_bytes())
    content[25] = 107  # the minor version
    (tmp_path / "a.las").write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.las: is not readable as LAS"):
        read_contents(tmp_path / "a.las")


@pytest.mark.parametrize("name", ["a.las", "a.laz"])
def test_a_las_has_its_points_and_colours_of_16_bits(tmp_path: Path, name: str) -> None:
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=7, version="1.4")
    header.scales, header.offsets = np.array([1e-3] * 3), np.array([0.0, 0, 0])
    las = laspy.LasData(header)
    las.x, las.y, las.z = POINTS.T.astype(float)
    las.red, las.green, las.blue = COLOURS.T.astype(np.uint16) * 257
    las.write(str(tmp_path / name))
    shape = read_model_shape(tmp_path / name)
    np.testing.assert_allclose(shape.points, POINTS, atol=1e-3)
    assert shape.colours is not None
    np.testing.assert_array_equal(shape.colours, COLOURS)
    content = bytearray((tmp_path / name).read_bytes())
    struct.pack_into("<Q", content, 247, 10**13)  # the count of LAS 1.4
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=r"announces 10000000000000 points, more than its \d+ bytes can hold"):
        read_contents(tmp_path / name)
    if name.endswith("laz"):
        las.write(str(tmp_path / name))
        content = bytearray((tmp_path / name).read_bytes())
        table_at = int.from_bytes(content[int.from_bytes(content[96:100], "little") :][:8], "little")
        content[table_at + 4 : table_at + 8] = b"\xff\xff\xff\x7f"
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ValueError, match="announces 2147483647 chunks"):
            read_contents(tmp_path / name)
    content = bytearray((tmp_path / name).read_bytes())
    struct.pack_into("<I", content, 100, 2**31)  # as many records would be looked for
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match="announces 2147483648 records"):
        read_contents(tmp_path / name)
    (tmp_path / name).write_bytes(b"LASF" + bytes(100))
    with pytest.raises(ValueError, match="is not readable as LAS"):
        read_contents(tmp_path / name)


def test_scans_of_an_e57_stand_where_their_poses_put_them(tmp_path: Path) -> None:
    pye57 = pytest.importorskip("pye57")
    path = tmp_path / "a.e57"
    file = pye57.E57(str(path), mode="w")
    columns = {f"cartesian{axis}": POINTS[:, place].astype(float) for place, axis in enumerate("XYZ")}
    columns |= {f"color{name}": COLOURS[:, place] for place, name in enumerate(("Red", "Green", "Blue"))}
    file.write_scan_raw(columns, name="first", rotation=np.array([1.0, 0, 0, 0]), translation=np.zeros(3))
    file.write_scan_raw(
        columns, name="second", rotation=np.array([0, 0, 0, 1.0]), translation=np.array([100.0, 0, 0])
    )  # half a turn
    file.close()
    shape = read_model_shape(path)
    np.testing.assert_allclose(shape.points[:200], POINTS, atol=1e-4)
    np.testing.assert_allclose(shape.points[200:], POINTS * [-1, -1, 1] + [100, 0, 0], atol=1e-4)
    assert shape.colours is not None
    np.testing.assert_array_equal(shape.colours[:200], COLOURS)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(ValueError, match="is not readable as E57"):
        read_contents(path)


def test_scans_of_an_e57_without_colours_are_grey_among_others(tmp_path: Path) -> None:
    pye57 = pytest.importorskip("pye57")
    file = pye57.E57(str(tmp_path / "a.e57"), mode="w")
    columns = {f"cartesian{axis}": POINTS[:, place].astype(float) for place, axis in enumerate("XYZ")}
    file.write_scan_raw(columns)
    file.write_scan_raw(columns | {f"color{name}": COLOURS[:, 0] for name in ("Red", "Green", "Blue")})
    file.close()
    contents = read_contents(tmp_path / "a.e57")
    assert contents.warnings == ["has no colours in 1 of 2 scans, which are shown grey"]
    np.testing.assert_array_equal(
        contents.parts[0].colours, [[NEUTRAL] * 3] * 200 + [[red] * 3 for red in COLOURS[:, 0]]
    )
