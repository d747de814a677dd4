"""Tables made by rule: what is read is right, or a question; never wrong. And no change of a number goes unsaid."""

from __future__ import annotations

import random
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from app.analysis.ratings.reading import understand_ratings
from app.analysis.ratings.table import ComparisonTable
from app.analysis.reading.cells import table_of_rows
from app.analysis.reading.description import Told
from app.analysis.reading.programs import restated
from app.analysis.reading.read_votes import understand_votes
from app.analysis.reading.recognise import recognise
from app.analysis.reading.sources import Source
from app.analysis.reading.votes_table import VotesError

N_TABLES = 2400
N_MUTATED = 800
Row = dict[str, Any]

PAIRS = (
    *(("item_a", "item_b"), ("left", "right"), ("condition_A", "condition_B"), ("stim1", "stim2")),
    *(("image left", "image right"), ("method-1", "method-2"), ("A", "B"), ("first_video", "second_video")),
)
NAMES = {
    "participant": ("participant", "subject", "observer_id", "worker", "PID", "rater"),
    "dataset": ("dataset", "scene", "content", "src"),
    "choice": ("choice", "preferred", "response", "answer", "vote", "winner", "selected"),
    "condition": ("condition", "stimulus", "PVS", "method", "file_name", "system"),
    "rating": ("rating", "score", "opinion_score", "Grade"),
}  # fmt: skip
ITEMS = (
    *(("x", "y", "z"), ("red", "green", "blue"), ("id+fa", "pm+fb", "dr+fa"), ("1", "2", "3"), ("a", "b", "c")),
    *(("c1", "c2", "c3"), ("crf 23", "crf 28", "crf 35"), ("left", "right", "none"), ("A", "B", "ref")),
)
WORDS = (
    *(("a", "b", "none"), ("left", "right", "tie"), ("Left", "Right", "no preference"), ("1", "2", "0")),
    *(("1", "2", "3"), ("first", "second", "same"), ("A", "B", "both"), ("0", "1", "-1")),
    ("left better", "right better", "equal"),
)
NUMBERS = ("confidence", "age", "trial", "session", "rt", "MOS", "SD", "n", "CI", "index", "Unnamed: 0", "rank",
           "rating", "score", "response_time", "block", "attention_check", "response", "is_practice_round",
           "group", "difficulty")  # fmt: skip
TEXTS = ("comment", "gender", "country", "browser", "phase", "gold_answer", "answer_text", "timestamp", "notes", "sex")


def styled(name: str, rng: random.Random) -> str:
    """Write a name as people do: capitals, spaces, underscores, hyphens."""
    style = rng.choice((str, str, str.title, str.upper, str.capitalize))
    return style(re.sub(r"[ _-]", lambda _: rng.choice("_ -"), name))


def decoys(rng: random.Random, n_rows: int, *, taken: set[str]) -> dict[str, list[Any]]:
    """Return columns that are no part of votes or ratings."""
    columns: dict[str, list[Any]] = {}
    for _ in range(rng.choice((0, 1, 1, 2, 3))):
        if rng.random() < 0.7:
            name, cells = rng.choice(NUMBERS), [rng.randint(1, 5) for _ in range(n_rows)]
        else:
            name, cells = rng.choice(TEXTS), [rng.choice(("ok", "why not", "f", "m", "test")) for _ in range(n_rows)]
        if name.lower() not in taken:
            columns[styled(name, rng)] = cells
    return columns


def arranged(columns: dict[str, list[Any]], rng: random.Random) -> list[Row]:
    """Return rows of columns in any order."""
    names = list(columns)
    rng.shuffle(names)
    return [{name: columns[name][row] for name in names} for row in range(len(columns[names[0]]))]


def votes_truth(rng: random.Random) -> list[tuple[str, str, str, str, str]]:
    """Return participant, dataset, two items, and the preferred one or nothing."""
    items = rng.choice(ITEMS)
    datasets = rng.choice((("d",), ("d", "e")))
    pairs = [
        (a, b) if rng.random() < 0.5 else (b, a)
        for a, b in ((items[0], items[1]), (items[0], items[2]), (items[1], items[2]))
    ]
    with_ties = rng.random() < 0.4
    return [
        (f"P{person}", dataset, a, b, rng.choice((a, b, "") if with_ties else (a, b)))
        for person in range(rng.randint(2, 5))
        for dataset in datasets
        for a, b in pairs
    ]


def long_votes(rng: random.Random) -> tuple[list[Row], Counter[Any]]:
    truth = votes_truth(rng)
    words = rng.choice((*WORDS, None, None))  # None: the name of the preferred item
    name_a, name_b = rng.choice(PAIRS)
    columns = {
        styled(rng.choice(NAMES["participant"]), rng): [row[0] for row in truth],
        styled(rng.choice(NAMES["dataset"]), rng): [row[1] for row in truth],
        styled(name_a, rng): [row[2] for row in truth],
        styled(name_b, rng): [row[3] for row in truth],
        styled(rng.choice(NAMES["choice"]), rng): [word_of(row, words) for row in truth],
    }
    columns |= decoys(rng, len(truth), taken={name.lower() for name in columns})
    return arranged(columns, rng), Counter((p, d, *sorted((a, b)), won) for p, d, a, b, won in truth)


def word_of(row: tuple[str, str, str, str, str], words: tuple[str, str, str] | None) -> str:
    _, _, a, _, won = row
    if words is None:
        return won or "tie"
    return words[2] if not won else words[0] if won == a else words[1]


def wide_votes(rng: random.Random) -> tuple[list[Row], Counter[Any]]:
    truth = [row for row in votes_truth(rng) if row[1] == "d"]
    words = rng.choice((*WORDS, None, None))
    form = rng.choice(("{a} vs {b}", "{a} vs. {b}", "P{n} - {a} vs {b}", "Q{n}: {a} versus {b}", "{n}. {a} vs {b}",
                       "{a} - {b}", "Q{n}_{a} vs {b}", "Pair {n} ({a} vs {b})"))  # fmt: skip
    people = list(dict.fromkeys(row[0] for row in truth))
    columns: dict[str, list[Any]] = {styled(rng.choice(NAMES["participant"]), rng): people}
    pairs = list(dict.fromkeys((row[2], row[3]) for row in truth))
    for n, (a, b) in enumerate(pairs, start=1):
        name = form.format(a=a, b=b, n=n)
        columns[name] = [word_of(row, words) for row in truth if row[2:4] == (a, b)]
        if rng.random() < 0.1:
            columns[f"{name} Comment"] = ["because"] * len(people)
    columns |= decoys(rng, len(people), taken={name.lower() for name in columns})
    return arranged(columns, rng), Counter((p, "", *sorted((a, b)), won) for p, _, a, b, won in truth)


def rated_truth(rng: random.Random) -> list[tuple[str, str, int]]:
    items = rng.choice(ITEMS)
    return [(f"P{person}", item, rng.randint(1, 5)) for person in range(rng.randint(3, 6)) for item in items]


def long_ratings(rng: random.Random) -> tuple[list[Row], Counter[Any]]:
    truth = rated_truth(rng)
    columns: dict[str, list[Any]] = {
        styled(rng.choice(NAMES["participant"]), rng): [row[0] for row in truth],
        styled(rng.choice(NAMES["condition"]), rng): [row[1] for row in truth],
        styled(rng.choice(NAMES["rating"]), rng): [row[2] for row in truth],
    }
    columns |= decoys(rng, len(truth), taken={name.lower() for name in columns})
    return arranged(columns, rng), Counter((p, "", c, float(value)) for p, c, value in truth)


def wide_ratings(rng: random.Random) -> tuple[list[Row], Counter[Any]]:
    truth = rated_truth(rng)
    across = rng.random() < 0.5
    rows = list(dict.fromkeys(row[0 if across else 1] for row in truth))
    heads = list(dict.fromkeys(row[1 if across else 0] for row in truth))
    columns: dict[str, list[Any]] = {styled(rng.choice(NAMES["participant" if across else "condition"]), rng): rows}
    for head in heads:
        columns[head] = [value for p, c, value in truth if (c if across else p) == head]
    columns |= decoys(rng, len(rows), taken={name.lower() for name in columns})
    return arranged(columns, rng), Counter((p, "", c, float(value)) for p, c, value in truth)


def long_comparisons(rng: random.Random) -> tuple[list[Row], Counter[Any]]:
    truth = [(p, d, a, b, rng.randint(-3, 3)) for p, d, a, b, _ in votes_truth(rng)]
    name_a, name_b = rng.choice(PAIRS)
    columns: dict[str, list[Any]] = {
        styled(rng.choice(NAMES["participant"]), rng): [row[0] for row in truth],
        styled(rng.choice(NAMES["dataset"]), rng): [row[1] for row in truth],
        styled(name_a, rng): [row[2] for row in truth],
        styled(name_b, rng): [row[3] for row in truth],
        styled("rating", rng): [row[4] for row in truth],
    }
    columns |= decoys(rng, len(truth), taken={name.lower() for name in columns})
    return arranged(columns, rng), Counter((p, d, a, b, float(value)) for p, d, a, b, value in truth)


KINDS = (long_votes, wide_votes, long_ratings, wide_ratings, long_comparisons)


def understood(rows: list[Row], told: Told = Told()) -> tuple[Counter[Any], list[str]]:  # frozen
    """Return what was read, as the truth is written, and the sentences."""
    table = restated(table_of_rows([{name: str(cell) for name, cell in row.items()} for row in rows]))
    source = Source(Path("table.csv"), table, recognise(table, told))
    if source.holds_votes:
        votes, said = understand_votes([source])
        read: Counter[Any] = Counter()
        for row in range(len(votes)):
            if not votes.is_used[row]:
                continue
            a, b = votes.items[votes.item_a[row]], votes.items[votes.item_b[row]]
            won = (a, b, "")[votes.choice[row]]
            read[
                votes.participants[votes.participant[row]], votes.datasets[votes.dataset[row]], *sorted((a, b)), won
            ] += int(votes.count[row])
        return read, said
    ratings, said = understand_ratings(source)
    people = [ratings.participants[person] for person in ratings.person]
    if isinstance(ratings, ComparisonTable):
        pairs = zip(people, ratings.item_a, ratings.item_b, ratings.rating.tolist(), strict=True)
        return Counter(
            (p, ratings.items[a][0], ratings.items[a][1], ratings.items[b][1], r) for p, a, b, r in pairs
        ), said
    return Counter(
        (p, *ratings.items[i], r) for p, i, r in zip(people, ratings.item, ratings.rating.tolist(), strict=True)
    ), said


def mutated(rows: list[Row], rng: random.Random) -> list[Row]:
    """Change one header or one cell, to another of the same table or to nonsense."""
    names = list(rows[0])
    name = rng.choice(names)
    if rng.random() < 0.5:
        other = rng.choice(
            (f"{name}x", name[:-1] or "q", "age", "practice", "count", "dataset", "rating", name.swapcase())
        )
        if other in names:
            return rows
        return [{other if key == name else key: cell for key, cell in row.items()} for row in rows]
    place = rng.randrange(len(rows))
    cell = rng.choice((rows[rng.randrange(len(rows))][name], "", "1", "a", rng.choice(list(rows[place].values()))))
    return [{**row, name: cell} if n == place else row for n, row in enumerate(rows)]


@pytest.mark.slow
def test_no_change_of_a_header_or_a_cell_changes_what_is_read_without_changing_a_line() -> None:
    n_changed = 0
    for seed in range(N_MUTATED):
        rng = random.Random(seed)
        rows, _ = KINDS[seed % len(KINDS)](rng)
        try:
            before, said = understood(rows)
            after, then_said = understood(mutated(rows, rng))
        except VotesError:
            continue  # a refusal is a line that changed
        if before != after:
            n_changed += 1
            assert said != then_said, seed
    assert n_changed > N_MUTATED / 20


@pytest.mark.slow
def test_a_generated_table_is_read_rightly_or_asked_about_and_never_misread() -> None:
    outcomes: Counter[tuple[str, str]] = Counter()
    for seed in range(N_TABLES):
        rng = random.Random(seed)
        make = KINDS[seed % len(KINDS)]
        rows, truth = make(rng)
        try:
            read, said = understood(rows)
        except VotesError:
            outcomes[make.__name__, "asked"] += 1
            continue
        assert read == truth, (seed, make.__name__, rows[:3], said)
        outcomes[make.__name__, "read"] += 1
    for make in KINDS:
        assert outcomes[make.__name__, "read"] > 0.4 * N_TABLES / len(KINDS), outcomes
