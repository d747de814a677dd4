"""The open rims of a frame's surface, drawn to the mean of where its neighbours in time have them.

Where a surface ends depends on what happened to be measured, so rims jump between frames that show the same. Frames
before and after count alike: what moves evenly stays where it is, and nothing trails behind it. No frame depends on how
another one was steadied.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometry.mesh import Mesh
from recon.surface.holes import rim_edges

SAME_RIM = 3.0  # voxels: what is farther from a rim is another one, or moved too fast to tell
BESIDE = 4.0  # voxels from a rim, within which the surface follows it
NEAREST = 4  # places of another frame's rim, whose mean is where it is


def steady_rims(mesh: Mesh, others: Sequence[Mesh], voxel: float) -> Mesh:
    """Move the rims of a mesh without texture, and what is beside them, to the mean of those of frames around it.

    Parameters
    ----------
    mesh : to be steadied
    others : of as many frames before as after, as far as there are any
    voxel : mm, of the surfaces
    """
    rim = _rim(mesh)
    if not len(rim):
        return mesh
    total, count = rim.copy(), np.ones((len(rim), 1))
    for place in map(_rim, others):
        if len(place) < NEAREST:
            continue
        distances, nearest = map(np.asarray, cKDTree(place).query(rim, k=NEAREST))
        same = distances[:, 0] < SAME_RIM * voxel
        total[same] += place[nearest[same]].mean(axis=1)
        count[same] += 1
    moves = total / count - rim
    distance, nearest = map(np.asarray, cKDTree(rim).query(mesh.vertices, distance_upper_bound=BESIDE * voxel))
    follows = np.isfinite(distance)
    vertices = mesh.vertices.copy()
    share = 1.0 - distance[follows, None] / (BESIDE * voxel)
    vertices[follows] += (share * moves[nearest[follows]]).astype(np.float32)
    return replace(mesh, vertices=vertices)


def _rim(mesh: Mesh) -> NDArray[np.float64]:
    return mesh.vertices[np.unique(rim_edges(mesh.faces))].astype(np.float64)
