"""Two ways from the sensors' clouds to one mesh: merge the clouds' surfaces, or merge the clouds first."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

from recon.fusion.views import check_clouds
from recon.geometry.mesh import Cloud, Mesh, merge_meshes
from recon.surface import NoSurfaceError, SurfaceParameters, surface_from_cloud, surface_from_clouds, with_voxel


class LeftOutWarning(UserWarning):
    """A cloud that adds nothing to a mesh."""


def fuse_after(clouds: Sequence[Cloud], parameters: SurfaceParameters = SurfaceParameters()) -> Mesh:
    """Fuse after surfacing (FA): a surface per sensor, then one mesh as their union.

    Where views overlap, each sensor adds a layer with its own normals. A cloud whose points support no
    surface of their own is left out, with a warning.

    A NoSurfaceError says that no cloud supports a surface.
    """
    parameters = _checked(clouds, parameters)
    surfaces: list[Mesh] = []
    reasons: list[str] = []
    for number, cloud in enumerate(clouds, start=1):
        if not len(cloud):
            continue
        try:
            surfaces.append(surface_from_cloud(cloud, parameters))
        except NoSurfaceError as error:
            reasons.append(f"cloud {number} of {len(clouds)} is left out: {error}")
    if not surfaces:
        raise NoSurfaceError("; ".join(reasons))
    for reason in reasons:
        warnings.warn(reason, LeftOutWarning, stacklevel=2)
    return merge_meshes(surfaces)


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
