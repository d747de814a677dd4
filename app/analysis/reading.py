"""Read a votes table strictly from a file or rows, in our column names or another tool's.

Rows are counted from 1, without the header. Nothing is dropped or guessed: an error names the row and the value.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.tabular import numbers, read_frame, refuse
from app.analysis.votes_table import CHOICES, IDENTICAL, MAIN, ROLES, VotesError, VotesTable

REQUIRED = ("participant", "dataset", "item_a", "item_b", "choice")
OPTIONAL = (
    *("first_shown", "trial", "response_ms", "practice", "excluded", "reason", "count", "role"),
    *("both_seen", "press_to_picture_ms"),
)


@dataclass(frozen=True)
class Layout:
    """Another tool's names of our columns and choices: `columns["participant"] == "judge"`."""

    columns: Mapping[str, str]
    choices: Mapping[str, str]


LAYOUTS = {
    "reconstudy": Layout({}, {}),
    "judge": Layout({"participant": "judge"}, {"none": "tie"}),
    # The format of pwcmp, https://github.com/mantiuk/pwcmp
    "pwcmp": Layout(
        {
            "participant": "observer",
            "dataset": "scene",
            "item_a": "condition_A",
            "item_b": "condition_B",
            "choice": "is_A_selected",
        },
        {"a": "1", "b": "0"},
    ),
}


def votes_from_rows(
    rows: Iterable[Mapping[str, Any]],
    columns: Mapping[str, str] | None = None,
    choices: Mapping[str, str] | None = None,
) -> VotesTable:
    """Make a votes table from dictionaries.

    Parameters
    ----------
    rows : with at least the keys participant, dataset, item_a, item_b and choice
    columns : our name of a column -> the name in `rows`, where it differs
    choices : our word `a`, `b` or `none` -> the word in `rows`, where it differs

    Raises
    ------
    VotesError
        Naming the row and the value.
    """
    kept = list(rows)
    for number, row in enumerate(kept, start=1):
        if not isinstance(row, Mapping):
            raise VotesError(f"row {number}: {row!r} is not an object with named values")
    return _votes_from_frame(pd.DataFrame(kept, dtype=object), columns, choices)


def read_votes(
    path: Path,
    columns: Mapping[str, str] | None = None,
    choices: Mapping[str, str] | None = None,
) -> VotesTable:
    """Read a votes table from CSV, Parquet or JSON (a list of objects, or an object with the list `votes`).

    Parameters
    ----------
    path : a file whose name ends in .csv, .parquet or .json
    columns, choices : as in `votes_from_rows`; without them, the columns decide which of `LAYOUTS` it is

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    frame = read_frame(path)
    try:
        return _votes_from_frame(frame, columns, choices)
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error


def _votes_from_frame(
    frame: pd.DataFrame, columns: Mapping[str, str] | None, choices: Mapping[str, str] | None
) -> VotesTable:
    layout = _layout(tuple(map(str, frame.columns)), columns, choices)
    ours = _rename(frame, layout.columns)
    _check_columns(frame, ours, layout)
    if ours.empty:
        raise VotesError("has no row, expected at least one vote")
    text = {name: _text(ours[name], name) for name in ours.columns}
    participant, participants = _names(text["participant"], "participant", may_be_unknown=True)
    dataset, datasets = _names(text["dataset"], "dataset", may_be_unknown=True)
    both, items = _names(np.concatenate([text["item_a"], text["item_b"]]), "item", may_be_unknown=False)
    item_a, item_b = both[: len(ours)], both[len(ours) :]
    n = len(ours)
    role = _role(text.get("role"), n)
    refuse(
        (item_a == item_b) & (role != IDENTICAL), lambda row: f"the item {items[item_a[row]]!r} is compared with itself"
    )
    return VotesTable(
        participants,
        datasets,
        items,
        participant=participant,
        dataset=dataset,
        item_a=item_a,
        item_b=item_b,
        choice=_choice(text["choice"], layout.choices),
        first_shown=_first_shown(text.get("first_shown"), text["item_a"], text["item_b"]),
        both_seen=_both_seen(text.get("both_seen"), n),
        count=numbers(text["count"], "count", whole=True).astype(np.int64) if "count" in text else np.ones(n, np.int64),
        response_ms=_milliseconds(text, "response_ms", n),
        press_to_picture_ms=_milliseconds(text, "press_to_picture_ms", n),
        practice=_flags(text.get("practice"), "practice", n),
        excluded=_flags(text.get("excluded"), "excluded", n),
        reason=text["reason"] if "reason" in text else np.full(n, "", object),
        role=role,
    )


def _layout(names: Sequence[str], columns: Mapping[str, str] | None, choices: Mapping[str, str] | None) -> Layout:
    """Return the layout given, or else the first known one whose required columns are all there."""
    unknown = [*set(columns or {}).difference(REQUIRED + OPTIONAL), *set(choices or {}).difference(CHOICES)]
    if unknown:
        known = ", ".join(REQUIRED + OPTIONAL + CHOICES)
        raise VotesError(f"{unknown[0]!r} is no column or choice of a votes table; known are {known}")
    if columns:
        return Layout(columns, choices or {})
    for layout in LAYOUTS.values():
        if all(layout.columns.get(name, name) in names for name in REQUIRED):
            return Layout(layout.columns, choices or layout.choices)
    return Layout({}, choices or {})


def _rename(frame: pd.DataFrame, columns: Mapping[str, str]) -> pd.DataFrame:
    names = {name: columns.get(name, name) for name in REQUIRED + OPTIONAL}
    return pd.DataFrame({name: frame[given_name] for name, given_name in names.items() if given_name in frame.columns})


def _check_columns(frame: pd.DataFrame, ours: pd.DataFrame, layout: Layout) -> None:
    missing = [layout.columns.get(name, name) for name in REQUIRED if name not in ours.columns]
    missing += [theirs for name, theirs in layout.columns.items() if name not in ours.columns and theirs not in missing]
    if missing:
        present = ", ".join(map(str, frame.columns)) or "none"
        raise VotesError(
            f"lacks {'the column' if len(missing) == 1 else 'the columns'} {', '.join(missing)}; found {present}. "
            "Map other names with columns, e.g. participant=judge"
        )


def _text(column: pd.Series[Any], name: str) -> NDArray[np.object_]:
    """Return the column as stripped text; a missing value is empty, and refused where a row is too short."""
    values = np.array(column.to_list(), object)
    is_missing = np.asarray(pd.isna(column))
    if name in REQUIRED[2:]:
        refuse(is_missing, lambda _: f"{name} is missing")
    cleaned = ["" if missing else _as_text(value) for value, missing in zip(values, is_missing, strict=True)]
    return np.array(cleaned, object)


def _as_text(value: Any) -> str:
    if isinstance(value, str):
        return value.strip()
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value)


def _names(
    values: NDArray[np.object_], what: str, *, may_be_unknown: bool
) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    codes, names = pd.factorize(values)
    if "" in names and not (may_be_unknown and len(names) == 1):
        n_rows = len(values) // 2 if what == "item" else len(values)
        row = int(np.flatnonzero(values == "")[0])
        column = what if what != "item" else ("item_a" if row < n_rows else "item_b")
        raise VotesError(f"row {row % n_rows + 1}: {column} is empty")
    return codes.astype(np.int32), tuple(str(name) for name in names)


def _choice(values: NDArray[np.object_], words: Mapping[str, str]) -> NDArray[np.int8]:
    known = {words.get(choice, choice): index for index, choice in enumerate(CHOICES)}
    codes, distinct = pd.factorize(values)
    index = np.array([known.get(str(word), -1) for word in distinct], np.int8)
    choice = index[codes]
    refuse(choice < 0, lambda row: f"choice is {values[row]!r}, expected {', '.join(known)}")
    return choice


def _first_shown(
    values: NDArray[np.object_] | None, item_a: NDArray[np.object_], item_b: NDArray[np.object_]
) -> NDArray[np.int8]:
    if values is None:
        return np.full(len(item_a), -1, np.int8)
    first = np.select([values == "", values == item_a, values == item_b], [-1, 0, 1], default=-2)
    refuse(
        first == -2,
        lambda row: f"first_shown is {values[row]!r}, expected {item_a[row]!r} or {item_b[row]!r} or nothing",
    )
    return first.astype(np.int8)


def _flags(values: NDArray[np.object_] | None, name: str, n: int) -> NDArray[np.bool_]:
    if values is None:
        return np.zeros(n, bool)
    words = {"": 0, "0": 0, "false": 0, "no": 0, "1": 1, "true": 1, "yes": 1}
    codes, distinct = pd.factorize(values)
    flags = np.array([words.get(str(word).lower(), -1) for word in distinct])[codes]
    refuse(flags < 0, lambda row: f"{name} is {values[row]!r}, expected true or false")
    return flags.astype(bool)


def _milliseconds(text: Mapping[str, NDArray[np.object_]], name: str, n: int) -> NDArray[np.float64]:
    """Return a column of times; NaN for an empty cell or without the column."""
    return numbers(text[name], name) if name in text else np.full(n, np.nan)


def _both_seen(values: NDArray[np.object_] | None, n: int) -> NDArray[np.int8]:
    """Return 1 for true, 0 for false, -1 for an empty cell or without the column."""
    if values is None:
        return np.full(n, -1, np.int8)
    return np.where(values == "", -1, _flags(values, "both_seen", n)).astype(np.int8)


def _role(values: NDArray[np.object_] | None, n: int) -> NDArray[np.int8]:
    """Return 0, 1, 2 for main, repeat, identical; an empty cell is a main vote."""
    if values is None:
        return np.zeros(n, np.int8)
    numbers = {"": MAIN, **{name: number for number, name in enumerate(ROLES)}}
    roles = np.array([numbers.get(value, -1) for value in values], np.int8)
    refuse(roles < 0, lambda row: f"role is {values[row]!r}, expected {', '.join(ROLES)}")
    return roles
