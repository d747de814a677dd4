"""Models as glTF 2.0, in one file (GLB) or several: every mesh of the scene in the pose that its nodes have.

trimesh's reader (5.2) is not used, because it takes glTF's linear vertex colours for sRGB, rounds them to bytes, and
goes on in silence where a picture is missing.
"""

from __future__ import annotations

import base64
import json
import struct
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.geometry.glb import GLB_BINARY, GLB_JSON, GLB_MAGIC, WIDTHS
from recon.geometry.srgb import light_of, light_of_bytes, srgb_bytes
from recon.models.atlas import SLACK
from recon.models.part import Contents, Part, check_finite, decode_picture
from recon.runtime.files import why_no_file

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
POINTS, TRIANGLES, STRIP, FAN = 0, 4, 5, 6
REPEAT = 10497  # of a sampler
INSTANCES, VISIBILITY = "EXT_mesh_gpu_instancing", "KHR_node_visibility"
READ_EXTENSIONS = {
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_texture_webp",
    INSTANCES,
    VISIBILITY,
}
WAYS_OUT = {  # of extensions that a file needs and that are not read, by a part of their names
    "draco": "a compression that is not read; export it without",
    "meshopt": "a compression that is not read; export it without",
    "basisu": "textures as KTX2, which are not read; export them as PNG, JPEG or WebP",
    "gaussian": "splats in glTF, which are not read; save them as PLY, SPZ, .splat, .ksplat or SOG",
    "pbrSpecularGlossiness": "a material that is not read; export it with metal and roughness",
}
LEFT_OUT = {  # extensions that change what is seen, and that a file does not need to have read
    "MSFT_lod": "has levels of detail, of which the finest is shown",
    "KHR_materials_variants": "has variants of its materials, of which the first is shown",
    "KHR_lights_punctual": "has lights, which are not taken",
    "KHR_animation_pointer": "animates more than its nodes, which is not shown",
}
BROKEN = (  # what reading raises where the document says something else than the standard
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    OverflowError,
    RecursionError,
    UnicodeDecodeError,
    json.JSONDecodeError,
)
WRITE_SRGB = ("trimesh", "Open3D")  # programs, as `asset.generator` names them
VertexColours = Literal["linear", "srgb"]
WHITE = 0.998  # vertex colours above that leave a texture as it is


def read_gltf_model(path: Path, vertex_colours: VertexColours | None = None) -> Contents:
    """Read the model of a .glb or .gltf file.

    Parameters
    ----------
    path : of the file
    vertex_colours : what they are, where the standard's "linear" is not true; None where nobody says

    Raises
    ------
    ValueError
        If the file is missing or damaged, a buffer or picture is missing, or it needs an extension that is not read.
    """
    if not path.is_file():
        raise ValueError(why_no_file(path))
    content = path.read_bytes()
    is_binary = path.suffix.lower() == ".glb"
    text, binary = _chunks(content) if is_binary else (content, None)
    contents = Contents([path])
    try:
        reader = _Reader(json.loads(text), binary, contents, vertex_colours)
        reader.check()
        for node, world in reader.placed():
            for primitive in reader.mesh(node)["primitives"]:
                part = reader.part(primitive, node, world)
                if part is not None:
                    contents.parts.append(part)
    except BROKEN as error:
        raise ValueError(f"is not whole glTF: {type(error).__name__} {error}") from error
    return contents


def _way_out(extension: str) -> str:
    """Return what to do about an extension that is not read."""
    ways = (way for part, way in WAYS_OUT.items() if part.lower() in extension.lower())
    return next(ways, "an extension of glTF that is not read; export it without")


def _chunks(content: bytes) -> tuple[bytes, bytes | None]:
    """Return the JSON and the binary part of a GLB."""
    if len(content) < 20:
        raise ValueError(f"is cut off after {len(content)} bytes")
    magic, version, length = struct.unpack("<III", content[:12])
    if magic != GLB_MAGIC or version != 2:
        raise ValueError("is not a GLB file of version 2")
    if length > len(content):
        raise ValueError(f"is cut off: it has {len(content)} bytes, its header says {length}")
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack("<II", content[at : at + 8])
        chunks.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    if GLB_JSON not in chunks:
        raise ValueError("is not whole glTF: it has no JSON part")
    return chunks[GLB_JSON], chunks.get(GLB_BINARY)


class _Reader:
    """Reads the parts of a glTF document, each buffer and picture once."""

    def __init__(
        self,
        document: Mapping[str, Any],
        binary: bytes | None,
        contents: Contents,
        vertex_colours: VertexColours | None,
    ) -> None:
        self._vertex_colours = vertex_colours
        self._document = document
        self._binary = binary
        self._contents = contents
        self._buffers: dict[int, bytes] = {}
        self._pictures: dict[tuple[Any, ...], NDArray[np.uint8]] = {}
        self._worlds: dict[int, NDArray[np.float64]] = {}

    def check(self) -> None:
        """Raise a ValueError if the document cannot be shown as it is, and warn of what is left out."""
        if not str(self._document.get("asset", {}).get("version", "")).startswith("2"):
            raise ValueError("is not glTF of version 2")
        unknown = set(self._document.get("extensionsRequired", ())) - READ_EXTENSIONS
        if unknown:
            raise ValueError(" and ".join(f"it needs {name}, {_way_out(name)}" for name in sorted(unknown)))
        for name in sorted({*self._document.get("extensionsUsed", ())} & set(LEFT_OUT)):
            self._contents.warn(LEFT_OUT[name])
        if self._document.get("animations"):
            self._contents.warn("is animated; only the pose of its nodes is shown")

    def placed(self) -> list[tuple[Mapping[str, Any], NDArray[np.float64]]]:
        """Return the nodes of the scene that have a mesh, each with its transform (4, 4) into the scene."""
        nodes: Sequence[Mapping[str, Any]] = self._document.get("nodes", [])
        scenes = self._document.get("scenes", [])
        if scenes:
            roots = scenes[self._document.get("scene", 0)].get("nodes", [])
        else:
            children = {child for node in nodes for child in node.get("children", ())}
            roots = [index for index in range(len(nodes)) if index not in children]
        placed, waiting = [], deque((index, np.eye(4)) for index in roots)
        while waiting:
            index, parent = waiting.popleft()
            if index in self._worlds:
                raise ValueError(
                    f"its node {index} has two parents, or goes in a circle; glTF has trees of nodes alone"
                )
            node = nodes[index]
            extensions = node.get("extensions", {})
            if not extensions.get(VISIBILITY, {}).get("visible", True):
                self._contents.warn("has nodes that are hidden, and stay so")
                continue
            with np.errstate(invalid="ignore", over="ignore"):  # of numbers that are no transform
                world = parent @ _transform(node)
            check_finite(world, "a row of a node's transform")
            self._worlds[index] = world
            if "mesh" in node and INSTANCES in extensions:
                placed += [(node, world @ place) for place in self._instances(extensions[INSTANCES]["attributes"])]
            elif "mesh" in node:
                placed.append((node, world))
            waiting += [(child, world) for child in node.get("children", ())]
        return placed

    def _instances(self, attributes: Mapping[str, int]) -> list[NDArray[np.float64]]:
        """Return the transform (4, 4) of each instance of a mesh, in its node."""
        parts = {
            entry: self._accessor(attributes[name]).astype(np.float64)
            for name, entry in (("TRANSLATION", "translation"), ("ROTATION", "rotation"), ("SCALE", "scale"))
            if name in attributes
        }
        n_instances = len(next(iter(parts.values()), ()))
        return [_transform({entry: rows[number] for entry, rows in parts.items()}) for number in range(n_instances)]

    def mesh(self, node: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the mesh of a node."""
        mesh: Mapping[str, Any] = self._document["meshes"][node["mesh"]]
        return mesh

    def part(self, primitive: Mapping[str, Any], node: Mapping[str, Any], world: NDArray[np.float64]) -> Part | None:
        """Return a primitive in the scene's axes; None for lines, which are not shown.

        Parameters
        ----------
        primitive : an entry of a mesh
        node : that has the mesh; where it has a skin, the joints' nodes say where the vertices are, and not its own
        world : float64 (4, 4), from the node to the scene
        """
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (POINTS, TRIANGLES, STRIP, FAN):
            self._contents.warn("has lines, which are not shown")
            return None
        attributes = primitive["attributes"]
        weights = node.get("weights", self.mesh(node).get("weights", ()))
        positions = self._morphed(primitive, "POSITION", weights)
        faces = np.zeros((0, 3), np.int64)
        if mode != POINTS:
            n_vertices = len(positions)
            indices = self._accessor(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(n_vertices)
            faces = _triangles(indices.astype(np.int64), mode)
        moves = self._joint_moves(attributes, self._document["skins"][node["skin"]]) if "skin" in node else world
        if np.median(np.linalg.det(moves[..., :3, :3])) < 0:
            faces = faces[:, ::-1]
        normals = None
        if "NORMAL" in attributes:
            turns = moves[..., :3, :3] if "skin" in node else np.linalg.pinv(world[:3, :3]).T
            normals = _applied(turns, self._morphed(primitive, "NORMAL", weights))
        colours, uv, picture = self._look(primitive, attributes, len(positions))
        return Part(_applied(moves[..., :3, :3], positions) + moves[..., :3, 3], faces, normals, colours, uv, picture)

    def _morphed(self, primitive: Mapping[str, Any], name: str, weights: Sequence[float]) -> NDArray[np.float64]:
        """Return an attribute's vectors (N, 3), changed by the morph targets as far as the weights say."""
        vectors = self._accessor(primitive["attributes"][name]).astype(np.float64)
        for target, weight in zip(primitive.get("targets", ()), weights, strict=False):
            if weight and name in target:
                vectors += weight * self._accessor(target[name])
        return vectors

    def _joint_moves(self, attributes: Mapping[str, int], skin: Mapping[str, Any]) -> NDArray[np.float64]:
        """Return each vertex's transform (N, 4, 4) into the scene: the mean of its joints', by their weights."""
        joints = np.array([self._worlds[joint] for joint in skin["joints"]])
        if "inverseBindMatrices" in skin:  # column by column
            joints = joints @ self._accessor(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)
        moves = np.zeros((len(self._accessor(attributes["JOINTS_0"])), 4, 4))
        for number in range(sum(name.startswith("JOINTS_") for name in attributes)):
            which, shares = (self._accessor(attributes[f"{name}_{number}"]) for name in ("JOINTS", "WEIGHTS"))
            for joint, share in zip(which.T, shares.T, strict=True):
                moves += share[:, None, None] * joints[joint]
        return moves

    def _look(
        self, primitive: Mapping[str, Any], attributes: Mapping[str, int], n_vertices: int
    ) -> tuple[NDArray[np.uint8] | None, NDArray[np.floating] | None, NDArray[np.uint8] | None]:
        """Return colours, texture coordinates and picture, each None where there is none."""
        material = self._document["materials"][primitive["material"]] if "material" in primitive else {}
        metallic = material.get("pbrMetallicRoughness", {})
        if "KHR_materials_pbrSpecularGlossiness" in material.get("extensions", {}) and not metallic:
            raise ValueError("its material is KHR_materials_pbrSpecularGlossiness, which is not read; export it anew")
        if material.get("alphaMode", "OPAQUE") != "OPAQUE":
            self._contents.warn("has transparent materials, which are shown opaque")
        factor = np.array(metallic.get("baseColorFactor", [1.0] * 4), dtype=np.float64)[:3]
        linear = self._linear_colours(attributes["COLOR_0"]) if "COLOR_0" in attributes else None
        texture = metallic.get("baseColorTexture")
        if not factor.any():  # black in any light: what it emits is all that shows
            factor = np.array(material.get("emissiveFactor", factor), dtype=np.float64)
            linear, texture = None, material.get("emissiveTexture")
        check_finite(factor[None], "colour factor")
        if texture is None:
            if linear is None:
                has_colour = "baseColorFactor" in metallic
                return (np.tile(srgb_bytes(factor), (n_vertices, 1)) if has_colour else None), None, None
            check_finite(linear, "colour")
            return srgb_bytes(linear * factor), None, None
        if linear is not None and linear.size and linear.min() < WHITE:
            raise ValueError("a material has a texture and vertex colours; bake both into the texture")
        moved = texture.get("extensions", {}).get("KHR_texture_transform", {})
        set_number = moved.get("texCoord", texture.get("texCoord", 0))
        if f"TEXCOORD_{set_number}" not in attributes:
            raise ValueError(f"a textured material has no texture coordinates (TEXCOORD_{set_number})")
        uv = _moved(self._accessor(attributes[f"TEXCOORD_{set_number}"]).astype(np.float64), moved)
        if self._leaves(uv, self._document["textures"][texture["index"]]):
            self._contents.warn("has a texture that shall not repeat beyond its edges, but is repeated instead")
        uv[:, 1] = 1 - uv[:, 1]  # glTF counts from the upper edge
        return None, uv, self._picture(texture["index"], factor)

    def _linear_colours(self, accessor: int) -> NDArray[Any]:
        """Return the vertices' colours (N, 3) in linear light; some programs write sRGB instead."""
        colours = self._accessor(accessor)[:, :3]
        if self._vertex_colours == "srgb":
            check_finite(colours, "colour")
            return light_of(colours)
        writer = str(self._document.get("asset", {}).get("generator", ""))
        program = next((name for name in WRITE_SRGB if name.lower() in writer.lower()), None)
        if program is not None and self._vertex_colours is None:
            self._contents.warn(
                f"was written by {program}, which stores the colours of vertices as sRGB where glTF has linear light: "
                'it is shown too bright, unless scene.json says "vertex_colours": "srgb"; "linear" ends this warning'
            )
        return colours

    def _leaves(self, uv: NDArray[np.float64], texture: Mapping[str, Any]) -> bool:
        """Tell whether places (N, 2) lie beyond an edge of a texture at which it is mirrored or stops."""
        sampler = self._document["samplers"][texture["sampler"]] if "sampler" in texture else {}
        is_beyond = [((places < -SLACK) | (places > 1 + SLACK)).any() for places in uv.T]
        return any(
            beyond and sampler.get(key, REPEAT) != REPEAT
            for beyond, key in zip(is_beyond, ("wrapS", "wrapT"), strict=True)
        )

    def _picture(self, index: int, factor: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the picture of a texture, multiplied by a factor; textures may share one."""
        texture = self._document["textures"][index]
        source = texture.get("extensions", {}).get("EXT_texture_webp", {}).get("source", texture.get("source"))
        if source is None:
            raise ValueError("a texture has no picture that is read (PNG, JPEG or WebP)")
        key = (source, *factor.tolist())
        if key not in self._pictures:
            image = self._document["images"][source]
            if "bufferView" in image:
                content, name = self._view(image["bufferView"]), image.get("name") or f"number {index}"
            else:
                content, name = self._resource(image["uri"], "texture"), image["uri"][:80]
            pixels = decode_picture(content, name)
            if not np.allclose(factor, 1):
                tables = [srgb_bytes(light_of_bytes() * share) for share in factor]
                pixels = np.stack([table[pixels[..., channel]] for channel, table in enumerate(tables)], axis=-1)
            self._pictures[key] = pixels
        return self._pictures[key]

    def _resource(self, uri: str, what: str) -> bytes:
        if uri.startswith("data:"):
            return base64.b64decode(uri.partition(",")[2])
        return self._contents.beside(unquote(uri), what)

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            buffer = self._document["buffers"][index]
            content = self._resource(buffer["uri"], "buffer") if "uri" in buffer else self._binary
            if content is None or len(content) < buffer["byteLength"]:
                n_bytes = 0 if content is None else len(content)
                raise ValueError(f"its buffer {index} is cut off: {n_bytes} of {buffer['byteLength']} bytes are there")
            self._buffers[index] = content
        return self._buffers[index]

    def _view(self, index: int) -> bytes:
        view = self._document["bufferViews"][index]
        start = view.get("byteOffset", 0)
        return self._buffer(view["buffer"])[start : start + view["byteLength"]]

    def _accessor(self, index: int) -> NDArray[Any]:
        """Return an accessor's values (N, width); normalised integers as floats."""
        accessor = self._document["accessors"][index]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise ValueError("it has sparse accessors, which are not read; export it without")
        kind = np.dtype(COMPONENTS[accessor["componentType"]])
        count, width = accessor["count"], WIDTHS[accessor["type"]]
        view = self._document["bufferViews"][accessor["bufferView"]]
        content, start = self._view(accessor["bufferView"]), accessor.get("byteOffset", 0)
        stride = view.get("byteStride") or kind.itemsize * width
        if count < 1 or start + stride * (count - 1) + kind.itemsize * width > len(content):
            raise ValueError(f"its accessor {index} promises {count} values, more than its buffer holds")
        values = np.ndarray((count, width), kind, content, start, (stride, kind.itemsize))
        if accessor.get("normalized"):
            return np.maximum(values / np.float64(np.iinfo(kind).max), -1)
        return values


def _applied(turns: NDArray[np.floating], vectors: NDArray[np.floating]) -> NDArray[np.float64]:
    """Apply one matrix (3, 3), or one for each (N, 3, 3), to vectors (N, 3)."""
    return np.asarray((turns @ vectors[..., None])[..., 0])


def _transform(node: Mapping[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T  # column by column
    transform = np.eye(4)
    rotation = Rotation.from_quat(node["rotation"]).as_matrix() if "rotation" in node else np.eye(3)
    transform[:3, :3] = rotation * np.array(node.get("scale", [1.0] * 3), dtype=np.float64)
    transform[:3, 3] = node.get("translation", [0.0] * 3)
    return transform


def _triangles(indices: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    if mode == TRIANGLES:
        if len(indices) % 3:
            raise ValueError(f"it has {len(indices)} corners of triangles, expected a multiple of 3")
        return indices.reshape(-1, 3)
    n_triangles = max(len(indices) - 2, 0)
    number = np.arange(n_triangles)
    if mode == FAN:
        return np.stack([np.broadcast_to(indices[:1], n_triangles), indices[number + 1], indices[number + 2]], axis=1)
    odd = number % 2
    return np.stack([indices[number], indices[number + 1 + odd], indices[number + 2 - odd]], axis=1)


def _moved(uv: NDArray[np.float64], transform: Mapping[str, Any]) -> NDArray[np.float64]:
    """Apply a KHR_texture_transform to texture coordinates (N, 2): scale, then rotation, then offset."""
    scaled = uv * np.array(transform.get("scale", [1.0, 1.0]))
    cos, sin = np.cos(transform.get("rotation", 0.0)), np.sin(transform.get("rotation", 0.0))
    turned = np.stack([cos * scaled[:, 0] + sin * scaled[:, 1], cos * scaled[:, 1] - sin * scaled[:, 0]], axis=1)
    return np.asarray(turned + np.array(transform.get("offset", [0.0, 0.0])))
