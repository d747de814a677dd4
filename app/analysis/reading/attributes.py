"""Read the tables beside the votes: items' factors, participants' groups, objective measures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from app.analysis.reading.cells import numbers
from app.analysis.reading.measures_table import is_long, read_measures_table
from app.analysis.reading.tabular import read_csv
from app.analysis.reading.votes_table import ALL, VotesError


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
    frame = read_csv(path)
    if key not in frame.columns or len(frame.columns) < 2:
        columns = ", ".join(frame.columns)
        raise VotesError(f"{path}: has the columns {columns}; expected {key} and at least one {attribute}")
    empty = np.flatnonzero(frame[key].isna() | (frame[key] == ""))
    if len(empty):
        raise VotesError(f"{path}: row {empty[0] + 1}: {key} is empty")
    twice = np.flatnonzero(frame[key].duplicated())
    if len(twice):
        raise VotesError(f"{path}: row {twice[0] + 1}: the {key} {frame[key][twice[0]]!r} appears a second time")
    names = frame[key].tolist()
    return {
        column: {name: value for name, value in zip(names, frame[column].tolist(), strict=True) if value}
        for column in frame.columns
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
    frame = read_csv(path)
    if is_long([str(name) for name in frame.columns]):
        return _long_measures(path)
    if not {"dataset", "item"} <= set(frame.columns) or len(frame.columns) < 3:
        columns = ", ".join(frame.columns)
        raise VotesError(
            f"{path}: has the columns {columns}; expected dataset, item and a column for each measure, or dataset, "
            "approach, measure, value, better"
        )
    twice = np.flatnonzero(frame.duplicated(["dataset", "item"]))
    if len(twice):
        raise VotesError(f"{path}: row {twice[0] + 1}: this item of this dataset appears a second time")
    measures: dict[str, dict[str, dict[str, float]]] = {}
    for measure in (name for name in frame.columns if name not in ("dataset", "item")):
        texts = frame[measure].to_list()
        try:
            values = numbers(np.array(texts, object), measure, may_be_negative=True)
        except VotesError as error:
            raise VotesError(f"{path}: {error}") from error
        by_dataset = measures.setdefault(measure, {})
        for dataset, item, text, value in zip(frame["dataset"], frame["item"], texts, values, strict=True):
            if text:
                by_dataset.setdefault(dataset, {})[item] = float(value)
    return MeasureValues(measures)


def _long_measures(path: Path) -> MeasureValues:
    table = read_measures_table(path)
    values: dict[str, dict[str, dict[str, float]]] = {}
    for row in table.values:
        values.setdefault(row.measure, {}).setdefault(row.dataset, {})[row.approach] = row.value
    return MeasureValues(values, {row.measure: row.better for row in table.values}, table.notes)
