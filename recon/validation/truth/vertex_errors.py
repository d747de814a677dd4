"""How far a surface lies from the true one, vertex by vertex: to look at, as colours on the mesh."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from recon.geometry.mesh import Mesh, error_colours

LIMIT_SHARE = 95  # percentile of the errors that gets the full colour, unless a limit is given


def signed_errors(mesh: Mesh, truth: Mesh) -> NDArray[np.float64]:
    """Distance (N,) of a mesh's vertices from the truth, mm, positive outside.

    It is counted from the tangent plane at the truth's nearest vertex, or from that vertex itself where the truth has
    ended: beside it by more than the truth's longest edge.
    """
    _, nearest = cKDTree(truth.vertices).query(mesh.vertices)
    apart = mesh.vertices.astype(np.float64) - truth.vertices[nearest]
    above = (apart * truth.normals[nearest]).sum(axis=1)
    distance = np.linalg.norm(apart, axis=1)
    beside = np.sqrt(np.maximum(distance**2 - above**2, 0))
    return np.asarray(np.where(beside <= _longest_edge(truth), above, np.copysign(distance, above)))


def coloured_by_error(mesh: Mesh, errors: NDArray[np.float64], limit: float | None = None) -> tuple[Mesh, float]:
    """The mesh with errors as colours, red outside and blue inside, and the error in mm that has the full colour.

    Raises
    ------
    ValueError
        If the limit is not positive.
    """
    if limit is None:
        limit = float(np.percentile(np.abs(errors), LIMIT_SHARE)) or 1.0  # a mesh without errors is white anyway
    return replace(mesh, colours=error_colours(errors, limit)), limit


def _longest_edge(mesh: Mesh) -> float:
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
