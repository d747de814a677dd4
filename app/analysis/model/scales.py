"""Express scores and differences on the scales that people publish: probabilities, JOD, and tests of equivalence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from app.analysis.model.contrasts import ALL_ALIKE, Contrast, holm, two_sided
from app.analysis.model.likelihood.fit import Fit

# One just-objectionable difference: preferred by 75 %, Perez-Ortiz and Mantiuk (2017).
LOG_ODDS_PER_JOD = float(np.log(3))
LONGEST_OF_GRADES = 10  # from end to end: the scale of 11 grades, ITU-T P.910


def rating_unit(scale: Mapping[str, Any]) -> str:
    """Return what steps of a rating scale are called: grades, or points where `low` and `high` are too far or near."""
    return "grades" if 2 <= scale["high"] - scale["low"] <= LONGEST_OF_GRADES else "points"


def preference_columns(
    fit: Fit, name: str, rows: Sequence[tuple[float | None, float | None, float | None]]
) -> list[dict[str, float | None]]:
    """Return differences and their limits as shares of decided votes for the first of two conditions.

    Parameters
    ----------
    fit : Fit that the differences are of
    name : of the column; its limits are `name_low` and `name_high`
    rows : difference, lower and upper limit of each, log-odds
    """
    names = (name, f"{name}_low", f"{name}_high")
    numbers = np.array(rows, float).reshape(-1, len(names))  # None becomes NaN
    shares = numbers if fit.theta is None else fit.preference(numbers)
    return [
        {key: None if np.isnan(share) else share for key, share in zip(names, row, strict=True)}
        for row in shares.tolist()
    ]


def equivalence_columns(
    fits: Sequence[Fit], contrasts: Sequence[Contrast], margin_jod: float | None
) -> list[dict[str, Any]]:
    """Return the test that two conditions differ by less than a margin, for each contrast.

    Two one-sided tests: the larger p-value of "the difference is below the margin" and "it is above minus the margin".
    There is none without an error of the difference, or if all participants voted alike.

    Parameters
    ----------
    fits : what the differences are of: one fit, or one for each group of conditions that votes do not set apart
    contrasts : the differences
    margin_jod : JOD (log-odds / ln 3); without one there is nothing to test

    Returns
    -------
    list of dict, `p_equivalent` and `p_equivalent_holm`, corrected for all pairs that have a test

    Source
    ------
    Schuirmann (1987).
    """
    rows: list[dict[str, Any]] = [{"p_equivalent": None, "p_equivalent_holm": None} for _ in contrasts]
    if margin_jod is None:
        return rows
    n_participants = {item: fit.n_participants for fit in fits for item in fit.items}
    p_values = {
        place: _p_equivalent(contrast, contrast.se, margin_jod * LOG_ODDS_PER_JOD, n_participants[contrast.item_a])
        for place, contrast in enumerate(contrasts)
        if contrast.se is not None and contrast.method != ALL_ALIKE
    }
    corrected = holm(np.array(list(p_values.values())))
    for (place, p_value), p_holm in zip(p_values.items(), corrected.tolist(), strict=True):
        rows[place] = {"p_equivalent": p_value, "p_equivalent_holm": p_holm}
    return rows


def _p_equivalent(contrast: Contrast, se: float, margin: float, n_participants: int | None) -> float:
    ratio = (margin - abs(contrast.difference)) / se
    half = float(two_sided(np.array([ratio]), n_participants)[0]) / 2
    return half if ratio > 0 else 1 - half
