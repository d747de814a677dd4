"""Planes in a cloud, one after the other: a consensus through three near points, then robust refinement.

Source: Fischler, Bolles, "Random sample consensus" (1981), scored as by Torr, Zisserman, "MLESAC" (2000); the
refinement is least squares with Tukey's weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_STEPS = 30
STEP_RAD = 1e-6
CUTOFF = 3.0  # Tukey's constant in standard deviations; tighter than 4.685, as for spheres: points abound
MIN_SCALE_SHARE = 1e-4  # of the band: a perfect plane still gets a cutoff
N_TRIALS = 400  # planes through three points, for each plane that is looked for
CHUNK = 64  # planes that are scored together


@dataclass(frozen=True, eq=False)
class Plane:
    """All x with normal . x = offset.

    Parameters
    ----------
    normal : float64 (3,), unit length
    offset : mm
    scale : mm, robust standard deviation of the points that determined it
    """

    normal: NDArray[np.float64]
    offset: float
    scale: float

    def errors(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the signed distances (N,) of points (N, 3), mm, positive on the normal's side."""
        return np.asarray(points @ self.normal - self.offset)


def plane_sequence(
    points: NDArray[np.float64], *, band: float, reach: float, least: int, most: int, rng: np.random.Generator
) -> list[Plane]:
    """Return the planes on which most points lie, best first; a point counts for the first plane that it lies on.

    Parameters
    ----------
    points : float64 (N, 3), mm, evenly spread over the surfaces
    band : mm, within which a point counts for a plane
    reach : mm, how far apart the three points of a trial may be
    least : points that a plane needs
    most : planes
    rng : of the trials
    """
    planes: list[Plane] = []
    left = points
    while len(planes) < most and len(left) >= least:
        plane = _consensus(left, band, reach, rng)
        if plane is None:
            break
        on_it = np.abs(plane.errors(left)) < band
        if np.count_nonzero(on_it) < least:
            break
        planes.append(refined_plane(left[on_it], plane, band))
        left = left[np.abs(planes[-1].errors(left)) >= max(band, CUTOFF * planes[-1].scale)]
    return planes


def refined_plane(points: NDArray[np.float64], plane: Plane, band: float) -> Plane:
    """Return the plane near another that suits the points best.

    Parameters
    ----------
    points : float64 (N, 3), mm
    plane : to start from
    band : mm; points beyond it never count
    """
    normal, offset, scale = plane.normal, plane.offset, plane.scale
    for _ in range(MAX_STEPS):
        errors = points @ normal - offset
        inside = np.abs(errors[np.abs(errors) < band])
        if len(inside) < 3:
            break
        scale = max(1.4826 * float(np.median(inside)), MIN_SCALE_SHARE * band)
        weights = np.clip(1 - (errors / min(CUTOFF * scale, band)) ** 2, 0, None) ** 2
        middle = weights @ points / weights.sum()
        offsets = points - middle
        turned = np.linalg.eigh((offsets * weights[:, None]).T @ offsets)[1][:, 0]
        turned *= np.sign(turned @ normal) or 1.0
        change = float(np.linalg.norm(turned - normal))
        normal, offset = turned, float(turned @ middle)
        if change < STEP_RAD:
            break
    return Plane(normal, offset, scale)


def _consensus(points: NDArray[np.float64], band: float, reach: float, rng: np.random.Generator) -> Plane | None:
    """Return the best of the planes through three points that are near each other."""
    normals, offsets = _trials(points, reach, rng)
    if not len(normals):
        return None
    scores = np.concatenate(
        [
            np.clip(1 - ((points @ normals[k : k + CHUNK].T - offsets[k : k + CHUNK]) / band) ** 2, 0, None).sum(axis=0)
            for k in range(0, len(normals), CHUNK)
        ]
    )
    best = int(np.argmax(scores))
    return Plane(normals[best], float(offsets[best]), band / CUTOFF)


def _trials(
    points: NDArray[np.float64], reach: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return normals (T, 3) and offsets (T,) of planes through a random point and two within reach of it."""
    from scipy.spatial import cKDTree

    seeds = points[rng.integers(0, len(points), N_TRIALS)]
    triples = []
    neighbours = cKDTree(points).query_ball_point(list(seeds), reach)
    for seed, near in zip(seeds, neighbours, strict=True):
        if len(near) >= 3:
            a, b = points[rng.choice(near, 2, replace=False)] - seed
            triples.append((seed, a, b))
    if not triples:
        return np.zeros((0, 3)), np.zeros(0)
    seed_points, a, b = (np.array(part) for part in zip(*triples, strict=True))
    normals = np.cross(a, b)
    area = np.linalg.norm(normals, axis=1)
    wide = area > 0.1 * reach**2  # flatter triples say nothing of the plane's tilt
    normals = normals[wide] / area[wide, None]
    return normals, np.einsum("ij,ij->i", normals, seed_points[wide])
