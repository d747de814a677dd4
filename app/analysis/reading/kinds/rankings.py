"""Find rankings and best-worst choices in a table, which become pairs."""

from __future__ import annotations

import re

from app.analysis.reading.cells import is_numeric
from app.analysis.reading.description import VOTES, Description
from app.analysis.reading.kinds.seen import FEWEST_RANKED, FEWEST_RATED, Seen, condition_of, rated_columns, rating_of
from app.analysis.reading.votes_table import VotesError
from app.analysis.reading.words import plain

NOT_INDEPENDENT = "pairs of one ranking are not independent; intervals are over participants, so they stay right"


def find_ranking(seen: Seen) -> Description | None:
    """Find the rank of an item in each row."""
    rank = seen.given.get("rank") or tuple(n for n in seen.free if plain(n) in ("rank", "ranking"))[:1]
    condition = condition_of(seen) if rank else ()
    who = seen.who_and_what()
    if not rank or not condition or "participant" not in who or rating_of(seen):
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


def find_ranked_columns(seen: Seen) -> Description | None:
    """Find a ranking in each row: rank_1, rank_2, …, whose cells name the items."""
    places = {name: place for name in seen.free if (place := _place_in(name)) is not None}
    if len(places) < FEWEST_RANKED or sorted(places.values()) != list(range(1, len(places) + 1)):
        return None
    if all(is_numeric(seen.column(name)) for name in places):
        return None
    spread = {name: (str(place),) for name, place in sorted(places.items(), key=lambda matches: matches[1])}
    note = f"a ranking of {len(places)} in each row, {next(iter(spread))} is best; turned into pairs; {NOT_INDEPENDENT}"
    return Description(VOTES, seen.who_and_what(), "ranked", spread, "condition", notes=(note,))


def find_best_worst(seen: Seen) -> Description | None:
    """Find the best and the worst of several items in each row."""
    names = {role: seen.first(role) for role in ("best", "worst")}
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


def find_wide_ranks(seen: Seen) -> Description | None:
    """Take ranks in many columns, one for each item: only if told, as they look like ratings."""
    who = seen.who_and_what()
    rated = rated_columns(seen, seen.given.get("rank", ()), who)
    if len(rated) < FEWEST_RATED:
        return None
    note = f"ranks of {len(rated)} items in each row, 1 is best; turned into pairs; {NOT_INDEPENDENT}"
    return Description(VOTES, who, "ranks", {name: (name,) for name in rated}, "condition", notes=(note,))
