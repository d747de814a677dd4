"""Read the tables beside the votes: items' factors, participants' groups, objective measures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from app.analysis.tabular import numbers, read_csv
from app.analysis.votes_table import VotesError


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


def read_measures(path: Path) -> dict[str, dict[str, dict[str, float]]]:
    """Read objective measures, `dataset,item,<measure>,…`, as {measure: {dataset: {item: value}}}; an empty cell means
    no value.

    Raises
    ------
    VotesError
        If a column is missing, an item of a dataset appears twice, or a value is no finite number.
    """
    frame = read_csv(path)
    if not {"dataset", "item"} <= set(frame.columns) or len(frame.columns) < 3:
        columns = ", ".join(frame.columns)
        raise VotesError(f"{path}: has the columns {columns}; expected dataset, item and at least one measure")
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
    return measures
