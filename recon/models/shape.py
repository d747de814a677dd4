"""The shape of a model of any format, to be measured: points and triangles as the file has them."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Shape, Texture, stacked_faces
from recon.models.part import Part
from recon.models.read import GLTF_SUFFIXES, read_contents
from recon.runtime.notices import Notice

GLTF_MM = 1000.0  # glTF's unit is the metre (glTF 2.0, section 3.4)


def read_model_shape(path: Path) -> Shape:
    """Read all parts of a model as one shape, float32, in the file's unit; glTF in mm.

    Normals that are all 0, which programs write that know none, are left out. A `Notice` says what else is.

    Raises
    ------
    ValueError
        If a file is missing or damaged, or holds no points; the message begins with the path.
    """
    contents = read_contents(path)
    for warning in contents.warnings:
        warnings.warn(f"{path}: {warning}", Notice, stacklevel=2)
    parts = [part for part in contents.parts if len(part.vertices)]
    if not parts:
        raise ValueError(f"{path}: holds neither faces nor points")
    scale = GLTF_MM if path.suffix.lower() in GLTF_SUFFIXES else 1.0
    normals = [part.normals for part in parts if part.normals is not None and part.normals.any()]
    colours = [shades for part in parts if (shades := _colours(part)) is not None]
    return Shape(
        (np.concatenate([part.vertices for part in parts]) * scale).astype(np.float32),
        stacked_faces([part.faces for part in parts], [len(part.vertices) for part in parts]),
        np.concatenate(normals).astype(np.float32) if len(normals) == len(parts) else None,
        np.concatenate(colours) if len(colours) == len(parts) else None,
    )


def _colours(part: Part) -> NDArray[np.uint8] | None:
    if part.picture is None or part.uv is None:
        return part.colours
    return Texture(part.picture, part.uv.astype(np.float32)).at_vertices()
