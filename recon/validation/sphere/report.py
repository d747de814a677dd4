"""The report of the evaluation on spheres, as a paper's appendix would have it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from recon.validation.measures import measured_rows
from recon.validation.page import (
    Section,
    curve_chart,
    curve_columns,
    percent,
    write_bytes,
    write_figure,
    write_measures,
    write_page,
    write_report_json,
    write_table,
)
from recon.validation.pictures import png, sphere_picture
from recon.validation.sphere.reconstruction import MeasuredSphere

METHOD_TEXT = {
    "robust": "A consensus of spheres of the known radius through three points, then robust refinement (Tukey).",
    "super4pcs": "The ideal sphere's points registered by Super4PCS, then robust refinement (Tukey).",
}
CAPTION = (
    "Reconstruction {name} with its fitted sphere: all points and outliers only, from the sensor (left) and from the "
    "side (right); orange is outside and blue inside by more than {threshold:g} mm."
)


def write_sphere_report(report: Mapping[str, Any], pictured: Sequence[MeasuredSphere], out: Path) -> Path:
    """Write report.json, tables, figures and report.html, and return the HTML's path.

    Parameters
    ----------
    report, pictured : from `measure_spheres`
    out : the report's folder
    """
    out.mkdir(parents=True, exist_ok=True)
    write_report_json(out, report)
    write_table(out / "reconstructions.csv", report["reconstructions"])
    write_table(out / "sensors.csv", report["table"])
    write_table(out / "curve.csv", report["curve"])
    write_measures(out, measured_rows(report["measures"], "validate sphere"))
    subset = "used" if any(row["subset"] == "used" for row in report["curve"]) else "all"
    curve = write_figure(out / "curve", curve_chart([row for row in report["curve"] if row["subset"] == subset]))
    sections = [_summary(report), _sensors(report), _curve(subset, curve), _fits(report)]
    sections += [_reasons(report), _pictures(report, pictured, out)]
    return write_page(out / "report.html", "Reconstruction of a sphere", sections)


def _summary(report: Mapping[str, Any]) -> Section:
    settings, rows = report["settings"], report["reconstructions"]
    n_used = sum(not row["is_excluded"] for row in rows)
    named = ", ".join(row["name"] for row in report["flagged"]) or "none"
    text = (
        f"{len(rows)} reconstructions of a sphere of radius {settings['radius_mm']:g} mm, {n_used} of them used. "
        f"Left out: {', '.join(row['name'] for row in report['excluded']) or 'none'}; failed: "
        f"{', '.join(report['failed']) or 'none'}; flagged by remarks: {named}. "
        f"{METHOD_TEXT[settings['method']]} The signed error of a point is its distance to the fitted centre minus the "
        "radius; beyond the threshold, on either side, it is an outlier."
    )
    return Section("What was measured", text)


def _sensors(report: Mapping[str, Any]) -> Section:
    text = (
        f"Mean over samples at a threshold of {report['settings']['table_threshold_mm']:g} mm, with 95 % intervals "
        f"from {report['settings']['replicates']} bootstrap replicates over samples. Combined are all sensors' points "
        "against one sphere. The rows “all” include what the exclusion rule leaves out."
    )
    return Section("Sensors", text, curve_columns(report["table"]))


def _curve(subset: str, svg: str) -> Section:
    what = "the reconstructions used" if subset == "used" else "all reconstructions, since none is used"
    return Section("Inliers against the threshold", figures=[(f"Share of inliers of {what}.", svg)])


def _fits(report: Mapping[str, Any]) -> Section:
    rows = [
        {
            "name": row["name"],
            "used": not row["is_excluded"],
            "inliers %": percent(row.get("inliers")),
            "free radius mm": row.get("free_radius_mm"),
            "sector shift mm": row.get("sector_shift_mm"),
            "ring shift mm": row.get("ring_shift_mm"),
            "coherent mm": row.get("coherent_error_mm"),
            "missing %": percent(row.get("missing_share")),
        }
        for row in report["reconstructions"]
    ]
    text = (
        f"Inliers are within {report['settings']['table_threshold_mm']:g} mm; the free radius is the one that suits "
        "the points best. Shifts are how far the centre moves without the worst of eight sectors, or without the inner "
        "or outer half. Coherent is by how much the worst sixth of the surface is off together. Missing is the share "
        "of the ball's picture without points, known where the sensor's place is given."
    )
    return Section("Reconstructions", text, rows)


def _reasons(report: Mapping[str, Any]) -> Section:
    rows = [
        {"name": row["name"], "verdict": verdict, "why": why}
        for row in report["reconstructions"]
        for verdict, reasons in (
            ("failed", [row["failure"]] if row["failure"] else []),
            ("left out" if row["is_excluded"] else "kept on request", row["reasons"]),
            ("flagged", row["remarks"]),
        )
        for why in reasons
    ]
    text = (
        "--keep and --drop overrule the exclusion rule by name. A reconstruction is flagged, but not left out, where a "
        "value is near its limit, or beyond it but usual for its sensor, or where parts of the ball have no points."
    )
    return Section("What was left out or flagged", text if rows else "Nothing.", rows)


def _pictures(report: Mapping[str, Any], pictured: Sequence[MeasuredSphere], out: Path) -> Section:
    figures = []
    radius, threshold = report["settings"]["radius_mm"], report["settings"]["table_threshold_mm"]
    for sphere in pictured:
        name, centre = sphere.file.name, np.asarray(sphere.columns["centre_mm"])
        picture = png(sphere_picture(sphere.points, centre, radius, threshold))
        write_bytes(out / f"sphere_{name.replace('/', '_')}.png", picture)
        figures.append((CAPTION.format(name=name, threshold=threshold), picture))
    return Section("Pictures", figures=figures)
