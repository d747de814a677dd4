"""Warn the reader of an analysis about separated or disconnected votes, missing errors and repeated votes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from app.analysis.comparisons.comparison import Comparison
from app.analysis.model.bootstrap import fewest_replicates
from app.analysis.model.bradley_terry import RIDGE
from app.analysis.model.contrasts import half_widths, has_few_participants, scores_of
from app.analysis.model.settings import LEVEL
from app.analysis.objective.permutation import FEWEST_CONDITIONS
from app.analysis.reading.phrases import counted, listed
from app.analysis.reading.votes_table import ALL, VotesTable

NOTHING_LEFT = "No vote is left after practice and exclusions: there is nothing to analyse."
MOST_PAIRS = 10_000  # listed of a comparison
MANY_REPEATS = 5  # repeated votes to name
FIRST_LOOK = 100_000  # rows in which they are looked for first
UNNAMED = (ALL, "")  # datasets that are all of them, or the only one, which has no name
FEW_CONDITIONS = 10  # of a dataset, which then tells little about a measure: 0.63 is within chance


def warnings_of(votes: VotesTable, used: VotesTable, compared: list[Comparison]) -> list[str]:
    """Return the sentences to read before the numbers.

    Parameters
    ----------
    votes : VotesTable, all votes
    used : VotesTable, the votes analysed
    compared : the fits
    """
    warnings = [] if len(used) else [NOTHING_LEFT]
    warnings += _repeats(votes)
    has_order = any(comparison.fit.design.has_order for comparison in compared)
    if has_order and not (used.first_shown >= 0).any():
        warnings.append(
            "no vote records which condition was shown first (first_shown): item_a counts as shown first, so the "
            "order effect is that of being item_a"
        )
    warnings += _orders_left_out(compared)
    if used.has_participants and len(used) and used.n_voters == 1:
        warnings.append("a single participant voted, so nothing can be said about other people")
    warnings += _single_voters(compared, used)
    said: dict[str, list[Comparison]] = {}
    for comparison in compared:
        for text in _fit_warnings(comparison):
            said.setdefault(text, []).append(comparison)
    return [*warnings, *(f"{_places(where)}: {text}" for text, where in said.items())]


def _orders_left_out(compared: list[Comparison]) -> Iterator[str]:
    """Yield why the order effect is left out, a sentence for each reason."""
    reasons: dict[str, list[str]] = {}
    for comparison in compared:
        if comparison.order_left_out:
            reasons.setdefault(comparison.order_left_out, []).append(_where(comparison))
    for why, where in reasons.items():
        yield f"the order effect is left out ({'; '.join(where)}): {why}"


def _single_voters(compared: list[Comparison], used: VotesTable) -> Iterator[str]:
    """Yield, in one sentence, where a single participant voted although others did elsewhere."""
    if not used.has_participants or used.n_voters <= 1:
        return
    alone = [comparison for comparison in compared if comparison.fit.n_participants == 1]
    if alone:
        yield f"{_places(alone)}: a single participant voted there, so nothing can be said about other people"


PENALISED = {"firth": "Firth's (1993) estimate", f"ridge {RIDGE}": f"an estimate with a ridge of {RIDGE}"}


def _where(comparison: Comparison) -> str:
    what = "all conditions" if comparison.comparison == ALL else f"factor {comparison.comparison}"
    if not comparison.votes.has_datasets:
        return what
    return f"{what}, {'all datasets' if comparison.dataset == ALL else f'dataset {comparison.dataset}'}"


def _places(comparisons: Sequence[Comparison]) -> str:
    """Name what many comparisons are about: each set of conditions or levels once, with its datasets."""
    datasets: dict[str, list[str]] = {}
    for each in comparisons:
        what, _, where = _where(each).partition(", ")
        datasets.setdefault(what, []).append(where)
    return "; ".join(f"{what}, {listed(where)}" if where[0] else what for what, where in datasets.items())


def measure_warnings(predictions: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a sentence for each number of conditions with which measures can hardly, or cannot, be judged.

    Parameters
    ----------
    predictions : rows of `prediction_rows`
    """
    has_names = any(row["dataset"] not in UNNAMED for row in predictions)
    judged: dict[tuple[int, float], dict[str, None]] = {}
    for row in predictions:
        if row["n_conditions"] < FEW_CONDITIONS:
            judged.setdefault((row["n_conditions"], row["p_smallest"]), {})[row["dataset"]] = None
    for (n_conditions, p_smallest), datasets in judged.items():
        single = [name for name in datasets if name not in UNNAMED]
        together = ", all datasets together" if has_names else ""
        where = f", dataset {', '.join(single)}" if single else together
        smallest = f"measures{where}: with {n_conditions} conditions the smallest p-value is {p_smallest:.2g}"
        if n_conditions < FEWEST_CONDITIONS:
            yield (
                f"{smallest}, so next to nothing can be said about measures, and there are no intervals; "
                f"expected {FEWEST_CONDITIONS} conditions or more"
            )
        else:
            t = student.ppf((1 + LEVEL) / 2, n_conditions - 2)
            yield (
                f"{smallest}, and on one dataset random numbers correlate by up to "
                f"{t / np.sqrt(n_conditions - 2 + t**2):.2f} (19 times in 20): a single dataset can hardly tell "
                "whether a measure predicts the scores"
            )


def _fit_warnings(comparison: Comparison) -> Iterator[str]:
    """Yield what is to know of a fit, without saying of which."""
    fit = comparison.fit
    if fit.status == "disconnected" and len(fit.groups) > 1:
        islands = "; ".join(", ".join(group) for group in fit.groups)
        yield f"disconnected, no vote links these groups, so no scores exist on one scale: {islands}"
    if fit.status == "separated" and len(fit.groups) > 1:
        order = " > ".join("{" + ", ".join(group) + "}" for group in fit.groups)
        yield (
            f"no finite maximum: no vote, or only ties, went against the order {order}; "
            f"scores are {PENALISED.get(fit.penalty or '', fit.penalty)}"
        )
    if fit.status == "separated" and len(fit.groups) == 1:
        yield (
            f"no finite maximum, the tie parameter grows without limit; scores are "
            f"{PENALISED.get(fit.penalty or '', fit.penalty)}"
        )
    if len(fit.counts.first) > MOST_PAIRS:
        yield f"{len(fit.counts.first)} pairs are analysed and not listed"
    if fit.theta is not None and fit.covariance is None:
        yield f"no errors are given for as many as {len(fit.items)} items"
    if fit.status == "ok" and fit.covariance is not None and (fit.n_participants or 0) > 1:
        half = half_widths(scores_of(fit))
        if half is None:
            yield "no intervals, as participants agree too exactly to tell how much other people would differ"
        else:
            yield from no_interval([item for item, each in zip(fit.items, half, strict=True) if np.isnan(each)])
    if comparison.bootstrap is not None and comparison.bootstrap.n_without_maximum:
        total = len(comparison.bootstrap.scores) + comparison.bootstrap.n_without_maximum
        missing = comparison.bootstrap.n_without_maximum
        has_percentiles = comparison.bootstrap.has_percentiles(fit.n_participants or 0)
        have, are = ("has", "is") if missing == 1 else ("have", "are")
        what = "left out" if has_percentiles else "too many for percentiles to hold"
        yield f"{missing} of {counted(total, 'bootstrap replicate')} {have} no maximum and {are} {what}"
    elif comparison.bootstrap is not None and not has_few_participants(fit):
        n_replicates, fewest = len(comparison.bootstrap.scores), fewest_replicates(fit.n_participants or 0)
        if n_replicates < fewest:
            are = "is" if n_replicates == 1 else "are"
            few = f"{counted(n_replicates, 'bootstrap replicate')} {are} too few"
            yield f"{few} for percentiles: t intervals stand; take {fewest}"


def no_interval(names: Sequence[str]) -> list[str]:
    """Return the sentence on scores without an interval, as all participants agree on them; none without names."""
    why = "on which all agree exactly: that does not tell how much other people would differ"
    return [f"no interval of {listed(names)}, {why}"] if names else []


def _repeats(votes: VotesTable) -> list[str]:
    """Name the rows in which a participant votes on a pair again; these votes count."""
    if not votes.has_participants:
        return []
    unit = votes.participant.astype(np.int64) * len(votes.datasets) + votes.dataset
    key = np.where(votes.is_used, unit * len(votes.items) ** 2 + votes.pair, -1 - np.arange(len(votes)))
    ordered = np.sort(key)
    n_repeats = int((ordered[1:] == ordered[:-1]).sum())
    rows = _first_repeats(key, min(n_repeats, MANY_REPEATS))
    named = [
        f"row {row + 1} ({votes.participants[votes.participant[row]]}, "
        f"{votes.datasets[votes.dataset[row]] or 'no dataset'}, "
        f"{votes.items[votes.item_a[row]]} - {votes.items[votes.item_b[row]]})"
        for row in rows
    ]
    if not named:
        return []
    more = f" and {n_repeats - len(named)} more" if n_repeats > len(named) else ""
    repeating = "1 vote repeats" if n_repeats == 1 else f"{n_repeats} votes repeat"
    what = f"{repeating} a pair that the same participant judged before; all are counted"
    return [f"{what}: {', '.join(named)}{more}"]


def _first_repeats(key: NDArray[np.int64], wanted: int) -> NDArray[np.intp]:
    """Return the first rows whose key an earlier row has; few rows of a long table show them."""
    size, rows = FIRST_LOOK, np.zeros(0, np.intp)
    while len(rows) < wanted:
        is_first = np.zeros(len(key[:size]), bool)
        is_first[np.unique(key[:size], return_index=True)[1]] = True
        rows = np.flatnonzero(~is_first)
        size *= 10
    return rows[:wanted]
