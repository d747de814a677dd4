"""Write the report's sections on ratings: scores, participants, the scale shared with pair votes, comparisons."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from app.analysis.ratings.table import PROTOCOLS
from app.analysis.reading.phrases import counted, with_interval
from app.analysis.report.tables import Analysis, Figures, Row, section, table

EXPLAINED = {
    "ok": "the quality weights each participant by consistency and takes off individual bias (ITU-T P.910 Annex E)",
    "common inconsistency": "the quality takes off individual bias (ITU-T P.913 clause 12.4)",
}
OF_THESE = "The quality's interval holds for ratings by these participants, that of the MOS for other people's too"


def rating_sections(analysis: Analysis, figures: Figures) -> Iterator[dict[str, Any]]:
    """Yield the sections for which this analysis has ratings.

    Parameters
    ----------
    figures : name -> figure, of the figures that were drawn
    """
    if analysis.get("rating_items"):
        yield _opinions(analysis, figures)
        yield _raters(analysis, figures)
    if analysis.get("alignment"):
        yield _alignment(analysis, figures)
    if analysis.get("comparison_pairs"):
        yield _comparisons(analysis, figures)


def _opinions(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    (model,) = analysis["rating_model"]
    quality = EXPLAINED.get(model["status"])
    text = (
        f"{counted(model['n_ratings'], 'rating')} by {counted(model['n_participants'], 'participant')} on the scale "
        f"from {model['low']:g} to {model['high']:g}; {PROTOCOLS[model['protocol']]}. The MOS is the mean over "
        "participants with its 95 % interval (t)" + (f"; {quality}. {OF_THESE}." if quality else ".")
    )
    has_differences = any(row["dmos"] is not None for row in analysis["rating_items"])
    if has_differences:
        text += (
            " The DMOS is the rating itself, which already compares with the reference."
            if model["protocol"] == "dcr"
            else f" The DMOS is the rating less the same participant's rating of the reference, plus {model['high']:g}."
        )
    columns = ["participants", "MOS", "sd", *(["DMOS"] if has_differences else []), "quality"]
    rows = [_with_intervals(row) for row in analysis["rating_items"]]
    conditions = [_with_intervals(row) for row in analysis["rating_conditions"]]
    tables = [table("Every item", ["condition", "dataset", *columns], rows)]
    if len({row["dataset"] for row in rows}) > 1:
        letters = ["letters"] if any(row["letters"] for row in conditions) else []
        tables.insert(
            0, table("Conditions over all datasets", ["condition", "n_datasets", *columns, *letters], conditions)
        )
    shown = [figures[name] for name in ("opinion_scores", "differential_scores") if name in figures]
    return {"title": "Mean opinion scores", "paragraphs": [text], "figures": shown, "tables": tables}


def _with_intervals(row: Row) -> dict[str, Any]:
    name = f"{row['condition']} (reference)" if row.get("is_reference") else row["condition"]
    return dict(row) | {
        "condition": name,
        "participants": row["n"],
        "MOS": with_interval(row, "mos", "ci"),
        "DMOS": with_interval(row, "dmos", "dmos"),
        "quality": with_interval(row, "quality", "quality"),
    }


def _raters(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    text = (
        "Bias is how much higher a participant rates than the others, inconsistency the standard deviation of what "
        "quality and bias do not explain. Unusual are ratings that go with the others' so little that fewer than 0.05 "
        "honest people of the whole study would look so (Rosner's test of correlations), or the same rating "
        "throughout. Remarks are no flags: the screening of observers of ITU-R BT.500, and a correlation with the mean "
        "scores below 0.75 (VQEG HDTV test plan, Annex I), name honest people, too. All count in the scores."
    )
    rows = [
        row
        | {
            "bias": with_interval(row, "bias", "bias"),
            "inconsistency": with_interval(row, "inconsistency", "inconsistency"),
            **{name: "; ".join(row[name]) or None for name in ("flags", "remarks")},
        }
        for row in sorted(analysis["raters"], key=lambda row: not row["flags"])
    ]
    columns = ["participant", "n_ratings", "mean", "bias", "inconsistency", "correlation", "flags", "remarks"]
    return section("Participants who rated", text, columns, rows, [figures["raters"]] if "raters" in figures else [])


def _alignment(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    (model,) = analysis["alignment"]
    if model["status"] != "ok":
        text = f"Ratings and votes could not be put on one scale: {model['status']} ({model['n_shared']} in common)."
        return {"title": "Ratings and votes on one scale", "paragraphs": [text], "figures": [], "tables": []}
    whose = "participants as the sample" if model["n_participants"] else "votes and ratings taken as independent"
    intervals = (
        "There are no intervals, as a single participant voted, or rated, or all agree exactly"
        if model["slope_low"] is None
        else f"Intervals are 95 %, with {whose}"
    )
    text = (
        "One quality per item explains ratings and votes together (maximum likelihood; Perez-Ortiz and others 2020): a "
        "rating is the quality plus noise, the log-odds of a preference are "
        f"{with_interval(model, 'slope', 'slope')} for each step of the rating "
        f"scale. {intervals}; scores are log-odds with mean zero in each dataset."
    )
    rows = [
        row | {name: with_interval(row, name, name) for name in ("quality", "score")}
        for row in analysis["alignment_items"]
    ]
    columns = ["condition", "dataset", "n_ratings", "n_votes", "quality", "score"]
    shown = [figures["alignment"]] if "alignment" in figures else []
    return section("Ratings and votes on one scale", text, [*columns, "jod"], rows, shown)


def _comparisons(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    text = (
        "Comparison category ratings (ITU-T P.910): above zero where the second item of a pair is better. What being "
        "shown second adds is taken off (Scheffe 1952) where the orders can tell it. Scores are the least squares "
        "scale of all ratings, with mean zero; the difference of two scores is the expected rating of the pair."
    )
    if any(row["ci_low"] is not None for row in analysis["comparison_pairs"]):
        text += " In brackets: 95 % intervals, with participants as the sample."
    scores = [dict(row) | {"scored": with_interval(row, "score", "ci")} for row in analysis["comparison_items"]]
    place = list(dict.fromkeys(row["dataset"] for row in scores)).index
    scores.sort(key=lambda row: (place(row["dataset"]), -row["score"]))
    pairs = [
        dict(row) | {"participants": row["n"], "cmos": with_interval(row, "cmos", "ci")}
        for row in analysis["comparison_pairs"]
    ]
    return {
        "title": "Comparison ratings",
        "paragraphs": [text],
        "figures": [figures["comparison_scores"]] if "comparison_scores" in figures else [],
        "tables": [
            table("Scores", ["condition", "dataset", "n_ratings", "scored"], scores),
            table("Pairs", ["item_a", "item_b", "dataset", "n_ratings", "participants", "cmos", "sd"], pairs),
            table(
                "Order",
                ["dataset", "n_ratings", "order_effect", "order_se", "n_first_better", "n_second_better", "status"],
                analysis["comparison_models"],
            ),
        ],
    }
