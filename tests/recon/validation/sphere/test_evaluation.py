"""The evaluation on many placed balls: tables, exclusion, report."""

from __future__ import annotations

import csv
import html
import json
import weakref
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer import BadParameter
from typer.testing import CliRunner

from recon.capture.importing.json_file import import_json
from recon.capture.importing.sources import ImportOptions
from recon.cli.main import app
from recon.cli.validate import parse_thresholds, parse_viewpoints
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.run import View
from recon.surface import SurfaceParameters
from recon.validation.clouds import FitError, named_clouds, read_measured
from recon.validation.sphere import reconstruction
from recon.validation.sphere.cells import cap_of
from recon.validation.sphere.evaluation import measure_spheres
from recon.validation.sphere.exclusion import Parts, examine_parts, findings, missing_remark, sensor_remarks
from recon.validation.sphere.fit.consensus import fit_sphere
from recon.validation.sphere.fit.methods import METHODS
from recon.validation.sphere.fit.model import SphereSettings
from recon.validation.sphere.report import write_sphere_report
from recon.validation.sphere.visibility import missing_share
from tests.recon.validation.sphere.simulated_caps import CapParameters, simulate_cap

SETTINGS = SphereSettings(150.0, (5.0, 12.5, 50.0))
SENSORS = ("S1", "S2", "S3")


def write_caps(
    folder: Path, n_samples: int = 2, spoilt: tuple[int, int] | None = None, spoil: str = "patch"
) -> list[Path]:
    """Text clouds of balls, each seen by three sensors; at most one cap is spoilt."""
    paths = []
    for sample in range(n_samples):
        place = np.random.default_rng(sample).uniform(-300, 300, 3)
        for index, azimuth in enumerate(np.deg2rad((-42.0, 0.0, 42.0))):
            kind = spoil if (sample, index) == spoilt else "none"
            parameters = CapParameters(n_points=6000, outliers=0.1, spoil=kind)
            towards = np.array([np.sin(azimuth), 0.1, np.cos(azimuth)])
            points, centre = simulate_cap(parameters, np.random.default_rng((sample, index)), towards)
            paths.append(folder / f"{sample}_{index}.xyz")
            np.savetxt(paths[-1], points - centre + place, fmt="%.4f")
    return paths


def test_clouds_belong_to_sensors_in_turn_or_one_by_one() -> None:
    paths = [Path(name) for name in "abcd"]
    assert [cloud.name for cloud in named_clouds(paths, ("L", "R"))] == ["1/L", "1/R", "2/L", "2/R"]
    assert [cloud.name for cloud in named_clouds(paths, ("L", "L", "R", "R"))] == ["1/L", "2/L", "1/R", "2/R"]
    assert [cloud.name for cloud in named_clouds(paths, ())] == ["1/S1", "2/S1", "3/S1", "4/S1"]
    with pytest.raises(ValueError, match="4 clouds cannot be shared among 3 sensors"):
        named_clouds(paths, SENSORS)
    with pytest.raises(ValueError, match="'combined', which is what reports call all sensors together"):
        named_clouds(paths, ("S1", "combined"))


@pytest.mark.slow
def test_ratios_are_those_of_the_known_centre_and_the_curve_never_falls(tmp_path: Path) -> None:
    paths = write_caps(tmp_path)
    report, _ = measure_spheres(named_clouds(paths, SENSORS), SETTINGS)
    for row in report["reconstructions"]:
        place = np.random.default_rng(row["sample"] - 1).uniform(-300, 300, 3)
        errors = np.linalg.norm(read_measured(Path(row["file"])) - place, axis=1) - 150
        assert np.linalg.norm(np.array(row["centre_mm"]) - place) < 1.0
        assert row["inliers"] == pytest.approx(np.mean(np.abs(errors) <= 12.5), abs=0.01)
    assert report["excluded"] == []
    assert {row["sensor"] for row in report["table"]} == {*SENSORS, "combined"}
    for sensor in (*SENSORS, "combined"):
        rows = [row for row in report["curve"] if row["sensor"] == sensor and row["subset"] == "used"]
        assert [row["inliers"] for row in rows] == sorted(row["inliers"] for row in rows)
        assert all(row["ci_low"] <= row["inliers"] <= row["ci_high"] for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize("spoil", ["wedge", "patch", "pushed"])
def test_a_spoilt_cap_is_left_out_with_reasons_and_kept_on_request(tmp_path: Path, spoil: str) -> None:
    clouds = named_clouds(write_caps(tmp_path, 1, (0, 1), spoil), SENSORS)
    report, _ = measure_spheres(clouds, SETTINGS)
    assert [row["name"] for row in report["excluded"]] == ["1/S2"]
    assert report["excluded"][0]["reasons"]
    used = {row["sensor"] for row in report["table"] if row["subset"] == "used"}
    assert "S2" not in used
    assert "S2" in {row["sensor"] for row in report["table"] if row["subset"] == "all"}
    kept, _ = measure_spheres(clouds, SphereSettings(150.0, (12.5,), keep=("1/S2",)))
    assert kept["excluded"] == []
    assert next(row for row in kept["reconstructions"] if row["name"] == "1/S2")["reasons"]


@pytest.mark.slow
def test_a_part_that_is_off_together_is_noticed_where_it_does_not_move_the_fit() -> None:
    points, centre = simulate_cap(CapParameters(n_points=20_000, noise=2.0, outliers=0.02), np.random.default_rng(5))
    offsets = (points - centre).astype(np.float32)
    good = fit_sphere(offsets, 150.0)
    assert all(
        finding.is_remark
        for finding in findings({"S1": good}, {"S1": examine_parts(cap_of(offsets, good), good)})["S1"]
    )
    is_wrong = np.arctan2(offsets[:, 1], offsets[:, 0]) > 1.8
    offsets[is_wrong] *= np.float32(162 / 150)  # too far off to pull the fit
    fit = fit_sphere(offsets, 150.0)
    assert np.linalg.norm(fit.centre - good.centre) < 0.5
    (reason,) = [
        f for f in findings({"S1": fit}, {"S1": examine_parts(cap_of(offsets, fit), fit)})["S1"] if not f.is_remark
    ]
    assert "off together" in reason.sentence


def test_a_verdict_depends_on_nothing_but_the_ball_itself_and_most_verdicts_on_a_sensor_are_said_of_it() -> None:
    points, centre = simulate_cap(CapParameters(n_points=20_000, noise=2.0, outliers=0.02), np.random.default_rng(5))
    fits = {"S1": fit_sphere(points - centre, 150.0)}
    verdicts = [findings(fits, {"S1": Parts(shift, 1.0, 1.0)})["S1"] for shift in (1.5, 2.5, 0.7, 0.3)]
    assert [[finding.is_remark for finding in verdict] for verdict in verdicts] == [[False], [False], [True], []]
    assert verdicts[2][0].sentence.endswith("by 0.70 mm, near the limit of 1 mm")
    (remark,) = sensor_remarks({"S1": [True, True, True, False], "S2": [True, False, False, False], "S3": [True]})
    assert remark.startswith("3 of 4 reconstructions by S1 are left out")


@pytest.mark.slow
def test_verdicts_on_three_balls_are_the_same_beside_a_fourth(tmp_path: Path) -> None:
    paths = write_caps(tmp_path, 4, (0, 0), "wedge")
    verdicts = [
        {
            row["name"]: (row["is_excluded"], row["reasons"])
            for row in measure_spheres(clouds, SETTINGS)[0]["reconstructions"]
        }
        for clouds in (named_clouds(paths[: 3 * len(SENSORS)], SENSORS), named_clouds(paths, SENSORS))
    ]
    for name, (is_excluded, reasons) in verdicts[0].items():
        assert verdicts[1][name][0] == is_excluded, reasons


@pytest.mark.slow
def test_of_real_shots_of_a_ball_by_our_matcher_the_bad_one_is_flagged_with_numbers(
    real_data: Path, tmp_path: Path
) -> None:
    bounds = np.array([[-700.0, -400, -7300], [800, 550, -4700]])
    import_json(real_data / "sphere/calibration.json", tmp_path / "capture", ImportOptions(bounds=bounds))
    options = ReconstructOptions(("dr",), ("fb",), temporal=None, surface=SurfaceParameters(voxel_mm=30.0))
    reconstruct(tmp_path / "capture", tmp_path / "run", options)
    clouds = named_clouds([tmp_path / "run" / View("dr", "S1", shot).cloud for shot in range(4)], ("S1",))
    settings = SphereSettings(300.0, (5.0, 12.5), viewpoints={"S1": (0.0, 0.0, 0.0)})
    report, pictured = measure_spheres(clouds, settings)
    page = write_sphere_report(report, pictured, tmp_path / "report").read_text(encoding="utf-8")
    flagged = {row["name"]: [*row["reasons"], *row["remarks"]] for row in report["reconstructions"]}
    assert any(remark.startswith("without its inner or outer half") for remark in flagged["3/S1"])
    assert any("of the ball's picture there are no points" in remark for remark in flagged["3/S1"])
    assert all(remark in html.unescape(page) for remark in flagged["3/S1"])


def test_what_a_sensor_leaves_out_of_the_balls_picture_is_told() -> None:
    points, centre = simulate_cap(
        CapParameters(n_points=20_000, outliers=0.0, opening_deg=170), np.random.default_rng(1)
    )
    towards = (points - centre).mean(axis=0)
    viewpoint = centre + 2000 * towards / np.linalg.norm(towards)
    assert missing_share(points, viewpoint, centre, 150.0) < 0.02
    place = centre + 150 * towards / np.linalg.norm(towards)
    is_left = np.linalg.norm(points - place, axis=1) > 60  # a hole whose share of the picture is (60 / 150)^2 / 0.9^2
    assert missing_share(points[is_left], viewpoint, centre, 150.0) == pytest.approx(0.2, abs=0.04)
    assert missing_remark(None) == missing_remark(0.04) == []
    (finding,) = missing_remark(0.2)
    assert finding.is_remark
    assert "20% of the ball's picture" in finding.sentence


@pytest.mark.slow
def test_a_good_cap_can_be_left_out_on_request(tmp_path: Path) -> None:
    clouds = named_clouds(write_caps(tmp_path, 1), SENSORS)
    report, _ = measure_spheres(clouds, SphereSettings(150.0, (12.5,), drop=("1/S3",)))
    assert report["excluded"] == [{"name": "1/S3", "reasons": ["left out on request"]}]
    with pytest.raises(ValueError, match="no reconstruction 9/S1"):
        measure_spheres(clouds, SphereSettings(150.0, (12.5,), drop=("9/S1",)))
    with pytest.raises(ValueError, match="1/S3: is both to be kept and to be left out"):
        measure_spheres(clouds, SphereSettings(150.0, (12.5,), keep=("1/S2", "1/S3"), drop=("1/S3",)))


@pytest.mark.slow
def test_a_cloud_without_a_sphere_is_a_failure_beside_the_others(tmp_path: Path) -> None:
    paths = write_caps(tmp_path, 1)
    np.savetxt(paths[1], np.random.default_rng(0).uniform(-300, 300, (5000, 3)))
    report, _ = measure_spheres(named_clouds(paths, SENSORS), SETTINGS)
    assert report["failed"] == ["1/S2"]
    with pytest.raises(FitError, match="no sphere was found in any of 1 clouds"):
        measure_spheres(named_clouds(paths[1:2], ()), SETTINGS)


@pytest.mark.parametrize("content", ["", "1 2\n3 4\n", "a b c\n", "ply\nformat ascii 1.0\n"])
@pytest.mark.parametrize("suffix", [".ply", ".xyz"])
def test_an_unreadable_cloud_is_named(tmp_path: Path, content: str, suffix: str) -> None:
    path = tmp_path / f"cloud{suffix}"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(ValueError, match=f"cloud{suffix}"):
        measure_spheres(named_clouds([path], ()), SETTINGS)


@pytest.mark.slow
def test_the_report_is_whole_and_needs_nothing_else(tmp_path: Path) -> None:
    report, pictured = measure_spheres(named_clouds(write_caps(tmp_path, 1), SENSORS), SETTINGS)
    page = write_sphere_report(report, pictured, tmp_path / "out").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "out/report.json").read_text())["table"] == report["table"]
    with (tmp_path / "out/sensors.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(report["table"])
    for name in (
        "curve.svg",
        "curve.png",
        "curve.pdf",
        "curve.csv",
        "reconstructions.csv",
        "sphere_1_S1.png",
        "cells_1_S1.png",
    ):
        assert (tmp_path / "out" / name).stat().st_size > 0
    assert 'src="data:image/png' in page
    assert 'src="http' not in page
    assert "<script" not in page


@pytest.mark.slow
def test_the_command_reads_each_cloud_once_and_fits_each_choice_of_sensors_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = write_caps(tmp_path, 2, (0, 1), "pushed")
    clouds = [read_measured(path) for path in paths]
    together = [clouds[:3], clouds[3:], [clouds[0], clouds[2]]]  # the last without the one that is left out
    reads, fits = Counter[Path](), Counter[bytes]()

    def counted(fit: Callable[..., Any]) -> Callable[..., Any]:
        def count_and_fit(points: NDArray[np.float32], *others: object) -> object:
            fits[points.tobytes()] += 1
            return fit(points, *others)

        return count_and_fit

    def read_text(path: Path, encoding: str | None = None, errors: str | None = None) -> str:
        reads[path] += 1
        return path.read_bytes().decode(encoding or "utf-8", errors or "strict")

    monkeypatch.setattr(Path, "read_text", read_text)
    monkeypatch.setattr(reconstruction, "refine_sphere", counted(reconstruction.refine_sphere))
    monkeypatch.setitem(METHODS, "robust", counted(METHODS["robust"]))
    sensors = [word for sensor in SENSORS for word in ("--sensor", sensor)]
    arguments = ["validate", "sphere", *map(str, paths), "--radius", "150", *sensors, "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "left out: 1/S2" in result.output
    assert [reads[path] for path in paths] == [1] * len(paths)
    assert fits == Counter([cloud.tobytes() for cloud in (*clouds, *map(np.concatenate, together))])


@pytest.mark.slow
def test_points_that_neither_a_fit_nor_a_picture_needs_are_let_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held: list[weakref.ref[NDArray[np.float32]]] = []

    def read(path: Path, unit: str) -> NDArray[np.float32]:
        points = read_measured(path, unit)
        held.append(weakref.ref(points))
        return points

    def count(_what: str, _done: int, _total: int) -> None:
        n_held.append(sum(points() is not None for points in held))

    n_held: list[int] = []
    monkeypatch.setattr(reconstruction, "read_measured", read)
    clouds = named_clouds(write_caps(tmp_path, 8, (6, 0), "pushed"), SENSORS)
    report, pictured = measure_spheres(clouds, SETTINGS, count)
    assert [row["name"] for row in report["excluded"]] == ["7/S1"]
    assert len(held) == 24 + 3  # read again: the others of its sample, for their fit, and itself, for its picture
    assert max(n_held) == 15  # those of twelve pictures, and the sample in hand
    assert [sphere.file.name for sphere in pictured[:2]] == ["7/S1", "1/S1"]
    assert all(len(sphere.points) for sphere in pictured)


def test_thresholds_are_steps_of_two_and_a_half_unless_asked_for() -> None:
    assert parse_thresholds("5:100")[:3] == (5.0, 7.5, 10.0)
    assert parse_thresholds("5:100")[-1] == 100.0
    assert parse_thresholds("1:2:0.5") == (1.0, 1.5, 2.0)
    assert parse_thresholds("0.1:0.7:0.1") == (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)


@pytest.mark.slow
def test_with_a_viewpoint_only_lines_of_sight_that_meet_the_ball_count(tmp_path: Path) -> None:
    points, centre = simulate_cap(CapParameters(n_points=6000, outliers=0.0), np.random.default_rng(1))
    rng = np.random.default_rng(2)
    wall = np.column_stack([rng.uniform(-2000, 2000, (6000, 2)), np.full(6000, -1500.0)])
    path = tmp_path / "scene.xyz"
    np.savetxt(path, np.concatenate([points - centre, wall]))
    settings = SphereSettings(150.0, (12.5,), viewpoints={"S1": (0.0, 0.0, 2500.0)})
    (row,) = measure_spheres(named_clouds([path], ()), settings)[0]["reconstructions"]
    behind = np.hypot(wall[:, 0], wall[:, 1]) < 4000 * np.tan(np.arcsin(150 / 2500))
    assert row["n_points"] == pytest.approx(6000 + behind.sum(), abs=3)
    with pytest.raises(ValueError, match="inside the fitted sphere"):
        measure_spheres(named_clouds([path], ()), SphereSettings(150.0, (12.5,), viewpoints={"S1": (0.0, 0.0, 0.0)}))
    with pytest.raises(ValueError, match="viewpoints are given for S7"):
        measure_spheres(named_clouds([path], ()), SphereSettings(150.0, (12.5,), viewpoints={"S7": (0.0, 0.0, 1e3)}))


def test_a_viewpoint_names_its_sensor_or_means_the_only_one() -> None:
    assert parse_viewpoints(["S2=1,-2,3.5", "0,0,0"]) == {"S2": (1.0, -2.0, 3.5), "S1": (0.0, 0.0, 0.0)}
    with pytest.raises(BadParameter, match="0,0,0 and S1=0,0,9: a sensor has two places"):
        parse_viewpoints(["0,0,0", "S1=0,0,9"])
