"""Write an analysis to files: tables for programs, figures for a paper, and a report to read."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.analysis.analyse import analyse, used_votes
from app.analysis.attributes import MeasureValues, read_items, read_measures, read_participants
from app.analysis.drawing import FULL, svg_pdf, svg_png
from app.analysis.figures import drawn_figures, font_warnings
from app.analysis.findings.ratings import rating_findings
from app.analysis.objective.against_scores import measure_tables
from app.analysis.objective.points import ScoreSet
from app.analysis.ratings.alignment import align
from app.analysis.ratings.analyse_ratings import analyse_ratings
from app.analysis.ratings.comparisons import analyse_comparisons
from app.analysis.ratings.reading import read_ratings, understand_ratings
from app.analysis.ratings.score_sets import comparison_score_sets, opinion_score_sets
from app.analysis.ratings.table import ComparisonTable, RatingTable
from app.analysis.reading import understand_votes
from app.analysis.report_page import PAGES, report_page
from app.analysis.settings import AnalysisSettings
from app.analysis.votes_table import ALL, VotesError, VotesTable
from app.analysis.warnings import measure_warnings
from app.files import without_formula, write_bytes, write_text

MOST_NAMED = 5  # of what is not among the votes


def analyse_file(
    path: Path | Sequence[Path],
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
    width: int = FULL,
) -> dict[str, Any]:
    """Read votes, analyse them, and write tables, figures and report to the folder `out`.

    Parameters
    ----------
    path : file of votes, or several, as `read_votes` takes them
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
    width : of the figures, in pixels; `WIDTHS` has those of a journal's columns

    Returns
    -------
    dict, the content of analysis.json

    Raises
    ------
    VotesError
        Naming the file, the row and the value, and if no vote counts: nothing is written then.
    ValueError
        For a factor that is not in `items`.
    """
    paths = [path] if isinstance(path, Path) else list(path)
    source = ", ".join(path.name for path in paths)
    votes, understood = understand_votes(paths, columns, choices)
    settings = _with_factors(settings or AnalysisSettings(), items, factors)
    settings = _with_groups(settings, participants, groups)
    settings, notes = (settings, []) if measures is None else _with_measures(settings, votes, measures)
    rated = None if ratings is None else _single_ratings(ratings, scale).without(settings.exclude)
    analysis = analyse(votes, settings) | {"understood": understood}
    _refuse_nothing(analysis["votes"], source)
    analysis["warnings"] += notes
    if rated is not None:
        _add_ratings(analysis, rated, used_votes(votes, settings))
    analysis["warnings"] += font_warnings(analysis)
    write_analysis(analysis, out, source=source, width=width)
    return analysis


def _with_factors(settings: AnalysisSettings, items: Path | None, factors: Sequence[str] | None) -> AnalysisSettings:
    """Return the settings with the factors of a file of items, if there is one."""
    if items is None:
        if factors:
            raise ValueError(f"the factor {factors[0]!r} needs an items file that gives each item's level")
        return settings
    known = read_items(items)
    _chosen(known, factors, "factor", items)
    return replace(settings, factors=known, analysed_factors=tuple(factors or known))


def _with_groups(
    settings: AnalysisSettings, participants: Path | None, groups: Sequence[str] | None
) -> AnalysisSettings:
    """Return the settings with the groupings of a file of participants, if there is one."""
    if participants is None:
        if groups:
            raise ValueError(
                f"the grouping {groups[0]!r} needs a participants file that gives each participant's group"
            )
        return settings
    return replace(settings, groups=_chosen(read_participants(participants), groups, "grouping", participants))


def _with_measures(settings: AnalysisSettings, votes: VotesTable, measures: Path) -> tuple[AnalysisSettings, list[str]]:
    """Return the settings with the measures of a file, and what is to be known about them."""
    known, datasets = read_measures(measures), votes.datasets if votes.has_datasets else ()
    notes = _measure_notes(known, datasets, votes.items, measures)
    return replace(settings, measures=known.on(datasets or (ALL,)), better=known.better), notes


def _add_ratings(analysis: dict[str, Any], rated: RatingTable, votes: VotesTable) -> None:
    """Add what ratings of the same items say, on one scale with the votes."""
    _add_tables(analysis, analyse_ratings(rated) | align(rated, votes))
    (shared,) = analysis["alignment"]
    if shared["status"] != "ok":
        analysis["warnings"].append(
            f"ratings and votes are not on one scale: {shared['status']} ({shared['n_shared']} items in common)"
        )


def _refuse_nothing(votes: Mapping[str, Any], source: str) -> None:
    """Raise if no vote counts."""
    if not votes["analysed"]:
        raise VotesError(
            f"{source}: none of the {votes['votes']} votes counts: {votes['practice']} are practice, {votes['checks']} "
            f"checks, {votes['excluded']} excluded; expected at least one other"
        )


def analyse_ratings_file(
    path: Path,
    out: Path,
    scale: tuple[float, float] | None = None,
    exclude: Sequence[str] = (),
    *,
    width: int = FULL,
    measures: Path | None = None,
) -> dict[str, Any]:
    """Read ratings, analyse them, and write tables, figures and report to the folder `out`.

    Parameters
    ----------
    path : ratings in any format that votes may have: of single items, or comparisons of two
    out : a folder, made if missing
    scale : ends of the scale; 1 and 5 by default, for comparisons -3 and 3
    exclude : participants left out
    width : of the figures, in pixels
    measures : CSV with objective measures, as in `analyse_file`, to be compared with the scores

    Returns
    -------
    dict, the content of analysis.json

    Raises
    ------
    VotesError
        Naming the file, the row and the value.
    """
    table, understood = understand_ratings(path, scale)
    unknown = [name for name in exclude if name not in table.participants]
    if unknown:
        raise VotesError(
            f"{path}: the participant to exclude, {unknown[0]!r}, is not among the {len(table.participants)} who rated"
        )
    table = table.without(exclude)
    if not len(table):
        raise VotesError(f"{path}: no rating is left after the exclusions")
    analysis = NO_VOTES | {"settings": {"exclude": list(exclude)}, "warnings": [], "understood": understood}
    _add_tables(analysis, analyse_ratings(table) if isinstance(table, RatingTable) else analyse_comparisons(table))
    if measures is not None:
        _compare_measures(analysis, table, measures)
    analysis["warnings"] += font_warnings(analysis)
    write_analysis(analysis, out, source=path.name, width=width)
    return analysis


def _compare_measures(analysis: dict[str, Any], table: RatingTable | ComparisonTable, path: Path) -> None:
    """Add the comparison of measures with the scores of ratings to an analysis."""
    known = read_measures(path)
    datasets = list(dict.fromkeys(dataset for dataset, _ in table.items))
    items = list(dict.fromkeys(condition for _, condition in table.items))
    notes = _measure_notes(known, datasets, items, path, "ratings")
    settings = AnalysisSettings(measures=known.on(datasets), better=known.better)
    if isinstance(table, RatingTable):
        add_measures(analysis, opinion_score_sets(table), settings)
    else:
        add_measures(analysis, comparison_score_sets(analysis["comparison_items"]), settings)
    analysis["warnings"] += notes


def add_measures(analysis: dict[str, Any], scored: Mapping[str, ScoreSet], settings: AnalysisSettings) -> None:
    """Add measures compared with the scores of ratings to an analysis, and what is to be warned of.

    Parameters
    ----------
    analysis : that has the tables of ratings; changed
    scored : dataset -> scores
    settings : its measures and their directions
    """
    analysis["settings"] = {**analysis["settings"], "measures": settings.measures, "better": settings.better}
    analysis.update(measure_tables(scored, settings))
    analysis["warnings"] = [*analysis["warnings"], *measure_warnings(analysis["measures"])]


def _single_ratings(path: Path, scale: tuple[float, float] | None) -> RatingTable:
    table = read_ratings(path, scale)
    if isinstance(table, ComparisonTable):
        raise VotesError(f"{path}: compares items, expected ratings of single ones to put on one scale with the votes")
    return table


def _add_tables(analysis: dict[str, Any], tables: Mapping[str, list[dict[str, Any]]]) -> None:
    """Add tables of ratings to an analysis, and their warnings and findings to its own."""
    analysis["findings"] = [*analysis["findings"], *rating_findings(tables)]
    analysis["warnings"] += [row["warning"] for row in tables["rating_warnings"]]
    analysis.update({name: rows for name, rows in tables.items() if name != "rating_warnings"})


def _measure_notes(
    measures: MeasureValues, datasets: Sequence[str], items: Sequence[str], path: Path, what: str = "votes"
) -> list[str]:
    """Return what is to be known about a table of measures; raise if it is of other items than the votes."""
    strangers = measures.strangers(datasets, items)
    more = f" and {len(strangers) - MOST_NAMED} more" if len(strangers) > MOST_NAMED else ""
    named = ", ".join(strangers[:MOST_NAMED]) + more
    n_places = len({(d, item) for by in measures.values.values() for d, row in by.items() for item in row})
    if len(strangers) == n_places:
        raise VotesError(
            f"{path}: measures {named or 'nothing'}; the {what} are on {', '.join(items[:MOST_NAMED])} … in "
            f"{', '.join(datasets[:MOST_NAMED]) or 'all (no dataset is named)'}; name datasets and items as they do"
        )
    left_out = [f"measures: {named} not among the {what} and left out"] if strangers else []
    return [*left_out, *(f"measures: {note}" for note in measures.notes)]


def _chosen(
    known: Mapping[str, dict[str, str]], names: Sequence[str] | None, what: str, path: Path
) -> dict[str, dict[str, str]]:
    unknown = sorted(set(names or ()).difference(known))
    if unknown:
        raise ValueError(f"{path}: has no {what} {unknown[0]!r}; it has {', '.join(known)}")
    return {name: known[name] for name in names or known}


def write_analysis(analysis: Mapping[str, Any], out: Path, *, source: str = "votes", width: int = FULL) -> None:
    """Write analysis.json, the tables, the figures (SVG, PNG, PDF) and the report (HTML, Markdown).

    Every file is complete or absent. analysis.json is written last, so its presence means that the folder is
    complete.

    Parameters
    ----------
    analysis : the content of analysis.json
    out : the folder
    source : name of what was analysed, for the report's title
    width : of the figures, in pixels; `WIDTHS` has those of a journal's columns
    """
    for name in COLUMNS:
        if analysis.get(name) or (analysis["votes"] and name in ALWAYS_THERE):
            write_text(out / f"{name}.csv", table_csv(analysis[name], COLUMNS[name]))
    for path, content in report_files(analysis, source=source, width=width):
        write_bytes(out / path, content)
    write_text(out / "analysis.json", _json_by_row(analysis))


def _json_by_row(analysis: Mapping[str, Any]) -> str:
    """Return an object of tables as JSON, each row on a line: four times faster than indented."""
    parts = []
    for name, value in analysis.items():
        if isinstance(value, list) and value:
            text = "[\n" + ",\n".join(json.dumps(row, allow_nan=False) for row in value) + "\n]"
        else:
            text = json.dumps(value, allow_nan=False)
        parts.append(f"{json.dumps(name)}: {text}")
    return "{\n" + ",\n".join(parts) + "\n}\n"


def report_files(
    analysis: Mapping[str, Any], *, source: str = "votes", width: int = FULL
) -> Iterator[tuple[str, bytes]]:
    """Yield path and content of every figure as SVG, PNG and PDF, then of the report as HTML and Markdown.

    Parameters
    ----------
    analysis : the content of analysis.json
    source : name of what was analysed, for the report's title
    width : of the figures, in pixels
    """
    figures = []
    for figure in drawn_figures(analysis, width):
        yield f"figures/{figure.name}.svg", figure.svg.encode()
        yield f"figures/{figure.name}.png", svg_png(figure.svg)
        yield f"figures/{figure.name}.pdf", svg_pdf(figure.svg)
        figures.append(figure)
    for name in PAGES:
        yield name, report_page(name, analysis, figures, source).encode()


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
    "contrasts": ("comparison", "dataset", "item_a", "item_b", "difference", "se", "p_value", "p_holm"),
    "effects": ("factor", "level", "dataset", "effect", "se", "se_participant", "ci_low", "ci_high", "letters"),
    "tests": ("name", "model", "dataset", "g2", "df", "p_value", "p_participant", "p_holm"),
    "random_effects": ("level", "sd", "sd_low", "sd_high"),
    "random_effects_scores": ("item", "score", "se", "ci_low", "ci_high"),
    "random_effects_contrasts": ("item_a", "item_b", "difference", "se", "p_value", "p_holm"),
    "models": ("comparison", "dataset", "ties", "status", "n_votes", "n_participants"),
    "agreement": ("dataset", "u", "chi2", "df", "p_value"),
    "pairs": ("comparison", "dataset", "item_a", "item_b", "a", "b", "none"),
    "measures": ("measure", "dataset"),
    "measure_comparisons": ("measure_a", "measure_b"),
    "rating_items": ("dataset", "condition", "is_reference", "n_ratings", "n", "mos"),
    "rating_conditions": ("condition", "n_datasets", "n_ratings", "n", "mos"),
    "rating_contrasts": ("item_a", "item_b", "difference", "se", "p_value", "p_holm"),
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
    *("random_effects", "random_effects_scores", "random_effects_contrasts"),
    *("triads_pooled", "measures", "measure_comparisons", "agreement", "dataset_agreement", "observers", "checks"),
    "pairs",
)
NO_VOTES: dict[str, Any] = {  # the keys of an analysis of votes, where there are none
    "schema_version": 1,
    "votes": None,
    "dataset_concordance": None,
    "findings": [],
    **{name: [] for name in VOTE_TABLES},
}


def table_csv(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """Return rows as CSV: these columns first, then any others of the rows; lists are joined by semicolons.

    An apostrophe precedes text that a spreadsheet would take for a formula.
    """
    names = list(dict.fromkeys([*columns, *(name for row in rows for name in row)]))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        writer.writerow([_cell(row.get(name)) for name in names])
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, list | tuple):
        value = "; ".join(map(str, value))
    return without_formula(value) if isinstance(value, str) else value
