"""Files that every evaluation writes: report.json, CSV tables, figures, and one HTML page that needs no other file."""

from __future__ import annotations

import csv
import io
import math
import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from recon.storage.files import read_json, write_bytes, write_json
from recon.validation.measures import Measured, measured_rows

REPORT = "report.json"
MOST_DECIMALS = 6  # in tables; with more, numbers have an exponent
FONT = "Liberation Sans, Arial, sans-serif"
# Okabe and Ito (2008), "Color universal design"; black first, yellow left out (too pale on white).
PALETTE = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")


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


@dataclass(frozen=True)
class Column:
    """A column of a report's table.

    Parameters
    ----------
    heading : its title
    is_words : whether the cells are words, which stand on the left, or numbers, which stand on the right
    cells : a text for each row
    """

    heading: str
    is_words: bool
    cells: Sequence[str]


def write_page(path: Path, title: str, sections: Sequence[Section]) -> Path:
    """Write a self-contained HTML page, and list all files of the report it belongs to in report.json, as `files`.

    Parameters
    ----------
    path : of the page; that of a report is written last
    title : of the page
    sections : in their order
    """
    environment = Environment(
        loader=PackageLoader("recon.validation", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(columns=_columns, base64=_base64)
    page = environment.get_template("report.html").render(
        title=title, sections=sections, font=FONT, program=f"reconstudy {version('reconstudy')}"
    )
    write_bytes(path, page.encode("utf-8"))
    _list_files(path.parent)
    return path


def _list_files(folder: Path) -> None:
    """List what was written since report.json, which is written first."""
    report = folder / REPORT
    if report.is_file():
        begun = report.stat().st_mtime_ns
        files = [path.name for path in folder.iterdir() if path.is_file() and path.stat().st_mtime_ns >= begun]
        write_json(report, read_json(report) | {"files": sorted(files)})


def _remove_earlier(folder: Path) -> None:
    """Remove the files of an earlier report, which would be taken for this one's."""
    try:
        listed = read_json(folder / REPORT).get("files")
    except ValueError:  # there is none, or none of ours
        return
    for path in list(folder.iterdir()):
        if isinstance(listed, list) and path.name in listed and path.is_file():
            path.unlink()


def write_table(path: Path, rows: Sequence[Mapping[str, Any]], columns: Sequence[str] = ()) -> Path:
    """Write rows as CSV.

    Parameters
    ----------
    path : of the file
    rows : cells by column
    columns : their order; else the keys of all rows, in the order in which they first appear
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, columns or _keys(rows), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: "; ".join(map(str, v)) if isinstance(v, list) else v for key, v in row.items()})
    return write_bytes(path, text.getvalue().encode("utf-8"))


def write_numbers(
    folder: Path,
    report: Mapping[str, Any],
    tables: Mapping[str, Sequence[Mapping[str, Any]]],
    values: Sequence[Measured] | None = None,
) -> None:
    """Write report.json, the tables as NAME.csv, and measures.csv, with all its columns even if there is no value.

    An earlier report in the folder is removed.

    Parameters
    ----------
    folder : of the report
    report : content of report.json
    tables : rows of each table by its name
    values : of measures.csv; None for the report's measures
    """
    if values is None:
        values = measured_rows(report["measures"], f"validate {report['kind']}")
    _remove_earlier(folder)
    write_json(folder / REPORT, report)
    for name, rows in tables.items():
        write_table(folder / f"{name}.csv", rows)
    write_table(
        folder / "measures.csv", [asdict(value) for value in values], [field.name for field in fields(Measured)]
    )


def write_figure(stem: Path, chart: Any) -> str:
    """Write a chart as SVG, PNG and PDF beside each other, and return the SVG's text."""
    import vl_convert

    spec = chart.configure(font=FONT).configure_axis(labelFlush=False).configure_view(stroke=None).to_dict()
    svg = str(vl_convert.vegalite_to_svg(spec))
    write_bytes(stem.with_name(f"{stem.name}.svg"), svg.encode("utf-8"))
    write_bytes(stem.with_name(f"{stem.name}.png"), bytes(vl_convert.vegalite_to_png(spec, scale=2.0)))
    write_bytes(stem.with_name(f"{stem.name}.pdf"), bytes(vl_convert.vegalite_to_pdf(spec)))
    return svg


def curve_chart(rows: Sequence[Mapping[str, Any]]) -> Any:
    """Draw the share of inliers against the threshold, a line per sensor (figure 6 of the paper)."""
    import altair as alt

    base = alt.Chart(alt.Data(values=[dict(row) for row in rows]))
    x = alt.X("threshold_mm:Q", title="threshold, ± mm")
    colour_of_band = alt.Color("sensor:N", legend=None, scale=alt.Scale(range=list(PALETTE)), sort=None)
    colour = alt.Color("sensor:N", title=None, scale=alt.Scale(range=list(PALETTE)), sort=None)
    band = base.mark_area(opacity=0.15).encode(x=x, y="ci_low:Q", y2="ci_high:Q", color=colour_of_band)
    y = alt.Y("inliers:Q", title="inliers", scale=alt.Scale(zero=False), axis=alt.Axis(format="%"))
    line = base.mark_line().encode(x=x, y=y, color=colour, strokeDash=alt.StrokeDash("sensor:N", sort=None, title=None))
    chart = (band + line).resolve_scale(color="independent", strokeDash="independent")  # or the bands hide the legend
    return chart.properties(width=460, height=280)


def curve_columns(table: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Name and round rows of inlier ratios for the page."""
    return [
        {
            "sensor": row["sensor"],
            "subset": row["subset"],
            "samples": row["n_samples"],
            "inliers %": percent(row["inliers"]),
            "outliers %": percent(row["outliers"]),
            "95 % from": percent(row["ci_low"]),
            "95 % to": percent(row["ci_high"]),
        }
        for row in table
    ]


def percent(share: float | None) -> str:
    """Format a share as per cents; a dash where there is none."""
    return "–" if share is None else f"{100 * share:.2f}"


def plain_name(name: str) -> str:
    """Return a name as a part of a file's name: what is no letter, digit, dot or hyphen becomes an underscore."""
    return re.sub(r"[^A-Za-z0-9.-]", "_", name)


def _columns(rows: Sequence[Mapping[str, Any]]) -> list[Column]:
    return [_column(key, [row.get(key) for row in rows]) for key in _keys(rows)]


def _column(key: str, values: Sequence[Any]) -> Column:
    decimals = _decimals([value for value in values if isinstance(value, float)])
    cells = [_cell(value, decimals) for value in values]
    return Column(key.removeprefix("n_").replace("_", " "), any(map(_is_words, values)), cells)


def _decimals(values: Sequence[float]) -> int | None:
    """Return the decimals of a column's numbers: four digits for the largest, two for the smallest, no needless zeros.

    None where that would take more than six, so that each number is better written by itself.
    """
    sizes = [abs(value) for value in values if math.isfinite(value) and value]
    if not sizes:
        return None
    decimals = max(3 - math.floor(math.log10(max(sizes))), 1 - math.floor(math.log10(min(sizes))), 0)
    if decimals > MOST_DECIMALS:
        return None
    while decimals and all(round(size, decimals - 1) == round(size, decimals) for size in sizes):
        decimals -= 1
    return decimals


def _base64(picture: bytes) -> str:
    return b64encode(picture).decode("ascii")


def _keys(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(key for row in rows for key in row))


def _is_words(value: Any) -> bool:
    return isinstance(value, list | bool) or (isinstance(value, str) and any(letter.isalpha() for letter in value))


def _cell(value: Any, decimals: int | None) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if decimals is None else f"{value:.{decimals}f}"
    if isinstance(value, int):
        return f"{value:_}".replace("_", "\u202f")
    return "; ".join(map(str, value)) if isinstance(value, list) else str(value)
