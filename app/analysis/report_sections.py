"""Write the report's sections after the scores: each a title, a paragraph on how to read it, figures and a table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

Analysis = Mapping[str, Any]
Figures = Mapping[str, dict[str, str]]
Row = Mapping[str, Any]

ROWS = 80  # rows of a table; the CSV files hold the rest
HEADINGS = {  # of columns; others have their name in analysis.json
    "ci_high": "to",
    "ci_low": "from",
    "circular_expected_ties": "expected with ties broken",
    "dataset_a": "dataset",
    "dataset_b": "and",
    "flags": "unusual",
    "g2": "G2",
    "kendall": "Kendall",
    "log_nu": "tie parameter",
    "log_theta": "tie parameter",
    "loglik": "log-likelihood",
    "loglik_per_vote_left_out": "log-likelihood per vote",
    "model": "in the model of",
    "moderate": "moderate violated",
    "n": "points",
    "n_datasets": "datasets",
    "n_items": "items",
    "n_participants": "participants",
    "n_triples": "triples",
    "n_votes": "votes",
    "name": "test",
    "order_effect": "order effect",
    "p_holm": "p (Holm)",
    "p_participant": "p (participants)",
    "p_value": "p",
    "pairs_correct": "in order",
    "pairs_different": "pairs that differ",
    "pearson": "Pearson",
    "pearson_monotone": "monotone",
    "pearson_x2": "Pearson X2",
    "spearman": "Spearman",
    "strong": "strong violated",
    "tie_rate": "tie rate",
    "weak": "weak violated",
}


def sections(analysis: Analysis, figures: Figures) -> Iterator[dict[str, Any]]:
    """Yield the sections for which this analysis has results.

    Parameters
    ----------
    figures : name -> figure, of the figures that were drawn
    """
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


def _section(
    title: str, text: str, columns: Sequence[str], rows: Sequence[Row], figures: Sequence[dict[str, str]] = ()
) -> dict[str, Any]:
    """Return a section with one table of these columns of the rows."""
    headings = [HEADINGS.get(column, column) for column in columns]
    cells = [[row[column] for column in columns] for row in rows[:ROWS]]
    table = {"title": "", "columns": headings, "rows": cells}
    rest = f" The first {ROWS} of {len(rows)} rows." if len(rows) > ROWS else ""
    return {"title": title, "paragraphs": [text + rest], "figures": figures, "tables": [table]}


def _model(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    parameter = "log_theta" if analysis["settings"]["ties"] == "rao-kupper" else "log_nu"
    rows = [{parameter: None, **row} for row in analysis["models"]]
    text = (
        "A small p-value of Pearson's X2 says that one score per item does not explain the votes. With several votes "
        "per person it also reacts to the similarity of a person's votes."
    )
    shown = [figures[name] for name in ("preferences", "residuals") if name in figures]
    columns = ["comparison", "dataset", "n_votes", parameter, "order_effect", "loglik", "pearson_x2", "df", "p_value"]
    return _section("Model", text, [*columns, "status"], rows, shown)


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
    return _section("Factors together", text, columns, rows)


def _tests(analysis: Analysis) -> dict[str, Any]:
    text = (
        "G2 is the likelihood-ratio statistic, which treats votes as independent; p (participants) is the Wald test "
        "with participants as the sample. Holm's correction covers the tests of one kind on single datasets, or on all "
        "together, and uses p (participants) where it exists."
    )
    columns = ["name", "model", "dataset", "g2", "df", "p (votes)", "p_participant", "p_holm"]
    rows = [row | {"p (votes)": row["p_value"]} for row in analysis["tests"]]
    return _section("Tests", text, columns, rows)


def _measures(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    text = (
        "How well objective measures predict the scores. The monotone correlation is taken after fitting the best "
        "monotone curve; the last column is the share of significantly different pairs that the measure puts in the "
        "right order. Over all datasets, measure and score are relative to their dataset's mean. Intervals: 95 %, "
        "from resampling participants, over all datasets also datasets."
    )
    correlations = ("pearson", "pearson_monotone", "spearman", "kendall")
    rows = [row | {n: _with_interval(row, n) for n in (*correlations, "pairs_correct")} for row in analysis["measures"]]
    columns = ["measure", "dataset", "n", *correlations, "pairs_different", "pairs_correct"]
    shown = [figure for name, figure in figures.items() if name.startswith("measure_")]
    return _section("Objective measures", text, columns, rows, shown)


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
    return _section("Exclusions", text, columns, rows)


def _groups(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    text = (
        "Scores of each group of participants alone. The tests above (group …) tell whether groups differ; a "
        "difference that was not planned before the study is a question for the next one."
    )
    columns = ["grouping", "group", "n_participants", "dataset", "item", "score", "ci_low", "ci_high", "status"]
    shown = [figure for name, figure in figures.items() if name.startswith("group_")]
    return _section("Groups of participants", text, columns, analysis["groups"], shown)


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
    return _section("Agreement between datasets", text, columns, analysis["dataset_agreement"])


def _agreement(analysis: Analysis) -> dict[str, Any]:
    violations = ("weak", "moderate", "strong", "n_triples")
    rows = [row | (row["transitivity"] or dict.fromkeys(violations)) for row in analysis["agreement"]]
    text = (
        "Kendall's u is 1 if all participants agree and slightly below 0 if they are split evenly; it exists for "
        "complete designs without ties. The next columns count the triples of items that violate weak, moderate and "
        "strong stochastic transitivity; without weak transitivity no scores fit the preferences."
    )
    columns = ["dataset", "u", "p_value", *violations]
    return _section("Agreement", text, columns, rows)


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
    return _section("Circular triads", text, columns, pooled, shown)


def _observers(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    flagged = [row for row in analysis["observers"] if row["flags"]]
    text = (
        f"{len(flagged)} of {len(analysis['observers'])} participants have something unusual about their votes; all "
        "numbers are in observers.csv. A flag is a reason to look, not to exclude."
    )
    rows = [row | {"flags": "; ".join(row["flags"])} for row in flagged]
    shown = [figures["response_times"]] if "response_times" in figures else []
    columns = ["participant", "n_votes", "tie_rate", "loglik_per_vote_left_out", "flags"]
    return _section("Participants", text, columns, rows, shown)
