"""Read large CSV files of votes in one pass, as numbers of names; whatever is unusual is left to the strict reader."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.tabular import DISARMED, FLAGS, LARGEST_COUNT
from app.analysis.reading.votes_table import IDENTICAL, MAIN, ROLE_CODES, VotesTable, votes_from_indices

QUICK_FROM = 4_000_000  # bytes; below, the strict reader takes no more than a second
TEXTS = (
    *("participant", "dataset", "item_a", "item_b", "choice", "first_shown", "both_seen"),
    *("practice", "excluded", "reason", "role"),
)
NUMBERS = ("response_ms", "press_to_picture_ms", "count")
UNKNOWN = -9  # of a word that means nothing here
BLOCK = 16_000_000  # bytes read at once

Codes = tuple[NDArray[np.int32], list[str]]


def quick_votes(path: Path, columns: Mapping[str, str], choices: Mapping[str, int]) -> VotesTable | None:
    """Read a clean CSV file of votes; None if anything in it needs the strict reader, which says what.

    Parameters
    ----------
    path : the file
    columns : our name of a column -> the name in the file, for all that are there
    choices : word in the file -> choice, as in `VotesTable`

    Returns
    -------
    VotesTable, the same as from the strict reader
    """
    try:
        texts, numbers = _read(path, columns)
    except (ValueError, OSError, KeyError):
        return None
    (participant, participants), (dataset, datasets) = texts["participant"], texts["dataset"]
    item_a, item_b, items = _items(texts["item_a"], texts["item_b"])
    words = {"choice": choices, "role": ROLE_CODES}
    coded = {name: _meaning(texts[name], meanings) for name, meanings in words.items() if name in texts}
    for name, empty in (("practice", 0), ("excluded", 0), ("both_seen", -1)):
        if name in texts:
            coded[name] = _meaning(_lower(texts[name]), FLAGS | {"": empty})
    if "first_shown" in texts:
        coded["first_shown"] = _first_shown(texts["first_shown"], item_a, item_b, items)
    is_odd = [
        *(column.min(initial=0) == UNKNOWN for column in coded.values()),
        any("" in names and len(names) > 1 for names in (participants, datasets)),
        "" in items,
        any(re.match(DISARMED, name) for name in (*participants, *datasets, *items)),
        bool(np.any((item_a == item_b) & (coded.get("role", MAIN) != IDENTICAL))),
        *(_is_odd(values, whole=name == "count") for name, values in numbers.items()),
    ]
    if any(is_odd) or not len(item_a):
        return None
    kept: dict[str, Any] = coded | {name: values for name, values in numbers.items() if name != "count"}
    if "count" in numbers:
        kept["count"] = numbers["count"].astype(np.int64)
    if "reason" in texts:
        codes, reasons = texts["reason"]
        kept["reason"] = np.array(reasons, object)[codes]
    kept |= {name: kept[name].astype(bool) for name in ("practice", "excluded") if name in kept}
    names = participants, datasets, items
    votes = votes_from_indices(participant, dataset, item_a, item_b, kept.pop("choice"), names=names)
    return replace(votes, **kept)


def _read(path: Path, columns: Mapping[str, str]) -> tuple[dict[str, Codes], dict[str, NDArray[np.float64]]]:
    """Return the columns of texts as codes and names, and those of numbers, NaN where empty."""
    import pyarrow
    from pyarrow import csv

    text = pyarrow.dictionary(pyarrow.int32(), pyarrow.string())
    there = {name: given for name, given in columns.items() if name in (*TEXTS, *NUMBERS)}
    options = csv.ConvertOptions(
        include_columns=list(there.values()),
        column_types={given: pyarrow.float64() if name in NUMBERS else text for name, given in there.items()},
        null_values=[""],
        strings_can_be_null=False,
    )
    reader = csv.open_csv(path, read_options=csv.ReadOptions(block_size=BLOCK), convert_options=options)
    parts: dict[str, list[NDArray[Any]]] = {name: [] for name in there}
    known: dict[str, dict[str, int]] = {name: {} for name in there}
    for batch in reader:
        for name, given in there.items():
            column = batch.column(given)
            if name in NUMBERS:
                parts[name].append(column.to_numpy(zero_copy_only=False))
                continue
            words = [word.strip() for word in column.dictionary.to_pylist()]
            index = np.array([known[name].setdefault(word, len(known[name])) for word in words], np.int32)
            parts[name].append(index[column.indices.to_numpy()])
    joined = {name: np.concatenate(parts.pop(name)) for name in there}
    texts = {name: (codes, list(known[name])) for name, codes in joined.items() if name not in NUMBERS}
    return texts, {name: values for name, values in joined.items() if name in NUMBERS}


def _items(a: Codes, b: Codes) -> tuple[NDArray[np.int32], NDArray[np.int32], tuple[str, ...]]:
    """Return both columns of items as codes into one list: first all of `item_a`, in the order of appearance."""
    place = {name: index for index, name in enumerate(a[1])}
    index = np.array([place.setdefault(name, len(place)) for name in b[1]], np.int32)
    return a[0], index[b[0]], tuple(place)


def _lower(column: Codes) -> Codes:
    return column[0], [text.lower() for text in column[1]]


def _meaning(column: Codes, words: Mapping[str, int]) -> NDArray[np.int8]:
    """Return what each text means, int8 (N,), UNKNOWN where nothing."""
    codes, texts = column
    return np.array([words.get(text, UNKNOWN) for text in texts], np.int8)[codes]


def _first_shown(
    column: Codes, item_a: NDArray[np.int32], item_b: NDArray[np.int32], items: Sequence[str]
) -> NDArray[np.int8]:
    """Return 0 where `item_a` was shown first, 1 where `item_b`, -1 where the cell is empty, else UNKNOWN."""
    codes, texts = column
    place = {name: index for index, name in enumerate(items)} | {"": -1}
    shown = np.array([place.get(text, -2) for text in texts], np.int32)[codes]
    return np.select([shown == -1, shown == item_a, shown == item_b], [-1, 0, 1], default=UNKNOWN).astype(np.int8)


def _is_odd(values: NDArray[np.float64], *, whole: bool) -> bool:
    """Does a column of numbers hold what a votes table does not?"""
    if whole:
        return bool(np.any(~((values >= 0) & (values <= LARGEST_COUNT) & (values == np.floor(values)))))
    return bool(np.any(np.isinf(values) | (values < 0)))
