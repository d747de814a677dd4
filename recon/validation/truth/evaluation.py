"""A mesh or cloud against the truth: accuracy, completeness and F-score, as Tanks and Temples and ETH3D define them.

Precision (accuracy) is the share of the reconstruction's points within a threshold of the truth, recall (completeness)
the share of the truth's within the threshold of the reconstruction, the F-score their harmonic mean. Both benchmarks
measure distances to points; here distances to a mesh are those to its triangles, the limit of ever denser samples. The
shares are of points; `eth3d` averages them over voxels as that benchmark's program does.

Source
------
Knapitsch et al., "Tanks and Temples" (2017), section 3.3; Schöps et al., ETH3D (2017), section 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.format import read_capture
from recon.geometry.mesh import Shape
from recon.runtime.files import naming
from recon.validation.clouds import read_measured_shape, read_shape, size_remarks
from recon.validation.measures import LESS, MORE, Subject, check_thresholds, measure_rows
from recon.validation.sampling import between_corners, cell_means, order_by_cells, search_tree, spread_over_triangles
from recon.validation.triangles import TriangleTree
from recon.validation.truth.eth3d import VOXEL_MM, eth3d_scores
from recon.validation.truth.visible import seen_by_sensors

N_SAMPLES = 250_000
PERCENTILES = (50, 90, 95)


def sample_evenly(shape: Shape, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Spread points over the triangles by their area; a cloud's points are returned as they are, as in the benchmarks.

    Parameters
    ----------
    shape : a mesh or cloud
    n : number of points on a mesh
    rng : chooses the points

    Returns
    -------
    float64 (n, 3), mm

    Raises
    ------
    ValueError
        If the triangles have no area.
    """
    if not len(shape.faces):
        return shape.points.astype(np.float64)
    chosen, weights = spread_over_triangles(shape.points, shape.faces, n, rng)
    return between_corners(shape.points, shape.faces[chosen], weights)


def compare_points(
    measured: NDArray[np.floating], truth: NDArray[np.floating], thresholds: Sequence[float]
) -> dict[str, Any]:
    """Summarise distances both ways from point to point; compute precision, recall and F-score at each threshold.

    Parameters
    ----------
    measured, truth : floating (N, 3) and (M, 3), mm
    thresholds : mm
    """
    return compared(nearest_distances(measured, truth), nearest_distances(truth, measured), thresholds)


def compared(
    to_truth: NDArray[np.float64], to_measured: NDArray[np.float64], thresholds: Sequence[float]
) -> dict[str, Any]:
    """Summarise distances, and compute precision, recall and F-score at each threshold.

    Parameters
    ----------
    to_truth : float64 (N,), mm, of the measured points
    to_measured : float64 (M,), mm, of the truth's points
    thresholds : mm
    """
    return {
        "accuracy": _summary(to_truth),
        "completeness": _summary(to_measured),
        "scores": [_score(to_truth, to_measured, threshold) for threshold in thresholds],
    }


def nearest_distances(points: NDArray[np.floating], others: NDArray[np.floating]) -> NDArray[np.float64]:
    """Compute the exact distance float64 (N,), mm, of each point (N, 3) to the nearest of the others (M, 3)."""
    tree = search_tree(others)
    order = order_by_cells(points)
    distances = np.empty(len(points))
    distances[order] = tree.query(points[order], workers=-1)[0]  # neighbours find the tree's leaves in the cache
    return distances


@dataclass(frozen=True)
class MeshSettings:
    """Options of the comparison.

    Parameters
    ----------
    thresholds : mm, of the scores
    table_threshold : mm, of the F-score in `measures`; None for the middle threshold
    subject : dataset and approaches that the mesh belongs to
    seed : of the samples on the surfaces
    cell : mm; then `sampled` compares the means of the points in cells of this size, as the evaluation of Tanks and
        Temples does with half its threshold; None for the points themselves
    voxel : mm, over which ETH3D averages
    scanner : mm, where the truth was scanned from: ETH3D counts only what that scanner observed; None where unknown
    filled : whether filled holes of a mesh of ours count
    capture : folder of the recording; then completeness and recall count what its sensors can see; None: all
    """

    thresholds: tuple[float, ...]
    table_threshold: float | None = None
    subject: Subject = field(default_factory=Subject)
    seed: int = 1
    cell: float | None = None
    voxel: float = VOXEL_MM
    scanner: tuple[float, float, float] | None = None
    filled: bool = True
    capture: str | None = None

    @property
    def chosen(self) -> float:
        """The threshold of the F-score in `measures`, mm."""
        middle = self.thresholds[len(self.thresholds) // 2]
        return middle if self.table_threshold is None else self.table_threshold


def measure_mesh(mesh: Path, truth: Path, settings: MeshSettings) -> dict[str, Any]:
    """Compare two files; returns the content of report.json.

    Parameters
    ----------
    mesh, truth : each a mesh or cloud
    settings : options of the comparison

    Raises
    ------
    ValueError
        If a file cannot be read or holds a single point, their units differ, or a threshold is not positive.
    """
    thresholds = settings.thresholds
    check_thresholds(thresholds)
    if settings.chosen not in thresholds:
        raise ValueError(f"the threshold {settings.chosen:g} mm is none of {', '.join(f'{t:g}' for t in thresholds)}")
    for name, width in (("cells", settings.cell), ("voxels", settings.voxel)):
        if width is not None and not 0 < width < math.inf:
            raise ValueError(f"the {name} are {width:g} mm wide, expected a positive length")
    rng = np.random.default_rng(settings.seed)
    shapes = (read_shape if settings.filled else read_measured_shape)(mesh), read_shape(truth)
    measured, real = (_points(path, shape, rng) for path, shape in zip((mesh, truth), shapes, strict=True))
    remarks = size_remarks((str(mesh), str(truth)), measured, real)
    seen = _seen(settings, shapes[1], real)
    exact = compared(distances_to(shapes[1], measured), distances_to(shapes[0], real[seen]), thresholds)
    between = nearest_distances(measured, real), nearest_distances(real, measured)
    report: dict[str, Any] = {
        "schema_version": 1,
        "kind": "mesh",
        "settings": {
            "mesh": str(mesh),
            "truth": str(truth),
            "thresholds_mm": list(thresholds),
            "table_threshold_mm": settings.chosen,
            "samples": [len(measured), len(real)],
            "accuracy_to": "triangles" if len(shapes[1].faces) else "points",
            "completeness_to": "triangles" if len(shapes[0].faces) else "points",
            "spacing_mm": _spacing(real),
            "seed": settings.seed,
            "cell_mm": settings.cell,
            "voxel_mm": settings.voxel,
            "scanner_mm": settings.scanner,
            "filled": settings.filled,
            "capture": settings.capture,
            "seen": float(seen.mean()),
        },
        "remarks": remarks,
        **exact,
        "sampled": compared(*between, thresholds)
        if settings.cell is None
        else compare_points(cell_means(measured, settings.cell), cell_means(real, settings.cell), thresholds),
        "eth3d": eth3d_scores(measured, real, *between, thresholds, settings.scanner, voxel=settings.voxel),
    }
    return report | {"measures": _measures(report, settings)}


def _seen(settings: MeshSettings, truth: Shape, real: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark the truth's points that count for completeness, bool (N,)."""
    if settings.capture is None:
        return np.ones(len(real), np.bool_)
    seen = seen_by_sensors(truth, real, read_capture(Path(settings.capture)))
    if not seen.any():
        raise ValueError(f"{settings.capture}: its sensors see nothing of the truth; are both in the same coordinates?")
    return seen


def _points(path: Path, shape: Shape, rng: np.random.Generator) -> NDArray[np.float64]:
    with naming(path):
        points = sample_evenly(shape, N_SAMPLES, rng)
    if len(points) < 2:
        raise ValueError(f"{path}: holds a single point, expected a mesh or a cloud")
    return points


def distances_to(shape: Shape, points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Compute the distance (N,) of points (N, 3) to a shape, mm: to its triangles where it has any, else to points."""
    return np.abs(signed_distances_to(shape, points))


def signed_distances_to(shape: Shape, points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Compute the distance (N,) of points (N, 3) to a shape, mm, positive outside; unsigned for a cloud."""
    if not len(shape.faces):
        return nearest_distances(points, shape.points)
    return TriangleTree(shape.points, shape.faces).nearest(points).signed


def _measures(report: dict[str, Any], settings: MeshSettings) -> list[dict[str, Any]]:
    subject = settings.subject
    score = next(row for row in report["scores"] if row["threshold_mm"] == settings.chosen)
    at = f"at {settings.chosen:g} mm"
    return [
        *measure_rows(subject, "accuracy", report["accuracy"]["mean_mm"], direction=LESS, unit="mm"),
        *measure_rows(subject, "completeness", report["completeness"]["mean_mm"], direction=LESS, unit="mm"),
        *measure_rows(subject, f"F-score {at}", score["f_score"], direction=MORE, unit="share"),
    ]


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
    """Estimate the median distance of a point to its neighbour, mm: the resolution of distances between samples."""
    from scipy.spatial import cKDTree

    some = points[:: max(1, len(points) // 5000)]
    return float(np.median(np.asarray(cKDTree(points).query(some, k=2)[0])[:, 1]))
