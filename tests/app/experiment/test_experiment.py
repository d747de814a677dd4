"""The paper's experiment: its steps, its artificial people, what it concludes, and one small real run."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import app.experiment.study
import recon.validation.cloud_quality.evaluation
import recon.validation.truth.evaluation
from app.analysis.reading.votes_table import ALL
from app.analysis.report.vote_charts import triads_chart
from app.cli.experiments import Step, run_steps
from app.experiment import reconstruction
from app.experiment.measured import _figure_5, models_section
from app.experiment.reconstruction.objects import sphere_imaging
from app.experiment.report import conclusions
from app.experiment.results import SPHERE, Results, order_text
from app.experiment.study import people, raters, true_abilities
from app.experiment.voted import TRIADS_CAPTION, is_against
from app.intake.reports import Measure
from app.simulation.rating import LOG_ODDS_OF_SCALE
from recon.capture.format import read_capture
from recon.depth import DEFAULTS, PmParameters
from recon.methods.approaches import DEPTH_METHODS, FUSION_METHODS, approaches
from recon.runtime.workers import no_progress
from recon.studio import SynthParameters
from tests.command_line import Command

APPROACHES = [str(approach) for approach in approaches(DEPTH_METHODS, FUSION_METHODS)]
SSIM = dict(zip(APPROACHES, (0.76, 0.78, 0.795, 0.82, 0.806, 0.824), strict=True))


class Clock:
    """A clock that steps move on."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    def step(self, name: str, taken: float) -> Step:
        def run() -> None:
            self.now += taken

        return Step(name, run)


def ssim(dataset: str, values: dict[str, float]) -> list[Measure]:
    return [
        Measure(
            dataset=dataset,
            approach=approach,
            measure=app.experiment.study.QUALITY,
            value=value,
            direction="more is better",
            unit="share",
        )
        for approach, value in values.items()
    ]


def test_steps_are_announced_with_their_number_and_where_to_look(tmp_path: Path) -> None:
    clock, said = Clock(), []
    steps = [clock.step("record", 40.0)._replace(look="left.png"), clock.step("film", 0.24)]
    assert run_steps(steps, tmp_path / "seconds.json", said.append, clock) == {"record": 40.0, "film": 0.2}
    assert said == ["1 of 2: record", "   look at left.png", "2 of 2: film"]


def test_a_step_that_was_there_keeps_the_time_that_it_took_to_make(tmp_path: Path) -> None:
    clock = Clock()
    for taken in (40.0, 0.2):
        seconds = run_steps([clock.step("a", taken)], tmp_path / "seconds.json", lambda _: None, clock)
    assert seconds == {"a": 40.0}


def test_a_step_that_was_interrupted_took_the_time_of_all_its_parts(tmp_path: Path) -> None:
    clock, notes = Clock(), tmp_path / "seconds.json"

    def interrupted() -> None:
        clock.now += 30.0
        raise KeyboardInterrupt

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            run_steps([clock.step("a", 0.0)._replace(run=interrupted)], notes, lambda _: None, clock)
    for taken in (40.0, 0.2):
        assert run_steps([clock.step("a", taken)], notes, lambda _: None, clock) == {"a": 100.0}
    assert json.loads(notes.read_text(encoding="utf-8")) == {"a": 100.0}


def test_what_people_prefer_follows_what_was_measured_in_each_dataset() -> None:
    abilities = true_abilities([*ssim("ball", SSIM), *ssim("box", {one: 0.9 * SSIM[one] for one in APPROACHES})])
    for dataset in ("ball", "box"):
        own = [abilities[f"{dataset}/{approach}"] for approach in APPROACHES]
        assert sum(own) == pytest.approx(0, abs=1e-3)
        assert np.argsort(own).tolist() == np.argsort(list(SSIM.values())).tolist()
    half_as_unlike = true_abilities(ssim("ball", {"id_fa": 0.6, "pm_fb": 0.8}))
    assert half_as_unlike["ball/pm_fb"] - half_as_unlike["ball/id_fa"] == pytest.approx(
        app.experiment.study.LOG_ODDS_PER_OCTAVE
    )


def test_without_the_measure_that_people_see_nobody_prefers_anything() -> None:
    with pytest.raises(ValueError, match="hold no 'novel view SSIM'"):
        true_abilities([])


def test_the_people_are_those_of_table_3_and_one_who_lacks_a_cone() -> None:
    crowd = people(true_abilities(ssim("ball", SSIM)))
    seeing = [one for one in crowd if one.observer.lacks is None]
    assert (len(crowd), len(seeing)) == (23, 22)
    assert Counter(one.answers["sex"] for one in seeing) == {"male": 9, "female": 13}
    assert Counter(one.answers["trained"] for one in seeing) == {"yes": 11, "no": 11}
    ages = [one.answers["age"] for one in seeing]
    assert (min(ages), max(ages)) == (19, 59)
    assert len({tuple((one.abilities or {}).values()) for one in seeing}) == 22


def test_raters_use_the_whole_scale_and_all_prefer_as_before() -> None:
    crowd = people(true_abilities(ssim("ball", SSIM)))
    rating = [person.abilities or {} for person in raters(crowd)]
    assert max(max(one.values()) - min(one.values()) for one in rating) == pytest.approx(LOG_ODDS_OF_SCALE)
    before = [person.abilities for person in crowd if person.abilities]
    assert [sorted(one, key=one.__getitem__) for one in rating] == [sorted(one, key=one.__getitem__) for one in before]


def results(
    scored: dict[str, float], verdicts: tuple[str, ...] = ("passed", "failed"), p_holm: float = 0.001
) -> Results:
    """Results of one dataset whose scores are given, all of them as clearly different as `p_holm` says."""
    rows = [
        {"comparison": "all", "dataset": dataset, "item": item, "score": score}
        for dataset in ("ball", "all")
        for item, score in scored.items()
    ]
    for factor, place in (("depth", slice(0, 2)), ("fusion", slice(3, 5))):
        levels = dict.fromkeys(item[place] for item in scored)
        rows += [
            {"comparison": factor, "dataset": "all", "item": level,
             "score": float(np.mean([score for item, score in scored.items() if item[place] == level]))}
            for level in levels
        ]  # fmt: skip
    clear = [
        {"comparison": one["comparison"], "dataset": "all", "item_a": one["item"], "item_b": other["item"],
         "difference": one["score"] - other["score"], "p_holm": p_holm}
        for one, other in combinations((row for row in rows if row["dataset"] == "all"), 2)
        if one["comparison"] == other["comparison"]
    ]  # fmt: skip
    answers: dict[str, Any] = {
        "abilities": true_abilities(ssim("ball", SSIM)),
        "analysis": {"scores": rows, "contrasts": clear},
        "screening": [{"participant": "P1", "test": "colour", "verdict": verdict} for verdict in verdicts],
    }
    levels = {name: {"depth": name[:2], "fusion": name[3:]} for name in SSIM}
    return Results(Path(), answers, {"levels": levels}, [], {})


def test_conclusions_agree_where_the_scores_are_the_truth() -> None:
    truth = true_abilities(ssim("ball", SSIM))
    checks = conclusions(results({name.split("/")[1]: ability for name, ability in truth.items()}))
    assert [check["agrees"] for check in checks] == [True] * 6
    assert checks[3]["came_out"] == "pm > dr > id"


def test_conclusions_differ_where_the_scores_are_the_truth_upside_down() -> None:
    truth = true_abilities(ssim("ball", SSIM))
    upside_down = {name.split("/")[1]: -ability for name, ability in truth.items()}
    assert [check["agrees"] for check in conclusions(results(upside_down, ("passed",)))] == [False] * 6


@pytest.mark.parametrize(
    ("better", "low", "high", "told"),
    [("higher", -0.9, -0.4, True), ("higher", -0.9, 0.1, False), ("lower", 0.3, 0.8, True),
     ("lower", -0.8, -0.3, False), ("", -0.9, -0.4, False), ("higher", None, None, False)],
)  # fmt: skip
def test_a_measure_that_people_surely_like_the_other_way_gets_its_remark(
    better: str, low: float | None, high: float | None, told: bool
) -> None:
    row = {"measure": "coverage", "dataset": ALL, "better": better, "spearman": low or 0.0, "spearman_low": low,
           "spearman_high": high, "pearson_logistic": None, "pairs_correct": None, "pairs_different": 0}  # fmt: skip
    assert is_against(row) is told


def test_the_caption_of_circular_triads_names_what_the_figure_draws() -> None:
    row = {"participant": "p0", "circular": 1, "strict_by_chance": 2.0, "circular_expected_ties": 1.5}
    drawn = triads_chart({"triads_pooled": [row]}).to_dict()["layer"]
    marks = {layer["mark"].get("shape", layer["mark"]["type"]) for layer in drawn}
    assert marks == {mark for mark in ("bar", "tick", "diamond", "line") if mark in TRIADS_CAPTION}


@pytest.mark.parametrize("is_excluded", [False, True])
def test_figure_5_is_said_to_be_of_those_used_only_where_one_is_used(tmp_path: Path, is_excluded: bool) -> None:
    picture = tmp_path / SPHERE / "sphere_a.png"
    picture.parent.mkdir(parents=True)
    picture.write_bytes(b"")
    row = {"name": "a", "is_excluded": is_excluded, "inliers": 0.9, "n_points": 1000}
    caption = _figure_5(Results(tmp_path, {}, {}, [], {}), [row], 12.5).caption
    assert ("reconstructions used that" in caption) != is_excluded
    assert "the largest share of outliers" in caption


def test_the_sphere_is_made_hard_alike_in_pictures_of_any_width() -> None:
    small, full = sphere_imaging(640), sphere_imaging(1280)
    assert dict(small["defocus"])["S1"] == max(dict(small["defocus"]).values())  # the paper's order of sensors
    assert dict(full["defocus"]) == {name: 2 * px for name, px in small["defocus"]}
    SynthParameters("sphere", n_sensors=3, **full)


def test_an_order_that_the_votes_leave_open_is_not_told_apart() -> None:
    truth = {name.split("/")[1]: ability for name, ability in true_abilities(ssim("ball", SSIM)).items()}
    for scored in (truth, {name: -ability for name, ability in truth.items()}):
        rank, *orders, _ = conclusions(results(scored, p_holm=0.6))
        assert rank["agrees"] is (scored is truth)
        assert [check["grade"] for check in orders] == ["not told apart"] * 4
        assert not any(check["agrees"] for check in orders)
    assert orders[2]["came_out"] == "id ≈ dr ≈ pm"


def test_one_pair_of_neighbours_that_is_left_open_leaves_the_order_open() -> None:
    truth = {name.split("/")[1]: ability for name, ability in true_abilities(ssim("ball", SSIM)).items()}
    nearly = results(truth)
    for row in nearly.analysis["contrasts"]:
        if {row["item_a"], row["item_b"]} == {"id", "dr"}:
            row["p_holm"] = 0.3
    grades = [check["grade"] for check in conclusions(nearly)]
    assert grades == ["agrees"] * 3 + ["not told apart"] + ["agrees"] * 2


def test_a_factor_of_adaptive_pairs_has_the_effects_of_its_levels() -> None:
    """Hardly a pair differs in colour alone, and those few votes tell nothing."""
    effects = [
        {"factor": "colour", "level": level, "dataset": "all", "effect": effect, "letters": letters}
        for level, effect, letters in (("photographs", 6.8, "a"), ("vertices", -6.8, "b"), ("painted", -6.9, "b"))
    ]
    scores = [
        {"comparison": "colour", "dataset": dataset, "item": "vertices", "score": 1.0} for dataset in ("all", "ball")
    ]
    levels = {f"pm_fb_{number}": {"colour": "vertices"} for number in range(15)}
    analysis = {"effects": effects, "scores": scores, "contrasts": []}
    colours = Results(Path(), {"analysis": analysis}, {"levels": levels}, [], {})
    told_apart = colours.told_apart("colour", "all")
    assert order_text(colours.scores("colour", "all"), told_apart) == "photographs > vertices ≈ painted"
    assert told_apart == {("photographs", "vertices"), ("photographs", "painted")}
    assert colours.scores("colour", "ball") == {"vertices": 1.0}


def test_means_of_measures_are_told_with_three_digits_so_that_a_column_compares() -> None:
    of_all = dict.fromkeys(APPROACHES, 0.76) | {"id_fa": 29.96, "id_fb": 27.0, "dr_fa": 118.4, "dr_fb": 0.0}
    table = models_section(replace(results(SSIM), measures=ssim("ball", of_all))).tables[0]
    (row,) = table.rows
    shown = dict(zip(table.columns[3:], row[3:], strict=True))
    assert shown == dict.fromkeys(APPROACHES, "0.760") | {
        "id_fa": "30.0", "id_fb": "27.0", "dr_fa": "118", "dr_fb": "0.00"
    }  # fmt: skip


@pytest.mark.parametrize(
    ("options", "takes"),
    [
        ((), "5.8 h on two idle cores and 81 GB"),
        (("--frames", "5", "--seconds", "5"), "57 min on two idle cores and 6 GB"),
    ],
)
def test_full_says_how_long_it_takes_and_how_much_room_and_waits_to_be_told(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...], takes: str
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=29_400_000_000))
    told = command("experiment", "paper", "-o", tmp_path / "full", "--scale", "full", *options)
    assert told.code == 2
    assert "--yes" in told.err
    assert f"takes about {takes} of disk (29 GB are free), and nobody can be asked here" in told.err
    assert not (tmp_path / "full").exists()


@pytest.mark.parametrize("approach", ["pm_fb", "truth"])
def test_models_by_the_name_of_an_approach_of_the_experiment_are_refused_at_once(tmp_path: Path, approach: str) -> None:
    folders = [models_of(tmp_path / scene, scene, approach) for scene in reconstruction.SCALES["small"].scenes]
    given = reconstruction.Experiment(tmp_path, reconstruction.SCALES["small"], models=tuple(folders))
    with pytest.raises(
        ValueError, match=f"^{approach}: is an approach of the experiment itself; give the models anoth"
    ):
        reconstruction.steps(given)


def models_of(folder: Path, scene: str, approach: str) -> Path:
    """A folder of a scene's models by an approach, one file that nobody reads."""
    (folder / approach).mkdir(parents=True)
    (folder / approach / "0.ply").touch()
    content = {"schema_version": 1, "dataset": scene, "fps": 25, "units": "m", "up": "y", "path": {"orbit": {}}}
    (folder / "scene.json").write_text(json.dumps(content), encoding="utf-8")
    return folder


@pytest.mark.parametrize(
    ("dataset", "sentence"),
    [
        ("dancer", "is of dataset dancer, expected ball or box or people or standing or face"),
        ("ball", "mine: has models of ball, but none of box, people, standing, face; give a folder for each scene"),
    ],
)
def test_models_of_no_scene_of_the_experiment_or_of_some_only_are_refused(
    command: Command, tmp_path: Path, dataset: str, sentence: str
) -> None:
    models = models_of(tmp_path / "models", dataset, "mine")
    told = command("experiment", "paper", "-o", tmp_path / "out", "--models", models)
    assert told.code == 1
    assert sentence in told.err
    assert not (tmp_path / "out").exists()


def test_the_effect_of_a_method_that_has_one_fusion_only_is_told_without_that_fusions() -> None:
    abilities = {"ball/id_fa": -1.0, "ball/id_fb": 1.0, "ball/dr_fa": 0.0, "ball/dr_fb": 2.0, "ball/sgm_fb": 1.5}
    parts = {name: name.removeprefix("ball/").split("_") for name in abilities}
    levels = {"_".join(part): {"depth": part[0], "fusion": part[1]} for part in parts.values()} | {"scanned": {}}
    truth = Results(Path(), {"abilities": abilities | {"ball/scanned": 9.0}}, {"levels": levels}, [], {}).truth
    depth = truth("depth", "ball")
    assert list(depth) == ["dr", "sgm", "id"]
    assert depth["sgm"] - depth["id"] == pytest.approx(0.5)
    assert next(iter(truth("all", "ball"))) == "scanned"


def test_an_unknown_scale_is_wrong_use(command: Command, tmp_path: Path) -> None:
    told = command("experiment", "paper", "-o", tmp_path, "--scale", "huge")
    assert told.code == 2
    assert "expected small or full" in told.err


def test_reports_on_approaches_of_an_earlier_start_do_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scale = replace(reconstruction.SCALES["small"], scenes=("ball",))
    small = reconstruction.Experiment(tmp_path, scale)
    monkeypatch.setattr(reconstruction.plan, "surfaces", lambda *_: {"pm_fb": None})
    for name in ("truth/ball_sgm_fb", "truth/ball_pm_fb", "sphere"):
        small.report(name).mkdir(parents=True)
        (small.report(name) / "report.json").write_text('{"reconstructions": []}', encoding="utf-8")
    small.stimuli.mkdir()
    (small.stimuli / "manifest.json").write_text('{"stimuli": []}', encoding="utf-8")
    reconstruction.plan.write_objective(small, no_progress)
    reports = json.loads((tmp_path / "objective.json").read_text(encoding="utf-8"))["reports"]
    assert "validation/truth/ball_pm_fb" in reports
    assert "validation/truth/ball_sgm_fb" not in reports


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scale `small`, but so that it takes twenty seconds: one scene, one ball, three people, two sweeps of PM."""
    scale = reconstruction.Scale((108, 192), (140, 140), 2, 10.0, 1, 1, (96, 54), 25.0, 0.2, ("ball",))
    monkeypatch.setitem(reconstruction.SCALES, "small", scale)
    monkeypatch.setitem(DEFAULTS, "pm", PmParameters(sweeps=2))
    monkeypatch.setattr(recon.validation.truth.evaluation, "N_SAMPLES", 2000)
    monkeypatch.setattr(recon.validation.cloud_quality.evaluation, "USUAL_POINTS", 2000)
    for name, value in {"N_PEOPLE": 3, "N_MEN": 1, "N_TRAINED": 2, "LACKING": 1}.items():
        monkeypatch.setattr(app.experiment.study, name, value)


@pytest.mark.slow
@pytest.mark.usefixtures("tiny")
def test_a_small_experiment_ends_in_a_report_and_is_not_done_twice(command: Command, tmp_path: Path) -> None:
    out = tmp_path / "paper"
    asked = ("experiment", "paper", "-o", out, "--frames", "1", "--approach", "sgm_fb", "--ratings", "--json")
    told = command(*asked)
    assert told.code == 0, told.err
    report = json.loads(told.out)
    assert (read_capture(out / "captures" / "ball").n_frames, read_capture(out / "captures" / "ball").fps) == (1, 5.0)
    wanted = {f"table_{n}" for n in range(1, 5)} | {f"figure_{n}" for n in range(6, 9)} | {"measures", "cuboid"}
    assert wanted <= report["tables"].keys()
    assert {row["measure"] for row in report["tables"]["models"]} == set(app.experiment.study.MEASURES)
    assert {row["measure"] for row in report["measures"]} == set(app.experiment.study.MEASURES)
    compared = {*APPROACHES, "sgm_fb"}
    assert {name.split("/")[1] for name in report["abilities"]} == compared
    assert {score["item"] for score in report["scores"] if score["comparison"] == "all"} == compared
    assert {row["approach"] for row in report["tables"]["ratings"]} == compared
    stimuli = json.loads((out / "stimuli" / "manifest.json").read_text(encoding="utf-8"))["stimuli"]
    assert {stimulus["approach"] for stimulus in stimuli} == {*compared, "truth"}
    checks = {check["question"].split(" ")[0]: check for check in report["checks"]}
    assert checks["People"]["agrees"]
    assert float(checks["Rank"]["came_out"]) > 0.4  # of three people
    page = (out / "report.html").read_text(encoding="utf-8")
    assert 'src="http' not in page
    assert page.count("<svg") >= 5
    for number in (5, 6, 7, 8):
        assert (out / f"figures/figure_{number}.pdf").read_bytes().startswith(b"%PDF")
        assert f"Figure {number}. " in page
    votes = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.suffix in (".mp4", ".ply", ".sqlite")}
    again = command(*asked)
    assert json.loads(again.out)["checks"] == report["checks"]
    assert {path: path.stat().st_mtime_ns for path in votes} == votes
