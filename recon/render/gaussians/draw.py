"""Splats over a picture: front to back in tiles of 16 pixels, each drawn by one thread.

The picture is the same, bit by bit, for any number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from recon.geometry.rig import Camera
from recon.geometry.splats import Splats
from recon.render.gaussians.projection import LEAST_ALPHA, project
from recon.render.gaussians.tiles import TILE, binned, nearest_first
from recon.render.rasterise import in_threads

MOST_ALPHA = np.float32(0.999)
FINISHED = np.float32(1e-4)  # share of what lies behind that may be left out
LEAST = np.float32(LEAST_ALPHA)
LOWEST = np.float32(-6)  # of exponents; e to it is less than LEAST_ALPHA
SPLATS_BETWEEN_LOOKS = 16  # for rows of a tile that nothing is seen through any more


def render_splats(
    splats: Splats,
    camera: Camera,
    *,
    size: tuple[int, int] | None = None,
    background: Sequence[float] = (0.0, 0.0, 0.0),
    threads: int | None = None,
) -> NDArray[np.uint8]:
    """Draw splats over one colour.

    Parameters
    ----------
    splats : in the camera's world
    camera : from where; its distortion is not applied
    size : (width, height), pixels; default: the camera's
    background : red, green, blue, 0 to 1, as the screen shows them
    threads : how many threads share the work; the picture does not depend on it; default: all

    Returns
    -------
    uint8 (H, W, 3), sRGB

    Raises
    ------
    ValueError
        If the background is no colour.
    """
    behind: NDArray[np.float32] = np.asarray(background, np.float32)
    if behind.shape != (3,) or not (np.isfinite(behind) & (behind >= 0) & (behind <= 1)).all():
        raise ValueError(f"background is {background!r}, expected red, green and blue from 0 to 1")
    width, height = size or camera.size
    layer = splat_layer(splats, camera, (width, height), threads=threads or os.cpu_count() or 1)
    picture = np.empty((height, width, 3), np.uint8)
    _lay_over(layer, behind.reshape(1, 1, 3) * np.float32(255), picture)
    return picture


def draw_splats(picture: NDArray[np.uint8], splats: Splats, camera: Camera, *, threads: int = 1) -> None:
    """Draw splats over a picture, uint8 (H, W, 3), in place.

    Parameters
    ----------
    picture : sRGB
    splats, camera : as for `render_splats`
    threads : how many threads share the work; the picture does not depend on it
    """
    lay_over(picture, splat_layer(splats, camera, (picture.shape[1], picture.shape[0]), threads=threads))


def lay_over(picture: NDArray[np.uint8], layer: NDArray[np.float32]) -> None:
    """Lay drawn splats, as `splat_layer` returns them, over a picture, uint8 (H, W, 3), in place."""
    _lay_over(layer, picture.astype(np.float32), picture)


def splat_layer(splats: Splats, camera: Camera, size: tuple[int, int], *, threads: int = 1) -> NDArray[np.float32]:
    """Draw splats alone.

    Parameters
    ----------
    splats, camera, threads : as for `render_splats`
    size : (width, height), pixels

    Returns
    -------
    float32 (H, W, 4): red, green and blue, 0 to 1 and beyond, as far as they cover, and the share that stays uncovered
    """
    ellipses = project(splats, camera, size, threads=threads)
    order = nearest_first(ellipses.depths)
    starts, members = binned(ellipses, order, size, threads=threads)
    layer = np.empty((size[1], size[0], 4), np.float32)
    n_columns = -(-size[0] // TILE)

    def draw(first: int) -> None:
        _draw_tiles(ellipses, starts, members, layer, n_columns, first, threads)

    in_threads(draw, threads)
    return layer


@njit(cache=True, nogil=True, error_model="numpy")
def _draw_tiles(ellipses, starts, members, layer, n_columns, first, step):  # type: ignore[no-untyped-def]  # numba
    """Draw every `step`-th tile from `first` on."""
    height, width = layer.shape[0], layer.shape[1]
    tile_layer = np.empty((TILE, 4, TILE), np.float32)
    is_open = np.empty(TILE, np.bool_)
    for tile in range(first, starts.shape[0] - 1, step):
        y0, x0 = tile // n_columns * TILE, tile % n_columns * TILE
        tile_layer[:, :3] = 0
        tile_layer[:, 3] = 1
        is_open[:] = True
        n_open = TILE
        for m in range(starts[tile], starts[tile + 1]):
            i = members[m]
            place = ellipses.places[i, 0] - np.float32(x0), ellipses.places[i, 1] - np.float32(y0)
            _cover(place, ellipses.reaches[i, 1], ellipses.shapes[i], ellipses.colours[i], tile_layer, is_open)
            if (m - starts[tile]) % SPLATS_BETWEEN_LOOKS == SPLATS_BETWEEN_LOOKS - 1:
                n_open = _look(tile_layer, is_open)
                if n_open == 0:
                    break
        for y in range(y0, min(y0 + TILE, height)):
            for x in range(x0, min(x0 + TILE, width)):
                for channel in range(4):
                    layer[y, x, channel] = tile_layer[y - y0, channel, x - x0]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _look(tile_layer, is_open):  # type: ignore[no-untyped-def]  # numba
    """Close the rows that nothing is seen through; returns how many are open."""
    n_open = 0
    for row in range(TILE):
        if is_open[row]:
            n_seen = 0
            for x in range(TILE):
                n_seen += tile_layer[row, 3, x] > FINISHED
            is_open[row] = n_seen > 0
            n_open += n_seen > 0
    return n_open


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _cover(place, reach, shape, colour, tile_layer, is_open):  # type: ignore[no-untyped-def]  # numba
    """Lay a splat behind what a tile shows already: whole rows at once, for the processor's wide registers."""
    full, half = np.float32(1), np.float32(0.5)
    x, y = place
    top, bottom = max(0, int(np.ceil(y - reach))), min(TILE - 1, int(np.floor(y + reach)))
    xx, xy, yy, opacity = -half * shape[0], -shape[1], -half * shape[2], shape[3]
    red, green, blue = colour[0], colour[1], colour[2]
    for row in range(top, bottom + 1):
        if not is_open[row]:
            continue
        dy = np.float32(row) - y
        line = tile_layer[row]
        constant, slope = yy * dy * dy, xy * dy
        for column in range(TILE):
            dx = np.float32(column) - x
            power = (xx * dx + slope) * dx + constant
            power = power if power > LOWEST else LOWEST
            # e to the power: a polynomial for a sixteenth of it, then its sixteenth power; relative error 2e-6.
            t = power * np.float32(1 / 16)
            e = full + t * (
                full
                + t
                * (
                    half
                    + t
                    * (
                        np.float32(1 / 6)
                        + t * (np.float32(1 / 24) + t * (np.float32(1 / 120) + t * np.float32(1 / 720)))
                    )
                )
            )
            e = e * e
            e = e * e
            e = e * e
            e = e * e
            alpha = opacity * e
            alpha = alpha if alpha < MOST_ALPHA else MOST_ALPHA
            alpha = alpha if alpha >= LEAST else np.float32(0)
            share = alpha * line[3, column]
            line[0, column] += red * share
            line[1, column] += green * share
            line[2, column] += blue * share
            line[3, column] -= share


@njit(cache=True, nogil=True, error_model="numpy")
def _lay_over(layer, behind, picture):  # type: ignore[no-untyped-def]  # numba
    """Lay splats over what is behind them, float32 (H or 1, W or 1, 3), 0 to 255."""
    is_picture = behind.shape[0] > 1 or behind.shape[1] > 1
    for y in range(picture.shape[0]):
        for x in range(picture.shape[1]):
            seen = behind[y, x] if is_picture else behind[0, 0]
            for channel in range(3):
                value = layer[y, x, channel] * np.float32(255) + layer[y, x, 3] * seen[channel]
                picture[y, x, channel] = np.uint8(min(value, np.float32(255)) + np.float32(0.5))
