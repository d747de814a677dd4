"""What every evaluation leaves behind: report.json, CSV tables, figures, and one HTML file that needs nothing else."""

from __future__ import annotations

import base64
import csv
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recon.storage.files import whole_file, write_json

FONT = "Liberation Sans, Arial, sans-serif"
# Okabe and Ito (2008), "Color universal design"; black first, yellow left out (too pale on white).
PALETTE = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
STYLE = (
    f"body{{font:15px/1.5 {FONT};max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}}"
    "table{border-collapse:collapse;margin:1rem 0;font-variant-numeric:tabular-nums}"
    "th,td{padding:.2rem .7rem;text-align:right;border-bottom:1px solid #ddd}th{border-bottom:2px solid #222}"
    "td:first-child,th:first-child,td.words,th.words{text-align:left}figure{margin:1.5rem 0}figcaption{color:#555}"
    "img,svg{max-width:100%;height:auto}h1,h2{line-height:1.2}h2{margin-top:2.2rem}a{color:#0072B2}"
)


@dataclass(frozen=True)
class Section:
    """A part of the report: sentences, then a table, then figures.

    Parameters
    ----------
    title, text : of the section
    rows : of the table; their keys are the columns
    figures : (caption, SVG text or PNG bytes)
    """

    title: str
    text: str = ""
    rows: Sequence[Mapping[str, Any]] = ()
    figures: Sequence[tuple[str, str | bytes]] = ()


def write_page(path: Path, title: str, sections: Sequence[Section]) -> Path:
    """Write a self-contained HTML page."""
    body = "\n".join(map(_section_html, sections))
    page = (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{STYLE}</style></head>\n<body><main><h1>{html.escape(title)}</h1>\n{body}\n</main></body></html>\n"
    )
    return _write(path, page.encode("utf-8"))


def write_table(path: Path, rows: Sequence[Mapping[str, Any]]) -> Path:
    """Write rows as CSV; columns are the keys of all rows, in the order in which they first appear."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: "; ".join(map(str, v)) if isinstance(v, list) else v for key, v in row.items()})
    return _write(path, text.getvalue().encode("utf-8"))


def write_report_json(folder: Path, report: Mapping[str, Any]) -> Path:
    """Write report.json into the report's folder."""
    write_json(folder / "report.json", report)
    return folder / "report.json"


def write_figure(stem: Path, chart: Any) -> str:
    """Write a chart as SVG, PNG and PDF beside each other, and return the SVG's text."""
    import vl_convert

    spec = chart.configure(font=FONT).configure_view(stroke=None).to_dict()
    svg = str(vl_convert.vegalite_to_svg(spec))
    _write(stem.with_suffix(".svg"), svg.encode("utf-8"))
    _write(stem.with_suffix(".png"), bytes(vl_convert.vegalite_to_png(spec, scale=2.0)))
    _write(stem.with_suffix(".pdf"), bytes(vl_convert.vegalite_to_pdf(spec)))
    return svg


def curve_chart(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Share of inliers against the threshold, one line per sensor (figure 6 of the paper)."""
    import altair as alt

    base = alt.Chart(alt.Data(values=[dict(row) for row in rows]))
    x = alt.X("threshold_mm:Q", title="threshold, ± mm")
    colour_of_band = alt.Color("sensor:N", legend=None, scale=alt.Scale(range=list(PALETTE)), sort=None)
    colour = alt.Color("sensor:N", title=None, scale=alt.Scale(range=list(PALETTE)), sort=None)
    band = base.mark_area(opacity=0.15).encode(x=x, y="ci_low:Q", y2="ci_high:Q", color=colour_of_band)
    y = alt.Y("inliers:Q", title="inliers", scale=alt.Scale(zero=False), axis=alt.Axis(format="%"))
    line = base.mark_line().encode(x=x, y=y, color=colour, strokeDash=alt.StrokeDash("sensor:N", sort=None, title=None))
    own = (band + line).resolve_scale(color="independent", strokeDash="independent")  # or the bands hide the legend
    return own.properties(width=460, height=280)


def curve_columns(table: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows of inlier ratios in the words and percents of a report."""
    return [
        {
            "sensor": row["sensor"],
            "subset": row["subset"],
            "samples": row["n_samples"],
            "inliers %": percent(row["inliers"]),
            "outliers %": percent(row["outliers"]),
            "from %": percent(row["ci_low"]),
            "to %": percent(row["ci_high"]),
        }
        for row in table
    ]


def percent(share: float | None) -> str:
    """A share as percents; a dash where there is none."""
    return "–" if share is None else f"{100 * share:.2f}"


def write_bytes(path: Path, content: bytes) -> Path:
    """Write a file, whole or not at all."""
    return _write(path, content)


def _write(path: Path, content: bytes) -> Path:
    with whole_file(path) as temporary:
        temporary.write_bytes(content)
    return path


def _section_html(section: Section) -> str:
    parts = [f"<h2>{html.escape(section.title)}</h2>"]
    parts += [f"<p>{html.escape(section.text)}</p>"] if section.text else []
    parts += [_table_html(section.rows)] if section.rows else []
    parts += [_figure_html(caption, figure) for caption, figure in section.figures]
    return "\n".join(parts)


def _table_html(rows: Sequence[Mapping[str, Any]]) -> str:
    columns = list(dict.fromkeys(key for row in rows for key in row))
    words = {c: ' class="words"' for c in columns if any(_is_words(row.get(c)) for row in rows)}
    head = "".join(
        f'<th scope="col"{words.get(column, "")}>{html.escape(column.removeprefix("n_").replace("_", " "))}</th>'
        for column in columns
    )
    lines = [
        "".join(f"<td{words.get(column, '')}>{html.escape(_cell(row.get(column)))}</td>" for column in columns)
        for row in rows
    ]
    return (
        f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(f'<tr>{line}</tr>' for line in lines)}</tbody></table>"
    )


def _is_words(value: Any) -> bool:
    return isinstance(value, list) or (isinstance(value, str) and any(letter.isalpha() for letter in value))


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, int):
        return f"{value:_}".replace("_", "\u202f")
    return "; ".join(map(str, value)) if isinstance(value, list) else str(value)


def _figure_html(caption: str, figure: str | bytes) -> str:
    if isinstance(figure, str):
        image = figure[figure.index("<svg") :]
    else:
        coded = base64.b64encode(figure).decode("ascii")
        image = f'<img alt="{html.escape(caption)}" src="data:image/png;base64,{coded}">'
    return f"<figure>{image}<figcaption>{html.escape(caption)}</figcaption></figure>"
