"""Prepare attached reports, and measures beside scores, for their pages."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from app.intake.reports import EVERY_DATASET
from app.operations.studies.attach import listed
from app.web.admin.results.scores_view import MINUS, NOTHING, by_dataset, decimal, p_value, unique

SHOWN = (  # of a measure, with intervals
    *("pearson_logistic", "pearson_logistic5", "pearson", "spearman", "kendall"),
    *("pairs_correct", "auc_better_worse", "auc_different_similar"),
)
MOST_COMPARED = 10  # pairs of measures on the page
MOST_ROWS = 100  # of a table on the page; the file holds all
TITLES = {
    "sphere": "Sphere",
    "cuboid": "Cuboid",
    "object": "Known object",
    "mesh": "Against the truth",
    "views": "Sensors and views",
    "cloud": "Clouds against a reference",
    "films": "Films against a reference",
}
CAPTIONS = {
    "curve": "Share of points within each threshold",
    "scores": "Precision, recall and F-score against the threshold",
    "psnr": "PSNR of every view",
    "measures": "Every measure by condition",
    "errors": "Signed errors",
}
NUMBERS_OF = {"psnr": "views"}  # figures whose table has another name


def report_view(record: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a report for its page: its figures with the files to download, pictures and tables, from its folder."""
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    stems = {name.removesuffix(".svg") for name in names if name.endswith(".svg")}
    singles = [name for name in names if name.endswith(".png") and name.removesuffix(".png") not in stems]
    return {
        "title": TITLES.get(record["kind"], str(record["kind"]).capitalize()),
        "subject": re.sub(rf"(^|; ){EVERY_DATASET}: ", r"\1every dataset: ", str(record["subject"])),
        "digest": record["digest"],
        "figures": [_figure(stem, names) for stem in sorted(stems)],
        "pictures": [{"caption": _caption(name.removesuffix(".png")), "picture": name} for name in singles],
        "tables": [table for name in names if name.endswith(".csv") and (table := _table(folder / name))["n_rows"]],
    }


def attachment_notes(detail: Mapping[str, Any]) -> list[str]:
    """Return sentences on what an attachment left out or averaged, from its entry in the audit log."""
    ignored = [f"the study does not compare {listed(detail['ignored'])}: left out"] if detail["ignored"] else []
    return [*ignored, *detail.get("notes", ())]


def measure_lines(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Say of each measure, best first, how well it predicts the scores, and if people prefer what it calls worse."""
    from app.analysis.objective.prediction import measures_by_rank
    from app.analysis.reading.phrases import with_interval

    last = {row["measure"]: row for row in rows}
    return [
        {
            "name": name,
            "contradiction": _contradiction(last[name]),
            "better": last[name]["better"] or NOTHING,
            "points": last[name]["n"],
            "p_value": p_value(last[name]["spearman_p"]),
            "rmse": decimal(last[name]["rmse"]),
            **{key: with_interval(last[name], key, key) or NOTHING for key in SHOWN},
        }
        for name in measures_by_rank(rows)
    ]


def _contradiction(row: Mapping[str, Any]) -> str:
    """Say whether the interval of the rank correlation contradicts the measure's direction."""
    low, high = row["spearman_low"], row["spearman_high"]
    if row["better"] == "higher" and high is not None and high < 0:
        return "more should be better, but people prefer less"
    if row["better"] == "lower" and low is not None and low > 0:
        return "less should be better, but people prefer more"
    return ""


def comparison_lines(rows: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the pairs of measures whose difference is clearest, with p-values corrected for all pairs."""
    tested = sorted((row for row in rows if row["p_value"] is not None), key=lambda row: float(row["p_value"]))
    return [
        {
            "names": (row["measure_a"], row["measure_b"]),
            "correlations": (decimal(row["pearson_a"]), decimal(row["pearson_b"])),
            **{key: p_value(row[key]) for key in ("p_value", "p_holm", "auc_p", "auc_p_holm")},
        }
        for row in tested[:MOST_COMPARED]
    ]


def beside_scores(analysis: Mapping[str, Any], measurements: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return each dataset's conditions, best first, with their measures, those that predict the scores best first."""
    from app.analysis.objective.against_scores import compared_scores
    from app.analysis.objective.prediction import measures_by_rank

    values = {(row["dataset"], row["approach"], row["measure"]): row["value"] for row in measurements}
    units = {row["measure"]: row["unit"] for row in measurements}
    names = unique([*measures_by_rank(analysis["measures"]), *units])
    scores = by_dataset(compared_scores(analysis))
    shown = []
    for dataset in unique(row["dataset"] for row in measurements):
        measured = [measure for measure in names if any(key[0] == dataset and key[2] == measure for key in values)]
        heads = [f"{measure}, {units[measure]}" if units[measure] else measure for measure in measured]
        rows = [
            (
                row["item"],
                decimal(row["score"]),
                *(readable(values.get((dataset, row["item"], name))) for name in measured),
            )
            for row in scores.get(dataset, ())
        ]
        shown.append({"dataset": dataset, "measures": heads, "rows": rows})
    return shown


def _figure(stem: str, names: Sequence[str]) -> dict[str, Any]:
    files = {kind: f"{stem}.{kind}" for kind in ("svg", "png", "pdf") if f"{stem}.{kind}" in names}
    if (numbers := f"{NUMBERS_OF.get(stem, stem)}.csv") in names:
        files["csv"] = numbers
    return {"caption": _caption(stem), "picture": f"{stem}.svg", "files": files}


def _caption(stem: str) -> str:
    return CAPTIONS.get(stem, stem.replace("_", " ").capitalize())


def _table(path: Path) -> dict[str, Any]:
    """Return a table with its first rows."""
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(file)
        columns = [name.replace("_", " ") for name in next(reader, [])]
        rows = [[_cell(cell) for cell in row] for row in islice(reader, MOST_ROWS)]
        n_rows = len(rows) + sum(1 for _ in reader)
    return {"name": _caption(path.stem), "file": path.name, "columns": columns, "rows": rows, "n_rows": n_rows}


def _cell(text: str) -> str:
    """Return a number with readable digits; other text unchanged."""
    try:
        return readable(float(text)) if text and not text.lstrip("-").isdigit() else text or NOTHING
    except ValueError:
        return text


def readable(value: float | None) -> str:
    """Format a measure's value with four digits, or all of whole large ones; None as a dash."""
    if value is None:
        return NOTHING
    return (f"{value:,.0f}".replace(",", "\u202f") if abs(value) >= 1e4 else f"{value:.4g}").replace("-", MINUS)
