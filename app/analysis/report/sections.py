"""Write the report's sections after the scores: each a title, a paragraph on how to read it, figures and a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from app.analysis.findings.pairs import better_first
from app.analysis.findings.ranking import overall
from app.analysis.model.contrasts import SIGNIFICANT
from app.analysis.objective.against_scores import score_unit
from app.analysis.objective.prediction import measures_by_rank
from app.analysis.reading.phrases import counted, p_phrase, part, with_interval
from app.analysis.reading.votes_table import ALL
from app.analysis.report.rate_sections import rate_section
from app.analysis.report.rating_sections import rating_sections
from app.analysis.report.tables import ROWS, Analysis, Figures, Row, section, table

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
    if analysis["contrasts"]:
        yield _contrasts(analysis)
    if analysis["random_effects"]:
        yield _random_effects(analysis)
    if analysis["lapse_scores"]:
        yield _lapses(analysis)
    if analysis["measures"]:
        yield _measures(analysis, figures)
    if analysis["rates"]:
        yield rate_section(analysis, figures)
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
        "A small p-value of Pearson's X2 says that one score per condition does not explain the votes. With several "
        "votes per person it also reacts to the similarity of a person's votes."
    )
    shown = [figures[name] for name in ("preferences", "residuals") if name in figures]
    columns = ["comparison", "dataset", "n_votes", parameter, "order_effect", "loglik", "pearson_x2", "df", "p_value"]
    return _overall_first("Model", text, [*columns, "status"], rows) | {"figures": shown}


def _factors(analysis: Analysis) -> dict[str, Any]:
    rows = [
        row | {"error": row["se"] if row["se_participant"] is None else row["se_participant"]}
        for row in analysis["effects"]
    ]
    text = (
        "What each level of a factor adds to the score when all pairs are used (additive model); the levels of a "
        "factor sum to zero, and levels that share a letter are not told apart (all pairs of its levels, Holm). The "
        "scores of single factors above use only the pairs that differ in nothing else."
    )
    columns = ["factor", "level", "dataset", "effect", "error", "ci_low", "ci_high", "letters"]
    return _overall_first("Factors together", text, columns, rows)


def _tests(analysis: Analysis) -> dict[str, Any]:
    text = (
        "G2 is the likelihood-ratio statistic, which treats votes as independent; p (participants) has participants as "
        "the sample: Hotelling's test, and for datasets and groups Rao and Scott's correction of G2. Holm's correction "
        "covers the tests of one kind on single datasets, or on all together, and uses p (participants) where it "
        "exists."
    )
    columns = ["name", "model", "dataset", "g2", "df", "p_votes", "p_participant", "p_holm"]
    rows = [row | {"p_votes": row["p_value"]} for row in analysis["tests"]]
    return _overall_first("Tests", text, columns, rows)


def _overall_first(title: str, text: str, columns: Sequence[str], rows: Sequence[Row]) -> dict[str, Any]:
    """Return a section with the rows over all datasets, and those of single datasets folded away."""
    single = [row for row in rows if row["dataset"] != ALL]
    every = [row for row in rows if row["dataset"] == ALL]
    tables = [table("Over all datasets" if single else "", columns, every)]
    if single:
        rest = f", the first {ROWS} of {len(single)}" if len(single) > ROWS else ""
        tables.append(table(f"On single datasets{rest}", columns, single, is_folded=True))
    return {"title": title, "paragraphs": [text], "figures": [], "tables": tables}


def clearest_contrasts(analysis: Analysis) -> list[Row]:
    """Return the pairs of conditions over all datasets, the better one first, the clearest difference first."""
    return better_first(overall(analysis["contrasts"]))


def _contrasts(analysis: Analysis) -> dict[str, Any]:
    """Return all pairs of conditions over all datasets, the clearest differences first."""
    rows = clearest_contrasts(analysis)
    n_differ = sum(row["p_holm"] < SIGNIFICANT for row in rows)
    text = (
        f"How much higher the first of two conditions scores, the clearest first: {n_differ} of {len(rows)} "
        f"{'differs' if 1 in (n_differ, len(rows)) else 'differ'} (5 %, Holm's correction for all of them). The "
        "intervals are 95 % for each difference alone: of those that lie farthest apart they hold "
        "less often, without any difference in 63 to 80 % (simulations)."
        f"{_open_intervals(rows)} All, also of single datasets and factors, are in contrasts.csv."
    )
    columns = ["item_a", "item_b", "difference", "se", "ci_low", "ci_high", "p_value", "p_holm"]
    if any(row["method"] != rows[0]["method"] for row in rows):
        columns.append("method")
    return section("Pairs of conditions", text, columns, rows)


def _open_intervals(rows: Sequence[Row]) -> str:
    """Say what a difference without a finite estimate is, if there is one."""
    if not any(row["ci_high"] is None for row in rows):
        return ""
    return (
        " Where all votes of a pair go one way, the difference is that of the penalised scores, the test is an exact "
        "sign test, and the interval is one-sided: a dash is a limit that does not exist."
    )


def _random_effects(analysis: Analysis) -> dict[str, Any]:
    """Return scores with random effects, and how much people, and datasets, differ."""
    text = (
        "Scores of the average person, where everybody has scores of their own that vary around them, and on datasets "
        "at large if datasets vary, too. The intervals hold 95 % of what is likely given the votes (posterior, nested "
        "Laplace approximation). Spreads are standard deviations in log-odds. Of two conditions, “people” is the "
        "share of people whose own score of the first is higher."
    )
    ordered = sorted(analysis["random_effects_scores"], key=lambda row: -row["score"])
    pairs = better_first(analysis["random_effects_contrasts"])
    columns = ["item_a", "item_b", "difference", "ci_low", "ci_high", "p_value", "p_holm", "people_preferring"]
    tables = [
        table("Scores", ["item", "score", "se", "ci_low", "ci_high"], ordered),
        table("How much they vary", ["level", "sd", "sd_low", "sd_high"], analysis["random_effects"]),
        table("Pairs of conditions", columns, pairs, is_folded=True),
    ]
    return {"title": "Random effects", "paragraphs": [text], "figures": [], "tables": tables}


def _lapses(analysis: Analysis) -> dict[str, Any]:
    """Return scores with careless answers weighted down, and everybody's lapse rate."""
    text = (
        "Everybody gives a share of answers at random, the lapse rate, and votes count by how probable it is that they "
        "are no lapses; how rates vary over people is estimated with the scores. Intervals are t on a jackknife over "
        "participants. Honest people whose opinions are unlike the others' look careless here, too."
    )
    ordered = sorted(analysis["lapse_scores"], key=lambda row: -row["score"])
    rates = sorted(analysis["lapse_rates"], key=lambda row: -row["lapse_rate"])
    tables = [
        table("Scores", ["item", "score", "se", "ci_low", "ci_high"], ordered),
        table("Lapse rates", ["participant", "lapse_rate"], rates, is_folded=True),
    ]
    return {"title": "Careless answers weighted down", "paragraphs": [text], "figures": [], "tables": tables}


def _measures(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    ranked = [_with_intervals(row) for row in measures_by_rank(analysis["measures"]).values()]
    single = [_with_intervals(row) for row in analysis["measures"] if row["dataset"] != ALL]
    single = single if ranked[0]["dataset"] == ALL else []
    correlations = (
        *("pearson_logistic", "pearson_logistic5", "pearson", "pearson_monotone"),
        *("spearman", "spearman_p", "kendall"),
    )
    shares = ("pairs_correct", "auc_better_worse", "auc_different_similar")
    drawn = [figure for name, figure in figures.items() if name.startswith("measure_")]
    shown = [figures["measures"]] if "measures" in figures else []
    rest = f" Figures of the best {MOST_FIGURES} of {len(drawn)}; the folder figures holds all." * (
        len(drawn) > MOST_FIGURES
    )
    where = "all datasets" if single else "the dataset"
    return {
        "title": "Do objective measures predict the scores?",
        "paragraphs": [MEASURES_TEXT.format(unit=score_unit(analysis)) + rest, _chance_text(len(ranked))],
        "figures": [*shown, *drawn[:MOST_FIGURES]],
        "tables": [
            table(f"Correlations over {where}, best first", ["measure", "better", "n", *correlations], ranked),
            table(
                "Pairs in the right order, and errors after the logistic fit",
                ["measure", "pairs_different", "pairs_similar", *shares, "rmse", "rmse_epsilon", "outlier_ratio"],
                ranked,
            ),
            *(
                [table("On each dataset", ["measure", "dataset", "n", *correlations, *shares], single)]
                if single
                else []
            ),
            *_comparisons(analysis),
        ],
    }


MEASURES_TEXT = (
    "PLCC is Pearson's correlation of the scores with a logistic curve of the measure (VQEG 2000), PLCC5 with one of "
    "five parameters, a linear term beside it (Sheikh and others 2006), monotone with the best monotone curve. A pair "
    "is different if the answers tell its conditions apart (5 %, Holm), else similar: “in order” is the share of "
    "different pairs that the measure orders as people do, the areas are those of Krasula and others (2016). RMSE is "
    "in {unit}, RMSE* counts only what exceeds a score's 95 % interval, outliers are the points beyond it (ITU-T "
    "P.1401). Over all datasets, measure and score are relative to their dataset's mean."
)


ERRORS = (  # bench/sentences.py
    "Errors of the scores lower correlations, of ranks most: in simulations of 22 people the interval of a rank "
    "correlation of 0.9 holds it in 88 %, not 95 %."
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
        f"all datasets, so they take conditions as exchangeable.{many} {ERRORS} A measure whose lower values are "
        "better should have negative correlations; pairs and areas already count in its direction, or in that of the "
        "rank correlation where none is stated (“better” is a dash), which flatters the measure."
    )


def _comparisons(analysis: Analysis) -> list[dict[str, Any]]:
    """Return the table of measures against each other, the clearest differences first; none without a pair."""
    rows = [row for row in analysis["measure_comparisons"] if row["p_value"] is not None]
    rows.sort(key=lambda row: row["p_value"])
    if not rows:
        return []
    rest = f" The {MOST_COMPARED} clearest of {len(rows)}" if len(rows) > MOST_COMPARED else ""
    columns = [
        *("measure_a", "measure_b", "pearson_a", "pearson_b", "p_value", "p_holm"),
        *("auc_a", "auc_b", "auc_p", "auc_p_holm"),
    ]
    return [table(f"Does a measure predict better than another?{rest}", columns, rows[:MOST_COMPARED])]


def _with_intervals(row: Row) -> dict[str, Any]:
    shown = [name for name in row if f"{name}_low" in row]
    return dict(row) | {name: with_interval(row, name, name) for name in shown}


def _excluded(analysis: Analysis) -> dict[str, Any]:
    everybody = {(r["comparison"], r["dataset"], r["item"]): r["score"] for r in analysis["scores_with_excluded"]}
    rows = [
        row | {"score with all votes": everybody.get((row["comparison"], row["dataset"], row["item"]))}
        for row in analysis["scores"]
    ]
    text = (
        f"Votes excluded: {analysis['votes']['excluded']}; the last column is the score with them, but without "
        "those of people who have withdrawn."
    )
    columns = ["comparison", "dataset", "item", "score", "score with all votes"]
    return section("Exclusions", text, columns, rows)


def _groups(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    text = (
        "Scores of each group of participants alone. The tests above (group …) tell whether groups differ; a "
        "difference that was not planned before the study is a question for the next one."
    )
    columns = ["grouping", "group", "n_participants", "dataset", "item", "score", "ci_low", "ci_high", "status"]
    shown = [figure for name, figure in figures.items() if name.startswith("group_")]
    return _overall_first("Groups of participants", text, columns, analysis["groups"]) | {"figures": shown}


def _dataset_agreement(analysis: Analysis) -> dict[str, Any]:
    w_test = analysis["dataset_concordance"]
    overall = ""
    if w_test is not None:
        tested = "" if w_test["p_value"] is None else f", {p_phrase(w_test['p_value'])}"
        overall = (
            f" Kendall's coefficient of concordance over all {w_test['n_datasets']} datasets: W = {w_test['w']:.3f} "
            f"(1: the same order everywhere){tested}."
        )
    text = (
        "Correlation of the scores of two datasets over the conditions they share. Errors of the scores lower these "
        f"correlations; the test above tells whether the datasets differ beyond them.{overall}"
    )
    columns = ["dataset_a", "dataset_b", "n_items", "pearson", "spearman", "kendall"]
    return section("Agreement between datasets", text, columns, analysis["dataset_agreement"])


def _agreement(analysis: Analysis) -> dict[str, Any]:
    violations = ("weak", "moderate", "strong", "n_triples")
    rows = [row | (row["transitivity"] or dict.fromkeys(violations)) for row in analysis["agreement"]]
    text = (
        "Kendall's u is 1 if all participants agree and slightly below 0 if they are split evenly; it exists for "
        "complete designs without ties. The next columns count the triples of conditions that violate weak, moderate "
        "and strong stochastic transitivity; without weak transitivity no scores fit the preferences. Krippendorff's "
        "alpha (interval metric, every pair in both directions) takes ties and missing votes."
    )
    known = analysis["disagreement"]
    alphas = {row["dataset"]: row for row in (known["by_dataset"] if known else ())}
    rows = [
        row | {"alpha": with_interval(alphas[row["dataset"]], "alpha", "alpha")}
        if row["dataset"] in alphas
        else row | {"alpha": with_interval(known, "alpha", "alpha") if known else None}
        for row in rows
    ]
    columns = ["dataset", "alpha", "u", "p_value", *violations]
    return section("Agreement", text, columns, rows)


def _triads(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    total = sum(row["circular"] for row in analysis["triads"])
    pooled = analysis["triads_pooled"]
    with_cycles = sum(row["circular"] > 0 for row in pooled)
    complete = sum(row["complete"] for row in analysis["triads"])
    text = (
        f"{counted(total, 'circular triad')} in {counted(len(analysis['triads']), 'set')} of votes, {complete} "
        f"complete, by {part(with_cycles, len(pooled), 'participant')}. They exclude nobody: where conditions "
        "look alike, honest votes contradict each other."
    )
    shown = [figures["triads"]] if "triads" in figures else []
    columns = ["participant", "n_datasets", "circular", "circular_expected_ties", "p_value"]
    rows = sorted(pooled, key=lambda row: (-row["circular"], -row["circular_expected_ties"]))
    return section("Circular triads", text, columns, rows, shown)


def _observers(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    flagged = [row for row in analysis["observers"] if row["flags"]]
    failed = {
        row["participant"]: row["n_identical"] - row["n_identical_none"] + row["n_repeated"] - row["n_repeated_same"]
        for row in analysis["checks"]
    }
    text = (
        f"{len(flagged)} of {counted(len(analysis['observers']), 'participant')} flagged. “Careless” is the natural "
        "logarithm of how much likelier the answers are from somebody who answers carelessly than from somebody who "
        "answers as the others do, with own opinions and noise; somebody is flagged for it only if fewer than 0.05 "
        "honest people of the whole study would be expected to look so. Remarks are no flags: among honest people, "
        "too, some are slower than others, disagree more, or have triads no more consistent than chance, as half of "
        "those have who see no difference. A flag is a reason to look, not to exclude; observers.csv has all numbers."
    )
    rows = [
        row
        | {name: "; ".join(row[name]) for name in ("flags", "remarks")}
        | {"failed_checks": failed.get(row["participant"])}
        for row in sorted(analysis["observers"], key=lambda row: -(row["careless_log_ratio"] or -np.inf))
        if row["flags"] or row["remarks"] or failed.get(row["participant"])
    ]
    shown = [figures["response_times"]] if "response_times" in figures else []
    columns = ["participant", "n_votes", "tie_rate", "careless_log_ratio", "careless_false_alarms"]
    columns += ["failed_checks"] if analysis["checks"] else []
    return section("Participants", text, [*columns, "flags", "remarks"], rows, shown)
