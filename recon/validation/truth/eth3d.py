"""Accuracy and completeness as the benchmark ETH3D counts them: by voxels, and only where the scanner looked.

Completeness is the share of the scan's points within a threshold of the reconstruction. Accuracy is the share of the
reconstruction's points within the threshold of a scanned point on whose beam they lie; those that no beam passes, or
that lie behind what it met, were not observed and do not count. Both are taken in every voxel of two grids, the second
moved by half a voxel, and averaged, so that dense parts weigh no more.

Source
------
Schöps et al., "A Multi-View Stereo Benchmark with High-Resolution Images and Multi-Camera Videos" (2017), section 4,
and its evaluation program.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

VOXEL_MM = 10.0  # the program's defaults, from here on
BEAM_START_MM = 0.5 * 2.25
BEAM_SPREAD = float(np.tan(np.deg2rad(0.011)))
GRID_SHIFTS = (0.0, 0.5)  # of a voxel
MOST_VOXELS = 2**62  # that 64 bits can number
CHUNK = 20_000  # points whose beams are looked up at once


def eth3d_scores(
    measured: NDArray[np.float64],
    truth: NDArray[np.float64],
    to_truth: NDArray[np.float64],
    to_measured: NDArray[np.float64],
    thresholds: Sequence[float],
    scanner: Sequence[float] | None = None,
    *,
    voxel: float = VOXEL_MM,
) -> list[dict[str, float]]:
    """Compute accuracy, completeness and their harmonic mean at each threshold.

    Parameters
    ----------
    measured, truth : float64 (N, 3) and (M, 3), mm
    to_truth, to_measured : float64 (N,) and (M,), mm, distances to the nearest point of the other cloud
    thresholds : mm
    scanner : x, y, z, mm, from where the truth was scanned; None to count everything as observed
    voxel : mm
    """
    was_passed = np.ones(len(measured), np.bool_)
    if scanner is not None:
        to_truth, was_passed = along_beams(measured, truth, np.asarray(scanner, np.float64))
    measured_voxels, true_voxels = voxels(measured, voxel), voxels(truth, voxel)
    every = np.ones(len(truth), np.bool_)
    rows = []
    for threshold in thresholds:
        is_accurate = to_truth <= threshold
        is_observed = is_accurate | was_passed
        accuracy = voxel_mean(measured_voxels, is_accurate, is_observed)
        completeness = voxel_mean(true_voxels, to_measured <= threshold, every)
        both = accuracy + completeness
        rows.append(
            {
                "threshold_mm": float(threshold),
                "accuracy": accuracy,
                "completeness": completeness,
                "f1": 2 * accuracy * completeness / both if both else 0.0,
                "unobserved": float(np.mean(~is_observed)),
            }
        )
    return rows


def voxels(points: NDArray[np.float64], size: float) -> list[NDArray[np.int64]]:
    """Number the voxels that hold points (N, 3), mm, in each grid: int64 (N,) for each.

    A ValueError says that they are too small to be numbered.
    """
    numbers = []
    for shift in GRID_SHIFTS:
        cells = np.floor(points / size + shift)
        cells -= cells.min(axis=0)
        if float(np.prod(cells.max(axis=0) + 1)) > MOST_VOXELS:
            extent = float(np.ptp(points, axis=0).max())
            raise ValueError(
                f"voxels of {size:g} mm are too small for points {extent:.3g} mm across; choose larger ones"
            )
        cells = cells.astype(np.int64)
        keys = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
        numbers.append(np.unique(keys, return_inverse=True)[1])
    return numbers


def voxel_mean(grids: Sequence[NDArray[np.int64]], is_good: NDArray[np.bool_], is_counted: NDArray[np.bool_]) -> float:
    """Average over the voxels of all grids the share of good points among those that count there.

    Parameters
    ----------
    grids : int64 (N,) for each, as from `voxels`
    is_good, is_counted : bool (N,)
    """
    shares = []
    for numbers in grids:
        counted = np.bincount(numbers, weights=is_counted)
        good = np.bincount(numbers, weights=is_good & is_counted)
        shares.append(good[counted > 0] / counted[counted > 0])
    every = np.concatenate(shares)
    return float(every.mean()) if len(every) else 0.0


def along_beams(
    points: NDArray[np.float64], scan: NDArray[np.float64], scanner: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Compare points with the beams of a scan that pass them.

    Parameters
    ----------
    points : float64 (N, 3), mm
    scan : float64 (M, 3), mm, where the beams ended
    scanner : float64 (3,), mm, where they began

    Returns
    -------
    distances : float64 (N,), mm, to the nearest scanned point whose beam passes there, infinite where none does
    is_in_front : bool (N,), whether a beam went through on its way to its end

    Raises
    ------
    ValueError
        If a point lies at the scanner.
    """
    from scipy.spatial import cKDTree

    offsets, met = points - scanner, scan - scanner
    reach, ranges = np.linalg.norm(offsets, axis=1), np.linalg.norm(met, axis=1)
    if not (ranges.min() > 0 and reach.min() > 0):
        raise ValueError(f"the scanner, at {scanner.tolist()} mm, stands where there is a point: no beam goes there")
    directions = met / ranges[:, None]
    tree = cKDTree(directions)
    beam = BEAM_START_MM + reach * BEAM_SPREAD
    chords = 2 * np.sin(np.arcsin(np.minimum(beam / reach, 1.0)) / 2)
    distances, is_in_front = np.full(len(points), np.inf), np.zeros(len(points), np.bool_)
    for first in range(0, len(points), CHUNK):
        chunk = slice(first, first + CHUNK)
        beams = tree.query_ball_point(offsets[chunk] / reach[chunk, None], chords[chunk], workers=-1)
        rows = first + np.repeat(np.arange(len(beams)), [len(passing) for passing in beams])
        columns = np.concatenate([np.asarray(passing, np.int64) for passing in beams])
        np.minimum.at(distances, rows, np.linalg.norm(offsets[rows] - met[columns], axis=1))
        along = np.einsum("ij,ij->i", offsets[rows], directions[columns])
        is_in_front[rows[along < ranges[columns]]] = True
    return distances, is_in_front
