"""Participants who stand out are flagged, others are not, and agreement is measured as published."""

from __future__ import annotations

import json
import tracemalloc
from itertools import combinations, permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.analysis import analyse
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.model.likelihood.counts import count_pairs
from app.analysis.reading.read_votes import read_votes, votes_from_rows
from app.analysis.reading.votes_table import VotesError, VotesTable, only_compared, votes_from_indices
from app.analysis.screening import observers
from app.analysis.screening.agreement import agreement, agreement_rows, transitivity
from app.analysis.screening.observers import observer_rows

HONEST = 14


def panel(**changes: Any) -> VotesTable:
    """Fourteen honest participants and a last one whose columns can be changed."""
    votes = simulate_votes(StudyPlan(6, 4, HONEST + 1, spread=0.2), np.linspace(-1.2, 1.2, 6), np.random.default_rng(8))
    last = votes.participant == HONEST
    old = {name: getattr(votes, name) for name in changes}
    new = {name: np.where(last, value, old[name]).astype(old[name].dtype) for name, value in changes.items()}
    return VotesTable(**{**vars(votes), **new})


def flags(votes: VotesTable) -> dict[str, list[str]]:
    """Flags and remarks together."""
    return {row["participant"]: [*row["flags"], *row["remarks"]] for row in analyse(votes)["observers"]}


def test_honest_participants_are_not_flagged() -> None:
    assert not [row for row in analyse(panel())["observers"] if row["flags"]]


def test_somebody_who_always_takes_the_same_side_is_flagged() -> None:
    found = flags(panel(choice=0))
    assert "prefers one side" in found[str(HONEST)]


@pytest.mark.parametrize("ties", ["davidson", "rao-kupper", "half", "drop"])
def test_leaving_out_everybody_at_once_is_leaving_out_one_after_the_other(
    ties: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    votes = panel(choice=0)
    together = observer_rows(votes, [], ties=ties)
    monkeypatch.setattr(observers, "_left_out_together", lambda *_: None)
    alone = observer_rows(votes, [], ties=ties)
    name = "loglik_per_vote_left_out"
    assert [row.pop(name) for row in together] == pytest.approx([row.pop(name) for row in alone], rel=1e-9)
    assert together == alone


def test_votes_with_one_side_unseen_are_flagged_where_it_is_known() -> None:
    row = {"participant": "P1", "dataset": "d", "item_a": "x", "item_b": "y", "choice": "a"}
    seen = [row | {"both_seen": both} for both in (True, False, None)]
    rows = observer_rows(votes_from_rows(seen), [], ties="rao-kupper")
    assert rows[0]["one_side_unseen"] == 1
    assert "only one side seen in 1 of 3 votes" in rows[0]["flags"]
    (unknown,) = observer_rows(votes_from_rows([row, row]), [], ties="rao-kupper")
    assert (unknown["one_side_unseen"], unknown["flags"]) == (None, [])
    with pytest.raises(VotesError, match="both_seen is 'perhaps', expected true or false"):
        votes_from_rows([row | {"both_seen": "perhaps"}])


def test_votes_on_films_that_did_not_run_are_flagged_where_it_is_known() -> None:
    row = {"participant": "P1", "dataset": "d", "item_a": "x", "item_b": "y", "choice": "a"}
    ran = [row | {"shown_smoothly": smooth} for smooth in (True, False, None)]
    (judged,) = observer_rows(votes_from_rows(ran), [], ties="rao-kupper")
    assert (judged["not_smooth"], judged["flags"]) == (1, ["films not shown smoothly in 1 of 3 votes"])
    alone = votes_from_rows([row | {"shown_smoothly": False, "both_seen": False}])
    assert observer_rows(alone, [], ties="rao-kupper")[0]["flags"] == [
        "only one side seen in the only vote",
        "films not shown smoothly in the only vote",
    ]
    (unknown,) = observer_rows(votes_from_rows([row, row]), [], ties="rao-kupper")
    assert (unknown["not_smooth"], unknown["flags"]) == (None, [])


def test_the_time_from_press_to_picture_is_told_where_it_was_recorded() -> None:
    row = {"participant": "P1", "dataset": "d", "item_a": "x", "item_b": "y", "choice": "a"}
    rows = observer_rows(
        votes_from_rows([row | {"press_to_picture_ms": ms} for ms in (20, 30, None)]), [], ties="davidson"
    )
    assert rows[0]["median_press_to_picture_ms"] == 25
    (unknown,) = observer_rows(votes_from_rows([row]), [], ties="davidson")
    assert unknown["median_press_to_picture_ms"] is None


@pytest.mark.parametrize(("n_votes", "is_flagged"), [(4, False), (6, True)])
def test_few_votes_for_one_side_are_not_held_against_somebody(n_votes: int, is_flagged: bool) -> None:
    """Of votes between equals, all fall on one side with a probability of 2 / 2**n."""
    sides = [("x", "y"), ("y", "x")] * 3
    rows = [{"participant": "P", "dataset": "d", "item_a": a, "item_b": b, "choice": "a"} for a, b in sides[:n_votes]]
    (row,) = analyse(votes_from_rows(rows))["observers"]
    assert row["side_a_p_value"] == pytest.approx(2 / 2**n_votes)
    assert ("prefers one side" in row["remarks"]) == is_flagged


def test_somebody_who_votes_against_everybody_is_flagged() -> None:
    found = flags(panel(choice=np.array([1, 0, 2])[panel().choice]))
    assert "disagrees with the others" in found[str(HONEST)]


def test_somebody_without_preferences_is_flagged() -> None:
    found = flags(panel(choice=2))
    assert "unusually many ties" in found[str(HONEST)]


def test_somebody_who_votes_at_random_is_no_more_consistent_than_chance() -> None:
    found = flags(panel(choice=np.random.default_rng(3).integers(0, 2, len(panel()))))
    assert "no more consistent than chance" in found[str(HONEST)]


@pytest.mark.parametrize(("n_votes", "is_flagged"), [(9, False), (10, True)])
def test_rates_and_times_are_compared_from_ten_votes_on(n_votes: int, is_flagged: bool) -> None:
    votes = panel(choice=2, response_ms=100.0)
    last = np.flatnonzero(votes.participant == HONEST)
    kept = np.setdiff1d(np.arange(len(votes)), last[n_votes:])
    own = flags(votes.where(kept))[str(HONEST)]
    assert ("unusually many ties" in own) == is_flagged
    assert ("answers faster than looking" in own) == is_flagged


@pytest.mark.parametrize(
    ("n_items", "n_datasets", "can_tell"), [(3, 1, False), (5, 1, False), (5, 2, True), (6, 1, True)]
)
def test_contradictions_are_held_against_somebody_only_where_chance_could_have_been_told(
    n_items: int, n_datasets: int, can_tell: bool
) -> None:
    rows = [
        {"participant": "P", "dataset": f"d{dataset}", "item_a": f"{a}", "item_b": f"{b}", "choice": "a"}
        for dataset in range(n_datasets)
        for a, b in permutations(range(n_items), 2)
        if (b - a) % n_items <= n_items // 2 and (2 * (b - a) % n_items or a < b)  # each is preferred to those after it
    ]
    own = flags(votes_from_rows(rows))["P"]
    assert ("no more consistent than chance" in own) == can_tell


def test_somebody_who_prefers_what_is_shown_first_is_flagged() -> None:
    rng = np.random.default_rng(4)
    votes = panel()
    votes = VotesTable(**{**vars(votes), "first_shown": rng.integers(0, 2, len(votes)).astype(np.int8)})
    last = votes.participant == HONEST
    votes = VotesTable(**{**vars(votes), "choice": np.where(last, votes.first_shown, votes.choice).astype(np.int8)})
    assert "prefers by order of showing" in flags(votes)[str(HONEST)]


def test_answers_faster_than_looking_are_flagged() -> None:
    votes = panel()
    times = np.random.default_rng(5).uniform(2000, 6000, len(votes))
    times[votes.participant == HONEST] = 200
    found = flags(VotesTable(**{**vars(votes), "response_ms": times}))
    assert "answers faster than looking" in found[str(HONEST)]


def test_consistency_on_repeated_pairs_ignores_which_item_is_called_a() -> None:
    rows = [("x", "y", "a"), ("y", "x", "b"), ("y", "z", "a"), ("z", "y", "a")]
    votes = votes_from_rows(
        {"participant": "p", "dataset": "d", "item_a": a, "item_b": b, "choice": choice} for a, b, choice in rows
    )
    (row,) = analyse(votes)["observers"]
    assert (row["repeated_pairs"], row["repeats_consistent"]) == (2, 1)


def test_agreement_is_one_if_all_agree_and_least_if_they_are_split() -> None:
    def panel_of(choices: str) -> VotesTable:
        return votes_from_rows(
            {"participant": f"p{k}", "dataset": "d", "item_a": a, "item_b": b, "choice": choice}
            for k, choice in enumerate(choices)
            for a, b in (("x", "y"), ("x", "z"), ("y", "z"))
        )

    assert agreement(count_pairs(panel_of("aaaa"))).u == pytest.approx(1, abs=1e-12)
    split = agreement(count_pairs(panel_of("aabb")))
    assert split.u == pytest.approx(-1 / 3, abs=1e-12)
    assert split.u_min == pytest.approx(-1 / 3, abs=1e-12)
    ties = panel_of("aaa")
    tied = VotesTable(**{**vars(ties), "choice": np.where(np.arange(9) == 0, 2, ties.choice).astype(np.int8)})
    assert agreement(count_pairs(tied)).u is None


@pytest.mark.parametrize("name", ["baseball_agresti", "citations_stigler"])
def test_agreement_and_transitivity_have_the_reference_values(real_data: Path, name: str) -> None:
    folder = real_data / "votes" / "reference" / name
    expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))
    counts = count_pairs(only_compared(read_votes(folder / "votes.csv")))
    violated = expected["stochastic_transitivity"]
    found = transitivity(counts)
    assert found is not None
    assert found == {key: violated[key] for key in ("weak", "moderate", "strong")} | {"n_triples": found["n_triples"]}
    if "kendall_u" in expected:
        wanted, own = expected["kendall_u"], agreement(counts)
        assert own.u == pytest.approx(wanted["u"], abs=1e-10)
        assert own.u_min == pytest.approx(wanted["min_u"], abs=1e-10)
        assert own.chi2 == pytest.approx(wanted["chi2"], abs=1e-5)
        assert own.df == pytest.approx(wanted["df"], abs=1e-10)
        assert own.p_value == pytest.approx(wanted["p"], abs=1e-10)


def test_agreement_is_of_people_who_judge_a_pair_once() -> None:
    rows = [
        {"participant": f"p{who}", "dataset": "ball", "item_a": a, "item_b": b, "choice": "ab"[who]}
        for who in (0, 1)
        for a, b in combinations("xyz", 2)
    ]
    assert agreement_rows(votes_from_rows(rows))[0]["u"] == pytest.approx(-1)
    assert agreement_rows(votes_from_rows(rows + rows))[0]["u"] is None


@pytest.mark.parametrize("order", list(permutations("xyz")))
def test_transitivity_does_not_depend_on_the_order_of_items(order: tuple[str, ...]) -> None:
    """Three judges of a circle, each pair two to one: weak is broken once, whatever the items are called."""
    place = {item: order.index(item) for item in order}
    rows = []
    for better, worse in ("xy", "yz", "xz"):
        a, b = sorted((better, worse), key=place.__getitem__)
        rows += [
            {"participant": f"p{n}", "dataset": "ball", "item_a": a, "item_b": b, "choice": "a" if is_a else "b"}
            for n, is_a in enumerate(((a == better),) * 2 + (a != better,))
        ]
    assert agreement_rows(votes_from_rows(sorted(rows, key=lambda row: place[row["item_a"]])))[0]["transitivity"] == {
        "weak": 0,
        "moderate": 0,
        "strong": 0,
        "n_triples": 1,
    }


def test_side_rates_are_expected_from_the_ties_model() -> None:
    """By Rao and Kupper's model fewer choices go to the worse item than the scores alone would have it."""
    rng, theta, ability = np.random.default_rng(5), 1.0, {"x": 1.5, "y": 0.0}
    rows = []
    for who in range(20):
        for _ in range(60):
            win, loss = (1 / (1 + np.exp(theta - sign * 1.5)) for sign in (1, -1))
            drawn = rng.random()
            choice = "a" if drawn < win else "b" if drawn < win + loss else "none"
            rows.append({"participant": f"p{who}", "dataset": "", "item_a": "x", "item_b": "y", "choice": choice})
    assert ability["x"] > ability["y"]
    found = observer_rows(votes_from_rows(rows), [], ties="rao-kupper")
    observed, expected = (np.mean([row[f"side_a_{what}"] for row in found]) for what in ("rate", "expected"))
    assert expected == pytest.approx(observed, abs=0.01)
    assert not [row for row in found if "prefers one side" in row["remarks"]]


def test_thousands_of_items_take_memory_for_their_votes_and_not_for_all_their_pairs() -> None:
    rng, n_items, n_votes = np.random.default_rng(3), 4000, 8000
    first = rng.integers(0, n_items, n_votes)
    second = (first + rng.integers(1, n_items, n_votes)) % n_items
    names = ("p0", "p1"), ("",), tuple(f"i{item}" for item in range(n_items))
    votes = votes_from_indices(
        np.arange(n_votes) % 2, 0 * first, first, second, rng.integers(0, 2, n_votes), names=names
    )
    tracemalloc.start()
    rows = observer_rows(votes, [], ties="davidson")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert [row["n_votes"] for row in rows] == [n_votes / 2, n_votes / 2]
    assert peak < 8 * n_items**2 / 4  # bytes


def test_a_row_of_millions_of_votes_takes_the_memory_of_a_row() -> None:
    rows = [
        {"participant": who, "item_a": "x", "item_b": "y", "choice": choice, "count": count}
        for who, counts in (("p", (6_000_000, 4_000_000)), ("q", (4_000_000, 6_000_000)))
        for choice, count in zip("ab", counts, strict=True)
    ]
    votes = votes_from_rows(rows)
    tracemalloc.start()
    try:
        first, _ = observer_rows(votes, [], ties="davidson")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 5e6
    assert (first["side_a_rate"], first["side_a_p_value"]) == (0.6, 0.0)
