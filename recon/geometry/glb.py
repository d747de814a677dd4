"""GLB, the format that 3D viewers open: binary glTF 2.0.

trimesh (5.2) writes the bytes of sRGB as if they were linear, so that viewers show its colours too bright, has no unlit
material, and takes twice as long (0.8 s for a mesh of 2.7 million triangles). pygltflib holds the JSON part as objects
and leaves the buffers, which are most of this module, to its caller.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Mesh, Texture
from recon.geometry.srgb import light_of_bytes

GLB_MAGIC, GLB_JSON, GLB_BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942  # glTF 2.0, section 4.4
GENERATOR = "reconstudy"
COMPONENTS = {5123: "<u2", 5125: "<u4", 5126: "<f4"}  # section 3.6.2
COMPONENT_OF = {kind: component for component, kind in COMPONENTS.items()}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
KINDS = {width: kind for kind, width in WIDTHS.items()}
FILLED = "_FILLED"  # names that begin so are an application's own, section 3.7.2.1
METRES_PER_MM = 0.001  # glTF's unit of length is the metre


def glb_bytes(mesh: Mesh) -> bytes:
    """Encode a mesh as binary glTF 2.0, unlit and visible from both sides; it holds the texture as PNG."""
    scene = GltfScene()
    scene.add(mesh)
    document = scene.document([None])
    binary = scene.next_buffer()
    binary += b"\0" * (-len(binary) % 4)
    text = json.dumps(document, separators=(",", ":")).encode("ascii")
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), GLB_JSON) + text + struct.pack("<II", len(binary), GLB_BINARY) + binary
    return struct.pack("<III", GLB_MAGIC, 2, 12 + len(chunks)) + chunks


def png_of(texture: Texture) -> bytes:
    """Return the picture of a texture as PNG."""
    return bytes(cv2.imencode(".png", texture.pixels[..., ::-1])[1].tobytes())


def picture_of(png: bytes) -> NDArray[np.uint8]:
    """Return the pixels, uint8 (H, W, 3), of what `png_of` encoded."""
    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR_RGB)
    if pixels is None:
        raise ValueError("its texture is not readable as PNG")
    return np.asarray(pixels, np.uint8)


class GltfScene:
    """A document of glTF to which meshes are added one by one: a node each, unlit and visible from both sides."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self._done: list[int] = []  # bytes of the buffers before
        self._nodes: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._views: list[dict[str, Any]] = []
        self._images: list[dict[str, Any]] = []
        self._channels: list[dict[str, Any]] = []
        self._samplers: list[dict[str, Any]] = []

    def next_buffer(self) -> bytes:
        """Return the bytes that were added since the last one, and begin another buffer."""
        binary, self.binary = bytes(self.binary), bytearray()
        self._done.append(len(binary))
        return binary

    def add(self, mesh: Mesh, uri: str | None = None) -> None:
        """Add a mesh; `uri` names the file of its picture, which else goes into the buffer."""
        attributes: dict[str, NDArray[Any]] = {"POSITION": mesh.vertices, "NORMAL": mesh.normals}
        if mesh.texture is None:
            attributes["COLOR_0"] = np.full((len(mesh.colours), 4), 65535, "<u2")
            attributes["COLOR_0"][:, :3] = _linear_from_srgb()[mesh.colours]
        else:
            attributes["TEXCOORD_0"] = _turned(mesh.texture.uv)
        if mesh.filled is not None:
            attributes[FILLED] = mesh.filled.astype("<f4")
        named = {name: self._array(name, array, 34962) for name, array in attributes.items()}
        indices = self._array("indices", mesh.faces.astype("<u4").ravel(), 34963)
        surface: dict[str, Any] = {"metallicFactor": 0, "roughnessFactor": 1}
        if mesh.texture is not None:
            inside = {"bufferView": self._view(png_of(mesh.texture)), "mimeType": "image/png"} if uri is None else {}
            self._images.append(inside or {"uri": uri})
            surface["baseColorTexture"] = {"index": len(self._images) - 1}
        number = len(self._meshes)
        primitive = {"attributes": named, "indices": indices, "material": number, "mode": 4}
        self._nodes.append({"mesh": number, "scale": [METRES_PER_MM] * 3})
        self._meshes.append({"primitives": [primitive]})
        self._materials.append(
            {"doubleSided": True, "pbrMetallicRoughness": surface, "extensions": {"KHR_materials_unlit": {}}}
        )

    def show_in_turn(self, fps: float) -> None:
        """Show the meshes one after another, by steps of their nodes' scales: what all programs play."""
        n_meshes = len(self._nodes)
        for number, node in enumerate(self._nodes):
            node["name"] = f"{number:04d}"
            begins, ends = number / fps, (number + 1) / fps
            times = [0.0] * (number > 0) + [begins] + [ends] * (number < n_meshes - 1)
            shown = [0.0] * (number > 0) + [METRES_PER_MM] + [0.0] * (number < n_meshes - 1)
            scales = np.repeat(np.array(shown, "<f4")[:, None], 3, axis=1)
            given, taken = self._array("times", np.array(times, "<f4")), self._array("scales", scales)
            self._samplers.append({"input": given, "output": taken, "interpolation": "STEP"})
            self._channels.append({"sampler": number, "target": {"node": number, "path": "scale"}})
            if number:
                node["scale"] = [0.0] * 3  # where nothing moves, the first one is shown

    def document(self, uris: Sequence[str | None]) -> dict[str, Any]:
        """Return the document.

        Parameters
        ----------
        uris : of the buffers; None for that of a GLB
        """
        sizes = [*self._done, len(self.binary)] if len(uris) > len(self._done) else self._done
        buffers = [
            {"byteLength": size} | ({} if uri is None else {"uri": uri}) for size, uri in zip(sizes, uris, strict=True)
        ]
        document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": GENERATOR},
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self._nodes)))}],
            "nodes": self._nodes,
            "meshes": self._meshes,
            "materials": self._materials,
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": buffers,
        }
        if self._images:
            document["images"] = self._images
            document["samplers"] = [{"magFilter": 9729, "minFilter": 9987, "wrapS": 10497, "wrapT": 10497}]  # repeating
            document["textures"] = [{"source": number, "sampler": 0} for number in range(len(self._images))]
        if self._channels:
            document["animations"] = [{"name": "frames", "channels": self._channels, "samplers": self._samplers}]
        return document

    def _array(self, name: str, array: NDArray[Any], target: int | None = None) -> int:
        view = self._view(array.tobytes(), {} if target is None else {"target": target})
        component, kind = COMPONENT_OF[array.dtype.newbyteorder("<").str], KINDS[array[:1].size]
        accessor: dict[str, Any] = {"bufferView": view, "componentType": component, "count": len(array), "type": kind}
        if name == "POSITION":
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        if name == "times":
            accessor |= {"min": [float(array.min())], "max": [float(array.max())]}
        if name == "COLOR_0":
            accessor["normalized"] = True
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def _view(self, content: bytes, more: Mapping[str, int] | None = None) -> int:
        place = {"buffer": len(self._done), "byteOffset": len(self.binary), "byteLength": len(content)}
        self._views.append({**place, **(more or {})})
        self.binary += content
        return len(self._views) - 1


def read_glb(content: bytes) -> Mesh:
    """Decode what `glb_bytes` encoded: a mesh of a run.

    Raises
    ------
    ValueError
        If the file is cut off, or was written by another program, or its texture is no PNG.
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
        filled = arrays[FILLED][:, 0] > 0 if FILLED in arrays else None
        if "COLOR_0" in arrays:
            colours = np.searchsorted(_linear_from_srgb(), arrays["COLOR_0"][:, :3]).astype(np.uint8)
            return Mesh(vertices, faces.astype(np.int32), normals, colours, filled=filled)
        uv, picture = _turned(arrays["TEXCOORD_0"]), document["bufferViews"][-1]
        start = 28 + n_text + picture["byteOffset"]
        png = content[start : start + picture["byteLength"]]
    except (ValueError, KeyError, IndexError, struct.error, TypeError) as error:
        raise ValueError(f"is no whole GLB that reconstudy wrote: {error}; expected a mesh of a run") from error
    texture = Texture(picture_of(png), uv)
    return Mesh(vertices, faces.astype(np.int32), normals, texture.at_vertices(), texture, filled)


def _turned(uv: NDArray[np.float32]) -> NDArray[np.float32]:
    """Count places (N, 2) in a picture from its upper left corner instead of its lower left one, or back."""
    return np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)


def _linear_from_srgb() -> NDArray[np.uint16]:
    """Tabulate the linear light of each sRGB byte, uint16 (256,)."""
    return np.asarray(np.rint(light_of_bytes() * 65535), dtype=np.uint16)
