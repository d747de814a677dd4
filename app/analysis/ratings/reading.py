"""Read ratings by the description of a table: the second half of reading, for ratings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.analysis.ratings.table import PROTOCOLS, ComparisonTable, RatingTable, item_name
from app.analysis.reading.cells import Column, Problems, number_or_nan, numbered_names, same, shown
from app.analysis.reading.description import COMPARISONS, Description, Told
from app.analysis.reading.layouts import LongTable, flags, rows_of
from app.analysis.reading.phrases import counted, listed
from app.analysis.reading.sources import Source, fingerprint, in_lists, look_alikes, recognise_file
from app.analysis.reading.votes_table import ROLE_CODES, VotesError
from app.analysis.reading.words import stars_in

SCALE = (1.0, 5.0)  # of ITU-T P.910, five-level
COMPARISON_SCALE = (-3.0, 3.0)  # of ITU-T P.910, seven-level
FILLED = {False: ("participant", "condition", "rating"), True: ("participant", "item_a", "item_b", "rating")}
WIDE = 20  # points of a scale whose lowest tenth may be another scale
FEWEST_LOW = 3  # ratings of somebody who may have used it
MOST_GRADES = 12  # different ratings that are counted one by one


def understand_ratings(
    path: Path | str | Source, scale: tuple[float, float] | None = None, told: Told | None = None
) -> tuple[RatingTable | ComparisonTable, list[str]]:
    """Read ratings from a table of any format that votes have, and say how it was understood.

    Rows of practice, of exclusions and of a study's own checks are left out, and counted in a sentence.

    Parameters
    ----------
    path : a file whose name ends as one of votes may, or one already recognised
    scale : its ends; from 1 to 5 by default, for comparisons from -3 to 3
    told : what the user said of its columns and cells

    Returns
    -------
    the table, and the sentences; those that begin with `WARNING` are warnings

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    source = path if isinstance(path, Source) else recognise_file(path, told)
    if source.holds_votes:
        raise VotesError(f"{source.path}: holds votes, expected ratings: participant, condition and rating")
    try:
        rows, left_out = _counted(rows_of(source.table, source.description))
        read = _comparisons if source.description.holds == COMPARISONS else _ratings
        table = read(rows, source.description, scale)
    except ValueError as error:  # VotesError is one, as is what the table itself raises
        raise VotesError(f"{source.path}: {error}") from error
    warnings = []
    if isinstance(table, ComparisonTable) and not source.description.words and table.rating.min() > 0:
        warnings.append(
            "no grade is 0 or below: if the scale begins at 1, write its middle as 0 and the first item's side below it"
        )
    if isinstance(table, RatingTable):
        warnings += _other_scales(table)
    names = {"participants": table.participants} | {
        what: tuple(dict.fromkeys(names[place] for names in table.items))
        for place, what in enumerate(("datasets", "conditions"))
    }
    return table, [_sentence(source, table, left_out), *look_alikes(names), *source.warned(warnings)]


def _other_scales(table: RatingTable) -> list[str]:
    """Warn of people who stayed in the lowest tenth of a wide scale where others did not: as from 1 to 5 of 100."""
    lowest_tenth = table.low + (table.high - table.low) / 10
    highest = np.full(len(table.participants), -np.inf)
    np.maximum.at(highest, table.person, table.rating)
    is_low = (highest <= lowest_tenth) & (np.bincount(table.person, minlength=len(highest)) >= FEWEST_LOW)
    if table.high - table.low < WIDE or not is_low.any() or is_low.all():
        return []
    names = [name for name, low in zip(table.participants, is_low, strict=True) if low]
    return [f"{listed(names)} never rated above {lowest_tenth:g} of {table.high:g}: on another scale than the others?"]


def _sentence(source: Source, table: RatingTable | ComparisonTable, left_out: str) -> str:
    """Say how a file was understood: the three lists, the ratings, and a fingerprint that changes with any of them."""
    datasets = list(dict.fromkeys(dataset for dataset, _ in table.items if dataset))
    conditions = list(dict.fromkeys(condition for _, condition in table.items))
    parts = [
        source.table.how,
        f"{counted(len(table), 'rating')} by {counted(len(table.participants), 'participant')} "
        f"of {counted(len(table.items), 'item')}",
        left_out,
        *source.table.notes,
        *source.description.notes,
        *(source.description.used if source.description.layout == "rows" else ()),
        "" if datasets else "no dataset is named: all ratings are on one dataset",
    ]
    values, counts = np.unique(table.rating, return_counts=True)
    tally = ", ".join(f"{value:g} {n}x" for value, n in zip(values, counts, strict=True))
    if len(values) > MOST_GRADES:
        tally = f"from {values[0]:g} to {values[-1]:g}, mean {table.rating.mean():.6g}"
    names = [(table.participants, "participant"), (conditions, "condition"), (datasets, "dataset")]
    return in_lists(source, parts, names, f"ratings: {tally}; fingerprint {_fingerprint(table)}")


def _fingerprint(table: RatingTable | ComparisonTable) -> str:
    if isinstance(table, ComparisonTable):
        columns = [table.person, table.item_a, table.item_b, table.rating, table.a_first]
    else:
        columns = [table.person, table.item, table.rating, table.is_reference]
    return fingerprint([table.participants, table.items, getattr(table, "protocol", "ccr")], columns)


def _counted(rows: LongTable) -> tuple[LongTable, str]:
    """Return the rows that count, and how many do not; raise if none is left."""
    if not len(rows):
        raise VotesError("has no row, expected at least one rating")
    problems = Problems(rows.row)
    is_practice, is_excluded = (flags(rows, role, problems) for role in ("practice", "excluded"))
    problems.check()
    is_check = np.zeros(len(rows), bool)
    if "role" in rows.columns:
        is_check = rows.columns["role"].meaning(lambda word: ROLE_CODES.get(word, 0) != 0, bool)
    counts = {"practice": is_practice, "excluded": is_excluded, "checks": is_check}
    left_out = ", ".join(f"{int(rows_.sum())} {what}" for what, rows_ in counts.items() if rows_.any())
    kept = ~(is_practice | is_excluded | is_check)
    if not kept.any():
        raise VotesError(f"none of {counted(len(rows), 'rating')} counts: {left_out}; expected at least one other")
    return (rows, "") if kept.all() else (rows.where(kept), f"left out: {left_out}")


def _ratings(rows: LongTable, description: Description, scale: tuple[float, float] | None) -> RatingTable:
    problems = Problems(rows.row)
    _check_filled(rows, FILLED[False], problems)
    low, high = scale or SCALE
    rating = _scaled(rows, description, (low, high), problems)
    protocol = _protocol(rows, problems)
    is_marked = flags(rows, "reference", problems)
    problems.check()
    participants, person = _names(rows.columns["participant"].texts)
    items, item = _names(list(zip(_datasets(rows).texts, rows.columns["condition"].texts, strict=True)))
    is_reference = np.zeros(len(items), bool)
    is_reference[item[is_marked]] = True
    problems.add(
        is_reference[item] & ~is_marked,
        lambda row: f"{item_name(*items[item[row]])} is not the reference here, but in another row",
    )
    problems.check()
    if protocol == "acr-hr" and not is_reference.any():
        raise VotesError("has the protocol acr-hr, but no row whose column reference is true")
    return RatingTable(participants, items, person, item, rating, is_reference, protocol, low, high)


def _comparisons(rows: LongTable, description: Description, scale: tuple[float, float] | None) -> ComparisonTable:
    problems = Problems(rows.row)
    _check_filled(rows, FILLED[True], problems)
    low, high = scale or COMPARISON_SCALE
    if low != -high:
        raise VotesError(f"the scale of a comparison goes from {low:g} to {high:g}, expected the same on both sides")
    protocol = _lower(rows, "protocol")
    problems.add((protocol != "") & (protocol != "ccr"), lambda row: f"protocol is {protocol[row]!r}, expected ccr")
    rating = _scaled(rows, description, (low, high), problems)
    a, b = (rows.columns[role].texts for role in ("item_a", "item_b"))
    first = rows.columns.get("first_shown", same("", len(rows))).texts
    problems.add(
        (first != "") & (first != a) & (first != b),
        lambda row: f"first_shown is {first[row]!r}, expected {a[row]!r} or {b[row]!r} or nothing",
    )
    problems.add((a == b) & (a != ""), lambda row: f"the item {a[row]!r} is compared with itself")
    problems.check()
    participants, person = _names(rows.columns["participant"].texts)
    dataset = _datasets(rows).texts
    items, both = _names([*zip(dataset, a, strict=True), *zip(dataset, b, strict=True)])
    item_a, item_b = both.reshape(2, -1)
    return ComparisonTable(
        participants, items, person, item_a, item_b, rating, first != b, high, has_order=bool((first != "").all())
    )


def _datasets(rows: LongTable) -> Column:
    return rows.columns.get("dataset", same("", len(rows)))


def _check_filled(rows: LongTable, roles: Sequence[str], problems: Problems) -> None:
    """Note a missing column or an empty cell."""
    missing = [role for role in roles if role not in rows.columns]
    if missing:
        columns = "the column" if len(missing) == 1 else "the columns"
        raise VotesError(f"lacks {columns} {', '.join(missing)}; found {', '.join(rows.columns)}")
    dataset = rows.columns.get("dataset")
    for role in (*roles, *(["dataset"] if dataset is not None and dataset.filled else [])):
        way = "; leave out rows without a rating" if role == "rating" else ""
        problems.add(rows.columns[role].meaning(lambda word: not word, bool), f"{role} is empty{way}")


def _scaled(
    rows: LongTable, description: Description, scale: tuple[float, float], problems: Problems
) -> NDArray[np.float64]:
    """Return the ratings as numbers between the ends of the scale; words of a comparison as its grades."""
    column = rows.columns["rating"]
    rating = column.meaning(lambda word: description.words.get(word.lower(), number_or_nan(word)), np.float64)
    low, high = scale

    def cell(row: int) -> str:
        return f"{rows.cell('rating', row)} is"

    def word(row: int) -> str:
        return column.text(row)

    is_filled = column.meaning(bool, bool)
    problems.add(
        np.isnan(rating) & is_filled,
        lambda row: f"{cell(row)} {shown(word(row))}, expected a number{_in_numbers(word(row))}",
    )
    hint = "another scale: --scale LOW:HIGH; a code for no answer is to be an empty cell"
    if description.holds == COMPARISONS:
        hint = "another scale: --scale -HIGH:HIGH; 0 is to be its middle"
    elif rows.origin is not None:
        hint += "; leave columns out that hold no ratings"
    problems.add(
        (rating < low) | (rating > high), lambda row: f"{cell(row)} {word(row)}, expected {low:g} to {high:g} ({hint})"
    )
    return np.asarray(rating, np.float64)


def _in_numbers(word: str) -> str:
    """Say what to write instead of stars of which it is not known what they count to."""
    full, n = stars_in(word) or (0, 0)
    return f": write {full}, of --scale 0:{n}" if full < n else ""


def _lower(rows: LongTable, role: str) -> NDArray[np.object_]:
    return np.array([word.lower() for word in rows.columns.get(role, same("", len(rows))).texts], object)


def _protocol(rows: LongTable, problems: Problems) -> str:
    values = _lower(rows, "protocol")
    values = np.where(values == "", "acr", values)
    is_known = np.isin(values.astype(str), list(PROTOCOLS))
    problems.add(
        ~is_known,
        lambda row: f"protocol is {values[row]!r}, expected {', '.join(PROTOCOLS)} (or ccr, with item_a and item_b)",
    )
    problems.add(
        is_known & (values != values[0]),
        lambda row: f"protocol is {values[row]}, in the rows above {values[0]}: analyse them in separate files",
    )
    return str(values[0])


def _names(values: Iterable[Any]) -> tuple[tuple[Any, ...], NDArray[np.intp]]:
    """Return the different values in order of appearance, and each value's index (N,)."""
    known: dict[Any, int] = {}
    index = numbered_names(values, known)
    return tuple(known), index
