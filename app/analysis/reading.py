"""Tables as people have them, read strictly: votes, items' factors, objective measures, participants.

Rows are counted from 1, without the header. Nothing is dropped and nothing is guessed: a table that cannot be
understood as a whole is refused, with the row and the value.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.votes import CHOICES, IDENTICAL, MAIN, ROLES, VotesError, VotesTable

REQUIRED = ("participant", "dataset", "item_a", "item_b", "choice")
OPTIONAL = ("first_shown", "trial", "response_ms", "practice", "excluded", "reason", "count", "role")


@dataclass(frozen=True)
class Layout:
    """How somebody else's table names our columns and our choices: `columns["participant"] == "judge"`."""

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
    """Make a votes table from rows as dictionaries.

    Parameters
    ----------
    rows : iterable of mapping
        At least the keys participant, dataset, item_a, item_b and choice.
    columns : mapping, optional
        Our name of a column -> the name in `rows`, where it differs.
    choices : mapping, optional
        Our word `a`, `b` or `none` -> the word in `rows`, where it differs.

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
    path : Path
        A file whose name ends in .csv, .parquet or .json.
    columns, choices : mapping, optional
        As in `votes_from_rows`. Without them, the layouts in `LAYOUTS` are recognised by their columns.

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    try:
        reader = READERS[path.suffix.lower()]
    except KeyError as error:
        raise VotesError(f"{path}: ends in {path.suffix!r}, expected one of {', '.join(READERS)}") from error
    try:
        return _votes_from_frame(reader(path), columns, choices)
    except FileNotFoundError as error:
        raise VotesError(f"{path}: there is no such file") from error
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error


def read_items(path: Path) -> dict[str, dict[str, str]]:
    """Read items' factors, `item,<factor>,<factor>,…`, as {factor: {item: level}}.

    Raises
    ------
    VotesError
        If there is no column `item`, an item appears twice, or a level is empty.
    """
    return _read_attributes(path, "item", "factor", may_be_empty=False)


def read_participants(path: Path) -> dict[str, dict[str, str]]:
    """Read what is known of participants, `participant,<grouping>,…`, as {grouping: {participant: group}}; an empty
    cell puts a participant into no group.

    Raises
    ------
    VotesError
        If there is no column `participant`, or a participant appears twice.
    """
    return _read_attributes(path, "participant", "grouping", may_be_empty=True)


def _read_attributes(path: Path, of: str, attribute: str, *, may_be_empty: bool) -> dict[str, dict[str, str]]:
    try:
        frame = _read_csv(path)
    except FileNotFoundError as error:
        raise VotesError(f"{path}: there is no such file") from error
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error
    if of not in frame.columns or len(frame.columns) < 2:
        found = ", ".join(frame.columns)
        raise VotesError(f"{path}: has the columns {found}; expected {of} and at least one {attribute}")
    for column in frame.columns:
        empty = np.flatnonzero(frame[column].isna() | (frame[column] == ""))
        if len(empty) and (column == of or not may_be_empty):
            raise VotesError(f"{path}: row {empty[0] + 1}: {column} is empty")
    twice = np.flatnonzero(frame[of].duplicated())
    if len(twice):
        raise VotesError(f"{path}: row {twice[0] + 1}: the {of} {frame[of][twice[0]]!r} appears a second time")
    names = frame[of].tolist()
    return {
        column: {name: value for name, value in zip(names, frame[column].tolist(), strict=True) if value}
        for column in frame.columns
        if column != of
    }


def read_measures(path: Path) -> dict[str, dict[str, dict[str, float]]]:
    """Read objective measures, `dataset,item,<measure>,…`, as {measure: {dataset: {item: value}}}; an empty cell is
    no value.

    Raises
    ------
    VotesError
        If a column is missing, an item of a dataset appears twice, or a value is no finite number.
    """
    try:
        frame = _read_csv(path)
    except FileNotFoundError as error:
        raise VotesError(f"{path}: there is no such file") from error
    except VotesError as error:
        raise VotesError(f"{path}: {error}") from error
    if not {"dataset", "item"} <= set(frame.columns) or len(frame.columns) < 3:
        found = ", ".join(frame.columns)
        raise VotesError(f"{path}: has the columns {found}; expected dataset, item and at least one measure")
    twice = np.flatnonzero(frame.duplicated(["dataset", "item"]))
    if len(twice):
        raise VotesError(f"{path}: row {twice[0] + 1}: this item of this dataset appears a second time")
    measures: dict[str, dict[str, dict[str, float]]] = {}
    for measure in (name for name in frame.columns if name not in ("dataset", "item")):
        texts = frame[measure].to_list()
        try:
            values = _numbers(np.array(texts, object), measure, may_be_negative=True)
        except VotesError as error:
            raise VotesError(f"{path}: {error}") from error
        own = measures.setdefault(measure, {})
        for dataset, item, text, value in zip(frame["dataset"], frame["item"], texts, values, strict=True):
            if text:
                own.setdefault(dataset, {})[item] = float(value)
    return measures


def _read_csv(path: Path) -> pd.DataFrame:
    text = _decode(path.read_bytes())
    if not text.strip():
        raise VotesError("is empty, expected a header and at least one row")
    try:
        frame = pd.read_csv(io.StringIO(text), dtype=str, keep_default_na=False, skipinitialspace=True, index_col=False)
    except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
        raise VotesError(f"is not a table of equally long rows: {str(error).strip()}") from error
    frame.columns = [str(column).strip() for column in frame.columns]
    return pd.DataFrame({name: frame[name].str.strip() for name in frame.columns})


def _decode(content: bytes) -> str:
    """Decode UTF-8, or UTF-16 if the file says so; anything else is refused at the place where it stops making
    sense.
    """
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        start = content.rfind(b"\n", 0, error.start) + 1
        line = content[start:].split(b"\n", 1)[0].decode("latin-1").strip()
        row = content[: error.start].count(b"\n")
        raise VotesError(f"row {row}: {line!r} is not UTF-8 (it may be Latin-1); save the file as UTF-8") from error


def _read_parquet(path: Path) -> pd.DataFrame:
    try:
        return pd.read_parquet(path)
    except (ValueError, OSError) as error:
        if isinstance(error, FileNotFoundError):
            raise
        raise VotesError(f"is not readable as Parquet: {error}") from error


def _read_json(path: Path) -> pd.DataFrame:
    try:
        content = json.loads(_decode(path.read_bytes()))
    except json.JSONDecodeError as error:
        raise VotesError(f"is not readable as JSON: {error}") from error
    rows = content.get("votes") if isinstance(content, dict) else content
    if not isinstance(rows, list):
        raise VotesError("holds no list of votes, expected [{…}, …] or {'votes': [{…}, …]}")
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, dict):
            raise VotesError(f"row {number}: {row!r} is not an object with named values")
    return pd.DataFrame(rows, dtype=object)


READERS: dict[str, Callable[[Path], pd.DataFrame]] = {".csv": _read_csv, ".parquet": _read_parquet, ".json": _read_json}


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
    _refuse(
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
        count=_numbers(text["count"], "count", whole=True).astype(np.int64)
        if "count" in text
        else np.ones(n, np.int64),
        response_ms=_numbers(text["response_ms"], "response_ms") if "response_ms" in text else np.full(n, np.nan),
        practice=_flags(text.get("practice"), "practice", n),
        excluded=_flags(text.get("excluded"), "excluded", n),
        reason=text["reason"] if "reason" in text else np.full(n, "", object),
        role=role,
    )


def _layout(found: Sequence[str], columns: Mapping[str, str] | None, choices: Mapping[str, str] | None) -> Layout:
    """Return the layout asked for, or else the first known one whose required columns are all there."""
    unknown = [*set(columns or {}).difference(REQUIRED + OPTIONAL), *set(choices or {}).difference(CHOICES)]
    if unknown:
        known = ", ".join(REQUIRED + OPTIONAL + CHOICES)
        raise VotesError(f"{unknown[0]!r} is no column or choice of a votes table; known are {known}")
    if columns:
        return Layout(columns, choices or {})
    for layout in LAYOUTS.values():
        if all(layout.columns.get(name, name) in found for name in REQUIRED):
            return Layout(layout.columns, choices or layout.choices)
    return Layout({}, choices or {})


def _rename(frame: pd.DataFrame, columns: Mapping[str, str]) -> pd.DataFrame:
    there = {name: columns.get(name, name) for name in REQUIRED + OPTIONAL}
    return pd.DataFrame({name: frame[theirs] for name, theirs in there.items() if theirs in frame.columns})


def _check_columns(frame: pd.DataFrame, ours: pd.DataFrame, layout: Layout) -> None:
    missing = [layout.columns.get(name, name) for name in REQUIRED if name not in ours.columns]
    missing += [theirs for name, theirs in layout.columns.items() if name not in ours.columns and theirs not in missing]
    if missing:
        found = ", ".join(map(str, frame.columns)) or "none"
        raise VotesError(
            f"lacks {'the column' if len(missing) == 1 else 'the columns'} {', '.join(missing)}; found {found}. "
            "Map other names with columns, e.g. participant=judge"
        )


def _text(column: pd.Series[Any], name: str) -> NDArray[np.object_]:
    """Return the column as stripped text; missing values are empty, except in rows that are too short."""
    values = np.array(column.to_list(), object)
    is_missing = np.asarray(pd.isna(column))
    if name in REQUIRED[2:]:
        _refuse(is_missing, lambda _: f"{name} is missing")
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
    codes, found = pd.factorize(values)
    index = np.array([known.get(str(word), -1) for word in found], np.int8)
    choice = index[codes]
    _refuse(choice < 0, lambda row: f"choice is {values[row]!r}, expected {', '.join(known)}")
    return choice


def _first_shown(
    values: NDArray[np.object_] | None, item_a: NDArray[np.object_], item_b: NDArray[np.object_]
) -> NDArray[np.int8]:
    if values is None:
        return np.full(len(item_a), -1, np.int8)
    first = np.select([values == "", values == item_a, values == item_b], [-1, 0, 1], default=-2)
    _refuse(
        first == -2,
        lambda row: f"first_shown is {values[row]!r}, expected {item_a[row]!r} or {item_b[row]!r} or nothing",
    )
    return first.astype(np.int8)


def _numbers(
    values: NDArray[np.object_], name: str, *, whole: bool = False, may_be_negative: bool = False
) -> NDArray[np.float64]:
    expected = "a whole number, 0 or more" if whole else "a number, 0 or more, or nothing"
    if may_be_negative:
        expected = "a number or nothing"

    def number(value: str) -> float:
        try:
            return float(value)
        except ValueError:
            return math.nan

    parsed = np.array([number(value) for value in values], np.float64)
    is_bad = ~np.isfinite(parsed) | ((parsed < 0) & (not may_be_negative)) | (whole & (parsed != np.floor(parsed)))
    _refuse(is_bad & (whole | (values != "")), lambda row: f"{name} is {values[row]!r}, expected {expected}")
    return parsed


def _flags(values: NDArray[np.object_] | None, name: str, n: int) -> NDArray[np.bool_]:
    if values is None:
        return np.zeros(n, bool)
    words = {"": 0, "0": 0, "false": 0, "no": 0, "1": 1, "true": 1, "yes": 1}
    codes, found = pd.factorize(values)
    flags = np.array([words.get(str(word).lower(), -1) for word in found])[codes]
    _refuse(flags < 0, lambda row: f"{name} is {values[row]!r}, expected true or false")
    return flags.astype(bool)


def _role(values: NDArray[np.object_] | None, n: int) -> NDArray[np.int8]:
    """Return 0, 1, 2 for main, repeat, identical; an empty cell is a main vote."""
    if values is None:
        return np.zeros(n, np.int8)
    numbers = {"": MAIN, **{name: number for number, name in enumerate(ROLES)}}
    roles = np.array([numbers.get(value, -1) for value in values], np.int8)
    _refuse(roles < 0, lambda row: f"role is {values[row]!r}, expected {', '.join(ROLES)}")
    return roles


def _refuse(is_bad: NDArray[np.bool_], why: Callable[[int], str]) -> None:
    rows = np.flatnonzero(is_bad)
    if len(rows):
        more = f" (and {len(rows) - 1} more rows like it)" if len(rows) > 1 else ""
        raise VotesError(f"row {rows[0] + 1}: {why(int(rows[0]))}{more}")
