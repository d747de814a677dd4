"""Models as glTF 2.0, in one file (GLB) or several: every mesh of the scene in the pose that its nodes have.

trimesh's reader (5.2) is not used, because it takes glTF's linear vertex colours for sRGB, rounds them to bytes, and
goes on in silence where a picture is missing.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.geometry.srgb import light_of, light_of_bytes, srgb_bytes
from recon.models.atlas import SLACK
from recon.models.gltf.data import INSTANCES, VISIBILITY, GltfData, chunks, numbers
from recon.models.part import Contents, Part, check_finite, decode_picture
from recon.runtime.files import why_no_file

POINTS, TRIANGLES, STRIP, FAN = 0, 4, 5, 6
REPEAT = 10497  # of a sampler
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
MOST_PARTS = 100_000  # each takes time, and a small file can name one mesh very often
WRITE_SRGB = ("trimesh", "Open3D")  # programs, as `asset.generator` names them
VertexColours = Literal["linear", "srgb"]
QUATERNION_TOLERANCE = 0.01  # of its length
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
    text, binary = chunks(content) if is_binary else (content, None)
    contents = Contents([path])
    try:
        data = GltfData(json.loads(text), binary, contents)
        with np.errstate(invalid="ignore", over="ignore"):  # of numbers that are none, which are named where they show
            _read_parts(data, _Reader(data, vertex_colours))
    except BROKEN as error:
        places = "".join(f", in its {part}" for part in getattr(error, "__notes__", ())[:1])
        raise ValueError(f"is not whole glTF: {_plain(error)}{places}; export it again") from error
    return contents


def _read_parts(data: GltfData, reader: _Reader) -> None:
    """Read the parts of all meshes that the document shows into its contents."""
    data.check()
    placed = reader.placed()
    _check_parts(sum(len(reader.mesh(node)["primitives"]) for node, _ in placed))
    for node, world in placed:
        for primitive in reader.mesh(node)["primitives"]:
            part = reader.part(primitive, node, world)
            if part is not None:
                data.contents.parts.append(part)


def _check_parts(n_parts: int) -> None:
    if n_parts > MOST_PARTS:
        raise ValueError(f"it shows {n_parts} parts, expected at most {MOST_PARTS}; join those that repeat")


def _plain(error: Exception) -> str:
    """Say in words what Python found in a document that says something else than the standard."""
    if isinstance(error, ValueError):
        return f"it is no JSON: {error}"
    if isinstance(error, KeyError):
        return f"{error.args[0]!r} is missing, or is no value of the standard's"
    return (
        "it refers to a part it lacks"
        if isinstance(error, IndexError)
        else "a value is of another kind than it must be"
    )


class _Reader:
    """Reads the parts of a glTF document, each picture once."""

    def __init__(self, data: GltfData, vertex_colours: VertexColours | None) -> None:
        self._vertex_colours = vertex_colours
        self._data = data
        self._document = data.document
        self._contents = data.contents
        self._pictures: dict[tuple[Any, ...], NDArray[np.uint8]] = {}
        self._worlds: dict[int, NDArray[np.float64]] = {}

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
            node = self._data.entry("nodes", index)
            extensions = node.get("extensions", {})
            if not extensions.get(VISIBILITY, {}).get("visible", True):
                self._contents.warn("has nodes that are hidden, and stay so")
                continue
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
        parts: dict[str, NDArray[np.float64]] = {}
        n_instances: int | None = None
        for name, width in (("TRANSLATION", 3), ("ROTATION", 4), ("SCALE", 3)):
            if name in attributes:
                rows = self._data.accessor(attributes[name], width, n_rows=n_instances)
                parts[name.lower()], n_instances = rows.astype(np.float64), len(rows)
                _check_parts(n_instances)
        return [
            _transform({entry: rows[number] for entry, rows in parts.items()}) for number in range(n_instances or 0)
        ]

    def mesh(self, node: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the mesh of a node."""
        return self._data.entry("meshes", node["mesh"])

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
        given = node.get("weights", self.mesh(node).get("weights", ()))
        weights = numbers(given, len(given), "the weights of a mesh")
        positions = self._morphed(primitive, "POSITION", weights)
        faces = np.zeros((0, 3), np.int64)
        if mode != POINTS:
            n_vertices = len(positions)
            indices = (
                self._data.accessor(primitive["indices"], 1)[:, 0] if "indices" in primitive else np.arange(n_vertices)
            )
            faces = _triangles(indices.astype(np.int64), mode)
        moves = world
        if "skin" in node:
            moves = self._joint_moves(attributes, self._data.entry("skins", node["skin"]), len(positions))
        if np.median(np.linalg.det(moves[..., :3, :3])) < 0:
            faces = faces[:, ::-1]
        normals = None
        if "NORMAL" in attributes:
            turns = moves[..., :3, :3] if "skin" in node else np.linalg.pinv(world[:3, :3]).T
            normals = _applied(turns, self._morphed(primitive, "NORMAL", weights, len(positions)))
        colours, uv, picture = self._look(primitive, attributes, len(positions))
        return Part(_applied(moves[..., :3, :3], positions) + moves[..., :3, 3], faces, normals, colours, uv, picture)

    def _morphed(
        self, primitive: Mapping[str, Any], name: str, weights: NDArray[np.float64], n_rows: int | None = None
    ) -> NDArray[np.float64]:
        """Return an attribute's vectors (N, 3), changed by the morph targets as far as the weights say."""
        vectors = self._data.accessor(primitive["attributes"][name], 3, n_rows=n_rows).astype(np.float64)
        for target, weight in zip(primitive.get("targets", ()), weights, strict=False):
            if weight and name in target:
                vectors += weight * self._data.accessor(target[name], 3, n_rows=len(vectors))
        return vectors

    def _joint_moves(
        self, attributes: Mapping[str, int], skin: Mapping[str, Any], n_vertices: int
    ) -> NDArray[np.float64]:
        """Return each vertex's transform (N, 4, 4) into the scene: the mean of its joints', by their weights."""
        joints = np.array([self._worlds[joint] for joint in skin["joints"]]).reshape(-1, 4, 4)
        if "inverseBindMatrices" in skin:  # column by column; there may be more of them
            inverse = self._data.accessor(skin["inverseBindMatrices"], 16)[: len(joints)]
            if len(inverse) < len(joints):
                raise ValueError(
                    f"its accessor {skin['inverseBindMatrices']} has no matrix for each of {len(joints)} joints"
                )
            joints = joints @ inverse.reshape(-1, 4, 4).transpose(0, 2, 1)
        moves = np.zeros((n_vertices, 4, 4))
        for number in range(sum(name.startswith("JOINTS_") for name in attributes)):
            which, shares = (
                self._data.accessor(attributes[f"{name}_{number}"], 4, n_rows=n_vertices)
                for name in ("JOINTS", "WEIGHTS")
            )
            for joint, share in zip(which.T, shares.T, strict=True):
                moves += share[:, None, None] * joints[joint]
        return moves

    def _look(
        self, primitive: Mapping[str, Any], attributes: Mapping[str, int], n_vertices: int
    ) -> tuple[NDArray[np.uint8] | None, NDArray[np.floating] | None, NDArray[np.uint8] | None]:
        """Return colours, texture coordinates and picture, each None where there is none."""
        material = self._data.entry("materials", primitive["material"]) if "material" in primitive else {}
        metallic = material.get("pbrMetallicRoughness", {})
        if "KHR_materials_pbrSpecularGlossiness" in material.get("extensions", {}) and not metallic:
            raise ValueError("its material is KHR_materials_pbrSpecularGlossiness, which is not read; export it anew")
        if material.get("alphaMode", "OPAQUE") != "OPAQUE":
            self._contents.warn("has transparent materials, which are shown opaque")
        factor = numbers(metallic.get("baseColorFactor", [1.0] * 4)[:3], 3, "the baseColorFactor of a material")
        linear = self._linear_colours(attributes["COLOR_0"]) if "COLOR_0" in attributes else None
        texture = metallic.get("baseColorTexture")
        if not factor.any():  # black in any light: what it emits is all that shows
            factor = numbers(material.get("emissiveFactor", factor), 3, "the emissiveFactor of a material")
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
        uv = _moved(self._data.accessor(attributes[f"TEXCOORD_{set_number}"], 2).astype(np.float64), moved)
        if self._leaves(uv, self._data.entry("textures", texture["index"])):
            self._contents.warn("has a texture that shall not repeat beyond its edges, but is repeated instead")
        uv[:, 1] = 1 - uv[:, 1]  # glTF counts from the upper edge
        return None, uv, self._picture(texture["index"], factor)

    def _linear_colours(self, accessor: int) -> NDArray[Any]:
        """Return the vertices' colours (N, 3) in linear light; some programs write sRGB instead."""
        colours = self._data.accessor(accessor, 3, 4)[:, :3]
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
        sampler = self._data.entry("samplers", texture["sampler"]) if "sampler" in texture else {}
        is_beyond = [((places < -SLACK) | (places > 1 + SLACK)).any() for places in uv.T]
        return any(
            beyond and sampler.get(key, REPEAT) != REPEAT
            for beyond, key in zip(is_beyond, ("wrapS", "wrapT"), strict=True)
        )

    def _picture(self, index: int, factor: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return the picture of a texture, multiplied by a factor; textures may share one."""
        texture = self._data.entry("textures", index)
        source = texture.get("extensions", {}).get("EXT_texture_webp", {}).get("source", texture.get("source"))
        if source is None:
            raise ValueError("a texture has no picture that is read (PNG, JPEG or WebP)")
        key = (source, *factor.tolist())
        if key not in self._pictures:
            image = self._data.entry("images", source)
            if "bufferView" in image:
                content, name = self._data.view(image["bufferView"]), image.get("name") or f"number {index}"
            else:
                content, name = self._data.resource(image["uri"], "texture"), image["uri"][:80]
            pixels = decode_picture(content, name)
            if not np.allclose(factor, 1):
                tables = [srgb_bytes(light_of_bytes() * share) for share in factor]
                pixels = np.stack([table[pixels[..., channel]] for channel, table in enumerate(tables)], axis=-1)
            self._pictures[key] = pixels
        return self._pictures[key]


def _applied(turns: NDArray[np.floating], vectors: NDArray[np.floating]) -> NDArray[np.float64]:
    """Apply one matrix (3, 3), or one for each (N, 3, 3), to vectors (N, 3)."""
    return np.asarray((turns @ vectors[..., None])[..., 0])


def _transform(node: Mapping[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        return numbers(node["matrix"], 16, "the matrix of a node").reshape(4, 4).T  # column by column
    transform = np.eye(4)
    turn = numbers(node.get("rotation", [0.0, 0.0, 0.0, 1.0]), 4, "the rotation of a node")
    if not abs(float(np.linalg.norm(turn)) - 1) <= QUATERNION_TOLERANCE:
        raise ValueError(f"the rotation of a node is {turn.tolist()}, expected a quaternion of the length 1")
    rotation = Rotation.from_quat(turn).as_matrix()
    transform[:3, :3] = rotation * numbers(node.get("scale", [1.0] * 3), 3, "the scale of a node")
    transform[:3, 3] = numbers(node.get("translation", [0.0] * 3), 3, "the translation of a node")
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
    scale, offset = (
        numbers(transform.get(name, [value] * 2), 2, f"the {name} of a texture")
        for name, value in (("scale", 1.0), ("offset", 0.0))
    )
    (angle,) = numbers([transform.get("rotation", 0.0)], 1, "the rotation of a texture")
    scaled, cos, sin = uv * scale, np.cos(angle), np.sin(angle)
    turned = np.stack([cos * scaled[:, 0] + sin * scaled[:, 1], cos * scaled[:, 1] - sin * scaled[:, 0]], axis=1)
    return np.asarray(turned + offset)
