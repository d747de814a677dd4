"""Write the report's subjective sections: scores, circular triads, and which measure would have predicted them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from app.analysis.drawing.charts_in_common import chart_svg
from app.analysis.objective.prediction import measures_by_rank
from app.analysis.reading.votes_table import ALL
from app.analysis.report.objective_charts import measure_chart, ranking_chart
from app.analysis.report.vote_charts import triads_chart
from app.experiment.figures import levels_bars
from app.experiment.parts import Figure, Section, Table
from app.experiment.results import Results, order_text
from app.experiment.study import LOG_ODDS_PER_OCTAVE, QUALITY, TASTE_SPREAD, TIE_RATE

LIKED = {"depth": "depth reconstruction", "fusion": "view fusion", "colour": "source of colours"}
USED = {
    False: "pairs that differ in the factor only",
    True: "effects of levels, all else equal, in an additive model of all pairs: of pairs chosen because they are "
    "close, few differ in one factor only (these alone are used on scenes whose votes set an effect no limit)",
}
CAPTION = (
    "Figure {number}. Opinion scores by {what}, for each scene and for all of them together: Bradley-Terry scores in "
    "natural log-odds, which sum to zero in each group of bars; whiskers are 95 % intervals with people as the "
    "sample. A bar without whiskers has votes that set its score no limit."
)

TRIADS_CAPTION = (
    "Circular triads (A before B, B before C, C before A) of each participant over all scenes: the bar is how many "
    "there are, the diamond what is expected of votes at random with the same ties."
)
RANKING_CAPTION = (
    "How well each measure predicts the videos' scores over all scenes, with 95 % intervals over the videos: "
    "correlation after a logistic fit, rank correlation, and how often it tells which of two videos is better. The "
    "dashed line is a measure that knows nothing."
)


def subjective_section(results: Results, published: Mapping[str, Any]) -> Section:
    tables, figures = [], []
    for number, comparison in enumerate(LIKED, start=7):
        if comparison not in results.factors:
            continue
        paper, rows = published.get(f"figure_{number}", {}), []
        for dataset in [*results.objective["scenes"], ALL]:
            scored = results.scores(comparison, dataset)
            listed = "; ".join(f"{item} {score:+z.2f}" for item, score in scored.items())
            here = order_text(scored, results.told_apart(comparison, dataset))
            truth = order_text(results.truth(comparison, dataset))
            rows.append((dataset, order_text(paper.get(dataset, ())), here, listed, truth))
        columns = ("dataset", "paper", "here", "scores, log-odds", "put in")
        tables.append(Table(f"figure_{number}", f"Values of figure {number}: {LIKED[comparison]}", columns, rows))
        chart = levels_bars(results.score_rows(comparison), results.objective["scenes"])
        figures.append(
            Figure(CAPTION.format(number=number, what=LIKED[comparison]), f"figure_{number}", chart_svg(chart))
        )
    circular = sum(row["circular"] for row in results.analysis["triads"])
    most = sum(row["circular_max"] or 0 for row in results.analysis["triads"])
    flagged = [row["participant"] for row in results.analysis["observers"] if row["flags"]]
    text = [
        f"Bradley-Terry scores with ties (Davidson), {USED[results.has_effects]}, intervals with people as the sample. "
        "≈ stands between neighbours that the votes do not tell apart (5 %, Holm).",
        f"Circular triads: {circular}{f' of at most {most}' if most else ''}; the paper "
        f"found {published['trials']['circular_triads']}. The noise put in: log-odds of {LOG_ODDS_PER_OCTAVE:g} for "
        f"half the unlikeness to the photographs, people's tastes of {TASTE_SPREAD:g} beside that (standard "
        f"deviation), and {TIE_RATE:.0%} ties between equals. "
        "Such triads between similar videos are no reason to exclude anybody"
        f"{'; something else is unusual about ' + ', '.join(flagged) if flagged else ''}.",
    ]
    triads = triads_chart(results.analysis) if most else None  # adaptive pairs make few triangles
    extra = [] if triads is None else [Figure(TRIADS_CAPTION, svg=chart_svg(triads))]
    return Section("Subjective evaluation", text, tables, [*figures, *extra])


def ratings_section(results: Results) -> Iterator[Section]:
    """Yield the part on ratings, if there were any: mean opinion scores beside the scores from comparisons."""
    if "ratings" not in results.answers:
        return
    ratings, scores = results.answers["ratings"], results.scores(ALL, ALL)
    rows = [
        (row["condition"], f"{row['mos']:.2f}",
         "–" if row["ci_low"] is None else f"{row['ci_low']:.2f} to {row['ci_high']:.2f}",
         _signed(scores.get(row["condition"])))
        for row in sorted(ratings["rating_conditions"], key=lambda row: -row["mos"])
    ]  # fmt: skip
    n_people = max(row["n"] for row in ratings["rating_conditions"])
    text = (
        f"A second protocol: {n_people} other artificial people of the same preferences, whom a recruiting platform "
        "sends with an id in the link, see every video alone and rate it from 1 (bad) to 5 (excellent), ITU-T P.910 "
        "ACR; their preferences are scaled to span the grades. "
        "Mean opinion scores over all scenes, 95 % interval over people, beside the scores from comparisons."
    )
    columns = ("approach", "mean opinion score", "95 % interval", "score, log-odds")
    table = Table("ratings", f"Ratings of {len(ratings['rating_items'])} videos", columns, rows)
    yield Section("Absolute ratings", [text], [table])


def prediction_section(results: Results) -> Section:
    ranked = [row for row in measures_by_rank(results.analysis["measures"]).values() if row["dataset"] == ALL]
    rows = [
        (row["measure"], row["better"], _signed(row["spearman"]), _between(row, "spearman"),
         _signed(row["pearson_logistic"]),
         f"{row['pairs_correct']:.0%} of {row['pairs_different']}" if row["pairs_correct"] is not None else "–")
        for row in ranked
    ]  # fmt: skip
    columns = ("measure", "better", "rank correlation", "95 % interval", "PLCC", "clear pairs in order")
    text = (
        "Which measure would have predicted the votes? Correlations over all scenes, each relative to its mean; PLCC "
        "is after a logistic fit; negative where less of a measure is better. The intervals hold for measures: one of "
        f"random numbers excludes zero in 5 % of experiments. “{QUALITY}” is what the people were told to see."
    )
    against = [row for row in ranked if is_against(row)]
    remarks = [
        f"{row['measure']}: {row['better']} is better by its definition, but people liked the opposite (rank "
        f"correlation {row['spearman']:+z.2f}): among these videos it tells something else than quality."
        for row in against
    ]
    best = next((row["measure"] for row in ranked if row["measure"] != QUALITY), QUALITY)
    charts = [(RANKING_CAPTION, ranking_chart(results.analysis))]
    charts += [
        (
            f"The videos' scores against their {name}, both relative to their scene's mean: a point for each video "
            "with its 95 % interval, and the fitted logistic curve.",
            measure_chart(results.analysis, name),
        )
        for name in dict.fromkeys((QUALITY, best))
    ]
    figures = [Figure(caption, svg=chart_svg(chart)) for caption, chart in charts if chart is not None]
    return Section("Objective against subjective", [text, *remarks], [Table("measures", "", columns, rows)], figures)


def is_against(row: Mapping[str, Any]) -> bool:
    """Tell whether people surely liked a measure's better values less."""
    ends = row["spearman_low"], row["spearman_high"]
    if not row["better"] or None in ends:
        return False
    return bool(max(ends) < 0 if row["better"] == "higher" else min(ends) > 0)


def _signed(value: float | None) -> str:
    return "–" if value is None else f"{value:+z.2f}"


def _between(row: Mapping[str, Any], name: str) -> str:
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    return "–" if low is None else f"{low:+z.2f} to {high:+z.2f}"
