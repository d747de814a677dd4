"""Recognise a table: data in, a plain description out. The first half of reading.

What the user said decides, then pairs in the names of columns, then the names of columns, last what cells look like.
Where two readings fit, they are asked and not chosen.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from app.analysis.reading.cells import Column, Table, is_numeric, named, shown, values_of
from app.analysis.reading.choices import (
    Asked,
    Meaning,
    binary_meaning,
    codes_of,
    grade_of,
    understand_choices,
)
from app.analysis.reading.description import (
    COMPARISONS,
    JOIN,
    RATINGS,
    VOTES,
    Description,
    QuestionError,
    Reading,
    Told,
)
from app.analysis.reading.layouts import joined_column, rows_of
from app.analysis.reading.votes_table import CHOICES, VotesError
from app.analysis.reading.words import (
    BINARY_CHOICES,
    COMMENTS,
    ENDS,
    GRADES,
    MORE_ENDS,
    MULTIPLE,
    NEVER,
    OPTIONAL,
    OWN_VOTES,
    RATING_OPTIONAL,
    ROLES,
    SEVERAL,
    SUMMARIES,
    SWAPPED,
    WEAK_RATINGS,
    ends_of,
    is_never,
    is_suspicious,
    means,
    pair_in,
    plain,
)

NOT_USED = "-"  # `--columns reference=-`: no column is that
FEWEST_RATED = 2  # columns of a wide table of ratings; a single one may be anything
FEWEST_DASHED = 2  # columns named "x - y"; a single one may be anything
FEWEST_RANKED = 3
SHORTENED = re.compile(r"\d([.,]\d+)?E\+?\d{2,}", re.IGNORECASE)  # 5.6E+23: what Excel leaves of a long id
DATE = re.compile(
    r"\d{4}-\d\d-\d\d([ T]00:00(:00)?)?|\d{1,2}-(jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*(-\d{2,4})?|"
    r"(jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*-\d{2,4}",
    re.IGNORECASE,
)
WIDE_ROLES = ("choice", "rating")  # told with several columns, they are spread over these


def recognise(table: Table, told: Told = Told()) -> Description:  # frozen
    """Describe a table.

    Parameters
    ----------
    table : as read from a file
    told : what the user said

    Raises
    ------
    QuestionError
        If several readings fit.
    VotesError
        If none does.
    """
    seen = _Seen(table, told)
    finders = FINDERS if told.format not in LAYOUTS else {told.format: LAYOUTS[told.format]}
    for find in finders.values():
        description = find(seen)
        if description is not None:
            return _with_lists(seen, description)
    raise VotesError(_lacking(seen))


@dataclass(frozen=True)
class _Seen:
    """A table with what was told about it, and the columns that are left to recognise."""

    table: Table
    told: Told

    @cached_property
    def given(self) -> dict[str, tuple[str, ...]]:
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
        taken = {name for names in self.given.values() for name in names}
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
        if len(matches) > 1 and not all(self._same(matches[0], other) for other in matches[1:]):
            readings = [Reading(f"{role} is the column {name!r}", Told(columns={role: name})) for name in matches]
            raise QuestionError(f"{len(matches)} columns may be {role}", readings)
        return tuple(matches[:1])

    def _same(self, name: str, other: str) -> bool:
        """Do two columns tell the same rows apart?"""
        a, b = self.column(name), self.column(other)
        pairs = len(np.unique(a.codes.astype(np.int64) * len(b.words) + b.codes))
        return pairs == len(a.seen) == len(b.seen)

    @cached_property
    def pairs(self) -> list[tuple[str, str]]:
        """Columns that name two items, our own names first."""
        if {"item_a", "item_b"} <= set(self.given):
            return [(JOIN.join(self.given["item_a"]), JOIN.join(self.given["item_b"]))]
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
        if len(self.given.keys() & {"item_a", "item_b"}) == 1:
            (role,) = self.given.keys() & {"item_a", "item_b"}
            other = "item_b" if role == "item_a" else "item_a"
            ours = [name for name in self.free if plain(name) == plain(other)]
            half = JOIN.join(self.given[role])
            matches = [(half, ours[0]) if role == "item_a" else (ours[0], half)] if ours else []
        return matches

    @property
    def is_own(self) -> bool:
        """Has the table our own names of the columns of votes?"""
        return set(self.table.names) >= OWN_VOTES and not set(self.told.columns) & OWN_VOTES

    def optional(self, roles: Sequence[str], taken: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Return the optional columns that are there."""
        matches = {}
        for role in roles:
            names = self.given.get(role) or tuple(name for name in self.candidates(role)[:1] if name not in taken)
            if names:
                matches[role] = names
        return matches

    def who_and_what(self) -> dict[str, tuple[str, ...]]:
        """Return the columns of participants and datasets."""
        return {role: names for role in ("participant", "dataset") if (names := self.one(role))}


Finder = Callable[[_Seen], Description | None]


def _matrix(seen: _Seen) -> Description | None:
    """Find a matrix of win counts: the same names in the first column and the header."""
    names = [name.strip() for name in seen.table.names]
    if set(seen.told.columns) - {"participant", "dataset"} or len(names) < 3:
        return None
    first = seen.column(seen.table.names[0])
    if len(first) != len(names) - 1 or len(first) < 2 or set(first.texts) != set(names[1:]):
        return None
    note = f"a matrix of win counts of {len(first)} items, of the row over the column"
    spread = {name: (name.strip(),) for name in seen.table.names[1:]}
    return Description(VOTES, {"item_a": (seen.table.names[0],)}, "matrix", spread, "condition", notes=(note,))


def _wide_pairs(seen: _Seen) -> Description | None:
    """Find a column for each pair, named "x vs y"."""
    spread = _told_pairs(seen) or _named_pairs(seen)
    if not spread:
        return None
    who = seen.who_and_what()
    others = [name for name in seen.table.names if name not in spread]
    if others and not who:
        raise VotesError(
            f"has a column for each of {len(spread)} pairs, beside {named(others)}; "
            "say which column names the participants, e.g. --columns participant=judge"
        )
    taken = [*spread, *(name for names in who.values() for name in names)]
    description = Description(
        VOTES,
        who | seen.optional(("practice", "excluded", "reason"), taken),
        "wide",
        spread,
        "pair",
        notes=(f"a wide table with a column for each of {len(spread)} pairs",),
    )
    return _with_meaning(seen, description)


def _told_pairs(seen: _Seen) -> dict[str, tuple[str, ...]]:
    """Return the pairs of the columns that were told to hold choices or grades."""
    for role in WIDE_ROLES:
        names = seen.given.get(role, ())
        pairs = {name: pair[:2] for name in names if (pair := pair_in(name)) is not None}
        if names and len(pairs) == len(names):
            return dict(pairs)
    return {}


def _named_pairs(seen: _Seen) -> dict[str, tuple[str, ...]]:
    """Return the columns that are named by a pair; "x vs y Comment" is none, and a dash needs more than itself."""
    if set(seen.told.columns) & {"item_a", "item_b", "choice", "rating", "condition", "winner", "loser"}:
        return {}
    if any(plain(name) in ("itema", "itemb") for name in seen.free):
        return {}
    matches = {name: pair for name in seen.free if (pair := pair_in(name)) is not None and not COMMENTS.search(name)}
    sure = {name: pair[:2] for name, pair in matches.items() if not pair[2]}
    items = {item for pair in sure.values() for item in pair}
    dashed: dict[str, tuple[str, str]] = {name: pair[:2] for name, pair in matches.items() if pair[2]}
    if sure:
        return {**sure, **{name: pair for name, pair in dashed.items() if set(pair) <= items}}
    if len(dashed) < FEWEST_DASHED:
        return {}
    counts = Counter(item for pair in dashed.values() for item in pair)
    recurring = all(max(counts[a], counts[b]) > 1 for a, b in dashed.values())
    are_named = all(_names_items(seen.column(name), pair) for name, pair in dashed.items())
    is_heading = (
        len({a for a, _ in dashed.values()}) == 1 and len(dashed) > FEWEST_DASHED
    )  # "Quality - x", "Quality - y"
    if not are_named and (is_heading or not recurring or all(is_numeric(seen.column(name)) for name in dashed)):
        return {}
    return dict(dashed)


def _names_items(column: Column, pair: Sequence[str]) -> bool:
    return bool(set(column.filled) & set(pair)) and not any(
        word not in pair and grade_of(word) != 0 for word in column.filled
    )


def _with_meaning(seen: _Seen, description: Description) -> Description:
    """Complete a description of votes with what its choices mean; grades make it one of comparisons."""
    rows = rows_of(seen.table, description)
    choice, item_a, item_b = (rows.columns[name] for name in ("choice", "item_a", "item_b"))
    if seen.told.format == "ccr":
        return _as_grades(description, choice)
    is_graded = is_numeric(choice) and any(value != int(value) or not -1 <= value <= 3 for value in values_of(choice))
    are_items = set(choice.filled) <= {*item_a.filled, *item_b.filled}
    if is_graded and not are_items and not {"a", "b", "by"} & set(seen.told.choices):
        raise QuestionError(
            f"the choices {named(sorted(choice.filled)[:6])} are numbers",
            [Reading("grades, how much better the second of two items is", Told(format="ccr"))],
        )
    names = ("item_a", "item_b")
    if description.layout == "rows":
        names = (description.columns["item_a"][0], description.columns["item_b"][0])
    asked = Asked(
        choice,
        item_a,
        item_b,
        names,
        is_own=seen.is_own,
        is_told="choice" in seen.told.columns,
        strengths_as="votes" if seen.told.format == "votes" else "",
    )
    meaning = _binary(seen, description) or understand_choices(asked, seen.told.choices)
    _ask_about_sides(seen, description, asked, meaning)
    notes = (*description.notes, meaning.note) if meaning.note else description.notes
    return replace(
        description, words=dict(meaning.words), by_item=meaning.by_item, expected=meaning.expected, notes=notes
    )


def _as_grades(description: Description, choice: Column) -> Description:
    words = {word.lower(): grade for word in choice.filled if (grade := grade_of(word)) is not None}
    columns = {("rating" if role == "choice" else role): names for role, names in description.columns.items()}
    note = "grades say how much better item_b is than item_a"
    return replace(description, holds=COMPARISONS, columns=columns, words=words, notes=(*description.notes, note))


def _binary(seen: _Seen, description: Description) -> Meaning | None:
    """Return the meaning of a column such as `is_A_selected`."""
    names = description.columns.get("choice", ())
    if len(names) != 1 or {"a", "b", "by"} & set(seen.told.choices):
        return None
    for side, known in BINARY_CHOICES.items():
        if plain(names[0]) in known and {word.lower() for word in seen.column(names[0]).filled} <= set(
            binary_meaning(side).words
        ):
            return binary_meaning(side)
    return None


def _ask_about_sides(seen: _Seen, description: Description, asked: Asked, meaning: Meaning) -> None:
    """Ask where a choice is a side, and another column says which item was on a side."""
    if description.layout != "rows" or meaning.by_item or {"a", "b", "by"} & set(seen.told.choices):
        return
    sides = [word for word in meaning.expected.split(" or ") if word in {end for ends in ENDS[1:] for end in ends}]
    items = {*asked.item_a.filled, *asked.item_b.filled}
    known = {*description.columns["item_a"], *description.columns["item_b"], *description.columns["choice"]}
    _ask_about_swaps(seen, description, asked, sides)
    for name in seen.table.names:
        if name in known or not any(side in plain(name) for side in sides if not side.isdigit()):
            continue
        column = seen.column(name)
        place = 0 if sides[0] in plain(name) else 1
        theirs = (asked.item_a, asked.item_b)[place].texts
        if column.filled and set(column.filled) <= items and (column.texts != theirs).any():
            reading = Reading(
                f"{sides[0]} is {asked.names[0]} and {sides[1]} is {asked.names[1]}",
                Told(choices={"a": sides[0], "b": sides[1]}),
            )
            raise QuestionError(
                f"choices are {sides[0]} and {sides[1]}, and the column {name!r} names another item on a side than "
                f"{asked.names[place]!r} (if it is right, give the items of the sides as item_a and item_b)",
                [reading],
            )


def _ask_about_swaps(seen: _Seen, description: Description, asked: Asked, sides: Sequence[str]) -> None:
    """Ask where choices are sides, and a column says that these were exchanged in some rows."""
    used = {name for names in description.columns.values() for name in names}
    for name in seen.table.names:
        if name not in used and SWAPPED.search(name) and len(seen.column(name).filled) > 1 and len(sides) > 1:
            told = Told(choices={"a": sides[0], "b": sides[1]})
            reading = Reading(f"{sides[0]} is {asked.names[0]} in all rows", told)
            raise QuestionError(
                f"choices are {sides[0]} and {sides[1]}, and the column {name!r} may say that sides were exchanged in "
                "some rows (if so, give the items as they stood)",
                [reading],
            )


def _ask_about_counts(seen: _Seen, description: Description) -> None:
    """Ask where a column that is not used may say how often a row counts."""
    if "count" in description.columns or "count" in seen.told.columns:
        return
    for name in seen.free:
        column = seen.column(name)
        if plain(name) in MULTIPLE and is_numeric(column) and any(value != 1 for value in values_of(column)):
            readings = [
                Reading(f"each row counts as often as {name!r} says", Told(columns={"count": name})),
                Reading("each row is one vote", Told(columns={"count": NOT_USED})),
            ]
            raise QuestionError(f"the column {name!r} may say how often a row counts", readings)


def _by_names(seen: _Seen) -> Description | None:
    """Find what the names of the columns say: votes, comparisons, ratings, counts, rankings."""
    if any(len(seen.given.get(role, ())) > 1 for role in WIDE_ROLES):
        return None
    matches = {name: description for name, find in BY_NAMES.items() if (description := find(seen)) is not None}
    for stronger, weaker in (
        ("votes", "winner-loser"), ("votes", "ranking"), ("votes", "best-worst"), ("ccr", "ratings"),
        ("best-worst", "ratings"), ("wins", "winner-loser"),
    ):  # fmt: skip
        if stronger in matches:
            matches.pop(weaker, None)
    if len(matches) > 1 and "ratings" in matches and seen.is_empty(matches["ratings"].columns["rating"][0]):
        matches.pop("ratings")
    if "votes" in matches and "ccr" in matches and "rating" not in seen.told.columns:
        rating = matches["ccr"].columns["rating"][0]
        if plain(rating) not in ("rating", "ratings"):
            matches.pop("ccr")  # a `score` beside the choice; it is named as not used
    if not matches:
        return None
    if len(matches) > 1:
        raise _several(matches)
    (description,) = matches.values()
    if description.holds == VOTES and description.layout in ("rows", "won"):
        _ask_about_counts(seen, description)
    if description.holds == VOTES and description.layout == "rows":
        return _with_meaning(seen, description)
    return description


def _several(matches: Mapping[str, Description]) -> QuestionError:
    kinds = {
        "votes": "votes: {choice} says which item is preferred", "ccr": "comparison ratings: {rating} is the grade",
        "ratings": "ratings of {condition} in {rating}", "wins": "counts of wins",
        "ranking": "rankings in {rank}", "winner-loser": "votes: a winner and a loser", "best-worst": "best and worst",
    }  # fmt: skip
    readings = []
    for name, description in matches.items():
        names = {role: repr(JOIN.join(theirs)) for role, theirs in description.columns.items()}
        told = Told(format=name)
        for role in ("choice", "rating", "rank"):
            if role in description.columns:
                told = Told(columns={role: JOIN.join(description.columns[role])})
        readings.append(Reading(kinds[name].format_map(names), told))
    return QuestionError(f"the columns can be read in {len(readings)} ways", readings)


def _says(seen: _Seen, *roles: str) -> bool:
    """Did the user name a column of one of these roles?"""
    return bool(set(roles) & set(seen.given))


def _votes(seen: _Seen) -> Description | None:
    """Find votes: two items and which is preferred."""
    if _says(seen, "rating", "condition", "winner", "loser", "wins_a", "rank") and not _says(seen, "choice"):
        return None
    if seen.told.format == "ratings":
        return None
    binaries = tuple(name for known in BINARY_CHOICES.values() for name in known)
    choices = seen.candidates("choice", binaries)
    if "choice" not in seen.told.columns:
        choices = [name for name in choices if not seen.is_empty(name) or not len(seen.table) or seen.is_own]
        if seen.is_own and "choice" in choices and seen.is_empty("choice") and _rating_of(seen):
            return None  # a study's own table of ratings
    pairs = seen.pairs
    if not pairs or not choices:
        return None
    item_a, item_b = _one_pair(seen, pairs, choices)
    if seen.told.format != "ccr" and "choice" not in seen.given and len(choices) > 1:
        choices = _agreeing(seen, choices, (item_a, item_b))
    columns = _items(item_a, item_b) | {"choice": seen.given.get("choice") or (choices[0],)}
    who = seen.who_and_what()
    columns = {role: names for role in ("participant", "dataset") if (names := who.get(role))} | columns
    taken = [name for names in columns.values() for name in names]
    return Description(VOTES, columns | seen.optional(OPTIONAL, taken))


def _items(item_a: str, item_b: str) -> dict[str, tuple[str, ...]]:
    return {"item_a": tuple(item_a.split(JOIN)), "item_b": tuple(item_b.split(JOIN))}


def _one_pair(seen: _Seen, pairs: Sequence[tuple[str, str]], choices: Sequence[str]) -> tuple[str, str]:
    """Return the columns of the two items, asking where there are several such pairs."""
    if len(pairs) == 1:
        return pairs[0]
    first = pairs[0]
    others = [pair for pair in pairs[1:] if any(not seen._same(a, b) for a, b in zip(first, pair, strict=True))]
    if plain(first[0]) == "itema":
        words = {word.lower() for name in choices for word in seen.column(name).filled}
        others = [pair for pair in others if words & set(ENDS[(ends_of(pair[0]) or ("", 0, 0))[1]]) - {"a", "b"}]
    if not others:
        return first
    readings = [
        Reading(f"the items are {a!r} and {b!r}", Told(columns={"item_a": a, "item_b": b})) for a, b in (first, *others)
    ]
    raise QuestionError(f"{len(readings)} pairs of columns may name the two items", readings)


def _agreeing(seen: _Seen, choices: Sequence[str], pair: tuple[str, str]) -> list[str]:
    """Return columns that may be the choice, if all of them say the same; else ask."""
    items = [joined_column(seen.table, names) for names in _items(*pair).values()]
    matches = []
    for name in choices:
        asked = Asked(seen.column(name), items[0], items[1], (pair[0], pair[1]), is_own=seen.is_own)
        try:
            matches.append(codes_of(understand_choices(asked, seen.told.choices), asked))
        except QuestionError:
            matches.append(np.full(len(seen.table), -2, np.int8))
    if all((codes == matches[0]).all() and (codes != -2).all() for codes in matches):
        return list(choices)
    readings = [Reading(f"the choice is the column {name!r}", Told(columns={"choice": name})) for name in choices]
    raise QuestionError(f"{len(readings)} columns may be the choice, and do not say the same", readings)


def _rating_of(seen: _Seen, *, weak: bool = False) -> tuple[str, ...]:
    """Return the column of ratings that is not empty."""
    names = seen.one("rating") or (seen.one("rating", WEAK_RATINGS) if weak else ())
    return names if names and (not seen.is_empty(names[0]) or not len(seen.table)) else ()


def _comparisons(seen: _Seen) -> Description | None:
    """Find comparison ratings: two items and how much better the second is."""
    is_other = _says(seen, "choice", "condition", "winner", "wins_a", "rank") and not _says(seen, "rating")
    if is_other and seen.told.format != "ccr":
        return None
    if seen.told.format in ("votes", "ratings"):
        return None
    rating = _rating_of(seen)
    if not rating and seen.told.format == "ccr":
        rating = tuple(seen.candidates("choice")[:1])
    if not rating or not seen.pairs:
        return None
    item_a, item_b = _one_pair(seen, seen.pairs, ())
    columns = seen.who_and_what() | _items(item_a, item_b) | {"rating": rating}
    taken = [name for names in columns.values() for name in names]
    optional = seen.optional(RATING_OPTIONAL, taken)
    if {"protocol", "role"} <= set(optional) and set(seen.column(optional["protocol"][0]).filled) - {"ccr", "CCR"}:
        columns = {role: names for role, names in columns.items() if role not in ("item_a", "item_b")}
        columns["condition"] = (item_b,)  # a study's own table: what ACR, ACR-HR and DCR rate
        optional.pop("first_shown", None)
        return Description(RATINGS, columns | optional)
    optional.pop("reference", None)
    choice = seen.column(rating[0])
    words = {word.lower(): grade for word in choice.filled if (grade := grade_of(word)) is not None}
    notes = ("grades say how much better item_b is than item_a",)
    return Description(COMPARISONS, columns | optional, words=words, notes=notes)


def _ratings(seen: _Seen) -> Description | None:
    """Find ratings of single items: who rated what, and how."""
    if _says(seen, "choice", "item_a", "item_b", "winner", "wins_a", "rank") and not _says(seen, "rating", "condition"):
        return None
    if seen.told.format == "votes":
        return None
    if not _says(seen, "condition", "rating") and {"item_a", "item_b"} <= {plain(n) for n in seen.table.names}:
        return None
    rating = _rating_of(seen, weak=True) or seen.one("rating")
    condition = _condition_of(seen) if rating else ()
    if not rating or not condition:
        return None
    columns = seen.who_and_what() | {"condition": condition, "rating": rating}
    if "participant" not in columns:
        if "rating" not in seen.given and len(_rated(seen, [*condition])) > FEWEST_RATED:
            return None  # a column for each participant, and one more
        raise VotesError(
            f"lacks the column participant; found {named(seen.table.names)}; who rated? --columns participant=…"
        )
    taken = [name for names in columns.values() for name in names]
    optional = seen.optional(RATING_OPTIONAL, taken)
    optional.pop("first_shown", None)
    is_worded = {word.lower() for word in seen.column(rating[0]).filled} <= set(GRADES)
    note = "words are grades: excellent is 5, bad is 1" if is_worded and not seen.is_empty(rating[0]) else ""
    return Description(RATINGS, columns | optional, words=GRADES if note else {}, notes=(note,) if note else ())


def _condition_of(seen: _Seen) -> tuple[str, ...]:
    """Return the column of conditions; where a PVS is a scene and an HRC, the HRC."""
    matches = seen.candidates("condition")
    dataset = seen.one("dataset")
    if "condition" in seen.given or len(matches) < 2 or not dataset:
        return seen.one("condition")
    within = {name: joined_column(seen.table, (*dataset, name)) for name in matches}
    first = within[matches[0]]
    for column in within.values():
        pairs = len(np.unique(first.codes.astype(np.int64) * len(column.words) + column.codes))
        if not pairs == len(first.seen) == len(column.seen):
            return seen.one("condition")
    return (min(matches, key=lambda name: len(seen.column(name).seen)),)


def _won(seen: _Seen) -> Description | None:
    """Find a winner and a loser in each row."""
    more = {"winner": ("chosen",), "loser": ()}  # chosen beside rejected
    names = {role: seen.given.get(role) or tuple(seen.candidates(role, more[role])[:1]) for role in more}
    if not all(names.values()) or _says(seen, "item_a", "choice", "rating"):
        return None
    columns = seen.who_and_what() | {"item_a": names["winner"], "item_b": names["loser"]}
    taken = [name for theirs in columns.values() for name in theirs]
    winner, loser = names["winner"][0], names["loser"][0]
    note = f"item_a is the column {winner}, item_b the column {loser}, and item_a is always preferred"
    return Description(VOTES, columns | seen.optional(OPTIONAL, taken), "won", notes=(note,))


def _wins(seen: _Seen) -> Description | None:
    """Find counts of wins of either item, and of ties, in each row."""
    counts = {role: seen.one(role) for role in ("wins_a", "wins_b", "ties")}
    if not (counts["wins_a"] and counts["wins_b"] and seen.pairs):
        return None
    item_a, item_b = _one_pair(seen, seen.pairs, ())
    columns = seen.who_and_what() | _items(item_a, item_b) | {role: names for role, names in counts.items() if names}
    note = "each row counts the wins of either item"
    return Description(VOTES, columns, "wins", notes=(note,))


NOT_INDEPENDENT = "pairs of one ranking are not independent; intervals are over participants, so they stay right"


def _ranking(seen: _Seen) -> Description | None:
    """Find the rank of an item in each row."""
    rank = seen.given.get("rank") or tuple(n for n in seen.free if plain(n) in ("rank", "ranking"))[:1]
    condition = _condition_of(seen) if rank else ()
    who = seen.who_and_what()
    if not rank or not condition or "participant" not in who or _rating_of(seen):
        return None
    columns = who | {"condition": condition, "rank": rank}
    trial = tuple(name for name in seen.candidates("trial")[:1])
    note = f"a rank in each row, 1 is best; turned into pairs; {NOT_INDEPENDENT}"
    return Description(VOTES, columns | ({"trial": trial} if trial else {}), "ranking", notes=(note,))


RANKED = re.compile(
    r"^(?:rank(?:ed|ing)?|place|choice|position|preference)?(\d+)(?:st|nd|rd|th)?(?:rank|place|choice)?$"
)


def _place_in(name: str) -> int | None:
    """Return the place that a column such as rank_1, 2nd or "third choice" is named by; None for others."""
    letters = plain(name)
    for place, word in enumerate(("first", "second", "third", "fourth", "fifth", "sixth"), start=1):
        letters = re.sub(rf"^{word}|{word}$", str(place), letters)
    match = RANKED.match(letters)
    return int(match[1]) if match and not plain(name).isdigit() else None


def _ranked_columns(seen: _Seen) -> Description | None:
    """Find a ranking in each row: rank_1, rank_2, …, whose cells name the items."""
    places = {name: place for name in seen.free if (place := _place_in(name)) is not None}
    if len(places) < FEWEST_RANKED or sorted(places.values()) != list(range(1, len(places) + 1)):
        return None
    if all(is_numeric(seen.column(name)) for name in places):
        return None
    spread = {name: (str(place),) for name, place in sorted(places.items(), key=lambda matches: matches[1])}
    note = f"a ranking of {len(places)} in each row, {next(iter(spread))} is best; turned into pairs; {NOT_INDEPENDENT}"
    return Description(VOTES, seen.who_and_what(), "ranking", spread, "condition", notes=(note,))


def _best_worst(seen: _Seen) -> Description | None:
    """Find the best and the worst of several items in each row."""
    names = {role: seen.given.get(role) or tuple(seen.candidates(role)[:1]) for role in ("best", "worst")}
    if not all(names.values()):
        return None
    options = seen.given.get("options") or tuple(
        name
        for name in seen.free
        if re.fullmatch(r"(option|item|stimulus|alternative|candidate|choice|object)s?\d*", plain(name))
    )
    if not options:
        raise VotesError(
            "has columns best and worst, and none of the items they were chosen of: --columns options=item1+item2+…"
        )
    note = f"the best and the worst of several, turned into pairs; {NOT_INDEPENDENT}"
    columns = seen.who_and_what() | names | {"options": options}
    return Description(VOTES, columns, "best-worst", notes=(note,))


BY_NAMES: dict[str, Finder] = {
    "votes": _votes,
    "ccr": _comparisons,
    "winner-loser": _won,
    "wins": _wins,
    "ratings": _ratings,
    "best-worst": _best_worst,
    "ranking": lambda seen: _ranking(seen) or _ranked_columns(seen),
}


def _wide_ratings(seen: _Seen) -> Description | None:
    """Find ratings in many columns: one for each condition, or one for each participant."""
    told = seen.given.get("rating", ())
    who = {role: names for role in ("participant", "condition") if (names := _quietly(seen, role))}
    rated = list(told) if len(told) > 1 else [] if told else _rated(seen, [n for names in who.values() for n in names])
    if len(who) != 1 or len(rated) < FEWEST_RATED:
        return None
    if len(told) < 2:
        _ask_if_something_else(seen, rated, who)
    (role,) = who
    stands = "condition" if role == "participant" else "participant"
    dataset = {"dataset": names} if (names := seen.one("dataset")) else {}
    taken = [*rated, *who[role], *(n for names in dataset.values() for n in names)]
    note = f"a row for each {role}, a column for each of {len(rated)} {stands}s"
    return Description(
        RATINGS,
        who | dataset | seen.optional(("practice", "excluded"), taken),
        "wide",
        {name: (name,) for name in rated},
        stands,
        without=_summaries(seen, who[role]),
        notes=(note,),
    )


def _quietly(seen: _Seen, role: str) -> tuple[str, ...]:
    return _condition_of(seen) if role == "condition" else seen.one(role)


def _rated(seen: _Seen, taken: Sequence[str]) -> list[str]:
    """Return the columns of numbers that may be ratings by or of something."""
    others = {*taken, *seen.one("dataset")}
    return [name for name in seen.free if name not in others and not is_never(name) and is_numeric(seen.column(name))]


def _ask_if_something_else(seen: _Seen, rated: Sequence[str], who: Mapping[str, tuple[str, ...]]) -> None:
    """Ask where columns of numbers may be something else than ratings, in all or in some of them."""
    if seen.told.format == "ratings":
        return
    whole = Reading(f"ratings of or by {named(rated)}", Told(columns={"rating": JOIN.join(rated)}))
    rows = joined_column(seen.table, [name for names in (*who.values(), seen.one("dataset")) for name in names])
    if len(rows.seen) < len(rows):
        as_votes = Told(columns={"item_a": rated[0], "item_b": rated[1], "choice": rated[-1]})
        readings = [Reading(f"{whole.text}, more than once", whole.told)]
        if len(rated) > FEWEST_RATED:
            readings.append(Reading("votes, if columns name two items and the choice, such as", as_votes))
        raise QuestionError(f"{', '.join(who)} {shown(_repeated(rows))} has several rows of numbers", readings)
    roles = [name for name in rated if means("choice", name) or means("rank", name) or means("rating", name)]
    if roles or (seen.pairs and len(rated) > len(seen.pairs[0]) and set(seen.pairs[0]) <= set(rated)):
        readings = [whole]
        if seen.pairs:
            a, b = seen.pairs[0]
            choice = next((name for name in rated if name not in (a, b)), "…")
            columns = {"item_a": a, "item_b": b, "choice": choice}
            readings.insert(0, Reading(f"votes on the items in {a!r} and {b!r}", Told(columns=columns)))
        for name in roles:
            rest = [other for other in rated if other != name]
            if len(rest) >= FEWEST_RATED:
                readings.append(Reading(f"ratings without {name!r}", Told(columns={"rating": JOIN.join(rest)})))
        raise QuestionError(f"the numbers in {named(rated)} can be read in {len(readings)} ways", readings)
    dashed = [pair[:2] for name in rated if (pair := pair_in(name)) is not None]
    if len(dashed) == len(rated) and max(Counter(item for pair in dashed for item in pair).values()) > 1:
        votes = Reading(
            "choices of pairs, whose numbers --choices explains", Told(columns={"choice": JOIN.join(rated)})
        )
        raise QuestionError(f"{named(rated)} may be named by pairs", [votes, whole])
    odd = _odd_names(rated)
    if odd:
        rest = [name for name in rated if name not in odd]
        raise QuestionError(
            f"{named(odd)} may be something else than {named(rest)}",
            [whole, Reading(f"ratings without {named(odd)}", Told(columns={"rating": JOIN.join(rest)}))],
        )
    values = {value for name in rated for value in values_of(seen.column(name))}
    if len(values) == 2 and values <= {0.0, 1.0, 2.0} and len(seen.table) > 1:
        raise QuestionError(
            f"the cells of {named(rated)} are only {' and '.join(f'{value:g}' for value in sorted(values))}: ratings, "
            "or choices (name a column of choices by its pair, such as 'x vs y')",
            [Reading("ratings", Told(format="ratings"))],
        )
    if _are_ranks(seen, rated):
        readings = [
            Reading("ratings, more is better", Told(format="ratings")),
            Reading("ranks, 1 is best", Told(format="ranking")),
        ]
        raise QuestionError(f"each row of {named(rated)} holds the numbers from 1 to {len(rated)}", readings)


def _repeated(column: Column) -> str:
    """Return a text that several cells have."""
    return column.words[int(np.argmax(np.bincount(column.codes, minlength=len(column.words))))]


def _odd_names(rated: Sequence[str]) -> list[str]:
    """Return names that do not look like most of the others, c1, c2, …; or that speak of a number about people."""
    odd = [
        name
        for name in rated
        if {*re.split(r"[\W_]+", name.lower())} & (NEVER - {"", "n"}) or plain(name) == "id" or is_suspicious(name)
    ]
    stems: dict[str, list[str]] = {}
    for name in rated:
        stems.setdefault(re.sub(r"\d+", "#", plain(name)), []).append(name)
    counted = {stem: names for stem, names in stems.items() if "#" in stem and len(names) > 1}
    if len(counted) == 1 and len(stems) > 1:
        (kept,) = counted.values()
        odd += [name for name in rated if name not in kept and name not in odd]
    return odd if len(odd) < len(rated) else []


def _are_ranks(seen: _Seen, rated: Sequence[str]) -> bool:
    if len(rated) < FEWEST_RANKED or len(seen.table) < 2:
        return False
    cells = np.stack([seen.column(name).texts for name in rated], axis=1)
    wanted = sorted(str(place) for place in range(1, len(rated) + 1))
    return all(sorted(row) == wanted for row in cells.tolist())


def _summaries(seen: _Seen, names: Sequence[str]) -> tuple[int, ...]:
    """Return the rows of a wide table whose name is that of a statistic: they are nobody's."""
    column = seen.column(names[0])
    if names[0] in {name for theirs in seen.given.values() for name in theirs}:
        return ()
    is_summary = column.meaning(lambda word: plain(word) in SUMMARIES, bool)
    return tuple(np.flatnonzero(is_summary).tolist())


def _wide_ranks(seen: _Seen) -> Description | None:
    """Take ranks in many columns, one for each item: only if told, as they look like ratings."""
    told = seen.given.get("rank", ())
    who = seen.who_and_what()
    rated = list(told) if len(told) > 1 else _rated(seen, [name for names in who.values() for name in names])
    if len(rated) < FEWEST_RATED:
        return None
    note = f"ranks of {len(rated)} items in each row, 1 is best; turned into pairs; {NOT_INDEPENDENT}"
    return Description(VOTES, who, "ranks", {name: (name,) for name in rated}, "condition", notes=(note,))


FINDERS: dict[str, Finder] = {
    "matrix": _matrix,
    "pairs": _wide_pairs,
    "names": _by_names,
    "cells": _wide_ratings,
}


def _first(*finders: Finder) -> Finder:
    def find(seen: _Seen) -> Description | None:
        return next((matches for finder in finders if (matches := finder(seen)) is not None), None)

    return find


# What `--format` may name, beside programs; each allows one kind of reading.
LAYOUTS: dict[str, Finder] = {
    "votes": _first(_wide_pairs, lambda seen: _meant(seen, _votes(seen)), _won, _wins, _matrix),
    "ratings": _first(_ratings, _wide_ratings),
    "ccr": _first(_comparisons, _wide_pairs),
    "winner-loser": _won,
    "wins": _wins,
    "matrix": _matrix,
    "ranking": _first(_ranking, _ranked_columns, _wide_ranks),
    "best-worst": _best_worst,
}


def _meant(seen: _Seen, description: Description | None) -> Description | None:
    return None if description is None else _with_meaning(seen, description)


def _lacking(seen: _Seen) -> str:
    """Say what a table lacks, for what it comes nearest to."""
    names = seen.table.names
    given = seen.given
    is_rated = bool(_quietly(seen, "condition") or seen.candidates("rating") or "rating" in given) and not seen.pairs
    wanted = ("participant", "condition", "rating") if is_rated else ("item_a", "item_b", "choice")
    pair = seen.pairs[0] if seen.pairs else None
    there = {
        role for role in wanted if role in given or seen.candidates(role) or (pair and role in ("item_a", "item_b"))
    }
    missing = [role for role in wanted if role not in there] or ["choice"]
    return (
        f"lacks {'the column' if len(missing) == 1 else 'the columns'} {', '.join(missing)}; found "
        f"{named(names) or 'none'}. Map other names, e.g. --columns participant=judge, or item_a=type+level for an "
        "item in two columns; ratings have the columns participant, condition and rating, or one for each condition "
        "(--columns rating=c1+c2+c3 names them); --format names a layout"
    )


def _with_lists(seen: _Seen, description: Description) -> Description:
    """Complete a description with the columns that are not used, and what to be warned of."""
    used = {name for names in description.columns.values() for name in names} | set(description.spread)
    rest = tuple(name for name in seen.table.names if name not in used)
    warnings = [*description.warnings]
    for name in rest:
        column = seen.column(name)
        words = column.filled if len(column.words) <= 50 else ()
        if SEVERAL.search(name) and len(column.filled) > 1:
            warnings.append(
                f"the column {name!r} is not used: what it tells apart ({named([repr(word) for word in words[:4]])}) "
                f"counts as the same; {Told(columns={'dataset': name})} keeps it apart"
            )
        elif is_suspicious(name, words) and (column.filled or not len(seen.table)):
            role = next((r for r in ("practice", "excluded", "dataset") if r not in description.columns), "excluded")
            holds = named([repr(word) for word in column.filled[:4]]) or "nothing"
            warnings.append(
                f"the column {name!r} is not used, and looks as if it said that rows should not count or are apart "
                f"(it holds {holds}); {Told(columns={role: name})} uses it"
            )
    warnings += _odd_cells(seen, description)
    if description.without:
        names = [seen.column(next(iter(description.columns.values()))[0]).texts[row] for row in description.without]
        rows = ", ".join(str(seen.table.row(row)) for row in description.without)
        warnings.append(f"row {rows} is not used: {', '.join(map(repr, names))} is nobody but a summary")
    return replace(description, not_used=rest, warnings=tuple(warnings))


def _odd_cells(seen: _Seen, description: Description) -> list[str]:
    """Warn of names that a spreadsheet made of others: shortened numbers and dates."""
    warnings = []
    roles = ("participant", "dataset", "condition", "item_a", "item_b")
    named_in = {name: seen.column(name).filled for role in roles for name in description.columns.get(role, ())}
    named_in["a column"] = tuple(label for labels in description.spread.values() for label in labels)
    for name, words in named_in.items():
        if words:
            for pattern, what in ((SHORTENED, "a long id that a spreadsheet shortened: different ones may look alike"),
                                  (DATE, "a date, which a spreadsheet may have made of another name")):  # fmt: skip
                odd = [word for word in words if pattern.fullmatch(word)]
                if odd:
                    warnings.append(f"{name} is {shown(odd[0])}, {what}")
    return warnings
