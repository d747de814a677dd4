"""Public data sets are read to the last vote, and give the digits of the same votes counted by hand."""

from __future__ import annotations

import csv
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from app.analysis.model.bradley_terry import fit_scores
from app.analysis.reading.read_votes import understand_votes
from app.analysis.reading.sources import recognise_file
from app.analysis.reading.votes_table import CHOICES, VotesTable, votes_from_indices

REFERENCES = (
    *("baseball_agresti", "cemschoice", "citations_stigler", "kbs_dog", "paper_like_22x5x6", "deg_all_ties"),
    *("deg_disconnected", "deg_item_never_wins", "deg_two_items", "deg_two_items_ties"),
)
WORDS = {"a": "a", "b": "b", "tie": "none"}
Key = tuple[str, str, str, str, str]  # participant, dataset, item_a, item_b, choice


def counted(votes: VotesTable) -> Counter[Key]:
    """How often each vote stands in a table."""
    counts: Counter[Key] = Counter()
    columns = (votes.participant, votes.dataset, votes.item_a, votes.item_b, votes.choice, votes.count)
    for person, dataset, a, b, choice, n in zip(*(column.tolist() for column in columns), strict=True):
        names = (votes.participants[person], votes.datasets[dataset], votes.items[a], votes.items[b], CHOICES[choice])
        counts[names] += n
    return counts


def counted_by_hand(path: Path) -> Counter[Key]:
    counts: Counter[Key] = Counter()
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if "is_A_selected" in row:
                choice = "a" if row["is_A_selected"] == "1" else "b"
                counts[row["observer"], row["scene"], row["condition_A"], row["condition_B"], choice] += 1
            else:
                key = (row["judge"], row["dataset"], row["item_a"], row["item_b"], WORDS[row["choice"]])
                counts[key] += int(row["count"])
    return counts


@pytest.mark.parametrize("name", [*(f"reference/{name}/votes.csv" for name in REFERENCES), "pwcmp_tone_mapping.csv"])
def test_every_vote_of_a_public_file_is_read_as_it_stands_there(real_data: Path, name: str) -> None:
    path = real_data / "votes" / name
    votes, _ = understand_votes([recognise_file(path)])
    assert counted(votes) == counted_by_hand(path)


@pytest.mark.parametrize("name", ["baseball_agresti", "cemschoice", "citations_stigler", "paper_like_22x5x6"])
def test_scores_of_a_public_file_have_every_digit_of_votes_counted_by_hand(real_data: Path, name: str) -> None:
    path = real_data / "votes" / "reference" / name / "votes.csv"
    read, _ = understand_votes([recognise_file(path)])
    by_hand = counted_by_hand(path)
    items = {name: place for place, name in enumerate(read.items)}
    rows = [(items[a], items[b], CHOICES.index(choice), n) for (_, _, a, b, choice), n in by_hand.items()]
    item_a, item_b, choice, count = np.array(rows).T
    one = np.zeros(len(rows), int)
    table = votes_from_indices(one, one, item_a, item_b, choice, names=(("",), ("",), read.items), count=count)
    for ties in ("davidson", "drop"):
        fit, plain = (fit_scores(votes, ties=ties) for votes in (read, table))
        assert fit.scores is not None
        assert plain.scores is not None
        np.testing.assert_allclose(fit.scores, plain.scores, rtol=0, atol=1e-12)
