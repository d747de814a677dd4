"""The report of the paper's experiment: its conclusions beside the truth that was put in and the paper's numbers."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from app.analysis.contrasts import SIGNIFICANT
from app.analysis.correlation import spearman
from app.experiment.sections import Results, experiment_sections, order_text, screened_out
from app.experiment.study import OBJECTIVE_FILE, StudyPart
from app.files import packaged, read_json, write_json, write_text

PUBLISHED = "experiment/paper.toml"
QUESTIONS = {
    "all": "Approaches, best first",
    "depth": "Depth methods, best first",
    "fusion": "View fusions, best first",
}
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
        "checks": checks,
        "sections": parts,
        "lead": _lead(results, name),
    }
    environment = Environment(
        loader=FileSystemLoader([packaged("templates/experiment"), packaged("templates/analysis")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    write_text(results.out / "report.html", environment.get_template("experiment.html").render(content))
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


def conclusions(results: Results) -> list[dict[str, Any]]:
    """Compare what the experiment concludes with what was put into it."""
    names = sorted(results.answers["abilities"])
    scores = {dataset: results.scores("all", dataset) for dataset in {name.split("/")[0] for name in names}}
    put_in = np.array([results.answers["abilities"][name] for name in names])
    measured = np.array([scores[name.split("/")[0]][name.split("/")[1]] for name in names])
    rank = spearman(put_in, measured)
    question = f"Rank correlation of the {len(names)} videos' scores with the quality put in"
    checks = [_check(question, "1", f"{rank:.3f}", agrees=rank >= AGREEMENT)]
    best, preferred = (next(iter(ranked("all", "all"))) for ranked in (results.truth, results.scores))
    agrees = preferred == best or {best, preferred} in results.alike("all", "all")
    checks.append(_check("The preferred approach", best, preferred, agrees=agrees))
    for comparison, question in QUESTIONS.items():
        truth = results.truth(comparison, "all")
        came_out = order_text(results.scores(comparison, "all"), results.alike(comparison, "all"))
        agrees = not _contradictions(results, comparison, truth)
        checks.append(_check(question, order_text(truth), came_out, agrees=agrees))
    failed = [test for _, test in screened_out(results)]
    came_out = f"{len(failed)}: {', '.join(sorted(set(failed))) or 'nobody'}"
    question = "People whom the screening stops"
    checks.append(_check(question, "1, who lacks a cone", came_out, agrees=failed == ["colour"]))
    return checks


def _check(question: str, put_in: str, came_out: str, *, agrees: bool) -> dict[str, Any]:
    return {"question": question, "put_in": put_in, "came_out": came_out, "agrees": agrees}


def _contradictions(results: Results, comparison: str, truth: Mapping[str, float]) -> list[str]:
    """List the pairs whose scores clearly contradict the truth."""
    return [
        f"{row['item_a']}, {row['item_b']}"
        for row in results.contrasts(comparison, "all")
        if row["p_holm"] < SIGNIFICANT and row["difference"] * (truth[row["item_a"]] - truth[row["item_b"]]) < 0
    ]


def _lead(results: Results, name: str) -> str:
    scale = results.objective["scale"]
    width, height = scale["video_size"]
    return (
        f"Scale “{name}”: {len(results.objective['scenes'])} synthetic scenes of {scale['n_frames']} frames, three "
        f"stereo sensors, six approaches, {width} × {height} videos of {scale['seconds']:g} s at "
        f"{scale['video_fps']:g} frames a second; {scale['n_spheres']} placed spheres; "
        f"{results.answers['votes']} votes. The recordings are synthetic and the people artificial: they prefer what "
        "was measured to look more like the scene. Numbers of the paper stand beside ours to compare their kind and "
        "order, not their size."
    )
