"""Write an analysis to files: tables for programs, figures for a paper, and a report to read."""

from __future__ import annotations

import csv
import io
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from app.analysis.analyse import analyse, used_votes
from app.analysis.attributes import MeasureValues, read_items, read_measures, read_participants
from app.analysis.charts import (
    chart_pdf,
    chart_png,
    chart_svg,
    groups_chart,
    preference_chart,
    residual_chart,
    response_chart,
    scores_chart,
    triads_chart,
)
from app.analysis.objective.charts import measure_chart, ranking_chart
from app.analysis.objective.prediction import ALL, measures_by_rank
from app.analysis.ratings.alignment import align
from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.ratings.charts import rating_charts
from app.analysis.ratings.comparisons import analyse_comparisons
from app.analysis.ratings.reading import read_ratings
from app.analysis.ratings.table import ComparisonTable, RatingTable
from app.analysis.reading import read_votes
from app.analysis.report_sections import sections
from app.analysis.settings import AnalysisSettings
from app.analysis.votes_table import VotesError, VotesTable
from app.files import packaged, write_bytes, write_json, write_text

ITEMS_IN_A_TABLE = 60
MOST_NAMED = 5  # of what is not among the votes

ROUNDING = 1e-12  # smaller numbers are rounding errors of zero

TIES_IN_WORDS = {
    "davidson": "the model of Davidson (1970)",
    "rao-kupper": "the model of Rao and Kupper (1967)",
    "half": "half a win for each item",
    "drop": "left out",
}


def analyse_file(
    path: Path,
    out: Path,
    settings: AnalysisSettings | None = None,
    *,
    items: Path | None = None,
    columns: Mapping[str, str] | None = None,
    choices: Mapping[str, str] | None = None,
    factors: Sequence[str] | None = None,
    measures: Path | None = None,
    participants: Path | None = None,
    groups: Sequence[str] | None = None,
    ratings: Path | None = None,
    scale: tuple[float, float] | None = None,
) -> dict[str, Any]:
    """Read votes, analyse them, and write tables, figures and report to the folder `out`.

    Parameters
    ----------
    path : votes as CSV, Parquet or JSON
    out : a folder, made if missing
    settings : how to analyse; `items` replaces its factors
    items : CSV with `item` and one column per factor
    columns, choices : our names -> those in the file, where they differ: {"participant": "judge"}, {"none": "tie"}
    factors : the factors to analyse out of those in `items`; all of them by default
    measures : CSV with objective measures, to be compared with the scores: the long table of `reconstudy validate`,
        or `dataset`, `item` and one column per measure
    participants : CSV with `participant` and one column per grouping, whose groups are compared
    groups : the groupings to compare out of those in `participants`; all of them by default
    ratings : CSV with ratings of the same items, to be put on one scale with the votes
    scale : ends of the ratings' scale; 1 and 5 by default

    Returns
    -------
    dict, the content of analysis.json

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    ValueError
        For a factor that is not in `items`.
    """
    settings = settings or AnalysisSettings()
    votes = read_votes(path, columns, choices)
    if items is not None:
        known = read_items(items)
        _chosen(known, factors, "factor", items)
        settings = replace(settings, factors=known, analysed_factors=tuple(factors or known))
    elif factors:
        raise ValueError(f"the factor {factors[0]!r} needs an items file that gives each item's level")
    notes: list[str] = []
    if measures is not None:
        known_measures = read_measures(measures)
        notes = _measure_notes(known_measures, votes, measures)
        datasets = votes.datasets if votes.has_datasets else (ALL,)
        settings = replace(settings, measures=known_measures.on(datasets), better=known_measures.better)
    if participants is not None:
        settings = replace(settings, groups=_chosen(read_participants(participants), groups, "grouping", participants))
    elif groups:
        raise ValueError(f"the grouping {groups[0]!r} needs a participants file that gives each participant's group")
    rated = None if ratings is None else _single_ratings(ratings, scale).without(settings.exclude)
    analysis = analyse(votes, settings)
    analysis["warnings"] += notes
    if rated is not None:
        _add_tables(analysis, analyse_ratings(rated) | align(rated, used_votes(votes, settings)))
        (shared,) = analysis["alignment"]
        if shared["status"] != "ok":
            analysis["warnings"].append(
                f"ratings and votes are not on one scale: {shared['status']} ({shared['n_shared']} items in common)"
            )
    write_analysis(analysis, out, source=path.name)
    return analysis


def analyse_ratings_file(
    path: Path, out: Path, scale: tuple[float, float] | None = None, exclude: Sequence[str] = ()
) -> dict[str, Any]:
    """Read ratings, analyse them, and write tables, figures and report to the folder `out`.

    Parameters
    ----------
    path : ratings as CSV, Parquet or JSON: of single items, or comparisons of two
    out : a folder, made if missing
    scale : ends of the scale; 1 and 5 by default, for comparisons -3 and 3
    exclude : participants left out

    Returns
    -------
    dict, the content of analysis.json

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    table = read_ratings(path, scale)
    unknown = [name for name in exclude if name not in table.participants]
    if unknown:
        raise VotesError(
            f"{path}: the participant to exclude, {unknown[0]!r}, is not among the {len(table.participants)} who rated"
        )
    table = table.without(exclude)
    if not len(table):
        raise VotesError(f"{path}: no rating is left after the exclusions")
    analysis = NO_VOTES | {"settings": {"exclude": list(exclude)}, "warnings": []}
    _add_tables(analysis, analyse_ratings(table) if isinstance(table, RatingTable) else analyse_comparisons(table))
    write_analysis(analysis, out, source=path.name)
    return analysis


def _single_ratings(path: Path, scale: tuple[float, float] | None) -> RatingTable:
    table = read_ratings(path, scale)
    if isinstance(table, ComparisonTable):
        raise VotesError(f"{path}: compares items, expected ratings of single ones to put on one scale with the votes")
    return table


def _add_tables(analysis: dict[str, Any], tables: Mapping[str, list[dict[str, Any]]]) -> None:
    """Add tables of ratings to an analysis, and their warnings to its warnings."""
    analysis["warnings"] += [row["warning"] for row in tables["rating_warnings"]]
    analysis.update({name: rows for name, rows in tables.items() if name != "rating_warnings"})


def _measure_notes(measures: MeasureValues, votes: VotesTable, path: Path) -> list[str]:
    """Return what is to be known about a table of measures; raise if it is of other items than the votes."""
    datasets = votes.datasets if votes.has_datasets else ()
    strangers = measures.strangers(datasets, votes.items)
    more = f" and {len(strangers) - MOST_NAMED} more" if len(strangers) > MOST_NAMED else ""
    named = ", ".join(strangers[:MOST_NAMED]) + more
    n_places = len({(d, item) for by in measures.values.values() for d, row in by.items() for item in row})
    if len(strangers) == n_places:
        raise VotesError(
            f"{path}: measures {named or 'nothing'}; the votes are on {', '.join(votes.items[:MOST_NAMED])} … in "
            f"{', '.join(datasets[:MOST_NAMED]) or 'all (no dataset is named)'}; name datasets and items as they do"
        )
    left_out = [f"measures: {named} not among the votes and left out"] if strangers else []
    return [*left_out, *(f"measures: {note}" for note in measures.notes)]


def _chosen(
    known: Mapping[str, dict[str, str]], names: Sequence[str] | None, what: str, path: Path
) -> dict[str, dict[str, str]]:
    unknown = sorted(set(names or ()).difference(known))
    if unknown:
        raise ValueError(f"{path}: has no {what} {unknown[0]!r}; it has {', '.join(known)}")
    return {name: known[name] for name in names or known}


def write_analysis(analysis: Mapping[str, Any], out: Path, *, source: str = "votes") -> None:
    """Write analysis.json, the tables, the figures (SVG, PNG, PDF) and the report (HTML, Markdown).

    Every file is complete or absent. analysis.json is written last, so its presence means that the folder is
    complete.

    Parameters
    ----------
    analysis : the content of analysis.json
    out : the folder
    source : name of what was analysed, for the report's title
    """
    for name in COLUMNS:
        if analysis.get(name) or (analysis["votes"] and name in ALWAYS_THERE):
            write_text(out / f"{name}.csv", table_csv(analysis[name], COLUMNS[name]))
    figures = [_write_figure(name, caption, chart, out) for name, caption, chart in named_charts(analysis)]
    content = _content(analysis, figures, source)
    for name in ("report.html", "report.md"):
        write_text(out / name, _environment(name).get_template(name).render(content))
    write_json(out / "analysis.json", dict(analysis))


COLUMNS = {
    "scores": (
        *("comparison", "dataset", "item", "score", "se", "se_participant", "ci_low", "ci_high"),
        *("n_votes", "wins", "losses", "ties", "status"),
    ),
    "triads": (
        *("participant", "dataset", "n_items", "complete", "circular"),
        *("circular_expected_ties", "circular_max", "zeta", "p_value"),
    ),
    "observers": ("participant", "flags"),
    "measures": ("measure", "dataset"),
    "measure_comparisons": ("measure_a", "measure_b"),
    "rating_items": ("dataset", "condition", "is_reference", "n_ratings", "n", "mos"),
    "rating_conditions": ("condition", "n_datasets", "n_ratings", "n", "mos"),
    "rating_model": ("protocol", "low", "high", "n_ratings", "n_participants", "n_items", "status"),
    "raters": ("participant", "n_ratings", "mean", "bias", "inconsistency", "flags"),
    "alignment_items": ("dataset", "condition", "n_ratings", "n_votes", "quality", "score"),
    "alignment": ("n_items", "n_shared", "n_ratings", "n_votes", "slope", "rating_noise", "status"),
    "comparison_pairs": ("dataset", "item_a", "item_b", "n_ratings", "n", "cmos"),
    "comparison_items": ("dataset", "condition", "n_ratings", "score"),
    "comparison_models": ("dataset", "n_ratings", "n_participants", "order_effect", "order_se", "status"),
}
ALWAYS_THERE = ("scores", "triads", "observers")  # tables of every analysis of votes
VOTE_TABLES = (
    *("scores", "scores_with_excluded", "models", "tie_models", "contrasts", "effects", "tests", "groups", "triads"),
    *("triads_pooled", "measures", "measure_comparisons", "agreement", "dataset_agreement", "observers", "checks"),
    "pairs",
)
NO_VOTES: dict[str, Any] = {  # the keys of an analysis of votes, where there are none
    "schema_version": 1,
    "votes": None,
    "dataset_concordance": None,
    **{name: [] for name in VOTE_TABLES},
}


def table_csv(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Return rows as CSV: these columns first, then any others of the rows; lists are joined by semicolons."""
    names = list(dict.fromkeys([*columns, *(name for row in rows for name in row)]))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        writer.writerow(["; ".join(map(str, row[n])) if isinstance(row.get(n), list) else row.get(n) for n in names])
    return text.getvalue()


def named_charts(analysis: Mapping[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """Yield every figure's name, caption and chart; the chart is None where there is nothing to draw."""
    for comparison in dict.fromkeys(row["comparison"] for row in analysis["scores"]):
        name = "scores" if comparison == "all" else f"scores_{_file_name(comparison)}"
        what = "all items" if comparison == "all" else f"the factor {comparison}"
        yield name, f"Scores of {what} with 95 % intervals.", scores_chart(analysis, comparison)
    yield "preferences", "Votes for the row's item against the column's.", preference_chart(analysis)
    yield "residuals", "Where the model and the votes differ.", residual_chart(analysis)
    yield "measures", "How well each measure predicts the scores.", ranking_chart(analysis)
    for measure in measures_by_rank(analysis["measures"]):
        yield f"measure_{_file_name(measure)}", f"Score against {measure}.", measure_chart(analysis, measure)
    for grouping in dict.fromkeys(row["grouping"] for row in analysis["groups"]):
        yield f"group_{_file_name(grouping)}", f"Scores by {grouping}, all datasets.", groups_chart(analysis, grouping)
    yield "response_times", "Response times of each participant.", response_chart(analysis)
    yield "triads", "Circular triads of each participant over all datasets.", triads_chart(analysis)
    yield from rating_charts(analysis)


def _file_name(text: str) -> str:
    return "".join(character if character.isalnum() else "_" for character in text)


def _write_figure(name: str, caption: str, chart: Any, out: Path) -> dict[str, str] | None:
    if chart is None:
        return None
    svg = chart_svg(chart)
    write_text(out / "figures" / f"{name}.svg", svg)
    write_bytes(out / "figures" / f"{name}.png", chart_png(chart))
    write_bytes(out / "figures" / f"{name}.pdf", chart_pdf(chart))
    return {"name": name, "caption": caption, "svg": svg}


def _environment(name: str) -> Environment:
    environment = Environment(
        loader=FileSystemLoader(packaged("templates/analysis")),
        autoescape=name.endswith(".html"),
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    environment.filters["number"] = _number
    return environment


def _number(value: Any) -> str:
    """Format a number for reading: three decimals, small p-values in scientific notation, None as a dash."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return "0.000" if abs(value) < ROUNDING else f"{value:.3f}" if abs(value) >= 0.0005 else f"{value:.1e}"
    return str(value)


def _content(analysis: Mapping[str, Any], figures: Sequence[dict[str, str] | None], source: str) -> dict[str, Any]:
    by_name = {figure["name"]: figure for figure in figures if figure}
    has_votes = analysis["votes"] is not None
    return {
        "analysis": analysis,
        "title": f"{'Pair comparison' if has_votes else 'Ratings'}: {source}",
        "summary": _summary(analysis) if has_votes else "",
        "figures": {"scores": [figure for name, figure in by_name.items() if name.startswith("scores")]},
        "score_tables": _score_tables(analysis),
        "scores_note": _scores_note(analysis),
        "sections": list(sections(analysis, by_name)),
        "methods": [*(_methods(analysis) if has_votes else ()), _software()],
    }


def _summary(analysis: Mapping[str, Any]) -> str:
    votes = analysis["votes"]
    people = "unknown participants" if votes["participants"] is None else f"{votes['participants']} participants"
    datasets = f" on {len(votes['datasets'])} datasets" if votes["datasets"] else ""
    return (
        f"{votes['votes']} votes read: {votes['analysed']} analysed ({votes['ties']} without preference), "
        f"{votes['practice']} practice, {votes['excluded']} excluded. "
        f"{people.capitalize()}, {len(votes['items'])} items{datasets}."
    )


def _scores_note(analysis: Mapping[str, Any]) -> str:
    methods = dict.fromkeys(row["ci_method"] for row in analysis["scores"] if row["ci_method"])
    return (
        "Scores are log-odds with sum zero in each panel: a difference of 1.1 (one JOD) means that one item is "
        f"preferred three times as often as the other. Intervals: 95 %, {' or '.join(methods) or 'none'}. "
        "Overlapping intervals are no test of a difference: items of one panel that share a letter in the column group "
        "do not differ significantly (5 %, all pairs, Holm)."
    )


def _score_tables(analysis: Mapping[str, Any]) -> list[dict[str, Any]]:
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in analysis["scores"]:
        shown = dict(row) | {"error": row["se"] if row["se_participant"] is None else row["se_participant"]}
        groups.setdefault((row["comparison"], row["dataset"]), []).append(shown)
    tables = []
    for (comparison, dataset), rows in sorted(groups.items(), key=lambda group: group[0][1] != "all"):
        rows.sort(key=lambda row: -(row["score"] or 0.0))
        what = "All items" if comparison == "all" else f"Factor {comparison}"
        where = "all datasets" if dataset == "all" else dataset
        rest = (
            f"; the first {ITEMS_IN_A_TABLE} of {len(rows)}, all in scores.csv" if len(rows) > ITEMS_IN_A_TABLE else ""
        )
        has_letters = any(row.get("letters") for row in rows)
        title = f"{what}, {where}{rest}"
        tables.append({"title": title, "rows": rows[:ITEMS_IN_A_TABLE], "has_letters": has_letters})
    return tables


def _methods(analysis: Mapping[str, Any]) -> list[str]:
    settings, votes = analysis["settings"], analysis["votes"]
    texts = [
        f"Items were compared in pairs{' with a no-preference option' if votes['ties'] else ''}. "
        f"Scores were estimated with the Bradley-Terry model (Bradley and Terry 1952) by maximum likelihood; ties: "
        f"{TIES_IN_WORDS[settings['ties']]}.",
        "Before each fit, Ford's condition (1957) and its extensions were checked; where no finite maximum exists, a "
        "penalised estimate is shown and marked, Firth's (1993) unless another is named.",
    ]
    if settings["order_effect"]:
        texts.append("An advantage of the item shown first was estimated with the scores (Davidson and Beaver 1977).")
    if votes["participants"] is not None:
        texts.append(
            "The participant is the independent unit: standard errors come from the sandwich estimator clustered by "
            f"participant with the factor J / (J - 1), intervals from {_interval_in_words(settings)}."
        )
        texts.append(
            "Contradictory votes were counted as circular triads (Kendall and Babington Smith 1940) with exact "
            "p-values up to ten items; ties enter by the expectation over all ways of breaking them."
        )
    return texts


def _software() -> str:
    return (
        f"Software: reconstudy {version('reconstudy')}, Python {platform.python_version()}, "
        f"numpy {np.__version__}, scipy {scipy.__version__}."
    )


def _interval_in_words(settings: Mapping[str, Any]) -> str:
    if settings["bootstrap"]:
        return f"percentiles of {settings['bootstrap']} bootstrap samples of participants (seed {settings['seed']})"
    return "the t distribution with J - 1 degrees of freedom"
