"""What a glTF 2.0 document holds and refers to: buffers, views of them, arrays of numbers, files beside it."""

from __future__ import annotations

import base64
import binascii
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from recon.geometry.glb import GLB_BINARY, GLB_JSON, GLB_MAGIC, WIDTHS
from recon.models.part import Contents

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
MOST_ZEROS = 20_000_000  # rows that a file promises without bytes for them
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


def _way_out(extension: str) -> str:
    """Return what to do about an extension that is not read."""
    ways = (way for part, way in WAYS_OUT.items() if part.lower() in extension.lower())
    return next(ways, "an extension of glTF that is not read; export it without")


def chunks(content: bytes) -> tuple[bytes, bytes | None]:
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


@contextmanager
def named(part: str) -> Iterator[None]:
    """Note with an error in which part of the document it was."""
    try:
        yield
    except Exception as error:
        error.add_note(part)
        raise


def numbers(value: object, n: int, what: str) -> NDArray[np.float64]:
    """Return numbers of a document, float64 (n,).

    Parameters
    ----------
    value : as parsed
    n : how many there must be
    what : they are, for the message

    Raises
    ------
    ValueError
        If it is something else, or one of them is not finite.
    """
    try:
        values = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.array(np.nan)
    if values.shape != (n,) or not np.isfinite(values).all():
        shown = value.tolist() if isinstance(value, np.ndarray) else value
        raise ValueError(f"{what} is {shown!r:.80}, expected {n} finite number{'s' * (n > 1)}")
    return values


class GltfData:
    """A glTF document with its buffers, each read once.

    Parameters
    ----------
    document : as parsed
    binary : of a GLB
    contents : the files beside it, and its warnings
    """

    def __init__(self, document: Mapping[str, Any], binary: bytes | None, contents: Contents) -> None:
        self.document = document
        self.contents = contents
        self._binary = binary
        self._buffers: dict[int, bytes] = {}

    def check(self) -> None:
        """Raise a ValueError if the document cannot be shown as it is, and warn of what is left out."""
        if not str(self.document.get("asset", {}).get("version", "")).startswith("2"):
            raise ValueError("is not glTF of version 2")
        unknown = set(self.document.get("extensionsRequired", ())) - READ_EXTENSIONS
        if unknown:
            raise ValueError(" and ".join(f"it needs {name}, {_way_out(name)}" for name in sorted(unknown)))
        for name in sorted({*self.document.get("extensionsUsed", ())} & set(LEFT_OUT)):
            self.contents.warn(LEFT_OUT[name])
        if self.document.get("animations"):
            self.contents.warn("is animated; only the pose of its nodes is shown")

    def resource(self, uri: str, what: str) -> bytes:
        """Return the bytes that a URI names: its own, or those of a file beside the document."""
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2])
            except binascii.Error as error:
                raise ValueError(f"its {what} is no base64") from error
        return self.contents.beside(unquote(uri), what)

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            buffer = self.entry("buffers", index)
            content = self.resource(buffer["uri"], "buffer") if "uri" in buffer else self._binary
            if content is None or len(content) < buffer["byteLength"]:
                n_bytes = 0 if content is None else len(content)
                raise ValueError(f"its buffer {index} is cut off: {n_bytes} of {buffer['byteLength']} bytes are there")
            self._buffers[index] = content
        return self._buffers[index]

    def entry(self, kind: str, index: int) -> Mapping[str, Any]:
        """Return a part of the document that another one refers to by its number."""
        entries = self.document[kind]
        if not 0 <= index < len(entries):
            raise ValueError(f"it refers to number {index} of {kind}, of which it has {len(entries)}")
        entry: Mapping[str, Any] = entries[index]
        return entry

    def view(self, index: int) -> bytes:
        """Return the bytes of a view of a buffer."""
        view = self.entry("bufferViews", index)
        with named(f"bufferView {index}"):
            start, buffer = view.get("byteOffset", 0), self._buffer(view["buffer"])
            end = start + view["byteLength"]
            if not 0 <= start <= end <= len(buffer):
                raise ValueError(f"its bufferView {index} ends at byte {end} of a buffer of {len(buffer)}")
            return buffer[start:end]

    def accessor(self, index: int, *widths: int, n_rows: int | None = None) -> NDArray[Any]:
        """Return an accessor's values (N, width); normalised integers as floats.

        Parameters
        ----------
        index : its number
        widths : of which it must have one
        n_rows : that it must have; None if any number will do
        """
        accessor = self.entry("accessors", index)
        with named(f"accessor {index}"):
            width = WIDTHS[accessor["type"]]
            if width not in widths:
                wanted = " or ".join(name for name, n in WIDTHS.items() if n in widths)
                raise ValueError(f"its accessor {index} holds {accessor['type']}, expected {wanted}")
            values = self._values(accessor, width, index)
            if n_rows is not None and len(values) != n_rows:
                raise ValueError(f"its accessor {index} has {len(values)} rows, expected {n_rows}")
            if "sparse" in accessor:
                few = accessor["sparse"]
                places = self._values({**few["indices"], "count": few["count"]}, 1, index)[:, 0]
                values = values.copy()
                values[places] = self._values({**accessor, **few["values"], "count": few["count"]}, width, index)
            if accessor.get("normalized") and values.dtype.kind != "f":
                return np.maximum(values / np.float64(np.iinfo(values.dtype).max), -1)
            return values

    def _values(self, accessor: Mapping[str, Any], width: int, index: int) -> NDArray[Any]:
        """Return the numbers (N, width) at a place in a view, zeros without one; `index` is for the message."""
        kind, count = np.dtype(COMPONENTS[accessor["componentType"]]), accessor["count"]
        if "bufferView" not in accessor and 0 < count <= MOST_ZEROS:
            return np.zeros((count, width), kind)
        view = self.entry("bufferViews", accessor["bufferView"])
        content, start = self.view(accessor["bufferView"]), accessor.get("byteOffset", 0)
        stride = view.get("byteStride") or kind.itemsize * width
        if min(start, stride) < 0 or count < 1 or start + stride * (count - 1) + kind.itemsize * width > len(content):
            raise ValueError(f"its accessor {index} promises {count} values, more than its buffer holds")
        return np.ndarray((count, width), kind, content, start, (stride, kind.itemsize))
