"""Files that every evaluation writes: report.json, CSV tables, figures, and one HTML page that needs no other file."""

from __future__ import annotations

import csv
import io
import math
import re
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.capture.images import write_picture
from recon.runtime.files import alone_in, check_replaceable, new_folder, read_json, write_bytes, write_json
from recon.runtime.pages import report_page
from recon.validation.measures import Measured, measured_rows

REPORT, PAGE, TABLE = "report.json", "report.html", "measures.csv"  # of every report
MADE = ".report"  # a report that is whole, but not yet in its place
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


def write_report(
    out: Path,
    title: str,
    report: Mapping[str, Any],
    tables: Mapping[str, Sequence[Mapping[str, Any]]],
    sections: Callable[[Path], Sequence[Section]],
    values: Sequence[Measured] | None = None,
) -> Path:
    """Write report.json, the tables as NAME.csv, measures.csv, figures and report.html; returns the page's path.

    They replace the files of an earlier report in the folder, and no others; if anything fails, that one stays whole.

    Parameters
    ----------
    out : folder of the report
    title : of the page
    report : content of report.json, to which `files` is added, the names of all files
    tables : rows of each table by its name
    sections : makes the page's sections, and writes their figures into the folder that it is given
    values : of measures.csv, which has all its columns even if there is none; None for the report's measures

    Raises
    ------
    ValueError
        As from `check_report_folder`, if another report is being written into the folder, or if a file of somebody
        else's has the name of one of the report's, which is left whole in the folder MADE then.
    """
    check_report_folder(out)
    if values is None:
        values = measured_rows(report["measures"], f"validate {report['kind']}")
    with alone_in(out):
        with new_folder(out / MADE, replaces=True) as folder:
            for name, rows in tables.items():
                write_table(folder / f"{name}.csv", rows)
            columns = [field.name for field in fields(Measured)]
            write_table(folder / TABLE, [asdict(value) for value in values], columns)
            write_page(folder / PAGE, title, sections(folder))
            names = sorted([REPORT, *(path.name for path in folder.iterdir())])
            write_json(folder / REPORT, {**report, "files": names})
        _replace_files(out, names)
    return out / PAGE


def _replace_files(out: Path, names: Sequence[str]) -> None:
    """Put the files of a whole report in the place of an earlier one's."""
    earlier = _listed_files(out, names)
    if others := [name for name in names if (out / name).exists() and name not in earlier]:
        raise ValueError(
            f"{out}: holds {' and '.join(others)} that no evaluation wrote, and that the report would overwrite; move "
            f"{out / MADE}, where the whole report lies, or choose another folder"
        )
    for name in sorted(names, key=lambda name: name != REPORT):  # first the one that lists the others
        (out / MADE / name).replace(out / name)
    (out / MADE).rmdir()
    for name in earlier.difference(names):
        (out / name).unlink(missing_ok=True)


def check_report_folder(out: Path) -> None:
    """Raise a ValueError if a folder holds files of somebody else that a report would overwrite."""
    check_replaceable(out, (REPORT, PAGE, TABLE), ("kind", "measures"), "evaluation")


def _listed_files(folder: Path, names: Sequence[str]) -> set[str]:
    """Return the names of the files of an earlier report that are still there; by these where it does not list them."""
    if not (folder / REPORT).exists():
        return set()
    listed = read_json(folder / REPORT).get("files")
    known = listed if isinstance(listed, list) else names
    return {path.name for path in folder.iterdir() if path.name in known and path.is_file()}


def write_page(path: Path, title: str, sections: Sequence[Section]) -> Path:
    """Write a self-contained HTML page.

    Parameters
    ----------
    path : of the page
    title : of the page
    sections : in their order
    """
    program = f"reconstudy {version('reconstudy')}"
    content = {"title": title, "sections": sections, "font": FONT, "program": program}
    return write_bytes(path, report_page("recon.validation", content, columns=_columns, base64=_base64))


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


def write_figure(stem: Path, chart: Any) -> str:
    """Write a chart as SVG, PNG and PDF beside each other, and return the SVG's text."""
    import vl_convert

    room = {"left": 5, "top": 5, "right": 48, "bottom": 5}  # other fonts than ours are wider, and cut legends
    whole = chart.configure(font=FONT, padding=room)
    spec = whole.configure_axis(labelFlush=False).configure_view(stroke=None).to_dict()
    svg = str(vl_convert.vegalite_to_svg(spec))
    write_bytes(stem.with_name(f"{stem.name}.svg"), svg.encode("utf-8"))
    write_bytes(stem.with_name(f"{stem.name}.png"), bytes(vl_convert.vegalite_to_png(spec, scale=2.0)))
    write_bytes(stem.with_name(f"{stem.name}.pdf"), bytes(vl_convert.vegalite_to_pdf(spec)))
    return svg


def save_picture(folder: Path, name: str, picture: NDArray[np.uint8]) -> bytes:
    """Write a picture of a report as PNG, and return the file's bytes, which its page holds, too.

    Parameters
    ----------
    folder : of the report
    name : of the file, without its ending; see `free_name`
    picture : uint8 (H, W, 3), RGB
    """
    return write_picture(folder / f"{free_name(folder, name)}.png", picture)


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
    """Return a name as a part of a file's name: what is no letter of any script, digit, dot or hyphen becomes _."""
    return re.sub(r"[^\w.-]", "_", name)


def free_name(folder: Path, name: str) -> str:
    """Return the plain name for a file, with a number if a file of the folder has it, as of "a b" beside "a_b"."""
    plain, taken = plain_name(name), {path.stem for path in folder.iterdir()}
    numbered = (f"{plain}_{number}" for number in count(2))
    return next(free for free in chain((plain,), numbered) if free not in taken)


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
