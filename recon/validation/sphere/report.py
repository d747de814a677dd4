"""The report of the evaluation on spheres, as a paper's appendix would have it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from recon.validation.page import Section, curve_chart, curve_columns, percent, save_picture, write_figure, write_report
from recon.validation.pictures import sphere_picture
from recon.validation.sphere.cell_picture import cell_picture
from recon.validation.sphere.exclusion import MIN_SURFACE_SHARE, part_limits
from recon.validation.sphere.fit.model import OWN
from recon.validation.sphere.reconstruction import MeasuredSphere

METHOD_TEXT = {
    "robust": "A consensus of spheres of the known radius through three points, then robust refinement (Tukey).",
    "super4pcs": "The ideal sphere's points registered by Super4PCS, then robust refinement (Tukey).",
}
CAPTION = (
    "Reconstruction {name} with its fitted sphere: all points and outliers only, from the sensor (left) and from the "
    "side (right); orange is outside and blue inside by more than {threshold:g} mm."
)
CELLS_CAPTION = (
    "Verdict on {name}: {verdict}; {why}. Errors from the sensor; grey has no points. Lines part the rule's eight "
    "sectors and three rings; numbers are the cells' median errors in mm, the worst four outlined."
)
CRITERIA = {
    "sector_shift": "sector shift mm",
    "ring_shift": "ring shift mm",
    "coherent_error": "coherent mm",
}
MAX_RATIO = 1.5  # of residuals to uncertainties that is no more than chance makes of a few places


def write_sphere_report(report: Mapping[str, Any], pictured: Sequence[MeasuredSphere], out: Path) -> Path:
    """Write report.json, tables, figures and report.html, and return the HTML's path.

    Parameters
    ----------
    report, pictured : from `measure_spheres`
    out : the report's folder
    """
    tables = {"reconstructions": report["reconstructions"], "sensors": report["table"], "curve": report["curve"]}
    return write_report(out, "Reconstruction of a sphere", report, tables, partial(_sections, report, pictured))


def _sections(report: Mapping[str, Any], pictured: Sequence[MeasuredSphere], out: Path) -> list[Section]:
    """Return the page's sections, whose figures are written into a folder."""
    subset = "used" if any(row["subset"] == "used" for row in report["curve"]) else "all"
    curve = write_figure(out / "curve", curve_chart([row for row in report["curve"] if row["subset"] == subset]))
    sections = [_summary(report), _sensors(report), _curve(subset, curve), _fits(report), _sources(report)]
    sections += [_reference(report), _verdicts(report), _reasons(report)]
    return [*sections, _pictures(report, pictured, out), _inputs(report)]


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
        "against one sphere. The rows “all” include what the exclusion rule leaves out. With few samples these "
        "intervals are too narrow: with four they hold the mean in 80 % of cases, with ten in 90 %."
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
            "x mm": _with_uncertainty(row, "centre_mm", 0),
            "y mm": _with_uncertainty(row, "centre_mm", 1),
            "z mm": _with_uncertainty(row, "centre_mm", 2),
            "free radius mm": _with_uncertainty(row, "free_radius_mm"),
            "median error mm": _with_uncertainty(row, "median_error_mm"),
            "scatter mm": _with_uncertainty(row, "scale_mm"),
            "RMS of inliers mm": _with_uncertainty(row, "rms_inliers_mm"),
            "inliers %": _with_uncertainty(row, "inliers", unit=0.01),
        }
        for row in report["reconstructions"]
        if not row["failure"]
    ]
    text = (
        f"Centre of the ball, the radius that would suit the points best, median of the signed errors, their robust "
        f"standard deviation, and the inliers within {report['settings']['table_threshold_mm']:g} mm. After ± stands "
        "the expanded uncertainty of 95 %: the standard uncertainty by a bootstrap over the eight sectors of the cap "
        f"({report['settings']['draws']} draws), times Student's t of one degree of freedom fewer than sectors. It "
        "holds what differs from sector to sector: noise and clusters of wrong depth. It does not hold what all "
        "sectors share: the calibration, the ball's form and the error of its known radius."
    )
    return Section("Measurement results", text, rows)


def _with_uncertainty(row: Mapping[str, Any], name: str, part: int | None = None, unit: float = 1.0) -> str:
    """Write a value of a row with its expanded uncertainty, to the uncertainty's second digit."""
    value, u = row.get(name), row.get(f"u_{name}")
    if value is None:
        return "–"
    value, u = (value, u) if part is None else (value[part], u and u[part])
    if u is None:
        return f"{value / unit:.2f}"
    expanded = row["coverage_factor"] * u / unit
    digits = 2 if expanded <= 0 else int(np.clip(1 - np.floor(np.log10(expanded)), 0, 4))
    return f"{value / unit:.{digits}f}\u00a0±\u00a0{expanded:.{digits}f}"


def _verdicts(report: Mapping[str, Any]) -> Section:
    rows = [
        {
            "name": row["name"],
            "verdict": _verdict(row),
            "points": row["n_points"],
            "on the surface %": percent(row.get("surface_share")),
            **{words: _against_limit(row, name) for name, words in CRITERIA.items()},
            "missing %": percent(row.get("missing_share")),
        }
        for row in report["reconstructions"]
    ]
    text = (
        "The exclusion rule's values, each against its limit. Shifts are how far the centre moves without the worst of "
        "eight sectors, or without the inner or outer half. Coherent is by how much the worst sixth of the surface is "
        f"off together. At least {MIN_SURFACE_SHARE:.0%} of the points must lie on the surface. Missing is the share "
        "of the ball's picture without points, known where the sensor's place is given; it excludes nothing."
    )
    return Section("Verdicts of the exclusion rule", text, rows)


def _verdict(row: Mapping[str, Any]) -> str:
    if row["failure"]:
        return "no fit"
    if row["is_excluded"]:
        return "left out"
    return "kept on request" if row["reasons"] else "used, with remarks" if row["remarks"] else "used"


def _against_limit(row: Mapping[str, Any], name: str) -> str:
    if row["failure"]:
        return "–"
    value, limit = row[f"{name}_mm"], row[f"{name}_limit_mm"]
    return f"{value:.2f}\u00a0{'>' if value > limit else '≤'}\u00a0{limit:.2f}"


def _reasons(report: Mapping[str, Any]) -> Section:
    rows = [
        {"name": row["name"], "why": why}
        for row in report["reconstructions"]
        for why in [*([row["failure"]] if row["failure"] else []), *row["reasons"], *row["remarks"]]
    ]
    text = (
        "--keep and --drop overrule the exclusion rule by name. A reconstruction is flagged, but not left out, where a "
        "value is near its limit, or where parts of the ball have no points."
    )
    return Section("What was left out or flagged", text if rows else "Nothing.", rows)


def _sources(report: Mapping[str, Any]) -> Section:
    rows = [
        {
            "sensor": row["sensor"],
            "shots": row["n_shots"],
            "calibration mm": _with_uncertainty(row, "calibration_mm"),
            "single shots mm": _with_uncertainty(row, "shot_mm"),
            "both together mm": _with_uncertainty(row, "smooth_mm"),
            "matching mm": _with_uncertainty(row, "matching_mm"),
            "offset x, y, z mm": "–" if row["offset_mm"] is None else " ".join(f"{v:+z.2f}" for v in row["offset_mm"]),
        }
        for row in report["error_sources"]
    ]
    text = (
        "Root mean squares of the signed errors of the points on the surface, ± the expanded uncertainty of 95 % by a "
        "bootstrap over sectors. Calibration is the mean error of a cell of the cap (eight sectors, three rings) that "
        "comes back in every shot: it bends every ball alike. Single shots is what differs from shot to shot, such as "
        "a highlight. With one shot the two cannot be told apart. Matching is the scatter of points within a cell. An "
        "error that moves the whole ball bends nothing: the offset is how far a sensor sees the balls from the middle "
        "of all sensors (median over at least four samples), and the exclusion rule does not count it against a "
        "sample; what all sensors share, only a reference can show."
    )
    return Section("Calibration and matching", text, rows)


def _reference(report: Mapping[str, Any]) -> Section:
    reference = report["reference"]
    if reference is None:
        return Section("Agreement with a reference", "No reference centres were given (--reference-centre).")
    rows = [
        {
            "sample": row["sample"],
            **{f"{axis} mm": f"{part:+z.2f}" for axis, part in zip("xyz", row["residual_mm"], strict=True)},
            "distance mm": f"{row['distance_mm']:.2f}",
            "u mm": f"{row['u_mm']:.2f}",
            "Eₙ": "–" if row["e_n"] is None else f"{row['e_n']:.2f}",
            "verdict": "unknown" if row["e_n"] is None else "agrees" if row["e_n"] <= 1 else "disagrees",
        }
        for row in reference["samples"]
    ]
    return Section("Agreement with a reference", reference_text(reference), rows)


def reference_text(reference: Mapping[str, Any]) -> str:
    """Say how well the centres agree, and what the frames make of that."""
    n, dof = reference["n_samples"], reference["degrees_of_freedom"]
    if reference["frame"] == OWN:
        frames = (
            f"The reference has a frame of its own, so the rigid motion between the two sets of {n} centres was "
            f"estimated from these centres: it takes 6 of their {3 * n} coordinates and leaves {dof} degrees of "
            "freedom. A shift or turn of everything shows nowhere. "
        )
        scale, expanded = 100 * reference["scale"], 100 * reference["u_scale"] * reference["scale_coverage_factor"]
        lengths = f" Our distances between places are {scale:.1f} ± {expanded:.1f} % (95 %) of the reference's."
    else:
        frames = f"The reference is in the sensors' frame: {n} centres are compared as they are ({dof} coordinates). "
        lengths = ""
    ratio = reference["birge_ratio"]
    explained = "" if ratio is None else (
        f" That is {ratio:.1f} times what the bootstrap's uncertainties of both fits explain"
        + ("." if ratio <= MAX_RATIO else ": the rest is calibration, form, or the reference's own error.")
    )  # fmt: skip
    return (
        f"{frames}The residuals' standard deviation is {reference['s_mm']:.2f} mm per coordinate (95 %: "
        f"{reference['s_low_mm']:.2f} to {reference['s_high_mm']:.2f} mm), their mean length "
        f"{reference['mean_distance_mm']:.2f} mm.{explained}{lengths} u is the standard uncertainty along a residual; "
        "Eₙ is the residual over twice that, and at most 1 where both agree within their uncertainties."
    )


def _pictures(report: Mapping[str, Any], pictured: Sequence[MeasuredSphere], out: Path) -> Section:
    figures = []
    rows = {row["name"]: row for row in report["reconstructions"]}
    radius, threshold = report["settings"]["radius_mm"], report["settings"]["table_threshold_mm"]
    for sphere in pictured:
        if sphere.fit is None:
            continue
        name, limit = sphere.file.name, max(part_limits(sphere.fit)["coherent_error"], sphere.fit.scale)
        row = rows[name]
        why = "; ".join([*row["reasons"], *row["remarks"]]) or "nothing is near a limit"
        drawn = sphere_picture(sphere.points, sphere.fit.centre, radius, threshold)
        points = save_picture(out, f"sphere_{name}", drawn)
        cells = save_picture(out, f"cells_{name}", cell_picture(sphere.counted, sphere.fit, limit))
        figures += [
            (CAPTION.format(name=name, threshold=threshold), points),
            (CELLS_CAPTION.format(name=name, verdict=_verdict(row), why=why), cells),
        ]
    return Section("Pictures", figures=figures)


def _inputs(report: Mapping[str, Any]) -> Section:
    settings = report["settings"]
    places = [f"{sensor} at {list(place)} mm" for sensor, place in settings["viewpoints_mm"].items()]
    text = (
        f"Clouds in {settings['unit']}; seed {settings['seed']}. Points count "
        + (f"on lines of sight to the ball alone ({', '.join(places)})." if places else "wherever they lie.")
        + (f" Reference in {reference['unit']}." if (reference := settings.get("reference")) else "")
    )
    files = [(row["name"], row["file"]) for row in report["reconstructions"]]
    files += [("reference", file) for file in reference["files"]] if reference else []
    return Section("Files and settings", text, [{"name": name, "file": file} for name, file in files])
