"""Find ratings in a table: of single items or of pairs, in rows or in columns."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from app.analysis.reading.cells import Column, named, number_or_nan, shown, values_of
from app.analysis.reading.description import COMPARISONS, JOIN, RATINGS, Description, QuestionError, Reading, Told
from app.analysis.reading.kinds.seen import (
    FEWEST_RANKED,
    FEWEST_RATED,
    Seen,
    as_grades,
    columns_of_numbers,
    condition_of,
    item_columns,
    names_in,
    one_pair,
    rated_columns,
    rating_of,
    says,
    summaries,
    with_people_alone,
)
from app.analysis.reading.layouts import joined_column
from app.analysis.reading.votes_table import VotesError
from app.analysis.reading.words import NEVER, RATING_OPTIONAL, grades_in, is_never, is_suspicious, means, pair_in, plain

ROUNDED = 0.006  # a mean of two decimals is nearer to the true one
FEWEST_AVERAGED = 3
MOST_LEVELS = 20  # different texts of a column that is part of a condition's name; more are numbers or names of rows


def find_comparisons(seen: Seen) -> Description | None:
    """Find comparison ratings: two items and how much better the second is."""
    is_other = says(seen, "choice", "condition", "winner", "wins_a", "rank") and not says(seen, "rating")
    if is_other and seen.told.format != "ccr":
        return None
    rating = rating_of(seen)
    if not rating and seen.told.format == "ccr":
        rating = tuple(seen.candidates("choice")[:1])
    if not rating or not seen.pairs:
        return None
    item_a, item_b = one_pair(seen, seen.pairs, ())
    columns = seen.who_and_what() | item_columns(item_a, item_b) | {"rating": rating}
    optional = seen.optional(RATING_OPTIONAL, names_in(columns))
    if {"protocol", "role"} <= set(optional) and set(seen.column(optional["protocol"][0]).filled) - {"ccr", "CCR"}:
        columns = {role: names for role, names in columns.items() if role not in ("item_a", "item_b")}
        columns["condition"] = (item_b,)  # a study's own table: what ACR, ACR-HR and DCR rate
        optional.pop("first_shown", None)
        return Description(RATINGS, columns | optional)
    optional.pop("reference", None)
    choice = seen.column(rating[0])
    is_sure = "rating" in seen.given or seen.told.format == "ccr" or plain(rating[0]) == "rating"
    if not is_sure and {*values_of(choice)} <= {0.0, 0.5, 1.0}:
        _ask_about_points(choice, rating[0], item_a, item_b)
    return as_grades(with_people_alone(seen, Description(COMPARISONS, columns | optional)), choice)


def _ask_about_points(column: Column, name: str, item_a: str, item_b: str) -> None:
    """Ask where grades of 0, 1/2 and 1 may be points, as of a game."""
    words = {number: word for word in column.filled if not math.isnan(number := number_or_nan(word))}
    points = {our: words[value] for our, value in (("a", 1.0), ("b", 0.0), ("none", 0.5)) if value in words}
    if words:
        readings = [
            Reading(f"grades, how much better {item_b} is", Told(format="ccr")),
            Reading(f"points of {item_a}, 1 where it is preferred", Told(columns={"choice": name}, choices=points)),
        ]
        raise QuestionError(f"the cells of {name!r} are only {named(sorted(words.values()))}", readings)


def find_ratings(seen: Seen) -> Description | None:
    """Find ratings of single items: who rated what, and how."""
    if says(seen, "choice", "item_a", "item_b", "winner", "wins_a", "rank") and not says(seen, "rating", "condition"):
        return None
    if not says(seen, "condition", "rating") and {"item_a", "item_b"} <= {plain(n) for n in seen.table.names}:
        return None
    rating = rating_of(seen, weak=True) or seen.one("rating")
    condition = condition_of(seen) if rating else ()
    if not rating or not condition:
        return None
    columns = seen.who_and_what() | {"condition": condition, "rating": rating}
    if "participant" not in columns:
        if "rating" not in seen.given and len(columns_of_numbers(seen, [*condition])) > FEWEST_RATED:
            return None  # a column for each participant, and one more
        raise VotesError(
            f"lacks the column participant; found {named(seen.table.names)}; who rated? --columns participant=…"
        )
    optional = seen.optional(RATING_OPTIONAL, names_in(columns))
    optional.pop("first_shown", None)
    grades = grades_in(seen.column(rating[0]).filled)
    return with_people_alone(seen, Description(RATINGS, columns | optional, words=grades, notes=_noted(grades)))


def find_wide_ratings(seen: Seen) -> Description | None:
    """Find ratings in many columns: one for each condition, or one for each participant."""
    told = seen.given.get("rating", ())
    who = {role: names for role in ("participant", "condition") if (names := quietly(seen, role))}
    rated = rated_columns(seen, told, who)
    if len(who) != 1 or len(rated) < FEWEST_RATED:
        return None
    if seen.pairs and not told and not set(seen.pairs[0]) & set(rated):
        return None  # two items in each row, and no column that is known to say which is preferred
    if len(told) < 2:
        _ask_if_something_else(seen, rated, who)
    (role,) = who
    stands = "condition" if role == "participant" else "participant"
    dataset = {"dataset": names} if (names := seen.one("dataset")) else {}
    note = f"a row for each {role}, a column for each of {len(rated)} {stands}s"
    grades = grades_in(word for name in rated for word in seen.column(name).filled)
    return Description(
        RATINGS,
        who | dataset | seen.optional(("practice", "excluded"), names_in(who | dataset) | {*rated}),
        "wide",
        {name: (name,) for name in rated},
        stands,
        grades,
        without=_summaries(seen, who[role], rated),
        notes=(note, *_noted(grades)),
    )


def _noted(grades: Mapping[str, float]) -> tuple[str, ...]:
    """Say which grades words are."""
    said = ", ".join(f"{word} is {grade:g}" for word, grade in sorted(grades.items(), key=lambda known: -known[1]))
    return (f"words are grades: {said}",) if grades else ()


def quietly(seen: Seen, role: str) -> tuple[str, ...]:
    return condition_of(seen) if role == "condition" else seen.one(role)


def _ask_if_something_else(seen: Seen, rated: Sequence[str], who: Mapping[str, tuple[str, ...]]) -> None:
    """Ask where columns of numbers may be something else than ratings, in all or in some of them."""
    if seen.told.format == "ratings":
        return
    whole = Reading(f"ratings of or by {named(rated)}", Told(columns={"rating": JOIN.join(rated)}))
    rows = joined_column(seen.table, [name for names in (*who.values(), seen.one("dataset")) for name in names])
    if len(rows.seen) < len(rows):
        as_votes = Told(columns={"item_a": rated[0], "item_b": rated[1], "choice": rated[-1]})
        readings = [*_rated_one(seen, rated, who), Reading(f"{whole.text}, more than once", whole.told)]
        if len(rated) > FEWEST_RATED:
            readings.append(Reading("votes, if columns name two items and the choice, such as", as_votes))
        repeated = shown(rows.words[int(np.argmax(np.bincount(rows.codes)))])
        raise QuestionError(f"{', '.join(who)} {repeated} has several rows of numbers", readings)
    roles = [name for name in rated if means("choice", name) or means("rank", name) or means("rating", name)]
    if roles or (seen.pairs and len(rated) > len(seen.pairs[0]) and set(seen.pairs[0]) <= set(rated)):
        readings = [whole]
        if seen.pairs:
            a, b = seen.pairs[0]
            columns = {"item_a": a, "item_b": b, "choice": next((name for name in rated if name not in (a, b)), "…")}
            readings.insert(0, Reading(f"votes on the items in {a!r} and {b!r}", Told(columns=columns)))
        odd = list(dict.fromkeys((*roles, *_odd_names([name for name in rated if name not in roles]))))
        for names in [[name] for name in odd] + ([odd] if len(odd) > 1 else []):
            if len(rated) - len(names) >= FEWEST_RATED:
                readings.append(_without(rated, names))
        raise QuestionError(f"the numbers in {named(rated)} can be read in {len(readings)} ways", readings)
    dashed = [pair[:2] for name in rated if (pair := pair_in(name)) is not None]
    if len(dashed) == len(rated) and max(Counter(item for pair in dashed for item in pair).values()) > 1:
        votes = Reading("choices of pairs, their numbers explained next", Told(columns={"choice": JOIN.join(rated)}))
        raise QuestionError(f"{named(rated)} may be named by pairs", [votes, whole])
    odd = _odd_names(rated) or _odd_numbers(seen, rated)
    if odd:
        rest = [name for name in rated if name not in odd]
        about = f"{named(odd)} may be something else than {named(rest)}"
        raise QuestionError(about, [whole, _without(rated, odd)])
    values = {value for name in rated for value in values_of(seen.column(name))}
    if len(values) == 2 and values <= {0.0, 1.0, 2.0} and len(seen.table) > 1:
        raise QuestionError(
            f"the cells of {named(rated)} are only {' and '.join(f'{value:g}' for value in sorted(values))}: if these "
            "are choices of one of two items, rename each column by its pair in the file, such as 'x vs y'",
            [Reading("ratings", Told(format="ratings"))],
        )
    if _are_ranks(seen, rated):
        readings = [
            Reading("ratings, more is better", Told(format="ratings")),
            Reading("ranks, 1 is best", Told(format="ranking")),
        ]
        raise QuestionError(f"each row of {named(rated)} holds the numbers from 1 to {len(rated)}", readings)


def _without(rated: Sequence[str], odd: Sequence[str]) -> Reading:
    rest = [name for name in rated if name not in odd]
    return Reading(f"ratings without {named(odd)}", Told(columns={"rating": JOIN.join(rest)}))


def _rated_one(seen: Seen, rated: Sequence[str], who: Mapping[str, tuple[str, ...]]) -> list[Reading]:
    """Return the reading of one column as the rating, of the conditions that the other columns make together."""
    names = [name for name in rated if means("rating", name)]
    taken = {*names, *(name for theirs in (*who.values(), seen.one("dataset")) for name in theirs)}
    parts = [
        name
        for name in seen.free
        if name not in taken and not is_never(name) and 1 < len(seen.column(name).filled) <= MOST_LEVELS
    ]
    rows = joined_column(seen.table, [*taken.difference(names), *parts])
    if len(names) != 1 or "participant" not in who or len(rows.seen) < len(rows):
        return []
    told = Told(columns={"condition": JOIN.join(parts), "rating": names[0]})
    return [Reading(f"ratings in {names[0]!r} of conditions in {named(parts)}", told)]


def _odd_names(rated: Sequence[str]) -> list[str]:
    """Return names that do not look like most of the others, c1, c2, …; or that speak of a number about people."""
    odd = [
        name
        for name in rated
        if {*re.split(r"[\W_]+", name.lower())} & (NEVER - {"", "n"})
        or plain(name) == "id"
        or is_suspicious(name)
        or any(re.match(rf"{re.escape(other)}[\W_]", name) for other in rated)  # x_views beside x
    ]
    stems: dict[str, list[str]] = {}
    for name in rated:
        stems.setdefault(re.sub(r"\d+", "#", plain(name)), []).append(name)
    counted = {stem: names for stem, names in stems.items() if "#" in stem and len(names) > 1}
    if len(counted) == 1 and len(stems) > 1:
        (kept,) = counted.values()
        odd += [name for name in rated if name not in kept and name not in odd]
    return odd if len(odd) < len(rated) else []


def _odd_numbers(seen: Seen, rated: Sequence[str]) -> list[str]:
    """Return columns of numbers with decimals among others of whole numbers: a mean rather than ratings."""
    odd = [
        name for name in rated if any(value != int(value) for value in values_of(seen.column(name)) if value == value)
    ]
    return odd if 2 * len(odd) < len(rated) else []


def _are_ranks(seen: Seen, rated: Sequence[str]) -> bool:
    if len(rated) < FEWEST_RANKED or len(seen.table) < 2:
        return False
    cells = np.stack([seen.column(name).texts for name in rated], axis=1)
    wanted = sorted(str(place) for place in range(1, len(rated) + 1))
    return all(sorted(row) == wanted for row in cells.tolist())


def _summaries(seen: Seen, names: Sequence[str], rated: Sequence[str]) -> tuple[int, ...]:
    """Return the rows of a wide table that are nobody's: named as a statistic, or the mean of all others."""
    if names[0] in names_in(seen.given):
        return ()
    cells = np.stack([seen.column(name).meaning(number_or_nan, np.float64) for name in rated], axis=1)
    means = (cells.sum(axis=0) - cells) / max(len(cells) - 1, 1)
    is_mean = (np.abs(cells - means) < ROUNDED).all(axis=1) & (cells % 1 > 0).any(axis=1)
    named_so = summaries(seen.column(names[0]))
    return named_so or (tuple(np.flatnonzero(is_mean).tolist()) if len(cells) > FEWEST_AVERAGED else ())
