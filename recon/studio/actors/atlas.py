"""The layout of a texture for the studio's bodies: which place of which body each texel shows.

Faces are grouped by the side of a box that they face at rest; what hangs together in a group is a chart, seen from that
side. Charts stand next to each other in one picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from recon.models.atlas import packed
from recon.studio.actors.skeleton import vertex_normals

GUTTER = 4  # texels around each chart, for the means of texels that are seen from afar


@dataclass(frozen=True, eq=False)
class Atlas:
    """A texture without its colours.

    Parameters
    ----------
    kept : int64 (N,), number of each textured vertex in the mesh; vertices where charts meet are there once for each
    faces : int32 (M, 3), of the textured vertices
    uv : float32 (N, 2), as in `recon.geometry.mesh.Texture`
    places : float64 (H, W, 3), mm, on the bodies at rest
    owners : int64 (H, W), the body of each texel
    """

    kept: NDArray[np.int64]
    faces: NDArray[np.int32]
    uv: NDArray[np.float32]
    places: NDArray[np.float64]
    owners: NDArray[np.int64]


def lay_out(places: NDArray[np.float64], faces: NDArray[np.int32], owners: NDArray[np.int64], texel_mm: float) -> Atlas:
    """Lay out bodies.

    Parameters
    ----------
    places : float64 (V, 3), mm, vertices at rest
    faces : int32 (M, 3); owners : int64 (M,), the body of each face
    texel_mm : edge of a texel where a surface lies flat in its chart
    """
    outwards = vertex_normals(places, faces)[faces].mean(axis=1)
    side = np.argmax(np.concatenate([outwards, -outwards], axis=1), axis=1)
    keys, corners = np.unique(faces.astype(np.int64) * 6 + side[:, None], return_inverse=True)
    corners = corners.reshape(-1, 3)
    kept, axis = keys // 6, keys % 6 % 3
    links = coo_array((np.ones(2 * len(faces)), np.concatenate([corners[:, :2], corners[:, 1:]]).T), (len(keys),) * 2)
    n_charts, chart = connected_components(links, directed=False)
    flat = places[kept][np.arange(len(keys))[:, None], np.stack([(axis + 1) % 3, (axis + 2) % 3], axis=1)] / texel_mm
    low, high = np.full((n_charts, 2), np.inf), np.full((n_charts, 2), -np.inf)
    np.minimum.at(low, chart, flat)
    np.maximum.at(high, chart, flat)
    sizes = np.ceil(high - low).astype(int) + 1 + 2 * GUTTER
    boxes, (height, width) = packed([(int(rows), int(columns)) for columns, rows in sizes])
    texels = flat - low[chart] + GUTTER + np.array(boxes)[chart][:, ::-1]
    shown, owner = np.zeros((height, width, 3)), np.full((height, width), -1)
    _draw(texels[corners], places[faces], owners, shown, owner)
    _, (rows, columns) = distance_transform_edt(owner < 0, return_indices=True)
    uv = (texels + 0.5) / (width, height)
    uv[:, 1] = 1 - uv[:, 1]
    return Atlas(kept, corners.astype(np.int32), uv.astype(np.float32), shown[rows, columns], owner[rows, columns])


@numba.njit(cache=True, nogil=True)
def _draw(
    texels: NDArray[np.float64],
    corners: NDArray[np.float64],
    owners: NDArray[np.int64],
    shown: NDArray[np.float64],
    owner: NDArray[np.int64],
) -> None:
    """Write places and owners of faces, which have columns and rows (M, 3, 2) and corners (M, 3, 3), to texels."""
    for f in range(len(texels)):
        ax, ay, bx, by, cx, cy = texels[f].ravel()
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0.0:
            continue
        for row in range(int(np.ceil(min(ay, by, cy))), int(np.floor(max(ay, by, cy))) + 1):
            for column in range(int(np.ceil(min(ax, bx, cx))), int(np.floor(max(ax, bx, cx))) + 1):
                u = ((bx - column) * (cy - row) - (cx - column) * (by - row)) / area
                v = ((cx - column) * (ay - row) - (ax - column) * (cy - row)) / area
                if u < 0.0 or v < 0.0 or u + v > 1.0:
                    continue
                shown[row, column] = u * corners[f, 0] + v * corners[f, 1] + (1.0 - u - v) * corners[f, 2]
                owner[row, column] = owners[f]
