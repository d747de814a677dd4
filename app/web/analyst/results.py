"""A study's results, made once for the same inputs: the analysis of its votes, its charts, balance and power."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from app.intake.reports import better_by_measure, by_measure
from app.store.database.engine import Database, Transaction
from app.store.participants.interviews import questionnaire_records
from app.store.participants.participants import assigned_groups, counted_voters, session_state
from app.store.studies.measurements import measurement_records
from app.store.studies.studies import Study, study_by_id
from app.store.trials.counted_votes import VoteState, vote_state
from app.store.trials.designs import conditions_of
from app.store.trials.orders import study_plan, taken_orders
from app.study.design.balance import balance_report
from app.study.design.groupings import groupings, without_small_groups
from app.study.options.options import StudyOptions, parse_options
from app.study.protocols import CCR, PC, RATED, WITH_REFERENCE
from app.web.analyst.columns import with_others
from app.web.analyst.formats import csv_text
from app.web.analyst.study_votes import read_votes_table
from app.web.once import Latest, Shared

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from app.analysis.reading.votes_table import VotesTable

RESULTS_KEPT = 16  # the latest; one of a study with 100 participants takes some MB
ASSIGNED = "assigned group"  # beside the questions that participants are grouped by
PATIENCE_S = 0.4  # checking the orders of 10 000 participants takes minutes
TABLE_NAMES = {"ratings": "rating_items", "comparisons": "comparison_items"}  # in analysis.json
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
        """Caption and chart of every figure that has anything to show, by name."""
        from app.analysis.report.figures import named_charts

        charts = named_charts(self.analysis) if self.analysis is not None else ()
        return {name: (caption, chart) for name, caption, chart in charts if chart is not None}


_results: Shared[Results] = Shared(RESULTS_KEPT)
_latest: Latest[Results] = Latest("reconstudy-results")
_reports: Shared[dict[str, Any]] = Shared(16)
_latest_report: Latest[dict[str, Any]] = Latest("reconstudy-balance")


@dataclass(frozen=True)
class Inputs:
    """What an analysis follows from, without the votes themselves.

    Parameters
    ----------
    digest : SHA-256 of all of it
    state : of the votes
    settings : fields of `AnalysisSettings`, for votes on pairs
    """

    study_id: int
    digest: str
    state: VoteState
    settings: Mapping[str, Any]
    options: StudyOptions
    with_excluded: bool


@dataclass(frozen=True)
class Prepared:
    """An analysis whose votes have been read: its results and scores are computed without a connection."""

    digest: str
    results: Callable[[], Results]
    score_rows: Callable[[], Sequence[Mapping[str, Any]]]


def results_of(database: Database, study_id: int, *, with_excluded: bool = False) -> Results:
    """Analyse the votes so far.

    Parameters
    ----------
    with_excluded : count participants whom the experimenter has excluded, too; who has withdrawn is never counted
    """
    with database.snapshot() as connection:
        prepared = prepare_results(connection, inputs_of(connection, study_id, with_excluded=with_excluded))
    return prepared.results()


def results_soon(
    database: Database, study_id: int, patience_s: float, *, with_excluded: bool = False
) -> tuple[Results | None, bool]:
    """Return the results of the votes so far and True, or the latest results known and False if they take longer.

    Parameters
    ----------
    patience_s : how long to wait; the work then goes on without the caller
    with_excluded : as in `results_of`
    """
    key = (str(database.engine.url), study_id, with_excluded)
    return _latest.get(key, lambda: results_of(database, study_id, with_excluded=with_excluded), patience_s)


def grouped_results_of(database: Database, study: Study) -> Results:
    """Analyse the votes so far, and compare groups of participants by their answers; for who may see participants."""
    with database.snapshot() as connection:
        people = counted_voters(connection, study.id)
        answers = questionnaire_records(connection, study.id)
        written = [row for row in answers if row["source"] == "written" and row["participant"] in people]
        options = parse_options(study.options)
        groups = groupings(options.questions, written)
        if not any(group.datasets for group in options.groups):  # else there is nothing that two groups have judged
            assigned = assigned_groups(connection, study.id)
            assigned = without_small_groups({label: name for label, name in assigned.items() if label in people})
            groups |= {ASSIGNED: assigned} if len(set(assigned.values())) > 1 else {}
        prepared = prepare_results(connection, inputs_of(connection, study.id, groups=groups))
    return prepared.results()


def rows_of(analysis: Mapping[str, Any], table: str) -> Sequence[Mapping[str, Any]]:
    """Return the rows of an analysis that a table of analysts shows; none where the protocol has no such table."""
    name = "raters" if table == "observers" and "raters" in analysis else TABLE_NAMES.get(table, table)
    rows: Sequence[Mapping[str, Any]] = analysis.get(name, ())
    if name == "observers":
        return [{column: value for column, value in row.items() if column != "careless"} for row in rows]
    return rows


def no_analysis(state: VoteState) -> Mapping[str, Any]:
    """Return the content of analysis.json while there are no votes, or no rating that counts."""
    from app.analysis.ratings.content import NO_VOTES
    from app.analysis.warnings import NOTHING_LEFT

    return NO_VOTES | {"warnings": [NOTHING_LEFT if state.n_votes else "there are no votes yet"], "settings": {}}


def analysis_of(database: Database, study_id: int) -> Mapping[str, Any] | None:
    """Return the content of analysis.json for the votes so far; None while there are none."""
    return results_of(database, study_id).analysis


def inputs_of(
    connection: Transaction,
    study_id: int,
    *,
    with_excluded: bool = False,
    groups: Mapping[str, Mapping[str, str]] | None = None,
) -> Inputs:
    """Return what an analysis of the votes so far follows from.

    Parameters
    ----------
    with_excluded : as in `results_of`
    groups : question -> participant -> group, to compare groups by
    """
    study = study_by_id(connection, study_id)
    assert study is not None, "its caller has just found it"
    options = parse_options(study.options)
    state = vote_state(connection, study_id)
    measured = measurement_records(connection, study_id)
    more_expected = 0 if study.state == "closed" else options.limits.finished
    settings: dict[str, Any] = {
        "factors": items_factors(conditions_of(connection, study_id)),
        "measures": by_measure(measured),
        "better": better_by_measure(measured),
        "groups": groups or {},
        "random_effects": options.random_effects,
        "lapses": options.lapses,
        "adaptive_pairs": options.adaptive_pairs > 0,
        "planned_participants": options.planned_participants or more_expected or None,
    }
    counted = asdict(state) | ({"excluded": {}} if with_excluded else {})
    known = json.dumps([study_id, counted, settings, options.protocol, options.scale], sort_keys=True, default=str)
    digest = hashlib.sha256(known.encode()).hexdigest()
    return Inputs(study_id, digest, state, settings, options, with_excluded)


def prepare_results(connection: Transaction, inputs: Inputs) -> Prepared:
    """Read the votes of an analysis, in the transaction of its inputs, unless it is known or being made."""
    if (begun := _results.begun(inputs.digest)) is not None:
        return Prepared(inputs.digest, begun.result, lambda: _score_rows(begun.result()))
    read = read_votes_table(connection, inputs.study_id, inputs.state, with_excluded=inputs.with_excluded)
    if read is None:
        return Prepared(inputs.digest, _kept(inputs, lambda: None), list)
    votes, rating = read
    if inputs.options.protocol != PC:
        rated = _kept(inputs, lambda: _analysed_ratings(votes, rating, inputs))
        return Prepared(inputs.digest, rated, lambda: _score_rows(rated()))
    return Prepared(inputs.digest, _kept(inputs, lambda: _analysed(votes, inputs)), lambda: _scored(votes, inputs))


def _kept(inputs: Inputs, analyse: Callable[[], Mapping[str, Any] | None]) -> Callable[[], Results]:
    return lambda: _results.get(inputs.digest, lambda: Results(inputs.digest, analyse()))


def _score_rows(results: Results) -> Sequence[Mapping[str, Any]]:
    return rows_of(results.analysis or {}, "scores")


def _analysed(votes: VotesTable, inputs: Inputs) -> Mapping[str, Any]:
    from app.analysis import AnalysisSettings, analyse

    return analyse(votes, AnalysisSettings(**inputs.settings))


def _scored(votes: VotesTable, inputs: Inputs) -> Sequence[Mapping[str, Any]]:
    """Fit the scores alone, which takes a tenth of an analysis; those of a known analysis are the same."""
    from app.analysis import AnalysisSettings
    from app.analysis.analyse import scored

    return scored(votes, AnalysisSettings(**inputs.settings))


def _analysed_ratings(votes: VotesTable, rating: NDArray[np.float64], inputs: Inputs) -> Mapping[str, Any] | None:
    """Analyse ratings as the study's protocol asks; None where none counts.

    Parameters
    ----------
    votes : all of the study
    rating : float64 (N,), one for each vote
    inputs : settings of the analysis, and the study's options; of ratings only the measures are used
    """
    from app.analysis import AnalysisSettings
    from app.analysis.ratings.analyse_ratings import analyse_ratings
    from app.analysis.ratings.comparisons import analyse_comparisons
    from app.analysis.ratings.content import NO_VOTES, with_measures, with_tables
    from app.analysis.ratings.score_sets import opinion_score_sets
    from app.analysis.ratings.study_votes import comparison_table, counted_ratings, rating_table, with_films

    options = inputs.options
    counted, ratings = counted_ratings(votes, rating)
    if options.protocol in RATED and options.grades:
        if not len(counted):
            return None
        reference = options.reference if options.protocol in WITH_REFERENCE else ""
        scale = (options.grades.low, options.grades.high)
        table = rating_table(counted, ratings, options.protocol, scale, reference)
        planned = inputs.settings["planned_participants"]
        settings = {"protocol": options.protocol, "scale": options.scale, "planned_participants": planned}
        tables = analyse_ratings(table)
        tables["raters"] = with_films(tables["raters"], counted)
        rated = with_tables(NO_VOTES | {"settings": settings}, tables)
        chosen = AnalysisSettings(measures=inputs.settings["measures"], better=inputs.settings["better"])
        return with_measures(rated, opinion_score_sets(table), chosen)
    analysis = _analysed(votes, inputs)
    if options.protocol == CCR and len(counted):
        return with_tables(analysis, analyse_comparisons(comparison_table(counted, ratings)))
    return analysis


def load_analysis() -> None:
    """Import what scores and figures need, before somebody waits a second for them."""
    import app.analysis.report.write  # noqa: F401


def items_factors(levels: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, str]]:
    """Return factor -> item -> level; an item without a level of a factor is missing there."""
    factors = dict.fromkeys(factor for item_levels in levels.values() for factor in item_levels)
    return {
        factor: {item: item_levels[factor] for item, item_levels in levels.items() if factor in item_levels}
        for factor in factors
    }


def figures_of(results: Results) -> list[tuple[str, str]]:
    """Return name and caption of every figure that has anything to show."""
    return [(name, caption) for name, (caption, _) in results.charts.items()]


def code_of(results: Results, name: str) -> Mapping[str, str]:
    """Return the code that draws a figure anew from the analysis, by its language."""
    from app.analysis.drawing.figure_code import figure_code

    return figure_code(name, results.analysis) if results.analysis is not None else {}


def figure(results: Results, name: str, kind: str) -> bytes | None:
    """Write a figure as a file; None if there is no such figure.

    Parameters
    ----------
    kind : a key of FIGURE_TYPES, or `vega` for a specification
    """
    from app.analysis.drawing.charts_in_common import chart_svg, chart_vega, svg_pdf, svg_png
    from app.analysis.drawing.figure_code import figure_rows

    _, chart = results.charts.get(name, ("", None))
    if chart is None or results.analysis is None:
        return None
    if kind == "csv":
        rows = figure_rows(name, results.analysis)
        return csv_text(rows, with_others((), rows)).encode()
    if kind == "vega":
        return chart_vega(chart).encode()
    svg = chart_svg(chart)
    return svg.encode() if kind == "svg" else svg_png(svg) if kind == "png" else svg_pdf(svg)


def balance_soon(
    database: Database, study: Study, now: datetime, patience_s: float = PATIENCE_S
) -> tuple[dict[str, Any] | None, bool]:
    """Return the balance of a study's orders and True, or the latest that is known and False if it takes longer."""
    key = (str(database.engine.url), study.id)
    return _latest_report.get(key, partial(_checked_orders, database, study, now), patience_s)


def _checked_orders(database: Database, study: Study, now: datetime) -> dict[str, Any]:
    """Check the balance of a study's orders, once for the same participants in the same stages."""
    with database.reading() as connection:
        people = session_state(connection, study.id), sorted(vote_state(connection, study.id).excluded)
    known = json.dumps([str(database.engine.url), study.id, study.revision, people, now.date(), now.hour], default=str)

    def check() -> dict[str, Any]:
        with database.reading() as connection:
            return balance_report(study_plan(connection, study), taken_orders(connection, study, now))

    return _reports.get(known, check)
