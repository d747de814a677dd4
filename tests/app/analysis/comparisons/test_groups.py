"""Groups of people, and datasets against each other, with participants as the sample."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import friedmanchisquare, kendalltau, spearmanr, ttest_ind

from app.analysis import AnalysisSettings, VotesError, analyse, analyse_file
from app.analysis.comparisons.factors import ModelTest
from app.analysis.comparisons.homogeneity import Part, parts_differ
from app.analysis.comparisons.power import simulate_votes
from app.analysis.comparisons.vote_studies import StudyPlan
from app.analysis.model.bradley_terry import fit_scores
from app.analysis.reading.attributes import read_participants
from app.analysis.reading.read_votes import votes_from_rows
from app.analysis.reading.votes_table import VotesTable, votes_from_indices
from app.analysis.screening.agreement import concordance, concordance_p_value, dataset_agreement_rows
from tests.app.analysis.votes_data_frame import frame_from_votes

ABILITIES = np.array([-0.6, -0.2, 0.2, 0.6])
TWENTY = {str(who): "old" if who < 10 else "young" for who in range(20)}


def simulated(seed: int, *, spread: float = 0.8, participants: int = 20, datasets: int = 2) -> VotesTable:
    plan = StudyPlan(len(ABILITIES), datasets, participants, spread=spread)
    return simulate_votes(plan, ABILITIES, np.random.default_rng(seed))


def split_test(votes: VotesTable) -> ModelTest:
    """Test the first ten participants against the others."""
    halves = [votes.where((votes.participant < 10) == is_first) for is_first in (True, False)]
    found = parts_differ("group", "items", "all", fit_scores(votes), [Part(half, fit_scores(half)) for half in halves])
    assert found is not None
    return found


@pytest.mark.slow
def test_alike_groups_differ_by_chance_only_as_often_as_they_should() -> None:
    tests = [split_test(simulated(seed)) for seed in range(150)]
    rejected = np.mean([test.p_participant is not None and test.p_participant < 0.05 for test in tests])
    as_if_votes_were_people = np.mean([test.p_value < 0.05 for test in tests])
    assert rejected < 0.10  # 0.05 and three standard errors
    assert as_if_votes_were_people > 0.15  # which is why the correction is there


@pytest.mark.parametrize("sizes", [(4, 4), (3, 20), (12, 5)])
def test_groups_are_compared_as_by_a_t_test_of_unequal_variances(sizes: tuple[int, int]) -> None:
    n = sum(sizes)
    won = np.random.default_rng(4).normal(505, 30, n).astype(int)  # of 1000 votes of each person
    who, choice = np.repeat(np.arange(n), 2), np.tile([0, 1], n)
    count = np.stack([won, 1000 - won], axis=1).ravel()
    names = tuple(map(str, range(n))), ("",), ("a", "b")
    first, second = np.zeros(2 * n, int), np.ones(2 * n, int)
    votes = votes_from_indices(who, first, first, second, choice, names=names, count=count)
    parts = [votes.where((votes.participant < sizes[0]) == is_first) for is_first in (True, False)]
    tested = parts_differ("group", "items", "all", fit_scores(votes), [Part(part, fit_scores(part)) for part in parts])
    assert tested is not None
    expected = ttest_ind(won[: sizes[0]], won[sizes[0] :], equal_var=False).pvalue
    assert tested.p_participant == pytest.approx(expected, rel=0.02)


def test_where_every_vote_is_another_person_the_two_tests_agree() -> None:
    votes = simulated(5, spread=0.0, participants=200, datasets=1)
    names = tuple(map(str, range(len(votes))))
    alone = VotesTable(**{**vars(votes), "participants": names, "participant": np.arange(len(votes), dtype=np.int32)})
    is_first_half = np.arange(len(votes)) < len(votes) // 2
    parts = [alone.where(is_first_half), alone.where(~is_first_half)]
    found = parts_differ("halves", "items", "all", fit_scores(alone), [Part(part, fit_scores(part)) for part in parts])
    assert found is not None
    assert found.p_participant == pytest.approx(found.p_value, abs=0.05)


def test_datasets_are_compared_with_more_parameters_than_participants() -> None:
    plan = StudyPlan(6, 5, 12)
    rows = analyse(simulate_votes(plan, np.linspace(-0.5, 0.5, 6), np.random.default_rng(1)))["tests"]
    (row,) = [row for row in rows if row["name"] == "datasets differ"]
    assert row["df"] == 24
    assert 0 < row["p_participant"] <= 1


def test_a_group_with_the_opposite_taste_is_found() -> None:
    votes = simulated(3, spread=0.2)
    swapped = np.where((votes.participant < 10) & (votes.choice < 2), 1 - votes.choice, votes.choice).astype(np.int8)
    opposed = VotesTable(**{**vars(votes), "choice": swapped})
    analysis = analyse(opposed, AnalysisSettings(groups={"age": TWENTY}))
    by_dataset = {row["dataset"]: row for row in analysis["tests"] if row["name"] == "group age"}
    assert set(by_dataset) == {"0", "1", "all"}
    assert by_dataset["all"]["p_participant"] < 1e-3
    overall = {(row["group"], row["item"]): row["score"] for row in analysis["groups"] if row["dataset"] == "all"}
    assert overall["young", "3"] > 0 > overall["old", "3"]


def test_groups_and_datasets_on_which_all_vote_alike_say_nothing_about_other_people() -> None:
    """The variation between people is then rounding, which would make any difference certain."""
    pairs, choices = [("a", "b"), ("b", "c"), ("a", "c")] * 2, {"ball": "aabaab", "box": "babbba"}
    rows = [
        {"participant": f"p{who}", "dataset": dataset, "item_a": a, "item_b": b, "choice": choice}
        for who in range(14)
        for dataset, votes in choices.items()
        for (a, b), choice in zip(pairs, votes, strict=True)
    ]
    (datasets,) = analyse(votes_from_rows(rows))["tests"]
    assert (datasets["name"], datasets["p_participant"]) == ("datasets differ", None)
    groups = {"taste": {f"p{who}": "one" if who < 7 else "other" for who in range(14)}}
    swapped = {"a": "b", "b": "a"}
    split = [
        row if groups["taste"][row["participant"]] == "one" else row | {"choice": swapped[row["choice"]]}
        for row in rows
    ]
    tests = analyse(votes_from_rows(split), AnalysisSettings(groups=groups))["tests"]
    assert {test["p_participant"] for test in tests if test["name"] == "group taste"} == {None}


def test_who_belongs_to_no_group_is_left_out_of_the_comparison() -> None:
    of = {name: group for name, group in TWENTY.items() if int(name) % 2}
    rows = analyse(simulated(2), AnalysisSettings(groups={"age": of}))["groups"]
    assert {row["n_participants"] for row in rows} == {5}


def test_groups_that_cannot_be_compared_are_named() -> None:
    """A group of one has no spread; a single group has no other."""
    alone = {name: "old" if name == "1" else "young" for name in TWENTY}
    analysis = analyse(simulated(2), AnalysisSettings(groups={"age": alone, "glasses": dict.fromkeys(TWENTY, "yes")}))
    said = [row["text"] for row in analysis["findings"] if row["about"] == "groups"]
    assert said == [
        "Whether the groups differ by age could not be tested with these participants.",
        "There is nothing to compare by glasses: all who voted and have a group are in one.",
    ]


@pytest.mark.parametrize("of", [{}, {"somebody else": "old"}])
def test_a_grouping_of_nobody_who_voted_is_refused(of: dict[str, str]) -> None:
    with pytest.raises(VotesError, match="none of 20 participants"):
        analyse(simulated(2), AnalysisSettings(groups={"age": of}))
    vote = {"participant": "P1", "dataset": "d", "item_a": "x", "item_b": "y", "choice": "a"}
    with pytest.raises(VotesError, match=r"none of 1 participant, e.g. 'P1', has"):
        analyse(votes_from_rows([vote]), AnalysisSettings(groups={"age": of}))


@pytest.mark.slow
def test_groups_are_read_from_a_file_and_stand_in_the_report(tmp_path: Path) -> None:
    frame_from_votes(simulated(2)).to_csv(tmp_path / "votes.csv", index=False)
    lines = [f"{name},{group},yes" for name, group in TWENTY.items()]
    (tmp_path / "people.csv").write_text("\n".join(["participant,age,glasses", *lines]), encoding="utf-8")
    out = tmp_path / "out"
    analyse_file(tmp_path / "votes.csv", out, participants=tmp_path / "people.csv", groups=["age"])
    assert "Groups of participants" in (out / "report.html").read_text(encoding="utf-8")
    assert (out / "figures" / "group_age.svg").is_file()
    with pytest.raises(ValueError, match="has no grouping 'sex'; it has age, glasses"):
        analyse_file(tmp_path / "votes.csv", out, participants=tmp_path / "people.csv", groups=["sex"])
    with pytest.raises(ValueError, match="needs a participants file"):
        analyse_file(tmp_path / "votes.csv", out, groups=["age"])


def test_a_participant_listed_twice_is_named(tmp_path: Path) -> None:
    path = tmp_path / "people.csv"
    path.write_text("participant,age\np1,old\np2,\np1,young\n", encoding="utf-8")
    with pytest.raises(VotesError, match="row 3: the participant 'p1' appears a second time"):
        read_participants(path)


def test_an_empty_cell_puts_a_participant_into_no_group(tmp_path: Path) -> None:
    path = tmp_path / "people.csv"
    path.write_text("participant,age\np1,old\np2,\n", encoding="utf-8")
    assert read_participants(path) == {"age": {"p1": "old"}}


def test_concordance_is_friedmans_statistic_with_datasets_as_blocks() -> None:
    values = np.array([[1.0, 2.0, 3.0, 4.0], [1.0, 3.0, 2.0, 4.0], [2.0, 2.0, 3.0, 1.0]])
    votes = simulate_votes(StudyPlan(4, 3, 5), np.zeros(4), np.random.default_rng(1))
    found = concordance({str(k): dict(zip("wxyz", row, strict=True)) for k, row in enumerate(values.tolist())}, votes)
    assert found is not None
    assert found["chi2"] == pytest.approx(friedmanchisquare(*values.T)[0])


def test_conditions_that_win_equally_often_rank_alike() -> None:
    """Everybody judges every pair without ties, so scores are in the order of the numbers of wins."""
    plan = StudyPlan(6, 3, 3, tie_rate=0.0)
    votes = simulate_votes(plan, np.zeros(6), np.random.default_rng(8))
    analysis = analyse(votes)
    wins = np.zeros((3, 6), int)
    np.add.at(wins, (votes.dataset, np.where(votes.choice == 0, votes.item_a, votes.item_b)), 1)
    assert any(len(set(row)) < 6 for row in wins.tolist())
    agreement = {(row["dataset_a"], row["dataset_b"]): row for row in analysis["dataset_agreement"]}
    for first, second in combinations(range(3), 2):
        row = agreement[str(first), str(second)]
        assert row["spearman"] == pytest.approx(spearmanr(wins[first], wins[second]).statistic)
        assert row["kendall"] == pytest.approx(kendalltau(wins[first], wins[second]).statistic)
    assert analysis["dataset_concordance"]["chi2"] == pytest.approx(friedmanchisquare(*wins.T)[0])


def test_people_with_opinions_of_their_own_make_no_concordance() -> None:
    """The same 12 people judge all five datasets and share no preference: their own make all datasets alike."""
    rng, datasets = np.random.default_rng(3), list("01234")
    plan = StudyPlan(6, 5, 12, tie_rate=0.0, spread=1.5)
    p_values = [concordance_p_value(simulate_votes(plan, np.zeros(6), rng), datasets) for _ in range(20)]
    assert sum(p is not None and p <= 0.05 for p in p_values) <= 4  # 3 in 1000 at 5 %; chi-square rejects in half
    shared = simulate_votes(plan, np.linspace(-2, 2, 6), rng)
    assert (concordance_p_value(shared, datasets) or 1) < 0.01
    alone = shared.where(shared.participant == 0)
    assert concordance_p_value(alone, datasets) is None


def test_datasets_with_one_order_agree_and_with_the_reverse_disagree() -> None:
    up, down = {"x": 1.0, "y": 2.0, "z": 3.0}, {"x": 3.0, "y": 2.0, "z": 1.0}
    rows = dataset_agreement_rows({"a": up, "b": up, "c": down})
    assert [row["kendall"] for row in rows] == pytest.approx([1.0, -1.0, -1.0])


def test_datasets_with_two_items_in_common_have_no_correlation() -> None:
    (row,) = dataset_agreement_rows({"a": {"x": 1.0, "y": 2.0}, "b": {"x": 2.0, "y": 1.0, "z": 0.0}})
    assert (row["n_items"], row["pearson"]) == (2, None)


def test_the_penalised_estimate_is_chosen_by_name() -> None:
    votes = simulated(1, participants=2, datasets=1)
    never = VotesTable(**{**vars(votes), "choice": np.where(votes.item_b == 3, 1, votes.choice).astype(np.int8)})
    estimates = {
        penalty: {row["penalty"] for row in analyse(never, AnalysisSettings(penalty=penalty))["scores"]}
        for penalty in ("firth", "ridge")
    }
    assert estimates == {"firth": {"firth"}, "ridge": {"ridge 0.1"}}
    with pytest.raises(ValueError, match="penalty is 'lasso'"):
        AnalysisSettings(penalty="lasso")
