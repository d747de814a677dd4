"""Background, floor and light around the model, the same for every approach of a dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import Texture
from recon.geometry.rig import Camera, bounds_corners, checked_bounds, direction_of, look_at
from recon.geometry.splats import Splats

KEY_AZIMUTH_DEG = 35.0  # the light stands to the left behind the camera, as in a portrait
KEY_ELEVATION_DEG = 55.0
SHADOW_TEXELS = 1024  # of the shadow map's longer side
FLOOR_TEXELS = 256  # of the map of shadows on the floor

Real = TypeVar("Real", np.float32, np.float64)


@dataclass(frozen=True)
class Background:
    """An artificial background and its light.

    Parameters
    ----------
    floor, horizon, zenith : sRGB colours, 0 to 255; the floor fades into the horizon, the horizon into the zenith
    has_floor : whether there is a floor, and with it shadows on it
    ambient : share of the light that reaches every surface alike; 1 leaves the captured colours what they were
    sky : share of the ambient light that a surface facing straight down does not get
    cast, contact : how dark the key light's shadow and the contact shadow on the floor are at most, 0 to 1
    """

    floor: tuple[float, float, float]
    horizon: tuple[float, float, float]
    zenith: tuple[float, float, float]
    has_floor: bool = True
    ambient: float = 0.62
    sky: float = 0.25
    cast: float = 0.38
    contact: float = 0.55


BACKGROUNDS: dict[str, Background] = {
    "studio": Background(floor=(216, 215, 212), horizon=(186, 187, 188), zenith=(142, 146, 152)),
    "dark": Background(floor=(74, 75, 78), horizon=(46, 47, 50), zenith=(24, 25, 28), cast=0.45, contact=0.6),
    "plain": Background(
        floor=(128, 128, 128), horizon=(128, 128, 128), zenith=(128, 128, 128), has_floor=False, ambient=1.0, sky=0.0
    ),
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A background placed around the bounds of a dataset.

    Parameters
    ----------
    background : its colours and light
    bounds : float64 (2, 3), mm
    to_light : float64 (3,), unit length, towards the key light
    floor_y : height of the floor, mm
    """

    background: Background
    bounds: NDArray[np.float64]
    to_light: NDArray[np.float64]
    floor_y: float

    @property
    def centre(self) -> NDArray[np.float64]:
        """Middle of the bounds, float64 (3,), mm."""
        return np.asarray(self.bounds.mean(axis=0))

    @property
    def radius(self) -> float:
        """Half the diagonal of the bounds, mm."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0])) / 2

    def without_light(self) -> Scene:
        """Return the scene with models in the colours that they bring, as splats are; shadows on the floor stay."""
        return replace(self, background=replace(self.background, ambient=1.0, sky=0.0))

    def light_grid(self) -> TexelGrid:
        """Project along the key light onto a grid that holds the bounds; depth grows away from the light."""
        pose = look_at(self.centre + self.to_light, self.centre)
        corners = bounds_corners(self.bounds) @ pose[:3, :3].T + pose[:3, 3]
        low, high = corners.min(axis=0)[:2], corners.max(axis=0)[:2]
        texel = float((high - low).max()) / (SHADOW_TEXELS - 1)
        rows, columns = int(np.ceil((high - low)[1] / texel)) + 1, int(np.ceil((high - low)[0] / texel)) + 1
        transform = pose[:3].copy()
        transform[:2] /= texel
        transform[:2, 3] -= low / texel
        return TexelGrid(transform, (rows, columns), texel)

    def floor_grid(self, along: NDArray[np.floating]) -> TexelGrid:
        """Project onto the floor parallel to `along` (3,), upwards; depth is the height above the floor, mm.

        The grid is a square around the bounds that the longest shadow does not leave; column is x, row is z.
        """
        half = self.floor_reach
        texel = 2 * half / (FLOOR_TEXELS - 1)
        slope_x, slope_z = float(along[0] / along[1]), float(along[2] / along[1])
        to_floor = np.array([[1, -slope_x, 0, 0], [0, -slope_z, 1, 0], [0, 1, 0, -self.floor_y]], dtype=np.float64)
        to_floor[:2, 3] = (
            slope_x * self.floor_y - self.centre[0] + half,
            slope_z * self.floor_y - self.centre[2] + half,
        )
        to_floor[:2] /= texel
        return TexelGrid(to_floor, (FLOOR_TEXELS, FLOOR_TEXELS), texel)

    @property
    def floor_reach(self) -> float:
        """Half the side of the square of floor that can hold shadows, mm."""
        extent = self.bounds[1] - self.bounds[0]
        footprint = float(np.hypot(extent[0], extent[2])) / 2
        return 1.3 * footprint + float(extent[1]) / float(np.tan(np.deg2rad(KEY_ELEVATION_DEG)))


@dataclass(frozen=True, eq=False)
class TexelGrid:
    """A parallel projection of the world onto a square of texels, for maps of shadows.

    Parameters
    ----------
    texels_from_world : float64 (3, 4): column, row (texels) and depth (mm) of a world point
    shape : (rows, columns)
    texel : mm
    """

    texels_from_world: NDArray[np.float64]
    shape: tuple[int, int]
    texel: float

    def project(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Project points (N, 3) to column, row and depth, float32 (N, 3)."""
        return transformed(points.astype(np.float32, copy=False), self.texels_from_world.astype(np.float32))


@dataclass(frozen=True, eq=False)
class LitMesh:
    """A mesh with the colours to show on either side of it.

    Parameters
    ----------
    vertices : float32 (N, 3), mm
    faces : int32 (M, 3)
    front, back : uint8 (N, 3), sRGB; with a texture the share of its colours that the light leaves, 255 for all
    texture : of the same N vertices; None for none
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    front: NDArray[np.uint8]
    back: NDArray[np.uint8]
    texture: Texture | None = None


@dataclass(frozen=True, eq=False)
class LitDiscs:
    """Points with the colours to show, each as a disc that faces the camera.

    Parameters
    ----------
    vertices : float32 (N, 3), mm, middles of the discs
    colours : uint8 (N, 3), sRGB
    radius_mm : of the discs, mm
    """

    vertices: NDArray[np.float32]
    colours: NDArray[np.uint8]
    radius_mm: float


LitModel = LitMesh | LitDiscs | Splats  # splats have the light that they were trained with


@dataclass(frozen=True, eq=False)
class Shot:
    """A renderer's task: to draw a model over a picture.

    Parameters
    ----------
    model : lit
    camera : from where
    picture : uint8 (H, W, 3), the scene without the model; the renderer may draw over it
    threads : how many threads the renderer may use
    """

    model: LitModel
    camera: Camera
    picture: NDArray[np.uint8]
    threads: int = 1


def check_background(name: str) -> None:
    """Raise a ValueError if there is no such background."""
    if name not in BACKGROUNDS:
        raise ValueError(f"there is no background {name!r}; expected one of {', '.join(BACKGROUNDS)}")


def scene_around(
    bounds: NDArray[np.floating],
    cameras: Sequence[Camera],
    background: str = "studio",
    *,
    floor_y: float | None = None,
) -> Scene:
    """Place a background around a dataset, lit from beside its whole camera path, for every frame and approach.

    Parameters
    ----------
    bounds : floating (2, 3), mm, lowest and highest corner
    cameras : of the whole path
    background : a name in `BACKGROUNDS`
    floor_y : height of the floor, mm; None for the bottom of the bounds

    Raises
    ------
    ValueError
        If there is no such background, no camera, or the bounds are empty.
    """
    check_background(background)
    if not cameras:
        raise ValueError("a scene needs the cameras that look at it, found none")
    bounds = checked_bounds(bounds)
    floor_y = float(bounds[0, 1]) if floor_y is None else floor_y
    return Scene(BACKGROUNDS[background], bounds, _key_direction(bounds.mean(axis=0), cameras), floor_y)


def transformed(points: NDArray[Real], transform: NDArray[Real]) -> NDArray[Real]:
    """Transform points (N, 3) by an affine matrix (3, 4).

    Written out, because the linear algebra library may round differently with its number of threads.
    """
    x, y, z = points.T
    return np.stack([row[0] * x + row[1] * y + row[2] * z + row[3] for row in transform], axis=1)


def _key_direction(centre: NDArray[np.float64], cameras: Sequence[Camera]) -> NDArray[np.float64]:
    """Point towards the key light: to the left of where the cameras stand on average, and above."""
    towards = np.mean([camera.centre - centre for camera in cameras], axis=0)
    first = cameras[0].centre - centre
    if np.linalg.norm(towards[[0, 2]]) < 0.05 * np.linalg.norm(first):  # a whole orbit has no mean direction
        towards = first
    azimuth = float(np.arctan2(towards[0], towards[2])) - float(np.deg2rad(KEY_AZIMUTH_DEG))
    return direction_of(azimuth, float(np.deg2rad(KEY_ELEVATION_DEG)))
