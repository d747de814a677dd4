"""The report of a comparison of clouds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from recon.geometry.mesh import LIMIT_SHARE, error_limit
from recon.validation.cloud_quality.compared import SYMMETRIC
from recon.validation.cloud_quality.evaluation import SOURCE, Comparison
from recon.validation.cloud_quality.measures import WITH_SCORES
from recon.validation.page import PALETTE, Section, save_picture, write_figure, write_report
from recon.validation.pictures import error_picture

MOST_PICTURES = 6
WHOLE = ("", SYMMETRIC)  # directions of values that hold for both
INFINITE = ("inf", "-inf")
BOTH_WAYS = (
    "Both directions together: the worse of the two, but the mean for the Chamfer distance and the harmonic mean for "
    "the F-score. The values of a sequence are means over its frames. measures.csv has directions and frames; the page "
    "“Measures” of the documentation says what each measure sees and what it is blind to."
)
KINDS = (  # title, text, and how names begin; the last takes all that are left
    ("Distances", BOTH_WAYS, ("d1_", "d2_", "chamfer", "f_score")),
    ("Colours", "At nearest points, in Y, Cb and Cr of BT.709.", ("y_", "cb_", "cr_")),
    ("PointSSIM", "1 is best; variance over 12 neighbours, mean over points.", ("pointssim_",)),
    ("Other measures", "By programs and packages of others; measures.csv names them.", ("",)),
)
CHART_COLUMNS, CHART_WIDTH = 3, 210


def write_cloud_report(comparison: Comparison, out: Path) -> Path:
    """Write report.json, tables, figures and report.html; returns the HTML's path."""
    report = comparison.report
    title, tables = f"Clouds of {report['settings']['dataset']}", {"clouds": report["clouds"]}
    return write_report(out, title, report, tables, partial(_sections, comparison), comparison.values)


def _sections(comparison: Comparison, out: Path) -> list[Section]:
    """Return the page's sections, whose figures are written into a folder."""
    report = comparison.report
    has_choice = len({value["approach"] for value in report["values"]}) > 1 or len(report["settings"]["frames"]) > 1
    return [
        *_tables(report),
        *([Section("All measures", figures=[_figure(report, out)])] if has_choice else []),
        _pictures(comparison, out),
        Section("Clouds", _clouds_text(report), report["clouds"]),
        *_doubts(report),
    ]


def mean_values(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a report's values of whole sequences, both directions together: what its first table shows."""
    return [value for value in report["values"] if value["frame"] is None and value["direction"] in WHOLE]


def _tables(report: Mapping[str, Any]) -> list[Section]:
    """Arrange the main values: a table for each kind of measure, with a row for each approach."""
    values = _main_values(report)
    sections = []
    for title, text, _ in KINDS:
        rows: dict[str, dict[str, Any]] = {}
        for value in values:
            if next(other for other, _, begins in KINDS if value["measure"].startswith(begins)) == title:
                row = rows.setdefault(value["approach"], {"approach": value["approach"]})
                row[_heading(value)] = "∞" if value["value"] == "inf" else value["value"]
        if rows:
            sections.append(Section(title, text, list(rows.values())))
    return sections


def _main_values(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Select of a report's values of whole sequences the main ones of ours, and those of others."""
    return [value for value in mean_values(report) if value["measure"] in WITH_SCORES or value["source"] != SOURCE]


def _heading(value: Mapping[str, Any]) -> str:
    """Return a measure's name with its unit and an arrow, up where higher is better."""
    unit = "" if value["measure"].endswith("_db") else value["unit"]
    return " ".join(filter(None, (value["measure"], unit, "↑" if value["better"] == "higher" else "↓")))


def _figure(report: Mapping[str, Any], out: Path) -> tuple[str, str]:
    svg = write_figure(out / "measures", _chart(report))
    frames = "; small dots are frames" if len(report["settings"]["frames"]) > 1 else ""
    return f"Each measure by approach{frames}. ↑: higher is better; ↓: lower is better.", svg


def _chart(report: Mapping[str, Any]) -> Any:
    import altair as alt

    headings = {value["measure"]: _heading(value) for value in _main_values(report)}
    approaches = list(dict.fromkeys(value["approach"] for value in report["values"]))
    y = alt.Y("approach:N", title=None, sort=approaches)
    charts = []
    for measure, heading in headings.items():
        values = [
            value
            for value in report["values"]
            if value["measure"] == measure and value["direction"] in WHOLE and value["value"] not in INFINITE
        ]
        axis = alt.Axis(tickCount=4, format=".4~r")
        x = alt.X("value:Q", title=heading, scale=alt.Scale(zero=False), axis=axis)
        frames, means = (
            alt.Chart(alt.Data(values=[value for value in values if (value["frame"] is None) == is_mean]))
            for is_mean in (False, True)
        )
        small = frames.mark_circle(size=14, opacity=0.35, color=PALETTE[0]).encode(x=x, y=y)
        large = means.mark_circle(size=70, opacity=1, color=PALETTE[1]).encode(x=x, y=y)
        charts.append((small + large).properties(width=CHART_WIDTH, height=alt.Step(16)))
    return alt.concat(*charts, columns=CHART_COLUMNS)


def _pictures(comparison: Comparison, out: Path) -> Section:
    figures = []
    limit = max(error_limit(shown.errors) for shown in comparison.shown)
    unit = comparison.report["settings"]["unit"]
    for shown in comparison.shown[:MOST_PICTURES]:
        drawn = error_picture(shown.points, shown.errors, limit, unit=unit)
        picture = save_picture(out, f"errors_{shown.name}", drawn)
        figures.append((f"{shown.name}, along each of the three axes of the world.", picture))
    kind = (
        "Blue lies behind the reference's surface, red before it, by the normals of the nearest points"
        if comparison.shown[0].is_signed
        else "Red is far from the reference, which has no normals to tell the sides apart"
    )
    more = f" The first {MOST_PICTURES} of {len(comparison.shown)}." if len(comparison.shown) > MOST_PICTURES else ""
    text = (
        f"{kind}; white lies on it. The colours end at {limit:.3g} {unit} in all pictures, the largest of the clouds' "
        f"{LIMIT_SHARE}th percentiles.{more}"
    )
    return Section("Where the errors are", text, figures=figures)


def _clouds_text(report: Mapping[str, Any]) -> str:
    settings = report["settings"]
    unit = settings["unit"]
    parts = [f"The unit of length is {unit}."]
    if settings["density"] is not None:
        parts.append(
            f"Meshes were sampled uniformly by area, with {settings['density']:.4g} points per {unit}² and seed "
            f"{settings['seed']}; distances between two samples do not fall below the points' spacing."
        )
    parts.append(
        "The peak of the PSNR is, for each frame, the largest distance between neighbours in the reference."
        if settings["peak"] is None
        else f"The peak of the PSNR is {settings['peak']:g} {unit}."
    )
    if settings["threshold"] is not None:
        parts.append(f"The threshold of the F-score is {settings['threshold']:.4g} {unit}.")
    return " ".join(parts)


def _doubts(report: Mapping[str, Any]) -> list[Section]:
    sections = []
    if report["remarks"]:
        sections.append(Section("Remarks", rows=[{"remark": remark} for remark in report["remarks"]]))
    if report["skipped"]:
        sections.append(Section("Not measured", rows=report["skipped"]))
    return sections


def skipped_sentences(skipped: Sequence[Mapping[str, Any]]) -> list[str]:
    """Say once for each measure what could not be measured and why, however many frames and approaches it holds for."""
    reasons: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in skipped:
        reasons.setdefault((row["measure"], row["approach"]), []).append(row)
    return [
        f"not measured: {measure} of {approach}: {rows[0]['reason']}"
        + (f" (and in {len(rows) - 1} more frames)" if len(rows) > 1 else "")
        for (measure, approach), rows in reasons.items()
    ]
