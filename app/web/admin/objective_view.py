"""Prepare attached reports, and measures beside scores, for their pages."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from app.intake.reports import EVERY_DATASET
from app.web.admin.results_view import NOTHING, decimal, unique

MOST_ROWS = 100  # of a table on the page; the file holds all
TITLES = {
    "sphere": "Sphere",
    "cuboid": "Cuboid",
    "object": "Known object",
    "mesh": "Against the truth",
    "views": "Sensors and views",
}
CAPTIONS = {
    "curve": "Share of points within each threshold",
    "scores": "Precision, recall and F-score against the threshold",
    "psnr": "PSNR of every view",
    "errors": "Signed errors",
}
NUMBERS_OF = {"psnr": "views"}  # figures whose table has another name


@dataclass(frozen=True)
class FigureView:
    """A figure of a report: its picture, and every file to download it as."""

    caption: str
    picture: str
    files: Mapping[str, str]  # kind -> file name


@dataclass(frozen=True)
class TableView:
    """The first rows of a report's table."""

    name: str
    file: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    n_rows: int


@dataclass(frozen=True)
class ReportView:
    title: str
    subject: str
    digest: str
    figures: Sequence[FigureView]
    pictures: Sequence[FigureView]
    tables: Sequence[TableView]


@dataclass(frozen=True)
class MeasureLine:
    """How well an attached measure predicts the scores; `contradiction`: people prefer what it calls worse."""

    name: str
    contradiction: str
    points: int
    spearman: str
    pearson: str
    in_order: str


@dataclass(frozen=True)
class BesideScores:
    """The conditions of a dataset by falling score, with their measures."""

    dataset: str
    measures: Sequence[str]
    rows: Sequence[Sequence[str]]


def report_view(record: Mapping[str, Any], folder: Path) -> ReportView:
    """Return a report for its page; its files are in the folder."""
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    stems = {name.removesuffix(".svg") for name in names if name.endswith(".svg")}
    figures = [_figure(stem, names) for stem in sorted(stems)]
    singles = [name for name in names if name.endswith(".png") and name.removesuffix(".png") not in stems]
    pictures = [FigureView(_caption(name.removesuffix(".png")), name, {"png": name}) for name in singles]
    tables = [_table(folder / name) for name in names if name.endswith(".csv")]
    title = TITLES.get(record["kind"], str(record["kind"]).capitalize())
    subject = str(record["subject"]).replace(f"{EVERY_DATASET}: ", "every dataset: ")
    return ReportView(title, subject, record["digest"], figures, pictures, tables)


def measure_lines(rows: Iterable[Mapping[str, Any]], measurements: Sequence[Mapping[str, Any]]) -> list[MeasureLine]:
    """Return a line per measure: over all datasets, or for the only one."""
    last = {row["measure"]: row for row in rows}
    directions = {row["measure"]: row["direction"] for row in measurements}
    return [
        MeasureLine(
            name,
            _contradiction(row, directions.get(name)),
            row["n"],
            *(_with_interval(row, key) for key in ("spearman", "pearson", "pairs_correct")),
        )
        for name, row in last.items()
    ]


def _contradiction(row: Mapping[str, Any], direction: str | None) -> str:
    """Say whether the interval of the rank correlation contradicts the measure's direction."""
    low, high = row.get("spearman_low"), row.get("spearman_high")
    if direction == "more is better" and high is not None and high < 0:
        return "more should be better, but people prefer less"
    if direction == "less is better" and low is not None and low > 0:
        return "less should be better, but people prefer more"
    return ""


def beside_scores(analysis: Mapping[str, Any], measurements: Sequence[Mapping[str, Any]]) -> list[BesideScores]:
    """Return each dataset's conditions, best first, with their measures."""
    values = {(row["dataset"], row["approach"], row["measure"]): row["value"] for row in measurements}
    units = {row["measure"]: row["unit"] for row in measurements}
    shown = []
    for dataset in unique(row["dataset"] for row in measurements):
        measured = [measure for measure in units if any(key[0] == dataset and key[2] == measure for key in values)]
        heads = [f"{measure}, {units[measure]}" if units[measure] else measure for measure in measured]
        rows = [
            (
                row["item"],
                decimal(row["score"]),
                *(_value(values.get((dataset, row["item"], name))) for name in measured),
            )
            for row in _by_score(analysis, dataset)
        ]
        shown.append(BesideScores(dataset, heads, rows))
    return shown


def _figure(stem: str, names: Sequence[str]) -> FigureView:
    files = {kind: f"{stem}.{kind}" for kind in ("svg", "png", "pdf") if f"{stem}.{kind}" in names}
    if (numbers := f"{NUMBERS_OF.get(stem, stem)}.csv") in names:
        files["csv"] = numbers
    return FigureView(_caption(stem), f"{stem}.svg", files)


def _caption(stem: str) -> str:
    return CAPTIONS.get(stem, stem.replace("_", " ").capitalize())


def _table(path: Path) -> TableView:
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file)
        columns = [name.replace("_", " ") for name in next(reader, [])]
        rows = [[_cell(cell) for cell in row] for row in islice(reader, MOST_ROWS)]
        return TableView(_caption(path.stem), path.name, columns, rows, len(rows) + sum(1 for _ in reader))


def _cell(text: str) -> str:
    """Return a number with readable digits; other text unchanged."""
    try:
        return _value(float(text)) if text and not text.lstrip("-").isdigit() else text or NOTHING
    except ValueError:
        return text


def _value(value: float | None) -> str:
    return NOTHING if value is None else f"{value:.4g}".replace("-", "−")


def _by_score(analysis: Mapping[str, Any], dataset: str) -> list[Mapping[str, Any]]:
    rows = [row for row in analysis["scores"] if row["comparison"] == "all" and row["dataset"] == dataset]
    return sorted(rows, key=lambda row: -(row["score"] if row["score"] is not None else float("-inf")))


def _with_interval(row: Mapping[str, Any], key: str) -> str:
    low, high = row.get(f"{key}_low"), row.get(f"{key}_high")
    interval = "" if low is None else f" ({decimal(low)} to {decimal(high)})"
    return f"{decimal(row[key])}{interval}"
