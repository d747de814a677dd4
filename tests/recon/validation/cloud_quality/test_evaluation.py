"""The command: which files it compares, what it says of poor input, and what it writes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from shutil import copy, copytree

import numpy as np
import pytest

from app.intake.reports import read_report
from recon.geometry.mesh import Mesh
from recon.geometry.mesh_files import write_mesh
from recon.pipeline.run import RUN_FILE, mesh_name
from recon.studio import SynthParameters, synthesise
from recon.studio.objects import ball as ball_mesh
from recon.validation.cloud_quality.evaluation import CloudSettings
from recon.validation.cloud_quality.points import PointSet
from recon.validation.cloud_quality.reading import Sampling, area_of, read_point_set
from recon.validation.clouds import read_shape
from recon.validation.measures import Measured
from tests.command_line import Command
from tests.recon.validation.cloud_quality.clouds import ball, refusal, table, validate, write

FAST = ("--measures", "d1,chamfer")


def sphere(path: Path, radius: float = 100.0, scale: float = 1.0) -> Path:
    vertices, faces = ball_mesh(radius, 15.0)
    normals = vertices / radius
    levels = np.rint(127 * (1 + normals)).astype(np.uint8)
    return write_mesh(path, Mesh((scale * vertices).astype(np.float32), faces, normals.astype(np.float32), levels))


def test_a_report_holds_every_measure_in_every_direction(command: Command, tmp_path: Path) -> None:
    reference = write(tmp_path / "truth.ply", ball())
    cloud = write(tmp_path / "mine.ply", ball(noise=1))
    out = tmp_path / "report"
    report = validate(command, out, cloud, "--reference", reference, "--peak", 200, "--dataset", "temple")
    rows = {(row["measure"], row["direction"]): row for row in table(out)}
    names = {"d1_mse", "d2_psnr_db", "d1_hausdorff_squared", "chamfer", "f_score", "y_mse", "cr_mse"}
    names |= {f"pointssim_{part}" for part in ("geometry", "normals", "curvature", "colour", "normals_from_files")}
    assert names <= {measure for measure, _ in rows}
    assert len(rows) == 3 * len({measure for measure, _ in rows}) == len(report["values"])
    row = rows["d1_psnr_db", "symmetric"]
    assert (row["dataset"], row["approach"], row["frame"], row["unit"]) == ("temple", "mine", "", "dB")
    mse = float(rows["d1_mse", "symmetric"]["value"])
    assert float(row["value"]) == pytest.approx(10 * math.log10(3 * 200**2 / mse))
    assert list(table(out)[0]) == list(Measured.__dataclass_fields__)
    assert {"report.html", "clouds.csv", "errors_mine.png"} <= {path.name for path in out.iterdir()}


@pytest.mark.slow
def test_a_study_takes_the_measures_of_a_report(command: Command, tmp_path: Path) -> None:
    reference = write(tmp_path / "truth.ply", ball())
    clouds = [write(tmp_path / f"{noise}.ply", ball(noise=noise)) for noise in (1, 2)]
    names = ("--approach", "pm_fa", "--approach", "pm_fb", "--dataset", "temple")
    validate(command, tmp_path / "report", *clouds, "--reference", reference, *names)
    report = read_report(tmp_path / "report")
    values = {(m.measure, m.approach): m.value for m in report.measures if m.dataset == "temple"}
    assert report.kind == "cloud"
    assert values["chamfer", "pm_fa"] < values["chamfer", "pm_fb"]
    assert {m.measure: m.direction for m in report.measures}["f_score"] == "more is better"
    assert {"d1_mse", "d1_mse (reference to distorted)", "d2_psnr_db", "y_mse", "pointssim_colour"} <= {
        m.measure for m in report.measures
    }


@pytest.mark.slow
def test_a_sequence_is_compared_frame_by_frame_and_its_value_is_the_mean(command: Command, tmp_path: Path) -> None:
    for frame in range(3):
        write(tmp_path / "truth" / "mesh" / f"{frame:04d}.ply", ball(seed=10 * frame + 1))
        write(tmp_path / "a" / f"{frame:04d}.ply", ball(noise=1 + frame, seed=10 * frame + 1))
        if frame:
            write(tmp_path / "b" / f"frame_{frame}.ply", ball(noise=1, seed=10 * frame + 1))
    out = tmp_path / "report"
    clouds = (tmp_path / "a", tmp_path / "b")
    report = validate(command, out, *clouds, "--reference", tmp_path / "truth", *FAST)
    values = {
        (row["approach"], row["frame"]): float(row["value"])
        for row in table(out)
        if (row["measure"], row["direction"]) == ("chamfer", "symmetric")
    }
    assert values.keys() == {(name, frame) for name in "ab" for frame in ("", "1", "2")}
    assert values["a", ""] == pytest.approx((values["a", "1"] + values["a", "2"]) / 2)
    assert report["remarks"] == ["a: frame 0 is left out, because another approach or the reference lacks them"]
    chosen = validate(command, out, *clouds, "--reference", tmp_path / "truth", *FAST, "--frames", "2:3")
    assert chosen["settings"]["frames"] == [2]
    assert not chosen["remarks"]


def test_a_mesh_is_sampled_with_the_density_and_seed_that_are_stated(tmp_path: Path) -> None:
    path = sphere(tmp_path / "sphere.ply")
    cloud = read_point_set(path, Sampling(density=0.02, seed=3))
    assert len(cloud) == round(0.02 * area_of(read_shape(path)))
    radii = np.linalg.norm(cloud.points, axis=1)
    assert 98 < radii.min() < radii.max() <= 100.001
    assert cloud.normals is not None
    assert cloud.colours is not None
    assert np.linalg.norm(cloud.normals, axis=1) == pytest.approx(1, abs=1e-5)
    assert np.abs(cloud.normals - cloud.points / radii[:, None]).max() < 0.05
    assert np.abs(cloud.colours - 127 * (1 + cloud.normals)).max() < 8
    octants = np.bincount((cloud.points > 0) @ [1, 2, 4])
    assert octants == pytest.approx(len(cloud) / 8, rel=0.15)
    again, other = (read_point_set(path, Sampling(density=0.02, seed=seed)) for seed in (3, 4))
    assert np.array_equal(again.points, cloud.points)
    assert not np.array_equal(other.points, cloud.points)


@pytest.mark.slow
def test_equal_meshes_are_at_no_distance_and_one_that_is_larger_is_as_far_as_it_is_larger(
    command: Command, tmp_path: Path
) -> None:
    same, larger = sphere(tmp_path / "same.ply"), sphere(tmp_path / "larger.ply", 103)
    options = ("--reference", sphere(tmp_path / "truth.ply"), "--density", 0.1, "--measures", "d1,d2")
    out = tmp_path / "report"
    validate(command, out, same, larger, *options)
    rows = {(row["approach"], row["measure"], row["direction"]): float(row["value"]) for row in table(out)}
    assert rows["same", "d1_psnr_db", "symmetric"] == math.inf
    assert rows["larger", "d2_mse", "symmetric"] == pytest.approx(9, rel=0.05)


def test_what_clouds_lack_is_named_and_the_rest_is_measured(command: Command, tmp_path: Path) -> None:
    reference = write(tmp_path / "truth.ply", ball(), normals=False)
    cloud = write(tmp_path / "mine.ply", ball(noise=1), colours=False)
    out = tmp_path / "report"
    report = validate(command, out, cloud, "--reference", reference)
    reasons = {row["measure"]: row["reason"] for row in report["skipped"]}
    assert reasons.keys() == {"d2", "colour", "pointssim_colour", "pointssim_normals_from_files"}
    assert reasons["d2"] == f"{reference}: has no normals (nx, ny, nz other than 0), which D2 takes from the reference"
    assert reasons["colour"] == f"{cloud}: has no colours (red, green, blue of 8 bits)"
    assert {"d1_mse", "chamfer", "f_score", "pointssim_curvature"} <= {row["measure"] for row in table(out)}
    told = command("validate", "cloud", cloud, "--reference", reference, "-o", out)
    assert f"not measured: colour of mine: {cloud}: has no colours" in told.out


@pytest.mark.parametrize(
    ("n_blank", "said"),
    [
        (400, ["truth.ply: has no normals (nx, ny, nz other than 0), which D2 takes from the reference"]),
        (3, ["truth.ply: 3 of 400 normals are (0, 0, 0); D2 sees no error there"]),
    ],
)
def test_normals_without_direction_are_named_and_make_no_cloud_perfect(
    command: Command, tmp_path: Path, n_blank: int, said: list[str]
) -> None:
    whole = ball()
    normals = np.where(np.arange(400)[:, None] < n_blank, 0, whole.normals)
    reference = write(tmp_path / "truth.ply", PointSet("truth", whole.points, normals))
    cloud = write(tmp_path / "mine.ply", ball(noise=1))
    report = validate(command, tmp_path / "report", cloud, "--reference", reference, "--measures", "d1,d2")
    sentences = [*report["remarks"], *(row["reason"] for row in report["skipped"])]
    assert [sentence.removeprefix(f"{tmp_path}/") for sentence in sentences] == said
    assert any(value["measure"] == "d2_mse" for value in report["values"]) == (n_blank < 400)


def test_the_length_of_the_references_normals_does_not_scale_d2(command: Command, tmp_path: Path) -> None:
    whole, out = ball(), tmp_path / "report"
    assert whole.normals is not None
    cloud, values = write(tmp_path / "mine.ply", ball(noise=1)), []
    for length in (1.0, 0.25):
        reference = write(tmp_path / "truth.ply", PointSet("truth", whole.points, length * whole.normals))
        report = validate(command, out, cloud, "--reference", reference, "--measures", "d2")
        values.append([value["value"] for value in report["values"]])
    assert values[1] == pytest.approx(values[0], rel=1e-5)


def test_one_point_is_measured_as_far_as_that_goes(command: Command, tmp_path: Path) -> None:
    truth = write(tmp_path / "truth.ply", ball())
    point = write(tmp_path / "point.ply", PointSet("point", np.array([[0, 0, 0]])))
    values = {
        value["measure"]: value["value"]
        for value in validate(command, tmp_path / "report", point, "--reference", truth)["values"]
    }
    assert values["d1_mse"] == pytest.approx(100**2)
    assert "pointssim_geometry" not in values
    other_way = validate(command, tmp_path / "report", truth, "--reference", point)
    reasons = {row["measure"]: row["reason"] for row in other_way["skipped"]}
    assert "no two points apart to take a peak from; give --peak" in reasons["d1_psnr_db"]
    assert "give --threshold" in reasons["f_score"]
    assert "has points at 1 places, expected at least the 12" in reasons["pointssim_geometry"]


def test_points_at_one_place_are_counted_and_told(command: Command, tmp_path: Path) -> None:
    truth = write(tmp_path / "truth.ply", ball())
    twice = write(tmp_path / "twice.ply", PointSet("twice", np.concatenate([ball().points, ball().points[:7]])))
    report = validate(command, tmp_path / "report", twice, "--reference", truth, *FAST)
    assert [row["n_duplicates"] for row in report["clouds"]] == [0, 7]
    assert report["remarks"] == [
        f"{twice}: 7 of 407 points lie where another does; all measures but Chamfer and F-score take them as one"
    ]


@pytest.mark.parametrize(("scale", "relation"), [(1000, "1 000 times larger"), (0.001, "1 000 times smaller")])
def test_a_cloud_in_another_unit_is_refused_by_its_factor(
    command: Command, tmp_path: Path, scale: float, relation: str
) -> None:
    truth = write(tmp_path / "truth.ply", ball())
    cloud = write(tmp_path / "mine.ply", ball(noise=1), scale=scale)
    line = refusal(command, tmp_path / "report", cloud, "--reference", truth)
    assert f"mine.ply: is about {relation} than its reference" in line
    assert "metres against millimetres? Bring both to one unit first" in line


def test_gltf_which_is_read_in_mm_is_refused_where_the_unit_is_another(command: Command, tmp_path: Path) -> None:
    cloud, truth = (sphere(tmp_path / name) for name in ("mine.glb", "truth.glb"))
    line = refusal(command, tmp_path / "report", cloud, "--reference", truth, *FAST, "--unit", "m")
    assert "truth.glb: glTF is read in mm, but the unit is m" in line


@pytest.mark.slow
@pytest.mark.parametrize(("scale", "relation"), [(1e6, "1 000 000 times larger"), (0.001, "1 000 times smaller")])
def test_a_mesh_in_another_unit_is_refused_by_its_factor(
    command: Command, tmp_path: Path, scale: float, relation: str
) -> None:
    truth, mesh = sphere(tmp_path / "truth.ply"), sphere(tmp_path / "mine.ply", scale=scale)
    line = refusal(command, tmp_path / "report", mesh, "--reference", truth)
    assert f"mine.ply: is about {relation} than its reference" in line


@pytest.mark.slow
def test_a_cloud_of_odd_size_or_place_is_remarked(command: Command, tmp_path: Path) -> None:
    truth = write(tmp_path / "truth.ply", ball())
    large = write(tmp_path / "large.ply", ball(), scale=10)
    far = write(tmp_path / "far.ply", PointSet("far", ball().points + np.float32(500)))
    remarks = validate(command, tmp_path / "report", large, far, "--reference", truth, *FAST)["remarks"]
    assert "is about 10 times larger than its reference" in remarks[0]
    assert "lies wholly beside its reference" in remarks[1]


@pytest.mark.slow
def test_points_that_are_no_numbers_are_counted_and_empty_files_refused(command: Command, tmp_path: Path) -> None:
    truth = write(tmp_path / "truth.ply", ball())
    out = tmp_path / "report"
    rows = "1 2 3\n4 5 6\n7 nan 9\n"
    header = "ply\nformat ascii 1.0\nelement vertex {n}\n" + "".join(f"property float {a}\n" for a in "xyz")
    (tmp_path / "nan.ply").write_text(header.format(n=3) + "end_header\n" + rows)
    (tmp_path / "empty.ply").write_text(header.format(n=0) + "end_header\n")
    (tmp_path / "no.ply").write_text("")
    told = command(
        "validate", "cloud", tmp_path / "nan.ply", "--reference", tmp_path / "nan.ply", "-o", tmp_path / "counted"
    )
    assert "nan.ply: has 1 of 3 points without finite coordinates, left out" in told.err
    assert "empty.ply: holds no points" in refusal(command, out, tmp_path / "empty.ply", "--reference", truth)
    assert "no.ply: is not a whole PLY file" in refusal(command, out, tmp_path / "no.ply", "--reference", truth)
    assert "there is no such file" in refusal(command, out, tmp_path / "gone.ply", "--reference", truth)


def test_a_file_where_the_report_should_be_is_named_before_anything_is_measured(
    command: Command, tmp_path: Path
) -> None:
    cloud = write(tmp_path / "a.ply", ball(20))
    told = command("validate", "cloud", cloud, "--reference", cloud, "-o", cloud)
    assert told.code == 2
    assert "'--out' / '-o'" in told.err
    assert "clouds: " not in told.err


@pytest.mark.slow
def test_clouds_that_do_not_fit_together_are_refused(command: Command, tmp_path: Path) -> None:
    one_file, other_file = (write(tmp_path / f"{name}.ply", ball(20)) for name in ("mine", "yours"))
    for frame in (1, 2):
        write(tmp_path / "early" / f"{frame}.ply", ball(20))
        write(tmp_path / "late" / f"{frame + 5}.ply", ball(20))
    (tmp_path / "none").mkdir()
    out = tmp_path / "report"
    early, late, none = (tmp_path / name for name in ("early", "late", "none"))
    cases = [
        ((early, one_file, "--reference", other_file), "some of the clouds are files, others folders"),
        ((one_file, "--reference", early), "is a folder of frames, but"),
        ((early, "--reference", late), "no frame that all have (early: 2 frames from 1 to 2; "),
        ((early, "--reference", early, "--frames", "7:9"), "asked for 7 to 8"),
        ((none, "--reference", one_file), "holds no cloud; expected FRAME.ply for every frame"),
        ((one_file, one_file, "--reference", other_file), "there is a cloud of mine already"),
        (
            (one_file, "--approach", "a", "--approach", "b", "--reference", one_file),
            "2 names of approaches for 1",
        ),
        ((one_file, "--reference", one_file, "--measures", "d3"), "unknown measure 'd3', expected some of d1, d2, "),
    ]
    for arguments, message in cases:
        assert message in refusal(command, out, *arguments)


@pytest.mark.parametrize(("name", "length"), [("peak", -1.0), ("threshold", 0.0), ("peak", math.inf)])
def test_a_length_that_nothing_is_compared_with_is_refused(name: str, length: float) -> None:
    with pytest.raises(ValueError, match=f"the {name} is .*, expected a positive length"):
        CloudSettings(**{name: length})  # type: ignore[arg-type]


def true_run(folder: Path) -> tuple[Path, Path]:
    """Make a capture of two frames, and a run whose two approaches are the true mesh of the second."""
    capture, run = folder / "capture", folder / "run"
    synthesise(capture, SynthParameters(scene="sphere", n_sensors=2, n_frames=2, size=(64, 48)))
    truth = capture / "truth" / "mesh" / "0001.ply"
    for approach in ("id_fa", "id_fb"):
        (run / "meshes" / approach).mkdir(parents=True)
        copy(truth, run / mesh_name(approach, 1))
    copy(capture / "capture.json", run)
    content = {"schema_version": 1, "approaches": ["id_fa", "id_fb"], "frames": [1], "versions": {}}
    (run / RUN_FILE).write_text(json.dumps(content))
    return capture, run


@pytest.mark.slow
def test_a_run_brings_its_approaches_and_its_dataset(command: Command, tmp_path: Path) -> None:
    capture, run = true_run(tmp_path)
    report = validate(command, tmp_path / "report", run, "--reference", capture / "truth", *FAST, "--density", 0.01)
    assert {value["approach"] for value in report["values"]} == {"id_fa", "id_fb"}
    assert report["settings"]["dataset"] == "sphere"
    assert report["settings"]["frames"] == [1]
    assert {value["value"] for value in report["values"] if value["measure"] == "d1_mse"} == {0}


@pytest.mark.slow
def test_two_runs_of_the_same_approaches_are_told_apart_as_the_refusal_says(command: Command, tmp_path: Path) -> None:
    capture, run = true_run(tmp_path)
    meshes = copytree(run, tmp_path / "again") / "meshes" / "id_fa"
    out, options = tmp_path / "report", ("--reference", capture / "truth", *FAST, "--density", 0.01)
    said = refusal(command, out, run, tmp_path / "again", *options)
    assert f"there is a cloud of id_fa already; give {meshes} instead of the run, with --approach NAME" in said
    report = validate(command, out, run, meshes, "--approach", "again", *options)
    assert {value["approach"] for value in report["values"]} == {"id_fa", "id_fb", "again"}
