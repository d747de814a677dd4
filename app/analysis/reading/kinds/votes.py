"""Find votes in a table: pairs in rows or in columns, winners, counts; and what the choices mean."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from app.analysis.reading.cells import Column, is_numeric, named, number_or_nan, shown, values_of
from app.analysis.reading.choices import (
    Asked,
    Meaning,
    binary_meaning,
    codes_of,
    grade_of,
    number_codes,
    understand_choices,
)
from app.analysis.reading.description import JOIN, VOTES, Description, QuestionError, Reading, Told
from app.analysis.reading.kinds.seen import (
    NOT_USED,
    WIDE_ROLES,
    Seen,
    as_grades,
    item_columns,
    names_in,
    one_pair,
    rating_of,
    says,
    summaries,
    with_people_alone,
)
from app.analysis.reading.layouts import joined_column, rows_of
from app.analysis.reading.votes_table import VotesError
from app.analysis.reading.words import (
    BINARY_CHOICES,
    COMMENTS,
    ENDS,
    MOST_PLACES,
    MULTIPLE,
    OPTIONAL,
    PLACED,
    SUMMARIES,
    SWAPPED,
    TRUE_FALSE,
    pairs_in,
    plain,
)

TO_MATCH = ("x", "stimulusx", "stimx", "samplex", "videox", "clipx", "imagex")
MOST_TOTALS = 5  # rows of a matrix that are no item's
LOSERS_FIRST = re.compile(r"^\W*(los(er|t|es|ing)|verlierer|perdant)", re.IGNORECASE)  # of a matrix
FEWEST_DOUBTED = 3  # items of a matrix; two may well have won as often
FEWEST_DASHED = 2  # columns named "x - y"; a single one may be anything


def find_matrix(seen: Seen) -> Description | None:
    """Find a matrix of win counts: the same names in the first column and the header."""
    names = [name.strip() for name in seen.table.names]
    if set(seen.told.columns) - {"participant", "dataset"} or len(names) < 3:
        return None
    first = seen.column(seen.table.names[0])
    if len(first) > len(names) + MOST_TOTALS:
        return None
    spread = {name: (name.strip(),) for name in seen.table.names[1:] if plain(name) not in SUMMARIES}
    totals = summaries(first)
    items = [name for row, name in enumerate(first.texts) if row not in totals]
    if len(items) != len(spread) or len(items) < 2 or set(items) != {item for (item,) in spread.values()}:
        return None
    if LOSERS_FIRST.search(names[0]):
        raise VotesError(f"is a matrix of {shown(names[0])}, expected winners in rows: exchange its rows and columns")
    note = f"a matrix of win counts of {len(items)} items, of the row over the column"
    columns = {"item_a": (seen.table.names[0],)}
    doubts = _doubts_of_matrix(seen, [items.index(name) for name in spread], [*spread], totals)
    return Description(VOTES, columns, "matrix", spread, "condition", without=totals, notes=(note,), warnings=doubts)


def _doubts_of_matrix(seen: Seen, order: Sequence[int], names: Sequence[str], totals: Sequence[int]) -> tuple[str, ...]:
    """Say why a matrix may be none of wins: it is the same both ways, or only one side of the diagonal is filled."""
    columns = [np.delete(seen.column(name).meaning(number_or_nan, np.float64), totals) for name in names]
    cells = np.nan_to_num(np.stack(columns, axis=1)[np.asarray(order)])
    np.fill_diagonal(cells, 0)
    if len(names) < FEWEST_DOUBTED or not cells.any():
        return ()
    if (cells == cells.T).all():
        return ("the matrix is the same both ways: is it the number of comparisons rather than of wins?",)
    if not np.triu(cells).any() or not np.tril(cells).any():
        return ("only one side of the diagonal is filled: the other item of each pair is taken never to have won",)
    return ()


def find_wide_pairs(seen: Seen) -> Description | None:
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
    description = Description(
        VOTES,
        who | seen.optional(("practice", "excluded", "reason"), names_in(who) | {*spread}),
        "wide",
        spread,
        "pair",
        notes=(f"a wide table with a column for each of {len(spread)} pairs",),
        warnings=_same_pairs(spread),
    )
    return with_meaning(seen, description)


def _same_pairs(spread: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Warn where columns are the same pair under names that differ by more than a number: of another scene?"""
    alike: dict[frozenset[str], dict[str, str]] = {}
    for name, pair in spread.items():
        heading = re.sub(r"\d+", "", name.replace(pair[0], "").replace(pair[1], ""))
        alike.setdefault(frozenset(pair), {}).setdefault(heading, name)
    several = [names.values() for names in alike.values() if len(names) > 1]
    return tuple(
        f"the columns {named([*map(repr, names)])} are the same pair and count together; a file for each scene keeps "
        "them apart"
        for names in several
    )


def _told_pairs(seen: Seen) -> dict[str, tuple[str, ...]]:
    """Return the pairs of the columns that were told to hold choices or grades."""
    for role in WIDE_ROLES:
        names = seen.given.get(role, ())
        pairs = {name: pair[:2] for name, pair in pairs_in(names).items()}
        if names and len(pairs) == len(names):
            return dict(pairs)
    return {}


def _named_pairs(seen: Seen) -> dict[str, tuple[str, ...]]:
    """Return the columns that are named by a pair; "x vs y Comment" is none, and a dash needs more than itself."""
    if set(seen.told.columns) & {"item_a", "item_b", "choice", "rating", "condition", "winner", "loser"}:
        return {}
    if any(plain(name) in ("itema", "itemb") for name in seen.free):
        return {}
    matches = pairs_in(name for name in seen.free if not COMMENTS.search(name))
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


def with_meaning(seen: Seen, description: Description) -> Description:
    """Complete a description of votes with what its choices mean; grades make it one of comparisons."""
    description = with_people_alone(seen, description)
    rows = rows_of(seen.table, description)
    choice, item_a, item_b = (rows.columns[name] for name in ("choice", "item_a", "item_b"))
    if seen.told.format == "ccr":
        return as_grades(description, choice)
    is_graded = is_numeric(choice) and any(value != int(value) or not -1 <= value <= 3 for value in values_of(choice))
    are_items = set(choice.filled) <= {*item_a.filled, *item_b.filled}
    name_a, name_b = (JOIN.join(description.columns.get(role, (role,))) for role in ("item_a", "item_b"))
    if is_graded and not are_items and not number_codes(choice) and not {"a", "b", "by"} & set(seen.told.choices):
        raise _ask_whose_grades(description, choice, name_a, name_b)
    asked = Asked(
        choice,
        item_a,
        item_b,
        (name_a, name_b),
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


def _ask_whose_grades(description: Description, choice: Column, item_a: str, item_b: str) -> QuestionError:
    about = f"the choices {named(sorted(choice.filled)[:6])} are numbers"
    if description.layout != "rows":
        return QuestionError(about, [Reading("grades, how much better the second item is", Told(format="ccr"))])
    turned = Told(columns={"item_a": item_b, "item_b": item_a}, format="ccr")
    better = "grades, how much better {} is than {}"
    readings = [Reading(better.format(item_b, item_a), Told(format="ccr")),
                Reading(better.format(item_a, item_b), turned)]  # fmt: skip
    return QuestionError(about, readings)


def _binary(seen: Seen, description: Description) -> Meaning | None:
    """Return the meaning of a column such as `is_A_selected`."""
    names = description.columns.get("choice", ())
    if len(names) != 1 or {"a", "b", "by"} & set(seen.told.choices):
        return None
    for side, known in BINARY_CHOICES.items():
        meaning = binary_meaning(side)
        if plain(names[0]) in known and {word.lower() for word in seen.column(names[0]).filled} <= meaning.words.keys():
            return meaning
    return None


def _ask_about_sides(seen: Seen, description: Description, asked: Asked, meaning: Meaning) -> None:
    """Ask where a column that is not used may say which item stood where, or what else an answer was about."""
    if description.layout != "rows" or {"a", "b", "by"} & set(seen.told.choices):
        return
    sides = [word for word in meaning.expected.split(" or ") if word in {end for ends in ENDS[1:] for end in ends}]
    if sides and not sides[0].isdigit() and sides[0] in plain(asked.names[0]):
        sides = []  # the items' own columns are called by the sides
    items = {*asked.item_a.filled, *asked.item_b.filled}
    used = names_in(description.columns)
    for name in seen.table.names:
        speaks = SWAPPED.search(name) or PLACED.search(name) if len(sides) > 1 and not meaning.by_item else None
        if not (speaks or plain(name) in TO_MATCH):
            continue  # the cells of few columns are looked at
        column = seen.column(name)
        holds_items = bool(column.filled) and set(column.filled) <= items
        if plain(name) in TO_MATCH and name not in used and holds_items:
            reading = Reading("answers say which of the two is preferred", Told(choices={"by": "side"}))
            raise QuestionError(
                f"the column {name!r} may be what the two were to be compared with (ABX); matches are no preferences",
                [reading],
            )
        is_told = name in used and name not in description.columns.get("first_shown", ())
        if not speaks or is_told or not len(column.filled) > 1:
            continue
        is_place = len(column.filled) <= MOST_PLACES and "trial" not in plain(name) and not holds_items
        names_side = holds_items and any(side in plain(name) for side in sides if not side.isdigit())
        theirs = asked.item_a if sides[0] in plain(name) else asked.item_b
        if SWAPPED.search(name) or is_place or (names_side and (column.texts != theirs.texts).any()):
            told = Told(choices={"a": sides[0], "b": sides[1]})
            raise QuestionError(
                f"choices are {sides[0]} and {sides[1]}, and the column {name!r} may say that items stood the other "
                "way round in some rows (if so, give the items as they stood as item_a and item_b)",
                [Reading(f"{sides[0]} is {asked.names[0]} and {sides[1]} is {asked.names[1]} in all rows", told)],
            )


def ask_about_counts(seen: Seen, description: Description) -> None:
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


def find_votes(seen: Seen) -> Description | None:
    """Find votes: two items and which is preferred."""
    if says(seen, "rating", "condition", "winner", "loser", "wins_a", "rank") and not says(seen, "choice"):
        return None
    binaries = tuple(name for known in BINARY_CHOICES.values() for name in known)
    choices = seen.candidates("choice", binaries)
    if "choice" not in seen.told.columns:
        choices = [name for name in choices if not seen.is_empty(name) or not len(seen.table) or seen.is_own]
        if seen.is_own and "choice" in choices and seen.is_empty("choice") and rating_of(seen):
            return None  # a study's own table of ratings
    if not seen.pairs or not choices:
        return None
    item_a, item_b = one_pair(seen, seen.pairs, choices)
    if seen.told.format != "ccr" and "choice" not in seen.given and len(choices) > 1:
        choices = _agreeing(seen, choices, (item_a, item_b))
    choice = {"choice": seen.given.get("choice") or (choices[0],)}
    columns = seen.who_and_what() | item_columns(item_a, item_b) | choice
    return _with_ties(seen, Description(VOTES, columns | seen.optional(OPTIONAL, names_in(columns))))


def _with_ties(seen: Seen, description: Description) -> Description:
    """Use a column that says of each row whether nobody won, such as is_tie."""
    ties = seen.first("ties")
    if not ties or not {word.lower() for word in seen.column(ties[0]).filled} <= TRUE_FALSE.keys():
        return description
    note = f"rows whose {ties[0]} is true are no preference"
    return replace(description, columns={**description.columns, "ties": ties}, notes=(*description.notes, note))


def _agreeing(seen: Seen, choices: Sequence[str], pair: tuple[str, str]) -> list[str]:
    """Return columns that may be the choice, if all of them say the same; else ask."""
    items = [joined_column(seen.table, names) for names in item_columns(*pair).values()]
    asked = [Asked(seen.column(name), items[0], items[1], pair, is_own=seen.is_own) for name in choices]
    try:
        codes = [codes_of(understand_choices(each, seen.told.choices), each) for each in asked]
    except QuestionError:
        codes = []
    if codes and all((each == codes[0]).all() for each in codes):
        return list(choices)
    readings = [Reading(f"the choice is the column {name!r}", Told(columns={"choice": name})) for name in choices]
    raise QuestionError(f"{len(readings)} columns may be the choice, and do not say the same", readings)


def find_won(seen: Seen) -> Description | None:
    """Find a winner and a loser in each row."""
    more = {"winner": ("chosen",), "loser": ()}  # chosen beside rejected
    names = {role: seen.first(role, more[role]) for role in more}
    if not all(names.values()) or says(seen, "item_a", "choice", "rating"):
        return None
    columns = seen.who_and_what() | {"item_a": names["winner"], "item_b": names["loser"]}
    columns |= seen.optional(OPTIONAL, names_in(columns))
    winner, loser = names["winner"][0], names["loser"][0]
    note = f"item_a is the column {winner}, item_b the column {loser}, and item_a is always preferred"
    return _with_ties(seen, Description(VOTES, columns, "won", notes=(note,)))


def find_wins(seen: Seen) -> Description | None:
    """Find counts of wins of either item, and of ties, in each row."""
    counts = {role: seen.one(role) for role in ("wins_a", "wins_b", "ties")}
    if not (counts["wins_a"] and counts["wins_b"] and seen.pairs):
        return None
    item_a, item_b = one_pair(seen, seen.pairs, ())
    columns = (
        seen.who_and_what() | item_columns(item_a, item_b) | {role: names for role, names in counts.items() if names}
    )
    note = "each row counts the wins of either item"
    return Description(VOTES, columns, "wins", notes=(note,))
