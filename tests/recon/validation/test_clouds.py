"""Clouds as text, as scanners and other programs write it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from recon.validation.clouds import read_measured, read_shape


def write(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_text(text, encoding=encoding)
    return path


@pytest.mark.parametrize(
    "text", ["1.5 2 -3e1\n4 5 6\n", "1.5,2,-30,255,0,0\r\n4,5,6,0,0,0\r\n", "// X, Y, Z\n1.5, 2, -30\n\n# end\n4\t5\t6"]
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_points_are_read_from_text_of_other_programs(tmp_path: Path, text: str, encoding: str) -> None:
    path = write(tmp_path / "cloud.xyz", text, encoding)
    assert read_measured(path).tolist() == [[1.5, 2, -30], [4, 5, 6]]


@pytest.mark.parametrize("text", ["143,106 13,004 -2639,865\n", "0 0 0\n143 13 -2639,8 255 0 0\n", "1,5\t2,5\t3,5"])
def test_decimal_commas_are_never_taken_for_other_coordinates(tmp_path: Path, text: str) -> None:
    path = write(tmp_path / "cloud.txt", text)
    with pytest.raises(ValueError, match=r"cloud.txt: line [12] is '.*', with decimal commas; write decimal points"):
        read_shape(path)


@pytest.mark.parametrize("line", ["x,y,z", "1.5;2.5;3.5", "1 2", "nan nan nan", "1 2 inf", "1 2 z"])
def test_a_line_without_three_finite_numbers_is_named(tmp_path: Path, line: str) -> None:
    path = write(tmp_path / "cloud.csv", f"1 2 3\n{line}\n")
    for read in (read_shape, read_measured):
        with pytest.raises(ValueError, match=rf"cloud.csv: line 2 is {re.escape(repr(line))}, expected finite numbers"):
            read(path)


def test_the_count_that_begins_a_scanners_pts_file_is_no_point(tmp_path: Path) -> None:
    path = write(tmp_path / "scan.pts", "2\n1 2 3 -900 10 20 30\n4 5 6 -900 10 20 30\n")
    assert np.array_equal(read_shape(path).points, [[1, 2, 3], [4, 5, 6]])
    with pytest.raises(ValueError, match=r"promises 3 points, 2 follow; is it cut off\?"):
        read_shape(write(path, "3\n1 2 3\n4 5 6\n"))


def test_text_without_points_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"cloud.xyz: holds no points"):
        read_shape(write(tmp_path / "cloud.xyz", "# nothing\n"))


@pytest.mark.parametrize("name", ["a.ply", "a.obj", "a.glb", "a.xyz", "truth"])
def test_a_folder_where_a_cloud_should_be_is_called_a_folder(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    for read in (read_measured, read_shape):
        with pytest.raises(ValueError, match=f"{name}: is a folder, expected a file"):
            read(tmp_path / name)


def test_a_shape_that_single_precision_blurs_where_it_stands_is_refused(tmp_path: Path) -> None:
    corners = [(5e8, 4.5e9, 0), (5e8 + 1000, 4.5e9, 0), (5e8, 4.5e9 + 1800, 0)]
    for suffix in (".xyz", ".obj"):
        text = "".join(f"{'v ' * (suffix == '.obj')}{x} {y} {z}\n" for x, y, z in corners)
        with pytest.raises(ValueError, match=rf"far{suffix}: its points, .* lie up to 4.5e\+09 from the origin"):
            read_shape(write(tmp_path / f"far{suffix}", text))
