"""From a cloud to a mesh: the zero of a smooth signed field that exists only near the points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from recon.cloud import merge_clouds
from recon.geometry.mesh import Cloud, Mesh
from recon.surface.apss import signed_field
from recon.surface.band import Band, band_around
from recon.surface.blocks import LARGEST_AXIS, SAMPLES
from recon.surface.cells import Cells, Reach, extent_in_blocks, gather
from recon.surface.components import drop_small_components
from recon.surface.holes import close_holes
from recon.surface.marching_cubes import march
from recon.surface.vertex_colours import colour_vertices

__all__ = [
    "NoSurfaceError",
    "SurfaceParameters",
    "surface_from_cloud",
    "surface_from_clouds",
]

BYTES_PER_BLOCK = SAMPLES * (4 + 12 + 12 + 6) + 27 * 4 * 2  # field, gradient, colour, vertex numbers; neighbours
BYTES_PER_POINT = 200  # while points are gathered into cells, measured
MIN_POINTS = 3
VOXELS_PER_DECADE = 20  # default voxels are rounded, so that the frames of a recording mostly share one grid
SPACINGS_PER_VOXEL = 1.5  # 1.25 gains 0.1 dB on the temple, and makes 1.4 times the triangles
SIGMAS_PER_VOXEL = 0.4  # so that 5 standard deviations, over which a shape is smoothed, are 12 samples across at most
PINHOLE_VOXELS = 8  # the rim of a hole narrower than the radius of a point's influence: noise, not the end of a surface
COARSE_CELLS = (128, 64, 32, 16, 8)  # along the longest side, to count how much surface a cloud covers
POINTS_PER_COARSE_CELL = 8  # so that cells without a point inside the surface are rare
CELLS_PER_AREA = 1.5  # cells that a unit of surface crosses, averaged over directions


class NoSurfaceError(ValueError):
    """A cloud whose points support no surface."""


@dataclass(frozen=True)
class SurfaceParameters:
    """How a surface is sampled and where it ends.

    Parameters
    ----------
    voxel_mm : distance of the samples; None takes 1.5 times the spacing of a sensor's points, or 0.4 of their depth
        error where that is more
    radius, radius_spacings, radius_sigmas : where a point's weight ends: the largest of these, in voxels, in distances
        of neighbouring points where they are sparse, and in standard deviations of the points' depth; at most 8 voxels
    overhang : how far the surface may reach past the data's edge, as a share of the radius; 0.235 is the edge itself
        for points that fill a half plane, what is more makes up for the cubes lost at the edge
    agreement : shortest mean normal that counts as one surface, 0 to 1
    min_points : least number of points, each counted by its nearness, that supports the surface
    min_component : smallest connected component that is kept, as a share of the largest one's faces
    longest_rim_mm : holes with a rim up to this long are closed; pinholes, with a rim of up to 8
        voxels, always are
    memory_gb : the surface is refused where it would need more
    """

    voxel_mm: float | None = None
    radius: float = 3.5
    radius_spacings: float = 3.5
    radius_sigmas: float = 5.0
    overhang: float = 0.4
    agreement: float = 0.5
    min_points: float = 2.0
    min_component: float = 0.02
    longest_rim_mm: float = 0.0
    memory_gb: float = 4.0

    def __post_init__(self) -> None:
        if self.voxel_mm is not None and not (np.isfinite(self.voxel_mm) and self.voxel_mm > 0):
            raise ValueError(f"voxel_mm is {self.voxel_mm}, expected a length above 0")
        if not 1 <= self.radius <= 8:
            raise ValueError(f"radius is {self.radius} voxels, expected 1 to 8")
        for name in ("radius_spacings", "radius_sigmas", "overhang", "min_points", "longest_rim_mm"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name)}, expected at least 0")
        for name in ("agreement", "min_component"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} is {getattr(self, name)}, expected 0 to 1")
        if not self.memory_gb > 0:
            raise ValueError(f"memory_gb is {self.memory_gb}, expected more than 0")


def surface_from_cloud(cloud: Cloud, parameters: SurfaceParameters = SurfaceParameters()) -> Mesh:
    """Fit the algebraic point set surface to a cloud and triangulate it, as `surface_from_clouds` does for several."""
    return surface_from_clouds([cloud], parameters)


def surface_from_clouds(clouds: Sequence[Cloud], parameters: SurfaceParameters = SurfaceParameters()) -> Mesh:
    """Fit one algebraic point set surface to the points of all clouds and triangulate it.

    Holes stay open where no points support a surface, unless they are asked to be closed. Where the clouds of several
    sensors colour a vertex, the one with the most points there decides.

    Raises
    ------
    NoSurfaceError
        If the cloud is empty or nearly so, or its points support no surface.
    ValueError
        If the samples would not fit into memory.
    """
    _check_number(sum(map(len, clouds)))
    parameters = with_voxel(clouds, parameters)
    mesh = shape_from_clouds(clouds, parameters)
    assert parameters.voxel_mm is not None
    mesh = colour_vertices(mesh, [cloud for cloud in clouds if len(cloud)], parameters.voxel_mm)
    return with_small_holes_closed(mesh, parameters)


def shape_from_clouds(clouds: Sequence[Cloud], parameters: SurfaceParameters) -> Mesh:
    """Make the surface as `surface_from_clouds`, its colours as smooth as its shape, and its holes open."""
    cloud = merge_clouds(clouds)
    _check_number(len(cloud))
    voxel = parameters.voxel_mm
    assert voxel is not None
    cells, band = _sampled(cloud, voxel, parameters)
    field, gradient, colour = signed_field(
        cells, band, overhang=parameters.overhang, agreement=parameters.agreement, min_points=parameters.min_points
    )
    vertices, faces, normals, colours = march(field, gradient, colour, band.blocks, band.neighbours)
    if not len(faces):
        raise NoSurfaceError(
            f"{len(cloud)} points about {spacing(cloud):.3g} mm apart support no surface at a voxel of {voxel:g} mm; "
            "take more points or a larger voxel"
        )
    mesh = Mesh((vertices * voxel).astype(np.float32), faces, normals, colours)
    return drop_small_components(mesh, parameters.min_component)


def _check_number(n_points: int) -> None:
    if n_points < MIN_POINTS:
        raise NoSurfaceError(f"the cloud has {n_points} points: a surface needs at least {MIN_POINTS}")


def with_small_holes_closed(mesh: Mesh, parameters: SurfaceParameters) -> Mesh:
    """Close the holes that are asked to be, and pinholes."""
    assert parameters.voxel_mm is not None
    return close_holes(mesh, max(parameters.longest_rim_mm, PINHOLE_VOXELS * parameters.voxel_mm))


def with_voxel(clouds: Sequence[Cloud], parameters: SurfaceParameters) -> SurfaceParameters:
    """Choose a voxel for these clouds, where the parameters give none."""
    return parameters if parameters.voxel_mm else replace(parameters, voxel_mm=default_voxel(clouds))


def default_voxel(clouds: Sequence[Cloud]) -> float:
    """Choose a voxel, mm, for clouds of single sensors: by the points' spacing and their depth error.

    Raises
    ------
    NoSurfaceError
        If the points of every cloud lie in one place.
    """
    lengths = [
        max(SPACINGS_PER_VOXEL * spacing(cloud), SIGMAS_PER_VOXEL * _depth_error(cloud))
        for cloud in clouds
        if len(cloud)
    ]
    voxel = float(np.median(lengths)) if lengths else 0.0
    if not voxel > 0:
        raise NoSurfaceError(f"{sum(map(len, clouds))} points in one place have no spacing: a surface needs an extent")
    return float(f"{10 ** (round(VOXELS_PER_DECADE * np.log10(voxel)) / VOXELS_PER_DECADE):.3g}")


def spacing(cloud: Cloud) -> float:
    """Estimate the mean distance of neighbouring points, mm, from the area that the cloud covers."""
    lowest = cloud.points.min(axis=0)
    size = float((cloud.points.max(axis=0) - lowest).max())
    if size == 0:
        return 0.0
    for n_cells in COARSE_CELLS:
        coarse = np.floor((cloud.points - lowest) * (n_cells / size)).astype(np.int64)
        cells = np.sort((coarse[:, 0] << 20) | (coarse[:, 1] << 10) | coarse[:, 2])  # `np.unique` hashes, more slowly
        occupied = np.count_nonzero(np.diff(cells)) + 1
        if len(cloud) >= POINTS_PER_COARSE_CELL * occupied:
            break
    return size / n_cells * float(np.sqrt(occupied / CELLS_PER_AREA / len(cloud)))


def _depth_error(cloud: Cloud) -> float:
    return 0.0 if cloud.sigma is None else float(np.median(cloud.sigma))


def _sampled(cloud: Cloud, voxel: float, parameters: SurfaceParameters) -> tuple[Cells, Band]:
    """Make the cloud's cells and the band around them, if they fit into memory."""
    if extent_in_blocks(cloud, voxel) > LARGEST_AXIS:
        raise _too_large(cloud, voxel, parameters, "more samples than can be numbered")
    cells = gather(cloud, voxel, _reach(parameters))
    band = band_around(cells)
    needed = _gigabytes(cloud, band)
    if needed > parameters.memory_gb:
        raise _too_large(
            cloud, voxel, parameters, f"{needed:.3g} GB, more than the {parameters.memory_gb:g} GB allowed"
        )
    return cells, band


def _reach(parameters: SurfaceParameters) -> Reach:
    return Reach(parameters.radius, parameters.radius_spacings, parameters.radius_sigmas)


def _gigabytes(cloud: Cloud, band: Band) -> float:
    return (len(band.blocks) * BYTES_PER_BLOCK + len(cloud) * BYTES_PER_POINT) / 1e9


def _too_large(cloud: Cloud, voxel: float, parameters: SurfaceParameters, need: str) -> ValueError:
    fitting = voxel
    while extent_in_blocks(cloud, fitting) > LARGEST_AXIS:
        fitting *= 2
    while (needed := _gigabytes(cloud, band_around(gather(cloud, fitting, _reach(parameters))))) > parameters.memory_gb:
        fitting *= max(1.05, (needed / parameters.memory_gb) ** 0.5)  # the band grows with the inverse square
    return ValueError(f"a voxel of {voxel:g} mm would need {need}; a voxel of {fitting:.3g} mm fits")
