"""Packed meshes: Parquet files of one row with a list for each property, less than half as large as PLY.

Zstandard packs them, the first bytes of all numbers together and so on (`BYTE_STREAM_SPLIT`): those of neighbours are
alike. No digit is lost.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.glb import picture_of, png_of
from recon.geometry.mesh import Mesh, Texture
from recon.geometry.ply import FLOAT_NORMAL, UINT8_COLOUR, vector_columns

PACKED = ".parquet"
FACES, PLACES, FILLED, PICTURE = "vertex_indices", ("u", "v"), "filled", "picture"  # the last one is PNG
NEEDED = (*"xyz", *FLOAT_NORMAL, FACES)
LEVEL = 2  # of Zstandard: 4 % smaller than by 1; 3 saves as much again and takes 1.6 times as long
ALWAYS, MOST_TIMES = 2**28, 100  # bytes that a mesh may have, and how much larger than its file; of a run it is 5 times
NUMBER_BYTES = 4


def packed_bytes(mesh: Mesh) -> bytes:
    """Encode a mesh, with its texture where it has one."""
    import pyarrow  # heavy, and of this form alone
    import pyarrow.parquet

    columns: dict[str, NDArray[Any]] = vector_columns("xyz", mesh.vertices)
    columns |= vector_columns(FLOAT_NORMAL, mesh.normals)
    textured = mesh.texture
    columns |= vector_columns(*((UINT8_COLOUR, mesh.colours) if textured is None else (PLACES, textured.uv)))
    columns |= {} if mesh.filled is None else {FILLED: mesh.filled.astype(np.uint8)}
    columns[FACES] = mesh.faces.ravel()
    row: dict[str, Any] = {
        name: pyarrow.ListArray.from_arrays(
            pyarrow.array([0, len(values)], pyarrow.int32()), np.ascontiguousarray(values)
        )
        for name, values in columns.items()
    }
    if textured is not None:
        row[PICTURE] = pyarrow.array([png_of(textured)])
    content = BytesIO()
    pyarrow.parquet.write_table(
        pyarrow.table(row),
        content,
        compression="zstd",
        compression_level=LEVEL,
        use_dictionary=False,
        write_statistics=False,
        column_encoding={f"{name}.list.element": "BYTE_STREAM_SPLIT" for name in columns},
    )
    return content.getvalue()


def read_packed(path: Path) -> Mesh:
    """Read what `packed_bytes` encoded.

    Raises
    ------
    ValueError
        If the file is damaged, another table, or far smaller than what it promises; the message lacks its name.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            _check(file, path.stat().st_size)
            table = file.read(use_threads=False)
        row = {name: table.column(name).combine_chunks() for name in table.column_names}
        lists = {name: np.asarray(values.flatten()) for name, values in row.items() if name != PICTURE}
        vertices, normals = _vectors(lists, "xyz"), _vectors(lists, FLOAT_NORMAL)
        faces, filled = lists[FACES].reshape(-1, 3), lists[FILLED] > 0 if FILLED in lists else None
        if not len(faces):
            raise ValueError("it holds no faces")
        if PICTURE not in row:
            return Mesh(vertices, faces, normals, _vectors(lists, UINT8_COLOUR), filled=filled)
        texture = Texture(picture_of(row[PICTURE][0].as_py()), _vectors(lists, PLACES))
        return Mesh(vertices, faces, normals, texture.at_vertices(), texture, filled)
    except (ValueError, KeyError, OSError, pyarrow.ArrowException) as error:
        raise ValueError(f"is no whole packed mesh: {error}") from error


def _check(file: Any, n_bytes: int) -> None:
    """Raise a ValueError if a Parquet file of `n_bytes` is another table, or unpacks to far more."""
    described, schema = file.metadata, file.schema_arrow
    fields = {field.name: str(field.type) for field in schema}
    missing = [name for name in NEEDED if name not in fields]
    others = [
        name for name, kind in fields.items() if not kind.startswith("list<") and (name, kind) != (PICTURE, "binary")
    ]
    if missing or others or described.num_rows != 1:
        raise ValueError(
            f"it has {described.num_rows} rows of {', '.join(fields)}; expected one, with lists {', '.join(NEEDED)}"
        )
    group = described.row_group(0)
    chunks = [group.column(number) for number in range(group.num_columns)]
    size = sum(max(chunk.total_uncompressed_size, NUMBER_BYTES * chunk.num_values) for chunk in chunks)
    if size > max(ALWAYS, MOST_TIMES * n_bytes):
        raise ValueError(f"it would have {size} bytes unpacked, {size // n_bytes} times as many as it has")


def _vectors(lists: Mapping[str, NDArray[Any]], names: Sequence[str]) -> NDArray[Any]:
    return np.column_stack([lists[name] for name in names])
