"""Read tables of ratings that were made elsewhere, row by row checked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.ratings.layouts import is_of_ratings, one_rating_a_row
from app.analysis.ratings.table import PROTOCOLS, ComparisonTable, RatingTable, numbered_names
from app.analysis.reading.tabular import flags, numbers, read_frame, refuse, texts
from app.analysis.reading.votes_table import VotesError

Columns = Mapping[str, NDArray[np.object_]]

SCALE = (1.0, 5.0)  # of ITU-T P.910, five-level
COMPARISON_SCALE = (-3.0, 3.0)  # of ITU-T P.910, seven-level
REQUIRED = ("participant", "dataset", "condition", "rating")
COMPARED = ("participant", "dataset", "item_a", "item_b", "rating")


def holds_ratings(path: Path) -> bool:
    """Does a table hold ratings?

    Raises
    ------
    VotesError
        If the file cannot be read.
    """
    return is_of_ratings(read_frame(path))


def understand_ratings(
    path: Path | str, scale: tuple[float, float] | None = None
) -> tuple[RatingTable | ComparisonTable, list[str]]:
    """Read ratings from a table of any format that votes have, and say how it was understood.

    With the columns `participant, dataset, condition, rating` they are of single stimuli; `protocol` (`acr` by default)
    and `reference` (is the item its dataset's reference?) are optional. Usual other names of these columns are known,
    and wide tables (`one_rating_a_row`). With `participant, dataset, item_a, item_b, rating` they compare two;
    `first_shown` is the name of the item shown first, `item_a` by default. A study's table of votes is read as it was
    exported: practice, exclusions and checks are left out, and what ACR, ACR-HR and DCR rate is `item_b`.

    Parameters
    ----------
    path : a file whose name ends as one of votes may
    scale : its ends; from 1 to 5 by default, for comparisons from -3 to 3

    Returns
    -------
    the table, and the sentences

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    path = Path(path)
    frame = read_frame(path)
    try:
        long, note = one_rating_a_row(frame, scale or SCALE)
        columns = {str(name): texts(long[name].to_list()) for name in long.columns}
        if "protocol" in columns:
            columns["protocol"] = np.array([value.lower() for value in columns["protocol"]], object)
        counted = _exported(columns)
        table = _comparisons(counted, scale) if "item_a" in counted else _ratings(counted, scale)
    except ValueError as error:  # VotesError is one, as is what the table itself raises
        raise VotesError(f"{path}: {error}") from error
    parts = [
        frame.attrs.get("understood", ""),
        f"{len(table)} ratings by {len(table.participants)} participants of {len(table.items)} items",
        note,
    ]
    return table, [f"{path.name}: {'; '.join(filter(None, parts))}"]


def _exported(columns: Columns) -> Columns:
    """Return the counted rows of a study's table of votes under the names of a table of ratings; others unchanged."""
    if not {"protocol", "role", "item_b"} <= set(columns):
        return columns
    is_left_out = _flags(columns, "practice") | _flags(columns, "excluded") | ~np.isin(columns["role"], ("", "main"))
    kept = {name: values[~is_left_out] for name, values in columns.items()}
    if (kept["protocol"] == "ccr").all():
        return kept
    return {name: values for name, values in kept.items() if name != "item_a"} | {"condition": kept["item_b"]}


def _ratings(columns: Columns, scale: tuple[float, float] | None) -> RatingTable:
    if "dataset" not in columns and len(columns.get("rating", ())):
        columns = {**columns, "dataset": np.full(len(columns["rating"]), "", object)}
    _check(columns, REQUIRED)
    low, high = scale or SCALE
    rating = _scaled(columns, low, high)
    protocol = _protocol(columns)
    is_marked = _flags(columns, "reference")
    participants, person = _names(columns["participant"])
    items, item = _names(list(zip(columns["dataset"], columns["condition"], strict=True)))
    is_reference = np.zeros(len(items), bool)
    is_reference[item[is_marked]] = True
    refuse(
        is_reference[item] & ~is_marked,
        lambda row: f"{items[item[row]][1]} of {items[item[row]][0]} is not the reference here, but in another row",
    )
    if protocol == "acr-hr" and not is_reference.any():
        raise VotesError("has the protocol acr-hr, but no row whose column reference is true")
    return RatingTable(participants, items, person, item, rating, is_reference, protocol, low, high)


def _comparisons(columns: Columns, scale: tuple[float, float] | None) -> ComparisonTable:
    _check(columns, COMPARED)
    low, high = scale or COMPARISON_SCALE
    if low != -high:
        raise VotesError(f"the scale of a comparison goes from {low:g} to {high:g}, expected the same on both sides")
    protocol = columns.get("protocol", np.array([], object))
    refuse((protocol != "") & (protocol != "ccr"), lambda row: f"protocol is {protocol[row]!r}, expected ccr")
    rating = _scaled(columns, low, high)
    a, b = columns["item_a"], columns["item_b"]
    first = columns.get("first_shown", np.full(len(a), "", object))
    refuse(
        (first != "") & (first != a) & (first != b),
        lambda row: f"first_shown is {first[row]!r}, expected {a[row]!r} or {b[row]!r} or nothing",
    )
    refuse(a == b, lambda row: f"the item {a[row]!r} is compared with itself")
    participants, person = _names(columns["participant"])
    dataset = columns["dataset"]
    items, both = _names([*zip(dataset, a, strict=True), *zip(dataset, b, strict=True)])
    item_a, item_b = both.reshape(2, -1)
    return ComparisonTable(participants, items, person, item_a, item_b, rating, first != b, high)


def _check(columns: Columns, required: tuple[str, ...]) -> None:
    """Raise for a missing column, an empty table or an empty cell."""
    missing = [name for name in required if name not in columns]
    if missing:
        raise VotesError(
            f"lacks {'the column' if len(missing) == 1 else 'the columns'} {', '.join(missing)}; "
            f"found {', '.join(columns)}"
        )
    if not len(columns["rating"]):
        raise VotesError("has no row, expected at least one rating")
    for name in required:
        values = columns[name]
        if name != "dataset" or values.any():  # a table may have no datasets at all
            refuse(values == "", f"{name} is empty")


def _scaled(columns: Columns, low: float, high: float) -> NDArray[np.float64]:
    """Return the ratings as numbers between the ends of the scale."""
    values = columns["rating"]
    rating = numbers(values, "rating", may_be_negative=True)
    refuse(
        (rating < low) | (rating > high),
        lambda row: f"rating is {values[row]}, expected {low:g} to {high:g} (--scale names another scale)",
    )
    return rating


def _protocol(columns: Columns) -> str:
    values = columns.get("protocol", np.array([""], object))
    values = np.where(values == "", "acr", values)
    refuse(
        ~np.isin(values.astype(str), list(PROTOCOLS)),
        lambda row: f"protocol is {values[row]!r}, expected {', '.join(PROTOCOLS)} (or ccr, with item_a and item_b)",
    )
    refuse(
        values != values[0],
        lambda row: f"protocol is {values[row]}, in the rows above {values[0]}: analyse them in separate files",
    )
    return str(values[0])


def _flags(columns: Columns, name: str) -> NDArray[np.bool_]:
    """Return a column of true and false; all false without the column."""
    return flags(columns.get(name, np.full(len(columns["rating"]), "", object)), name)


def _names(values: Iterable[Any]) -> tuple[tuple[Any, ...], NDArray[np.intp]]:
    """Return the different values in order of appearance, and each value's index (N,)."""
    known: dict[Any, int] = {}
    index = numbered_names(values, known)
    return tuple(known), index
