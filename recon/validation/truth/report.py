"""The report of a comparison with the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from recon.capture.images import write_picture
from recon.geometry.mesh import LIMIT_SHARE, error_colours, error_limit
from recon.geometry.mesh_files import write_coloured
from recon.validation.clouds import read_shape
from recon.validation.page import PALETTE, Section, percent, write_figure, write_report
from recon.validation.pictures import error_picture
from recon.validation.truth.evaluation import sample_evenly, signed_distances_to

MEASURES = ("precision", "recall", "f_score")
COLOURED = "errors.ply"
PICTURED = 150_000  # points; more than the pictures have pixels for


def write_mesh_report(report: Mapping[str, Any], out: Path) -> Path:
    """Write report.json, tables, the figure, the mesh coloured by error and report.html; returns the HTML's path."""
    tables = {name: report[name] for name in ("scores", "eth3d")}
    return write_report(out, "Comparison with the truth", report, tables, partial(_sections, report))


def _sections(report: Mapping[str, Any], out: Path) -> list[Section]:
    """Return the page's sections, whose figures are written into a folder."""
    svg = write_figure(out / "scores", _chart(report))
    figure = ("Precision, recall and their harmonic mean against the threshold.", svg)
    scores = "Share of points nearer than each threshold: precision of the mesh's, recall of the truth's."
    sections = [
        Section("Distances", _settings_text(report["settings"]), _distances(report)),
        Section("Scores", scores, _percents(report["scores"]), [figure]),
        Section("Scores as ETH3D counts them", _eth3d_text(report), _eth3d_rows(report)),
        _errors(report, out),
    ]
    if report["remarks"]:
        sections.insert(0, Section("Remarks", rows=[{"remark": remark} for remark in report["remarks"]]))
    return sections


def _settings_text(settings: Mapping[str, Any]) -> str:
    return (
        f"{settings['samples'][0]} points of {Path(settings['mesh']).name} against {settings['samples'][1]} of "
        f"{Path(settings['truth']).name}; meshes are sampled uniformly by area (seed {settings['seed']}). Accuracy is "
        f"the distance to the truth's {settings['accuracy_to']}, completeness that to the mesh's "
        f"{settings['completeness_to']}. The rows “between samples” are what the benchmarks' scripts give, which "
        f"compare points with points: the truth's are {settings['spacing_mm']:.3g} mm apart (median), and smaller "
        "distances are not resolved in those rows."
    )


def _eth3d_text(report: Mapping[str, Any]) -> str:
    settings = report["settings"]
    seen = (
        "Where the truth was scanned from is not known: all points count as observed."
        if settings["scanner_mm"] is None
        else f"Points that no beam of a scanner at {list(settings['scanner_mm'])} mm passes do not count."
    )
    return (
        f"Between samples, averaged over voxels of {settings['voxel_mm']:g} mm, so that densely sampled parts weigh no "
        f"more than others. {seen}"
    )


def _eth3d_rows(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Leave out the share of unobserved points where the scanner's place is not known."""
    is_known = report["settings"]["scanner_mm"] is not None
    return _percents([{key: row[key] for key in row if is_known or key != "unobserved"} for row in report["eth3d"]])


def _percents(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Name and round scores for the page: shares become per cents."""
    return [
        {
            "threshold mm": row["threshold_mm"],
            **{f"{name.replace('_', '-')} %": percent(share) for name, share in row.items() if name != "threshold_mm"},
        }
        for row in rows
    ]


def _distances(report: Mapping[str, Any]) -> list[dict[str, Any]]:
    parts = (("", report), (", between samples", report["sampled"]))
    return [
        {"distance": name + suffix, **part[name]} for suffix, part in parts for name in ("accuracy", "completeness")
    ]


def _errors(report: Mapping[str, Any], out: Path) -> Section:
    """Colour the measured shape by its errors, as a file and as pictures."""
    settings = report["settings"]
    measured, truth = (read_shape(Path(settings[name])) for name in ("mesh", "truth"))
    errors = signed_distances_to(truth, measured.points)
    limit = error_limit(errors)
    write_coloured(out / COLOURED, measured.points, measured.faces, error_colours(errors, limit))
    shown = sample_evenly(measured, PICTURED, np.random.default_rng(settings["seed"]))
    picture = write_picture(out / "errors.png", error_picture(shown, signed_distances_to(truth, shown), limit))
    text = (
        f"Blue is inside the truth, red outside, white on it; the colours end at {limit:.3g} mm, the "
        f"{LIMIT_SHARE}th percentile. {COLOURED} holds the same for any viewer."
    )
    return Section("Where the errors are", text, figures=[("Along each of the three axes of the world.", picture)])


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
