"""Prepare an analysis for the results page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

MINUS = "−"
NOTHING = "–"


@dataclass(frozen=True)
class ScoreLine:
    item: str
    score: str
    interval: str
    wins: str
    losses: str
    ties: str
    status: str


@dataclass(frozen=True)
class ScoreGroup:
    """The scores of a dataset, or of all together."""

    name: str
    rows: Sequence[ScoreLine]


@dataclass(frozen=True)
class ComparisonView:
    """The scores of all conditions ("all"), or of a factor's levels."""

    name: str
    groups: Sequence[ScoreGroup]


@dataclass(frozen=True)
class TriadsLine:
    """A participant's circular triads by dataset, and over all complete datasets."""

    participant: str
    cells: Sequence[str]
    total: str
    p_value: str


@dataclass(frozen=True)
class AgreementLine:
    dataset: str
    u: str
    p_value: str


@dataclass(frozen=True)
class GroupingView:
    """Groups of participants, a test of their difference, and their scores over all datasets.

    Parameters
    ----------
    groups : name and number of participants
    rows : an item, then its score and interval in each group
    """

    name: str
    figure: str
    groups: Sequence[tuple[str, int]]
    p_value: str
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class ResultsView:
    comparisons: Sequence[ComparisonView]
    datasets: Sequence[str]
    triads: Sequence[TriadsLine]
    agreement: Sequence[AgreementLine]
    warnings: Sequence[str]


def results_view(analysis: Mapping[str, Any]) -> ResultsView:
    """Return the content of the results page from analysis.json."""
    datasets = unique(row["dataset"] for row in analysis["triads"])
    return ResultsView(
        [_comparison(name, analysis["scores"]) for name in unique(row["comparison"] for row in analysis["scores"])],
        datasets,
        _triads(analysis, datasets),
        [_agreement(row) for row in analysis["agreement"] if row["u"] is not None],
        analysis["warnings"],
    )


def groups_view(analysis: Mapping[str, Any]) -> list[GroupingView]:
    """Return the content of the groups' page from analysis.json."""
    names = unique(row["grouping"] for row in analysis["groups"])
    return [_grouping(analysis, name) for name in names]


def _grouping(analysis: Mapping[str, Any], name: str) -> GroupingView:
    datasets = unique(row["dataset"] for row in analysis["groups"])
    dataset = "all" if "all" in datasets else datasets[0]
    rows = [row for row in analysis["groups"] if row["grouping"] == name and row["dataset"] == dataset]
    groups = {row["group"]: row["n_participants"] for row in rows}
    cells = {(row["item"], row["group"]): row for row in rows}
    items = unique(row["item"] for row in rows)
    lines = [(item, *(_group_cell(cells.get((item, group))) for group in groups)) for item in items]
    tests = [row for row in analysis["tests"] if row["name"] == f"group {name}" and row["dataset"] == dataset]
    p = tests[0]["p_holm"] if tests else None
    figure = f"group_{''.join(character if character.isalnum() else '_' for character in name)}"
    return GroupingView(name, figure, list(groups.items()), p_value(p), lines)


def _group_cell(row: Mapping[str, Any] | None) -> str:
    if row is None or row["ci_low"] is None:
        return NOTHING if row is None else decimal(row["score"])
    return f"{decimal(row['score'])} ({decimal(row['ci_low'])} to {decimal(row['ci_high'])})"


def decimal(value: float | None, digits: int = 2) -> str:
    """Format a number with a true minus sign; None as a dash."""
    return NOTHING if value is None else f"{value:.{digits}f}".replace("-", MINUS)


def p_value(value: float | None) -> str:
    if value is None:
        return NOTHING
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def _comparison(name: str, scores: Iterable[Mapping[str, Any]]) -> ComparisonView:
    rows = [row for row in scores if row["comparison"] == name]
    # All datasets together first: most readers look for them.
    datasets = sorted(unique(row["dataset"] for row in rows), key=lambda dataset: dataset != "all")
    groups = [_group(dataset, [row for row in rows if row["dataset"] == dataset]) for dataset in datasets]
    return ComparisonView(name, groups)


def _group(dataset: str, rows: Sequence[Mapping[str, Any]]) -> ScoreGroup:
    best_first = sorted(rows, key=lambda row: -(row["score"] if row["score"] is not None else float("-inf")))
    return ScoreGroup("all datasets" if dataset == "all" else dataset, [_line(row) for row in best_first])


def _line(row: Mapping[str, Any]) -> ScoreLine:
    interval = NOTHING if row["ci_low"] is None else f"{decimal(row['ci_low'])} to {decimal(row['ci_high'])}"
    wins, losses, ties = (f"{row[name]:g}" for name in ("wins", "losses", "ties"))
    return ScoreLine(row["item"], decimal(row["score"]), interval, wins, losses, ties, row["status"])


def _triads(analysis: Mapping[str, Any], datasets: Sequence[str]) -> list[TriadsLine]:
    circular = {(row["participant"], row["dataset"]): row for row in analysis["triads"]}
    pooled = {row["participant"]: row for row in analysis["triads_pooled"]}
    lines = []
    for participant in unique(row["participant"] for row in analysis["triads"]):
        cells = [_circular(circular.get((participant, dataset))) for dataset in datasets]
        together = pooled.get(participant)
        total, p = (str(together["circular"]), together["p_value"]) if together else (NOTHING, None)
        lines.append(TriadsLine(participant, cells, total, p_value(p)))
    return lines


def _agreement(row: Mapping[str, Any]) -> AgreementLine:
    dataset = "all datasets" if row["dataset"] == "all" else row["dataset"]
    return AgreementLine(dataset, decimal(row["u"]), p_value(row["p_value"]))


def _circular(row: Mapping[str, Any] | None) -> str:
    return NOTHING if row is None or row["circular"] is None else str(row["circular"])


def unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))
