"""Packed meshes come back as they were, and files that are none are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow
import pyarrow.parquet
import pytest

from recon.geometry import packed
from recon.geometry.mesh import Mesh, Texture
from recon.geometry.mesh_files import read_mesh, write_mesh
from recon.geometry.packed import packed_bytes
from recon.models.shape import read_model_shape


def wave(n: int = 60) -> Mesh:
    """A surface of n x n vertices with a hole that was filled."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(n), np.arange(n)))
    first = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate([np.stack([first, first + a, first + b], 1) for a, b in ((1, n), (n, n - 1))])
    vertices = np.stack([x, y, np.sin(x / 7) * 9], 1)
    normals = np.stack([-np.cos(x / 7) * 9 / 7, 0 * x, 1 + 0 * x], 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(vertices, faces, normals, np.stack([x, y, x + y], 1).astype(np.uint8), filled=x < 5)


def test_a_packed_mesh_comes_back_with_every_digit(tmp_path: Path) -> None:
    mesh, path = wave(), tmp_path / "a.parquet"
    back = read_mesh(write_mesh(path, mesh))
    for name in ("vertices", "faces", "normals", "colours", "filled"):
        assert np.array_equal(getattr(back, name), getattr(mesh, name)), name
    assert packed_bytes(back) == path.read_bytes()
    assert path.stat().st_size < write_mesh(tmp_path / "a.ply", mesh).stat().st_size / 2
    assert np.array_equal(read_model_shape(path).points, mesh.vertices)


def test_a_packed_mesh_keeps_its_texture(tmp_path: Path) -> None:
    mesh, pixels = wave(), np.random.default_rng(1).integers(0, 256, (9, 7, 3), np.uint8)
    texture = Texture(pixels, np.random.default_rng(2).uniform(0, 1, (len(mesh.vertices), 2)).astype(np.float32))
    back = read_mesh(write_mesh(tmp_path / "a.parquet", replace(mesh, texture=texture))).texture
    assert back is not None
    assert np.array_equal(back.pixels, pixels)
    assert np.array_equal(back.uv, texture.uv)


def test_other_tables_and_damaged_files_are_refused(tmp_path: Path) -> None:
    path, content = tmp_path / "a.parquet", packed_bytes(wave())
    votes = pyarrow.table({"participant": ["p1", "p2"], "choice": ["a", "b"]})
    flat = pyarrow.table({name: [1.0] for name in ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue")})
    for table in (votes, flat):
        pyarrow.parquet.write_table(table, path)
        with pytest.raises(ValueError, match=r"a\.parquet: is no whole packed mesh: it has \d rows of .* expected one"):
            read_mesh(path)
    for damaged in (b"", b"PAR1", content[:-9], content[: len(content) // 2], content.replace(b"PAR1", b"PAR2")):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"a\.parquet: is no whole packed mesh"):
            read_mesh(path)


def test_a_small_file_that_promises_a_huge_mesh_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packed, "ALWAYS", 2**20)
    path, mesh = tmp_path / "a.parquet", wave(4)
    table = pyarrow.parquet.read_table(write_mesh(path, mesh))
    zeros = pyarrow.ListArray.from_arrays(pyarrow.array([0, 3_000_000], pyarrow.int32()), np.zeros(3_000_000, np.uint8))
    column = table.column_names.index("vertex_indices")
    pyarrow.parquet.write_table(table.set_column(column, "vertex_indices", zeros), path, compression="zstd")
    assert path.stat().st_size < 20_000
    with pytest.raises(ValueError, match=r"it would have \d+ bytes unpacked, \d+ times as many as it has"):
        read_mesh(path)
