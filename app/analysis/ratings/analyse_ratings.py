"""Run the whole analysis of ratings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from app.analysis.model.contrasts import Contrast, critical_value, letters
from app.analysis.ratings.contrasts import rating_contrasts
from app.analysis.ratings.disagreement import rating_disagreement
from app.analysis.ratings.opinion_scores import columns_by_condition, condition_rows, item_rows
from app.analysis.ratings.outliers import (
    LOWEST_CORRELATION,
    correlations_with_means,
    correlations_with_others,
    false_alarms,
    screen_observers,
)
from app.analysis.ratings.subject_model import (
    COMMON,
    FEWEST_RATINGS,
    Array,
    SubjectModel,
    fit_subject_model,
    rater_intervals,
)
from app.analysis.ratings.table import RatingTable, item_name
from app.analysis.reading.phrases import listed
from app.analysis.screening.careless import FALSE_ALARMS
from app.analysis.warnings import no_interval

Z = critical_value(None)
UNLIKE = "ratings unlike the others'"
ONE_GRADE = "the same rating throughout"
FEWEST_ALIKE = 10  # ratings, all of one grade, which nobody gives who looks
WHY_NO_MODEL = {
    "disconnected": "to tell biases and qualities apart takes two participants or more with three ratings each, linked "
    "by items that they share",
    "not converged": "the estimate did not settle",
}


def analyse_ratings(table: RatingTable) -> dict[str, list[dict[str, Any]]]:
    """Analyse ratings: mean opinion scores of items and conditions, participants, and what to be warned of.

    Parameters
    ----------
    table : RatingTable

    Returns
    -------
    dict, the rows of each table by its name: `rating_items`, `rating_conditions`, `rating_contrasts`, `raters`,
    `rating_model` (a single row) and `rating_warnings`; only lists, dictionaries, text, numbers and None
    """
    model = fit_subject_model(table)
    raters, items = list(_rater_rows(table, model)), list(_items_with_quality(table, model))
    contrasts = rating_contrasts(table)
    return {
        "rating_items": items,
        "rating_conditions": list(_with_letters(_conditions_with_quality(table, model), contrasts)),
        "rating_contrasts": [asdict(contrast) for contrast in contrasts],
        "raters": raters,
        "rating_model": [_model_row(table, model)],
        "rating_warnings": [{"warning": text} for text in _warnings(table, model, raters, items)],
    }


def _items_with_quality(table: RatingTable, model: SubjectModel) -> Iterator[dict[str, Any]]:
    for column, row in enumerate(item_rows(table)):
        yield row | _quality(model, [column])


def _conditions_with_quality(table: RatingTable, model: SubjectModel) -> Iterator[dict[str, Any]]:
    for row, columns in zip(condition_rows(table), columns_by_condition(table).values(), strict=True):
        yield row | _quality(model, columns)


def _with_letters(rows: Iterator[dict[str, Any]], contrasts: Sequence[Contrast]) -> Iterator[dict[str, Any]]:
    """Add the letters that conditions share if they do not differ; None where a pair was not compared."""
    kept = list(rows)
    best_first = [row["condition"] for row in sorted(kept, key=lambda row: -(row["mos"] or 0.0))]
    n_pairs = len(kept) * (len(kept) - 1) // 2
    shown = letters(best_first, contrasts) if len(contrasts) == n_pairs else {}
    for row in kept:
        yield row | {"letters": shown.get(row["condition"])}


def _quality(model: SubjectModel, columns: list[int]) -> dict[str, Any]:
    """Return the mean quality of some items with its error; None where the model has no estimate."""
    value = float(model.quality[columns].mean())
    if np.isnan(value):
        return dict.fromkeys(("quality", "quality_se", "quality_low", "quality_high"))
    error = float(np.sqrt(model.quality_covariance[np.ix_(columns, columns)].mean()))
    return {
        "quality": value,
        "quality_se": _or_none(error),
        "quality_low": _or_none(value - Z * error),
        "quality_high": _or_none(value + Z * error),
    }


def _rater_rows(table: RatingTable, model: SubjectModel) -> Iterator[dict[str, Any]]:
    screening = screen_observers(table)
    share, imbalance, is_outlier = screening.share, screening.imbalance, screening.is_outlier
    totals = np.bincount(table.person, table.rating, minlength=len(table.participants))
    others = correlations_with_others(table)
    alarms = false_alarms(others)
    limits = rater_intervals(table, model)
    grades = [set(table.rating[table.person == person]) for person in range(len(table.participants))]
    for index, correlation in enumerate(correlations_with_means(table)):
        n = int(screening.n_ratings[index])
        row: dict[str, Any] = {
            "participant": table.participants[index],
            "n_ratings": n,
            "mean": float(totals[index]) / n if n else None,
            **_rater_model(model, limits, index),
            "correlation": correlation,
            "bt500_above": int(screening.above[index]),
            "bt500_below": int(screening.below[index]),
            "bt500_share": _or_none(share[index]),
            "bt500_imbalance": _or_none(imbalance[index]),
            "is_bt500_outlier": bool(is_outlier[index]),
            "is_correlation_low": correlation is not None and correlation < LOWEST_CORRELATION,
            "correlation_others": others[index],
            "unlike_false_alarms": alarms[index],
            "is_one_grade": n >= FEWEST_ALIKE and len(grades[index]) == 1,
        }
        yield row | {"flags": list(_flags(row)), "remarks": list(_remarks(row))}


def _rater_model(model: SubjectModel, limits: tuple[Array, Array, Array], index: int) -> dict[str, Any]:
    bias, spread = float(model.bias[index]), float(model.inconsistency[index])
    if np.isnan(bias):
        names = ("bias", "bias_low", "bias_high", "inconsistency", "inconsistency_low", "inconsistency_high")
        return dict.fromkeys(names)
    half, low, high = (float(part[index]) for part in limits)
    return {
        "bias": bias,
        "bias_low": _or_none(bias - half),
        "bias_high": _or_none(bias + half),
        "inconsistency": spread,
        "inconsistency_low": _or_none(low),
        "inconsistency_high": _or_none(high),
    }


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _flags(row: dict[str, Any]) -> Iterator[str]:
    """Say in words what honest people's ratings hardly ever are."""
    if row["unlike_false_alarms"] is not None and row["unlike_false_alarms"] < FALSE_ALARMS:
        yield UNLIKE
    if row["is_one_grade"]:
        yield ONE_GRADE


def _remarks(row: dict[str, Any]) -> Iterator[str]:
    """Say in words which rules of recommendations name a participant; they name honest people, too."""
    if row["is_bt500_outlier"]:
        yield f"BT.500: {row['bt500_above']} far above, {row['bt500_below']} far below"
    if row["is_correlation_low"]:
        yield f"correlation {row['correlation']:.2f}"


def _model_row(table: RatingTable, model: SubjectModel) -> dict[str, Any]:
    is_end = (table.rating == table.low) | (table.rating == table.high)
    return {
        "protocol": table.protocol,
        "low": table.low,
        "high": table.high,
        "n_ratings": len(table),
        "n_participants": len(np.unique(table.person)),
        "n_items": len(np.unique(table.item)),
        "status": model.status,
        "loglik": _or_none(model.loglik),
        "iterations": model.iterations,
        "share_at_ends": float(is_end.mean()) if len(table) else 0.0,
        "disagreement": rating_disagreement(table),
    }


def _warnings(
    table: RatingTable, model: SubjectModel, raters: list[dict[str, Any]], items: list[dict[str, Any]]
) -> Iterator[str]:
    if model.status == COMMON:
        yield (
            "ratings: the likelihood of the subject model has no maximum, because the qualities can follow one "
            "participant without any residue (few ratings, or one participant far more consistent than the others); "
            "qualities and biases take all participants as equally consistent"
        )
    elif model.status != "ok":
        yield f"ratings: there are no qualities, biases and inconsistencies: {WHY_NO_MODEL[model.status]}"
    few = [row["participant"] for row in raters if 0 < row["n_ratings"] < FEWEST_RATINGS]
    if few:
        are = "is" if len(few) == 1 else "are"
        yield f"ratings: {', '.join(few)} gave fewer than {FEWEST_RATINGS} ratings and {are} left out of the model"
    flagged = [row["participant"] for row in raters if row["flags"]]
    if flagged:
        yield f"ratings: look at {listed(flagged)}, whose ratings are unusual; nobody was left out for it"
    if table.protocol == "acr-hr":
        there = {table.items[index][0] for index in np.flatnonzero(table.is_reference)}
        without = [name for name in dict.fromkeys(dataset for dataset, _ in table.items) if name not in there]
        if without:
            has = "has" if len(without) == 1 else "have"
            yield f"ratings: {', '.join(without)} {has} no reference, so there are no differential scores"
    several = np.bincount(table.person * len(table.items) + table.item).max(initial=0)
    agreed = [row for row in items if row["n"] > 1 and row["ci_low"] is None]
    for text in no_interval([item_name(row["dataset"], row["condition"]) for row in agreed]):
        yield f"ratings: {text}"
    if several > 1:
        yield "ratings: some participants rated an item several times; their mean counts as one opinion in the MOS"
