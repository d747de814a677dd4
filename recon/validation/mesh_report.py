"""The report of a comparison with the truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from recon.validation.report import (
    PALETTE,
    Section,
    write_figure,
    write_page,
    write_report_json,
    write_table,
)

MEASURES = ("precision", "recall", "f_score")


def write_mesh_report(report: Mapping[str, Any], out: Path) -> Path:
    """Write report.json, the table, the figure and report.html; returns the HTML's path."""
    out.mkdir(parents=True, exist_ok=True)
    write_report_json(out, report)
    write_table(out / "scores.csv", report["scores"])
    svg = write_figure(out / "scores", _chart(report))
    distances = [{"distance": name, **report[name]} for name in ("accuracy", "completeness")]
    settings = report["settings"]
    text = (
        f"{settings['samples'][0]} points of {Path(settings['mesh']).name} against {settings['samples'][1]} of "
        f"{Path(settings['truth']).name}, meshes sampled uniformly by area (seed {settings['seed']}). The truth's "
        f"samples are {settings['spacing_mm']:.3g} mm apart (median): distances of that size are not resolved."
    )
    scores = "Share of points nearer than each threshold: precision of the mesh's, recall of the truth's."
    figure = ("Precision, recall and their harmonic mean against the threshold.", svg)
    sections = [Section("Distances", text, distances), Section("Scores", scores, report["scores"], [figure])]
    return write_page(out / "report.html", "Comparison with the truth", sections)


def _chart(report: Mapping[str, Any]) -> Any:
    import altair as alt

    values = [
        {"threshold_mm": row["threshold_mm"], "measure": measure, "share": row[measure]}
        for row in report["scores"]
        for measure in MEASURES
    ]
    colour = alt.Color("measure:N", title=None, sort=None, scale=alt.Scale(range=list(PALETTE)))
    return (
        alt.Chart(alt.Data(values=values))
        .mark_line(point=True)
        .encode(
            x=alt.X("threshold_mm:Q", title="threshold, mm"),
            y=alt.Y("share:Q", title=None, scale=alt.Scale(domain=[0, 1]), axis=alt.Axis(format="%")),
            color=colour,
        )
        .properties(width=460, height=280)
    )
