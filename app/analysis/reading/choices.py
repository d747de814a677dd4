"""Understand the words of choices: sides, names of items, numbers, strengths. Readings that both fit are asked."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.analysis.reading.cells import Column, is_numeric, number_or_nan, numbered_names, shown, values_of
from app.analysis.reading.description import BY_ITEM, QuestionError, Reading, Told
from app.analysis.reading.votes_table import CHOICE_CODES, CHOICES, NONE, A, B, VotesError
from app.analysis.reading.words import ENDS, SIDES, STRENGTH, STRENGTHS, TIES, TRUE_FALSE, ends_of, words_of

Codes = NDArray[np.int8]
UNKNOWN = -1
HIGHEST_GRADE = 3  # of ITU-T P.910's comparison categories
# Words around a side that say nothing: "the left image is better".
FILLERS = frozenset(
    words_of(
        "the is was better best preferred prefer prefers wins won one option item image video clip film "
        "stimulus model method system answer choice more i it picture version sample side arrow key condition "
        "looks sounds button"
    )
)
# Numbers that may be choices in several ways; each way is our word -> theirs.
NUMBER_CODES: dict[frozenset[str], tuple[dict[str, str], ...]] = {
    frozenset({"0", "1"}): ({"a": "1", "b": "0"}, {"a": "0", "b": "1"}),
    frozenset({"true", "false"}): ({"a": "true", "b": "false"}, {"a": "false", "b": "true"}),
    frozenset({"-1", "1"}): ({"a": "-1", "b": "1"}, {"a": "1", "b": "-1"}),
    frozenset({"-1", "0", "1"}): ({"a": "-1", "none": "0", "b": "1"}, {"a": "1", "none": "0", "b": "-1"}),
    frozenset({"0", "1", "2"}): (
        {"none": "0", "a": "1", "b": "2"},
        {"a": "0", "b": "1", "none": "2"},
        {"a": "0", "none": "1", "b": "2"},
    ),
    frozenset({"0", "0.5", "1"}): ({"a": "1", "none": "0.5", "b": "0"}, {"a": "0", "none": "0.5", "b": "1"}),
    frozenset({"1", "2", "3"}): ({"a": "1", "b": "2", "none": "3"}, {"a": "1", "none": "2", "b": "3"}),
}


@dataclass(frozen=True)
class Meaning:
    """What the cells of a choice mean: `words` in lower case -> choice, or the names of the items; and in words."""

    words: Mapping[str, int]
    by_item: bool = False
    note: str = ""
    expected: str = ""


@dataclass(frozen=True)
class Asked:
    """A column of choices with its two items, each (N,), and what is known about them.

    Parameters
    ----------
    choice, item_a, item_b : the columns
    names : their names in the table
    is_own : the table has our own format, whose words are documented
    is_told : the user named the column of choices
    strengths_as : `ccr`, `votes`, or empty where that is not told
    """

    choice: Column
    item_a: Column
    item_b: Column
    names: tuple[str, str] = ("item_a", "item_b")
    is_own: bool = False
    is_told: bool = False
    strengths_as: str = ""


def understand_choices(asked: Asked, told: Mapping[str, str]) -> Meaning:
    """Find what the words of choices mean; rows that are alike are looked at once."""
    columns = asked.choice, asked.item_a, asked.item_b
    sizes = [len(column.words) for column in columns]
    if math.prod(sizes) < len(asked.choice):
        is_there = np.zeros(math.prod(sizes), bool)
        is_there[np.ravel_multi_index([column.codes for column in columns], sizes)] = True
        few = np.unravel_index(np.flatnonzero(is_there), sizes)
        choice, item_a, item_b = (
            Column(codes.astype(np.int32), c.words) for codes, c in zip(few, columns, strict=True)
        )
        asked = replace(asked, choice=choice, item_a=item_a, item_b=item_b)
    return _understand(asked, told)


def _understand(asked: Asked, told: Mapping[str, str]) -> Meaning:
    """Find what the words of choices mean.

    Parameters
    ----------
    asked : the cells
    told : `a`, `b`, `none` -> word, or `by` -> `item` or `side`, as told

    Raises
    ------
    QuestionError
        If two readings fit.
    """
    by = told.get("by", "")
    if by not in ("", BY_ITEM, "side"):
        raise VotesError(f"by={by} is not known, expected by=item (a cell names the preferred item) or by=side")
    given = {word: told[word] for word in CHOICES if word in told}
    ties = TIES | ({given["none"].lower(): NONE} if "none" in given else {})
    names = [given.get(word, word) for word in CHOICES]
    place = {_as_code(name): code for code, name in enumerate(names)}
    words = {word.lower(): place[_as_code(word)] for word in (*names, *asked.choice.filled) if _as_code(word) in place}
    theirs = Meaning(words, expected=", ".join(names))
    if {"a", "b"} & set(given):
        return theirs
    readings = _readings(asked, ties)
    if by:
        readings = [(reading, codes) for reading, codes in readings if reading.by_item == (by == BY_ITEM)]
    empty = asked.choice.meaning(lambda word: not word, bool)
    whole = [(reading, codes) for reading, codes in readings if ((codes != UNKNOWN) | empty).all()]
    if asked.is_own and not by and whole and whole[0][0].expected == ", ".join(CHOICES):
        return _own(asked, whole[0])
    if not whole and not by:
        _ask_about_numbers(asked, given)
    if len(whole) > 1 and any((codes != whole[0][1]).any() for _, codes in whole[1:]):
        raise _question(asked, whole)
    if whole:
        _ask_if_items_are_called_like_sides(asked, whole, by=by)
        return whole[0][0]
    best = max(readings, key=lambda known: int((known[1] != UNKNOWN).sum()), default=None)
    if best is None or not ((best[1] != UNKNOWN) & (best[1] != NONE)).any():
        also = "or the name of one of the two items (other words: --choices a=…,b=…,none=…)"
        return replace(theirs, words={**ties, **theirs.words}, expected=f"{theirs.expected}, {also}")
    return best[0]


def codes_of(meaning: Meaning, asked: Asked) -> Codes:
    """Return each cell's choice by a meaning, int8 (N,), UNKNOWN where it has none."""
    codes = asked.choice.meaning(lambda word: meaning.words.get(word.lower(), UNKNOWN), np.int8)
    if not meaning.by_item:
        return np.asarray(codes, np.int8)
    place = {word: index for index, word in enumerate(asked.choice.words)}
    a, b = (item.meaning(lambda word: place.get(word, UNKNOWN), np.int32) for item in (asked.item_a, asked.item_b))
    codes = np.select([asked.choice.codes == a, asked.choice.codes == b], [A, B], codes)
    is_open = (codes == UNKNOWN) & asked.choice.meaning(bool, bool)
    if is_open.any():
        known: dict[str, int] = {}
        files = (asked.choice, asked.item_a, asked.item_b)
        choice, a, b = (numbered_names(map(file_name, c.words), known, np.int32)[c.codes] for c in files)
        is_open &= a != b
        codes = np.select([is_open & (choice == a), is_open & (choice == b)], [A, B], codes)
    return np.asarray(codes, np.int8)


def file_name(name: str) -> str:
    """Return the name of a file without its folders, its ending, and what follows a question mark."""
    return re.sub(r"\.[a-z][a-z0-9]{1,4}$", "", re.split(r"[/\\]", name.partition("?")[0])[-1], flags=re.IGNORECASE)


def _readings(asked: Asked, ties: Mapping[str, int]) -> list[tuple[Meaning, Codes]]:
    """Return all ways to understand the words, ours first, with each cell's choice."""
    said = _ties_in(asked.choice, ties)
    ours = Meaning(CHOICE_CODES | dict(ties), expected=", ".join(CHOICES))
    if set(map(str.lower, asked.choice.filled)) - set(CHOICES):
        ours = replace(ours, note=f"choice is a for item_a and b for item_b{said}")
    known = [ours]
    for first, second in (*SIDES[1:], tuple(name.lower() for name in asked.names), *ENDS[4:]):
        sides = {word.lower(): _side(word, first, second) for word in asked.choice.filled}
        words = {**ties, **{word: side for word, side in sides.items() if side is not None}}
        note = f"choice is {first} for item_a and {second} for item_b{said}"
        known.append(Meaning(words, note=note, expected=f"{first} or {second}"))
    note = "choice is the name of the preferred item"
    known.append(Meaning(dict(ties), by_item=True, note=note, expected="the name of one of the two items"))
    if any(STRENGTH.fullmatch(word) for word in asked.choice.filled):
        known += _strengths(asked, ties)
    return [(reading, codes_of(reading, asked)) for reading in known]


def _side(word: str, first: str, second: str) -> int | None:
    """Return the side that a word such as "Left", "the left image" or "model_a" means; None for others."""
    letters = word.lower()
    if letters in (first, second):
        return A if letters == first else B
    if not math.isnan(number_or_nan(word)):
        return None  # -1 is not 1
    parts = [part for part in re.findall(r"[^\W_]+", letters) if part not in FILLERS]
    if len(parts) == 1 and parts[0] in (first, second):
        return A if parts[0] == first else B
    ends = ends_of(word)
    return ends[2] if ends and ENDS[ends[1]] == (first, second) and not ends[0].startswith("name") else None


def _any_side(who: str) -> int | None:
    """Return the side that words mean by any of its names; None for others."""
    return next((known for ends in SIDES if (known := _side(who, *ends)) is not None), None)


def _ties_in(choice: Column, ties: Mapping[str, int]) -> str:
    used = sorted({word for word in choice.filled if word.lower() in ties and word.lower() not in CHOICES})
    return f", {' or '.join(used)} for none" if used else ""


def _own(asked: Asked, known: tuple[Meaning, Codes]) -> Meaning:
    """Return our own words, saying so where items have these names, too, and some would mean the other side."""
    meaning, codes = known
    named = codes_of(Meaning({"none": NONE}, by_item=True), asked)
    if (named != UNKNOWN).all() and (named != codes).any():
        return replace(meaning, note="choice a is item_a and b is item_b, although items are named a and b, too")
    return meaning


def _question(asked: Asked, whole: list[tuple[Meaning, Codes]]) -> QuestionError:
    """Ask which of several meanings of all words is right; of those that agree, one is shown."""
    readings = {codes.tobytes(): reading for reading, codes in reversed(whole)}  # the first of those that agree
    ways = [
        Reading(reading.note or "a is item_a, b is item_b", _told(reading)) for reading in reversed(readings.values())
    ]
    return QuestionError(f"the choices {_some_of(asked.choice)} can be read in {len(ways)} ways", ways)


def _told(reading: Meaning) -> Told:
    if reading.by_item:
        return Told(choices={"by": BY_ITEM})
    sides = {CHOICES[code]: word for word, code in reversed(list(reading.words.items())) if code != NONE}
    return Told(choices=dict(sorted(sides.items())))


def _some_of(column: Column) -> str:
    words = sorted(column.filled)
    return ", ".join(map(shown, words[:4])) + (" …" if len(words) > 4 else "")


def _ask_if_items_are_called_like_sides(asked: Asked, whole: list[tuple[Meaning, Codes]], *, by: str) -> None:
    """Ask where items are called 1 and 2 and so are choices, unless the user named the column; and for a lone 1."""
    words, items = set(asked.choice.filled), {*asked.item_a.filled, *asked.item_b.filled}
    if by or asked.is_told or not words & items or whole[0][0].by_item:
        return
    if words & items & {"1", "2"}:
        readings = [
            Reading("1 is item_a and 2 is item_b", Told(choices={"a": "1", "b": "2"})),
            Reading("a cell is the name of the preferred item", Told(choices={"by": BY_ITEM})),
        ]
        raise QuestionError(f"items are called {', '.join(sorted(words & items))}, and choices are, too", readings)


def _ask_about_numbers(asked: Asked, given: Mapping[str, str]) -> None:
    """Ask which number means which side."""
    words = {_as_code(word) for word in asked.choice.filled}
    if len(words) < 2 or given:  # one number alone is a mistake rather than a code
        return
    ours = {"a": f"{asked.names[0]} preferred", "b": f"{asked.names[1]} preferred", "none": "no preference"}
    if ways := number_codes(asked.choice):
        said = [", ".join(f"{theirs} is {ours[our]}" for our, theirs in way.items()) for way in ways]
        readings = [Reading(text, Told(choices=way)) for text, way in zip(said, ways, strict=True)]
        if not words <= TRUE_FALSE.keys() and all(abs(value) <= HIGHEST_GRADE for value in values_of(asked.choice)):
            readings.append(Reading(f"grades, how much better {asked.names[1]} is", Told(format="ccr")))
        raise QuestionError(f"the choices {_some_of(asked.choice)} can be read in {len(readings)} ways", readings)


def _as_code(word: str) -> str:
    """Return a word in lower case, and a number as it is written shortest: 1.0 is 1."""
    return word.lower() if math.isnan(number := number_or_nan(word)) else f"{number:g}"


def number_codes(choice: Column) -> tuple[dict[str, str], ...]:
    """Return what numbers may mean, our word -> theirs, each way; none where they are rather grades."""
    words = {_as_code(word) for word in choice.filled}
    ways = next((ways for known, ways in NUMBER_CODES.items() if words <= known), ())
    if ways or len(words) != len(SIDES[0]) or not is_numeric(choice):
        return ways
    low, high = sorted(words, key=number_or_nan)
    return {"a": low, "b": high}, {"a": high, "b": low}


def _strengths(asked: Asked, ties: Mapping[str, int]) -> list[Meaning]:
    """Return what words such as "left much better" mean without their strength.

    Raises
    ------
    QuestionError
        If a word says "better" and not who, and that was not told.
    """
    items, by_item = {*asked.item_a.filled, *asked.item_b.filled}, False
    words: dict[str, int] = dict(ties)
    for word in asked.choice.filled:
        match = STRENGTH.fullmatch(word)
        if match is None:
            continue
        who = match["who"]
        if who is None:
            if not asked.strengths_as:
                raise _ask_about_strengths(asked)
            words[word.lower()] = B if match["way"].lower() == "better" else A
            continue
        side = _any_side(who)
        if side is None or who in items:
            by_item = True
            continue
        words[word.lower()] = side if match["way"].lower() == "better" else 1 - side
    note = "how much better is left out of the choices; --format ccr takes it as a grade"
    return [] if by_item else [Meaning(words, note=note, expected="a side and how much better it is")]


def _ask_about_strengths(asked: Asked) -> QuestionError:
    first, second = asked.names
    grades = f"how much better {second} is than {first}, as grades from -3 to 3 (ITU-T P.910)"
    swapped = Told(columns={"item_a": second, "item_b": first}, format="votes")
    return QuestionError(
        f"the choices {_some_of(asked.choice)} do not say which item is better",
        [
            Reading(grades, Told(format="ccr")),
            Reading(f"whether {second} is better than {first}, as votes without strength", Told(format="votes")),
            Reading(f"whether {first} is better than {second}, as votes without strength", swapped),
        ],
    )


def grade_of(word: str) -> float | None:
    """Return the grade of a comparison's words, ITU-T P.910: "much better" is 3, "slightly worse" -1, a tie 0."""
    letters = word.lower()
    if letters in TIES:
        return 0.0
    match = STRENGTH.fullmatch(letters)
    if match is None:
        return None
    grade = float(STRENGTHS[match["much"] or ""] * (1 if match["way"] == "better" else -1))
    side = _any_side(match["who"]) if match["who"] else B
    return None if side is None else -grade if side == A else grade


def binary_meaning(side: int) -> Meaning:
    """Return what a column such as `is_A_selected` means, whose true cells prefer that side."""
    return Meaning({word: side if true else 1 - side for word, true in TRUE_FALSE.items()}, expected="1 or 0")
