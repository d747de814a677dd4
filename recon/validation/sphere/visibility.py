"""What a sensor sees of a ball from where it stands: its lines of sight, and those on which it found nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

INSIDE = 0.9  # of the outline's radius; nearer to it surfaces are too oblique to ask for points
POINTS_A_CELL = 16  # of an even cloud on average: an empty cell is then no accident
MOST_CELLS = 16  # across the ball
EMPTY = 0.25  # of the median cell's points


def meets_sphere(
    points: NDArray[np.floating], viewpoint: NDArray[np.floating], centre: NDArray[np.float64], radius: float
) -> NDArray[np.bool_]:
    """Whether the line of sight through each of points (N, 3) meets a sphere.

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
    """Share of a ball's picture, but for its rim, in which a cloud (N, 3) has no points at whatever depth.

    The picture is divided into square cells; one that holds less than a quarter of what is usual is empty. Inlier
    ratios do not know of them: a sensor that leaves out what is difficult looks better by it.
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
    """The direction (3,) of a sphere's centre, and the sine of the angle at which its outline is seen."""
    towards = centre - viewpoint
    distance = float(np.linalg.norm(towards))
    if distance <= radius:
        raise ValueError(f"the viewpoint {np.round(viewpoint, 1).tolist()} mm lies inside the fitted sphere")
    return towards / distance, radius / distance
