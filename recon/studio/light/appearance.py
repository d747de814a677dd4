"""What actors, objects and the studio around them look like: the colours of their surfaces, in their light.

Every colour is a function of the place on the body at rest, so that texture moves with the surface. Noise of
several wavelengths is faded out where a pixel is too coarse to hold it (`fp`, a pixel's footprint in mm), so nothing
aliases. Colours are linear here; looks are rows as in `looks`. All kernels stand in this one file because
numba's cache needs it.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from recon.studio.light.looks import (
    EYES_CLOSED,
    FIFTH,
    FIRST,
    FOURTH,
    HALF_SIZE,
    KIND,
    LONG_HAIR,
    PATTERN,
    SECOND,
    SHIFT,
    SLEEVE,
    THIRD,
)
from recon.studio.rasterise import Visibility


class Actors(NamedTuple):
    """Bodies in their light.

    Parameters
    ----------
    faces : int32 (M, 3)
    lit : float32 (N, 7), as from `lighting.lit`
    owners : int64 (M,), the row of `looks` per face
    looks : float64 (K, N_LOOK), see `looks`
    volume : float32 (S, S, S), noise
    """

    faces: NDArray[np.int32]
    lit: NDArray[np.float32]
    owners: NDArray[np.int64]
    looks: NDArray[np.float64]
    volume: NDArray[np.float32]


class Rays(NamedTuple):
    """The rays of a camera's pixels.

    Parameters
    ----------
    slopes : float64 (H, W, 2), x / z and y / z in the camera
    camera_to_world : float64 (3, 3), world axes from camera axes
    eye : float64 (3,), mm
    spread : size of a pixel at a distance of 1 mm
    """

    slopes: NDArray[np.float64]
    camera_to_world: NDArray[np.float64]
    eye: NDArray[np.float64]
    spread: float


class Room(NamedTuple):
    """The empty studio.

    Parameters
    ----------
    radius, floor_y : mm, of the curtain around the world's y axis, and of the floor
    curtain, floor : float64 (3,), linear colours
    """

    radius: float
    floor_y: float
    curtain: NDArray[np.float64]
    floor: NDArray[np.float64]


# Middles of the nails of the left hand at rest, mm: the right one's are mirrored.
NAILS = (
    (651.2, 875.3, 46.4), (658.8, 863.0, 16.1), (657.2, 866.7, -16.9), (646.4, 885.3, -45.2), (607.6, 921.8, 69.6),
)  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _noise(volume: NDArray[np.float32], x: float, y: float, z: float) -> float:
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    tx, ty, tz = x - fx, y - fy, z - fz
    i0, j0, k0 = np.uint64(np.int64(fx) & 63), np.uint64(np.int64(fy) & 63), np.uint64(np.int64(fz) & 63)
    i1, j1, k1 = (
        np.uint64((np.int64(fx) + 1) & 63),
        np.uint64((np.int64(fy) + 1) & 63),
        np.uint64((np.int64(fz) + 1) & 63),
    )
    tx, ty, tz = tx * tx * (3.0 - 2.0 * tx), ty * ty * (3.0 - 2.0 * ty), tz * tz * (3.0 - 2.0 * tz)
    a = volume[i0, j0, k0] + tz * (volume[i0, j0, k1] - volume[i0, j0, k0])
    b = volume[i0, j1, k0] + tz * (volume[i0, j1, k1] - volume[i0, j1, k0])
    c = volume[i1, j0, k0] + tz * (volume[i1, j0, k1] - volume[i1, j0, k0])
    d = volume[i1, j1, k0] + tz * (volume[i1, j1, k1] - volume[i1, j1, k0])
    a += ty * (b - a)
    c += ty * (d - c)
    return float(a + tx * (c - a))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _step(value: float, low: float, high: float) -> float:
    t = min(1.0, max(0.0, (value - low) / (high - low)))
    return t * t * (3.0 - 2.0 * t)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _layer(volume: NDArray[np.float32], x: float, y: float, z: float, cell: float, footprint: float) -> float:
    """Sample noise with features of `cell` mm; a cell under half a pixel is averaged away."""
    if cell < 0.5 * footprint:
        return 0.0
    inverse = 1.0 / cell
    fade = 1.0 if cell > 1.5 * footprint else cell / footprint - 0.5
    return float(fade * _noise(volume, x * inverse, y * inverse + 0.37 * cell, z * inverse))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _wave(u: float, period: float, footprint: float) -> float:
    """Return a soft square wave of u, -1 to 1, faded where a pixel cannot hold it."""
    return float(_step(period / footprint, 1.5, 4.0) * min(1.0, max(-1.0, 3.0 * _zigzag(u / period))))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _zigzag(u: float) -> float:
    """Return a triangle wave of period 1, -1 to 1: a cheap stand-in for a sine."""
    return float(4.0 * abs(u - np.floor(u + 0.5)) - 1.0)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _skin(
    look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float, fp: float
) -> tuple[float, float, float]:
    s = look[SHIFT]
    broad = _layer(volume, x, y + s, z, 22.0, fp)
    tone = 1.0 + 0.06 * broad + 0.07 * _layer(volume, x, y + s, z, 9.0, fp)
    tone += 0.08 * _layer(volume, x, y, z + s, 3.1, fp) + 0.10 * _layer(volume, x + s, y, z, 1.3, fp)
    red = 0.10 * broad
    ax = abs(x)
    if ax > 560.0:
        hand: tuple[float, float, float] = _hand(look, ax, y, z, fp, tone, red)
        return hand
    r, g, b = (
        look[FIRST] * tone * (1.0 + 0.3 * red),
        look[FIRST + 1] * tone * (1.0 - red),
        look[FIRST + 2] * tone * (1.0 - red),
    )
    if y < 1540.0 or z < 30.0:
        if ax > 66.0 and y > 1600.0:  # ears are redder
            g, b = g * 0.90, b * 0.90
        return r, g, b
    if ax < 80.0 and abs(y - 1635.0) < 50.0:  # cheeks and nose are redder
        flush = np.exp(-((ax - 40.0) ** 2 + (y - 1636.0) ** 2) / 520.0) + np.exp(-(x * x + (y - 1629.0) ** 2) / 150.0)
        g, b = g * (1.0 - 0.13 * flush), b * (1.0 - 0.13 * flush)
        nostril = np.exp(-((ax - 5.5) ** 2 / 9.0 + (y - 1620.5) ** 2 / 5.0)) * _step(z, 92.0, 97.0)
        r, g, b = r * (1.0 - 0.6 * nostril), g * (1.0 - 0.7 * nostril), b * (1.0 - 0.7 * nostril)
    # Lips, and the dark line between them, which rises at the corners.
    width = 24.0
    if ax < width + 4.0 and z > 60.0 and abs(y - 1596.0) < 18.0:
        side = ax / width
        arch = np.sqrt(max(0.0, 1.0 - side * side))
        middle = 1595.5 + 2.6 * side * side
        upper = middle + (7.2 - 1.6 * np.exp(-x * x / 14.0)) * arch
        lower = middle - 9.0 * arch
        edge = 0.9 + 0.4 * fp
        lips = _step(upper - y, -edge, edge) * _step(y - lower, -edge, edge)
        lips *= 1.0 + 0.25 * _layer(volume, 2.2 * x, 0.4 * y, z, 2.2, fp)
        r, g, b = r * (1.0 - 0.10 * lips), g * (1.0 - 0.34 * lips), b * (1.0 - 0.28 * lips)
        gap = _step(1.2 - abs(y - middle), -0.4 - 0.5 * fp, 0.4 + 0.5 * fp) * _step(width + 1.0 - ax, 0.0, 7.0)
        r, g, b = r * (1.0 - 0.72 * gap), g * (1.0 - 0.84 * gap), b * (1.0 - 0.82 * gap)
    if 9.0 < ax < 56.0 and y > 1650.0:
        r, g, b = _eye(look, x, y, z, fp, (r, g, b))
        brow = 1690.5 - 0.0085 * (ax - 34.0) ** 2 - 0.05 * (ax - 34.0)
        thick = 3.4 * _step(ax, 8.0, 20.0) * (1.0 - 0.6 * _step(ax, 34.0, 53.0))
        if abs(y - brow) < thick + 2.5:
            hairs = _step(thick - abs(y - brow), -1.8, 1.4) * _step(ax, 10.0, 15.0) * _step(54.0 - ax, 0.0, 8.0)
            hairs *= 0.72 + 0.7 * _layer(volume, 1.4 * x - y * np.sign(x), 0.3 * y, z, 1.1, fp)
            hairs = min(0.9, max(0.0, hairs))
            r, g, b = (
                r + hairs * (look[FIFTH] - r),
                g + hairs * (look[FIFTH + 1] - g),
                b + hairs * (look[FIFTH + 2] - b),
            )
    return r, g, b


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _hand(
    look: NDArray[np.float64], ax: float, y: float, z: float, fp: float, tone: float, red: float
) -> tuple[float, float, float]:
    """Colour a hand: knuckles are redder, nails paler with a darker rim."""
    along, back = (ax - 552.0) * 0.683 - (y - 1014.0) * 0.730, (ax - 552.0) * 0.73 + (y - 1014.0) * 0.683
    for joint in (92.0, 135.0, 158.0):
        red += 0.10 * np.exp(-((along - joint) ** 2) / 40.0) * _step(back, -24.0, -6.0)
    red += 0.10 * _step(along, 140.0, 180.0)
    r, g, b = (
        look[FIRST] * tone * (1.0 + 0.2 * red),
        look[FIRST + 1] * tone * (1.0 - red),
        look[FIRST + 2] * tone * (1.0 - red),
    )
    if along < 98.0:
        return r, g, b
    nearest = 99.0
    for nx, ny, nz in NAILS:
        nearest = min(nearest, (ax - nx) ** 2 + (y - ny) ** 2 + (z - nz) ** 2)
    nearest = np.sqrt(nearest)
    soft = 0.4 + 0.5 * fp
    nail, rim = _step(5.2 - nearest, -soft, soft), _step(1.0 - abs(nearest - 5.4), -soft, soft)
    dark = 1.0 - 0.22 * rim
    return (
        (r + nail * (1.12 * look[FIRST] - r)) * dark,
        (g + nail * (1.06 * look[FIRST + 1] - g)) * dark,
        (b + nail * (1.10 * look[FIRST + 2] - b)) * dark,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _eye(
    look: NDArray[np.float64], x: float, y: float, z: float, fp: float, skin: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Colour an eye: white, iris, pupil and lids; look[EYES_CLOSED] is how far the lids are closed."""
    r, g, b = skin
    ex, ey = abs(x) - 32.0, y - 1666.5
    if abs(ex) > 20.0 or abs(ey) > 14.0 or z < 60.0:
        return r, g, b
    arch = max(0.0, 1.0 - (ex / 14.5) ** 2)
    tilt = 0.05 * ex  # outer corners are higher
    top = tilt + arch * (4.7 - 9.1 * look[EYES_CLOSED])  # the upper lid covers the iris's edge, or the look is a stare
    bottom = tilt - 4.5 * arch
    soft = 0.4 + 0.5 * fp
    opened = _step(top - ey, -soft, soft) * _step(ey - bottom, -soft, soft) * _step(arch, 0.02, 0.15)
    shade = 1.0 - 0.35 * _step(ey - top, -3.5, 0.0) - 0.25 * _step(abs(ex), 8.0, 14.0)  # by the lid, in the corners
    white = 0.50 * shade
    radius = np.sqrt((x - np.sign(x) * 32.0) ** 2 + (ey - 0.4) ** 2)
    iris = _step(5.9 - radius, -soft, soft)
    ring = 0.55 + 0.45 * _step(5.2 - radius, -0.6 - soft, 0.6 + soft)
    pupil = _step(2.3 - radius, -soft, soft)
    glint = _step(1.1 - np.sqrt((x - np.sign(x) * 32.0 + 1.8) ** 2 + (ey - 2.2) ** 2), -0.6, 0.6)
    blue = 0.5 + 0.5 * np.sin(0.9 * look[SHIFT])  # people's irises differ, brown to grey
    er = white + iris * ((0.11 - 0.03 * blue) * ring - white)
    eg = white * 0.96 + iris * ((0.06 + 0.05 * blue) * ring - white)
    eb = white * 0.92 + iris * ((0.03 + 0.09 * blue) * ring - white)
    er, eg, eb = (
        er * (1.0 - 0.88 * pupil) + 0.5 * glint,
        eg * (1.0 - 0.88 * pupil) + 0.5 * glint,
        eb * (1.0 - 0.88 * pupil) + 0.5 * glint,
    )
    lash = (1.0 - opened) * _step(1.3 - abs(ey - top), -soft, soft) * _step(arch, 0.0, 0.2)
    crease = 0.25 * _step(1.2 - abs(ey - tilt - 4.4 - 3.6 * arch), -soft, soft) * _step(arch, 0.0, 0.3)
    lower = 0.15 * _step(1.0 - abs(ey - bottom), -soft, soft) * arch
    dark = (1.0 - 0.75 * lash) * (1.0 - crease) * (1.0 - lower)
    r, g, b = r * dark, g * dark, b * dark
    return r + opened * (er - r), g + opened * (eg - g), b + opened * (eb - b)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _shirt(
    look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float, along: float, fp: float
) -> tuple[float, float, float]:
    s = look[SHIFT]
    if abs(x) > 190.0:  # a sleeve: along the arm and around it
        u, v = z + 0.3 * y, along
    else:
        u, v = 0.85 * x + 0.5 * z, y
    mix = 0.0
    if look[PATTERN] == 0.0:
        mix = 0.5 + 0.25 * _wave(u, 58.0, fp) + 0.25 * _wave(v, 58.0, fp)
        line = max(_step(abs(_zigzag(u / 58.0)), 0.16, 0.06), _step(abs(_zigzag(v / 58.0)), 0.16, 0.06))
        mix -= 0.45 * line * _step(6.0 / fp, 1.0, 2.5)
    elif look[PATTERN] == 1.0:
        mix = 0.5 + 0.5 * _wave(v, 46.0, fp)
    elif look[PATTERN] == 2.0:
        mix = 0.40 + 0.42 * _layer(volume, x + s, 0.6 * y, z, 5.0, fp) + 0.35 * _layer(volume, x, y + s, z, 1.9, fp)
    else:
        blot = _noise(volume, (x + s) / 24.0, y / 24.0, z / 24.0) + 0.4 * _layer(volume, x, y, z + s, 7.0, fp)
        mix = _step(abs(blot), 0.26 - 0.01 * fp, 0.34 + 0.01 * fp)
    mix = min(1.0, max(0.0, mix))
    tone = 1.0 + 0.10 * _layer(volume, x, y + s, z, 45.0, fp) + 0.14 * _layer(volume, x + s, y, z, 6.0, fp)
    tone += 0.18 * _layer(volume, x, y, z + s, 2.3, fp) + 0.18 * _layer(volume, x, y + s, z, 1.1, fp)
    if fp < 1.73:
        tone += 0.10 * _step(2.6 / fp, 1.5, 4.0) * _zigzag(u / 2.6) * _zigzag(v / 2.6)
    return (
        (look[SECOND] + mix * (look[THIRD] - look[SECOND])) * tone,
        (look[SECOND + 1] + mix * (look[THIRD + 1] - look[SECOND + 1])) * tone,
        (look[SECOND + 2] + mix * (look[THIRD + 2] - look[SECOND + 2])) * tone,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _trousers(
    look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float, fp: float
) -> tuple[float, float, float]:
    s = look[SHIFT] + 13.0
    side = abs(x) - 108.0
    worn = 0.35 * np.exp(-((z - 70.0) ** 2) / 2500.0) * np.exp(-((y - 620.0) ** 2) / 40000.0)
    tone = (
        1.0 + worn + 0.22 * _layer(volume, x + s, 0.6 * y, z, 52.0, fp) + 0.22 * _layer(volume, x, y + s, z, 14.0, fp)
    )
    tone += 0.28 * _layer(volume, x * 1.6, 0.35 * y, z * 1.6 + s, 3.6, fp) + 0.26 * _layer(volume, x + s, y, z, 1.5, fp)
    tone += 0.14 * _step(3.0 / fp, 1.5, 4.0) * _zigzag((side + z + y) / 3.0)
    seam = _step(3.0 - abs(z + 6.0), -1.0 - fp, 1.0 + fp) * _step(abs(side), 30.0, 40.0)
    tone *= 1.0 - 0.28 * seam
    return look[FOURTH] * tone, look[FOURTH + 1] * tone, look[FOURTH + 2] * tone


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _strand(look: NDArray[np.float64], x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return where on the head a hair at a place comes from, and how far it has come: mm, mm, mm.

    Hairs leave a parting that runs from the crown to the forehead, and fall down the sides. The first two numbers stay
    the same along a hair.
    """
    parting, swept = (6.0, 0.25) if look[LONG_HAIR] > 0.0 else (26.0, 0.6)
    dx = x - parting
    along = min(max(z + swept * abs(dx), -20.0), 130.0)
    dz = z + swept * abs(dx) - along
    reach = np.sqrt(dx * dx + dz * dz) + 0.5
    return parting + 70.0 * dx / reach, along + 70.0 * dz / reach, reach - y


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _lock(volume: NDArray[np.float32], a: float, b: float, way: float) -> float:
    """Return the groove between locks of hair, 0 on a lock to 1 in the groove."""
    wave = 5.0 * _noise(volume, a / 40.0, way / 60.0, b / 40.0)
    return float(max(0.0, 1.0 - 3.6 * abs(_noise(volume, (a + wave) / 16.0, way / 110.0, (b - wave) / 16.0))))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _hair_inside(look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float) -> float:
    """Return how far a place of the head lies inside the hair, mm; its line is ragged by locks."""
    ax = abs(x)
    if ax > 125.0:
        return -99.0
    a, b, way = _strand(look, x, y, z)
    ragged = 8.0 * _noise(volume, a / 9.0, way / 60.0, b / 9.0) + 4.0 * _noise(volume, a / 3.0, way / 30.0, b / 3.0)
    line = 1742.0 + 6.0 * np.exp(-(((ax - 42.0) / 14.0) ** 2)) - 94.0 * _step(46.0 - z + 0.6 * ragged, 0.0, 24.0)
    line = max(line, 1586.0 + 100.0 * (_step(z, -52.0, -26.0) - 0.38 * _step(z, 10.0, 22.0)) * _step(ax, 50.0, 62.0))
    if z < 0.0:
        line = min(line, 1648.0 - 62.0 * _step(-z, 0.0, 40.0) + 100.0 * _step(z, -52.0, -26.0) * _step(ax, 50.0, 62.0))
    if look[LONG_HAIR] > 0.0:
        beside = max(1.6 * (ax - 58.0) - max(0.0, z - 2.0), -56.0 - z) + 0.7 * ragged
        line = min(line - 0.5 * max(0.0, ax - 14.0), 1830.0 - 322.0 * _step(beside, -6.0, 8.0))
    return float(y - line + ragged)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _hair(
    look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float, fp: float
) -> tuple[float, float, float, float]:
    """Return colour and gloss of hair: locks, strands of several widths, darker grooves and roots."""
    a, b, way = _strand(look, x, y, z)
    groove = _lock(volume, a, b, way)
    fine = 0.55 * _layer(volume, a, way * 0.06, b, 2.2, fp) + 0.5 * _layer(volume, a, way * 0.05, b, 1.0, fp)
    fine += 0.35 * _layer(volume, a + 9.0, way * 0.08, b, 5.0, fp)
    tone = (1.0 - 0.5 * groove) * (1.0 + fine) + 0.25 * _layer(volume, a, way * 0.4, b, 20.0, fp)
    tone *= 0.7 + 0.3 * _step(way + 1800.0, 10.0, 45.0)
    tone = max(0.18, tone)
    gloss = 0.10 * max(0.0, 1.0 + 1.4 * fine) * (1.0 - 0.8 * groove)
    return look[FIFTH] * tone, look[FIFTH + 1] * tone, look[FIFTH + 2] * (0.9 + 0.1 * tone) * tone, gloss


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _shirt_inside(look: NDArray[np.float64], x: float, y: float, z: float) -> float:
    """Return how far a place of trunk or arms lies inside the shirt, mm: from collar, cuff or hem."""
    ax = abs(x)
    inside = max(1452.0 - 0.5 * z - y, np.sqrt(x * x + (z + 18.0) ** 2) - 84.0)
    if ax > 250.0:
        return float(min(inside, look[SLEEVE] - _along_arm(ax, y)))
    return float(min(inside, y - 905.0))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _along_arm(ax: float, y: float) -> float:
    return (ax - 180.0) * 0.683 - (y - 1412.0) * 0.730


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _person(
    look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float, fp: float
) -> tuple[float, float, float, float]:
    """Return colour and gloss of a person at a place of the rest body."""
    ax = abs(x)
    soft = 0.5 + 0.5 * fp
    gloss = 0.10
    r, g, b = 0.0, 0.0, 0.0
    if y > 1508.0 and ax < 250.0:
        inside = _hair_inside(look, volume, x, y, z)
        cover = _step(inside, -2.5 - soft, 4.0 + soft)
        if cover > 0.0:
            r, g, b, gloss = _hair(look, volume, x, y, z, fp)
        if cover < 1.0:
            sr, sg, sb = _skin(look, volume, x, y, z, fp)
            r, g, b = sr + cover * (r - sr), sg + cover * (g - sg), sb + cover * (b - sb)
            gloss = 0.08 + cover * (gloss - 0.08)
        return r, g, b, gloss
    inside = _shirt_inside(look, x, y, z)
    shirt = _step(inside + 3.5, -soft, soft)  # the edge's thickness is cloth, too
    below = 1.0 - shirt if y < 925.0 and ax < 260.0 else 0.0
    if shirt + below < 1.0:
        r, g, b = _skin(look, volume, x, y, z, fp)
        gloss = 0.08
    if shirt > 0.0:
        cr, cg, cb = _shirt(look, volume, x, y, z, _along_arm(ax, y), fp)
        seam = 1.0 - 0.28 * _step(1.1 - abs(inside - 15.0), -soft, soft)  # of cuff, collar and hem
        if ax > 150.0 and y > 1260.0:
            seam *= 1.0 - 0.22 * _step(1.2 - abs(ax - 178.0 + 0.06 * (y - 1400.0)), -soft, soft)  # of the sleeve
        if inside < 15.0 and y > 1380.0:
            cr, cg, cb = (
                0.1 * cr + 0.8 * look[SECOND],
                0.1 * cg + 0.8 * look[SECOND + 1],
                0.1 * cb + 0.8 * look[SECOND + 2],
            )
        r, g, b = r + shirt * (cr * seam - r), g + shirt * (cg * seam - g), b + shirt * (cb * seam - b)
        gloss *= 1.0 - shirt
    if below > 0.0:
        tr, tg, tb = _trousers(look, volume, x, y, z, fp)
        r, g, b = r + below * (tr - r), g + below * (tg - g), b + below * (tb - b)
        gloss = 0.0
        if y < 85.0:
            shoe = _step(70.0 + 0.10 * (z + 20.0) - y, -soft, soft)
            sole = _step(16.0 - y, -soft, soft)
            tone = 1.0 + 0.3 * _layer(volume, x, y, z, 8.0, fp) + 0.3 * _layer(volume, x, y, z, 2.0, fp)
            lace = _step(z, 20.0, 26.0) * _step(88.0 - z, 0.0, 6.0) * _step(11.0 - abs(ax - 121.0), -1.0, 1.0)
            sole += 0.7 * lace * _step(_zigzag(z / 11.0), 0.0, 0.3) * _step(y, 50.0, 55.0)
            lr, lg, lb = (0.05 + 0.5 * sole) * tone, (0.045 + 0.48 * sole) * tone, (0.045 + 0.44 * sole) * tone
            r, g, b = r + shoe * (lr - r), g + shoe * (lg - g), b + shoe * (lb - b)
            gloss = 0.12 * shoe
    return r, g, b, gloss


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def person_relief(
    places: NDArray[np.float64], look: NDArray[np.float64], volume: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Compute how far clothes and hair stand off a person's parts: float64 (N,), mm along the normal.

    Parameters
    ----------
    places : float64 (N, 3), mm, on the parts' surface at rest
    look : float64 (N_LOOK,), the person's
    volume : float32 (S, S, S), noise
    """
    relief = np.empty(len(places))
    for i in range(len(places)):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        ax = abs(x)
        if y > 1508.0 and ax < 250.0:
            relief[i] = _hair_relief(look, volume, x, y, z)
            continue
        inside = _shirt_inside(look, x, y, z)
        along = _along_arm(ax, y)
        off = 4.5 + 2.0 * _step(15.0 - inside, 0.0, 2.0)  # cuff, collar and hem are thicker
        if ax > 190.0:
            off += 8.0 * _step(along, look[SLEEVE] - 170.0, look[SLEEVE]) if look[SLEEVE] < 350.0 else 0.0
            off += 5.0 * _step(along, 180.0, 300.0) * _step(495.0 - along, 0.0, 45.0) if look[SLEEVE] > 350.0 else 0.0
        else:
            off += 5.0 * _step(1010.0 - y, 0.0, 80.0)
        off *= _step(inside, -4.0, -1.0)
        if ax < 260.0 and y < 915.0:
            cuff = y - 70.0 - 0.10 * (z + 20.0)
            off = max(off, 2.0 * _step(cuff, -1.5, 2.5) + 4.0 * _step(150.0 - y, 0.0, 90.0) * _step(cuff, -1.5, 2.5))
            off += 2.5 * _step(16.0 - y, -2.0, 2.0)
        relief[i] = off
    return relief


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _hair_relief(look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float) -> float:
    inside = _hair_inside(look, volume, x, y, z)
    if inside < -3.0:
        return 0.0
    a, b, way = _strand(look, x, y, z)
    thick = 3.5 + 13.0 * _step(y, 1700.0, 1775.0) if look[LONG_HAIR] == 0.0 else 9.0
    tousled = 5.0 * _noise(volume, a / 32.0, way / 50.0, b / 32.0) + 2.0 * _noise(
        volume, a / 12.0, way / 40.0, b / 12.0
    )
    tousled -= 4.0 * _lock(volume, a, b, way)
    if look[LONG_HAIR] > 0.0:  # it waves, and ends in tips
        tousled += 4.0 * _noise(volume, a / 26.0, way / 38.0, b / 26.0)
        tousled += 14.0 * _step(1570.0 - y, 0.0, 45.0) * _noise(volume, a / 11.0, 0.5, b / 11.0)
    parted = 1.0 - 0.6 * _step(14.0 - (way + y), 0.0, 9.0) * _step(y, 1700.0, 1740.0)
    return float(_step(inside, -3.0, 22.0) * parted * (thick + min(1.0, thick / 8.0) * tousled))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _crease(volume: NDArray[np.float32], x: float, y: float, z: float) -> float:
    """Return folds, -1 in the wide valleys to 1 on the narrow crests."""
    return float(max(-1.0, 1.0 - 4.5 * abs(_noise(volume, x, y, z))))


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def person_folds(
    places: NDArray[np.float64], look: NDArray[np.float64], volume: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Compute folds of cloth as bent joints make them: float32 (N, 10), mm along the normal.

    The columns are those of `person.FOLDING`: elbows, shoulders, waist, hips, knees, left before right; the last one
    holds the folds that cloth always has.

    Parameters
    ----------
    places : float64 (N, 3), mm, at rest
    look : float64 (N_LOOK,), the person's
    volume : float32 (S, S, S), noise
    """
    folds = np.zeros((len(places), 10), np.float32)
    for i in range(len(places)):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        ax, right = abs(x), 1 if x < 0.0 else 0
        s = look[SHIFT] + 40.0 * right
        inside = _shirt_inside(look, x, y, z)
        shirt = _step(inside, 4.0, 26.0)
        along = _along_arm(ax, y)
        if y > 1508.0 or (shirt == 0.0 and (ax > 260.0 or y > 905.0)):
            continue
        sleeve = _step(ax, 170.0, 215.0)
        if sleeve > 0.0 and y > 905.0:
            around = 0.73 * ax + 0.683 * y
            rings = _crease(volume, around / 60.0 + s, (along + 0.35 * around) / 21.0, z / 60.0)
            crook = 0.45 + 0.55 * _step(z, -30.0, 25.0)
            folds[i, right] = 11.0 * shirt * sleeve * crook * rings * np.exp(-(((along - 290.0) / 62.0) ** 2))
            folds[i, 9] = (
                4.5 * shirt * sleeve * rings * (_step(along, 380.0, 440.0) + 0.5 * _step(300.0 - along, 0.0, 120.0))
            )
        pit = (ax - 165.0) ** 2 + (y - 1325.0) ** 2 + 0.6 * z * z
        if pit < 40000.0:
            fan = _crease(volume, (0.80 * ax + 0.60 * y) / 22.0, (0.60 * ax - 0.80 * y) / 95.0 + s, z / 70.0)
            folds[i, 2 + right] = 13.0 * shirt * fan * np.exp(-pit / 13000.0)
        shirt *= 1.0 - sleeve
        if sleeve < 1.0 and y > 880.0:
            belt = _crease(volume, x / 80.0 + s, (y + 0.25 * x) / 24.0, z / 80.0)
            folds[i, 4] = 11.0 * shirt * belt * np.exp(-(((y - 1015.0) / 65.0) ** 2))
            drape = _noise(volume, x / 42.0, y / 150.0 + s, z / 42.0) * _step(1360.0 - y, 0.0, 160.0)
            slant = _crease(volume, (x + 0.5 * y) / 48.0, (y - 0.5 * x) / 120.0, z / 60.0)
            folds[i, 9] += shirt * (16.0 * drape + 5.5 * slant + 3.0 * belt * np.exp(-(((y - 960.0) / 50.0) ** 2)))
        elif y <= 905.0 and ax < 260.0:
            legs = _step(905.0 - y, 0.0, 25.0) * _step(y, 75.0, 95.0)
            rings = _crease(volume, x / 60.0, (y + 0.35 * x) / 23.0 + s, z / 60.0)
            groin = np.exp(-((ax - 60.0) ** 2) / 9000.0 - (y - 850.0) ** 2 / 4500.0) * _step(z, -40.0, 30.0)
            rays = _crease(volume, (0.75 * ax - 0.66 * y) / 20.0 + s, (0.66 * ax + 0.75 * y) / 90.0, z / 80.0)
            folds[i, 5 + right] = 11.0 * legs * groin * rays
            folds[i, 7 + right] = 11.0 * legs * rings * np.exp(-(((y - 500.0) / 75.0) ** 2))
            stacked = _step(250.0 - y, 0.0, 130.0) + 0.35 * np.exp(-(((y - 480.0) / 90.0) ** 2)) + 0.4 * groin
            hanging = _noise(volume, x / 40.0 + s, y / 170.0, z / 40.0)
            folds[i, 9] = legs * (6.5 * rings * stacked + 11.0 * hanging)
    return folds


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def garment_edges(places: NDArray[np.float64], look: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute how far places (N, 3) at rest are from the nearest collar, cuff or hem: float64 (N,), mm."""
    away = np.full(len(places), 999.0)
    for i in range(len(places)):
        x, y, z = places[i, 0], places[i, 1], places[i, 2]
        if y < 1508.0:
            away[i] = abs(_shirt_inside(look, x, y, z)) if y > 850.0 else abs(y - 70.0 - 0.10 * (z + 20.0))
    return away


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _ball(
    look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float, fp: float
) -> tuple[float, float, float, float]:
    """Colour a ball: six panels in three colours with dark seams, scuffed."""
    angle = np.arctan2(z, x)
    panel = int(np.floor(3.0 * angle / 3.14159265)) % 3
    base = FIRST + 3 * panel
    tone = 1.0 + 0.12 * _layer(volume, x, y, z, 20.0, fp) + 0.16 * _layer(volume, x, y, z, 6.0, fp)
    tone += 0.18 * _layer(volume, x, y, z, 2.4, fp) + 0.16 * _layer(volume, x, y, z, 1.1, fp)
    seam_at = abs(np.sin(3.0 * angle)) * np.sqrt(x * x + z * z) / 3.0
    seam = min(_step(seam_at, 1.0, 1.5 + fp), _step(abs(y), 1.5, 2.5 + fp))
    star = _step(np.sqrt(x * x + z * z) - look[HALF_SIZE] * 0.33, -0.5 - fp, 0.5 + fp)
    tone *= 0.25 + 0.75 * seam
    r = look[base] * star + 0.75 * (1.0 - star)
    g = look[base + 1] * star + 0.75 * (1.0 - star)
    b = look[base + 2] * star + 0.72 * (1.0 - star)
    return r * tone, g * tone, b * tone, 0.2


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _box(
    look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float, fp: float
) -> tuple[float, float, float, float]:
    """Colour a box: cardboard with flutes, a strip of tape and a printed label on each side."""
    tone = 1.0 + 0.10 * _layer(volume, x, y, z, 60.0, fp) + 0.10 * _layer(volume, x, y, z, 15.0, fp)
    tone += 0.14 * _layer(volume, x, y * 0.3, z, 4.0, fp) + 0.16 * _layer(volume, x, y, z, 1.4, fp)
    r, g, b = look[FIRST] * tone, look[FIRST + 1] * tone, look[FIRST + 2] * tone
    hx, hy, hz = look[HALF_SIZE], look[HALF_SIZE + 1], look[HALF_SIZE + 2]
    on_x, on_y = abs(abs(x) - hx) < 1.0, abs(abs(y) - hy) < 1.0
    u, v = (z, y) if on_x else ((x, z) if on_y else (x, y))
    hu, hv = (hz, hy) if on_x else ((hx, hz) if on_y else (hx, hy))
    tape = _step(24.0 - abs(u), -0.5 * fp - 0.3, 0.5 * fp + 0.3) if on_y else 0.0
    r, g, b = r + tape * (0.45 - r), g + tape * (0.30 - g), b + tape * (0.14 - b)
    if not on_y:
        inside = min(0.62 * hu - abs(u), 0.42 * hv - abs(v - 0.1 * hv))
        label = _step(inside, -0.3 - 0.5 * fp, 0.3 + 0.5 * fp)
        letters = _noise(volume, u / 7.0 + 5.0, np.floor(v / 15.0) * 3.7, 0.5)
        ink = _step(letters, 0.05, 0.15) * _step(abs((v / 15.0) % 1.0 - 0.5), 0.32, 0.28) * _step(inside, 8.0, 9.0)
        rim = _step(abs(inside - 4.0), 1.6 + 0.5 * fp, 0.8)
        ink = max(ink, rim)
        pr, pg, pb = (
            0.62 + ink * (look[SECOND] - 0.62),
            0.60 + ink * (look[SECOND + 1] - 0.60),
            0.55 + ink * (look[SECOND + 2] - 0.55),
        )
        r, g, b = r + label * (pr * tone - r), g + label * (pg * tone - g), b + label * (pb * tone - b)
    return r, g, b, 0.05


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _target(
    look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float, fp: float
) -> tuple[float, float, float, float]:
    """Colour a validation object: blots of every size, features for matching at any distance."""
    s = look[SHIFT]
    wx, wy = (
        x + 6.0 * _noise(volume, x / 13.0, y / 13.0, z / 13.0),
        y + 6.0 * _noise(volume, x / 13.0, z / 13.0, y / 13.0),
    )
    a = _layer(volume, wx + s, wy, z, 34.0, fp) + 0.6 * _layer(volume, wx, wy + s, z, 13.0, fp)
    c = _layer(volume, wx, wy, z + s, 27.0, fp) + 0.6 * _layer(volume, wx + s, wy, z, 10.0, fp)
    first, second = _step(a, -0.10, 0.10), _step(c, 0.05, 0.25)
    tone = 1.0 + 0.35 * _layer(volume, x, y, z, 5.5, fp) + 0.35 * _layer(volume, x + s, y, z, 2.6, fp)
    tone += 0.30 * _layer(volume, x, y + s, z, 1.2, fp)
    tone = max(0.2, tone)
    r = look[FIRST] + first * (look[SECOND] - look[FIRST])
    g = look[FIRST + 1] + first * (look[SECOND + 1] - look[FIRST + 1])
    b = look[FIRST + 2] + first * (look[SECOND + 2] - look[FIRST + 2])
    r, g, b = r + second * (look[THIRD] - r), g + second * (look[THIRD + 1] - g), b + second * (look[THIRD + 2] - b)
    return r * tone, g * tone, b * tone, 0.02


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _albedo(
    look: NDArray[np.float64], volume: NDArray[np.float32], x: float, y: float, z: float, fp: float
) -> tuple[float, float, float, float]:
    if look[KIND] == 0.0:
        r, g, b, gloss = _person(look, volume, x, y, z, fp)
    elif look[KIND] == 1.0:
        r, g, b, gloss = _ball(look, volume, x, y, z, fp)
    elif look[KIND] == 2.0:
        r, g, b, gloss = _box(look, volume, x, y, z, fp)
    else:
        r, g, b, gloss = _target(look, volume, x, y, z, fp)
    return max(0.004, r), max(0.004, g), max(0.004, b), gloss


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def vertex_albedo(
    places: NDArray[np.float64],
    owners: NDArray[np.int64],
    looks: NDArray[np.float64],
    volume: NDArray[np.float32],
    footprint: float,
) -> NDArray[np.float32]:
    """Compute the colours of vertices without any light: float32 (N, 3), linear RGB.

    Parameters
    ----------
    places : float64 (N, 3), mm, on the rest bodies
    owners : int64 (N,), the row of `looks` for each place
    looks : float64 (M, N_LOOK), see `looks`
    volume : float32 (S, S, S), noise
    footprint : mm, features below this size are averaged away
    """
    colours = np.empty((len(places), 3), np.float32)
    for i in range(len(places)):
        r, g, b, _ = _albedo(looks[owners[i]], volume, places[i, 0], places[i, 1], places[i, 2], footprint)
        colours[i, 0], colours[i, 1], colours[i, 2] = r, g, b
    return colours


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _shade_sample(
    sx: float, sy: float, face: int, pixels: NDArray[np.float64], actors: Actors, spread: float
) -> tuple[float, float, float]:
    faces, lit, owners, looks, volume = actors
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    ax, ay, bx, by = pixels[a, 0] - sx, pixels[a, 1] - sy, pixels[b, 0] - sx, pixels[b, 1] - sy
    cx, cy = pixels[c, 0] - sx, pixels[c, 1] - sy
    wa, wb, wc = bx * cy - by * cx, cx * ay - cy * ax, ax * by - ay * bx
    area = wa + wb + wc
    wa, wb, wc = wa * pixels[a, 2], wb * pixels[b, 2], wc * pixels[c, 2]
    inverse = 1.0 / (wa + wb + wc)
    wa, wb, wc = wa * inverse, wb * inverse, wc * inverse
    r, g, bl, gloss = _albedo(
        looks[owners[face]],
        volume,
        wa * lit[a, 0] + wb * lit[b, 0] + wc * lit[c, 0],
        wa * lit[a, 1] + wb * lit[b, 1] + wc * lit[c, 1],
        wa * lit[a, 2] + wb * lit[b, 2] + wc * lit[c, 2],
        area * inverse * spread,  # a pixel's size at the sample's depth
    )
    shine = gloss * (wa * lit[a, 6] + wb * lit[b, 6] + wc * lit[c, 6])
    return (
        r * (wa * lit[a, 3] + wb * lit[b, 3] + wc * lit[c, 3]) + shine,
        g * (wa * lit[a, 4] + wb * lit[b, 4] + wc * lit[c, 4]) + shine,
        bl * (wa * lit[a, 5] + wb * lit[b, 5] + wc * lit[c, 5]) + shine,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def shade(visible: Visibility, actors: Actors, spread: float) -> NDArray[np.float32]:
    """Colour the window in which a camera sees the actors.

    Returns float32 (h, w, 4): linear RGB of the covered part, and the covered share.

    Parameters
    ----------
    visible : which faces
    actors : whose faces they are
    spread : size of a pixel at a depth of 1 mm
    """
    column, row, seen, nearness, pixels = visible
    offset_x = (0.0, -0.125, 0.375, -0.375, 0.125)
    offset_y = (0.0, -0.375, -0.125, 0.125, 0.375)
    h, w = seen.shape[0], seen.shape[1]
    result = np.zeros((h, w, 4), np.float32)
    for y in range(h):
        for x in range(w):
            covered = 0
            least, most = 1.0, 0.0
            for s in range(1, 5):
                if seen[y, x, s] >= 0:
                    covered += 1
                    least, most = min(least, nearness[y, x, s]), max(most, nearness[y, x, s])
            if covered == 0:
                continue
            first, last = 1, 5
            if covered == 4 and seen[y, x, 0] >= 0 and most - least < 0.012 * most:
                first, last = 0, 1  # one smooth surface: its centre stands for the pixel
            red, green, blue = 0.0, 0.0, 0.0
            for s in range(first, last):
                if seen[y, x, s] < 0:
                    continue
                r, g, b = _shade_sample(
                    column + x + offset_x[s], row + y + offset_y[s], seen[y, x, s], pixels, actors, spread
                )
                red, green, blue = red + r, green + g, blue + b
            n = 1 if last == 1 else covered
            result[y, x, 0], result[y, x, 1], result[y, x, 2] = red / n, green / n, blue / n
            result[y, x, 3] = covered / 4.0
    return result


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def room_plate(rays: Rays, room: Room, volume: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colour the empty studio, a floor and a curtain that hangs around it: linear, float32 (H, W, 3).

    Parameters
    ----------
    rays : of the camera's pixels
    room : the studio
    volume : float32 (S, S, S), noise
    """
    slopes, camera_to_world, eye, spread = rays
    radius, floor_y, curtain, floor = room
    height, width = slopes.shape[0], slopes.shape[1]
    colours = np.empty((height, width, 3), np.float32)
    for row in range(height):
        for column in range(width):
            cx, cy = slopes[row, column, 0], slopes[row, column, 1]
            dx = camera_to_world[0, 0] * cx + camera_to_world[0, 1] * cy + camera_to_world[0, 2]
            dy = camera_to_world[1, 0] * cx + camera_to_world[1, 1] * cy + camera_to_world[1, 2]
            dz = camera_to_world[2, 0] * cx + camera_to_world[2, 1] * cy + camera_to_world[2, 2]
            a, b = dx * dx + dz * dz, eye[0] * dx + eye[2] * dz
            t = (-b + np.sqrt(b * b - a * (eye[0] * eye[0] + eye[2] * eye[2] - radius * radius))) / a
            on_floor = dy < 0.0 and (floor_y - eye[1]) / dy < t
            if on_floor:
                t = (floor_y - eye[1]) / dy
            x, y, z = eye[0] + t * dx, eye[1] + t * dy, eye[2] + t * dz
            fp = t * spread
            if on_floor:
                tone = 1.0 + 0.10 * _layer(volume, x, 0.0, z, 260.0, fp) + 0.12 * _layer(volume, x, 3.0, z, 60.0, fp)
                tone += 0.14 * _layer(volume, x, 7.0, z, 14.0, fp) + 0.18 * _layer(volume, x, 11.0, z, 5.0, fp)
                tone += 0.20 * _layer(volume, x, 15.0, z, 2.3, fp)
                pool = 0.42 + 0.95 * np.exp(-(x * x + z * z) / 5.0e6)
                near_wall = _step(radius - np.sqrt(x * x + z * z), -50.0, 500.0)
                light = pool * (0.55 + 0.45 * near_wall)
                r, g, bl = floor[0] * tone * light, floor[1] * tone * light, floor[2] * tone * light
            else:
                arc = np.arctan2(x, z) * radius
                sway = 60.0 * _noise(volume, arc / 420.0, y / 1400.0, 0.3)
                pleat = np.sin(6.2831853 * (arc + sway) / 190.0) + 0.35 * np.sin(6.2831853 * (arc - 0.5 * sway) / 73.0)
                tone = 0.80 + 0.17 * pleat + 0.08 * _layer(volume, arc, y, 5.0, 120.0, fp)
                tone += 0.09 * _layer(volume, arc, 0.4 * y, 5.0, 17.0, fp) + 0.12 * _layer(volume, arc, y, 9.0, 4.5, fp)
                fall = 0.55 + 0.30 * _step(y, -200.0, 1600.0) - 0.10 * _step(y, 2000.0, 3200.0)
                fall *= 0.55 + 0.45 * _step(y - floor_y, -60.0, 260.0)
                r, g, bl = curtain[0] * tone * fall, curtain[1] * tone * fall, curtain[2] * tone * fall
            colours[row, column, 0], colours[row, column, 1], colours[row, column, 2] = r, g, bl
    return colours
