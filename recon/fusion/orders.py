"""Two ways from the sensors' clouds to one mesh: merge the clouds' surfaces, or merge the clouds first."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from recon.fusion.views import check_clouds
from recon.geometry.mesh import Cloud, Mesh, merge_meshes
from recon.surface import (
    NoSurfaceError,
    SurfaceParameters,
    shape_from_clouds,
    surface_from_clouds,
    with_small_holes_closed,
    with_voxel,
)
from recon.surface.components import component_labels, drop_islands
from recon.surface.holes import rim_edges
from recon.surface.rims import cut, with_ring
from recon.surface.vertex_colours import Beside, beside

LEAST_SUPPORT = 0.5  # of what another sensor has there, for a sensor's own layer to stay
LEAST_ISLAND = 0.02  # of a sensor's faces: what is left in smaller pieces looks like flakes


class LeftOutWarning(UserWarning):
    """A cloud that adds nothing to a mesh."""


def fuse_after(clouds: Sequence[Cloud], parameters: SurfaceParameters = SurfaceParameters()) -> Mesh:
    """Fuse after surfacing (FA): a surface per sensor, then one mesh as their union.

    Where views overlap, each sensor adds a layer with its own normals, but for the parts that it sees so obliquely, or
    at such an edge, that another sensor has more than twice the points there: they would stand out as flakes. A cloud
    whose points support no surface of their own is left out, with a warning.

    A NoSurfaceError says that no cloud supports a surface.
    """
    parameters = _checked(clouds, parameters)
    assert parameters.voxel_mm is not None
    points = beside([cloud for cloud in clouds if len(cloud)], parameters.voxel_mm)
    surfaces: list[Mesh] = []
    reasons: list[str] = []
    place = 0  # of the cloud in `points`
    for number, cloud in enumerate(clouds, start=1):
        if not len(cloud):
            continue
        try:
            surfaces.append(_layer(cloud, points, place, parameters))
        except NoSurfaceError as error:
            reasons.append(f"cloud {number} of {len(clouds)} is left out: {error}")
        place += 1
    if not surfaces:
        raise NoSurfaceError("; ".join(reasons))
    for reason in reasons:
        warnings.warn(reason, LeftOutWarning, stacklevel=2)
    return merge_meshes([surface for surface in surfaces if len(surface.faces)])


def _layer(cloud: Cloud, points: Beside, place: int, parameters: SurfaceParameters) -> Mesh:
    """Make a cloud's surface, but for what another of the clouds supports far better."""
    mesh = shape_from_clouds([cloud], parameters)
    colours, weights = points.gather(mesh.vertices, mesh.normals, mesh.colours, range(place, place + 1))
    n_before = len(mesh.vertices)
    mesh = with_small_holes_closed(replace(mesh, colours=colours), parameters)
    patches = points.gather(mesh.vertices[n_before:], mesh.normals[n_before:], mesh.colours[n_before:])
    weights = np.concatenate([weights, patches[1]])
    others = np.delete(weights, place, axis=1)
    if not others.shape[1]:
        return mesh
    field = weights[:, place] - LEAST_SUPPORT * others.max(axis=1)
    kept = np.where(_from_rims(mesh.faces, field < 0), field, np.abs(field))
    return drop_islands(cut(mesh, kept), LEAST_ISLAND * len(mesh.faces))


def _from_rims(faces: NDArray[np.int32], is_weak: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Leave marked (N,) only what reaches in from a rim of faces (M, 3): within a layer, a cut would be a hole.

    ID's slices have such places: a riser between two of them has few points of its own.
    """
    core = with_ring(faces, ~with_ring(faces, ~is_weak)) & is_weak  # what hangs on by a line does not reach
    labels = component_labels(faces[core[faces].all(axis=1)], len(is_weak))
    reaches = np.zeros(len(is_weak), bool)
    rims = rim_edges(faces)[:, 0]
    reaches[labels[rims[core[rims]]]] = True
    return np.asarray(core & reaches[labels])


def fuse_before(clouds: Sequence[Cloud], parameters: SurfaceParameters = SurfaceParameters()) -> Mesh:
    """Fuse before surfacing (FB): one cloud as the union of the sensors' clouds, then its surface.

    Where views overlap, their points are averaged into one layer.

    A NoSurfaceError says that the points of all clouds together support no surface.
    """
    parameters = _checked(clouds, parameters)
    return surface_from_clouds(clouds, parameters)


def _checked(clouds: Sequence[Cloud], parameters: SurfaceParameters) -> SurfaceParameters:
    """Check that there are points, and set a voxel size, the same for both orders."""
    check_clouds(clouds)
    return with_voxel(clouds, parameters)
