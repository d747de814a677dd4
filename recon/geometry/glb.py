"""GLB, the format that 3D viewers open: binary glTF 2.0.

trimesh (5.2) writes the bytes of sRGB as if they were linear, so that viewers show its colours too bright, has no unlit
material, and takes twice as long (0.8 s for a mesh of 2.7 million triangles). pygltflib holds the JSON part as objects
and leaves the buffers, which are most of this module, to its caller.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.srgb import light_of_bytes

GLB_MAGIC, GLB_JSON, GLB_BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942  # glTF 2.0, section 4.4
GENERATOR = "reconstudy"
COMPONENTS = {5123: "<u2", 5125: "<u4", 5126: "<f4"}  # section 3.6.2
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
FILLED = "_FILLED"  # names that begin so are an application's own, section 3.7.2.1
METRES_PER_MM = 0.001  # glTF's unit of length is the metre


def glb_bytes(
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    normals: NDArray[np.float32],
    colours: NDArray[np.uint8],
    filled: NDArray[np.bool_] | None = None,
) -> bytes:
    """Encode a mesh with a colour on every vertex as binary glTF 2.0, unlit and visible from both sides.

    Parameters
    ----------
    vertices : float32 (N, 3), mm
    faces : int32 (M, 3)
    normals : float32 (N, 3), unit length
    colours : uint8 (N, 3), sRGB
    filled : bool (N,), as of `Mesh`
    """
    linear = np.full((len(colours), 4), 65535, dtype="<u2")
    linear[:, :3] = _linear_from_srgb()[colours]
    return _glb(vertices, faces, normals, ("COLOR_0", linear, 5123, "VEC4"), filled=filled)


def textured_glb_bytes(
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    normals: NDArray[np.float32],
    uv: NDArray[np.float32],
    png: bytes,
    filled: NDArray[np.bool_] | None = None,
) -> bytes:
    """Encode a textured mesh as binary glTF 2.0, unlit and visible from both sides.

    Parameters
    ----------
    vertices : float32 (N, 3), mm
    faces : int32 (M, 3)
    normals : float32 (N, 3), unit length
    uv : float32 (N, 2), (0, 0) is the lower left corner of the picture; glTF counts from the upper left one
    png : the picture, sRGB, which glTF expects in textures
    filled : bool (N,), as of `Mesh`
    """
    places = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1).astype("<f4")
    return _glb(vertices, faces, normals, ("TEXCOORD_0", places, 5126, "VEC2"), png, filled)


def _glb(
    vertices: NDArray[np.float32],
    faces: NDArray[np.int32],
    normals: NDArray[np.float32],
    colouring: tuple[str, NDArray[Any], int, str],
    png: bytes = b"",
    filled: NDArray[np.bool_] | None = None,
) -> bytes:
    """Encode a mesh whose vertices carry linear colours, or places in a picture."""
    arrays = [
        ("POSITION", vertices.astype("<f4"), 5126, "VEC3", 34962),
        ("NORMAL", normals.astype("<f4"), 5126, "VEC3", 34962),
        (*colouring, 34962),
        *([] if filled is None else [(FILLED, filled.astype("<f4"), 5126, "SCALAR", 34962)]),
        ("indices", faces.astype("<u4").ravel(), 5125, "SCALAR", 34963),
    ]
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    for name, array, component, kind, target in arrays:
        offset = sum(view["byteLength"] for view in views)
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": array.nbytes, "target": target})
        accessors.append({"bufferView": len(accessors), "componentType": component, "count": len(array), "type": kind})
        if name == "POSITION":
            accessors[-1] |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        if name == "COLOR_0":
            accessors[-1]["normalized"] = True
    binary = b"".join(array.tobytes() for _, array, *_ in arrays)
    attributes = {name: index for index, (name, *_) in enumerate(arrays) if name != "indices"}
    surface: dict[str, Any] = {"metallicFactor": 0, "roughnessFactor": 1}
    document = {
        "asset": {"version": "2.0", "generator": GENERATOR},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "scale": [METRES_PER_MM] * 3}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": len(attributes), "material": 0, "mode": 4}]}],
        "materials": [
            {"doubleSided": True, "pbrMetallicRoughness": surface, "extensions": {"KHR_materials_unlit": {}}}
        ],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary) + len(png)}],
    }
    if png:
        surface["baseColorTexture"] = {"index": 0}
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(png)})
        document["images"] = [{"bufferView": len(views) - 1, "mimeType": "image/png"}]
        document["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}]  # repeating
        document["textures"] = [{"source": 0, "sampler": 0}]
        binary += png + b"\0" * (-len(png) % 4)
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), GLB_JSON) + text + struct.pack("<II", len(binary), GLB_BINARY) + binary
    return struct.pack("<III", GLB_MAGIC, 2, 12 + len(chunks)) + chunks


def read_glb(
    content: bytes,
) -> tuple[
    NDArray[np.float32],
    NDArray[np.int32],
    NDArray[np.float32],
    NDArray[np.uint8] | NDArray[np.float32],
    bytes,
    NDArray[np.bool_] | None,
]:
    """Decode what `glb_bytes` or `textured_glb_bytes` encoded: the files of a run.

    Returns
    -------
    vertices : float32 (N, 3), mm
    faces : int32 (M, 3)
    normals : float32 (N, 3)
    colours or uv : uint8 (N, 3), sRGB, or float32 (N, 2) as encoded
    png : the picture, empty where vertices have colours
    filled : bool (N,), None where the file does not say

    Raises
    ------
    ValueError
        If the file is cut off, or was written by another program.
    """
    try:
        magic, version, length = struct.unpack("<III", content[:12])
        n_text = struct.unpack("<I", content[12:16])[0]
        document = json.loads(content[20 : 20 + n_text])
        if (magic, version, length) != (GLB_MAGIC, 2, len(content)) or document["asset"]["generator"] != GENERATOR:
            raise ValueError("it is cut off, or by another program")
        names = [*document["meshes"][0]["primitives"][0]["attributes"], "indices"]
        arrays = {}
        for name, accessor, view in zip(names, document["accessors"], document["bufferViews"], strict=False):
            kind, width = COMPONENTS[accessor["componentType"]], WIDTHS[accessor["type"]]
            start, count = 28 + n_text + view["byteOffset"], accessor["count"] * width
            arrays[name] = np.frombuffer(content, kind, count, start).reshape(-1, width)
        vertices, faces, normals = arrays["POSITION"], arrays["indices"].reshape(-1, 3), arrays["NORMAL"]
        if "COLOR_0" in arrays:
            colouring, png = np.searchsorted(_linear_from_srgb(), arrays["COLOR_0"][:, :3]).astype(np.uint8), b""
        else:
            uv, picture = arrays["TEXCOORD_0"], document["bufferViews"][-1]
            colouring = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)
            start = 28 + n_text + picture["byteOffset"]
            png = content[start : start + picture["byteLength"]]
    except (ValueError, KeyError, IndexError, struct.error, TypeError) as error:
        raise ValueError(f"is no whole GLB that reconstudy wrote: {error}; expected a mesh of a run") from error
    filled = arrays[FILLED][:, 0] > 0 if FILLED in arrays else None
    return vertices, faces.astype(np.int32), normals, colouring, png, filled


def _linear_from_srgb() -> NDArray[np.uint16]:
    """Tabulate the linear light of each sRGB byte, uint16 (256,)."""
    return np.asarray(np.rint(light_of_bytes() * 65535), dtype=np.uint16)
