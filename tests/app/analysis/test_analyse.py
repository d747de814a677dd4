"""The whole analysis: its keys, its counts, and what it says about data that cannot be analysed."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.analysis import AnalysisSettings, VotesError, analyse, analyse_file, votes_from_rows
from app.analysis.analyse import scored
from app.analysis.comparisons.factors import votes_with_levels
from app.analysis.model.contrasts import ALL_ALIKE, BY_SCORES
from app.analysis.model.likelihood.ties import TIE_MODELS
from app.analysis.reading.read_votes import read_votes
from app.analysis.reading.votes_table import VotesTable, votes_from_indices
from app.analysis.report.page import report_page
from app.analysis.tables import TABLES

KEYS = {
    "scores": "comparison dataset item score se se_participant ci_low ci_high n_votes wins losses ties status",
    "models": "comparison dataset ties log_nu order_effect order_se loglik deviance pearson_x2 df p_value converged "
    "iterations status",
    "triads": "participant dataset n_items complete circular circular_expected_ties circular_max zeta p_value",
    "agreement": "dataset u chi2 df p_value",
    "observers": "participant flags",
}
FACTORS = {
    "depth": {f"{d}_{f}": d for d in ("id", "dr", "pm") for f in ("fa", "fb")},
    "fusion": {f"{d}_{f}": f for d in ("id", "dr", "pm") for f in ("fa", "fb")},
}


def study(seed: int = 0, *, n_participants: int = 8, datasets: tuple[str, ...] = ("ball", "box")) -> VotesTable:
    rng = np.random.default_rng(seed)
    items = list(FACTORS["depth"])
    strength = dict(zip(items, np.linspace(-0.8, 0.8, 6), strict=True))
    rows = []
    for participant in range(n_participants):
        for dataset in datasets:
            for index, a in enumerate(items):
                for b in items[index + 1 :]:
                    chance = 1 / (1 + np.exp(strength[b] - strength[a]))
                    choice = "none" if rng.random() < 0.2 else "a" if rng.random() < chance else "b"
                    vote = {"participant": f"p{participant}", "dataset": dataset, "item_a": a, "item_b": b}
                    rows.append(vote | {"choice": choice, "first_shown": a if rng.random() < 0.5 else b})
    return votes_from_rows(rows)


def only(rows: list[dict[str, Any]], **wanted: str) -> list[dict[str, Any]]:
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


@pytest.mark.slow
def test_every_table_is_described_and_has_the_columns_that_are_explained() -> None:
    votes = study(datasets=("ball", "box", "cup"))
    analysis = analyse(votes, AnalysisSettings(factors=FACTORS, order_effect=True, random_effects="participants"))
    tables = {name for name, rows in analysis.items() if isinstance(rows, list)} - {"warnings", "findings"}
    assert tables == TABLES.keys()
    for name, table in TABLES.items():
        for row in analysis[name][:1]:
            assert table.columns.keys() <= row.keys(), name


def test_analysis_json_has_the_agreed_keys_and_is_json() -> None:
    analysis = analyse(study(), AnalysisSettings(factors=FACTORS, order_effect=True))
    for part, keys in KEYS.items():
        assert analysis[part], part
        assert set(keys.split()) <= set(analysis[part][0]), part
    json.dumps(analysis, allow_nan=False)


def test_every_comparison_and_dataset_is_there_and_sums_to_zero() -> None:
    analysis = analyse(study(), AnalysisSettings(factors=FACTORS))
    for comparison, n_items in (("all", 6), ("depth", 3), ("fusion", 2)):
        for dataset in ("ball", "box", "all"):
            rows = only(analysis["scores"], comparison=comparison, dataset=dataset)
            assert len(rows) == n_items
            assert sum(row["score"] for row in rows) == pytest.approx(0, abs=1e-9)


def test_counts_add_up() -> None:
    votes = study()
    excluded = VotesTable(**{**vars(votes), "practice": np.arange(len(votes)) < 10})
    analysis = analyse(excluded, AnalysisSettings(exclude=("p3",)))
    tally = analysis["votes"]
    assert tally["votes"] == tally["practice"] + tally["excluded"] + tally["analysed"] == 240
    assert (tally["practice"], tally["excluded"], tally["participants"]) == (10, 30, 7)
    rows = only(analysis["scores"], comparison="all", dataset="all")
    assert sum(row["n_votes"] for row in rows) == 2 * tally["analysed"]
    assert sum(row["wins"] for row in rows) == sum(row["losses"] for row in rows) == tally["analysed"] - tally["ties"]
    for row in rows:
        assert row["wins"] + row["losses"] + row["ties"] == row["n_votes"]


def test_votes_without_datasets_or_participants_are_analysed_as_one() -> None:
    rows = [("x", "y", "a", 6), ("x", "y", "b", 3), ("y", "z", "a", 5), ("y", "z", "b", 4)]
    votes = votes_from_rows(
        {"participant": "", "dataset": "", "item_a": a, "item_b": b, "choice": c, "count": n} for a, b, c, n in rows
    )
    analysis = analyse(votes)
    assert {row["dataset"] for row in analysis["scores"]} == {"all"}
    assert all(row["se_participant"] is None for row in analysis["scores"])
    assert analysis["triads"] == []
    assert analysis["votes"]["participants"] is None


def test_a_repeated_vote_is_named_and_kept() -> None:
    votes = study(datasets=("ball",))
    doubled = votes.where(np.r_[np.arange(len(votes)), 0])
    analysis = analyse(doubled)
    assert analysis["votes"]["analysed"] == len(votes) + 1
    assert any(f"row {len(votes) + 1} (p0, ball, id_fa - id_fb)" in warning for warning in analysis["warnings"])
    assert "repeat a pair" not in str(analyse(doubled, AnalysisSettings(exclude=("p0",)))["warnings"])


@pytest.mark.slow
def test_degenerate_data_have_their_status_and_a_warning() -> None:
    def analysed(*rows: tuple[str, str, str]) -> dict[str, Any]:
        return analyse(
            votes_from_rows(
                {"participant": f"p{n}", "dataset": "d", "item_a": a, "item_b": b, "choice": choice}
                for n, (a, b, choice) in enumerate(rows)
            ),
            AnalysisSettings(bootstrap=10),
        )

    islands = analysed(("x", "y", "a"), ("x", "y", "b"), ("u", "v", "a"))
    assert {row["status"] for row in islands["scores"]} == {"disconnected"}
    assert all(row["score"] is None for row in islands["scores"])
    assert any("no vote links" in warning for warning in islands["warnings"])
    never = analysed(("x", "y", "a"), ("x", "y", "b"), ("x", "z", "a"))
    assert {row["status"] for row in never["scores"]} == {"separated"}
    assert any("{x, y} > {z}" in warning for warning in never["warnings"])
    ties = analysed(("x", "y", "none"), ("x", "z", "none"), ("y", "z", "none"))
    assert [row["score"] for row in only(ties["scores"], dataset="all")] == pytest.approx([0, 0, 0], abs=1e-9)
    one = analysed(("x", "y", "a"))
    assert {row["status"] for row in one["models"]} == {"separated"}


@pytest.mark.slow
def test_a_bootstrap_is_the_same_for_the_same_seed_and_close_to_the_participant_errors() -> None:
    votes = study(n_participants=20)
    first = analyse(votes, AnalysisSettings(bootstrap=400, seed=7))["scores"]
    again = analyse(votes, AnalysisSettings(bootstrap=400, seed=7))["scores"]
    plain = analyse(votes)["scores"]
    assert first == again
    for sampled, computed in zip(first, plain, strict=True):
        width, expected = sampled["ci_high"] - sampled["ci_low"], computed["ci_high"] - computed["ci_low"]
        assert 0.6 < width / expected < 1.4


def any_votes(seed: int) -> VotesTable:
    """A small table of any shape: few or many votes, one or several people, ties or none."""
    rng = np.random.default_rng(seed)
    n_items, n_people, n_datasets, n = (int(rng.integers(*limits)) for limits in ((2, 6), (1, 6), (1, 3), (1, 30)))
    first = rng.integers(0, n_items, n)
    second = (first + rng.integers(1, n_items, n)) % n_items
    names = tuple(
        tuple(f"{kind}{k}" for k in range(size)) for kind, size in (("p", n_people), ("d", n_datasets), ("i", n_items))
    )
    return votes_from_indices(
        rng.integers(0, n_people, n),
        rng.integers(0, n_datasets, n),
        first,
        second,
        rng.choice(3, n, p=rng.dirichlet([1, 1, 1])),
        names=(names[0], names[1], names[2]),
        first_shown=rng.integers(-1, 2, n),
    )


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 100_000), st.sampled_from(list(TIE_MODELS)), st.booleans(), st.sampled_from([0, 10]), st.booleans()
)
def test_any_table_is_analysed_without_failing(
    seed: int, ties: str, order_effect: bool, bootstrap: int, has_factors: bool
) -> None:
    votes = any_votes(seed)
    levels = {"odd": {item: str(k % 2) for k, item in enumerate(votes.items)}}
    levels["half"] = {item: str(k // 2) for k, item in enumerate(votes.items)}
    chosen = AnalysisSettings(
        ties=ties, order_effect=order_effect, bootstrap=bootstrap, factors=levels if has_factors else {}
    )
    analysis = analyse(votes, chosen)
    json.dumps(analysis, allow_nan=False)
    for row in analysis["models"]:
        assert row["status"] in ("ok", "separated", "disconnected")
    for row in analysis["scores"]:
        assert (row["score"] is None) == (row["status"] == "disconnected")


@pytest.mark.slow
def test_ten_thousand_items_are_analysed() -> None:
    rng = np.random.default_rng(3)
    first = rng.integers(0, 10_000, 60_000)
    second = (first + rng.integers(1, 10_000, len(first))) % 10_000
    names = tuple(f"p{k}" for k in range(20)), ("",), tuple(f"i{k}" for k in range(10_000))
    who = rng.integers(0, 20, len(first))
    analysis = analyse(votes_from_indices(who, 0 * who, first, second, rng.integers(0, 3, len(first)), names=names))
    assert len(analysis["scores"]) == 10_000
    assert {row["status"] for row in analysis["models"]} <= {"ok", "separated"}
    assert any("no errors are given" in warning for warning in analysis["warnings"])


def test_nothing_left_after_practice_is_said() -> None:
    votes = study(n_participants=1)
    analysis = analyse(VotesTable(**{**vars(votes), "practice": np.ones(len(votes), bool)}))
    assert analysis["scores"] == []
    assert "nothing to analyse" in analysis["warnings"][0]


@pytest.mark.slow
def test_an_item_without_a_level_is_left_out_by_factor_and_named() -> None:
    votes = study()
    known = [item for item in votes.items if item != "pm_fb"]
    partial = {factor: {item: levels[item] for item in known} for factor, levels in FACTORS.items()}
    analysis = analyse(votes, AnalysisSettings(factors=partial))
    among_known = analyse(votes_with_levels(votes, partial), AnalysisSettings(factors=partial))
    assert "pm_fb has no level of depth or fusion: the analysis by factor leaves it out" in analysis["warnings"]
    by_factor = [row for row in analysis["scores"] if row["comparison"] != "all"]
    assert by_factor
    assert by_factor == [row for row in among_known["scores"] if row["comparison"] != "all"]
    assert analysis["effects"] == among_known["effects"] != []
    assert "pm_fb" in {row["item"] for row in analysis["scores"] if row["comparison"] == "all"}


def test_items_without_any_levels_are_scored_and_nothing_is_said_by_factor() -> None:
    analysis = analyse(study(), AnalysisSettings(factors={"depth": {}}))
    assert {row["comparison"] for row in analysis["scores"]} == {"all"}
    assert analysis["effects"] == []
    assert (
        analysis["warnings"][0]
        == f"{', '.join(study().items)} have no level of depth: the analysis by factor leaves them out"
    )


def test_factors_that_always_change_together_are_said_to_have_no_results() -> None:
    together = {"depth": {"x": "id", "y": "dr", "z": "pm"}, "fusion": {"x": "fa", "y": "fb", "z": "fc"}}
    analysis = analysed("aab", "aba", "baa", factors=together)
    assert analysis["effects"] == []
    assert {row["comparison"] for row in analysis["scores"]} == {"all"}
    assert "no vote is on conditions that differ in depth or fusion alone: no scores by it" in analysis["warnings"]
    assert "depth and fusion: no effects, because the votes cannot tell them apart" in analysis["warnings"]


def test_factors_whose_votes_all_go_one_way_are_said_to_have_no_effects() -> None:
    one_way = analysed("aaa", "aaa", "aaa", factors={"depth": {"x": "id", "y": "dr", "z": "pm"}})
    assert one_way["effects"] == []
    assert "depth: no effects, because they have no finite estimate" in one_way["warnings"]


def test_wrong_settings_are_refused() -> None:
    with pytest.raises(ValueError, match="ties is 'both'"):
        AnalysisSettings(ties="both")
    with pytest.raises(ValueError, match="bootstrap is -1"):
        AnalysisSettings(bootstrap=-1)
    with pytest.raises(ValueError, match="the factor 'depth' is not among none"):
        AnalysisSettings(analysed_factors=("depth",))
    with pytest.raises(ValueError, match="'nobody'"):
        analyse(study(), AnalysisSettings(exclude=("nobody",)))


def test_factors_are_compared_within_the_others_as_in_the_paper() -> None:
    analysis = analyse(study(n_participants=4), AnalysisSettings(factors=FACTORS))
    counted = {(row["comparison"], row["dataset"]): row["n_votes"] for row in analysis["models"]}
    assert counted["depth", "ball"] == 4 * 6
    assert counted["fusion", "ball"] == 4 * 3


@pytest.mark.slow
def test_the_factors_of_a_known_study_have_the_reference_values(real_data: Path) -> None:
    folder = real_data / "votes" / "reference" / "paper_like_22x5x6"
    expected = json.loads((folder / "expected.json").read_text(encoding="utf-8"))["datasets"]
    analysis = analyse(read_votes(folder / "votes.csv"), AnalysisSettings(factors=FACTORS))
    for dataset, models in expected.items():
        where = "all" if dataset == "ALL" else dataset
        for factor, name in (("depth", "separate_algorithm"), ("fusion", "separate_fusion")):
            wanted = models[name]
            rows = {row["item"]: row for row in only(analysis["scores"], comparison=factor, dataset=where)}
            (model,) = only(analysis["models"], comparison=factor, dataset=where)
            assert model["n_votes"] == wanted["n_votes"]
            assert model["loglik"] == pytest.approx(wanted["loglik"], abs=1e-5)
            assert model["log_nu"] == pytest.approx(wanted["params"]["log_nu"], abs=1e-6)
            for level in wanted["params"].keys() - {"log_nu"}:
                assert rows[level]["score"] == pytest.approx(wanted["params"][level], abs=1e-6)
                assert rows[level]["se"] == pytest.approx(wanted["se"][level], abs=1e-5)
                clustered = rows[level]["se_participant"] * np.sqrt(21 / 22)
                assert clustered == pytest.approx(wanted["se_cluster"][level], abs=1e-5)


@pytest.mark.slow
def test_a_file_becomes_a_folder_of_results(tmp_path: Path) -> None:
    from tests.app.analysis.votes_data_frame import frame_from_votes

    frame_from_votes(study(n_participants=4)).to_csv(tmp_path / "votes.csv", index=False)
    items = [
        "item,depth,fusion",
        *(f"{item},{FACTORS['depth'][item]},{FACTORS['fusion'][item]}" for item in FACTORS["depth"]),
    ]
    (tmp_path / "items.csv").write_text("\n".join(items) + "\n", encoding="utf-8")
    out = tmp_path / "out"
    analysis = analyse_file(tmp_path / "votes.csv", out, items=tmp_path / "items.csv", factors=["fusion"])
    assert json.loads((out / "analysis.json").read_text(encoding="utf-8")) == analysis
    assert {row["comparison"] for row in analysis["scores"]} == {"all", "fusion"}
    header = (out / "scores.csv").read_text(encoding="utf-8").splitlines()[0]
    assert header.startswith(
        "comparison,dataset,item,score,se,se_participant,ci_low,ci_high,n_votes,wins,losses,ties,status"
    )
    for name in ("scores", "scores_fusion", "preferences", "residuals", "triads"):
        for suffix, start in (("svg", b"<svg"), ("png", b"\x89PNG"), ("pdf", b"%PDF")):
            assert (out / "figures" / f"{name}.{suffix}").read_bytes().startswith(start)
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "Davidson" in report
    assert "pm_fb" in report
    assert report.count("<thead>") == report.count("<table>") > 0  # a header is repeated on every page of paper
    assert "95\u00a0% interval" in report  # a number and its sign stay on one line
    assert not list(out.rglob("*.part*"))


def opinions(*choices: str, pairs: str = "xy yz xz") -> list[dict[str, Any]]:
    """A row for each word of choices (one of each participant, a letter for each pair): a, b or n for a tie."""
    return [
        {"participant": f"p{who}", "dataset": "ball", "item_a": pair[0], "item_b": pair[1], "choice": choice}
        for who, own in enumerate(choices)
        for pair, choice in zip(pairs.split(), own.replace("n", "-"), strict=True)
    ]


def analysed(*choices: str, pairs: str = "xy yz xz", **options: Any) -> dict[str, Any]:
    words = {"a": "a", "b": "b", "none": "-"}
    return analyse(votes_from_rows(opinions(*choices, pairs=pairs), choices=words), AnalysisSettings(**options))


def test_scores_alone_are_those_of_the_analysis_in_the_same_order() -> None:
    """A server takes either, and a client fetches them page by page."""
    rows = [
        row | {"dataset": dataset}
        for dataset in ("box 10", "ball", "box 2")
        for row in opinions("aab", "aba", "bbb", "baa")
    ]
    votes = votes_from_rows(rows)
    assert scored(votes) == analyse(votes)["scores"]


def test_a_name_that_begins_with_a_digit_stands_where_names_do() -> None:
    rows = [
        {"participant": f"p{who}", "item_a": "3dgs", "item_b": "2dgs", "choice": choice}
        for who, choice in enumerate("aabab")
    ]
    page = report_page("report.html", analyse(votes_from_rows(rows)), (), "votes")
    assert page.count('<td class="name">2dgs</td>') == page.count(">2dgs</td>") > 1


def test_who_has_withdrawn_is_in_no_scores() -> None:
    rows = [
        row | {"excluded": row["participant"] in why, "reason": why.get(row["participant"], "")}
        for why in ({"p2": "asleep", "p3": "withdrawn"},)
        for row in opinions("aba", "baa", "abb", "aab")
    ]
    analysis = analyse(votes_from_rows(rows))
    assert {row["n_votes"] for row in only(analysis["scores"], dataset="all")} == {4}
    assert {row["n_votes"] for row in only(analysis["scores_with_excluded"], dataset="all")} == {6}
    only_withdrawn = [row | {"excluded": row["participant"] == "p3"} for row in rows]
    assert analyse(votes_from_rows(only_withdrawn))["scores_with_excluded"] == []


def test_a_bootstrap_that_loses_its_extremes_gives_way_to_participant_errors() -> None:
    one_for_z = ("abb", *["aaa", "baa"] * 4, "aaa")
    analysis = analysed(*one_for_z, bootstrap=400, seed=1)
    plain = analysed(*one_for_z)
    (model,) = only(analysis["models"], dataset="all")
    assert model["bootstrap_without_maximum"] > 40
    assert analysis["scores"] == plain["scores"]
    assert {row["ci_method"] for row in analysis["scores"]} == {
        "wider of t on participant errors and normal on information"
    }
    assert any("too many for percentiles to hold" in warning for warning in analysis["warnings"])


def test_few_replicates_have_no_percentiles() -> None:
    """The smallest and the largest of twenty lie far inside of a 95 % interval."""
    many = ("aab", "aba", "bba", "bab", "aaa") * 4
    plain, few, enough = (analysed(*many, bootstrap=n, seed=1)["scores"] for n in (0, 20, 200))
    assert few == plain
    assert {row["ci_method"] for row in enough} == {"participant bootstrap"}


def test_too_few_replicates_are_said_and_the_number_that_is_named_is_enough() -> None:
    many = ("aab", "aba", "bba", "bab", "aaa") * 4
    (said,) = [text for text in analysed(*many, bootstrap=20, seed=1)["warnings"] if "too few for percentiles" in text]
    (one,) = [text for text in analysed(*many, bootstrap=1, seed=1)["warnings"] if "too few for percentiles" in text]
    assert "1 bootstrap replicate is too few" in one
    enough = int(said.rpartition(" ")[2])
    assert {row["ci_method"] for row in analysed(*many, bootstrap=enough, seed=1)["scores"]} == {
        "participant bootstrap"
    }
    assert analysed(*many, bootstrap=enough, seed=1)["warnings"] == []


def test_a_single_voter_is_said_of_the_dataset_alone_on_which_nobody_else_voted() -> None:
    rows = [row | {"dataset": "street"} for row in opinions("aab", "aba", "bba")]
    rows += [row | {"dataset": "forest"} for row in opinions("aab")]
    (said,) = [text for text in analyse(votes_from_rows(rows))["warnings"] if "a single participant voted" in text]
    assert said.startswith("all conditions, dataset forest: a single participant voted there, so nothing")


def test_where_nothing_is_known_of_other_people_there_is_no_interval() -> None:
    alone, alike = "a single participant voted", "no intervals, as participants agree too exactly"
    for choices, why in ((["aaa"] * 5, "no finite maximum"), (["aab"] * 5, alike), (["aab"], alone)):
        analysis = analysed(*choices)
        (model,) = only(analysis["models"], dataset="all")
        assert model["n_participants"] == len(choices)
        for row in analysis["scores"]:
            assert row["score"] is not None
            assert (row["ci_low"], row["ci_high"], row["ci_method"]) == (None, None, None)
        assert any(why in warning for warning in analysis["warnings"])


def test_a_bootstrap_of_people_who_all_vote_alike_gives_no_interval() -> None:
    """Every replicate is then the votes again, and percentiles would take the scores for certain."""
    analysis = analysed(*["aab"] * 15, bootstrap=100)
    assert {row["status"] for row in analysis["scores"]} == {"ok"}
    assert {(row["ci_low"], row["ci_high"], row["ci_method"]) for row in analysis["scores"]} == {(None, None, None)}


@pytest.mark.parametrize("n_people", [8, 30])
def test_people_of_opposite_orders_leave_intervals_where_they_differ(n_people: int) -> None:
    """All place y in the middle, so that nothing is known of its spread; of x and z people know the opposite."""
    analysis = analysed(*["aaa", "bbb"] * (n_people // 2), bootstrap=1000, seed=1)
    by_item = {row["item"]: row for row in only(analysis["scores"], dataset="all")}
    for item in "xz":
        assert by_item[item]["ci_low"] < -0.3
        assert by_item[item]["ci_high"] > 0.3
        assert by_item[item]["se_participant"] > 0.1
        assert by_item[item]["ci_method"] is not None
    assert any("no interval of y, on which" in warning for warning in analysis["warnings"])
    assert [by_item["y"][name] for name in ("se_participant", "ci_low", "ci_high", "ci_method")] == [None] * 4
    assert {row["p_best"] for row in by_item.values()} == {None}
    for row in only(analysis["contrasts"], dataset="all"):
        assert (row["p_holm"], row["method"]) == (1, BY_SCORES)
        assert row["ci_simultaneous_low"] <= row["ci_low"]


@pytest.mark.parametrize("prior", ["none", "pwcmp"])
def test_people_of_opposite_orders_leave_jod_and_effects_where_they_differ(prior: str) -> None:
    factors = {"kind": {"x": "1", "z": "2", "y": "3"}}
    analysis = analysed(*["aaa", "bbb"] * 15, jod_prior=prior, factors=factors)
    for row in only(analysis["scores"], dataset="all", comparison="all"):
        assert (row["jod_thurstone_low"] is None) == (row["item"] == "y")
    effects = {row["level"]: row for row in only(analysis["effects"], dataset="all")}
    assert [effects[level]["ci_low"] is None for level in "123"] == [False, False, True]
    assert [effects[level]["se_participant"] is None for level in "123"] == [False, False, True]
    assert "| y | 0.000 | 0.172 | – | 0.000 |" in report_page("report.md", analysis, (), "votes")


def test_a_difference_on_which_all_voted_alike_is_not_certain() -> None:
    """Both prefer a to b twice in three; on b and c they differ, so that every score has an error."""
    analysis = analysed("aabaab", "aabbba", pairs="ab ab ab bc bc bc")
    contrast = next(row for row in analysis["contrasts"] if (row["item_a"], row["item_b"]) == ("a", "b"))
    assert contrast["difference"] == pytest.approx(np.log(2))
    assert contrast["se"] > 0.5
    assert contrast["p_value"] == contrast["p_holm"] == 1


@pytest.mark.parametrize(("first", "second"), [("abbbbb", "bbbbab"), ("babaaa", "aababa"), ("baaaba", "bbabab")])
def test_two_people_who_are_alike_but_for_rounding_leave_numbers(first: str, second: str) -> None:
    analysis = analysed(first, second, pairs="ab ab ac ac bc bc")
    json.dumps(analysis, allow_nan=False)
    alike = [row for row in analysis["contrasts"] if row["dataset"] == "all" and row["method"] == ALL_ALIKE]
    assert alike
    assert all(row["se"] > 0.1 and row["p_value"] == 1 for row in alike)


@pytest.mark.parametrize("odds", [10, 30])
def test_a_rare_loss_to_a_far_item_leaves_numbers(odds: int) -> None:
    items = [f"i{rank:02}" for rank in range(18)]
    rows = [(a, b, choice) for a, b in pairwise(items) for choice in "a" * odds + "b"] + [(items[0], items[-1], "a")]
    named = [
        {"participant": "p", "dataset": "ball", "item_a": a, "item_b": b, "choice": choice} for a, b, choice in rows
    ]
    analysis = analyse(votes_from_rows(named))
    json.dumps(analysis, allow_nan=False)
    assert analysis["models"][0]["pearson_x2"] == pytest.approx(0, abs=1e-6)


def test_a_dataset_or_factor_called_all_is_refused() -> None:
    rows = opinions("aba", "baa")
    with pytest.raises(VotesError, match="a dataset is called 'all'"):
        analyse(votes_from_rows([row | {"dataset": "all"} for row in rows]))
    with pytest.raises(VotesError, match="a factor is called 'all'"):
        analyse(votes_from_rows(rows), AnalysisSettings(factors={"all": {"x": "1", "y": "1", "z": "2"}}))
