"""A study's results: the votes so far through the analysis, with the charts of it, made once for the same inputs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from app.intake.reports import better_by_measure, by_measure
from app.store.designs import conditions_of
from app.store.engine import Database, Transaction
from app.store.measurements import measurement_records
from app.store.participants import participants_votes, questionnaire_records
from app.store.studies import Study, study_by_id
from app.store.vote_records import vote_records
from app.study.groupings import groupings
from app.study.options import StudyOptions, parse_options
from app.study.protocols import CCR, RATED
from app.web.once import Shared

RESULTS_KEPT = 16  # the latest; one of a study with 100 participants takes some MB
WITHDRAWN = "withdrawn"
TABLE_NAMES = {"ratings": "rating_items", "comparisons": "comparison_items"}  # in analysis.json
FIGURE_TABLES = {  # in analysis.json, of figures of ratings
    "opinion_scores": "rating_items",
    "differential_scores": "rating_items",
    "raters": "raters",
    "comparison_scores": "comparison_items",
}
FIGURE_TYPES = {"svg": "image/svg+xml", "png": "image/png", "pdf": "application/pdf", "csv": "text/csv; charset=utf-8"}


@dataclass(frozen=True)
class Results:
    """An analysis with its charts.

    Parameters
    ----------
    digest : SHA-256 of the analysis's inputs
    analysis : the content of analysis.json; None while there are no votes
    """

    digest: str
    analysis: Mapping[str, Any] | None = field(compare=False)

    @cached_property
    def charts(self) -> dict[str, tuple[str, Any]]:
        """Caption and chart of every figure that there is something in, by name."""
        from app.analysis.report import named_charts

        charts = named_charts(self.analysis) if self.analysis is not None else ()
        return {name: (caption, chart) for name, caption, chart in charts if chart is not None}


_results: Shared[Results] = Shared(RESULTS_KEPT)


def results_of(database: Database, study_id: int, *, with_excluded: bool = False) -> Results:
    """Analyse the votes so far.

    Parameters
    ----------
    with_excluded : count participants whom the experimenter has excluded, too; who has withdrawn is never counted
    """
    with database.snapshot() as connection:
        analysed = prepare_results(connection, study_id, with_excluded=with_excluded)
    return analysed()


def grouped_results_of(database: Database, study: Study) -> Results:
    """Analyse the votes so far, and compare groups of participants by their answers; for who may see participants."""
    with database.snapshot() as connection:
        votes = participants_votes(connection, study.id)
        counted = (row for row in votes if row["n_votes"] and row["reason"] is None and row["withdrawn_at"] is None)
        people = {row["participant"] for row in counted}
        answers = questionnaire_records(connection, study.id)
        written = [row for row in answers if row["source"] == "written" and row["participant"] in people]
        groups = groupings(parse_options(study.options).questions, written)
        analysed = prepare_results(connection, study.id, groups=groups)
    return analysed()


def rows_of(analysis: Mapping[str, Any], table: str) -> Sequence[Mapping[str, Any]]:
    """Return the rows of an analysis that a table of analysts shows; none where the protocol has no such table."""
    name = "raters" if table == "observers" and "raters" in analysis else TABLE_NAMES.get(table, table)
    rows: Sequence[Mapping[str, Any]] = analysis.get(name, ())
    return rows


def analysis_of(database: Database, study_id: int) -> Mapping[str, Any] | None:
    """Return the content of analysis.json for the votes so far; None while there are none."""
    return results_of(database, study_id).analysis


def prepare_results(
    connection: Transaction,
    study_id: int,
    *,
    with_excluded: bool = False,
    groups: Mapping[str, Mapping[str, str]] | None = None,
) -> Callable[[], Results]:
    """Read what an analysis is made of; the function that is returned makes it, and needs no connection any more.

    The digest is of how many votes each participant has and of when the vote on their last trial came, because votes
    are added to or all erased, never altered. The votes themselves, of which 60 000 take seconds, are read only if that
    digest is new.

    Parameters
    ----------
    with_excluded : as in `results_of`
    groups : question -> participant -> group, to compare groups by
    """
    study = study_by_id(connection, study_id)
    assert study is not None, "studies are never deleted"
    options = parse_options(study.options)
    votes = participants_votes(connection, study_id)
    if with_excluded:
        votes = [row | {"reason": None} for row in votes]
    measured = measurement_records(connection, study_id)
    inputs: dict[str, Any] = {
        "factors": items_factors(conditions_of(connection, study_id)),
        "measures": by_measure(measured),
        "better": better_by_measure(measured),
        "groups": groups or {},
    }
    known = json.dumps([votes, inputs, options.protocol, options.scale], sort_keys=True, default=str)
    digest = hashlib.sha256(known.encode()).hexdigest()
    if (begun := _results.begun(digest)) is not None:
        return begun.result
    rows = list(vote_records(connection, study_id))
    if with_excluded:
        rows = [row | {"excluded": row["reason"] == WITHDRAWN} for row in rows]
    return lambda: _results.get(digest, lambda: Results(digest, _analysed(rows, inputs, options) if rows else None))


def _analysed(
    rows: Sequence[Mapping[str, Any]], inputs: Mapping[str, Any], options: StudyOptions
) -> Mapping[str, Any] | None:
    """Analyse votes as the study's protocol asks; None where no rating counts.

    Parameters
    ----------
    rows : votes
    inputs : fields of `AnalysisSettings`, for votes on pairs
    options : the study's
    """
    from app.analysis import AnalysisSettings, analyse, votes_from_rows
    from app.analysis.ratings.analyse_ratings import analyse_ratings
    from app.analysis.ratings.comparisons import analyse_comparisons
    from app.analysis.ratings.study_votes import comparison_table, counted_ratings, rating_table
    from app.analysis.report import NO_VOTES

    counted = counted_ratings(rows)
    if options.protocol in RATED and options.grades:
        if not counted:
            return None
        table = rating_table(counted, options.protocol, (options.grades.low, options.grades.high))
        tables = analyse_ratings(table)
        settings = {"protocol": options.protocol, "scale": options.scale}
        return _with_tables(NO_VOTES | {"settings": settings, "warnings": []}, tables)
    analysis = analyse(votes_from_rows(rows), AnalysisSettings(**inputs))
    if options.protocol == CCR and counted:
        return _with_tables(analysis, analyse_comparisons(comparison_table(counted)))
    return analysis


def _with_tables(analysis: Mapping[str, Any], tables: Mapping[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """Return an analysis with tables of ratings, and their warnings among its own."""
    warnings = [*analysis["warnings"], *(row["warning"] for row in tables["rating_warnings"])]
    return {
        **analysis,
        **{name: rows for name, rows in tables.items() if name != "rating_warnings"},
        "warnings": warnings,
    }


def load_analysis() -> None:
    """Import what scores and figures need, before somebody waits a second for them."""
    import app.analysis.report  # noqa: F401


def items_factors(levels: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, str]]:
    """Levels by item for each factor; an item that has no level of one is not named there."""
    factors = dict.fromkeys(factor for item_levels in levels.values() for factor in item_levels)
    return {
        factor: {item: item_levels[factor] for item, item_levels in levels.items() if factor in item_levels}
        for factor in factors
    }


def figures_of(results: Results) -> list[tuple[str, str]]:
    """Name and caption of every figure that there is something in."""
    return [(name, caption) for name, (caption, _) in results.charts.items()]


def figure(results: Results, name: str, kind: str) -> bytes | None:
    """Write a figure as a file; None if there is no such figure.

    Parameters
    ----------
    kind : a key of FIGURE_TYPES, or `vega` for a specification
    """
    from app.analysis.charts import chart_pdf, chart_png, chart_svg, chart_vega

    _, chart = results.charts.get(name, ("", None))
    if chart is None or results.analysis is None:
        return None
    if kind == "csv":
        return _figure_csv(results.analysis, name).encode()
    if kind == "vega":
        return chart_vega(chart).encode()
    return chart_svg(chart).encode() if kind == "svg" else chart_png(chart) if kind == "png" else chart_pdf(chart)


def _figure_csv(analysis: Mapping[str, Any], name: str) -> str:
    from app.web.analyst.formats import csv_text

    rows = _figure_rows(analysis, name)
    return csv_text(rows, list(dict.fromkeys(key for row in rows for key in row)))


def _figure_rows(analysis: Mapping[str, Any], name: str) -> Sequence[Mapping[str, Any]]:
    """Return the numbers behind a figure."""
    kind, _, which = name.partition("_")
    if name in FIGURE_TABLES:
        return list(analysis.get(FIGURE_TABLES[name], ()))
    if kind == "scores":
        comparisons = {row["comparison"] for row in analysis["scores"]}
        wanted = next((comparison for comparison in comparisons if _is_called(comparison, which)), "all")
        return [row for row in analysis["scores"] if row["comparison"] == wanted]
    if kind in ("preferences", "residuals"):
        return [row for row in analysis["pairs"] if row["comparison"] == "all"]
    if kind == "triads":
        return list(analysis["triads"])
    if kind == "response":
        return list(analysis["observers"])
    if name == "measures":
        return list(analysis["measures"])
    return [row for row in analysis["measures" if kind == "measure" else "groups"] if _is_of(row, which)]


def _is_of(row: Mapping[str, Any], which: str) -> bool:
    return _is_called(str(row.get("measure", row.get("grouping", ""))), which)


def _is_called(name: str, file_name: str) -> bool:
    return "".join(character if character.isalnum() else "_" for character in name) == file_name
