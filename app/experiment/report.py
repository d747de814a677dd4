"""Write the report of the paper's experiment: its conclusions beside the truth that was put in and the paper's."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from app.analysis.drawing.charts_in_common import svg_pdf
from app.analysis.reading.votes_table import ALL
from app.analysis.screening.correlation import spearman
from app.experiment.parts import Figure, wrapped_picture
from app.experiment.results import Results, order_text, screened_out
from app.experiment.sections import experiment_sections
from app.experiment.study import OBJECTIVE_FILE, StudyPart
from app.files import packaged, page_templates, read_json, write_bytes, write_json, write_text

PUBLISHED = "experiment/paper.toml"
QUESTIONS = {
    ALL: "Approaches, best first",
    "depth": "Depth methods, best first",
    "fusion": "View fusions, best first",
    "colour": "Sources of colours, best first",
}
AGREES, OPEN, DIFFERS = "agrees", "not told apart", "differs"  # grades of a conclusion
AGREEMENT = 0.8  # least rank correlation of what was put in and what came out that counts as agreement


def read_results(study: StudyPart, seconds: Mapping[str, float]) -> Results:
    """Read the results from an experiment's folder, once its steps are done."""
    return Results(study.out, study.answers(), read_json(study.out / OBJECTIVE_FILE), study.measures(), seconds)


def write_experiment_report(results: Results, name: str) -> dict[str, Any]:
    """Write report.html and report.json into the experiment's folder; returns the content of report.json.

    Parameters
    ----------
    name : of the scale, "small" or "full"
    """
    published = tomllib.loads(packaged(PUBLISHED).read_text(encoding="utf-8"))
    checks = conclusions(results)
    parts = list(experiment_sections(results, published))
    content = {
        "title": "The paper's experiment, repeated",
        "scale": name,
        "agrees": all(check["agrees"] for check in checks),
        "differs": any(check["grade"] == DIFFERS for check in checks),
        "checks": checks,
        "sections": parts,
        "lead": _lead(results, name),
    }
    template = page_templates("templates/experiment", "templates/analysis").get_template("experiment.html")
    for figure in (figure for part in parts for figure in part.figures if figure.name):
        _write_figure(results.out / "figures" / figure.name, figure)
    write_text(results.out / "report.html", template.render(content))
    report = {
        "schema_version": 1,
        "scale": name,
        "agrees": content["agrees"],
        "checks": checks,
        "tables": {table.key: [dict(zip(table.columns, row, strict=True)) for row in table.rows]
                   for part in parts for table in part.tables if table.key},
        "published": published,
        "abilities": results.answers["abilities"],
        "scores": results.analysis["scores"],
        "measures": results.analysis["measures"],
        "seconds": dict(results.seconds),
    }  # fmt: skip
    write_json(results.out / "report.json", report)
    return report


def _write_figure(stem: Path, figure: Figure) -> None:
    """Write a figure as SVG and PDF."""
    stem.parent.mkdir(exist_ok=True)
    svg = figure.svg or wrapped_picture(figure.pictures[0])
    write_text(stem.with_suffix(".svg"), svg)
    write_bytes(stem.with_suffix(".pdf"), svg_pdf(svg))


def conclusions(results: Results) -> list[dict[str, Any]]:
    """Compare what the experiment concludes with what was put into it."""
    abilities = results.answers["abilities"]
    scores = {
        f"{dataset}/{item}": score
        for dataset in sorted({name.split("/")[0] for name in abilities})
        for item, score in results.scores(ALL, dataset).items()
    }
    names = list(scores)
    rank = spearman(np.array([abilities[name] for name in names]), np.array([scores[name] for name in names]))
    question = f"Rank correlation of the {len(names)} videos' scores with the quality put in"
    checks = [_check(question, "1", f"{rank:.3f}", AGREES if rank >= AGREEMENT else DIFFERS)]
    best, preferred = (next(iter(ranked(ALL, ALL))) for ranked in (results.truth, results.scores))
    checks.append(_check("The preferred approach", best, preferred, _grade_of_best(results, best)))
    for comparison, question in QUESTIONS.items():
        if comparison not in (ALL, *results.factors):
            continue
        truth = results.truth(comparison, ALL)
        came_out = order_text(results.scores(comparison, ALL), results.told_apart(comparison, ALL))
        checks.append(_check(question, order_text(truth), came_out, _grade_of_order(results, comparison, truth)))
    checks += _ratings_check(results, scores)
    failed = [test for _, test in screened_out(results)]
    came_out = f"{len(failed)}: {', '.join(sorted(set(failed))) or 'nobody'}"
    question = "People whom the screening stops"
    checks.append(_check(question, "1, who lacks a cone", came_out, AGREES if failed == ["colour"] else DIFFERS))
    return checks


def _ratings_check(results: Results, scores: Mapping[str, float]) -> list[dict[str, Any]]:
    """Compare the videos' mean ratings with their scores, where there are ratings."""
    rated = results.mean_ratings()
    if not rated:
        return []
    names = [name for name in scores if name in rated]
    rank = spearman(np.array([scores[name] for name in names]), np.array([rated[name] for name in names]))
    question = f"Rank correlation of the {len(names)} videos' ratings with their scores"
    return [_check(question, "1", f"{rank:.3f}", AGREES if rank >= AGREEMENT else DIFFERS)]


def _check(question: str, put_in: str, came_out: str, grade: str) -> dict[str, Any]:
    return {
        "question": question, "put_in": put_in, "came_out": came_out, "grade": grade, "agrees": grade == AGREES,
    }  # fmt: skip


def _grade_of_order(results: Results, comparison: str, truth: Mapping[str, float]) -> str:
    """Grade an order: the votes agree only where they tell all neighbours in the true order apart."""
    clear = results.told_apart(comparison, ALL)
    if any(truth[better] < truth[worse] for better, worse in clear):
        return DIFFERS
    return AGREES if set(pairwise(truth)) <= clear else OPEN


def _grade_of_best(results: Results, best: str) -> str:
    """Grade the preferred approach: the votes agree only where they tell it from every other one."""
    clear = results.told_apart(ALL, ALL)
    others = set(results.truth(ALL, ALL)) - {best}
    if any((other, best) in clear for other in others):
        return DIFFERS
    return AGREES if {(best, other) for other in others} <= clear else OPEN


def _lead(results: Results, name: str) -> str:
    scale = results.objective["scale"]
    width, height = scale["video_size"]
    return (
        f"Scale “{name}”: {len(results.objective['scenes'])} synthetic scenes of {scale['n_frames']} frames, three "
        f"stereo sensors, {len(results.levels)} approaches, {width} × {height} videos of {scale['seconds']:g} s at "
        f"{scale['video_fps']:g} frames a second; {scale['n_spheres']} placed spheres; "
        f"{results.answers['votes']} votes. The recordings are synthetic and the people artificial: they prefer what "
        "was measured to look more like the scene. Numbers of the paper stand beside ours to compare their kind and "
        "order, not their size."
    )
