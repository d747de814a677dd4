"""Write the report's sections after the scores: each a title, a paragraph on how to read it, figures and a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from app.analysis.objective.prediction import measures_by_rank
from app.analysis.ratings.report_sections import rating_sections
from app.analysis.report_tables import Analysis, Figures, Row, section, table

MOST_FIGURES = 8  # of measures in the report
MOST_COMPARED = 30  # pairs of measures in the report


def sections(analysis: Analysis, figures: Figures) -> Iterator[dict[str, Any]]:
    """Yield the sections for which this analysis has results.

    Parameters
    ----------
    figures : name -> figure, of the figures that were drawn
    """
    if analysis["models"]:
        yield _model(analysis, figures)
    if analysis["effects"]:
        yield _factors(analysis)
    if analysis["tests"]:
        yield _tests(analysis)
    if analysis["measures"]:
        yield _measures(analysis, figures)
    if analysis["scores_with_excluded"]:
        yield _excluded(analysis)
    if analysis["groups"]:
        yield _groups(analysis, figures)
    if analysis["dataset_agreement"]:
        yield _dataset_agreement(analysis)
    if any(row["u"] is not None or row["transitivity"] for row in analysis["agreement"]):
        yield _agreement(analysis)
    if analysis["triads"]:
        yield _triads(analysis, figures)
    if analysis["observers"]:
        yield _observers(analysis, figures)
    yield from rating_sections(analysis, figures)


def _model(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    parameter = "log_theta" if analysis["settings"]["ties"] == "rao-kupper" else "log_nu"
    rows = [{parameter: None, **row} for row in analysis["models"]]
    text = (
        "A small p-value of Pearson's X2 says that one score per item does not explain the votes. With several votes "
        "per person it also reacts to the similarity of a person's votes."
    )
    shown = [figures[name] for name in ("preferences", "residuals") if name in figures]
    columns = ["comparison", "dataset", "n_votes", parameter, "order_effect", "loglik", "pearson_x2", "df", "p_value"]
    return section("Model", text, [*columns, "status"], rows, shown)


def _factors(analysis: Analysis) -> dict[str, Any]:
    rows = [
        row | {"error": row["se"] if row["se_participant"] is None else row["se_participant"]}
        for row in analysis["effects"]
    ]
    text = (
        "What each level of a factor adds to the score when all pairs are used (additive model); the levels of a "
        "factor sum to zero. The scores of single factors above use only the pairs that differ in nothing else."
    )
    columns = ["factor", "level", "dataset", "effect", "error", "ci_low", "ci_high"]
    return section("Factors together", text, columns, rows)


def _tests(analysis: Analysis) -> dict[str, Any]:
    text = (
        "G2 is the likelihood-ratio statistic, which treats votes as independent; p (participants) is the Wald test "
        "with participants as the sample. Holm's correction covers the tests of one kind on single datasets, or on all "
        "together, and uses p (participants) where it exists."
    )
    columns = ["name", "model", "dataset", "g2", "df", "p (votes)", "p_participant", "p_holm"]
    rows = [row | {"p (votes)": row["p_value"]} for row in analysis["tests"]]
    return section("Tests", text, columns, rows)


def _measures(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    rows = [_with_intervals(row) for row in analysis["measures"]]
    last = {row["measure"]: row for row in rows}
    ranked = [last[measure] for measure in measures_by_rank(analysis["measures"])]
    single = [row for row in rows if row["dataset"] != "all"] if ranked[0]["dataset"] == "all" else []
    correlations = ("pearson_logistic", "pearson", "pearson_monotone", "spearman", "spearman_p", "kendall")
    told = ("pairs_correct", "auc_better_worse", "auc_different_similar")
    drawn = [figure for name, figure in figures.items() if name.startswith("measure_")]
    shown = [figures["measures"]] if "measures" in figures else []
    rest = f" Figures of the best {MOST_FIGURES} of {len(drawn)}; the folder figures holds all." * (
        len(drawn) > MOST_FIGURES
    )
    where = "all datasets" if single else "the dataset"
    return {
        "title": "Do objective measures predict the scores?",
        "paragraphs": [MEASURES_TEXT + rest, _chance_text(len(last))],
        "figures": [*shown, *drawn[:MOST_FIGURES]],
        "tables": [
            table(f"Correlations over {where}, best first", ["measure", "better", "n", *correlations], ranked),
            table(
                "Pairs told rightly, and errors after the logistic fit",
                ["measure", "pairs_different", "pairs_similar", *told, "rmse", "rmse_epsilon", "outlier_ratio"],
                ranked,
            ),
            *([table("On each dataset", ["measure", "dataset", "n", *correlations, *told], single)] if single else []),
            *_comparisons(analysis),
        ],
    }


MEASURES_TEXT = (
    "PLCC is Pearson's correlation of the scores with a logistic curve of the measure (VQEG 2000); monotone is the "
    "same with the best monotone curve. A pair is different if the votes tell its items apart (5 %, Holm), else "
    "similar: “in order” is the share of different pairs that the measure orders as the votes do, the areas are those "
    "of Krasula and others (2016). RMSE is in log-odds, RMSE* counts only what exceeds a score's 95 % interval, "
    "outliers are the points beyond it (ITU-T P.1401). Over all datasets, measure and score are relative to their "
    "dataset's mean."
)


def _chance_text(n_measures: int) -> str:
    expected = n_measures * 0.05
    many = (
        f" Of {n_measures} measures without information, about {expected:.0f} would have p below 0.05."
        if expected >= 1
        else ""
    )
    return (
        "Intervals (95 %) and p-values hold for the measure: they come from permuting the conditions, the same way on "
        f"all datasets, so they take conditions as exchangeable.{many} A measure whose lower values are better should "
        "have negative correlations; pairs and areas already count in its direction, or in that of the rank "
        "correlation where none is stated (“better” is a dash), which flatters the measure."
    )


def _comparisons(analysis: Analysis) -> list[dict[str, Any]]:
    """Return the table of measures against each other, the clearest differences first; none without a pair."""
    rows = [row for row in analysis["measure_comparisons"] if row["p_value"] is not None]
    rows.sort(key=lambda row: row["p_value"])
    if not rows:
        return []
    rest = f" The {MOST_COMPARED} clearest of {len(rows)}" if len(rows) > MOST_COMPARED else ""
    columns = [
        "measure_a",
        "measure_b",
        "pearson_a",
        "pearson_b",
        "p_value",
        "p_holm",
        "auc_a",
        "auc_b",
        "auc_p",
        "auc_p_holm",
    ]
    return [table(f"Does a measure predict better than another?{rest}", columns, rows[:MOST_COMPARED])]


def _with_intervals(row: Row) -> dict[str, Any]:
    shown = [name for name in row if f"{name}_low" in row]
    return dict(row) | {name: _with_interval(row, name) for name in shown}


def _with_interval(row: Mapping[str, Any], name: str) -> str | None:
    value, low, high = (row[key] for key in (name, f"{name}_low", f"{name}_high"))
    if value is None:
        return None
    return f"{value:.2f}" if low is None else f"{value:.2f} [{low:.2f}, {high:.2f}]"


def _excluded(analysis: Analysis) -> dict[str, Any]:
    everybody = {(r["comparison"], r["dataset"], r["item"]): r["score"] for r in analysis["scores_with_excluded"]}
    rows = [
        row | {"score with all votes": everybody.get((row["comparison"], row["dataset"], row["item"]))}
        for row in analysis["scores"]
    ]
    text = f"{analysis['votes']['excluded']} votes were excluded; the last column is the score with them."
    columns = ["comparison", "dataset", "item", "score", "score with all votes"]
    return section("Exclusions", text, columns, rows)


def _groups(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    text = (
        "Scores of each group of participants alone. The tests above (group …) tell whether groups differ; a "
        "difference that was not planned before the study is a question for the next one."
    )
    columns = ["grouping", "group", "n_participants", "dataset", "item", "score", "ci_low", "ci_high", "status"]
    shown = [figure for name, figure in figures.items() if name.startswith("group_")]
    return section("Groups of participants", text, columns, analysis["groups"], shown)


def _dataset_agreement(analysis: Analysis) -> dict[str, Any]:
    w_test = analysis["dataset_concordance"]
    overall = (
        ""
        if w_test is None
        else f" Kendall's coefficient of concordance over all {w_test['n_datasets']} datasets: W = {w_test['w']:.3f} "
        f"(1: the same order everywhere), p = {w_test['p_value']:.2g}."
    )
    text = (
        "Correlation of the scores of two datasets over the items they share. Errors of the scores lower these "
        f"correlations; the test above tells whether the datasets differ beyond them.{overall}"
    )
    columns = ["dataset_a", "dataset_b", "n_items", "pearson", "spearman", "kendall"]
    return section("Agreement between datasets", text, columns, analysis["dataset_agreement"])


def _agreement(analysis: Analysis) -> dict[str, Any]:
    violations = ("weak", "moderate", "strong", "n_triples")
    rows = [row | (row["transitivity"] or dict.fromkeys(violations)) for row in analysis["agreement"]]
    text = (
        "Kendall's u is 1 if all participants agree and slightly below 0 if they are split evenly; it exists for "
        "complete designs without ties. The next columns count the triples of items that violate weak, moderate and "
        "strong stochastic transitivity; without weak transitivity no scores fit the preferences."
    )
    columns = ["dataset", "u", "p_value", *violations]
    return section("Agreement", text, columns, rows)


def _triads(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    total = sum(row["circular"] for row in analysis["triads"])
    pooled = analysis["triads_pooled"]
    with_cycles = sum(row["circular"] > 0 for row in pooled)
    complete = sum(row["complete"] for row in analysis["triads"])
    text = (
        f"{total} circular triads in {len(analysis['triads'])} sets of votes ({complete} of them complete), "
        f"by {with_cycles} of {len(pooled)} participants. They exclude nobody: where stimuli look alike, honest votes "
        "contradict each other."
    )
    shown = [figures["triads"]] if "triads" in figures else []
    columns = ["participant", "n_datasets", "circular", "circular_expected_ties", "p_value"]
    return section("Circular triads", text, columns, pooled, shown)


def _observers(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    flagged = [row for row in analysis["observers"] if row["flags"]]
    text = (
        f"{len(flagged)} of {len(analysis['observers'])} participants have something unusual about their votes; all "
        "numbers are in observers.csv. A flag is a reason to look, not to exclude."
    )
    rows = [row | {"flags": "; ".join(row["flags"])} for row in flagged]
    shown = [figures["response_times"]] if "response_times" in figures else []
    columns = ["participant", "n_votes", "tie_rate", "loglik_per_vote_left_out", "flags"]
    return section("Participants", text, columns, rows, shown)
