"""NPY files are read whole, or refused by a sentence that names them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from recon.runtime.npy import read_npy

HEADER = b"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }"


def npy(header: bytes) -> bytes:
    return b"\x93NUMPY\x01\x00v\x00" + header.ljust(117) + b"\n" + bytes(16)


def test_what_numpy_wrote_is_read_as_it_was(tmp_path: Path) -> None:
    values = np.arange(6, dtype=np.int16).reshape(2, 3)
    np.save(tmp_path / "a.npy", values)
    again = read_npy(tmp_path / "a.npy")
    assert again.dtype == values.dtype
    np.testing.assert_array_equal(again, values)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"something",
        b"PK\x03\x04 an archive, cut off",
        npy(HEADER)[:-1],
        npy(HEADER.replace(b"}", b"")),  # a TokenError
        npy(HEADER.replace(b"2, 2", b"02, 2")),  # a SyntaxError
        npy(HEADER.replace(b"'descr'", b"b'descr'")),  # a TypeError
        npy(HEADER.replace(b"2, 2", b"9" * 30)),  # an OverflowError
        npy(HEADER.replace(b"<f4", b"|O")),
    ],
)
def test_a_damaged_file_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npy").write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.npy: is not readable as NPY: \w"):
        read_npy(tmp_path / "a.npy")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"a\.npy: cannot be read: no such file or directory"):
        read_npy(tmp_path / "a.npy")
