"""Models as PLY, text or binary: triangles or polygons, point clouds, colours of points or faces, or one texture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recon.geometry.ply import (
    FLOAT_NORMAL,
    UINT8_COLOUR,
    face_corners,
    number_columns,
    optional_columns,
    point_columns,
    read_ply,
)
from recon.geometry.ply_elements import Elements, Lists
from recon.geometry.polygons import cut_polygons
from recon.models.part import Contents, Part, cloud_part, colours_from, decode_picture, split_corners

COLOURS = (UINT8_COLOUR, ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
PLACES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
CORNER_PLACES = "texcoord"  # six numbers a face, as MeshLab writes them
TEXTURE_FILE = "texturefile"
GAUSSIANS = {"f_dc_0", "packed_position"}  # what points of Gaussian splats have, plain and compressed


def read_ply_model(path: Path) -> Contents:
    """Read the model of a PLY file.

    Raises
    ------
    ValueError
        If the file or its texture is missing or damaged, or is a Gaussian splat.
    """
    ply = read_ply(path)
    contents = Contents([path])
    if any(name in ply.columns("vertex") for name in GAUSSIANS):
        raise ValueError(
            "it holds Gaussian splats, which have no surface to be measured; `render` films them, and `validate views` "
            "compares them with photographs"
        )
    vertices = np.asarray(point_columns(path, ply, "xyz"), dtype=np.float64)
    normals = optional_columns(path, ply, FLOAT_NORMAL)
    colours = optional_columns(path, ply, *COLOURS)
    shades = None if colours is None else colours_from(colours)
    uv = optional_columns(path, ply, *PLACES)
    faces, polygons, corner_uv = _faces(ply, vertices)
    pictures = [
        comment.split(None, 1)[1].strip()
        for comment in ply.comments
        if comment.lower().startswith(TEXTURE_FILE) and len(comment.split(None, 1)) == 2
    ]
    if len(pictures) > 1:
        raise ValueError(f"it names {len(pictures)} textures, expected one; save it as OBJ or GLB, or bake one texture")
    if not len(faces):
        contents.parts.append(cloud_part(contents, vertices, normals, shades))
        return contents
    faces, used = _without_strays(contents, vertices, faces)
    vertices = vertices[used]
    normals = None if normals is None else normals[used]
    shades = None if shades is None else shades[used]
    uv = None if uv is None else uv[used]
    if not pictures or (uv is None and corner_uv is None):
        part, of_faces = Part(vertices, faces, normals, shades), _face_colours(ply)
        if shades is None and of_faces is not None:
            part = split_corners(part, polygons, of_faces)
        contents.parts.append(part)
        return contents
    picture = decode_picture(contents.beside(pictures[0], "texture"), pictures[0])
    whole = Part(vertices, faces, normals)
    if corner_uv is not None:
        whole, uv = split_corners(whole, polygons), corner_uv.reshape(-1, 2)
    contents.parts.append(Part(whole.vertices, whole.faces, whole.normals, None, uv, picture))
    return contents


def _without_strays(
    contents: Contents, vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return faces among the vertices that are left (N,) of those without finite coordinates that no face names."""
    is_kept = np.asarray(np.isfinite(vertices).all(axis=1), np.bool_)
    if not is_kept.all():
        is_kept[faces[(faces >= 0).all(axis=1) & (faces < len(vertices)).all(axis=1)]] = True
    if is_kept.all():
        return faces, is_kept
    contents.warn(f"has {np.count_nonzero(~is_kept)} points without finite coordinates that no face names, left out")
    return np.asarray((np.cumsum(is_kept) - 1)[faces], np.int64), is_kept


def _faces(
    ply: Elements, vertices: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.floating] | None]:
    """Return triangles (M, 3), the face (M,) of each, and their corners' places (M, 3, 2) if they have any."""
    lists = face_corners(ply)
    if lists is None:
        return np.zeros((0, 3), np.int64), np.zeros(0, np.int64), None
    counts = lists.lengths
    places, polygons = cut_polygons(vertices, lists.values, counts)
    triangles = lists.values[places].astype(np.int64)
    uv = ply.columns("face").get(CORNER_PLACES)
    if uv is None:
        return triangles, polygons, None
    if not isinstance(uv, Lists) or (uv.lengths != 2 * counts).any():
        raise ValueError("its faces have not two texture coordinates for each corner")
    return triangles, polygons, uv.values.astype(np.float64).reshape(-1, 2)[places]


def _face_colours(ply: Elements) -> NDArray[np.uint8] | None:
    """Return the colours of faces, uint8 (P, 3), None where they have none."""
    names = next((names for names in COLOURS if all(name in ply.columns("face") for name in names)), None)
    return None if names is None else colours_from(number_columns(ply, "face", names))
