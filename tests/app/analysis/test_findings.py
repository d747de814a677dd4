"""The sentences of an analysis follow its numbers, and never say more than the votes hold."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.analysis import AnalysisSettings, analyse, votes_from_rows, write_analysis
from app.analysis.report.page import report_page
from app.analysis.report.sections import sections

DEPTHS, FUSIONS = ("id", "dr", "pm"), ("fa", "fb")
FACTORS = {
    "depth": {f"{depth}_{fusion}": depth for depth in DEPTHS for fusion in FUSIONS},
    "fusion": {f"{depth}_{fusion}": fusion for depth in DEPTHS for fusion in FUSIONS},
}
Votes = list[dict[str, Any]]


def votes_by(abilities: Mapping[str, float], n_participants: int, *, ties: float = 0.1, seed: int = 1) -> Votes:
    """Every participant judges every pair once, as the Bradley-Terry model says."""
    rng = np.random.default_rng(seed)
    votes = []
    for participant in range(n_participants):
        for a, b in combinations(abilities, 2):
            wins = rng.random() < 1 / (1 + np.exp(abilities[b] - abilities[a]))
            choice = "none" if rng.random() < ties else "a" if wins else "b"
            first = a if rng.random() < 0.5 else b
            vote = {"participant": f"p{participant}", "dataset": "ball", "item_a": a, "item_b": b}
            votes.append(vote | {"choice": choice, "first_shown": first})
    return votes


def sentences(votes: Votes, **settings: Any) -> dict[str, str]:
    """The sentences by what they are about, those about the same thing joined."""
    by_subject: dict[str, str] = {}
    for row in analyse(votes_from_rows(votes), AnalysisSettings(by_dataset=False, **settings))["findings"]:
        by_subject[row["about"]] = f"{by_subject.get(row['about'], '')} {row['text']}".strip()
    return by_subject


def renamed(votes: Votes, names: Mapping[str, str]) -> Votes:
    places = ("item_a", "item_b", "first_shown")
    return [vote | {place: names.get(vote[place], vote[place]) for place in places} for vote in votes]


CLEAR = {"good": 2.0, "fair": 0.0, "bad": -2.0}


def test_the_settings_name_the_intervals_of_datasets_that_no_vote_links() -> None:
    halves = [
        vote | {"dataset": dataset}
        for dataset, pair in (("ball", {"x": 0.0, "y": 0.4}), ("box", {"u": 0.0, "v": 0.4}))
        for vote in votes_by(pair, 9)
    ]
    analysis = analyse(votes_from_rows(halves))
    assert any(row["ci_low"] is not None for row in analysis["scores"])
    (settings,) = [row["text"] for row in analysis["findings"] if row["about"] == "settings"]
    assert "95 % intervals: none" not in settings


def test_best_and_worst_are_those_that_the_votes_say() -> None:
    text = sentences(votes_by(CLEAR, 20))
    assert text["best"].startswith("good is best: it has the highest score, +")
    assert text["worst"].startswith("bad is worst")
    assert re.search(r"good is preferred in (\d+) of \1 decided votes; the model predicts 9\d %", text["difference"])
    assert text["told apart"] == "All 3 conditions differ from each other (5 % level, all pairs, Holm)."
    assert "limits" not in text


@pytest.mark.parametrize(("people", "is_said"), [(11, True), (12, False)])
def test_with_few_people_a_difference_that_is_found_is_said_to_look_larger_than_it_is(
    people: int, is_said: bool
) -> None:
    difference = sentences(votes_by({"good": 1.5, "fair": 0.0, "bad": -1.5}, people))["difference"]
    assert ("looks larger than it is" in difference) == is_said


def test_where_winners_are_swapped_the_sentences_are() -> None:
    votes, names = votes_by(CLEAR, 20), {"good": "bad", "bad": "good"}
    before, after = sentences(votes), sentences(renamed(votes, names))
    swapped = {about: re.sub("good|bad", lambda name: names[name[0]], text) for about, text in before.items()}
    assert after == swapped
    assert after["best"].startswith("bad is best")


def test_without_a_difference_nobody_is_best() -> None:
    text = sentences(votes_by(dict.fromkeys(CLEAR, 0.0), 20))
    assert not {"best", "worst", "difference"} & set(text)
    assert text["told apart"].startswith("The answers do not tell any of the 3 pairs of 3 conditions apart")
    assert "that does not mean that they are equal" in text["told apart"]


def test_conditions_that_are_alike_are_named_beside_the_best() -> None:
    text = sentences(votes_by({"good": 1.5, "as good": 1.5, "bad": -1.5}, 20))
    assert re.match(r"(as )?good has the highest score, .* but is not told apart from (as )?good\.", text["best"])
    assert "2 of 3 pairs" in text["told apart"]
    assert "(a). Not told apart does not mean equal." in text["told apart"]


@pytest.mark.parametrize(
    ("of_depth", "matters"),
    [({"id": -1.0, "dr": 0.0, "pm": 1.0}, True), (dict.fromkeys(DEPTHS, 0.0), False)],
)
def test_a_factor_matters_only_while_it_has_an_effect(of_depth: dict[str, float], matters: bool) -> None:
    abilities = {f"{d}_{f}": of_depth[d] + (0.6 if f == "fb" else -0.6) for d in DEPTHS for f in FUSIONS}
    text = sentences(votes_by(abilities, 20), factors=FACTORS)["factors"]
    shown = "An effect of {} is shown on this dataset (p < 0.001): {} is preferred to {} in"
    assert (shown.format("depth", "pm", "id") in text) == matters
    assert ("No effect of depth is shown on this dataset" in text) != matters
    assert shown.format("fusion", "fb", "fa") in text


def test_levels_that_are_alike_are_named_beside_their_factor() -> None:
    of_depth = {"id": -1.0, "dr": 1.0, "pm": 1.0}
    abilities = {f"{d}_{f}": of_depth[d] + (0.6 if f == "fb" else -0.6) for d in DEPTHS for f in FUSIONS}
    text = sentences(votes_by(abilities, 20), factors=FACTORS)["factors"]
    assert re.search(r"effect of depth .*; not told apart: (dr and pm|pm and dr)\.", text)
    assert "An effect of fusion is shown" in text
    assert text.count("not told apart") == 1


def test_a_measure_that_goes_against_the_scores_is_not_said_to_go_with_them() -> None:
    abilities = dict(zip("abcdef", np.linspace(2, -2, 6), strict=True))
    values = {"up": abilities, "down": {name: -ability for name, ability in abilities.items()}}
    measures = {name: {"ball": value} for name, value in values.items()}
    said = sentences(votes_by(abilities, 20), measures=measures, better={"up": "higher", "down": "lower"})["measures"]
    assert said.startswith(
        "Of 2 objective measures, 2 are shown to go with the scores on this dataset; closest by rank is up, rank "
        "correlation +1.00 (95 %"
    )
    said = sentences(votes_by(abilities, 20), measures=measures, better=dict.fromkeys(measures, "higher"))["measures"]
    assert said.startswith(
        "Of 2 objective measures, 1 is shown to go with the scores on this dataset; closest by rank is up, rank "
        "correlation +1.00 (95 %"
    )
    assert "go against the scores on this dataset, in the direction that they state: down, rank correlation" in said
    alone = sentences(votes_by(abilities, 20), measures={"up": measures["up"]}, better={"up": "lower"})["measures"]
    assert alone.startswith("It is not shown that the objective measure predicts the scores. Shown to go against")


@pytest.mark.slow
def test_the_order_of_showing_is_told_with_its_direction() -> None:
    votes = votes_by(dict.fromkeys("abcd", 0.0), 30)
    helped = [
        vote | {"choice": "a" if vote["first_shown"] == vote["item_a"] else "b"} if number % 2 else vote
        for number, vote in enumerate(votes)
    ]
    harmed = [
        vote | {"first_shown": vote["item_b" if vote["first_shown"] == vote["item_a"] else "item_a"]} for vote in helped
    ]
    assert sentences(helped, order_effect=True)["order"].startswith("Being shown first helps")
    assert sentences(harmed, order_effect=True)["order"].startswith("Being shown first harms")
    assert "No effect of being shown first is shown" in sentences(votes, order_effect=True)["order"]
    assert sentences(helped)["order"] == sentences(helped, order_effect=True)["order"]  # tested wherever recorded
    unordered = [vote | {"first_shown": ""} for vote in helped]
    assert "order" not in sentences(unordered)


def with_a_winner(votes: Votes, winner: str) -> Votes:
    """The same votes, but that the winner wins all of its own."""
    return [
        vote | {"choice": "a" if vote["item_a"] == winner else "b"}
        if winner in (vote["item_a"], vote["item_b"])
        else vote
        for vote in votes
    ]


@pytest.mark.slow
def test_a_condition_that_wins_everything_leaves_the_others_their_inference() -> None:
    votes = votes_by({"good": 1.0, "fair": 0.0, "bad": -1.0, "best": 0.0}, 22)
    won = with_a_winner(votes, "best")
    analysis = analyse(votes_from_rows(won), AnalysisSettings(by_dataset=False))
    others = analyse(
        votes_from_rows([vote for vote in won if "best" not in (vote["item_a"], vote["item_b"])]),
        AnalysisSettings(by_dataset=False),
    )
    pairs = {(row["item_a"], row["item_b"]): row for row in analysis["contrasts"]}
    for row in others["contrasts"]:
        same = pairs[row["item_a"], row["item_b"]]
        assert [same[name] for name in ("difference", "se", "p_value", "ci_low", "ci_high")] == [
            row[name] for name in ("difference", "se", "p_value", "ci_low", "ci_high")
        ]
    against_best = [row for pair, row in pairs.items() if "best" in pair]
    for row in against_best:  # 22 of 22 participants
        assert row["p_value"] == pytest.approx(2 * 0.5**22)
        (limit,) = (abs(row[name]) for name in ("ci_low", "ci_high") if row[name] is not None)
        assert limit == pytest.approx(np.log(0.05 ** (1 / 22) / (1 - 0.05 ** (1 / 22))))
        assert limit < abs(row["difference"])
    by_item = {row["item"]: row for row in analysis["scores"]}
    for row in others["scores"]:
        ours = by_item[row["item"]]
        assert ours["ci_high"] - ours["ci_low"] == pytest.approx(row["ci_high"] - row["ci_low"])
    assert by_item["best"]["ci_low"] is None
    assert {row["item"]: row["letters"] for row in analysis["scores"]}["best"] == "a"
    text = sentences(won)
    assert text["best"].startswith("best is best: it has the highest score, +")
    assert "exact sign test over participants and a one-sided limit" in text["ranking"]
    assert "Of best and bad, every decided vote prefers best: its share is at least 87 %" in text["difference"]


@pytest.mark.slow
def test_separation_is_no_less_evidence_than_its_neighbour() -> None:
    def p_value(*choices: str) -> float:
        votes = [
            {"participant": f"p{who}", "dataset": "", "item_a": "x", "item_b": "y", "choice": choice}
            for who, choice in enumerate(choices)
        ]
        return float(analyse(votes_from_rows(votes))["contrasts"][0]["p_value"])

    assert p_value(*["a"] * 66) < p_value(*["a"] * 65, "b") < 0.001
    assert p_value(*["a"] * 3) == pytest.approx(0.25)
    assert p_value(*["a"] * 20, *["none"] * 8) == pytest.approx(2 * 0.5**20)


def test_a_participant_who_votes_often_counts_once_in_a_sign_test() -> None:
    votes = [
        {"participant": f"p{number % 5}", "dataset": "", "item_a": "x", "item_b": "y", "choice": "a"}
        for number in range(100)
    ]
    (row,) = analyse(votes_from_rows(votes))["contrasts"]
    assert (row["p_value"], row["method"]) == (pytest.approx(2 * 0.5**5), "sign test over participants")
    (row,) = analyse(votes_from_rows([vote | {"participant": ""} for vote in votes]))["contrasts"]
    assert (row["p_value"], row["method"]) == (pytest.approx(2 * 0.5**100), "sign test over votes")


def test_separated_conditions_that_were_never_compared_have_no_test() -> None:
    votes = [
        {"participant": f"p{who}", "dataset": "", "item_a": a, "item_b": b, "choice": "a"}
        for who in range(12)
        for a, b in (("x", "y"), ("y", "z"))
    ]
    rows = {row["item_a"] + row["item_b"]: row for row in analyse(votes_from_rows(votes))["contrasts"]}
    assert rows["xz"]["method"] == "never compared"
    assert (rows["xz"]["p_value"], rows["xz"]["p_holm"], rows["xz"]["ci_low"]) == (1.0, 1.0, None)
    assert rows["xy"]["p_holm"] == pytest.approx(2 * rows["xy"]["p_value"])  # of two tests, not three


def test_all_ties_prefer_nothing() -> None:
    text = sentences([vote | {"choice": "none"} for vote in votes_by(CLEAR, 5)])
    assert text["ranking"] == "All 3 conditions have the same score: the votes prefer none of them."
    assert text["ties"] == "All 15 votes are without preference."
    assert "limits" not in text  # there are no intervals and no tests that could be uncertain


def test_a_single_participant_says_nothing_about_other_people() -> None:
    text = sentences(votes_by(dict.fromkeys(CLEAR, 0.0), 1, seed=3) * 4 + votes_by(CLEAR, 1, seed=8))
    assert "nothing can be concluded about other people" in text["limits"]
    assert not {"best", "worst", "told apart"} & set(text)


def test_two_participants_for_three_conditions_are_said_to_be_too_few() -> None:
    said = sentences(votes_by({"a": 1.0, "b": 0.0, "c": -1.0}, 2, seed=4))
    assert "was not tested: 2 participants are too few, or vote too much alike, to know" in said["ranking"]


@pytest.mark.slow
def test_a_single_participant_on_several_datasets_gets_a_report(tmp_path: Path) -> None:
    votes = [vote | {"dataset": name} for name in ("x", "y", "z") for vote in votes_by(CLEAR, 1, seed=ord(name))]
    write_analysis(analyse(votes_from_rows(votes)), tmp_path)
    assert "Agreement between datasets" in (tmp_path / "report.md").read_text(encoding="utf-8")


def test_groups_that_no_vote_links_are_not_ranked() -> None:
    votes = [*votes_by({"a": 0.0, "b": 1.0}, 12), *votes_by({"c": 0.0, "d": 1.0}, 12)]
    assert sentences(votes)["ranking"].startswith("No vote links these groups of conditions: {a and b}; {c and d}.")


@pytest.mark.slow
def test_a_condition_without_a_vote_that_counts_is_named() -> None:
    votes = votes_by(CLEAR, 12)
    practice = votes[0] | {"item_a": "new", "first_shown": "new", "practice": True}
    assert sentences([*votes, practice])["missing"].startswith("new has no vote that counts")
    assert "missing" not in sentences([*votes, practice | {"practice": False}])


@pytest.mark.slow
@pytest.mark.parametrize("n_conditions", [2, 200])
def test_two_and_two_hundred_conditions_are_ranked(n_conditions: int) -> None:
    names = [f"c{number}" for number in range(n_conditions)]
    neighbours = [dict(zip(pair, (0.5, 0.0), strict=True)) for pair in pairwise(names)]
    votes = [vote for seed, pair in enumerate(neighbours, 1) for vote in votes_by(pair, 12, ties=0.0, seed=seed)]
    text = sentences(votes)
    if n_conditions == 2:
        assert text["told apart"].startswith("The answers do not tell the two conditions apart")
    else:
        assert "200 conditions have too many pairs" in text["ranking"]
        assert "no more than the numbers that are estimated" in text["limits"]


def test_nothing_left_is_said() -> None:
    assert sentences([vote | {"practice": True} for vote in votes_by(CLEAR, 2)]) == {
        "ranking": "No vote counts, so nothing can be concluded."
    }


def partial(n_participants: int, n_conditions: int, seed: int) -> Votes:
    """Each participant judges a share of the pairs of many conditions."""
    votes = votes_by({f"c{n}": 0.05 * n for n in range(n_conditions)}, n_participants, ties=0.0, seed=seed)
    return [vote for number, vote in enumerate(votes) if number % 3 == 0]


def test_few_participants_never_make_errors_smaller_than_those_of_the_votes() -> None:
    analysis = analyse(votes_from_rows(partial(4, 10, seed=3)), AnalysisSettings(by_dataset=False))
    scores, contrasts = analysis["scores"], analysis["contrasts"]
    assert any(row["se_participant"] < row["se"] for row in scores)  # which would be certain without reason
    t_of_3, normal = 3.182, 1.96
    for row in scores:
        wider = max(t_of_3 * row["se_participant"], normal * row["se"])
        assert (row["ci_high"] - row["ci_low"]) / 2 == pytest.approx(wider, rel=1e-3)
    for row in contrasts:
        assert row["ci_high"] - row["ci_low"] >= 2 * 0.999 * normal * row["se"]
        assert (row["p_value"] < 0.05) == (row["ci_low"] > 0 or row["ci_high"] < 0)
    (limits,) = (row["text"] for row in analysis["findings"] if row["about"] == "limits")
    assert limits.startswith("4 participants are few (fewer than 12)")


def test_one_p_value_of_several_datasets_is_no_agreement_beyond_chance() -> None:
    from app.analysis.findings.people import people_findings

    analysis = analyse(votes_from_rows(votes_by(CLEAR, 12, ties=0.0)))
    (row,) = analysis["agreement"]
    rows = [row | {"dataset": f"d{n}", "u": 0.02, "p_value": p} for n, p in enumerate((0.03, 0.4, 0.5, 0.6, 0.7))]
    agreed = [text["text"] for text in people_findings(analysis | {"agreement": rows}) if text["about"] == "agreement"]
    assert agreed[0].endswith("more than by chance on 0 of them (Holm).")
    pair_of_people = [row | {"p_value": None} for row in rows]
    agreed = [text["text"] for text in people_findings(analysis | {"agreement": pair_of_people})]
    assert agreed[0].endswith("Kendall's u = 0.02 on average over 5 datasets.")


@pytest.mark.parametrize(("role", "is_said"), [("repeat", True), ("identical", False)])
def test_a_repeated_pair_that_is_answered_otherwise_is_said_to_be_what_honest_people_do_too(
    role: str, is_said: bool
) -> None:
    votes = votes_by(CLEAR, 6)
    again = [vote | {"role": role, "choice": "b"} for vote in votes[::3]]
    again = again if is_said else [vote | {"item_b": vote["item_a"], "first_shown": vote["item_a"]} for vote in again]
    checks = sentences([*(vote | {"role": "main"} for vote in votes), *again])["checks"]
    assert ("repeated pair" in checks) == is_said
    assert ("honest people" in checks) == is_said


@pytest.mark.parametrize(("people", "is_said"), [(11, True), (12, False)])
def test_with_few_people_an_order_effect_that_is_found_is_said_to_look_larger_than_it_is(
    people: int, is_said: bool
) -> None:
    votes = [
        vote | {"choice": "a" if vote["first_shown"] == vote["item_a"] else "b"} if number % 4 else vote
        for number, vote in enumerate(votes_by(dict.fromkeys("abcdef", 0.0), people))
    ]
    order = sentences(votes)["order"]
    assert order.startswith("Being shown first helps")
    assert ("looks larger than it is" in order) == is_said


def test_the_report_says_that_errors_of_scores_lower_the_correlations_of_measures() -> None:
    values = {"ball": {"good": 3.0, "fair": 2.0, "bad": 1.0}}
    analysis = analyse(votes_from_rows(votes_by(CLEAR, 12)), AnalysisSettings(measures={"psnr": values}))
    (measures,) = (each for each in sections(analysis, {}) if each["title"].startswith("Do objective measures"))
    assert "Errors of the scores lower correlations, of ranks most" in " ".join(measures["paragraphs"])


def test_who_stands_out_is_named_and_nobody_is_where_nobody_does() -> None:
    votes = votes_by(CLEAR, 20, ties=0.0) * 4
    turned = [
        vote | {"choice": {"a": "b", "b": "a"}[vote["choice"]]} if vote["participant"] == "p7" else vote
        for vote in votes
    ]
    assert sentences(turned)["participants"].startswith("Participant p7 (")
    assert sentences(votes_by(dict.fromkeys("abc", 0.0), 6))["participants"].startswith("Nobody of 6 stands out.")


def test_a_zero_that_rounding_made_negative_has_no_minus() -> None:
    from app.analysis.reading.phrases import signed, unsigned

    assert [(signed(value), unsigned(value)) for value in (-1e-17, -0.004, -0.006)] == [
        ("+0.00", "0.00"),
        ("+0.00", "0.00"),
        ("−0.01", "−0.01"),
    ]


@pytest.mark.parametrize(
    ("share", "text"), [(1 / 200, "less than 1 %"), (1 / 100, "1 %"), (199 / 200, "more than 99 %"), (1.0, "100 %")]
)
def test_a_share_that_is_not_certain_is_never_said_as_nothing_or_all(share: float, text: str) -> None:
    from app.analysis.reading.phrases import percent

    assert percent(share) == text


@pytest.mark.parametrize(
    ("names", "text"),
    [
        ((), ""),
        (("a",), "a"),
        (("a", "b"), "a and b"),
        (("a", "b", "c"), "a, b and c"),
        (tuple("abcdefg"), "a, b, c, d, e and 2 more"),
    ],
)
def test_names_are_listed_as_in_a_sentence(names: Sequence[str], text: str) -> None:
    from app.analysis.reading.phrases import listed

    assert listed(names) == text


def always_first(votes: Votes) -> Votes:
    """The same votes, each pair shown in one order only."""
    return [vote | {"first_shown": min(vote["item_a"], vote["item_b"])} for vote in votes]


@pytest.mark.parametrize(
    ("spoilt", "why"),
    [
        (lambda votes: [votes[0] | {"first_shown": ""}, *votes[1:]], "1 of 120 votes does not record"),
        (always_first, "the orders are unbalanced"),
        (lambda votes: [vote | {"first_shown": ""} for vote in votes], "the scores have no finite estimate"),
    ],
)
def test_without_orders_that_can_tell_the_scores_are_those_without_an_order_effect(spoilt: Any, why: str) -> None:
    votes = votes_by({"a": 2.5, "b": 0.3, "c": 0.0, "d": -0.3}, 20, ties=0.0, seed=5)
    winner_first = [
        vote | {"item_a": vote["item_b"], "item_b": vote["item_a"], "choice": "a"} if vote["choice"] == "b" else vote
        for vote in spoilt(votes)
    ]
    plain, asked = (
        analyse(votes_from_rows(winner_first), AnalysisSettings(by_dataset=False, order_effect=order))
        for order in (False, True)
    )
    assert asked["scores"] == plain["scores"]
    assert asked["contrasts"] == plain["contrasts"]
    assert why in next(row["text"] for row in asked["findings"] if row["about"] == "order")
    assert why in asked["warnings"][0]
    assert "order effect not estimated" in asked["findings"][-1]["text"]
    assert not asked["tests"]


def test_the_order_effect_is_one_hypothesis_however_many_models_hold_it() -> None:
    abilities = {f"{d}_{f}": 0.0 for d in DEPTHS for f in FUSIONS}
    settings = AnalysisSettings(by_dataset=False, order_effect=True, factors=FACTORS)
    analysis = analyse(votes_from_rows(votes_by(abilities, 20)), settings)
    tests = [row for row in analysis["tests"] if row["name"] == "order effect"]
    assert len(tests) == 4
    assert all(row["p_holm"] == row["p_participant"] for row in tests)


def report_of(votes: Votes, **settings: Any) -> str:
    return report_page("report.md", analyse(votes_from_rows(votes), AnalysisSettings(**settings)), [], "votes")


def test_the_methods_of_a_report_are_those_that_were_used_not_those_that_were_asked_for() -> None:
    wide, used = {name: ability / 4 for name, ability in CLEAR.items()}, "100 bootstrap samples of participants"
    assert used in report_of(votes_by(wide, 20), bootstrap=100)
    few = report_of(votes_by(wide, 8), bootstrap=100)  # too few people for percentiles
    assert used not in few
    assert "intervals from the t distribution" in few
    shown, votes = "An advantage of the condition shown first was estimated", votes_by(wide, 20)
    assert shown in report_of(votes, order_effect=True)
    assert shown not in report_of([vote | {"first_shown": ""} for vote in votes[:9]] + votes[9:], order_effect=True)


def test_a_difference_of_one_jod_is_said_as_the_model_of_ties_has_it() -> None:
    votes = votes_by({name: ability / 4 for name, ability in CLEAR.items()}, 20, ties=0.4)
    assert "one condition is preferred three times as often" in report_of(votes)
    (model,) = analyse(votes_from_rows(votes), AnalysisSettings(ties="rao-kupper", by_dataset=False))["models"]
    theta = np.exp(model["log_theta"])
    ratio = (1 + 3 * theta) / (1 + theta / 3)  # P(win) : P(loss) at a difference of ln 3
    assert f"one condition is preferred about {ratio:.1f} times as often" in report_of(votes, ties="rao-kupper")


def test_a_mark_in_a_name_ends_no_cell_of_the_written_report() -> None:
    votes = votes_by({"a|b": 0.5, "c": 0.0, "d": -0.5}, 20)
    text = report_of(votes)
    (header, row) = (
        next(line for line in text.splitlines() if start in line) for start in ("| condition |", r"| a\|b |")
    )
    assert row.replace(r"\|", "").count("|") == header.count("|")
    assert "a|b" not in text


def test_ends_of_an_interval_that_are_rounded_to_the_same_are_said_once() -> None:
    from app.analysis.reading.phrases import number_with_interval

    row = {"score": 0.181, "ci_low": 0.179, "ci_high": 0.182}
    assert number_with_interval(row, "score") == "0.18 (95 % interval 0.18 at both ends)"
    assert number_with_interval(row | {"ci_high": 0.19}, "score") == "0.18 (95 % interval 0.18 to 0.19)"


@pytest.mark.parametrize(
    ("n", "total", "said"),
    [(2, 5, "2 of 5 participants"), (1, 1, "the only participant"), (0, 1, "none, as there is one participant")],
)
def test_one_of_one_is_said_in_words(n: int, total: int, said: str) -> None:
    from app.analysis.reading.phrases import part

    assert part(n, total, "participant") == said


def test_votes_at_random_that_would_make_less_than_one_circular_triad_are_not_said_to_make_none() -> None:
    said = sentences(votes_by(CLEAR, 1, ties=0.0))["participants"]
    assert "votes at random with the same ties would make 0.2." in said


def test_so_early_that_hardly_any_p_value_counts_it_is_said_so() -> None:
    said = sentences(votes_by(CLEAR, 3), planned_participants=24)["interim"]
    assert "Not even p = 0.0001 counts so early" in said


def test_datasets_on_which_several_score_highest_name_them_all() -> None:
    shares = {"box": (17, 16, 12), "ball": (3, 12, 16), "face": (10, 15, 15)}  # of 20 votes, for the first of a pair
    votes = [
        {"participant": f"p{n}", "dataset": dataset, "item_a": a, "item_b": b}
        | {"choice": "a" if (n * 7 + place * 3) % 20 < wins else "b"}
        for dataset, counts in shares.items()
        for place, ((a, b), wins) in enumerate(zip(combinations(("x", "y", "z"), 2), counts, strict=True))
        for n in range(20)
    ]
    rows = analyse(votes_from_rows(votes))["findings"]
    (said,) = [row["text"] for row in rows if row["about"] == "datasets"]
    assert "y on ball; x on box; x and y, the same, on face." in said


def test_two_conditions_of_the_same_score_are_both_not_all() -> None:
    votes = [{"participant": "p", "dataset": "d", "item_a": "x", "item_b": "y", "choice": "none"}]
    assert sentences(votes)["ranking"] == "Both conditions have the same score: the votes prefer none of them."


def test_methods_name_no_intervals_where_there_are_none() -> None:
    said = report_of(votes_by(CLEAR, 1))
    assert "Intervals: none." in said
    assert "standard errors come from the sandwich estimator" not in said


def test_one_of_several_pairs_differs() -> None:
    analysis = analyse(votes_from_rows(votes_by({"good": 2.2, "bad": -2.2}, 12, ties=0.0)))
    texts = " ".join(text for part in sections(analysis, {}) for text in part["paragraphs"])
    assert "1 of 1 differs" in texts


def test_a_factor_of_one_level_is_not_dropped_in_silence() -> None:
    votes = votes_from_rows(votes_by({"x": 0.0, "y": 0.4}, 3))
    analysis = analyse(votes, AnalysisSettings(factors={"depth": {"x": "10", "y": "10"}}))
    assert "all conditions have the same depth, 10: nothing can be said about it" in analysis["warnings"]
