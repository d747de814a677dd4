"""A study's votes through the analysis, which is loaded when it is first needed and done once for the same votes."""

from __future__ import annotations

import gc
import hashlib
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from app.intake.reports import by_measure
from app.store.designs import conditions_of
from app.store.engine import Database, Transaction
from app.store.measurements import measurement_records
from app.store.participants import participants_votes, questionnaire_records
from app.store.studies import Study
from app.store.vote_records import vote_records
from app.study.groupings import groupings
from app.study.options import parse_options
from app.web.once import Shared

ANALYSES_KEPT = 16  # their results, of the latest votes and settings; a study of 100 participants takes some MB
CHARTS_KEPT = 4
WITHDRAWN = "withdrawn"
FIGURE_TYPES = {"svg": "image/svg+xml", "png": "image/png", "pdf": "application/pdf", "csv": "text/csv; charset=utf-8"}

_analyses: Shared[Mapping[str, Any]] = Shared(ANALYSES_KEPT)
_snapshots: Shared[Snapshot] = Shared(ANALYSES_KEPT)

VotesOf = Sequence[Mapping[str, Any]]  # as `participants_votes` has them


@dataclass(frozen=True)
class Snapshot:
    """What the votes so far say; the digest is of the votes and of how they were analysed."""

    digest: str
    analysis: Mapping[str, Any] | None = field(compare=False)


def snapshot_of(database: Database, study_id: int, *, with_excluded: bool = False) -> Snapshot:
    """The analysis of the votes so far, None while there are none.

    Parameters
    ----------
    with_excluded : count those whom the experimenter has excluded, too; who has withdrawn is never counted
    """
    return _latest(database, study_id, lambda *_: {}, with_excluded=with_excluded)


def grouped_snapshot_of(database: Database, study: Study) -> Snapshot:
    """As `snapshot_of`, with groups of participants compared by their answers; for who may see participants."""

    def groups(connection: Transaction, votes: VotesOf) -> dict[str, Any]:
        counts = (row for row in votes if row["n_votes"] and row["reason"] is None and row["withdrawn_at"] is None)
        people = {row["participant"] for row in counts}
        answers = questionnaire_records(connection, study.id)
        counted = [row for row in answers if row["source"] == "written" and row["participant"] in people]
        return {"groups": groupings(parse_options(study.options).questions, counted)}

    return _latest(database, study.id, groups)


def analysis_of(database: Database, study_id: int) -> Mapping[str, Any] | None:
    """The content of analysis.json for the votes so far; None while there are none."""
    return snapshot_of(database, study_id).analysis


def load_analysis() -> None:
    """Import what scores and figures need, before somebody waits a second for them."""
    if "app.analysis.report" in sys.modules:
        return
    import app.analysis.report  # noqa: F401

    gc.freeze()  # as app/main.py does with what was loaded before: looking through it would hold up votes for 55 ms


def given_of(connection: Transaction, study_id: int) -> dict[str, Any]:
    """What an analysis is made of."""
    return {"rows": list(vote_records(connection, study_id)), **_beside_votes(connection, study_id)}


def _beside_votes(connection: Transaction, study_id: int) -> dict[str, Any]:
    levels = conditions_of(connection, study_id)
    measures = by_measure(measurement_records(connection, study_id))
    return {"factors": items_factors(levels), "measures": measures}


def _latest(
    database: Database,
    study_id: int,
    more: Callable[[Transaction, VotesOf], Mapping[str, Any]],
    *,
    with_excluded: bool = False,
) -> Snapshot:
    """The snapshot of the votes so far, which are read only if something has changed: 60 000 take seconds.

    A participant's votes are added to, or all erased, and never altered: how many there are, and when the vote on the
    last trial came, says which.

    Parameters
    ----------
    more : what an analysis follows from besides
    """
    with database.snapshot() as connection:
        votes = participants_votes(connection, study_id)
        given = {**_beside_votes(connection, study_id), **more(connection, votes)}
        key = _digest(votes, json.dumps([with_excluded, given], sort_keys=True))
        if (begun := _snapshots.begun(key)) is None:
            given["rows"] = list(vote_records(connection, study_id))
    if begun is not None:
        return begun.result()
    if with_excluded:
        given["rows"] = [row | {"excluded": row["reason"] == WITHDRAWN} for row in given["rows"]]
    return _snapshots.get(key, lambda: snapshot_of_given(given))


def snapshot_of_given(given: Mapping[str, Any]) -> Snapshot:
    """The analysis of what `given_of` has read; no connection is needed any more."""
    rows = given["rows"]
    others = json.dumps({name: value for name, value in given.items() if name != "rows"}, sort_keys=True)
    digest = _digest(rows, others)
    return Snapshot(digest, _analyses.get(digest, lambda: _analysed(rows, json.loads(others))) if rows else None)


def _digest(rows: Iterable[Mapping[str, Any]], others: str) -> str:
    """Of all that an analysis follows from; a vote at a time, because a million as one text take hundreds of MB."""
    digest = hashlib.sha256(others.encode())
    for row in rows:
        digest.update(json.dumps(row, sort_keys=True, default=str).encode())
    return digest.hexdigest()


def _analysed(rows: Sequence[Mapping[str, Any]], others: Mapping[str, Any]) -> Mapping[str, Any]:
    from app.analysis import AnalysisSettings, analyse, votes_from_rows

    settings = AnalysisSettings(factors=others["factors"], measures=others["measures"], groups=others.get("groups", {}))
    return analyse(votes_from_rows(rows), settings)


def items_factors(levels: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, str]]:
    """Levels by item for each factor that every item has a level of."""
    factors = dict.fromkeys(factor for own in levels.values() for factor in own)
    return {
        factor: {item: own[factor] for item, own in levels.items()}
        for factor in factors
        if all(factor in own for own in levels.values())
    }


def figures_of(snapshot: Snapshot) -> list[tuple[str, str]]:
    """Name and caption of every figure that there is something in."""
    return [(name, caption) for name, (caption, _) in _charts(snapshot).items()]


@lru_cache(maxsize=CHARTS_KEPT)
def _charts(snapshot: Snapshot) -> dict[str, tuple[str, Any]]:
    """Caption and chart of every figure, by name; a page asks for them once to list, then once for each it shows."""
    from app.analysis.report import named_charts

    charts = named_charts(snapshot.analysis) if snapshot.analysis is not None else ()
    return {name: (caption, chart) for name, caption, chart in charts if chart is not None}


def figure(snapshot: Snapshot, name: str, kind: str) -> bytes | None:
    """A figure as a file of a kind in FIGURE_TYPES, or `vega` for a specification; None if there is no such figure."""
    from app.analysis.charts import chart_pdf, chart_png, chart_svg, chart_vega

    _, chart = _charts(snapshot).get(name, ("", None))
    if chart is None or snapshot.analysis is None:
        return None
    if kind == "csv":
        return _figure_csv(snapshot.analysis, name).encode()
    if kind == "vega":
        return chart_vega(chart).encode()
    return chart_svg(chart).encode() if kind == "svg" else chart_png(chart) if kind == "png" else chart_pdf(chart)


def _figure_csv(analysis: Mapping[str, Any], name: str) -> str:
    from app.web.analyst.formats import csv_text

    rows = _figure_rows(analysis, name)
    return csv_text(rows, list(dict.fromkeys(key for row in rows for key in row)))


def _figure_rows(analysis: Mapping[str, Any], name: str) -> Sequence[Mapping[str, Any]]:
    """The numbers behind a figure."""
    kind, _, which = name.partition("_")
    if kind == "scores":
        comparisons = {row["comparison"] for row in analysis["scores"]}
        wanted = next((one for one in comparisons if _is_called(one, which)), "all") if which else "all"
        return [row for row in analysis["scores"] if row["comparison"] == wanted]
    if kind in ("preferences", "residuals"):
        return [row for row in analysis["pairs"] if row["comparison"] == "all"]
    if kind == "triads":
        return list(analysis["triads"])
    if kind == "response":
        return list(analysis["observers"])
    return [row for row in analysis["measures" if kind == "measure" else "groups"] if _is_of(row, which)]


def _is_of(row: Mapping[str, Any], which: str) -> bool:
    return _is_called(str(row.get("measure", row.get("grouping", ""))), which)


def _is_called(name: str, file_name: str) -> bool:
    return "".join(character if character.isalnum() else "_" for character in name) == file_name
