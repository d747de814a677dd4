"""Write the report's objective sections: the sphere, the cuboid, the models and videos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from app.analysis.drawing.charts_in_common import chart_svg
from app.analysis.reading.votes_table import ALL
from app.experiment.figures import inlier_chart
from app.experiment.parts import Figure, Row, Section, Table, data_url
from app.experiment.results import SPHERE, Results
from app.experiment.study import QUALITY
from app.files import read_json
from app.intake.reports import BETTER

MOST_COLUMNS = 6  # approaches side by side on a printed page


def sphere_section(results: Results, published: Mapping[str, Any]) -> Section:
    report, paper = results.sphere(), published["figure_6"]
    points = results.objective["n_points"]
    subset = "used" if any(row["subset"] == "used" for row in report["curve"]) else "all"
    curve = {(row["sensor"], row["threshold_mm"]): row["inliers"] for row in report["curve"] if row["subset"] == subset}
    sixth = [
        (f"±{float(mm):g} mm", f"{share:.1f}", _percent(curve.get(("combined", float(mm)))))
        for mm, share in paper["inliers"].items()
    ]
    threshold = report["settings"]["table_threshold_mm"]
    fourth = [
        (sensor, f"{share:.2f}", f"{100 - share:.2f}", *_in_and_out(curve.get((sensor, threshold))))
        for sensor, share in published["table_4"].items()
    ]
    here = {sensor: curve[sensor, threshold] for sensor in published["table_4"] if (sensor, threshold) in curve}
    both = paper["inliers"][f"{threshold:g}"]
    fourth.append(("combined", f"{both:.2f}", f"{100 - both:.2f}", *_in_and_out(curve.get(("combined", threshold)))))
    rows = report["reconstructions"]
    text = [
        f"{len({row['sample'] for row in rows})} placed spheres of radius {report['settings']['radius_mm']:g} mm, "
        f"three sensors each, by DR: {_count(min(points))} to {_count(max(points))} points, {_count(fmean(points))} "
        "on average. "
        f"{len({row['sample'] for row in rows if not row['is_excluded']})} placements have a reconstruction that is "
        f"used; left out by rule: {', '.join(row['name'] for row in report['excluded']) or 'none'}. "
        f"The paper: {paper['samples']} reconstructions, {paper['used']} used, {_count(paper['points_mean'])} points "
        "on average.",
        _imaging(results.objective.get("sphere_imaging")),
        f"Sensors, best first: {_order(published['table_4'])} in the paper, {_order(here)} here.",
    ]
    placements = "the placements used" if subset == "used" else "all placements, since none is used,"
    combined = [row for row in report["curve"] if (row["sensor"], row["subset"]) == ("combined", subset)]
    figures = [
        _figure_5(results, rows, threshold),
        Figure(
            "Figure 6. Share of the points within ± t of the fitted sphere's surface, all sensors' points against one "
            f"sphere: mean over {placements} with its 95 % interval (line and band, bootstrap over "
            "placements), and the points that the paper's text gives (diamonds).",
            "figure_6",
            chart_svg(inlier_chart(combined, paper["inliers"])),
        ),
    ]
    tables = [
        Table("figure_6", "Values of figure 6: inliers, all sensors, %", ("threshold", "paper", "here"), sixth),
        Table("table_4", f"Table 4. Single sensors, and all together, at ±{threshold:g} mm, %",
              ("sensor", "inliers, paper", "outliers, paper", "inliers, here", "outliers, here"), fourth),
    ]  # fmt: skip
    return Section("Objective evaluation: spheres", text, tables, figures)


def _imaging(made: Mapping[str, Any] | None) -> str:
    """Say what makes the synthetic spheres hard."""
    if made is None:
        return "Our sphere is matt and textured all over."
    defocus = ", ".join(f"{sensor} {pixels:g}" for sensor, pixels in made["defocus"].items())
    return (
        f"So that our textured sphere is as hard as the paper's: surfaces shine {made['gloss']:g} times as much, noise "
        f"is {made['noise']:g} grey levels, the cameras' colours differ by {made['colour_cast']:.0%}, calibrations err "
        f"by {made['calibration_error_px']:g} px, and the sensors are out of focus (standard deviation, px: {defocus})."
    )


def _order(shares: Mapping[str, float]) -> str:
    return " > ".join(sorted(shares, key=lambda sensor: -shares[sensor])) or "–"


def _figure_5(results: Results, rows: Sequence[Mapping[str, Any]], threshold: float) -> Figure:
    """Return the picture of the used reconstruction with the largest share of outliers, of those that have one."""
    drawn = {row["name"]: picture for row in rows if (picture := _picture(results.out / SPHERE, row["name"])).is_file()}
    row = min((row for row in rows if row["name"] in drawn), key=lambda row: (row["is_excluded"], row["inliers"]))
    outliers = row["n_points"] * (1 - row["inliers"])
    among = "reconstructions, of which none is used," if row["is_excluded"] else "reconstructions used"
    caption = (
        f"Figure 5. Points of reconstruction {row['name']} (grey) with the fitted ideal sphere (circle), from the "
        f"sensor and from the side; to the right of each, its {_count(outliers)} outliers "
        f"beyond ±{threshold:g} mm among {_count(row['n_points'])} points, orange outside and blue inside. Of the "
        f"{among} that have a picture, it has the largest share of outliers."
    )
    return Figure(caption, "figure_5", pictures=[data_url(drawn[row["name"]].read_bytes(), "png")])


def _picture(folder: Path, name: str) -> Path:
    return folder / f"sphere_{name.replace('/', '_')}.png"


def _count(number: float) -> str:
    """Write a count with a space, which does not break, between thousands."""
    return f"{number:,.0f}".replace(",", "\N{NO-BREAK SPACE}")


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f}"


def _in_and_out(share: float | None) -> tuple[str, str]:
    return ("–", "–") if share is None else (f"{100 * share:.2f}", f"{100 - 100 * share:.2f}")


def cuboid_section(results: Results) -> Section:
    report = read_json(results.out / "validation" / "cuboid" / "report.json")
    size = " × ".join(f"{length:g}" for length in report["settings"]["size_mm"])
    together = {row["name"] for row in report["reconstructions"] if row["sensor"] == "combined"}

    def worst_and_mean(part: str, column: str, unit: str) -> Row:
        values = [abs(row[column]) for row in report[part] if row["name"] in together]
        return (f"{fmean(values):.2f} {unit}", f"{max(values):.2f} {unit}") if values else ("–", "–")

    rows = [
        ("angles between faces, error", *worst_and_mean("angles", "error_deg", "°")),
        ("edges, error", *worst_and_mean("edges", "error_mm", "mm")),
        ("flatness of faces, root mean square", *worst_and_mean("faces", "flatness_rms_mm", "mm")),
    ]
    text = (
        f"A box of {size} mm at {len(together)} places, all sensors' points against one box. The paper has none of it."
    )
    return Section("Objective evaluation: cuboid", [text], [Table("cuboid", "", ("", "mean", "worst"), rows)])


def models_section(results: Results) -> Section:
    values: dict[str, dict[str, list[float]]] = {}
    for measure in results.measures:
        values.setdefault(measure.measure, {}).setdefault(measure.approach, []).append(measure.value)
    described = {measure.measure: measure for measure in results.measures}
    approaches = list(results.truth(ALL, ALL))

    def rows(shown: Sequence[str]) -> list[Row]:
        return [
            (name, described[name].unit, BETTER[described[name].direction], *(
                f"{fmean(measured[approach]):#.3g}".rstrip(".") if approach in measured else "–" for approach in shown
            ))
            for name, measured in values.items()
        ]  # fmt: skip

    text = [
        "Means over the scenes; approaches best liked first. Every model of the first frame is compared with "
        "photographs that no sensor uses (novel view), with the true surface (accuracy, completeness), and as a cloud "
        "with samples of the true surface (d1, pointssim). Completeness counts what some sensor can see; d1 and "
        "pointssim also count the surface that no sensor sees. Every video is compared "
        "with that of the true models: ssim_actor and flicker inside the "
        "actor's outline, vmaf over the whole frame.",
        f"The artificial people see “{QUALITY}”. These measures are a few of many: the reports in validation/ have "
        "all, and the documentation says on the page “Measures” what each sees and what it is blind to.",
    ]
    tables = []
    for first in range(0, len(approaches), MOST_COLUMNS):
        shown = approaches[first : first + MOST_COLUMNS]
        key = "models" if not first else f"models_{first // MOST_COLUMNS + 1}"
        tables.append(Table(key, "", ("measure", "unit", "better", *shown), rows(shown)))
    return Section("Objective evaluation: models and videos", text, tables)
