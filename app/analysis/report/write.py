"""Write an analysis to files: tables for programs, figures for a paper, and a report to read."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from app.analysis.drawing.charts_in_common import FULL, svg_pdf, svg_png
from app.analysis.reading.votes_table import VotesError
from app.analysis.report.figures import drawn_figures
from app.analysis.report.page import PAGES, report_page
from app.files import without_formula, write_bytes, write_text

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
    "island_scores": ("comparison", "dataset", "group", "item", "score", "se", "se_participant", "ci_low", "ci_high"),
    "island_contrasts": ("comparison", "dataset", "group", "item_a", "item_b", "difference", "se", "p_value", "p_holm"),
    "effects": ("factor", "level", "dataset", "effect", "se", "se_participant", "ci_low", "ci_high", "letters"),
    "tests": ("name", "model", "dataset", "g2", "df", "p_value", "p_participant", "p_holm"),
    "random_effects": ("level", "sd", "sd_low", "sd_high"),
    "random_effects_scores": ("item", "score", "se", "ci_low", "ci_high"),
    "random_effects_contrasts": ("item_a", "item_b", "difference", "se", "p_value", "p_holm"),
    "lapse_scores": ("item", "score", "se", "ci_low", "ci_high"),
    "lapse_rates": ("participant", "lapse_rate"),
    "models": ("comparison", "dataset", "ties", "status", "n_votes", "n_participants"),
    "agreement": ("dataset", "u", "chi2", "df", "p_value"),
    "pairs": ("comparison", "dataset", "item_a", "item_b", "a", "b", "none"),
    "measures": ("measure", "dataset"),
    "measure_comparisons": ("measure_a", "measure_b"),
    "rates": ("dataset", "item", "method", "level", "bytes", "score", "ci_low", "ci_high", "is_on_front"),
    "rate_differences": ("dataset", "method_a", "method_b", "difference", "ci_low", "ci_high"),
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
FIGURES = (".svg", ".png", ".pdf")


def write_analysis(analysis: Mapping[str, Any], out: Path | str, *, source: str = "votes", width: int = FULL) -> None:
    """Write analysis.json, the tables, the figures (SVG, PNG, PDF) and the report (HTML, Markdown).

    Every file is complete or absent. analysis.json is written last, so its presence means that the folder is
    complete. Where it is there already, the tables and figures of that earlier analysis are removed first.

    Parameters
    ----------
    analysis : the content of analysis.json
    out : the folder
    source : name of what was analysed, for the report's title
    width : of the figures, in pixels; `WIDTHS` has those of a journal's columns
    """
    out = Path(out)
    whole = out / "analysis.json"
    if whole.exists():
        for earlier in _written_before(out):
            earlier.unlink(missing_ok=True)
        whole.unlink()
    for name in COLUMNS:
        if analysis.get(name) or (analysis["votes"] and name in ALWAYS_THERE):
            write_text(out / f"{name}.csv", table_csv(analysis[name], COLUMNS[name]))
    for path, content in report_files(analysis, source=source, width=width):
        write_bytes(out / path, content)
    write_text(whole, _json_by_row(analysis))


def _written_before(out: Path) -> set[Path]:
    """Find the tables and figures of an analysis: a figure lies there in all three formats, other pictures do not."""
    drawn = [[svg.with_suffix(kind) for kind in FIGURES] for svg in (out / "figures").glob("*.svg")]
    figures = {path for files in drawn if all(path.exists() for path in files) for path in files}
    return figures | {out / f"{name}.csv" for name in COLUMNS}


def refuse_to_replace(inputs: Sequence[Path | str | None], out: Path | str) -> None:
    """Raise if a table of the results would take the place of a file that they follow from."""
    tables = {(Path(out) / f"{name}.csv").resolve() for name in COLUMNS}
    for path in inputs:
        if path is not None and Path(path).resolve() in tables:
            raise VotesError(f"{path}: a table of the results would replace it; choose another folder for them")


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
    if isinstance(value, dict):
        value = json.dumps(value)
    return without_formula(value) if isinstance(value, str) else value
