"""The report of the evaluation on cuboids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from recon.validation.cuboid.evaluation import FLATNESS_CUT, MeasuredCuboid, face_errors
from recon.validation.page import (
    Section,
    curve_chart,
    curve_columns,
    write_bytes,
    write_figure,
    write_page,
    write_report_json,
    write_table,
)
from recon.validation.pictures import error_picture, face_map, in_a_row, png

MOST_PICTURES = 12
COLOUR_SHARE = 98  # percentile of the errors at which the colours end, if that is within the table's threshold
TABLES = ("reconstructions", "faces", "angles", "edges", "table", "curve", "measures")


def write_cuboid_report(report: Mapping[str, Any], measured: Sequence[MeasuredCuboid], out: Path) -> Path:
    """Write report.json, tables, figures and report.html; returns the HTML's path."""
    out.mkdir(parents=True, exist_ok=True)
    write_report_json(out, report)
    for name in TABLES:
        write_table(out / f"{name}.csv", report[name])
    curve = write_figure(out / "curve", curve_chart(report["curve"]))
    size = " x ".join(f"{length:g}" for length in report["settings"]["size_mm"])
    what = (
        f"{len(report['reconstructions'])} reconstructions of a cuboid of {size} mm. Each visible face is a plane "
        "fitted to its own points; the box, whose faces are at right angles and whose edges are the known ones, is "
        "fitted to all of them together. Combined are all sensors' points against one box."
    )
    sections = [
        Section("What was measured", what, _overview(report)),
        Section("Edges", _edges_text(), report["edges"]),
        Section("Angles", "Inside the box, between the faces' own planes, against 90 degrees.", report["angles"]),
        Section("Flatness", _flatness_text(), report["faces"]),
        Section(
            "Inliers against the threshold",
            "Signed error of a point: its distance to the fitted box's surface, positive outside.",
            curve_columns(report["table"]),
            [("Share of inliers of all reconstructions.", curve)],
        ),
        _pictures(report, measured, out),
    ]
    return write_page(out / "report.html", "Reconstruction of a cuboid", sections)


def _overview(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    left_out = {"axes", "file", "sample", "sensor"}
    if not any(row["failure"] for row in report["reconstructions"]):
        left_out.add("failure")
    rows = []
    for row in report["reconstructions"]:
        shown = {key: value for key, value in row.items() if key not in left_out}
        if "faces" in shown:
            shown["faces"] = "\u00a0".join(shown["faces"])
            shown["centre_mm"] = ",\u00a0".join(f"{value:.2f}" for value in shown["centre_mm"])
        rows.append(shown)
    return rows


def _edges_text() -> str:
    return (
        "An end is where a visible face lies, or where the points of the other faces end (outline): there what the "
        "reconstruction loses along silhouettes counts as error."
    )


def _flatness_text() -> str:
    return (
        f"Root mean square distance of a face's points from its plane, of those within {FLATNESS_CUT:g} robust "
        "standard deviations (scale); beyond is the share of the others. Tilt is the angle to the box's own face."
    )


def _pictures(report: Mapping[str, Any], measured: Sequence[MeasuredCuboid], out: Path) -> Section:
    most, figures = report["settings"]["table_threshold_mm"], []
    for one in [one for one in measured if one.fit is not None][:MOST_PICTURES]:
        assert one.fit is not None, "chosen above"
        stem = one.name.replace("/", "_")
        views = [np.roll(one.fit.axes, shift, axis=0) for shift in range(3)]
        errors = one.fit.errors(one.points)
        limit = min(most, max(float(np.percentile(np.abs(errors), COLOUR_SHARE)), 1e-3))
        picture = png(error_picture(one.points, errors, limit, views))
        faces = [face_map(*face_errors(one, face), 3 * face.plane.scale, face.name) for face in one.fit.faces]
        maps = png(in_a_row(faces))
        write_bytes(out / f"cuboid_{stem}.png", picture)
        write_bytes(out / f"faces_{stem}.png", maps)
        figures += [
            (f"Reconstruction {one.name} along the box's three edges; colours are signed errors.", picture),
            (f"Faces of {one.name}: median signed distance to their own planes, place by place.", maps),
        ]
    return Section("Pictures", figures=figures)
