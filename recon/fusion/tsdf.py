"""A truncated signed distance function by Open3D: the baseline that integrates depth maps instead of points.

Source: Curless and Levoy, A volumetric method for building complex models from range images, SIGGRAPH 1996.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.fusion.views import DepthView, check_clouds
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.normals import surface_normals
from recon.runtime.backend import open3d
from recon.surface import NoSurfaceError, default_voxel
from recon.surface.components import drop_small_components

BLOCK = 16  # samples along the side of the blocks that are allocated near the depths, Open3D's default


@dataclass(frozen=True)
class TsdfParameters:
    """How distances are integrated.

    Parameters
    ----------
    voxel_mm : distance of the samples; None takes the run's, or one that suits the points
    truncation : voxels in front of and behind a depth in which it counts; of 2, 3 and 5, 3 was best on the studio's
        face (docs/surface.md)
    min_component : smallest connected component that is kept, as a share of the largest one's faces, as with ours
    """

    voxel_mm: float | None = None
    truncation: float = 3.0
    min_component: float = 0.02

    def __post_init__(self) -> None:
        if self.voxel_mm is not None and not self.voxel_mm > 0:
            raise ValueError(f"voxel_mm is {self.voxel_mm}, expected a length above 0")
        if not self.truncation >= 1 or not 0 <= self.min_component <= 1:
            raise ValueError(
                f"truncation {self.truncation} must be at least 1 voxel, min_component {self.min_component} 0 to 1"
            )


def fuse_tsdf(
    clouds: Sequence[Cloud], parameters: TsdfParameters = TsdfParameters(), *, views: Sequence[DepthView]
) -> Mesh:
    """Average the signed distances to all sensors' depth maps, and take the surface where they are zero.

    Parameters
    ----------
    clouds : one per sensor, which choose a voxel where none is given
    parameters : of the volume
    views : the same points as depth maps

    Raises
    ------
    NoSurfaceError
        If the depth maps support no surface.
    ValueError
        If there is no cloud.
    """
    check_clouds(clouds)
    voxel = parameters.voxel_mm or default_voxel(clouds)

    kinds = (open3d().core.float32,) * 3
    volume = open3d().t.geometry.VoxelBlockGrid(("tsdf", "weight", "color"), kinds, ((1,), (1,), (3,)), voxel, BLOCK)
    for view in views:
        if np.isfinite(view.depth).any():
            _integrate(volume, view, parameters.truncation)
    # every sample that a sensor saw counts
    surface = volume.extract_triangle_mesh(weight_threshold=0.0) if volume.hashmap().size() else None
    if surface is None or not len(surface.triangle.indices):
        raise NoSurfaceError(f"{sum(map(len, clouds))} points support no surface at a voxel of {voxel:g} mm")
    vertices, colours, faces = _in_order(
        surface.vertex.positions.numpy(), surface.vertex.colors.numpy(), surface.triangle.indices.numpy()
    )
    sRGB = np.rint(np.clip(colours, 0, 1) * 255).astype(np.uint8)
    return drop_small_components(
        Mesh(vertices, faces, surface_normals(vertices, faces), sRGB), parameters.min_component
    )


def _integrate(volume: Any, view: DepthView, truncation: float) -> None:
    """Add a depth map to Open3D's VoxelBlockGrid."""
    Tensor, Image = open3d().core.Tensor, open3d().t.geometry.Image
    depth = Image(Tensor(np.nan_to_num(view.depth, nan=0.0)))  # 0 is Open3D's sign of no depth
    colours = Image(Tensor(np.ascontiguousarray(view.colours, dtype=np.float32) / np.float32(255)))
    camera = (Tensor(view.camera.K), Tensor(np.ascontiguousarray(view.camera.cam_from_world)))
    farthest = 2 * float(np.nanmax(view.depth))
    blocks = volume.compute_unique_block_coordinates(depth, *camera, 1.0, farthest, truncation)
    volume.integrate(blocks, depth, colours, *camera, 1.0, farthest, truncation)


def _in_order(
    vertices: NDArray[np.float32], colours: NDArray[np.float32], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int32]]:
    """Sort vertices and faces: Open3D numbers them as its threads come to them."""
    order = np.lexsort(vertices.T)
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order))
    corners = rank[faces]
    first = corners.argmin(axis=1)[:, None]
    turned = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
    return vertices[order], colours[order], turned[np.lexsort(turned.T[::-1])]
