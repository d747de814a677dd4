"""What fusions get: clouds, and for those that work on depth maps the same points as their sensors' depth maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.normals import are_unit, surface_normals, unit_normals
from recon.geometry.rig import Camera
from recon.models.inspection import OTHER_UNIT
from recon.surface import NoSurfaceError


@dataclass(frozen=True, eq=False)
class DepthView:
    """A sensor's points as a picture.

    Parameters
    ----------
    depth : float32 (H, W), mm along the camera's z axis, NaN where there is no point
    colours : uint8 (H, W, 3), sRGB, black where there is no point
    camera : of the rectified left picture, without distortion
    """

    depth: NDArray[np.float32]
    colours: NDArray[np.uint8]
    camera: Camera


def view_of_cloud(cloud: Cloud, camera: Camera) -> DepthView:
    """Put the points of a cloud back into the pixels that they were made from.

    Every point came from the middle of a pixel, so nothing is resampled: the view has the cloud's points, no more and
    no fewer.
    """
    width, height = camera.size
    depth = np.full((height, width), np.nan, np.float32)
    colours = np.zeros((height, width, 3), np.uint8)
    if len(cloud):
        columns, rows = np.rint(camera.project(cloud.points)).astype(np.int64).T
        depth[rows, columns] = camera.points_in_camera(cloud.points)[:, 2]
        colours[rows, columns] = cloud.colours
    return DepthView(depth, colours, camera)


def with_unit_normals(mesh: Mesh) -> Mesh:
    """Return a mesh by somebody else with normals of unit length: those of its faces where one has no direction."""
    if are_unit(mesh.normals):
        return mesh
    return replace(mesh, normals=unit_normals(mesh.normals, surface_normals(mesh.vertices, mesh.faces)))


def check_place(mesh: Mesh, clouds: Sequence[Cloud]) -> None:
    """Raise a ValueError if a mesh by somebody else lies apart from the clouds, or has not their size, as in metres."""
    corners = mesh.vertices[mesh.faces.ravel()], np.concatenate([cloud.points for cloud in clouds])
    (low, high), (lowest, highest) = ((each.min(axis=0), each.max(axis=0)) for each in corners)
    size, expected = np.linalg.norm(high - low), np.linalg.norm(highest - lowest)
    is_apart = (low > highest).any() or (high < lowest).any()
    if is_apart or not expected / OTHER_UNIT < size < expected * OTHER_UNIT:
        raise ValueError(
            f"it reaches from {low.tolist()} to {high.tolist()}, the clouds from {lowest.tolist()} to "
            f"{highest.tolist()}; expected the clouds' coordinates, in mm"
        )


def check_clouds(clouds: Sequence[Cloud]) -> None:
    """Raise a ValueError if there is no cloud, a NoSurfaceError if none holds points."""
    if not clouds:
        raise ValueError("there is no cloud to fuse")
    if not any(map(len, clouds)):
        raise NoSurfaceError(f"there is nothing to fuse: none of {len(clouds)} clouds holds points")
