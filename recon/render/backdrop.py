"""The picture behind the model: a soft gradient and a floor that carries the model's shadows."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.mesh import Model
from recon.geometry.rig import Camera
from recon.geometry.splats import Splats
from recon.render.heights import height_map
from recon.render.rasterise import in_threads
from recon.render.scene import Scene

CONTACT_HEIGHT = 0.06  # of the bounds' radius: how far above the floor a surface still darkens it by contact
PENUMBRA_HEIGHT = 0.5  # of the bounds' radius: from how high a surface casts the wide, soft shadow alone
NARROW, WIDE = 0.012, 0.07  # standard deviation of the shadows' edges, of the floor map's side
FADE = 2.2  # radii of the bounds after which the floor is half the horizon's colour


def floor_shade(model: Model, scene: Scene) -> NDArray[np.float32]:
    """Compute how much darker the floor is below a model.

    Returns
    -------
    float32 (rows, columns) over the square of `Scene.floor_grid`, 0 (as it is) to 1 (black), 0 along the border
    """
    background = scene.background
    if not background.has_floor:
        return np.zeros((2, 2), dtype=np.float32)
    if isinstance(model, Splats):  # those of a sky or a room would darken the whole floor
        low, high = scene.bounds
        model = model.select(((model.centres >= low) & (model.centres <= high)).all(axis=1))
    straight, oblique = (
        height_map(model, grid)
        for grid in (scene.floor_grid(np.array([0.0, 1.0, 0.0])), scene.floor_grid(scene.to_light))
    )
    radius = scene.radius
    contact = np.exp(-np.maximum(straight, 0) / np.float32(CONTACT_HEIGHT * radius))
    contact = np.maximum(_blurred(contact, NARROW), _blurred(contact, WIDE))
    is_cast = np.isfinite(oblique)
    high = np.clip(np.where(is_cast, oblique, 0) / np.float32(PENUMBRA_HEIGHT * radius), 0, 1).astype(np.float32)
    cast = _blurred(is_cast * (1 - high), NARROW) + _blurred(is_cast * high, WIDE)
    shade = 1 - (1 - background.contact * contact) * (1 - background.cast * np.minimum(cast, 1))
    return np.ascontiguousarray(shade * _window(shade.shape), np.float32)


def backdrop(scene: Scene, camera: Camera, shade: NDArray[np.float32], *, threads: int = 1) -> NDArray[np.uint8]:
    """Draw the scene without its model as a camera sees it.

    Parameters
    ----------
    scene : background and floor
    camera : without distortion
    shade : as `floor_shade` returns it
    threads : how many threads share the rows; the picture does not depend on it

    Returns
    -------
    uint8 (H, W, 3), sRGB
    """
    background = scene.background
    picture = np.empty((camera.size[1], camera.size[0], 3), dtype=np.uint8)
    rays = (camera.rotation.T @ np.linalg.inv(camera.K)).astype(np.float32)  # world direction of a pixel, unnormalised
    surroundings = _Surroundings(
        start=(camera.centre - scene.centre).astype(np.float32),
        drop=np.float32(camera.centre[1] - scene.floor_y) if background.has_floor else np.float32(-1),
        colours=np.array([background.floor, background.horizon, background.zenith], dtype=np.float32),
        shade=shade,
        texel=np.float32(2 * scene.floor_reach / (shade.shape[0] - 1)),
        fade=np.float32(FADE * scene.radius),
    )

    def draw(first: int) -> None:
        _draw_backdrop(picture, rays, surroundings, first, threads)

    in_threads(draw, threads)
    return picture


def _blurred(image: NDArray[np.floating], share: float) -> NDArray[np.float32]:
    """Blur by a Gaussian whose standard deviation is a share of the image's width."""
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), share * image.shape[1]), np.float32)


def _window(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Weigh texels 1 inside, falling to 0 at the border within a tenth of the width: no shadow ends in an edge."""
    ramps = [np.clip(np.minimum(np.arange(n), np.arange(n)[::-1]) / (0.1 * n), 0, 1) for n in shape]
    smooth = [ramp * ramp * (3 - 2 * ramp) for ramp in ramps]
    return np.asarray(np.outer(smooth[0], smooth[1]), np.float32)


class _Surroundings(NamedTuple):
    """What a camera sees from `start`, `drop` above the floor; that is negative where there is none."""

    start: NDArray[np.float32]
    drop: np.float32
    colours: NDArray[np.float32]
    shade: NDArray[np.float32]
    texel: np.float32
    fade: np.float32


@njit(cache=True, nogil=True)
def _draw_backdrop(picture, rays, surroundings, first, step):  # type: ignore[no-untyped-def]  # numba
    """Draw every `step`-th row from `first` on."""
    start, drop, colours, shade, texel, fade = surroundings
    full = np.float32(1)
    middle = np.float32((shade.shape[0] - 1) * 0.5)
    for y in range(first, picture.shape[0], step):
        for x in range(picture.shape[1]):
            fx, fy = np.float32(x), np.float32(y)
            dx = rays[0, 0] * fx + rays[0, 1] * fy + rays[0, 2]
            dy = rays[1, 0] * fx + rays[1, 1] * fy + rays[1, 2]
            dz = rays[2, 0] * fx + rays[2, 1] * fy + rays[2, 2]
            near, far, mix, light = 1, 2, np.float32(0), full  # colours to mix, share of the second
            if dy > 0:
                slope = dy / np.sqrt(dx * dx + dy * dy + dz * dz)
                mix = slope * slope * (np.float32(3) - np.float32(2) * slope)
            elif dy < 0 and drop > 0:
                along = -drop / dy
                px, pz = start[0] + along * dx, start[2] + along * dz
                distance = px * px + pz * pz
                near, far, mix = 0, 1, distance / (distance + fade * fade)
                u, v = px / texel + middle, pz / texel + middle
                if u >= 0 and v >= 0 and u < shade.shape[1] - 1 and v < shade.shape[0] - 1:
                    j, i = int(u), int(v)
                    s, t = u - np.float32(j), v - np.float32(i)
                    upper = shade[i, j] * (full - s) + shade[i, j + 1] * s
                    lower = shade[i + 1, j] * (full - s) + shade[i + 1, j + 1] * s
                    light = full - (upper * (full - t) + lower * t)
            # Interleaved gradient noise instead of rounding: without it the gradient shows bands.
            noise = np.float32(0.06711056) * fx + np.float32(0.00583715) * fy
            noise = np.float32(52.9829189) * (noise - np.floor(noise))
            noise = noise - np.floor(noise)
            for channel in range(3):
                value = colours[near, channel] + (colours[far, channel] - colours[near, channel]) * mix
                picture[y, x, channel] = np.uint8(min(value * light + noise, np.float32(255)))
