"""Disparity maps on disk."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from recon.depth.disparity_io import colour_preview, read_disparity, write_disparity


def a_map(seed: int = 0, height: int = 5, width: int = 9) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    disparity = rng.normal(30, 20, (height, width)).astype(np.float32)
    disparity[rng.random((height, width)) < 0.3] = np.nan
    return disparity


@pytest.mark.parametrize("suffix", [".pfm", ".npy", ".tiff", ".tif"])
@settings(deadline=None)
@given(seed=st.integers(0, 1000), height=st.integers(1, 8), width=st.integers(1, 8))
def test_what_is_written_is_read_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, seed: int, height: int, width: int
) -> None:
    path = tmp_path_factory.mktemp("maps") / f"map{suffix}"
    disparity = a_map(seed, height, width)
    write_disparity(path, disparity)
    np.testing.assert_array_equal(read_disparity(path), disparity)


def test_pfm_is_little_endian_bottom_row_first_and_has_infinity_where_unmatched(tmp_path: Path) -> None:
    write_disparity(tmp_path / "map.pfm", np.array([[1, 2], [3, np.nan]], np.float32))
    content = (tmp_path / "map.pfm").read_bytes()
    assert content == b"Pf\n2 2\n-1.0\n" + np.array([3, np.inf, 1, 2], "<f4").tobytes()


def test_pfm_of_opencv_reads_alike(tmp_path: Path) -> None:
    disparity = np.nan_to_num(a_map(), nan=7)
    write_disparity(tmp_path / "map.pfm", disparity)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "map.pfm"), cv2.IMREAD_UNCHANGED), disparity)


def test_a_big_endian_pfm_is_understood(tmp_path: Path) -> None:
    (tmp_path / "map.pfm").write_bytes(b"Pf\n2 2\n1.0\n" + np.array([3, np.inf, 1, 2], ">f4").tobytes())
    np.testing.assert_array_equal(read_disparity(tmp_path / "map.pfm"), [[1, 2], [3, np.nan]])


def test_unmatched_is_nan_in_npy_and_tiff(tmp_path: Path) -> None:
    disparity = a_map()
    write_disparity(tmp_path / "map.npy", disparity)
    write_disparity(tmp_path / "map.tiff", disparity)
    np.testing.assert_array_equal(np.load(tmp_path / "map.npy"), disparity)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "map.tiff"), cv2.IMREAD_UNCHANGED), disparity)


def test_a_tiff_of_a_person_before_a_masked_background_is_small_and_read_by_other_programs(tmp_path: Path) -> None:
    disparity = np.full((200, 100), np.nan, np.float32)
    disparity[50:150, 30:60] = np.linspace(40, 60, 100, dtype=np.float32)[:, None]
    write_disparity(tmp_path / "map.tiff", disparity)
    with Image.open(tmp_path / "map.tiff") as image:
        np.testing.assert_array_equal(image, disparity)
    assert (tmp_path / "map.tiff").stat().st_size < disparity.nbytes / 7


def test_the_preview_shows_near_warm_far_cold_and_unmatched_black(tmp_path: Path) -> None:
    disparity = np.repeat(np.linspace(0, 10, 50, dtype=np.float32)[None], 8, axis=0)
    disparity[:, 20] = np.nan
    write_disparity(tmp_path / "map.png", disparity)
    red_last = np.asarray(cv2.imread(str(tmp_path / "map.png"))).astype(int)
    assert (red_last[:, 20] == 0).all()
    assert (red_last[:, 2, 0] > red_last[:, 2, 2]).all()
    assert (red_last[:, 47, 2] > red_last[:, 47, 0]).all()


def test_a_map_without_a_match_has_a_black_preview() -> None:
    assert not colour_preview(np.full((3, 4), np.nan)).any()


def test_an_unknown_suffix_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"unknown format '\.exr'; expected \.pfm"):
        write_disparity(tmp_path / "map.exr", a_map())
    with pytest.raises(ValueError, match="two dimensions"):
        write_disparity(tmp_path / "map.pfm", np.zeros((2, 2, 2)))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("map.pfm", b"Pf\n2 2\n-1.0\n" + bytes(15), "holds 15 bytes of numbers, 2x2 needs 16"),
        ("map.pfm", b"PF\n2 2\n-1.0\n" + bytes(48), "is not a one-channel PFM"),
        ("map.pfm", b"Pf\n2 x\n", "the header is damaged"),
        ("map.npy", b"something", "is not readable as NPY"),
        ("map.npy", b"PK\x03\x04 an archive, cut off", "is not readable as NPY"),
        ("map.npy", b"\x93NUMPY\x01\x00\x02\x00{\n", "is not readable as NPY"),  # numpy raises a TokenError
        ("map.tiff", b"something", "is not readable as TIFF"),
        ("map.png", b"something", "a PNG is a coloured preview"),
    ],
)
def test_a_damaged_file_is_named_with_its_fault(tmp_path: Path, name: str, content: bytes, sentence: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=sentence) as raised:
        read_disparity(tmp_path / name)
    assert str(tmp_path / name) in str(raised.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="there is no such file"):
        read_disparity(tmp_path / "map.pfm")
