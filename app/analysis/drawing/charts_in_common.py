"""Lay charts out for a page: widths of a journal's columns, names that are never cut, fonts, colours, and files.

Colours are those of Okabe and Ito (2008), which colour-blind readers can tell apart; shapes repeat what they say.
"""

from __future__ import annotations

import io
import json
import math
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, Literal

import altair as alt
import vl_convert
from PIL import Image

# Okabe and Ito (2008), "Color universal design"; black first, yellow left out (too pale on white).
PALETTE = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
SHAPES = ("circle", "square", "triangle-up", "diamond", "cross", "triangle-down", "triangle-right")
DIVERGING = ["#b35806", "#f7f7f7", "#2166ac"]  # of a matrix
INK, FAINT = "#222222", "#d9d9d9"
# The first that a machine has; the last ones have Chinese, Japanese and Korean letters.
FONT = (
    "Liberation Sans, Arial, Helvetica, Noto Sans, Noto Sans CJK SC, Noto Sans SC, Noto Sans CJK JP, PingFang SC, "
    "Hiragino Sans, Microsoft YaHei, Malgun Gothic, sans-serif"
)
DOTS_PER_INCH = 300  # of PNG files, as journals ask
POINTS_PER_PIXEL = 0.75  # 72 points and 96 pixels in an inch
PIXELS_PER_MM = 96 / 25.4
# Columns of a journal's page: 88 and 181 mm, which fit those of Elsevier, IEEE, Springer and Nature.
WIDTHS = {"one": int(88 * PIXELS_PER_MM), "two": int(181 * PIXELS_PER_MM)}
FULL = WIDTHS["two"]

FONT_SIZE = 11  # pixels, 8 points
LINE = 13  # pixels between the lines of a label
GAP = 14  # pixels between panels
MARGIN = 26  # pixels on both sides, and for what stands over the end of an axis
TICK = 9  # pixels between a label and its axis
LEGEND_SYMBOL = 30  # pixels beside a legend's name
LEGEND_GAP = 16  # pixels between two columns of a legend
NARROWEST_PANEL = 110  # pixels
MOST_FOR_LABELS = 0.5  # of the width
NARROW, WIDE = "iljtfrI.,:;'|!()[] -", "mwMW@%"
INVISIBLE = ("Cf", "Mn", "Zs")  # categories of Unicode: joiners, marks, spaces
LATIN_END = 0x24F  # letters up to here are in every font
KEPT = 48  # drawings; one of thirty conditions takes 0.4 MB
RUNNING = re.compile(r"\b(gradient|clip)_?\d+\b")
SIZE = re.compile(r'width="([\d.]+)" height="([\d.]+)"')
VIEW_BOX = re.compile(r'viewBox="0 0 [\d.]+ ([\d.]+)"')
TITLE_SIZE = 13  # pixels
WIDEST_BOLD = 1.1  # of a bold letter beside an upright one; DejaVu Sans, the widest in use
MOST_LETTERS = 400  # looked up in fonts
NO_DATA = {"name": "empty"}  # what the library writes of a chart without data


def colours_of(n: int) -> list[str]:
    """Return a colour for each of n names; with `shapes_of`, no two of 49 names look alike."""
    return [PALETTE[place % len(PALETTE)] for place in range(n)]


def shapes_of(n: int) -> list[str]:
    """Return a shape for each of n names; where the colours begin again, the shapes are shifted."""
    return [SHAPES[(place + place // len(PALETTE)) % len(SHAPES)] for place in range(n)]


def colour_by(field: str, title: str, names: Sequence[str], width: int) -> alt.Color:
    """Return a colour for each name, with a legend below the figure.

    Parameters
    ----------
    field : of the data, with the names
    title : of the legend
    names : in their order
    width : of the figure, in pixels
    """
    scale = alt.Scale(domain=list(names), range=colours_of(len(names)))
    return alt.Color(f"{field}:N", title=title, scale=scale, legend=_legend(names, width))


def shape_by(field: str, title: str, names: Sequence[str], width: int) -> alt.Shape:
    """Return a shape for each name, with the same legend as `colour_by`.

    Parameters
    ----------
    field, title, names, width : as in `colour_by`
    """
    scale = alt.Scale(domain=list(names), range=shapes_of(len(names)))
    return alt.Shape(f"{field}:N", title=title, scale=scale, legend=_legend(names, width))


def _legend(names: Sequence[str], width: int) -> alt.Legend | None:
    """Return a legend with as many columns as the longest name leaves room for; none for a single name."""
    if len(names) < 2:
        return None
    longest = max(text_width(name) for name in names) + LEGEND_SYMBOL + LEGEND_GAP
    columns = max(1, int(width // longest))
    return alt.Legend(symbolOpacity=1, orient="bottom", columns=columns, columnPadding=LEGEND_GAP, labelLimit=width)


def intervals_shown(rows: Iterable[Mapping[str, Any]], low: str = "ci_low") -> str:
    """Say in a caption whether rows have intervals: all, some or none."""
    has = {row[low] is not None for row in rows}
    if has <= {False}:
        return "without intervals (there are none)"
    return "with 95 % intervals" if has == {True} else "with 95 % intervals where there are any"


def dashed_line(side: Literal["x", "y"], value: float) -> Any:
    """Draw a dashed line across a panel at a value of the horizontal or vertical axis."""
    rule = alt.Chart(alt.Data(values=[{"line": value}])).mark_rule(strokeDash=[4, 3], color="#777777")
    return rule.encode(**{side: {"x": alt.X, "y": alt.Y}[side]("line:Q")})


def text_width(text: str, size: float = FONT_SIZE) -> float:
    """Return about how wide a text is drawn, in pixels, rather too much than too little."""
    return size * sum(_letter_width(letter) for letter in text)


def _letter_width(letter: str) -> float:
    if unicodedata.east_asian_width(letter) in "WF":
        return 1.0
    if letter in NARROW:
        return 0.36
    return 0.92 if letter in WIDE else 0.72 if letter.isupper() else 0.6


def wrapped(name: str, most: float) -> list[str]:
    """Return a name in lines of at most a width in pixels; nothing of it is left out.

    Lines break after spaces, hyphens, underscores, slashes and commas, or, in words that are too long, anywhere.
    """
    lines, line = [], ""
    for part in re.findall(r"[^\s_/,-]*[\s_/,-]*", name):
        if line and text_width((line + part).rstrip()) > most:
            lines.append(line)
            line = ""
        line += part
        while text_width(line.rstrip()) > most and len(line) > 1:
            cut = max(1, sum(text_width(line[: end + 1]) <= most for end in range(len(line))))
            lines.append(line[:cut])
            line = line[cut:]
    return [text.strip() for text in [*lines, line] if text.strip()] or [name]


@dataclass(frozen=True)
class Labels:
    """Names beside an axis, wrapped where they are long.

    Parameters
    ----------
    lines : name -> its lines
    extent : pixels that the labels take
    """

    lines: Mapping[str, Sequence[str]]
    extent: float

    def axis(self, *, is_shown: bool = True, has_grid: bool = True) -> alt.Axis:
        """Return an axis that has these labels, or only its grid."""
        options = {}
        several = {name: lines for name, lines in self.lines.items() if len(lines) > 1}
        if is_shown and several:
            options["labelExpr"] = f"{json.dumps(several, ensure_ascii=False)}[datum.label] || datum.label"
        extent = self.extent if is_shown else 0
        return alt.Axis(
            grid=has_grid, gridColor=FAINT, labels=is_shown, ticks=is_shown, labelLimit=0, labelLineHeight=LINE,
            minExtent=extent, maxExtent=extent, labelOverlap=False, **options
        )  # fmt: skip

    def step(self, least: int) -> int:
        """Return the height of a row in pixels, at least so much."""
        return max(least, LINE * max((len(lines) for lines in self.lines.values()), default=1) + 5)


def labels_of(names: Iterable[str], width: int = FULL) -> Labels:
    """Return the labels of names beside panels, in a figure of a width in pixels."""
    most = MOST_FOR_LABELS * width
    lines = {name: wrapped(name, most) for name in names}
    widest = max((text_width(line) for name in lines.values() for line in name), default=0.0)
    return Labels(lines, min(widest, most) + TICK)


def panel_layout(n_panels: int, labels: Labels, width: int = FULL) -> tuple[int, float]:
    """Return how many panels stand in a row, and the width of each in pixels.

    Parameters
    ----------
    n_panels : in all
    labels : beside the first panel of each row
    width : of the figure, in pixels
    """
    room = width - labels.extent - MARGIN
    n = max(1, min(n_panels, int((room + GAP) // (NARROWEST_PANEL + GAP))))
    n_rows = -(-n_panels // n)
    n = -(-n_panels // n_rows)  # as many in each row
    return n, (room - GAP * (n - 1)) / n


def panels_in_rows(
    panels: Sequence[tuple[str, Sequence[Mapping[str, Any]]]], labels: Labels, width: int, draw: Callable[..., Any]
) -> dict[str, Any]:
    """Return the specification of panels in rows, which share their horizontal axis.

    A panel with names and one without are drawn, and get the data of each: the library takes 30 ms for a panel.

    Parameters
    ----------
    panels : title and rows of each
    labels : beside the first panel of each row
    width : of the figure, in pixels
    draw : function of a panel's vertical axis and its width in pixels; returns layers, whose data are the rows where
        they have none of their own
    """
    n_columns, panel_width = panel_layout(len(panels), labels, width)
    drawn = [
        draw(labels.axis(is_shown=is_first), panel_width)
        .properties(width=panel_width)
        .to_dict(validate=False, context={"top_level": False})
        for is_first in (True, False)[:n_columns]
    ]
    for layer in (layer for panel in drawn for layer in panel["layer"]):
        if layer["data"] == NO_DATA:
            del layer["data"]
    parts = [
        {**drawn[min(number % n_columns, 1)], "title": title, "data": {"values": list(rows)}}
        for number, (title, rows) in enumerate(panels)
    ]
    shared = {"resolve": {"scale": {"x": "shared"}}}
    rows = [
        {"hconcat": parts[start : start + n_columns], "spacing": GAP} | shared
        for start in range(0, len(parts), n_columns)
    ]
    return {"vconcat": rows} | shared if len(rows) > 1 else rows[0]


def letters_without_font(names: Iterable[str]) -> str:
    """Return the letters of names that no font of this machine draws, each once."""
    letters = dict.fromkeys(letter for name in names for letter in name if ord(letter) > LATIN_END)
    letters = {letter: None for letter in letters if unicodedata.category(letter) not in INVISIBLE}
    return "".join(letter for letter in list(letters)[:MOST_LETTERS] if _picture(letter) == _picture("\U0010fffd"))


@cache
def _picture(letter: str) -> bytes:
    """Draw a letter; the last private one, which no font has, as what stands for a missing letter."""
    text = f'<text y="20" font-size="20" font-family="{FONT}">{letter}</text>'
    return bytes(vl_convert.svg_to_png(f'<svg xmlns="http://www.w3.org/2000/svg" width="30" height="30">{text}</svg>'))


def chart_svg(chart: Any, most: int = FULL) -> str:
    """Return the chart as SVG, whose text is text, at most so many pixels wide; what is wider is drawn smaller."""
    svg = _spec_svg(_spec(chart))
    shrunk = min(1.0, most / drawn_width(svg))
    return svg if shrunk == 1 else SIZE.sub(lambda size: _size(size, shrunk), svg, count=1)


def _size(size: re.Match[str], factor: float) -> str:
    width, height = (float(value) * factor for value in size.groups())
    return f'width="{width:g}" height="{height:g}"'


@lru_cache(KEPT)
def _spec_svg(spec: str) -> str:
    """Draw a specification; the same always gives the same text, without the library's running numbers."""
    svg = str(vl_convert.vegalite_to_svg(spec)).replace("<svg ", '<svg overflow="visible" ', 1)
    svg = _as_wide_as_its_title(svg, json.loads(spec).get("title") or {})
    numbers: dict[str, str] = {}
    return RUNNING.sub(lambda match: numbers.setdefault(match[0], f"{match[1]}_{len(numbers)}"), svg)


def _as_wide_as_its_title(svg: str, title: Mapping[str, Any] | str) -> str:
    """Return an SVG whose title fits also where a machine has only wide fonts; the library measures a narrow one."""
    parts = title if isinstance(title, Mapping) else {"text": title}
    widths = [0.0]
    for key, size in (("text", WIDEST_BOLD * TITLE_SIZE), ("subtitle", FONT_SIZE)):
        lines = parts.get(key) or []
        widths += [text_width(line, size) for line in ([lines] if isinstance(lines, str) else lines)]
    wide = math.ceil(max(widths))
    if wide <= drawn_width(svg):
        return svg
    svg = SIZE.sub(lambda size: f'width="{wide}" height="{size[2]}"', svg, count=1)
    return VIEW_BOX.sub(lambda box: f'viewBox="0 0 {wide} {box[1]}"', svg, count=1)


def drawn_width(svg: str) -> float:
    """Return the width of a chart's SVG in pixels."""
    size = SIZE.search(svg)
    assert size is not None
    return float(size[1])


def svg_png(svg: str) -> bytes:
    """Return a chart's SVG as PNG of 300 dots in an inch, on white."""
    drawn = vl_convert.svg_to_png(svg, scale=POINTS_PER_PIXEL, ppi=DOTS_PER_INCH)
    with Image.open(io.BytesIO(drawn)) as picture:
        opaque, on_white = io.BytesIO(), Image.new("RGBA", picture.size, "white")
        on_white.alpha_composite(picture.convert("RGBA"))
        on_white.convert("RGB").save(opaque, "PNG", dpi=(DOTS_PER_INCH, DOTS_PER_INCH), compress_level=3)
    return opaque.getvalue()


@lru_cache(KEPT)
def svg_pdf(svg: str) -> bytes:
    """Return a chart's SVG as PDF, as wide on paper as the SVG.

    The library names fonts at random. So the latest files are kept, and an archive does not change while its study
    does not.
    """
    in_points = SIZE.sub(lambda size: _size(size, POINTS_PER_PIXEL), svg, count=1)
    return bytes(vl_convert.svg_to_pdf(in_points))


def chart_vega(chart: Any) -> str:
    """Return the chart as a Vega specification in JSON, which a browser draws."""
    return json.dumps(vl_convert.vegalite_to_vega(_spec(chart)))


def _spec(chart: Any) -> str:
    spec = dict(chart) if isinstance(chart, Mapping) else chart.to_dict(validate=False)
    spec["config"] = {
        "font": FONT,
        "background": "#ffffff",
        "view": {"stroke": "#bbbbbb"},
        "title": {
            "fontSize": TITLE_SIZE,
            "anchor": "start",
            "color": INK,
            "subtitleFontSize": FONT_SIZE,
            "subtitleColor": "#555555",
        },
        "axis": {
            "labelFontSize": FONT_SIZE,
            "titleFontSize": FONT_SIZE,
            "titleFontWeight": "normal",
            "labelColor": INK,
            "labelLimit": 0,
            "labelFlush": False,
        },
        "legend": {
            "labelFontSize": FONT_SIZE,
            "titleFontSize": FONT_SIZE,
            "titleFontWeight": "normal",
            "labelLimit": 0,
        },
    }
    return json.dumps(spec)
