"""What a report says in one list, for comparison with opinion scores: a dataset's and approach's value of a measure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

LESS, MORE = "less is better", "more is better"
EVERY_DATASET = "all"


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


def measure_rows(
    subject: Subject, measure: str, value: float | None, *, direction: str, unit: str
) -> list[dict[str, Any]]:
    """One row for each of the subject's approaches; none where there is no value.

    Parameters
    ----------
    direction : LESS or MORE
    """
    if value is None or not math.isfinite(value):
        return []
    row = {"measure": measure, "value": float(value), "direction": direction, "unit": unit}
    return [{"dataset": subject.dataset, "approach": approach, **row} for approach in subject.approaches]


def joined(parts: Sequence[list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """All rows of several lists."""
    return [row for part in parts for row in part]
