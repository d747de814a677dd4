"""Faces that reach behind the camera, cut a little before it: of a floor that it stands over, it sees a part.

The renderer's kernels leave such faces out, because their corners behind the camera have no place in the picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.rig import Camera
from recon.render.rasterise import FARTHEST_PIXEL, NEAREST
from recon.render.scene import transformed

Values = Sequence[NDArray[Any]]


def projected(vertices: NDArray[np.float32], camera: Camera) -> NDArray[np.float32]:
    """Project vertices (N, 3) to column, row and depth, float32 (N, 3)."""
    homogeneous = transformed(vertices.astype(np.float64), camera.K @ camera.cam_from_world[:3])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # beside or behind the camera: not drawn
        homogeneous[:, :2] /= homogeneous[:, 2:]
        return homogeneous.astype(np.float32)


def drawn_by(
    camera: Camera, vertices: NDArray[np.float32], faces: NDArray[np.int32], values: Values
) -> tuple[NDArray[np.float32], NDArray[np.int32], Values]:
    """Project a mesh, whose faces are cut before the camera where it stands among them.

    Parameters
    ----------
    camera, vertices, faces, values : as of `cut_before`

    Returns
    -------
    projected : float32 (N, 3), see `projected`
    faces, values : as of `cut_before`, but as they were where nothing is to be cut
    """
    places = projected(vertices, camera)
    nearest, farthest = places[:, 2].min(), np.abs(places[:, :2]).max()
    if nearest >= NEAREST and farthest < FARTHEST_PIXEL:  # false for NaN
        return places, faces, values
    vertices, faces, values = cut_before(camera, vertices, faces, values)
    return projected(vertices, camera), faces, values


def cut_before(
    camera: Camera, vertices: NDArray[np.float32], faces: NDArray[np.int32], values: Values
) -> tuple[NDArray[np.float32], NDArray[np.int32], list[NDArray[Any]]]:
    """Cut the faces of a mesh so that the kernels draw all that the camera sees of them.

    Parameters
    ----------
    camera : without distortion
    vertices : float32 (N, 3), mm
    faces : int32 (M, 3)
    values : of the vertices, (N, C) each: colours, and places in a texture, empty where there is none

    Returns
    -------
    vertices, faces, values : with more vertices at the end, and without the faces and parts of faces behind the camera
    """
    depth = transformed(vertices.astype(np.float64), camera.cam_from_world[2:3])[:, 0]
    reach = float(np.linalg.norm(vertices - camera.centre, axis=1).max())
    near = max(2 * reach * float(camera.K[:2, :2].max()) / FARTHEST_PIXEL, 2 * NEAREST)  # no pixel is too far
    is_before = depth >= near
    n_before = is_before[faces].sum(axis=1)

    crossing = faces[(n_before == 1) | (n_before == 2)]
    is_tip = n_before[(n_before == 1) | (n_before == 2)] == 1  # one corner is before the plane, else one is behind it
    turn = (is_before[crossing] == is_tip[:, None]).argmax(axis=1)[:, None]  # so that this one comes first
    a, b, c = np.take_along_axis(crossing, (turn + np.arange(3)) % 3, axis=1).T
    on_ab = len(vertices) + np.arange(len(a))
    on_ac = on_ab + len(a)

    ends = np.stack([np.concatenate([a, a]), np.concatenate([b, c])])
    seen, hidden = np.where(is_before[ends[0]], ends, ends[::-1])  # neighbours cut the edge that they share alike
    share = ((depth[seen] - near) / (depth[seen] - depth[hidden]))[:, None]

    def with_cuts(kept: NDArray[Any]) -> NDArray[Any]:
        if not len(kept):  # of what has no texture
            return kept
        cuts = kept[seen] + share * (kept[hidden].astype(np.float64) - kept[seen])
        return np.concatenate([kept, (np.rint(cuts) if kept.dtype == np.uint8 else cuts).astype(kept.dtype)])

    pieces = [
        faces[n_before == 3],
        np.stack([a, on_ab, on_ac], axis=1)[is_tip],
        np.stack([on_ab, b, c], axis=1)[~is_tip],
        np.stack([on_ab, c, on_ac], axis=1)[~is_tip],
    ]
    return with_cuts(vertices), np.concatenate(pieces).astype(np.int32), [with_cuts(kept) for kept in values]
