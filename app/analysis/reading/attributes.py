"""Read the tables beside the votes: items' factors, participants' groups, objective measures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.cells import Problems, Table, is_repeated, number_or_nan, shown
from app.analysis.reading.files.tabular import read_csv
from app.analysis.reading.measures_table import is_long, read_measures_table
from app.analysis.reading.votes_table import ALL, VotesError, naming


def read_items(path: Path) -> dict[str, dict[str, str]]:
    """Read items' factors, `item,<factor>,<factor>,…`, as {factor: {item: level}}; an empty cell means no level.

    Raises
    ------
    VotesError
        If there is no column `item`, or an item appears twice.
    """
    return _read_attributes(path, "item", "factor")


def read_participants(path: Path) -> dict[str, dict[str, str]]:
    """Read participants' groups, `participant,<grouping>,…`, as {grouping: {participant: group}}; an empty cell means
    no group.

    Raises
    ------
    VotesError
        If there is no column `participant`, or a participant appears twice.
    """
    return _read_attributes(path, "participant", "grouping")


def _read_attributes(path: Path, key: str, attribute: str) -> dict[str, dict[str, str]]:
    table = read_csv(path)
    with naming(path):
        if key not in table.columns or len(table.names) < 2:
            raise VotesError(f"has the columns {', '.join(table.names)}; expected {key} and at least one {attribute}")
        names, problems = table.columns[key].texts, Problems(table.row)
        problems.add(names == "", f"{key} is empty")
        problems.add((names != "") & is_repeated(names), lambda row: f"the {key} {names[row]!r} appears a second time")
        problems.check()
    return {
        column: {name: value for name, value in zip(names, cells.texts, strict=True) if value}
        for column, cells in table.columns.items()
        if column != key
    }


@dataclass(frozen=True)
class MeasureValues:
    """Objective measures of the items.

    Parameters
    ----------
    values : measure -> dataset, or `all` -> item -> value
    better : measure -> `higher` or `lower`, where the table tells
    notes : sentences on what was averaged or left out
    """

    values: dict[str, dict[str, dict[str, float]]]
    better: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def on(self, datasets: Sequence[str]) -> dict[str, dict[str, dict[str, float]]]:
        """Return the values on these datasets, with those that the table gives for all of them."""
        return {
            measure: {name: by.get(ALL, {}) | by.get(name, {}) for name in datasets}
            for measure, by in self.values.items()
        }

    def strangers(self, datasets: Sequence[str], items: Sequence[str]) -> list[str]:
        """Return the names, dataset/item, of what is not among these datasets and items."""
        known = {ALL, *datasets}
        places = {(d, item): None for by in self.values.values() for d, row in by.items() for item in row}
        return [f"{d}/{item}" for d, item in places if d not in known or item not in items]


def read_measures(path: Path) -> MeasureValues:
    """Read objective measures from either of two tables: the long one that `reconstudy validate` writes, with a row for
    each value and the direction, or a wide one, `dataset,item,<measure>,…`, where an empty cell means no value.

    Raises
    ------
    VotesError
        If a column is missing, a value stands there twice, or a value is no number.
    """
    table = read_csv(path)
    if is_long(table.names):
        long, values = read_measures_table(path), dict[str, dict[str, dict[str, float]]]()
        for row in long.values:
            values.setdefault(row.measure, {}).setdefault(row.dataset, {})[row.approach] = row.value
        return MeasureValues(values, {row.measure: row.better for row in long.values}, long.notes)
    with naming(path):
        return _wide_measures(table)


def _wide_measures(table: Table) -> MeasureValues:
    if not {"dataset", "item"} <= set(table.names) or len(table.names) < 3:
        raise VotesError(
            f"has the columns {', '.join(table.names)}; expected dataset, item and a column for each measure, or "
            "dataset, approach, measure, value, better"
        )
    problems = Problems(table.row)
    places = [*zip(*(table.columns[name].texts for name in ("dataset", "item")), strict=True)]
    problems.add(is_repeated(places), "this item of this dataset appears a second time")
    measures: dict[str, dict[str, dict[str, float]]] = {}
    for measure in (name for name in table.names if name not in ("dataset", "item")):
        for (dataset, item), value in zip(places, _numbers(table, measure, problems), strict=True):
            if not math.isnan(value):
                measures.setdefault(measure, {}).setdefault(dataset, {})[item] = float(value)
    problems.check()
    return MeasureValues(measures)


def _numbers(table: Table, measure: str, problems: Problems) -> NDArray[np.float64]:
    """Return a column of numbers, NaN where empty."""
    column = table.columns[measure]
    values = column.meaning(number_or_nan, np.float64)
    is_wrong = np.isnan(values) & column.meaning(bool, bool)
    problems.add(is_wrong, lambda row: f"{measure} is {shown(column.text(row))}, expected a number or nothing")
    return values
