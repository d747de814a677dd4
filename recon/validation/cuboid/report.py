"""The report of the evaluation on cuboids."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recon.geometry.mesh import error_limit
from recon.validation.cuboid.evaluation import FLATNESS_CUT, MeasuredCuboid, MeasuredFace
from recon.validation.page import Section, curve_chart, curve_columns, percent, save_picture, write_figure, write_report
from recon.validation.pictures import error_picture, face_map, in_a_row

EDGES = (
    "An end is measured at a visible face, or where the points of the other faces end (outline); at an outline, "
    "what the reconstruction loses along the silhouette counts as error."
)
FLATNESS = (
    "Root mean square distance of a face's points from the plane fitted to them, without points beyond "
    f"{FLATNESS_CUT:g} robust standard deviations (scale), whose share is given. Tilt is the angle between this "
    "plane and the box's face."
)
TABLES = ("reconstructions", "faces", "angles", "edges", "table", "curve")


def write_cuboid_report(report: Mapping[str, Any], pictured: Sequence[MeasuredCuboid], out: Path) -> Path:
    """Write report.json, tables, figures and report.html, and return the HTML's path.

    Parameters
    ----------
    report, pictured : from `measure_cuboids`
    out : the report's folder
    """
    tables = {name: report[name] for name in TABLES}
    return write_report(out, "Reconstruction of a cuboid", report, tables, partial(_sections, report, pictured))


def _sections(report: Mapping[str, Any], pictured: Sequence[MeasuredCuboid], out: Path) -> list[Section]:
    """Return the page's sections, whose figures are written into a folder."""
    curve = write_figure(out / "curve", curve_chart(report["curve"]))
    size = " x ".join(f"{length:g}" for length in report["settings"]["size_mm"])
    what = (
        f"{len(report['reconstructions'])} reconstructions of a cuboid of {size} mm. Each visible face is a plane "
        "fitted to its own points; the box, whose faces are at right angles and whose edges are the known ones, is "
        "fitted to all of them together. Combined are all sensors' points against one box."
    )
    return [
        Section("What was measured", what, _overview(report)),
        Section("Edges", EDGES, report["edges"]),
        Section(
            "Angles", "Inside the box, between the planes fitted to each face, against 90 degrees.", report["angles"]
        ),
        Section("Flatness", FLATNESS, report["faces"]),
        Section(
            "Inliers against the threshold",
            "Signed error of a point: its distance to the fitted box's surface, positive outside.",
            curve_columns(report["table"]),
            [("Share of inliers of all reconstructions.", curve)],
        ),
        _pictures(report, pictured, out),
    ]


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
            shown["inliers %"] = percent(shown.pop("inliers"))
        rows.append(shown)
    return rows


def _pictures(report: Mapping[str, Any], pictured: Sequence[MeasuredCuboid], out: Path) -> Section:
    most, figures = report["settings"]["table_threshold_mm"], []
    for cuboid in pictured:
        assert cuboid.fit is not None, "only those with a fit are pictured"
        views = [np.roll(cuboid.fit.axes, shift, axis=0) for shift in range(3)]
        limit = min(most, error_limit(cuboid.errors))
        drawn = error_picture(cuboid.points, cuboid.errors, limit, views)
        picture = save_picture(out, f"cuboid_{cuboid.name}", drawn)
        maps = save_picture(out, f"faces_{cuboid.name}", in_a_row([_face_map(measured) for measured in cuboid.faces]))
        figures += [
            (f"Reconstruction {cuboid.name} along the box's three edges; colours are signed errors.", picture),
            (f"Faces of {cuboid.name}: median signed distance to the planes fitted to them, place by place.", maps),
        ]
    return Section("Pictures", figures=figures)


def _face_map(measured: MeasuredFace) -> NDArray[np.uint8]:
    face = measured.face
    return face_map(measured.places, measured.errors, 3 * face.plane.scale, face.name)
