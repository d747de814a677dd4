"""Compiled parts of the fit of a sphere of known radius."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, inline="always")
def _next(state):  # type: ignore[no-untyped-def]  # numba
    """Take one step of a 32-bit linear congruential generator (Numerical Recipes, "quick and dirty" 1664525)."""
    return (state * np.int64(1664525) + np.int64(1013904223)) & np.int64(0xFFFFFFFF)


@njit(cache=True, fastmath={"reassoc", "contract"})
def local_consensus(
    points: NDArray[np.float64],
    seeds: NDArray[np.int64],
    radius: float,
    band: float,
    n_trials: int,
    seed: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the best sphere through each seed point: centres (S, 3), mm, and scores (S,).

    A sphere's points lie within its diameter of each other, so every seed looks only there. A trial takes the seed
    and two such points; the two spheres of the known radius through them score one for a point on the surface,
    falling to zero at the band's end, and lose one for a point inside.

    Parameters
    ----------
    points : float64 (N, 3), mm, evenly spread
    seeds : int64 (S,), their rows that spheres are tried through
    radius, band : mm
    n_trials : of each seed point
    seed : of the random numbers
    """
    centres = np.zeros((len(seeds), 3))
    scores = np.full(len(seeds), -np.inf)
    near = np.empty((3, len(points)))
    for index in range(len(seeds)):
        p = points[seeds[index]]
        n_near = _gather(points, p, 2 * radius + band, near)
        if n_near < 12:
            continue
        state = (seed * 7919 + index * 104729 + 12345) & 0xFFFFFFFF
        for _ in range(n_trials):
            state = _next(state)
            i = (state >> 8) % n_near
            state = _next(state)
            j = (state >> 8) % n_near
            a, b = (near[0, i], near[1, i], near[2, i]), (near[0, j], near[1, j], near[2, j])
            there_are, middle, aside = _spheres_through(a, b, radius)
            if not there_are:
                continue
            for sign in (-1.0, 1.0):
                x, y, z = middle[0] + sign * aside[0], middle[1] + sign * aside[1], middle[2] + sign * aside[2]
                score = _score(near, n_near, x, y, z, radius, band)
                if score > scores[index]:
                    scores[index] = score
                    centres[index, 0], centres[index, 1], centres[index, 2] = p[0] + x, p[1] + y, p[2] + z
    return centres, scores


@njit(cache=True)
def _gather(points: NDArray[np.float64], place: NDArray[np.float64], reach: float, near: NDArray[np.float64]) -> int:
    """Fill `near` (3, N) with the offsets from a place of the points within reach of it, and return their number."""
    n_near = 0
    for i in range(len(points)):
        x, y, z = points[i, 0] - place[0], points[i, 1] - place[1], points[i, 2] - place[2]
        if x * x + y * y + z * z < reach * reach:
            near[0, n_near], near[1, n_near], near[2, n_near] = x, y, z
            n_near += 1
    return n_near


@njit(cache=True, fastmath={"reassoc", "contract"})
def _spheres_through(a, b, radius):  # type: ignore[no-untyped-def]  # numba
    """Return the two spheres of a radius through the origin and points a and b, if these lie far enough apart.

    They are given by whether they exist, the centre of the circle through the three points, and the step from there to
    one sphere's centre; the other centre lies opposite.
    """
    nowhere = (0.0, 0.0, 0.0)
    (ax, ay, az), (bx, by, bz) = a, b
    shortest = 0.25 * radius**2
    aa, bb = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
    ab2 = (ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2
    if aa < shortest or bb < shortest or ab2 < shortest:
        return False, nowhere, nowhere
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    nn = nx * nx + ny * ny + nz * nz
    if nn < 0.01 * aa * bb:
        return False, nowhere, nowhere
    # The circle through 0, a and b has its centre at (|a|^2 b - |b|^2 a) x n / (2 n.n), n = a x b.
    ux, uy, uz = aa * bx - bb * ax, aa * by - bb * ay, aa * bz - bb * az
    cx, cy, cz = (uy * nz - uz * ny) / (2 * nn), (uz * nx - ux * nz) / (2 * nn), (ux * ny - uy * nx) / (2 * nn)
    left = radius**2 - (cx * cx + cy * cy + cz * cz)
    if left < 0:
        return False, nowhere, nowhere
    height = np.sqrt(left / nn)
    return True, (cx, cy, cz), (height * nx, height * ny, height * nz)


@njit(cache=True, fastmath={"reassoc", "contract"})
def _score(near, n_near, x0, y0, z0, radius, band):  # type: ignore[no-untyped-def]  # numba
    """Score the points near a seed against the sphere around (x0, y0, z0)."""
    per_band, inside, score = 1.0 / band, radius - 2 * band, 0.0
    for k in range(n_near):
        x, y, z = near[0, k] - x0, near[1, k] - y0, near[2, k] - z0
        d = np.sqrt(x * x + y * y + z * z)
        left = 1.0 - ((d - radius) * per_band) ** 2
        score += (left if left > 0.0 else 0.0) - (1.0 if d < inside else 0.0)
    return score


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def tukey_sums(
    points: NDArray[np.float32], centre: NDArray[np.float64], radius: float, cutoff: float
) -> NDArray[np.float64]:
    """Return the sums float64 (15,) of a Gauss-Newton step for centre and radius with Tukey's weights.

    They are the upper triangle of the normal matrix (10) of (x, y, z, radius), the right side (4), and the number of
    points within the cutoff. Differences to the centre are taken in double precision, the rest of a block of points in
    single precision, without branches and in any order: as vector instructions, in a quarter of the time.

    Parameters
    ----------
    points : float32 (N, 3), mm
    centre : float64 (3,), mm
    radius, cutoff : mm
    """
    cx, cy, cz = centre[0], centre[1], centre[2]
    r, per_cutoff = np.float32(radius), np.float32(1.0 / cutoff)
    unit, zero, tiny = np.float32(1.0), np.float32(0.0), np.float32(1e-30)  # the centre itself has no direction
    s = np.zeros(15)
    for start in range(0, len(points), 1024):
        xx = xy = xz = yy = yz = zz = zero
        x_sum = y_sum = z_sum = w_sum = zero
        ex = ey = ez = e_sum = n = zero
        for i in range(start, min(start + 1024, len(points))):
            x, y, z = np.float32(points[i, 0] - cx), np.float32(points[i, 1] - cy), np.float32(points[i, 2] - cz)
            d = np.sqrt(max(x * x + y * y + z * z, tiny))
            error, near = d - r, unit / d
            u = error * per_cutoff
            left = unit - u * u
            inside = unit if left > zero else zero
            w = inside * left * left
            x, y, z = x * near, y * near, z * near
            wx, wy, wz = w * x, w * y, w * z
            xx += wx * x
            xy += wx * y
            xz += wx * z
            yy += wy * y
            yz += wy * z
            zz += wz * z
            x_sum += wx
            y_sum += wy
            z_sum += wz
            w_sum += w
            ex += wx * error
            ey += wy * error
            ez += wz * error
            e_sum += w * error
            n += inside
        sums = (xx, xy, xz, x_sum, yy, yz, y_sum, zz, z_sum, w_sum, ex, ey, ez, e_sum, n)
        for place in range(15):
            s[place] += sums[place]
    return s


@njit(cache=True, nogil=True)
def signed_errors(points: NDArray[np.float32], centre: NDArray[np.float64], radius: float) -> NDArray[np.float32]:
    """Return the distance of each point to the centre minus the radius, float32 (N,), mm.

    Parameters
    ----------
    points : float32 (N, 3), mm
    centre : float64 (3,), mm
    radius : mm
    """
    errors = np.empty(len(points), np.float32)
    cx, cy, cz = centre[0], centre[1], centre[2]
    for i in range(len(points)):
        x, y, z = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
        errors[i] = np.sqrt(x * x + y * y + z * z) - radius
    return errors
