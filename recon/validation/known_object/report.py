"""The report of the evaluation on an object of any known shape."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from recon.capture.images import write_picture
from recon.geometry.mesh import error_colours, error_limit
from recon.geometry.mesh_files import write_coloured
from recon.validation.known_object.evaluation import MeasuredObject
from recon.validation.page import PALETTE, Section, curve_chart, curve_columns, write_figure, write_report
from recon.validation.pictures import error_picture

COLOURED = "errors.ply"
HISTOGRAM_BINS = 80


def write_object_report(report: Mapping[str, Any], measured: MeasuredObject, out: Path) -> Path:
    """Write report.json, tables, figures, the cloud coloured by error and report.html, and return the HTML's path.

    Parameters
    ----------
    report, measured : from `measure_object`
    out : the report's folder
    """
    title = f"Reconstruction of {Path(report['settings']['model']).stem}"
    tables = {name: report[name] for name in ("table", "curve")}
    return write_report(out, title, report, tables, partial(_sections, report, measured))


def _sections(report: Mapping[str, Any], measured: MeasuredObject, out: Path) -> list[Section]:
    """Return the page's sections, whose figures are written into a folder."""
    curve = write_figure(out / "curve", curve_chart(report["curve"]))
    limit = error_limit(measured.errors)
    histogram = write_figure(out / "errors", _histogram(measured, limit))
    picture = write_picture(out / "cloud.png", error_picture(measured.points, measured.errors, limit))
    write_coloured(out / COLOURED, measured.points, np.zeros((0, 3), np.int32), error_colours(measured.errors, limit))
    return [
        Section("Where the model lies", _placement_text(report)),
        Section(
            "Signed distances",
            "Of the cloud's points to the model's surface, positive outside; inliers within the table's threshold.",
            [report["errors"]],
            [("How often each distance occurs.", histogram)],
        ),
        Section(
            "Inliers against the threshold",
            "",
            curve_columns(report["table"]),
            [("Share of the points within each threshold of the model.", curve)],
        ),
        Section(
            "Where the errors are",
            f"Blue is inside the model, red outside. {COLOURED} holds the same in the model's frame.",
            figures=[("Along each of the model's three axes.", picture)],
        ),
    ]


def _placement_text(report: Mapping[str, Any]) -> str:
    placement, settings = report["registration"], report["settings"]
    text = (
        f"{Path(settings['model']).name} was registered to {report['n_points']} points of "
        f"{Path(settings['cloud']).name} by Super4PCS and then by point-to-plane ICP on the nearest "
        f"{settings['trim']:.0%} of the points ({placement['steps']} steps). {placement['overlap']:.1%} of the cloud "
        f"lie within {placement['delta_mm']:.3g} mm of it; the root mean square of the distances used is "
        f"{placement['rms_mm']:.3g} mm."
    )
    return text + (f" {ambiguity_text(report)}" if placement["is_ambiguous"] else "")


def ambiguity_text(report: Mapping[str, Any]) -> str:
    """Explain that the model fits in several places."""
    n = len(report["registration"]["rivals"])
    return (
        f"It fits as well in {n} other {'place' if n == 1 else 'places'}: the model is symmetric, or the cloud shows "
        "too little of it to tell. Distances hold for the place reported; its pose is not to be trusted."
    )


def _histogram(measured: MeasuredObject, limit: float) -> Any:
    import altair as alt

    counts, borders = np.histogram(measured.errors, HISTOGRAM_BINS, (-2 * limit, 2 * limit))
    values = [
        {"from": float(a), "to": float(b), "share": float(count / len(measured.errors))}
        for a, b, count in zip(borders[:-1], borders[1:], counts, strict=True)
    ]
    x = alt.X("from:Q", title="signed distance, mm", bin="binned")
    return (
        alt.Chart(alt.Data(values=values))
        .mark_bar(color=PALETTE[1])
        .encode(x=x, x2="to:Q", y=alt.Y("share:Q", title="points", axis=alt.Axis(format="%")))
        .properties(width=460, height=220)
    )
