"""Screened Poisson reconstruction by Open3D: the baseline that most programs compare with.

Source: Kazhdan and Hoppe, Screened Poisson surface reconstruction, ACM TOG 2013; Open3D runs Kazhdan's own code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from recon.cloud import merge_clouds
from recon.fusion.views import check_clouds
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.normals import surface_normals
from recon.runtime.backend import open3d
from recon.surface import MIN_POINTS, NoSurfaceError, default_voxel
from recon.surface.components import drop_small_components

SCALE = 1.1  # Open3D's: the octree's cube by the points' extent
DEEPEST = 12  # of the octree; at 13 a surface of the whole cube would take tens of gigabytes


@dataclass(frozen=True)
class PoissonParameters:
    """How the indicator function is solved, and where its surface ends.

    Parameters
    ----------
    voxel_mm : largest width of the octree's finest cells; None takes the run's, or one that suits the points
    point_weight : of the points against the smoothness of the function; 2 is Open3D's default
    trim : share of the vertices that is cut off, those with the fewest points around: the surface is closed
        otherwise; with 0.2 the studio's face is as near to the truth as by FB (docs/surface.md)
    min_component : smallest connected component that is kept, as a share of the largest one's faces, as with ours
    """

    voxel_mm: float | None = None
    point_weight: float = 2.0
    trim: float = 0.2
    min_component: float = 0.02

    def __post_init__(self) -> None:
        if self.voxel_mm is not None and not self.voxel_mm > 0:
            raise ValueError(f"voxel_mm is {self.voxel_mm}, expected a length above 0")
        if not self.point_weight >= 0:
            raise ValueError(f"point_weight is {self.point_weight}, expected at least 0")
        if not (0 <= self.trim < 1 and 0 <= self.min_component <= 1):
            raise ValueError(f"trim {self.trim} must be 0 to below 1, min_component {self.min_component} 0 to 1")


def fuse_poisson(clouds: Sequence[Cloud], parameters: PoissonParameters = PoissonParameters()) -> Mesh:
    """Merge the clouds, and solve for the surface whose gradient fits the normals (screened Poisson).

    It runs on one thread: with more, the last bits of its vertices change from run to run.

    Raises
    ------
    NoSurfaceError
        If there are too few points for a surface.
    ValueError
        If there is no cloud, or the voxel needs too deep an octree.
    """
    check_clouds(clouds)
    cloud = merge_clouds(clouds)
    if len(cloud) < MIN_POINTS:
        raise NoSurfaceError(f"the clouds have {len(cloud)} points: a surface needs at least {MIN_POINTS}")
    depth = _depth(cloud, parameters.voxel_mm or default_voxel(clouds))
    geometry, Vectors = open3d().geometry, open3d().utility.Vector3dVector
    theirs = geometry.PointCloud(Vectors(cloud.points.astype(np.float64)))
    theirs.normals = Vectors(cloud.normals.astype(np.float64))
    theirs.colors = Vectors(cloud.colours / 255)
    solved, density = geometry.TriangleMesh.create_from_point_cloud_poisson(
        theirs, depth=depth, scale=SCALE, point_weight=parameters.point_weight, n_threads=1
    )
    if not len(density):
        raise NoSurfaceError(f"{len(cloud)} points support no surface by screened Poisson reconstruction")
    support = np.asarray(density)
    solved.remove_vertices_by_mask(support < np.quantile(support, parameters.trim))
    vertices, faces = np.asarray(solved.vertices), np.asarray(solved.triangles)
    if not len(faces):
        raise NoSurfaceError(f"nothing is left of the surface of {len(cloud)} points after trimming {parameters.trim}")
    colours = np.rint(np.clip(np.asarray(solved.vertex_colors), 0, 1) * 255).astype(np.uint8)
    mesh = Mesh(vertices.astype(np.float32), faces, surface_normals(vertices, faces), colours)
    return drop_small_components(mesh, parameters.min_component)


def _depth(cloud: Cloud, voxel: float) -> int:
    """Return the depth of the octree whose finest cells are no wider than a voxel."""
    width = SCALE * float(np.ptp(cloud.points, axis=0).max())
    depth = int(np.ceil(np.log2(max(width / voxel, 2))))
    if depth > DEEPEST:
        raise ValueError(
            f"a voxel of {voxel:g} mm would need an octree of depth {depth}, more than {DEEPEST}; "
            f"a voxel of {width / 2**DEEPEST:.3g} mm fits"
        )
    return depth
