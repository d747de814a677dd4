"""See what a table may be: candidates for every role, and what was told."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from app.analysis.reading.cells import Column, Table, is_numeric, named, number_or_nan
from app.analysis.reading.choices import grade_of
from app.analysis.reading.description import COMPARISONS, JOIN, Description, QuestionError, Reading, Told
from app.analysis.reading.layouts import joined_column
from app.analysis.reading.votes_table import CHOICES, VotesError
from app.analysis.reading.words import (
    ENDS,
    INITIALS,
    MORE_ENDS,
    OWN_VOTES,
    ROLES,
    SUMMARIES,
    WEAK_RATINGS,
    ends_of,
    has_grade,
    is_never,
    means,
    plain,
)

NOT_USED = "-"  # `--columns reference=-`: no column is that


FEWEST_RATED = 2  # columns of a wide table of ratings; a single one may be anything


FEWEST_RANKED = 3


WIDE_ROLES = ("choice", "rating")  # told with several columns, they are spread over these


Columns = dict[str, tuple[str, ...]]  # role -> names of a table's columns


@dataclass(frozen=True)
class Seen:
    """A table with what was told about it, and the columns that are left to recognise."""

    table: Table
    told: Told

    @cached_property
    def given(self) -> Columns:
        """Columns as told, our name -> theirs."""
        unknown = [*set(self.told.columns).difference(ROLES), *set(self.told.choices).difference((*CHOICES, "by"))]
        if unknown:
            known = ", ".join(dict.fromkeys((*ROLES, *CHOICES)))
            raise VotesError(f"{unknown[0]!r} is no column or choice of a votes table; known are {known}")
        return {
            role: self._told_names(theirs) for role, theirs in self.told.columns.items() if theirs.strip() != NOT_USED
        }

    def _told_names(self, theirs: str) -> tuple[str, ...]:
        """Return the columns that were told, by the rule of names; several are joined by +, which names may hold."""
        parts, matches = [part.strip() for part in theirs.split(JOIN)], []
        while parts:
            for n in range(len(parts), 0, -1):
                if (name := self._column(JOIN.join(parts[:n])) or self._column(theirs)) is not None:
                    matches.append(name)
                    parts = [] if name == self._column(theirs) else parts[n:]
                    break
            else:
                break
        if matches and not parts:
            return tuple(matches)
        raise VotesError(
            f"lacks the column {theirs}; found {named(self.table.names) or 'none'}. "
            "Map other names, e.g. --columns participant=judge, or item_a=type+level for an item in two columns"
        )

    def _column(self, name: str) -> str | None:
        if name in self.table.columns:
            return name
        alike = [column for column in self.table.names if plain(column) == plain(name)]
        return alike[0] if len(alike) == 1 else None

    @cached_property
    def free(self) -> list[str]:
        """Names of columns that were not told, and are not empty where others could mean the same."""
        taken = names_in(self.given)
        return [name for name in self.table.names if name not in taken]

    def column(self, name: str) -> Column:
        return self.table.columns[name]

    def is_empty(self, name: str) -> bool:
        return not self.column(name).filled

    def candidates(self, role: str, more: Sequence[str] = ()) -> list[str]:
        """Return the columns that may have a role: what was told, else our own name, else usual other names."""
        if role in self.told.columns:
            return list(self.given.get(role, ()))
        ours = [name for name in self.free if plain(name) == plain(role)]
        if role == "rating" and not more:  # a rating beside a score is not surely the one that is meant
            ours += [
                name for name in self.free if means(role, name) and name not in ours and is_numeric(self.column(name))
            ]
        known = ours or [name for name in self.free if means(role, name) or plain(name) in more]
        filled = [name for name in known if not self.is_empty(name)]
        return filled or known[:1]

    def one(self, role: str, more: Sequence[str] = ()) -> tuple[str, ...]:
        """Return the columns of a role, one but where several were told; none if there is none.

        Raises
        ------
        QuestionError
            If several may have the role, and are not the same but for their names.
        """
        if role in self.given:
            return self.given[role]
        matches = self.candidates(role, more)
        if len(matches) > 1 and not all(self.tell_alike(matches[0], other) for other in matches[1:]):
            readings = [Reading(f"{role} is the column {name!r}", Told(columns={role: name})) for name in matches]
            raise QuestionError(f"{len(matches)} columns may be {role}", readings)
        return tuple(matches[:1])

    def tell_alike(self, name: str, other: str) -> bool:
        """Do two columns tell the same rows apart?"""
        return self.column(name).tells_alike(self.column(other))

    @cached_property
    def pairs(self) -> list[tuple[str, str]]:
        """Columns that name two items, our own names first."""
        if {"item_a", "item_b"} & self.given.keys():
            ours = ((role, [name for name in self.free if plain(name) == plain(role)]) for role in ("item_a", "item_b"))
            a, b = (JOIN.join(self.given.get(role, names[:1])) for role, names in ours)
            return [(a, b)] if a and b else []
        ends: dict[tuple[str, int], dict[int, str]] = {}
        for name in self.free:
            if (end := ends_of(name)) is not None:
                ends.setdefault(end[:2], {}).setdefault(end[2], name)
        plains = {plain(name) for name in self.table.names}
        matches = []
        for (stem, place), sides in ends.items():
            bare = stem.partition("+")[0]
            third = any({f"{bare}{end}", f"{end}{bare}"} & plains for end in MORE_ENDS) and place < len(ENDS) - 1
            if len(sides) == 2 and not third:
                matches.append((sides[0], sides[1]))
        matches.sort(key=lambda pair: (plain(pair[0]), plain(pair[1])) != ("itema", "itemb"))
        return matches

    @property
    def is_own(self) -> bool:
        """Has the table our own names of the columns of votes?"""
        return set(self.table.names) >= OWN_VOTES and not set(self.told.columns) & OWN_VOTES

    def optional(self, roles: Sequence[str], taken: Collection[str]) -> Columns:
        """Return the optional columns that are there, and are not taken by other roles."""
        matches = {role: self.first(role) for role in roles}
        return {role: n for role, n in matches.items() if n and (role in self.given or n[0] not in taken)}

    def first(self, role: str, more: Sequence[str] = ()) -> tuple[str, ...]:
        """Return the first column that may have a role, or what was told; none if there is none."""
        return self.given.get(role) or tuple(self.candidates(role, more)[:1])

    def who_and_what(self) -> Columns:
        """Return the columns of participants and datasets."""
        return {role: names for role in ("participant", "dataset") if (names := self.one(role))}


Finder = Callable[[Seen], Description | None]


def says(seen: Seen, *roles: str) -> bool:
    """Did the user name a column of one of these roles?"""
    return bool(set(roles) & set(seen.given))


def item_columns(item_a: str, item_b: str) -> Columns:
    return {"item_a": tuple(item_a.split(JOIN)), "item_b": tuple(item_b.split(JOIN))}


def one_pair(seen: Seen, pairs: Sequence[tuple[str, str]], choices: Sequence[str]) -> tuple[str, str]:
    """Return the columns of the two items, asking where there are several such pairs.

    Parameters
    ----------
    seen : the table
    pairs : columns that may name the two items
    choices : columns that may say which is preferred, whose words may tell
    """
    if len(pairs) == 1:
        return pairs[0]
    first = pairs[0]
    others = [pair for pair in pairs[1:] if any(not seen.tell_alike(a, b) for a, b in zip(first, pair, strict=True))]
    if plain(first[0]) == "itema":
        words = {word.lower() for name in choices for word in seen.column(name).filled}
        others = [pair for pair in others if words & set(ENDS[(ends_of(pair[0]) or ("", 0, 0))[1]]) - {"a", "b"}]
    if not others:
        return first
    readings = [
        Reading(f"the items are {a!r} and {b!r}", Told(columns={"item_a": a, "item_b": b})) for a, b in (first, *others)
    ]
    raise QuestionError(f"{len(readings)} pairs of columns may name the two items", readings)


def as_grades(description: Description, choice: Column) -> Description:
    """Take the choices of a description for grades of comparisons, whose words are numbers."""
    words = {word.lower(): grade for word in choice.filled if (grade := grade_of(word)) is not None}
    columns = {("rating" if role == "choice" else role): names for role, names in description.columns.items()}
    note = "grades say how much better item_b is than item_a"
    return replace(description, holds=COMPARISONS, columns=columns, words=words, notes=(*description.notes, note))


def rating_of(seen: Seen, *, weak: bool = False) -> tuple[str, ...]:
    """Return the column of ratings that is not empty."""
    names = seen.one("rating") or (seen.one("rating", WEAK_RATINGS) if weak else ())
    return names if names and (not seen.is_empty(names[0]) or not len(seen.table)) else ()


def condition_of(seen: Seen) -> tuple[str, ...]:
    """Return the column of conditions; where a PVS is a scene and an HRC, the HRC."""
    matches = seen.candidates("condition")
    dataset = seen.one("dataset")
    if "condition" in seen.given or len(matches) < 2 or not dataset:
        return seen.one("condition")
    first, *others = (joined_column(seen.table, (*dataset, name)) for name in matches)
    if not all(first.tells_alike(column) for column in others):
        return seen.one("condition")
    return (min(matches, key=lambda name: len(seen.column(name).seen)),)


def names_in(columns: Mapping[str, Iterable[str]]) -> set[str]:
    """Return the names of a table's columns that have a role."""
    return {name for names in columns.values() for name in names}


def rated_columns(seen: Seen, told: Sequence[str], who: Columns) -> list[str]:
    """Return the columns that hold ratings or ranks: several as told, else all of numbers.

    Parameters
    ----------
    seen : the table
    told : names of columns
    who : columns of participants and conditions
    """
    return list(told) if len(told) > 1 else [] if told else columns_of_numbers(seen, names_in(who))


def columns_of_numbers(seen: Seen, taken: Iterable[str]) -> list[str]:
    """Return the columns of numbers that may be ratings by or of something."""
    others = {*taken, *seen.one("dataset")}
    may_be = [name for name in seen.free if name not in others and not is_never(name)]
    numbers = [name for name in may_be if _mostly_numbers(seen.column(name))]
    if len(numbers) >= FEWEST_RATED:
        return numbers
    graded = [name for name in may_be if (words := seen.column(name).filled) and all(map(has_grade, words))]
    return graded if len(graded) >= FEWEST_RATED else numbers


def _mostly_numbers(column: Column) -> bool:
    """Are most of a column's cells numbers? A few others are mistakes, which are named as such."""
    if is_numeric(column):
        return True
    is_number = column.meaning(lambda word: not math.isnan(number_or_nan(word)), bool)
    return bool(2 * is_number.sum() > column.meaning(bool, bool).sum())


def with_people_alone(seen: Seen, description: Description) -> Description:
    """Leave out the rows of a long table, or of one with pairs in columns, whose participant is a statistic."""
    names = description.columns.get("participant", ())
    if len(names) != 1 or names[0] in names_in(seen.given):
        return description
    column = seen.column(names[0])
    rows = summaries(column)
    if not rows or len(rows) == len(seen.table):
        return description
    if {plain(column.text(row)) for row in rows} <= INITIALS:
        doubt = f"participants are called {named(sorted({column.text(row) for row in rows}))}: leave out statistics"
        return replace(description, warnings=(*description.warnings, doubt))
    return replace(description, without=rows)


def summaries(column: Column) -> tuple[int, ...]:
    """Return the rows whose name is that of a statistic: they are nobody's."""
    return tuple(np.flatnonzero(column.meaning(lambda word: plain(word) in SUMMARIES, bool)).tolist())
