"""A texture for a mesh from the photographs of its sensors: `reconstruct --colour photographs`.

Each face is laid out as one of the cameras sees it, so that a texel is a pixel of that camera, and the texture holds
no more and no less than what was photographed. Faces that no camera sees whole get small triangles of their own. Then
each texel is coloured for its place on the surface, by all photographs (`photographs`), however it is laid out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.capture.rectify import scaled_camera
from recon.geometry.mesh import Mesh
from recon.geometry.rig import Camera
from recon.models.atlas import one_texture
from recon.models.part import Part
from recon.surface.photographs import Photograph, View, colours_at, draw, prepare, qualities

SMOOTHING_STEPS = 4  # over neighbouring faces, so that each camera lays out large areas
GUTTER_PX = 4  # around what a camera lays out: for the means of texels that are seen from afar
BLOCK = 3  # texels to a side for a face of its own
MOST_TEXELS = 2**25  # 100 MB; 8192 x 4096
PLACES_AT_ONCE = 2**18  # that are coloured together: 200 MB

Colour = Callable[[NDArray[np.int32], NDArray[np.float64]], NDArray[np.uint8]]  # as `_colours` of a mesh


def textured(mesh: Mesh, photographs: Sequence[Photograph], tolerance_mm: float) -> Mesh:
    """Texture a mesh by photographs of it; places that none of them shows keep the colours of the vertices.

    Vertices where two cameras' areas meet are there once for each. The shape stays as it is.

    Parameters
    ----------
    mesh : with colours on its vertices
    photographs : of all cameras
    tolerance_mm : how far surfaces may lie behind each other and count as one: the error of depth
    """
    views = prepare(mesh, photographs, tolerance_mm)
    colour = partial(_colours, mesh, views, tolerance_mm)
    layout = _layout(mesh, views, tolerance_mm)
    scale = min(1.0, float(np.sqrt(MOST_TEXELS / max(1, sum(view.trust.size for view in views)))))
    laid_out = [
        _part_before(_scaled(view.photograph.camera, scale), mesh, layout == number, colour)
        for number, view in enumerate(views)
        if (layout == number).any()
    ]
    if (layout < 0).any():
        laid_out.append(_part_of_blocks(mesh, mesh.faces[layout < 0], colour))
    parts = [part for part, _ in laid_out]
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)])
    kept = np.concatenate([numbers for _, numbers in laid_out])
    filled = None if mesh.filled is None else mesh.filled[kept]
    return Mesh(
        mesh.vertices[kept],
        faces.astype(np.int32),
        mesh.normals[kept],
        mesh.colours[kept],
        one_texture(parts),
        filled,
    )


def _layout(mesh: Mesh, views: Sequence[View], tolerance_mm: float) -> NDArray[np.intp]:
    """Choose for each face the view that lays it out, (M,); -1 where none sees it whole."""
    if not views:
        return np.full(len(mesh.faces), -1)
    scores = []
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for view, quality in zip(views, qualities(views, mesh.vertices, mesh.normals, tolerance_mm), strict=True):
        camera = view.photograph.camera
        in_front = (outwards * (camera.centre - corners[:, 0])).sum(axis=1) > 0
        score = _whole_scores(mesh.faces, quality, in_front)
        is_whole = score > 0
        for _ in range(SMOOTHING_STEPS):
            score = _mean_of_corners(mesh.faces, score, len(mesh.vertices))
        scores.append(np.where(is_whole, score, 0))
    best = np.argmax(scores, axis=0)
    return np.where(np.max(scores, axis=0) > 0, best, -1)


@njit(cache=True)
def _whole_scores(faces, quality, in_front):  # type: ignore[no-untyped-def]  # numba
    """Average the qualities (N,) of each face's corners, float64 (M,); 0 where a corner has none or it looks away."""
    scores = np.zeros(len(faces))
    for f in range(len(faces)):
        a, b, c = quality[faces[f, 0]], quality[faces[f, 1]], quality[faces[f, 2]]
        if in_front[f] and a > 0 and b > 0 and c > 0:
            scores[f] = (a + b + c) / np.float32(3)
    return scores


@njit(cache=True)
def _mean_of_corners(faces, values, n_vertices):  # type: ignore[no-untyped-def]  # numba
    """Average values of faces (M,) over the faces around each face's corners."""
    count, total, means = np.zeros(n_vertices), np.zeros(n_vertices), np.empty(len(faces))
    for f in range(len(faces)):
        for corner in range(3):
            count[faces[f, corner]] += 1
            total[faces[f, corner]] += values[f]
    for f in range(len(faces)):
        a, b, c = faces[f]
        means[f] = (total[a] / count[a] + total[b] / count[b] + total[c] / count[c]) / 3
    return means


def _scaled(camera: Camera, scale: float) -> Camera:
    if scale == 1:
        return camera
    width, height = camera.size
    return scaled_camera(camera, (max(int(width * scale), 1), max(int(height * scale), 1)))


def _part_before(
    camera: Camera, mesh: Mesh, is_laid_out: NDArray[np.bool_], colour: Colour
) -> tuple[Part, NDArray[np.intp]]:
    """Lay out faces as a camera sees them; returns the part, and the numbers of its vertices in the mesh."""
    drawn, faces = draw(mesh, camera), mesh.faces[is_laid_out]
    is_kept = np.zeros(len(mesh.vertices), bool)
    is_kept[faces] = True
    wanted = np.append(is_laid_out, False)[drawn.face]  # face -1 is none
    columns, rows = np.rint(drawn.projected[is_kept, :2]).astype(int).T
    wanted[np.clip(rows, 0, wanted.shape[0] - 1), np.clip(columns, 0, wanted.shape[1] - 1)] = True
    wanted = cv2.dilate(wanted.astype(np.uint8), np.ones((2 * GUTTER_PX + 1,) * 2, np.uint8)) > 0
    rows, columns = np.nonzero(wanted & (drawn.face >= 0))
    corners = mesh.faces[drawn.face[rows, columns]]
    picture = np.zeros((*wanted.shape, 3), np.uint8)
    picture[rows, columns] = colour(corners, _shares(drawn.projected[corners], np.stack([columns, rows], axis=1)))
    picture = _filled(picture, drawn.face >= 0, wanted)
    top, left = np.argmax(wanted.any(axis=1)), np.argmax(wanted.any(axis=0))
    height, width = (
        len(wanted) - np.argmax(wanted.any(axis=1)[::-1]),
        wanted.shape[1] - np.argmax(wanted.any(axis=0)[::-1]),
    )
    picture = picture[top:height, left:width]
    uv = _uv(drawn.projected[is_kept, :2] - (left, top), picture)
    number = np.cumsum(is_kept) - 1
    return Part(mesh.vertices[is_kept].astype(np.float64), number[faces], uv=uv, picture=picture), np.flatnonzero(
        is_kept
    )


def _part_of_blocks(mesh: Mesh, faces: NDArray[np.int32], colour: Colour) -> tuple[Part, NDArray[np.intp]]:
    """Lay out faces one by one, each in a square of texels with its corners at the middles of three of them."""
    across = int(np.ceil(np.sqrt(len(faces))))
    second, third = np.meshgrid(*[np.arange(BLOCK) / (BLOCK - 1)] * 2)
    shares = np.stack([1 - second - third, second, third], axis=-1).reshape(-1, 3)
    colours = colour(np.repeat(faces, BLOCK**2, axis=0), np.tile(shares, (len(faces), 1)))
    blocks = np.zeros((across**2, BLOCK, BLOCK, 3), np.uint8)
    blocks[: len(faces)] = colours.reshape(len(faces), BLOCK, BLOCK, 3)
    rows = blocks.reshape(across, across, BLOCK, BLOCK, 3).swapaxes(1, 2)
    picture = np.ascontiguousarray(rows.reshape(BLOCK * across, BLOCK * across, 3))
    number, kept = np.arange(len(faces)), faces.ravel().astype(np.intp)
    first = BLOCK * np.stack([number % across, number // across], axis=1)
    texels = first[:, None] + (BLOCK - 1) * np.array([[0, 0], [1, 0], [0, 1]])  # (M, 3, 2)
    uv = _uv(texels.reshape(-1, 2), picture)
    return Part(
        mesh.vertices[kept].astype(np.float64), np.arange(len(kept)).reshape(-1, 3), uv=uv, picture=picture
    ), kept


def _uv(texels: NDArray[np.floating] | NDArray[np.integer], picture: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Convert columns and rows (N, 2) of a picture, whole at the middles of texels, to places as in `Texture`."""
    uv = np.clip((texels + 0.5) / picture.shape[1::-1], 0, 1)
    return np.column_stack([uv[:, 0], 1 - uv[:, 1]])


def _shares(corners: NDArray[np.float64], pixels: NDArray[np.intp]) -> NDArray[np.float64]:
    """Compute the shares (K, 3) of a face's corners (K, 3, 3), projected, in what is seen at a pixel (K, 2)."""
    x, y = np.moveaxis(corners[..., :2] - pixels[:, None], 2, 0)
    after, before = np.roll(x, -1, axis=1), np.roll(x, 1, axis=1)
    areas = after * np.roll(y, 1, axis=1) - np.roll(y, -1, axis=1) * before
    weights = areas / corners[..., 2]
    total = weights.sum(axis=1, keepdims=True)
    return np.asarray(weights / np.where(total == 0, 1, total))


def _colours(
    mesh: Mesh,
    views: Sequence[View],
    tolerance_mm: float,
    corners: NDArray[np.int32],
    shares: NDArray[np.float64],
) -> NDArray[np.uint8]:
    """Colour places on faces, uint8 (K, 3), given by the corners (K, 3) of the face and their shares (K, 3)."""
    colours = np.empty((len(corners), 3), np.uint8)
    for start in range(0, len(corners), PLACES_AT_ONCE):
        now = slice(start, start + PLACES_AT_ONCE)
        points, normals, fallback = (
            np.einsum("kc,kcx->kx", shares[now], values[corners[now]].astype(np.float64))
            for values in (mesh.vertices, mesh.normals, mesh.colours)
        )
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-6)
        colours[now] = colours_at(views, qualities(views, points, normals, tolerance_mm), points, fallback)
    return colours


def _filled(picture: NDArray[np.uint8], is_known: NDArray[np.bool_], is_wanted: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Give texels that are wanted and not known the colour of the nearest that is."""
    _, nearest = cv2.distanceTransformWithLabels(
        (~is_known).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    colour_of = np.zeros((int(nearest.max()) + 1, 3), np.uint8)
    colour_of[nearest[is_known]] = picture[is_known]
    missing = is_wanted & ~is_known
    picture = picture.copy()
    picture[missing] = colour_of[nearest[missing]]
    return picture
