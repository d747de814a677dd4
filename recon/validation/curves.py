"""Inliers against the threshold, as in the paper's figure 6 and table 4, of any shape whose errors are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.validation.measures import MORE, Subject, measure_rows

TABLE_THRESHOLD = 12.5  # mm, table 4 of the paper
N_REPLICATES = 1000
COMBINED = "combined"


def inlier_curve(errors: NDArray[np.floating], thresholds: Sequence[float]) -> NDArray[np.float64]:
    """Share of the points whose error is at most each threshold (T,), mm, on either side."""
    ordered = np.sort(np.abs(errors))
    return np.asarray(np.searchsorted(ordered, np.asarray(thresholds, dtype=ordered.dtype), side="right") / len(errors))


def group_rows(
    subset: str, group: str, ratios: Sequence[NDArray[np.float64]], thresholds: Sequence[float], seed: int
) -> list[dict[str, Any]]:
    """Inlier and outlier ratios of a group at each threshold: the mean over samples with its bootstrap interval.

    Parameters
    ----------
    ratios : one float64 (T,) for each sample
    """
    if not ratios:
        return []
    curves = np.stack(ratios)  # (samples, thresholds)
    drawn = np.random.default_rng(seed).integers(0, len(curves), (N_REPLICATES, len(curves)))
    low, high = np.percentile(curves[drawn].mean(axis=1), (2.5, 97.5), axis=0)
    has_interval = len(curves) > 1
    return [
        {
            "subset": subset,
            "sensor": group,
            "threshold_mm": float(threshold),
            "n_samples": len(curves),
            "inliers": float(curves[:, t].mean()),
            "outliers": 1 - float(curves[:, t].mean()),
            "ci_low": float(low[t]) if has_interval else None,
            "ci_high": float(high[t]) if has_interval else None,
        }
        for t, threshold in enumerate(thresholds)
    ]


def table_measures(shape: str, table: Sequence[Mapping[str, Any]], subject: Subject) -> list[dict[str, Any]]:
    """The inlier ratio of all sensors together, as a measure: of the reconstructions used, or of all if none is."""
    rows = [row for row in table if row["sensor"] == COMBINED]
    chosen = next((row for row in rows if row["subset"] == "used"), rows[0])
    name = f"{shape} inliers within {chosen['threshold_mm']:g} mm"
    return measure_rows(subject, name, chosen["inliers"], direction=MORE, unit="share")
