"""Recognise a table: data in, a plain description out. The first half of reading.

What the user said decides, then pairs in the names of columns, then the names of columns, last what cells look like.
Where two readings fit, they are asked and not chosen.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace

import numpy as np

from app.analysis.reading.cells import Column, Table, is_numeric, n_different, named, shown, values_of
from app.analysis.reading.description import JOIN, RATINGS, VOTES, Description, QuestionError, Reading, Told
from app.analysis.reading.kinds.practice import TRIAL_NUMBER, Practice, practice_in
from app.analysis.reading.kinds.rankings import find_best_worst, find_ranked_columns, find_ranking, find_wide_ranks
from app.analysis.reading.kinds.ratings import find_comparisons, find_ratings, find_wide_ratings, quietly
from app.analysis.reading.kinds.seen import FEWEST_RATED, WIDE_ROLES, Finder, Seen, columns_of_numbers
from app.analysis.reading.kinds.votes import (
    ask_about_counts,
    find_matrix,
    find_votes,
    find_wide_pairs,
    find_wins,
    find_won,
    with_meaning,
)
from app.analysis.reading.layouts import joined_column
from app.analysis.reading.phrases import counted
from app.analysis.reading.votes_table import VotesError
from app.analysis.reading.words import (
    COUNTS,
    MOST_PLACES,
    MULTIPLE,
    PLACED,
    SEVERAL,
    SEVERAL_RUNS,
    SWAPPED,
    TRUE_FALSE,
    is_never,
    is_suspicious,
    plain,
)

MONTH = "(jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*"
# Names that a spreadsheet made of others: an id such as 5.6E+23, and dates.
ODD = {
    re.compile(r"\d([.,]\d+)?E\+?\d{2,}", re.IGNORECASE): (
        "a long id that a spreadsheet shortened: different ones may look alike"
    ),
    re.compile(
        rf"\d{{4}}-\d\d-\d\d([ T]00:00(:00)?)?|\d{{1,2}}-{MONTH}(-\d{{2,4}})?|{MONTH}-\d{{2,4}}", re.IGNORECASE
    ): "a date, which a spreadsheet may have made of another name",
}


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
    seen = Seen(table, told)
    for find in LAYOUTS.get(told.format, FINDERS):
        if (description := find(seen)) is not None:
            return _with_lists(seen, description)
    raise VotesError(_lacking(seen))


def _by_names(seen: Seen) -> Description | None:
    """Find what the names of the columns say: votes, comparisons, ratings, counts, rankings."""
    if any(len(seen.given.get(role, ())) > 1 for role in WIDE_ROLES):
        return None
    matches = {name: description for name, (find, _) in BY_NAMES.items() if (description := find(seen)) is not None}
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
        ask_about_counts(seen, description)
    if description.holds == VOTES and description.layout == "rows":
        return with_meaning(seen, description)
    return description


def _several(matches: Mapping[str, Description]) -> QuestionError:
    readings = []
    for name, description in matches.items():
        names = {role: repr(JOIN.join(theirs)) for role, theirs in description.columns.items()}
        told = Told(format=name)
        for role in ("choice", "rating", "rank"):
            if role in description.columns:
                told = Told({role: JOIN.join(description.columns[role])}, format=name if name == "ratings" else "")
        readings.append(Reading(BY_NAMES[name][1].format_map(names), told))
    return QuestionError(f"the columns can be read in {len(readings)} ways", readings)


BY_NAMES: dict[str, tuple[Finder, str]] = {
    "votes": (find_votes, "votes: {choice} says which item is preferred"),
    "ccr": (find_comparisons, "comparison ratings: {rating} is the grade"),
    "winner-loser": (find_won, "votes: a winner and a loser"),
    "wins": (find_wins, "counts of wins"),
    "ratings": (find_ratings, "ratings of {condition} in {rating}"),
    "best-worst": (find_best_worst, "best and worst"),
    "ranking": (lambda seen: find_ranking(seen) or find_ranked_columns(seen), "rankings in {rank}"),
}
FINDERS: tuple[Finder, ...] = (find_matrix, find_wide_pairs, _by_names, find_wide_ratings)


def _find_meant(seen: Seen) -> Description | None:
    return with_meaning(seen, description) if (description := find_votes(seen)) else None


# What `--format` may name, beside programs; each allows one kind of reading.
LAYOUTS: dict[str, tuple[Finder, ...]] = {
    "votes": (find_wide_pairs, _find_meant, find_won, find_wins, find_matrix),
    "ratings": (find_ratings, find_wide_ratings),
    "ccr": (find_comparisons, find_wide_pairs),
    "winner-loser": (find_won,),
    "wins": (find_wins,),
    "matrix": (find_matrix,),
    "ranking": (find_ranking, find_ranked_columns, find_wide_ranks),
    "best-worst": (find_best_worst,),
}


def _lacking(seen: Seen) -> str:
    """Say what a table lacks, for what it comes nearest to."""
    if len(seen.table.names) == 1 or sum(name.startswith("Unnamed: ") for name in seen.table.names[1:]) > 1:
        shape = "has a single column" if len(seen.table.names) == 1 else "has columns without names"
        names = named(seen.table.names) or "none"
        return f"{shape}; the first line is to name them, commas, semicolons, tabs or bars between; found {names}"
    is_rated = (quietly(seen, "condition") or seen.candidates("rating")) and not seen.pairs
    is_wide = len(columns_of_numbers(seen, ())) >= FEWEST_RATED and not (
        is_rated or seen.pairs or seen.candidates("choice")
    )
    rated = ("participant", "condition", "rating") if is_rated else ("participant",)
    wanted = rated if is_rated or is_wide else ("item_a", "item_b", "choice")
    there = {role for role in wanted if seen.candidates(role) or (seen.pairs and role in ("item_a", "item_b"))}
    missing = [role for role in wanted if role not in there] or ["choice"]
    return (
        f"lacks {'the column' if len(missing) == 1 else 'the columns'} {', '.join(missing)}; found "
        f"{named(seen.table.names) or 'none'}. Map other names, e.g. --columns participant=judge, or "
        "item_a=type+level for an item in two columns; ratings have the columns participant, condition and rating, or "
        "one for each condition (--columns rating=c1+c2+c3 names them); --format names a layout"
    )


def _with_lists(seen: Seen, description: Description) -> Description:
    """Complete a description with the columns that are not used, and what to be warned of."""
    used = {name for names in description.columns.values() for name in names} | set(description.spread)
    practice = _practice(seen, description, used)
    used |= {*practice.columns}
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
        elif _may_turn_choices(name, column, description):
            warnings.append(
                f"the column {name!r} is not used, and may say that items stood the other way round in some rows; "
                "if so, exchange item_a and item_b there"
            )
        elif REVERSED.search(name) and description.holds == RATINGS:
            warnings.append(f"the column {name!r} is not used, and may say that a scale is turned: {MORE_IS_BETTER}")
        elif is_suspicious(name, words) and (column.filled or not len(seen.table)):
            holds = named([repr(word) for word in column.filled[:4]]) or "nothing"
            warnings.append(
                f"the column {name!r} is not used, and looks as if it said that rows should not count or are apart "
                f"(it holds {holds}){_way_to_use(name, column, description)}"
            )
    warnings += _repeats(seen, description, [name for name in rest if not any(repr(name) in text for text in warnings)])
    warnings += _odd_cells(seen, description)
    warnings += [
        f"{name!r} may be a scale that is turned: {MORE_IS_BETTER}"
        for name in description.columns.get("rating", ())
        if description.holds == RATINGS and REVERSED.search(name)
    ]
    if description.without:
        names = [seen.column(next(iter(description.columns.values()))[0]).texts[row] for row in description.without]
        rows = ", ".join(str(seen.table.row(row)) for row in description.without)
        warnings.append(f"row {rows} is not used: {', '.join(map(repr, names))} is nobody but a summary")
    return replace(
        description,
        not_used=rest,
        without=(*description.without, *np.flatnonzero(practice.rows).tolist()),
        notes=(*description.notes, *practice.notes),
        warnings=(*warnings, *practice.warnings),
    )


def _practice(seen: Seen, description: Description, used: Set[str]) -> Practice:
    """Find rows of practice, unless a column says of each whether it is, or the user that no column numbers trials."""
    is_told = "practice" in seen.told.columns or ("trial" in seen.told.columns and "trial" not in seen.given)
    if is_told or "practice" in description.columns:
        return Practice(np.zeros(len(seen.table), bool))
    return practice_in(seen.table, used - {*description.columns.get("trial", ())})


def _may_turn_choices(name: str, column: Column, description: Description) -> bool:
    """May a column say which item stood where, in a table whose choices are sides?"""
    if description.holds != VOTES or description.layout != "rows" or description.by_item:
        return False
    speaks = SWAPPED.search(name) or (PLACED.search(name) and "trial" not in plain(name))
    return bool(speaks) and 1 < len(column.filled) <= MOST_PLACES


def _way_to_use(name: str, column: Column, description: Description) -> str:
    """Return what to do with a column that may say which rows count, where doing it can be right."""
    if len(column.filled) < 2:
        return ""
    if SWAPPED.search(name):
        return ""
    is_run = SEVERAL_RUNS.search(name)
    if is_run and "dataset" not in description.columns:
        return f"; {Told(columns={'dataset': name})} keeps them apart"
    if is_run or {TRUE_FALSE.get(word.strip().lower()) for word in column.filled} != {True, False}:
        return "; leave out rows that should not count"
    if COUNTS.search(name):
        return "; if rows of which it is false should not count, leave them out"
    role = next((role for role in ("practice", "excluded") if role not in description.columns), "")
    return f"; {Told(columns={role: name})} leaves out those of which it is true" if role else ""


REPEATABLE = ("rows", "won", "ranking", "ranked", "ranks", "best-worst")  # layouts whose rows may be one person's
REVERSED = re.compile(
    r"revers|invert|\b1\s*(=|:|is|means)\s*(the )?(best|excellent|very good|sehr gut)|schulnote", re.IGNORECASE
)
MORE_IS_BETTER = "more counts as better; turn the numbers round where it is not"
RUN = re.compile(r"session|phase|block|part$|run$|loop|repe", re.IGNORECASE)  # in which numbers may begin again
MOST_KINDS = 20  # different texts of a column that may tell repeated rows apart; more are numbers of trials


def _repeats(seen: Seen, description: Description, rest: Sequence[str]) -> list[str]:
    """Warn where rows of the same person, dataset and items are told apart by a column that is not used."""
    columns = description.columns
    what = [role for role in ("dataset", "condition", "item_a", "item_b") if role in columns]
    weights = [name for name in rest if description.holds != VOTES and plain(name) in (*MULTIPLE, "count", "counts")]
    warnings = [
        f"the column {name!r} is not used: each row is one rating"
        for name in weights
        if any(value != 1 for value in values_of(seen.column(name)))
    ]
    few = [
        name
        for name in rest
        if 1 < len(seen.column(name).filled) <= MOST_KINDS
        and not (is_never(name) and is_numeric(seen.column(name)))
        and name not in weights
    ]
    if "participant" not in columns and description.layout in REPEATABLE:
        warnings += [
            f"the column {name!r} is not used, and may name the participants: {Told(columns={'participant': name})} "
            "makes the intervals those over people"
            for name in rest
            if plain(name).endswith("id") and 1 < len(seen.column(name).filled) < len(seen.table)
        ]
    if description.layout not in REPEATABLE or "participant" not in columns or not len(seen.table):
        return warnings
    who = [joined_column(seen.table, columns[role]) for role in ("participant", *what)]
    trials = [name for name in seen.table.names if TRIAL_NUMBER.search(plain(name)) and seen.column(name).filled]
    if not (few or trials) or n_different(who) == len(seen.table):
        return warnings
    for name in few:
        if n_different([*who, seen.column(name)]) == len(seen.table):
            apart = Told(columns={"dataset": JOIN.join((*columns.get("dataset", ()), name))})
            others = Told(columns={"participant": JOIN.join((*columns["participant"], name))})
            warnings.append(
                f"rows of the same participant and items differ in the column {name!r}, which is not used: they count "
                f"as repeats; {apart} keeps them apart, {others} takes them for other people's"
            )
    return [*warnings, *_begun_again(seen, who, trials if description.layout in ("rows", "won") else ())]


def _begun_again(seen: Seen, who: Sequence[Column], trials: Sequence[str]) -> list[str]:
    """Warn where few rows of the same person, dataset and items also have the same number of a trial."""
    runs = [name for name in seen.table.names if RUN.search(name) and name not in trials]
    for name in trials:
        again = len(seen.table) - n_different([*who, *map(seen.column, (name, *runs))])
        if 0 < 2 * again < len(seen.table):
            has = "has" if again == 1 else "have"
            about = f"{counted(again, 'row')} of the same participant and items as another also {has} the same {name!r}"
            return [f"{about}: joined twice, or begun again? They count"]
    return []


def _odd_cells(seen: Seen, description: Description) -> list[str]:
    """Warn of names that a spreadsheet made of others: shortened numbers and dates."""
    warnings = []
    roles = ("participant", "dataset", "condition", "item_a", "item_b")
    named_in = {name: seen.column(name).filled for role in roles for name in description.columns.get(role, ())}
    named_in["a column"] = tuple(label for labels in description.spread.values() for label in labels)
    for name, words in named_in.items():
        for pattern, what in ODD.items():
            if odd := next(filter(pattern.fullmatch, words), None):
                warnings.append(f"{name} is {shown(odd)}, {what}")
    return warnings
