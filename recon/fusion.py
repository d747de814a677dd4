"""Two ways from the sensors' clouds to one mesh: the same two steps in the other order."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from recon.cloud import merge_clouds
from recon.mesh import Cloud, Mesh, merge_meshes
from recon.surface import SurfaceParameters, surface_from_cloud, with_voxel

Fusion = Callable[[Sequence[Cloud], SurfaceParameters], Mesh]


def fuse_after(clouds: Sequence[Cloud], parameters: SurfaceParameters = SurfaceParameters()) -> Mesh:
    """FA: a surface per sensor, then one mesh as their union.

    Where views overlap there are as many layers as sensors, each with its own normals.
    """
    parameters = _checked(clouds, parameters)
    return merge_meshes([surface_from_cloud(cloud, parameters) for cloud in clouds])


def fuse_before(clouds: Sequence[Cloud], parameters: SurfaceParameters = SurfaceParameters()) -> Mesh:
    """FB: one cloud as the union of the sensors' clouds, then its surface.

    Where views overlap the points of all of them are averaged into one layer.
    """
    parameters = _checked(clouds, parameters)
    return surface_from_cloud(merge_clouds(clouds), parameters)


def _checked(clouds: Sequence[Cloud], parameters: SurfaceParameters) -> SurfaceParameters:
    """The parameters with one voxel for both orders, once every cloud has points."""
    if not clouds:
        raise ValueError("there is no cloud to fuse")
    for number, cloud in enumerate(clouds, start=1):
        if not len(cloud):
            raise ValueError(f"cloud {number} of {len(clouds)} is empty: its sensor saw nothing")
    return with_voxel(clouds, parameters)


FUSIONS: dict[str, Fusion] = {"fa": fuse_after, "fb": fuse_before}
