"""The parts of the experiment's report: the paper's tables and figures from our data, beside what was published."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory
from typing import Any

from app.analysis.charts import chart_svg, scores_chart, triads_chart
from app.analysis.contrasts import SIGNIFICANT
from app.analysis.objective.charts import measure_chart, ranking_chart
from app.analysis.objective.prediction import measures_by_rank
from app.experiment.study import N_PEOPLE, QUALITY, TRUTH
from app.files import read_json
from app.films.strips import write_still
from app.intake.reports import BETTER, Measure
from app.intake.stimuli import MANIFEST

LIKED = {"depth": "depth reconstruction", "fusion": "view fusion"}
HERE = {  # table 1
    "id": "cost-volume filtering by a permeability filter, hierarchical search, left/right check; whole disparities",
    "dr": "the same; parabola, holes filled, costs aggregated once more along the surface found",
    "pm": "PatchMatch on slanted planes, 35 × 35, seeded by ID; float disparities",
    "fa": "a surface per sensor (APSS, marching cubes), then one mesh as their union",
    "fb": "one cloud as the union of the sensors' clouds, then its surface",
}
PARAMETERS = {  # table 2: name, and where our value comes from
    "census_window": ("Cost computation: census window", "{census_window} × {census_window}"),
    "permeability_sigma": ("Cost aggregation: permeability σ", "{id[sigma]:g}"),
    "hierarchy_levels": ("Hierarchical matching: levels", "0 – {id[levels]}"),
    "consistency_threshold": ("Left/right consistency threshold", "{id[consistency_threshold]}"),
    "temporal_sigma": ("Temporal filtering: permeability σ", "{temporal[sigma]:g}"),
    "temporal_sigma_disparity": ("Temporal filtering: consistency σ′", "{temporal[sigma_disparity]:g}"),
}

Row = Sequence[str]


@dataclass(frozen=True)
class Table:
    """A table; `key` is its name in paper.toml, where it has one."""

    key: str
    title: str
    columns: Row
    rows: Sequence[Row]


@dataclass(frozen=True)
class Figure:
    """A figure: SVG text, or pictures as data URLs."""

    caption: str
    svg: str = ""
    pictures: Sequence[str] = ()


@dataclass(frozen=True)
class Section:
    title: str
    paragraphs: Sequence[str]
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()


@dataclass(frozen=True)
class Results:
    """What the report is made from.

    Parameters
    ----------
    out : the experiment's folder
    answers : what the people answered, with the truth that was put in
    objective : how it was measured, with which parameters
    measures : what was measured of the approaches
    seconds : that each step took
    """

    out: Path
    answers: Mapping[str, Any]
    objective: Mapping[str, Any]
    measures: Sequence[Measure]
    seconds: Mapping[str, float]

    @property
    def analysis(self) -> Mapping[str, Any]:
        analysis: Mapping[str, Any] = self.answers["analysis"]
        return analysis

    def scores(self, comparison: str, dataset: str) -> dict[str, float]:
        """Return the scores by item, best first."""
        rows = [r for r in self.analysis["scores"] if (r["comparison"], r["dataset"]) == (comparison, dataset)]
        return dict(sorted(((r["item"], r["score"]) for r in rows), key=lambda pair: -pair[1]))

    def contrasts(self, comparison: str, dataset: str) -> list[Mapping[str, Any]]:
        """Return the differences of scores with their p-values."""
        rows = self.analysis["contrasts"]
        return [row for row in rows if (row["comparison"], row["dataset"]) == (comparison, dataset)]

    def alike(self, comparison: str, dataset: str) -> list[set[str]]:
        """Return the pairs that the votes do not tell apart."""
        rows = self.contrasts(comparison, dataset)
        return [{row["item_a"], row["item_b"]} for row in rows if row["p_holm"] >= SIGNIFICANT]

    def truth(self, comparison: str, dataset: str) -> dict[str, float]:
        """Return what was put in: the mean ability by item or level, best first."""
        values: dict[str, list[float]] = {}
        for name, ability in self.answers["abilities"].items():
            scene, approach = name.split("/")
            if dataset in ("all", scene):
                level = {"all": approach, "depth": approach[:2], "fusion": approach[3:]}[comparison]
                values.setdefault(level, []).append(ability)
        return dict(sorted(((item, fmean(abilities)) for item, abilities in values.items()), key=lambda pair: -pair[1]))


def experiment_sections(results: Results, published: Mapping[str, Any]) -> Iterator[Section]:
    """Yield the parts of the report, in the paper's order.

    Parameters
    ----------
    published : the content of paper.toml
    """
    yield _material(results, published)
    yield _approaches(results, published)
    yield _people(results, published)
    yield _sphere(results, published)
    yield _cuboid(results)
    yield _models(results)
    yield _subjective(results, published)
    yield _objective_against_subjective(results)
    yield _course(results)


def _material(results: Results, published: Mapping[str, Any]) -> Section:
    best, worst = (list(results.truth("all", "all"))[place] for place in (0, -1))
    stimuli = read_json(results.out / "stimuli" / MANIFEST)["stimuli"]
    figures = []
    for approach in (best, worst, TRUTH):
        videos = [stimulus for stimulus in stimuli if stimulus["approach"] == approach]
        pictures = [_still(results.out / "stimuli", video) for video in videos]
        names = ", ".join(video["dataset"] for video in videos)
        how = "the truth, which nobody votes on" if approach == TRUTH else f"by {approach}"
        figures.append(Figure(f"Figure 2. {names}, {how}.", pictures=pictures))
    trials = published["trials"]
    rows = [
        ("videos", str(trials["videos"]), str(sum(stimulus["approach"] != TRUTH for stimulus in stimuli))),
        ("seconds each", f"{trials['seconds']}", f"{results.objective['scale']['seconds']:g}"),
        ("comparisons of a participant", str(trials["comparisons"]), str(results.answers["study"]["n_pairs"])),
    ]
    text = "Every scene by every approach, seen from a camera that moves from the first sensor to the last."
    return Section("Test material", [text], [Table("trials", "", ("", "paper", "here"), rows)], figures)


def _still(folder: Path, stimulus: Mapping[str, Any]) -> str:
    with TemporaryDirectory() as temporary:
        path = Path(temporary) / "still.jpg"
        write_still(folder / stimulus["video"], path, row=0, width=stimulus["width"], height=stimulus["height"])
        return _address(path.read_bytes(), "jpeg")


def _address(picture: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode('ascii')}"


def _approaches(results: Results, published: Mapping[str, Any]) -> Section:
    first = [(name.upper(), published["table_1"][name], text) for name, text in HERE.items()]
    given = {**results.objective, **results.objective["parameters"]}
    second = [
        (name, str(published["table_2"][key]), form.format_map(given)) for key, (name, form) in PARAMETERS.items()
    ]
    tables = [
        Table("table_1", "Table 1. Compared approaches", ("", "paper", "here"), first),
        Table("table_2", "Table 2. Parameters", ("", "paper", "here"), second),
    ]
    return Section("Approaches", ["An approach is a depth method with a view fusion, pm_fb for example."], tables)


def _people(results: Results, published: Mapping[str, Any]) -> Section:
    paper, failed = published["table_3"], screened_out(results)
    answers: dict[str, dict[str, Any]] = {}
    for row in results.answers["questionnaire"]:
        answers.setdefault(row["question"], {})[row["participant"]] = row["answer"]
    ages = [float(age) for age in answers["age"].values()]
    sexes, trained = list(answers["sex"].values()), list(answers["trained"].values())
    rows = [
        ("participants", str(paper["participants"]), str(len(ages))),
        ("male, female", f"{paper['male']}, {paper['female']}", f"{sexes.count('male')}, {sexes.count('female')}"),
        ("experienced: yes, no", f"{paper['experienced']}, {paper['inexperienced']}",
         f"{trained.count('yes')}, {trained.count('no')}"),
        ("age: youngest, oldest, mean", f"{paper['age_min']}, {paper['age_max']}, {paper['age_mean']}",
         f"{min(ages):g}, {max(ages):g}, {fmean(ages):.1f}"),
        ("failed the screening besides", str(paper["screened_out"]), f"{len(failed)} ({_tests(failed)})"),
    ]  # fmt: skip
    acuities = [row["logmar"] for row in results.answers["screening"] if row["logmar"] is not None]
    text = (
        f"{N_PEOPLE + 1} artificial people took the screening over HTTP by looking at its pictures: Landolt rings "
        f"(best {min(acuities):+.2f} logMAR, worst {max(acuities):+.2f}) and plates of coloured dots. Who failed "
        "took no part."
    )
    return Section("Participants", [text], [Table("table_3", "Table 3. Demographics", ("", "paper", "here"), rows)])


def screened_out(results: Results) -> list[tuple[str, str]]:
    """Return participant and test of every failed screening."""
    return [(row["participant"], row["test"]) for row in results.answers["screening"] if row["verdict"] == "failed"]


def _tests(failed: Sequence[tuple[str, str]]) -> str:
    return ", ".join(test for _, test in failed) or "nobody"


def _sphere(results: Results, published: Mapping[str, Any]) -> Section:
    folder = results.out / "validation" / "sphere"
    report, paper = read_json(folder / "report.json"), published["figure_6"]
    points = results.objective["n_points"]
    curve = {(row["sensor"], row["threshold_mm"]): row["inliers"] for row in report["curve"] if row["subset"] == "used"}
    sixth = [
        (f"±{float(mm):g} mm", f"{share:.1f}", _percent(curve.get(("combined", float(mm)))))
        for mm, share in paper["inliers"].items()
    ]
    threshold = report["settings"]["table_threshold_mm"]
    fourth = [
        (sensor, f"{share:.2f}", f"{100 - share:.2f}", *_in_and_out(curve.get((sensor, threshold))))
        for sensor, share in published["table_4"].items()
    ]
    rows, names = report["reconstructions"], [row["name"] for row in report["reconstructions"]]
    used = [row["sample"] for row in rows if not row["is_excluded"]]
    pictured = next((n for n in _used_first(rows) if _picture(folder, n).is_file()), names[0])
    text = [
        f"{len({row['sample'] for row in rows})} placed spheres of radius {report['settings']['radius_mm']:g} mm, "
        f"three sensors each, by DR: {min(points)} to {max(points)} points, {fmean(points):.0f} on average. "
        f"{len(set(used))} placements have a reconstruction that is used; left out by rule: "
        f"{', '.join(row['name'] for row in report['excluded']) or 'none'}. "
        f"The paper: {paper['samples']} reconstructions, {paper['used']} used, {paper['points_mean']:.0f} points on "
        "average.",
        "Our sphere is matt and textured all over, and its cameras are calibrated better than real ones, so that more "
        "points are inliers.",
    ]  # fmt: skip
    figures = [
        Figure(
            f"Figure 5. Reconstruction {pictured} with its sphere, from the sensor and from the side; right: outliers "
            f"beyond ±{threshold:g} mm.",
            pictures=[_address(_picture(folder, pictured).read_bytes(), "png")],
        ),
        Figure("Figure 6. Share of inliers against the threshold.", svg=_svg(folder / "curve.svg")),
    ]
    tables = [
        Table("figure_6", "Figure 6. Inliers of the combined clouds, %", ("threshold", "paper", "here"), sixth),
        Table("table_4", f"Table 4. Single sensors at ±{threshold:g} mm, %",
              ("sensor", "inliers, paper", "outliers, paper", "inliers, here", "outliers, here"), fourth),
    ]  # fmt: skip
    return Section("Objective evaluation: spheres", text, tables, figures)


def _used_first(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    return [row["name"] for row in sorted(rows, key=lambda row: bool(row["is_excluded"]))]


def _picture(folder: Path, name: str) -> Path:
    return folder / f"sphere_{name.replace('/', '_')}.png"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f}"


def _in_and_out(share: float | None) -> tuple[str, str]:
    return ("–", "–") if share is None else (f"{100 * share:.2f}", f"{100 - 100 * share:.2f}")


def _svg(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    return text[text.index("<svg") :]


def _cuboid(results: Results) -> Section:
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


def _models(results: Results) -> Section:
    values: dict[str, dict[str, list[float]]] = {}
    for measure in results.measures:
        values.setdefault(measure.measure, {}).setdefault(measure.approach, []).append(measure.value)
    described = {measure.measure: measure for measure in results.measures}
    approaches = list(results.truth("all", "all"))
    rows = [
        (name, described[name].unit, BETTER[described[name].direction], *(
            f"{fmean(measured[approach]):.3g}" if approach in measured else "–" for approach in approaches
        ))
        for name, measured in values.items()
    ]  # fmt: skip
    text = [
        "Means over the scenes; approaches best liked first. Every model of the first frame is compared with "
        "photographs that no sensor uses (novel view), with the true surface (accuracy, completeness), and as a cloud "
        "with samples of the true surface (d1, pointssim). Completeness, d1 and pointssim also count the surface that "
        "no sensor sees. Every video is compared with that of the true models: ssim_actor and flicker inside the "
        "actor's outline, vmaf over the whole frame.",
        f"The artificial people see “{QUALITY}”. These measures are a few of many: the reports in validation/ have "
        "all, and the documentation says on the page “Measures” what each sees and what it is blind to.",
    ]
    columns = ("measure", "unit", "better", *approaches)
    return Section("Objective evaluation: models and videos", text, [Table("models", "", columns, rows)])


def _subjective(results: Results, published: Mapping[str, Any]) -> Section:
    tables, figures = [], []
    for number, comparison in ((7, "depth"), (8, "fusion")):
        paper, rows = published[f"figure_{number}"], []
        for dataset in [*results.objective["scenes"], "all"]:
            scored = results.scores(comparison, dataset)
            told = "; ".join(f"{item} {score:+.2f}" for item, score in scored.items())
            here = order_text(scored, results.alike(comparison, dataset))
            truth = order_text(results.truth(comparison, dataset))
            rows.append((dataset, order_text(paper.get(dataset, ())), here, told, truth))
        columns = ("dataset", "paper", "here", "scores, log-odds", "put in")
        tables.append(Table(f"figure_{number}", f"Figure {number}. {LIKED[comparison].capitalize()}", columns, rows))
        chart = scores_chart(results.analysis, comparison)
        figures.append(Figure(f"Figure {number}. Scores of {LIKED[comparison]} with 95 % intervals.", chart_svg(chart)))
    circular = sum(row["circular"] for row in results.analysis["triads"])
    most = sum(row["circular_max"] or 0 for row in results.analysis["triads"])
    flagged = [row["participant"] for row in results.analysis["observers"] if row["flags"]]
    text = [
        "Bradley-Terry scores with ties (Davidson), pairs that differ in the factor only, intervals with people as the "
        "sample. ≈ stands between neighbours that the votes do not tell apart (5 %, Holm).",
        f"Circular triads: {circular} of at most {most}; the paper found {published['trials']['circular_triads']}. "
        "People who choose by chance between similar videos make some, so this is no reason to exclude anybody"
        f"{'; something else is unusual about ' + ', '.join(flagged) if flagged else ''}.",
    ]
    triads = triads_chart(results.analysis)
    extra = [] if triads is None else [Figure("Circular triads of each participant.", chart_svg(triads))]
    return Section("Subjective evaluation", text, tables, [*figures, *extra])


def _objective_against_subjective(results: Results) -> Section:
    overall = {row["measure"]: row for row in results.analysis["measures"] if row["dataset"] == "all"}
    ranked = [overall[name] for name in measures_by_rank(results.analysis["measures"]) if name in overall]
    rows = [
        (row["measure"], row["better"], _signed(row["spearman"]), _between(row, "spearman"),
         _signed(row["pearson_logistic"]),
         f"{row['pairs_correct']:.0%} of {row['pairs_different']}" if row["pairs_correct"] is not None else "–")
        for row in ranked
    ]  # fmt: skip
    columns = ("measure", "better", "rank correlation", "95 % interval", "PLCC", "clear pairs in order")
    text = (
        "Which measure would have predicted the votes? Correlations over all scenes, each relative to its mean; PLCC "
        "is after a logistic fit; negative where less of a measure is better. The intervals hold for measures: one of "
        f"random numbers excludes zero in 5 % of experiments. “{QUALITY}” is what the people were told to see."
    )
    best = next((row["measure"] for row in ranked if row["measure"] != QUALITY), QUALITY)
    charts = [("How well each measure predicts the scores.", ranking_chart(results.analysis))]
    charts += [
        (f"Scores against {name}.", measure_chart(results.analysis, name)) for name in dict.fromkeys((QUALITY, best))
    ]
    figures = [Figure(caption, chart_svg(chart)) for caption, chart in charts if chart is not None]
    return Section("Objective against subjective", [text], [Table("measures", "", columns, rows)], figures)


def _course(results: Results) -> Section:
    seconds = {**results.seconds, "all": sum(results.seconds.values())}
    rows = [(name, f"{taken / 60:.1f} min") for name, taken in seconds.items()]
    text = (
        "Started again, the command makes only what is missing. Every part has a report of its own in validation/; the "
        "study and its films are in the folder study-…, to be looked at with RECONSTUDY_DATA_DIR=that folder "
        "reconstudy serve."
    )
    return Section("How long it took", [text], [Table("seconds", "", ("step", "time"), rows)])


def _signed(value: float | None) -> str:
    return "–" if value is None else f"{value:+.2f}"


def _between(row: Mapping[str, Any], name: str) -> str:
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    return "–" if low is None else f"{low:+.2f} to {high:+.2f}"


def order_text(items: Sequence[str] | Mapping[str, float], alike: Sequence[set[str]] = ()) -> str:
    """Write items as "pm ≈ dr > id"; ≈ stands between neighbours that the votes do not tell apart."""
    names = list(items)
    text = names[0] if names else "–"
    for before, name in pairwise(names):
        text += f" {'≈' if {before, name} in alike else '>'} {name}"
    return text
