"""Models as PLY, text or binary: triangles or polygons, point clouds, colours of points or faces, or one texture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData

from recon.geometry.ply import FLOAT_NORMAL, UINT8_COLOUR, face_list, optional_columns, point_columns, read_ply
from recon.models.part import Contents, Part, colours_from, decode_picture, fan

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
    if any(name in ply["vertex"] for name in GAUSSIANS):
        raise ValueError(
            "it holds Gaussians, which only their own program draws; let that film them along SET/paths/DATASET.json, "
            "and bring the video in by `reconstudy stimuli import`"
        )
    vertices = np.asarray(point_columns(path, ply, "xyz"), dtype=np.float64)
    normals = optional_columns(path, ply, FLOAT_NORMAL)
    colours = optional_columns(path, ply, *COLOURS)
    shades = None if colours is None else colours_from(colours)
    uv = optional_columns(path, ply, *PLACES)
    faces, polygons, corner_uv = _faces(ply)
    pictures = [
        comment.split(None, 1)[1].strip()
        for comment in ply.comments
        if comment.lower().startswith(TEXTURE_FILE) and len(comment.split(None, 1)) == 2
    ]
    if len(pictures) > 1:
        raise ValueError(f"it names {len(pictures)} textures, expected one; save it as OBJ or GLB, or bake one texture")
    if not pictures or (uv is None and corner_uv is None):
        part, of_faces = Part(vertices, faces, normals, shades), _face_colours(ply)
        if shades is None and of_faces is not None:
            part = replace(_split_corners(part), colours=np.repeat(of_faces[polygons], 3, axis=0))
        contents.parts.append(part)
        return contents
    picture = decode_picture(contents.beside(pictures[0], "texture"), pictures[0])
    whole = Part(vertices, faces, normals)
    if corner_uv is not None:
        whole, uv = _split_corners(whole), corner_uv.reshape(-1, 2)
    contents.parts.append(Part(whole.vertices, whole.faces, whole.normals, None, uv, picture))
    return contents


def _faces(ply: PlyData) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.floating] | None]:
    """Return triangles (M, 3), the face (M,) of each, and their corners' places (M, 3, 2) if they have any."""
    name = face_list(ply)
    if name is None:
        return np.zeros((0, 3), np.int64), np.zeros(0, np.int64), None
    lists = ply["face"][name]
    if lists.dtype != object:
        corners, counts = np.asarray(lists).ravel(), np.full(len(lists), 3)
    else:
        counts = np.array([len(face) for face in lists])
        if counts.min() < 3:
            raise ValueError(f"face {int(counts.argmin())} has {counts.min()} corners, expected at least 3")
        corners = np.concatenate(lists)
    triangles, polygons = fan(corners, counts), np.repeat(np.arange(len(counts)), counts - 2)
    if CORNER_PLACES not in ply["face"]:
        return triangles, polygons, None
    places = ply["face"][CORNER_PLACES]
    if any(len(place) != 2 * count for place, count in zip(places, counts, strict=True)):
        raise ValueError("its faces have not two texture coordinates for each corner")
    flat = np.concatenate([np.asarray(place, np.float64) for place in places]).reshape(-1, 2)
    return triangles, polygons, flat[fan(np.arange(len(corners)), counts)]


def _face_colours(ply: PlyData) -> NDArray[np.uint8] | None:
    """Return the colours of faces, uint8 (P, 3), None where they have none."""
    if "face" not in ply:
        return None
    names = next((names for names in COLOURS if all(name in ply["face"] for name in names)), None)
    if names is None:
        return None
    columns = np.column_stack([ply["face"][name] for name in names])
    if columns.dtype == object:
        raise ValueError(f"its faces have lists where numbers are expected: {', '.join(names)}")
    return colours_from(columns)


def _split_corners(part: Part) -> Part:
    """Give every corner of every triangle a vertex of its own."""
    faces = np.arange(part.faces.size).reshape(-1, 3)
    picked = part.faces.ravel()
    normals = None if part.normals is None else part.normals[picked]
    return Part(part.vertices[picked], faces, normals)
