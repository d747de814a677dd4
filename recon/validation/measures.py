"""What all evaluations tabulate: inlier ratios, and the measures that a study compares with its opinion scores."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

LESS, MORE = "less is better", "more is better"
BETTER = {LESS: "lower", MORE: "higher"}
EVERY_DATASET = "all"
COMBINED = "combined"  # the group of all sensors' points together
TABLE_THRESHOLD = 12.5  # mm, table 4 of the paper
N_REPLICATES = 1000


@dataclass(frozen=True)
class Subject:
    """What was measured, in a study's words.

    Parameters
    ----------
    dataset : the scene's name, or "all" for what holds of an approach whatever the scene
    approaches : such as "pm_fb"; a ball that was reconstructed by one depth method speaks for all its approaches
    """

    dataset: str = EVERY_DATASET
    approaches: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not all((self.dataset, *self.approaches)):
            raise ValueError("the name of a dataset or an approach is empty; give it, or leave the option out")


@dataclass(frozen=True)
class Measured:
    """A value in the table that every evaluation writes, `measures.csv`; its columns are these fields.

    Parameters
    ----------
    dataset, approach : in a study's words; "all" for every dataset
    frame : number; None for the whole sequence
    measure, direction : name, and which cloud is compared with which (see docs/measures.md), or ""
    value : may be infinite, as is the PSNR of two equal things
    unit : such as "mm", or "" for none
    better : "higher" or "lower"
    source : what measured it
    """

    dataset: str
    approach: str
    frame: int | None
    measure: str
    direction: str
    value: float
    unit: str
    better: str
    source: str

    def __post_init__(self) -> None:
        if self.better not in BETTER.values():
            raise ValueError(f"better is {self.better!r}, expected one of {', '.join(BETTER.values())}")


def measured_rows(rows: Sequence[Mapping[str, Any]], source: str) -> list[Measured]:
    """Convert rows of `measure_rows` for the table of measures.

    Parameters
    ----------
    rows : of a report
    source : what measured them
    """
    return [
        Measured(
            dataset=row["dataset"],
            approach=row["approach"],
            frame=None,
            measure=row["measure"],
            direction="",
            value=row["value"],
            unit=row["unit"],
            better=BETTER[row["direction"]],
            source=source,
        )
        for row in rows
    ]


def measure_rows(
    subject: Subject, measure: str, value: float | None, *, direction: str, unit: str
) -> list[dict[str, Any]]:
    """Return a row for each of the subject's approaches; none where there is no value.

    Parameters
    ----------
    measure, value, unit : name, number and unit of the measure
    direction : LESS or MORE
    """
    if value is None or not math.isfinite(value):
        return []
    row = {"measure": measure, "value": float(value), "direction": direction, "unit": unit}
    return [{"dataset": subject.dataset, "approach": approach, **row} for approach in subject.approaches]


def check_thresholds(thresholds: Sequence[float]) -> None:
    """Raise a ValueError if there are no thresholds, or one is no positive length."""
    if not thresholds or not min(thresholds) > 0:
        raise ValueError(f"thresholds are {list(thresholds)}, expected positive lengths in mm")


def inlier_rms(errors: NDArray[np.floating]) -> float | None:
    """Return the root mean square, mm, of the errors (N,) within TABLE_THRESHOLD; None where there are none."""
    inliers = errors[np.abs(errors) <= TABLE_THRESHOLD].astype(np.float64)
    return float(np.sqrt(np.mean(inliers**2))) if len(inliers) else None


def inlier_ratios(errors: NDArray[np.floating], thresholds: Sequence[float]) -> NDArray[np.float64]:
    """Return the shares (1 + T,) of points within TABLE_THRESHOLD and within each threshold, on either side.

    Parameters
    ----------
    errors : floating (N,), mm, signed
    thresholds : T lengths, mm, of the curve
    """
    ordered = np.sort(np.abs(errors))
    limits = np.array([TABLE_THRESHOLD, *thresholds], dtype=ordered.dtype)
    return np.asarray(np.searchsorted(ordered, limits, side="right") / len(errors))


def inlier_tables(
    groups: Mapping[tuple[str, str], Sequence[NDArray[np.float64]]], thresholds: Sequence[float], seed: int
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the rows at TABLE_THRESHOLD, and those of the curve: figure 6 and table 4 of the paper.

    A ratio is the mean over samples, each counting alike; its interval is the percentile bootstrap over samples.

    Parameters
    ----------
    groups : by subset and sensor, one float64 (1 + T,) from `inlier_ratios` for each sample
    thresholds : T lengths, mm, of the curve
    seed : of the bootstrap
    """
    table, curve = [], []
    for (subset, sensor), ratios in groups.items():
        if ratios:
            first, *others = _group_rows(subset, sensor, np.stack(ratios), (TABLE_THRESHOLD, *thresholds), seed)
            table.append(first)
            curve += others
    return table, curve


def inlier_measures(shape: str, table: Sequence[Mapping[str, Any]], subject: Subject) -> list[dict[str, Any]]:
    """Return the inlier ratio of all sensors together as a measure, of the samples used, or of all if none is.

    Parameters
    ----------
    shape : what was fitted, the first word of the measure's name
    table : rows at TABLE_THRESHOLD
    subject : what was measured
    """
    rows = [row for row in table if row["sensor"] == COMBINED]
    chosen = next((row for row in rows if row["subset"] == "used"), rows[0])
    name = f"{shape} inliers within {chosen['threshold_mm']:g} mm"
    return measure_rows(subject, name, chosen["inliers"], direction=MORE, unit="share")


def _group_rows(
    subset: str, sensor: str, ratios: NDArray[np.float64], thresholds: Sequence[float], seed: int
) -> list[dict[str, Any]]:
    """Return a row per threshold for ratios (samples, thresholds)."""
    drawn = np.random.default_rng(seed).integers(0, len(ratios), (N_REPLICATES, len(ratios)))
    low, high = np.percentile(ratios[drawn].mean(axis=1), (2.5, 97.5), axis=0)
    means = ratios.mean(axis=0)
    has_interval = len(ratios) > 1
    return [
        {
            "subset": subset,
            "sensor": sensor,
            "threshold_mm": float(threshold),
            "n_samples": len(ratios),
            "inliers": float(means[t]),
            "outliers": 1 - float(means[t]),
            "ci_low": float(low[t]) if has_interval else None,
            "ci_high": float(high[t]) if has_interval else None,
        }
        for t, threshold in enumerate(thresholds)
    ]
