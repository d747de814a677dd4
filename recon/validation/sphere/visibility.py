"""A sensor's lines of sight to a ball: which points lie on them, and where points are missing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

INSIDE = 0.9  # of the outline's radius; nearer to it surfaces are too oblique to ask for points
POINTS_A_CELL = 16  # of an even cloud on average, so that no cell is empty by chance
MOST_CELLS = 16  # across the ball
EMPTY = 0.25  # of the median cell's points; cells with fewer count as empty


def meets_sphere(
    points: NDArray[np.floating], viewpoint: NDArray[np.floating], centre: NDArray[np.float64], radius: float
) -> NDArray[np.bool_]:
    """Return whether the line of sight through each point meets a sphere, bool (N,).

    Parameters
    ----------
    points : floating (N, 3), mm
    viewpoint : floating (3,), mm, where the sensor stands
    centre : float64 (3,), mm
    radius : mm

    Raises
    ------
    ValueError
        If the viewpoint lies inside the sphere.
    """
    towards, sine = _sight(viewpoint, centre, radius)
    rays = points - viewpoint
    cosine = (rays @ towards) / (np.linalg.norm(rays, axis=1) + 1e-12)
    return np.asarray(cosine >= np.sqrt(1 - sine**2))


def missing_share(
    points: NDArray[np.floating], viewpoint: NDArray[np.floating], centre: NDArray[np.float64], radius: float
) -> float:
    """Return the share of a ball's picture, without its rim, in which a cloud has no points at any depth.

    The picture is divided into square cells; those with less than a quarter of the usual number of points are empty.
    Inlier ratios do not show them: a sensor that leaves out what is difficult looks better for it.

    Parameters
    ----------
    points : floating (N, 3), mm
    viewpoint : floating (3,), mm, where the sensor stands
    centre : float64 (3,), mm
    radius : mm
    """
    towards, sine = _sight(viewpoint, centre, radius)
    rays = points[meets_sphere(points, viewpoint, centre, radius)] - viewpoint
    across = np.linalg.svd(towards[None])[2][1:]
    tangent = sine / np.sqrt(1 - sine**2)
    at = rays @ across.T / (rays @ towards * tangent)[:, None]  # (N, 2), of the outline's radius
    n_cells = int(np.clip(np.sqrt(len(at) / POINTS_A_CELL), 1, MOST_CELLS))
    counts, edges, _ = np.histogram2d(at[:, 0], at[:, 1], n_cells, ((-1, 1), (-1, 1)))
    middles = (edges[1:] + edges[:-1]) / 2
    counts = counts[np.hypot(middles[:, None], middles) < INSIDE]
    occupied = counts[counts > 0]
    return float(np.mean(counts < EMPTY * np.median(occupied))) if len(occupied) else 1.0


def _sight(
    viewpoint: NDArray[np.floating], centre: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], float]:
    """Return the direction (3,) of a sphere's centre, and the sine of the angle at which its outline is seen."""
    towards = centre - viewpoint
    distance = float(np.linalg.norm(towards))
    if distance <= radius:
        raise ValueError(f"the viewpoint {np.round(viewpoint, 1).tolist()} mm lies inside the fitted sphere")
    return towards / distance, radius / distance
