"""Recognise the columns and words of votes tables that other tools write."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from app.analysis.reading.tabular import named, refuse, shown
from app.analysis.reading.votes_table import CHOICES, NONE, VotesError

REQUIRED = ("participant", "dataset", "item_a", "item_b", "choice")
OPTIONAL = (
    *("first_shown", "trial", "response_ms", "practice", "excluded", "reason", "count", "role"),
    *("both_seen", "press_to_picture_ms"),
)
MAY_BE_UNKNOWN = ("participant", "dataset")  # a table without them is of unknown people, or of a single dataset
JOIN = "+"  # between columns that name an item together


@dataclass(frozen=True)
class Layout:
    """A table's names of our columns and choices: `columns["participant"] == "judge"`.

    Parameters
    ----------
    columns : our name -> theirs, where it differs
    choices : our word -> theirs, where it differs
    notes : names and words that were recognised, not given
    """

    columns: Mapping[str, str]
    choices: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def choice_codes(self) -> dict[str, int]:
        """Their word -> choice, as in `VotesTable`."""
        return {self.choices.get(choice, choice): code for code, choice in enumerate(CHOICES)}


# The format of pwcmp, https://github.com/mantiuk/pwcmp
PWCMP = Layout(
    {
        "participant": "observer",
        "dataset": "scene",
        "item_a": "condition_A",
        "item_b": "condition_B",
        "choice": "is_A_selected",
    },
    {"a": "1", "b": "0"},
)
# Names in lower case, without spaces, points, hyphens and underscores.
SYNONYMS = {
    "participant": (
        *("participantid", "judge", "judgeid", "observer", "observerid", "subject", "subjectid", "user", "userid"),
        *("worker", "workerid", "rater", "raterid", "annotator", "respondent", "voter", "pid", "prolificpid"),
    ),
    "dataset": ("scene", "content", "sequence", "src", "datasetid", "sceneid"),
    "item_a": (
        *("itema", "conditiona", "stimulusa", "methoda", "modela", "optiona", "systema", "left", "leftitem"),
        *("item1", "condition1", "stimulus1", "method1", "model1", "option1", "a"),
    ),
    "item_b": (
        *("itemb", "conditionb", "stimulusb", "methodb", "modelb", "optionb", "systemb", "right", "rightitem"),
        *("item2", "condition2", "stimulus2", "method2", "model2", "option2", "b"),
    ),
    "choice": ("preferred", "preference", "winner", "selected", "vote", "response", "answer", "choose", "chosen"),
}
TIES = dict.fromkeys(("none", "tie", "tied", "draw", "equal", "same", "both", "neither", "no preference"), 2)
SIDES = (("a", "b"), ("left", "right"), ("first", "second"), ("1", "2"))  # one table uses one of these


def recognise(
    names: Sequence[str], columns: Mapping[str, str] | None = None, choices: Mapping[str, str] | None = None
) -> Layout:
    """Find which of a table's columns is which of ours: as given, else by our own names, else by known others.

    Parameters
    ----------
    names : of the table's columns
    columns, choices : our name -> theirs, as the user gives them

    Raises
    ------
    VotesError
        If a given name is no column or choice of ours.
    """
    columns, choices = columns or {}, choices or {}
    unknown = [*set(columns).difference(REQUIRED + OPTIONAL), *set(choices).difference(CHOICES)]
    if unknown:
        known = ", ".join(REQUIRED + OPTIONAL + CHOICES)
        raise VotesError(f"{unknown[0]!r} is no column or choice of a votes table; known are {known}")
    if not columns and all(name in names for name in PWCMP.columns.values()):
        return Layout(PWCMP.columns, choices or PWCMP.choices, ("the layout of pwcmp",))
    mapped, notes = dict(columns), []
    if not columns and {"winner", "loser"} <= set(names) and "choice" not in names:
        mapped |= {"item_a": "winner", "item_b": "loser"}
        notes.append("item_a is the column winner, item_b the column loser, and item_a is always preferred")
    taken = {*mapped.values(), *(name for name in REQUIRED if name in names)}
    for ours, others in SYNONYMS.items():
        if ours in mapped or ours in names or ("loser" in taken and ours == "choice"):
            continue
        candidates = [name for name in names if plain(name) in (plain(ours), *others) and name not in taken]
        if candidates:
            mapped[ours] = candidates[0]
            taken.add(candidates[0])
            notes.append(f"{ours} is the column {candidates[0]}")
    return Layout(mapped, choices, tuple(notes))


def plain(name: str) -> str:
    """Return a column's name as `SYNONYMS` spell it."""
    return re.sub(r"[\s._-]", "", name).lower()


def our_columns(frame: pd.DataFrame, layout: Layout) -> pd.DataFrame:
    """Return the table's columns under our names; columns joined by + in the layout become one text.

    Raises
    ------
    VotesError
        Naming the columns that are missing.
    """
    ours: dict[str, pd.Series] = {}
    for name in REQUIRED + OPTIONAL:
        theirs = layout.columns.get(name, name)
        parts = [part.strip() for part in theirs.split(JOIN)]
        if theirs in frame.columns:
            ours[name] = frame[theirs]
        elif len(parts) > 1 and all(part in frame.columns for part in parts):
            ours[name] = _joined(frame, parts)
    if "loser" in layout.columns.values() and "choice" not in ours:
        ours["choice"] = pd.Series(["a"] * len(frame), index=frame.index, dtype=object)
    _check(frame, ours, layout)
    for name in MAY_BE_UNKNOWN:
        if name not in ours:
            ours[name] = pd.Series([""] * len(frame), index=frame.index, dtype=object)
    return pd.DataFrame(ours)


def unused_columns(frame: pd.DataFrame, layout: Layout) -> list[str]:
    """Name the table's columns that no vote is made of."""
    theirs = [layout.columns.get(name, name) for name in REQUIRED + OPTIONAL]
    used = {*theirs, *(part.strip() for name in theirs for part in name.split(JOIN))}
    return [name for name in map(str, frame.columns) if name not in used]


def _joined(frame: pd.DataFrame, parts: Sequence[str]) -> pd.Series:
    """Return the texts of several columns with spaces between: a type and its level."""
    columns = (frame[part].fillna("").astype(str).str.strip() for part in parts)
    return pd.Series([" ".join(filter(None, cells)) for cells in zip(*columns, strict=True)], frame.index, dtype=object)


def _check(frame: pd.DataFrame, ours: Mapping[str, pd.Series], layout: Layout) -> None:
    given = layout.columns
    missing = [given.get(n, n) for n in REQUIRED if n not in ours and (n in given or n not in MAY_BE_UNKNOWN)]
    missing += [theirs for name, theirs in given.items() if name not in ours and theirs not in missing]
    if missing:
        columns = "the column" if len(missing) == 1 else "the columns"
        raise VotesError(
            f"lacks {columns} {', '.join(missing)}; found {named(list(frame.columns)) or 'none'}. "
            "Map other names, e.g. --columns participant=judge, or item_a=type+level for an item in two columns; "
            "ratings have the columns participant, condition and rating, or one for each condition"
        )


def choice_codes(
    values: NDArray[np.object_], items: tuple[NDArray[np.object_], NDArray[np.object_]], layout: Layout
) -> tuple[NDArray[np.int8], str]:
    """Return each vote's choice, and what its words mean if that was not given.

    Parameters
    ----------
    values : object (N,), the texts of the column choice
    items : two object (N,), the texts of item_a and item_b
    layout : the words as given

    Returns
    -------
    codes : int8 (N,), 0 for item_a, 1 for item_b, 2 for none
    note : empty for our own words, unless they name items, too

    Raises
    ------
    VotesError
        Naming the row and the word.
    """
    known = layout.choice_codes
    codes = _by_word(values, known)
    if not layout.choices and (codes >= 0).all() and _may_name_items(values, items, codes):
        return codes, "choice a is item_a and b is item_b, although items are named a and b, too"
    if (codes < 0).any() and set(layout.choices) <= {"none"}:
        lower = np.array([str(value).lower() for value in values], object)
        ties = TIES | {word.lower(): 2 for word in layout.choices.values()}
        by_name = np.where(values == items[0], 0, np.where(values == items[1], 1, _by_word(lower, ties)))
        if (by_name >= 0).all():
            return by_name.astype(np.int8), "choice is the name of the preferred item"
        columns = tuple(layout.columns.get(name, name).lower() for name in ("item_a", "item_b"))
        for first, second in (*SIDES, columns):
            guess = _by_word(lower, ties | {first: 0, second: 1})
            if (guess >= 0).all():
                return guess, f"choice is {first} for item_a and {second} for item_b{_ties(lower)}"
    refuse(
        codes < 0,
        lambda row: (
            f"choice is {shown(values[row])}, expected {', '.join(known)}, or the name of one of the two items "
            "(other words: --choices a=…,b=…,none=…)"
        ),
    )
    return codes, ""


def _may_name_items(
    values: NDArray[np.object_], items: tuple[NDArray[np.object_], NDArray[np.object_]], codes: NDArray[np.int8]
) -> bool:
    """Could each choice of a side be an item's name as well, and some then mean the other side?"""
    is_first, is_second, is_side = values == items[0], values == items[1], codes != NONE
    differs = np.where(is_first, 0, 1) != codes
    return bool(((is_first | is_second) | ~is_side).all() and (differs & is_side).any())


def _by_word(values: NDArray[np.object_], words: Mapping[str, int]) -> NDArray[np.int8]:
    codes, distinct = pd.factorize(values)
    return np.array([words.get(str(word), -1) for word in distinct], np.int8)[codes]


def _ties(values: NDArray[np.object_]) -> str:
    used = sorted({str(value) for value in values} & set(TIES))
    return f", {' or '.join(used)} for none" if used else ""
