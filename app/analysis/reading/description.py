"""Describe a table in plain words: which column is what, and what its cells mean. Told, recognised, or asked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from app.analysis.reading.cells import named
from app.analysis.reading.votes_table import VotesError

VOTES, RATINGS, COMPARISONS = "votes", "ratings", "comparisons"
MOST_NAMED = 12  # columns of a wide table
BY_ITEM = "item"  # `--choices by=item`: a cell names the preferred item
SINGLE = ("format", "encoding", "sheet")  # what is told in a word
JOIN = "+"  # between columns that name an item together, or that hold the ratings or choices of a wide table


@dataclass(frozen=True)
class Told:
    """What the user says about a file; it edits the description, and takes nothing else away.

    Parameters
    ----------
    columns : our name of a column -> theirs
    choices : `a`, `b`, `none` -> their word; `by` -> `item` or `side`, what a cell names
    format : a name of `formats`, or empty
    encoding : of the text, or empty
    sheet : of a workbook, or question of a program's export, or empty
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    choices: Mapping[str, str] = field(default_factory=dict)
    format: str = ""
    encoding: str = ""
    sheet: str = ""

    def and_told(self, edits: Told) -> Told:
        """Return what was told, and more."""
        return replace(
            self,
            columns={**self.columns, **edits.columns},
            choices={**self.choices, **edits.choices},
            **{name: getattr(edits, name) or getattr(self, name) for name in SINGLE},
        )

    def __str__(self) -> str:
        """Write it as the options of a command."""
        mappings = (("--columns", self.columns), ("--choices", self.choices))
        words = [f"{name} {_quoted(written(pairs))}" for name, pairs in mappings if pairs]
        single = [f"--{name} {_quoted(value)}" for name in SINGLE if (value := getattr(self, name))]
        return " ".join([*words, *single])


def pairs_of(text: str, option: str) -> dict[str, str]:
    """Read "ours=theirs,ours=theirs"; empty: nothing.

    Raises
    ------
    ValueError
        If a part is no such pair, or names one of ours twice: names the option.
    """
    pairs = [pair.partition("=") for pair in text.split(",")] if text.strip() else []
    if not all(ours.strip() and theirs.strip() for ours, _, theirs in pairs):
        raise ValueError(f"{option} is {text!r}, expected ours=theirs, comma between")
    names = [ours.strip() for ours, _, _ in pairs]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"{option} names {repeated[0]} twice; expected ours=theirs, each of ours once")
    return {ours.strip(): theirs.strip() for ours, _, theirs in pairs}


def written(pairs: Mapping[str, str]) -> str:
    """Write pairs as `pairs_of` reads them."""
    return ",".join(f"{ours}={theirs}" for ours, theirs in pairs.items())


def _quoted(text: str) -> str:
    return f'"{text}"' if set(text) & set(" ()&|;<>*?$'#") else text


@dataclass(frozen=True)
class Reading:
    """One way to understand a table: in words, and what to tell to get it."""

    text: str
    told: Told


class QuestionError(VotesError):
    """Several readings fit a table, or one that must be confirmed; the message shows each, with its option."""

    def __init__(self, about: str, readings: Sequence[Reading]) -> None:
        self.about = about
        self.readings = tuple(readings)
        lines = [f"  {number}. {reading.text}: {reading.told}" for number, reading in enumerate(readings, start=1)]
        single = f"{about}; {readings[0].told} takes it as: {readings[0].text}" if len(lines) == 1 else ""
        super().__init__(single or "\n".join([f"{about}; which is meant?", *lines]))

    def at(self, place: Path | str) -> QuestionError:
        """Return the question about a file."""
        return QuestionError(f"{place}: {self.about}", self.readings)


@dataclass(frozen=True)
class Description:
    """How a table is read; all that the second half of reading needs beside the table.

    Parameters
    ----------
    holds : votes, ratings, or comparisons (ratings of pairs)
    columns : our name -> theirs; several are joined to one text
    spread : for a wide table, its column -> the two items, the condition or the participant that it stands for
    spread_role : what a column of a wide table stands for: `pair`, `condition` or `participant`
    layout : `rows`, `wide`, `won` (winner and loser), or one of `layouts.SEVERAL_VOTES`
    words : word of a choice, in lower case -> choice as in `VotesTable`; a rating for comparisons
    expected : words of a choice, for refusals
    by_item : a choice is the name of the preferred item
    without : rows, counted from 0, that are left out
    not_used : names of columns
    notes, warnings : sentences
    """

    holds: str
    columns: Mapping[str, tuple[str, ...]]
    layout: str = "rows"
    spread: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    spread_role: str = ""
    words: Mapping[str, float] = field(default_factory=dict)
    expected: str = ""
    by_item: bool = False
    without: tuple[int, ...] = ()
    not_used: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def used(self) -> list[str]:
        """Name each used column with its role."""
        said = [
            role if theirs == (role,) else f"{role} is the column {' and '.join(map(repr, theirs))}"
            for role, theirs in self.columns.items()
        ]
        if self.spread:
            what = {"pair": "pairs", "condition": "conditions", "participant": "participants"}[self.spread_role]
            said.append(f"the columns of {what} are {named([*map(repr, self.spread)], MOST_NAMED)}")
        return said
