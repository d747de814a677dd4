"""PLY, the format of clouds and meshes: what is written, and what a file's tables hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

FLOAT_NORMAL = ("nx", "ny", "nz")
UINT8_COLOUR = ("red", "green", "blue")
PLY_TYPES = {"<f4": "float", "|u1": "uchar"}


def vertex_table(
    points: NDArray[np.float32],
    normals: NDArray[np.float32],
    colours: NDArray[np.uint8],
    more: Mapping[str, NDArray[np.floating]] = MappingProxyType({}),
) -> NDArray[np.void]:
    fields = [(name, "<f4") for name in ("x", "y", "z", *FLOAT_NORMAL)] + [(name, "|u1") for name in UINT8_COLOUR]
    table = np.empty(len(points), np.dtype(fields + [(name, "<f4") for name in more]))
    for axis in range(3):
        table["xyz"[axis]] = points[:, axis]
        table[FLOAT_NORMAL[axis]] = normals[:, axis]
        table[UINT8_COLOUR[axis]] = colours[:, axis]
    for name, values in more.items():
        table[name] = values
    return table


def ply_header(vertices: NDArray[np.void], n_faces: int | None = None) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property {PLY_TYPES[vertices.dtype[name].str]} {name}" for name in vertices.dtype.names or ()]
    if n_faces is not None:
        lines += [f"element face {n_faces}", "property list uchar int vertex_indices"]
    return "\n".join([*lines, "end_header", ""]).encode("ascii")


def face_bytes(faces: NDArray[np.integer]) -> bytes:
    table = np.empty(len(faces), np.dtype([("count", "|u1"), ("index", "<i4", (3,))]))
    table["count"] = 3
    table["index"] = faces
    return table.tobytes()


def read_elements(path: Path) -> dict[str, Any]:
    """The elements of a PLY file as trimesh parses them, once it is certain that there are any."""
    from trimesh.exchange.ply import load_ply  # here, because clouds and meshes are used where trimesh is not installed

    if not path.is_file():
        raise ValueError(f"{path}: there is no such file")
    try:
        with path.open("rb") as file:
            elements: dict[str, Any] = load_ply(file, fix_texture=False, skip_materials=True)["metadata"]["_ply_raw"]
    except Exception as error:  # its parser raises whatever a damaged header leads to
        raise ValueError(f"{path}: is not a whole PLY file: {type(error).__name__}: {error}") from error
    if not elements.get("vertex", {}).get("length"):
        raise ValueError(f"{path}: holds no points")
    return elements


def columns(path: Path, elements: dict[str, Any], names: Sequence[str]) -> NDArray[Any]:
    missing = [name for name in names if name not in elements["vertex"]["properties"]]
    if missing:
        raise ValueError(f"{path}: its points have no {', '.join(missing)}")
    columns = np.column_stack([elements["vertex"]["data"][name] for name in names])
    if len(columns) != elements["vertex"]["length"]:
        raise ValueError(f"{path}: holds {len(columns)} points where its header says {elements['vertex']['length']}")
    return columns


def oriented_colours(
    path: Path, elements: dict[str, Any]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]:
    points, normals, colours = (
        columns(path, elements, names) for names in (("x", "y", "z"), FLOAT_NORMAL, UINT8_COLOUR)
    )
    return points, normals, colours


def face_table(path: Path, elements: dict[str, Any]) -> NDArray[np.integer]:
    element = elements.get("face", {})
    name = next((name for name in ("vertex_indices", "vertex_index") if name in element.get("properties", {})), None)
    if not element.get("length") or name is None:
        raise ValueError(f"{path}: holds no faces")
    column = element["data"][name]
    faces = np.asarray(column["f1"] if column.dtype.names else column)
    if faces.shape != (element["length"], 3):
        raise ValueError(f"{path}: its faces have shape {faces.shape}, expected {element['length']} triangles")
    if not isinstance(element["data"], dict) and (column["f0"] != 3).any():
        raise ValueError(f"{path}: its faces are no triangles throughout")
    return faces
