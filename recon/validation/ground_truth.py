"""A mesh or cloud against the truth: accuracy, completeness and F-score, as Tanks and Temples and ETH3D define them.

Source: Knapitsch et al., "Tanks and Temples" (2017), section 3.3; Schöps et al., ETH3D (2017), section 4. Precision
(accuracy) is the share of the reconstruction's points within a threshold of the truth, recall (completeness) the share
of the truth's within the threshold of the reconstruction, the F-score their harmonic mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.mesh import read_mesh
from recon.validation.measured import read_measured

N_SAMPLES = 250_000
PERCENTILES = (50, 90, 95)


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface as points, with its triangles where it has any.

    Parameters
    ----------
    points : float64 (N, 3), mm; vertices, or a cloud's points
    faces : int32 (M, 3); empty for a cloud
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int32]


def read_shape(path: Path) -> Shape:
    """A mesh, or a cloud where the file has no faces.

    Raises
    ------
    ValueError
        If the file cannot be read as either.
    """
    try:
        mesh = read_mesh(path)
    except ValueError as error:
        if "no faces" not in str(error) and "have no" not in str(error):
            raise
        return Shape(read_measured(path).astype(np.float64), np.zeros((0, 3), np.int32))
    return Shape(mesh.vertices.astype(np.float64), mesh.faces)


def sample_evenly(shape: Shape, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """n points (n, 3) spread over the triangles by their area; a cloud's own points, at most n of them.

    Raises
    ------
    ValueError
        If the triangles have no area.
    """
    if not len(shape.faces):
        return shape.points if len(shape.points) <= n else shape.points[rng.choice(len(shape.points), n, replace=False)]
    a, b, c = (shape.points[shape.faces[:, corner]] for corner in range(3))
    areas = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    if not areas.sum() > 0:
        raise ValueError(f"the mesh's {len(areas)} triangles have no area")
    chosen = np.searchsorted(np.cumsum(areas), rng.random(n) * areas.sum(), side="right").clip(max=len(areas) - 1)
    root, second = np.sqrt(rng.random((n, 1))), rng.random((n, 1))  # Turk (1990): uniform in a triangle
    return np.asarray((1 - root) * a[chosen] + root * (1 - second) * b[chosen] + root * second * c[chosen])


def compare_points(
    measured: NDArray[np.floating], truth: NDArray[np.floating], thresholds: Sequence[float]
) -> dict[str, Any]:
    """Distances both ways, and precision, recall and F-score at each threshold.

    Parameters
    ----------
    measured, truth : floating (N, 3) and (M, 3), mm
    thresholds : mm
    """
    to_truth, to_measured = nearest_distances(measured, truth), nearest_distances(truth, measured)
    return {
        "accuracy": _summary(to_truth),
        "completeness": _summary(to_measured),
        "scores": [_score(to_truth, to_measured, threshold) for threshold in thresholds],
    }


def nearest_distances(points: NDArray[np.floating], others: NDArray[np.floating]) -> NDArray[np.float64]:
    """Distance (N,) of each point to the nearest of the others, exact, mm."""
    from scipy.spatial import cKDTree

    tree = cKDTree(others, balanced_tree=False, compact_nodes=False)  # half the time on points of a surface
    distances, _ = tree.query(points, workers=-1)
    return np.asarray(distances)


def measure_mesh(mesh: Path, truth: Path, thresholds: Sequence[float], seed: int = 1) -> dict[str, Any]:
    """Compare two files; the content of report.json.

    Raises
    ------
    ValueError
        If a file cannot be read or a threshold is not positive.
    """
    if not thresholds or not min(thresholds) > 0:
        raise ValueError(f"thresholds are {list(thresholds)}, expected positive lengths in mm")
    rng = np.random.default_rng(seed)
    measured, real = (sample_evenly(read_shape(path), N_SAMPLES, rng) for path in (mesh, truth))
    return {
        "schema_version": 1,
        "kind": "mesh",
        "settings": {
            "mesh": str(mesh),
            "truth": str(truth),
            "thresholds_mm": list(thresholds),
            "samples": [len(measured), len(real)],
            "spacing_mm": _spacing(real),
            "seed": seed,
        },
        **compare_points(measured, real, thresholds),
    }


def _score(to_truth: NDArray[np.float64], to_measured: NDArray[np.float64], threshold: float) -> dict[str, float]:
    precision, recall = float(np.mean(to_truth < threshold)), float(np.mean(to_measured < threshold))
    both = precision + recall
    f_score = 2 * precision * recall / both if both else 0.0
    return {"threshold_mm": float(threshold), "precision": precision, "recall": recall, "f_score": f_score}


def _summary(distances: NDArray[np.float64]) -> dict[str, float]:
    return {
        "mean_mm": float(distances.mean()),
        "rms_mm": float(np.sqrt(np.mean(distances**2))),
        **{f"p{share}_mm": float(np.percentile(distances, share)) for share in PERCENTILES},
    }


def _spacing(points: NDArray[np.float64]) -> float:
    """Median distance of a point to its neighbour: what two samples of the same surface are apart at best, mm."""
    from scipy.spatial import cKDTree

    some = points[:: max(1, len(points) // 5000)]
    return float(np.median(np.asarray(cKDTree(points).query(some, k=2)[0])[:, 1]))
