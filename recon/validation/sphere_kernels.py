"""Compiled parts of the fit of a sphere of known radius."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, inline="always")
def _next(state):  # type: ignore[no-untyped-def]  # numba
    """One step of a 32-bit linear congruential generator (Numerical Recipes, "quick and dirty" 1664525)."""
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
    """The best sphere through each seed point: centres (S, 3) and scores (S,).

    A sphere's points lie within its diameter of each other, so every seed looks only there. A trial takes the seed
    and two such points; the two spheres of the known radius through them score one for a point on the surface,
    falling to zero at the band's end, and lose one for a point inside.
    """
    n = len(points)
    centres = np.zeros((len(seeds), 3))
    scores = np.full(len(seeds), -np.inf)
    near_x, near_y, near_z = np.empty(n), np.empty(n), np.empty(n)
    per_band, inside = 1.0 / band, radius - 2 * band
    reach = (2 * radius + band) ** 2
    shortest = 0.25 * radius**2
    for index in range(len(seeds)):
        p = points[seeds[index]]
        n_near = 0
        for i in range(n):
            x, y, z = points[i, 0] - p[0], points[i, 1] - p[1], points[i, 2] - p[2]
            if x * x + y * y + z * z < reach:
                near_x[n_near], near_y[n_near], near_z[n_near] = x, y, z
                n_near += 1
        if n_near < 12:
            continue
        state = (seed * 7919 + index * 104729 + 12345) & 0xFFFFFFFF
        for _ in range(n_trials):
            state = _next(state)
            i = (state >> 8) % n_near
            state = _next(state)
            j = (state >> 8) % n_near
            ax, ay, az = near_x[i], near_y[i], near_z[i]
            bx, by, bz = near_x[j], near_y[j], near_z[j]
            aa, bb = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
            ab2 = (ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2
            if aa < shortest or bb < shortest or ab2 < shortest:
                continue
            nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            nn = nx * nx + ny * ny + nz * nz
            if nn < 0.01 * aa * bb:
                continue
            # The circle through 0, a and b has its centre at (|a|^2 b - |b|^2 a) x n / (2 n.n), n = a x b.
            ux, uy, uz = aa * bx - bb * ax, aa * by - bb * ay, aa * bz - bb * az
            cx = (uy * nz - uz * ny) / (2 * nn)
            cy = (uz * nx - ux * nz) / (2 * nn)
            cz = (ux * ny - uy * nx) / (2 * nn)
            left = radius**2 - (cx * cx + cy * cy + cz * cz)
            if left < 0:
                continue
            height = np.sqrt(left / nn)
            for sign in (-1.0, 1.0):
                x0, y0, z0 = cx + sign * height * nx, cy + sign * height * ny, cz + sign * height * nz
                score = 0.0
                for k in range(n_near):
                    x, y, z = near_x[k] - x0, near_y[k] - y0, near_z[k] - z0
                    d = np.sqrt(x * x + y * y + z * z)
                    left = 1.0 - ((d - radius) * per_band) ** 2
                    score += (left if left > 0.0 else 0.0) - (1.0 if d < inside else 0.0)
                if score > scores[index]:
                    scores[index] = score
                    centres[index, 0], centres[index, 1], centres[index, 2] = p[0] + x0, p[1] + y0, p[2] + z0
    return centres, scores


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
def tukey_sums(
    points: NDArray[np.float32], centre: NDArray[np.float64], radius: float, cutoff: float
) -> NDArray[np.float64]:
    """float64 (15,): the sums of a Gauss-Newton step for centre and radius with Tukey's weights.

    The upper triangle of the normal matrix (10) of (x, y, z, radius), the right side (4), and the number of points
    within the cutoff. Differences to the centre are taken in double precision, the rest of a block of points in single
    precision, without branches and in any order: as vector instructions, in a quarter of the time.
    """
    cx, cy, cz = centre[0], centre[1], centre[2]
    r, per_cutoff = np.float32(radius), np.float32(1.0 / cutoff)
    one, zero, tiny = np.float32(1.0), np.float32(0.0), np.float32(1e-30)  # the centre itself has no direction
    s = np.zeros(15)
    for start in range(0, len(points), 1024):
        xx = xy = xz = yy = yz = zz = zero
        x_sum = y_sum = z_sum = w_sum = zero
        ex = ey = ez = e_sum = n = zero
        for i in range(start, min(start + 1024, len(points))):
            x, y, z = np.float32(points[i, 0] - cx), np.float32(points[i, 1] - cy), np.float32(points[i, 2] - cz)
            d = np.sqrt(max(x * x + y * y + z * z, tiny))
            error, near = d - r, one / d
            u = error * per_cutoff
            left = one - u * u
            inside = one if left > zero else zero
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
def extent(points: NDArray[np.floating]) -> tuple[float, float, int]:
    """Lowest and highest coordinate of points (N, 3), and the row of the first that is not finite, else -1."""
    low, high = np.inf, -np.inf
    for i in range(len(points)):
        for axis in range(3):
            value = points[i, axis]
            if not np.isfinite(value):
                return low, high, i
            low, high = min(low, value), max(high, value)
    return low, high, -1


@njit(cache=True, nogil=True)
def signed_errors(points: NDArray[np.float32], centre: NDArray[np.float64], radius: float) -> NDArray[np.float32]:
    """float32 (N,), mm: distance of each point to the centre, minus the radius."""
    errors = np.empty(len(points), np.float32)
    cx, cy, cz = centre[0], centre[1], centre[2]
    for i in range(len(points)):
        x, y, z = points[i, 0] - cx, points[i, 1] - cy, points[i, 2] - cz
        errors[i] = np.sqrt(x * x + y * y + z * z) - radius
    return errors
