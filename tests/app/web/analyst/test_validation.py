"""Reports of objective evaluation, attached to a study and compared with its scores."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.operations.studies import manage
from app.settings import Settings
from app.simulation.participants import simulate
from app.web.admin.results.objective_view import SHOWN, measure_lines, report_view
from tests.app.web.admin.dashboard_client import signed_in

pytestmark = pytest.mark.slow

ABILITIES = {"id_fa": -2.0, "id_fb": 0.0, "pm_fb": 2.0}
ACCURACY = {"id_fa": 3.0, "id_fb": 2.0, "pm_fb": 1.0}


def write_report(folder: Path, measures: list[dict[str, Any]]) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "report.json").write_text(json.dumps({"kind": "mesh", "measures": measures}), encoding="utf-8")
    return folder


def accuracy(dataset: str, approach: str, value: float) -> dict[str, Any]:
    facts = {"measure": "accuracy", "direction": "less is better", "unit": "mm"}
    return {"dataset": dataset, "approach": approach, "value": value, **facts}


@pytest.fixture
def report(tmp_path: Path) -> Path:
    """Accuracies of all three approaches, whatever the dataset, and one that no study here compares."""
    rows = [accuracy("all", approach, value) for approach, value in ACCURACY.items()]
    return write_report(tmp_path / "report", [*rows, accuracy("statue", "dr_fa", 9.0)])


def test_an_attached_measure_holds_for_every_dataset_and_can_be_fetched(
    analyst: httpx.Client, settings: Settings, new_study: Callable[[], dict[str, Any]], report: Path
) -> None:
    study = new_study()
    found = manage.attach_results(settings, [report], study["slug"])
    assert (found["n_values"], found["ignored"]) == (6, ["statue/dr_fa"])
    path = f"/api/v1/studies/{study['slug']}/validation"
    rows = analyst.get(path).json()
    assert {(row["dataset"], row["approach"], row["value"]) for row in rows} == {
        (dataset, approach, value) for dataset in ("ball", "box") for approach, value in ACCURACY.items()
    }
    table = list(csv.DictReader(io.StringIO(analyst.get(path, params={"format": "csv"}).text)))
    assert list(table[0])[:7] == ["dataset", "approach", "measure", "value", "direction", "unit", "better"]
    assert list(table[0])[7:] == ["source", "attached_at"]
    assert {row["better"] for row in table} == {"lower"}


PSNR = """dataset,approach,frame,measure,direction,value,unit,better,source
ball,id_fa,0,psnr,symmetric,30,dB,higher,lab
ball,id_fa,1,psnr,symmetric,32,dB,higher,lab
ball,pm_fb,,psnr,symmetric,inf,dB,higher,lab
statue,id_fa,,psnr,symmetric,25,dB,higher,lab
all,id_fb,,psnr,symmetric,40,dB,higher,lab
ball,id_fa,,psnr,reference_to_distorted,29,dB,higher,lab
"""


@pytest.fixture
def psnr(tmp_path: Path) -> Path:
    """Somebody else's table of measures."""
    path = tmp_path / "their values.csv"
    path.write_text(PSNR, encoding="utf-8")
    return path


def test_a_table_of_anybodys_measures_is_attached_with_its_sources(
    analyst: httpx.Client, settings: Settings, new_study: Callable[[], dict[str, Any]], psnr: Path, tmp_path: Path
) -> None:
    study = new_study()
    attached = manage.attach_results(settings, [psnr], study["slug"])
    assert attached["measures"] == ["psnr", "psnr (reference to distorted)"]
    assert attached["ignored"] == ["statue/id_fa"]
    assert attached["notes"] == [
        "psnr is the mean of 2 frames",
        "psnr leaves out what has no finite value: ball/pm_fb (+inf)",
    ]
    path = f"/api/v1/studies/{study['slug']}/validation"
    rows = analyst.get(path).json()
    assert {(row["dataset"], row["approach"], row["value"]) for row in rows if row["measure"] == "psnr"} == {
        ("ball", "id_fa", 31.0),
        ("ball", "id_fb", 40.0),
        ("box", "id_fb", 40.0),
    }
    assert {(row["better"], row["unit"], row["source"]) for row in rows} == {("higher", "dB", "lab")}
    again = tmp_path / "validation.csv"
    again.write_text(analyst.get(path, params={"format": "csv"}).text, encoding="utf-8")
    assert manage.attach_results(settings, [again], study["slug"])["n_values"] == len(rows)


def test_a_reports_values_are_those_of_its_table_of_measures(
    analyst: httpx.Client, settings: Settings, new_study: Callable[[], dict[str, Any]], report: Path
) -> None:
    study = new_study()
    row = "ball,id_fa,,accuracy,,4.5,mm,lower,validate mesh\n"
    (report / "measures.csv").write_text(PSNR.splitlines()[0] + "\n" + row, encoding="utf-8")
    manage.attach_results(settings, [report], study["slug"])
    (only,) = analyst.get(f"/api/v1/studies/{study['slug']}/validation").json()
    assert (only["value"], only["source"]) == (4.5, "validate mesh")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("ball,id_fa,psnr,1,lower", "better of psnr is 'lower' for ball/id_fa and 'higher' for"),
        ("statue,id_fa,psnr,1,higher", "compares id_fa, id_fb, pm_fb in ball, box"),
        (
            "\n".join(f"ball,a_{number},psnr,1,higher" for number in range(14)),
            "this describes ball/a_0, .*, ball/a_11 and 2 more; the study",
        ),
        ("ball,id_fa,psnr,inf,higher", "no value that can be attached: psnr leaves out .*ball/id_fa"),
        ("ball,id_fa,psnr,1;5,higher", "odd.csv: row 1: value is '1;5'"),
        ("", "odd.csv: holds no value that can be attached: it has no row below its header"),
    ],
)
def test_a_table_that_contradicts_the_study_is_refused_as_a_whole(
    analyst: httpx.Client, settings: Settings, study: dict[str, Any], psnr: Path, tmp_path: Path, row: str, message: str
) -> None:
    manage.attach_results(settings, [psnr], study["slug"])
    before = analyst.get(f"/api/v1/studies/{study['slug']}/validation").json()
    odd = tmp_path / "odd.csv"
    odd.write_text(f"dataset,approach,measure,value,better\n{row}\n", encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        manage.attach_results(settings, [odd], study["slug"])
    assert analyst.get(f"/api/v1/studies/{study['slug']}/validation").json() == before


def test_of_a_report_only_chosen_measures_are_attached(
    analyst: httpx.Client, settings: Settings, new_study: Callable[[], dict[str, Any]], report: Path, psnr: Path
) -> None:
    study = new_study()
    with pytest.raises(ValueError, match="no measure 'vmaf' in what is attached; there are accuracy, psnr"):
        manage.attach_results(settings, [report, psnr], study["slug"], only=["psnr", "vmaf"])
    attached = manage.attach_results(settings, [report, psnr], study["slug"], only=["psnr"])
    assert attached["measures"] == ["psnr"]
    rows = analyst.get(f"/api/v1/studies/{study['slug']}/validation").json()
    assert {row["measure"] for row in rows} == {"psnr"}


def test_attaching_again_replaces_the_value(
    analyst: httpx.Client, settings: Settings, new_study: Callable[[], dict[str, Any]], report: Path, tmp_path: Path
) -> None:
    study = new_study()
    manage.attach_results(settings, [report], study["slug"])
    better = write_report(tmp_path / "better", [accuracy("ball", "id_fa", 0.5)])
    manage.attach_results(settings, [better / "report.json"], study["slug"])
    rows = analyst.get(f"/api/v1/studies/{study['slug']}/validation").json()
    values = {(row["dataset"], row["approach"]): row["value"] for row in rows}
    assert len(rows) == 6
    assert (values["ball", "id_fa"], values["box", "id_fa"]) == (0.5, 3.0)


def test_a_report_that_names_no_approach_is_shown_for_the_study_as_a_whole(
    server: str, analyst: httpx.Client, settings: Settings, new_study: Callable[[], dict[str, Any]], tmp_path: Path
) -> None:
    study, folder = new_study(), write_report(tmp_path / "cuboid", [])
    (folder / "edges.csv").write_text("sensor,error\nS1,2.5\n", encoding="utf-8")
    found = manage.attach_results(settings, [folder], study["slug"])
    assert (found["reports"], found["n_values"]) == (1, 0)
    assert analyst.get(f"/api/v1/studies/{study['slug']}/validation").json() == []
    with signed_in(server, settings, "Whole") as dashboard:
        page = dashboard.get(f"/admin/studies/{study['slug']}/objective").text
        assert "the whole study" in page
        assert "Edges" in page
    with pytest.raises(ValueError, match="2 reports of kind mesh name no approach"):
        manage.attach_results(settings, [folder, folder], study["slug"])


def test_a_large_measure_is_shown_with_all_of_its_digits(
    server: str, settings: Settings, new_study: Callable[[], dict[str, Any]], tmp_path: Path
) -> None:
    study = new_study()
    size = accuracy("ball", "id_fa", 1865233.0) | {"measure": "bytes", "unit": "bytes"}
    manage.attach_results(settings, [write_report(tmp_path / "sizes", [size])], study["slug"])
    with signed_in(server, settings, "Large") as dashboard:
        assert "<td>1\u202f865\u202f233</td>" in dashboard.get(f"/admin/studies/{study['slug']}/objective").text


def test_measures_stand_beside_the_scores(
    server: str,
    token: str,
    analyst: httpx.Client,
    settings: Settings,
    new_study: Callable[[], dict[str, Any]],
    report: Path,
) -> None:
    study = new_study()
    simulate(server, study["slug"], study["invitation"], token, 4, ABILITIES, 0.1, seed=2)
    manage.attach_results(settings, [report], study["slug"])
    analysis = analyst.get(f"/api/v1/studies/{study['slug']}/analysis").json()
    overall = next(row for row in analysis["measures"] if row["dataset"] == "all")
    assert (overall["measure"], overall["n"]) == ("accuracy", 6)
    assert overall["spearman"] < -0.8
    assert overall["better"] == "lower"
    assert overall["pairs_correct"] in (None, 1.0)  # less is better
    with signed_in(server, settings, "measures") as browser:
        page = browser.get(f"/admin/studies/{study['slug']}/objective/scores").text
        assert "Objective measures" in page
        warned = "with 3 conditions the smallest p-value is 0.17"
        assert warned in page
        assert warned not in browser.get(f"/admin/studies/{study['slug']}/results").text  # which are of the votes
        ranking = browser.get(f"/admin/studies/{study['slug']}/figures/measures.csv").text
        assert ranking.count("accuracy") == len(analysis["measures"])
        plot = browser.get(f"/admin/studies/{study['slug']}/figures/measure_accuracy.svg")
        assert plot.headers["content-type"] == "image/svg+xml"
        assert "Score against accuracy" in plot.text
        assert browser.get(f"/admin/studies/{study['slug']}/figures/measure_weight.svg").status_code == 404


def test_a_report_on_all_datasets_says_so_and_names_of_others_stay_whole(tmp_path: Path) -> None:
    record = {"kind": "films", "subject": "ball: id_fa; all: pm_fb", "digest": "0"}
    assert report_view(record, tmp_path)["subject"] == "ball: id_fa; every dataset: pm_fb"


def test_a_report_shows_its_tables_but_those_without_rows(tmp_path: Path) -> None:
    (tmp_path / "curve.csv").write_text("threshold,inliers\n5,0.5\n")
    (tmp_path / "measures.csv").write_text("dataset,approach\n")
    tables = report_view({"kind": "sphere", "subject": "", "digest": "0"}, tmp_path)["tables"]
    assert [(table["file"], table["n_rows"]) for table in tables] == [("curve.csv", 1)]


@pytest.mark.parametrize(
    ("better", "low", "high", "said"),
    [
        ("lower", -0.9, -0.4, ""),
        ("lower", -0.2, 0.7, ""),
        ("lower", None, None, ""),
        ("lower", 0.3, 0.8, "less should be better, but people prefer more"),
        ("higher", -0.9, -0.4, "more should be better, but people prefer less"),
        ("higher", 0.3, 0.8, ""),
    ],
)
def test_a_measure_that_people_contradict_is_named(
    better: str, low: float | None, high: float | None, said: str
) -> None:
    row = {"measure": "weight", "n": 6, "better": better, "rmse": None, "spearman_p": 0.5} | dict.fromkeys(SHOWN, 0.0)
    (line,) = measure_lines([row | {"spearman_low": low, "spearman_high": high}])
    assert line["contradiction"] == said


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"measures": []}, "lists no measure and comes without tables"),
        ({"kind": "mesh"}, "measures is missing"),
        ({"measures": [accuracy("ball", "id_fa", 1.0) | {"direction": "up"}]}, "measures.0.direction"),
        ({"measures": [accuracy("statue", "id_fa", 1.0)]}, "compares id_fa, id_fb, pm_fb in ball, box"),
        ({"measures": [accuracy("all", "id_fa", 1.0), accuracy("ball", "id_fa", 2.0)]}, "1 in one report and 2"),
    ],
)
def test_what_cannot_be_attached_is_refused(
    settings: Settings, study: dict[str, Any], tmp_path: Path, content: dict[str, Any], message: str
) -> None:
    (tmp_path / "report.json").write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        manage.attach_results(settings, [tmp_path], study["slug"])


def test_a_missing_report_or_study_is_named(settings: Settings, study: dict[str, Any], report: Path) -> None:
    with pytest.raises(ValueError, match="there is no such report"):
        manage.attach_results(settings, [report / "absent"], study["slug"])
    (table := report / "measures.xlsx").write_bytes(b"PK")
    with pytest.raises(ValueError, match="expected the folder of a report"):
        manage.attach_results(settings, [table], study["slug"])
    with pytest.raises(ValueError, match="no study 'nowhere'"):
        manage.attach_results(settings, [report], "nowhere")
