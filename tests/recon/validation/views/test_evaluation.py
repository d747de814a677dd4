"""A run against its own sensors and photographs, with depth whose errors are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from shutil import copyfile, move

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from recon.capture.format import Capture
from recon.capture.masks.segment import segment_capture
from recon.capture.rectify import rectify
from recon.cli.main import app
from recon.cloud import CloudParameters
from recon.geometry.mesh import Mesh, Shape, Texture
from recon.geometry.mesh_files import read_mesh
from recon.pipeline.job import ReconstructOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.run import mesh_name, read_run, recorded_in
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MESH, read_depth
from recon.surface import SurfaceParameters
from recon.validation.truth.evaluation import distances_to
from recon.validation.views.between_sensors import cross_sensor_rows, depth_gaps, depth_points
from recon.validation.views.evaluation import FLOOR, ViewSettings, mean_agreement, measure_views
from recon.validation.views.image_quality import BEST_PSNR_DB, gradient_map, psnr, ssim_map
from recon.validation.views.novel_view import (
    HELD_OUT,
    Photograph,
    Rendering,
    photographs,
    rendered,
    roughness,
    true_disparity,
    true_mesh,
    view_rows,
)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    folder = tmp_path_factory.mktemp("studio") / "sphere"
    synthesise(folder, SynthParameters(scene="sphere", n_sensors=2, n_frames=1, size=(320, 240), noise=0.5))
    return segment_capture(folder)


@pytest.fixture(scope="module")
def run(capture: Capture, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    reconstruct(capture.folder, folder, ReconstructOptions(depths=("id",), fusions=("fb",), temporal=None))
    return folder


def photograph(size: int = 64, **changes: object) -> Photograph:
    pixels = np.random.default_rng(1).integers(0, 256, (size, size, 3)).astype(np.uint8)
    mask = np.zeros((size, size), bool)
    mask[16:48, 16:48] = True
    shot = Photograph("S1/left", HELD_OUT, 0, None, pixels, mask)  # type: ignore[arg-type]  # no camera is needed here
    return replace(shot, **changes)  # type: ignore[arg-type]  # of its fields


def front(picture: NDArray[np.uint8], covered: NDArray[np.bool_]) -> Rendering:
    return Rendering(picture, covered, np.zeros_like(covered))


def test_psnr_is_that_of_the_mean_square_error_in_the_region() -> None:
    grey, lighter = np.full((8, 8, 3), 100, np.uint8), np.full((8, 8, 3), 110, np.uint8)
    lighter[0] = 255
    region = np.ones((8, 8), bool)
    region[0] = False
    assert psnr(lighter, grey, region) == pytest.approx(20 * np.log10(25.5))
    assert psnr(grey, grey, region) == BEST_PSNR_DB
    assert psnr(grey, grey, np.zeros((8, 8), bool)) is None


def test_structure_measures_are_one_for_the_same_and_less_for_the_blurred() -> None:
    sharp = np.random.default_rng(1).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    flat = np.full_like(sharp, 128)
    for measure in (ssim_map, gradient_map):
        assert measure(sharp, sharp).min() == pytest.approx(1.0, abs=1e-4)
        assert measure(flat, sharp).mean() < 0.5


def test_coverage_and_spill_are_shares_of_object_and_drawing() -> None:
    shot = photograph()
    covered = np.zeros((64, 64), bool)
    covered[16:48, 32:64] = True  # half of the object, and as much beside it
    whole, rim, inside = view_rows(front(shot.pixels, covered), shot)
    assert (whole["coverage"], whole["spill"]) == (0.5, 0.5)
    assert whole["psnr_db"] == BEST_PSNR_DB
    assert whole["n_pixels"] == rim["n_pixels"] + inside["n_pixels"] == 32 * 16
    (unmasked,) = view_rows(front(shot.pixels, covered), photograph(mask=None))
    assert (unmasked["coverage"], unmasked["spill"], unmasked["n_pixels"]) == (None, None, 32 * 32)
    assert unmasked["roughness"] is None


def test_back_faces_cover_nothing_and_are_said(capture: Capture) -> None:
    mesh = read_mesh(capture.folder / MESH.format(frame=0))
    shot = next(one for one in photographs(capture, [0]) if one.kind == HELD_OUT)
    inside_out = replace(mesh, faces=mesh.faces[:, ::-1].copy())
    for model, rendering, back in (
        (mesh, rendered(mesh, shot.camera), 0.0),
        (inside_out, rendered(inside_out, shot.camera), 1.0),
        (inside_out, rendered(inside_out, shot.camera).turned(), 0.0),
    ):
        row = view_rows(rendering, shot)[0]
        assert row["back_faces"] == pytest.approx(back, abs=0.01)
        assert row["coverage"] == pytest.approx(1.0 - back, abs=0.02)
        assert len(model.faces)


def test_what_is_not_covered_is_black_in_the_psnr_of_the_object() -> None:
    shot = photograph()
    half = np.zeros((64, 64), bool)
    half[16:48, 16:32] = True
    row = view_rows(front(shot.pixels, half), shot)[0]
    assert shot.mask is not None
    missing = np.where(half[..., None], shot.pixels, 0).astype(np.uint8)
    assert row["psnr_db"] == BEST_PSNR_DB
    assert row["psnr_object_db"] == psnr(missing, shot.pixels, shot.mask)
    assert row["psnr_object_db"] < 15


def test_an_object_that_leaves_the_picture_has_no_rim_along_its_border_or_in_its_corner() -> None:
    mask = np.zeros((64, 64), bool)
    mask[32:, 32:] = True
    _, rim, inside = view_rows(front(photograph().pixels, mask), photograph(mask=mask))
    assert inside["n_pixels"] == 30 * 30  # two pixels along the upper and the left side are the rim
    assert rim["n_pixels"] == 32 * 32 - 30 * 30


def test_teeth_and_holes_make_an_outline_rough() -> None:
    mask = photograph().mask
    assert mask is not None
    assert roughness(mask, mask) == 1.0
    teeth, holes = mask.copy(), mask.copy()
    teeth[14:16, 16:48:4] = teeth[14:16, 17:48:4] = True
    holes[20:44:6, 20:44:6] = False
    assert 1.1 < roughness(teeth, mask) < roughness(teeth & holes, mask)
    assert roughness(mask, np.zeros_like(mask)) is None


def test_a_rendering_of_a_textured_mesh_shows_its_texture(capture: Capture) -> None:
    mesh = read_mesh(capture.folder / MESH.format(frame=0))
    camera = capture.sensors[0].left.camera
    orange = np.array([250, 120, 10], np.uint8)
    texture = Texture(np.full((4, 4, 3), orange), mesh.vertices[:, :2])
    picture, covered, _ = rendered(replace(mesh, texture=texture), camera)
    assert covered.any()
    assert np.array_equal(covered, rendered(mesh, camera)[1])
    assert np.abs(picture[covered].astype(int) - orange).max() <= 1


def test_a_rendering_covers_what_the_camera_sees_of_a_floor_that_it_stands_over(capture: Capture) -> None:
    camera = capture.sensors[0].left.camera
    corners = np.array([[-4000, 300, -1000], [4000, 300, -1000], [4000, 300, 9000], [-4000, 300, 9000]])  # before it
    vertices = (camera.centre + corners @ camera.rotation).astype(np.float32)
    faces, upwards = np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.tile(-camera.rotation[1].astype(np.float32), (4, 1))
    _, covered, _ = rendered(Mesh(vertices, faces, upwards, np.full((4, 3), 90, np.uint8)), camera)
    assert covered[-1].all()
    assert not covered[0].any()


def test_a_rendering_covers_what_the_studio_saw(capture: Capture) -> None:
    mesh = read_mesh(capture.folder / MESH.format(frame=0))
    shot = next(one for one in photographs(capture, [0]) if one.kind == HELD_OUT)
    assert shot.mask is not None
    _, covered, _ = rendered(mesh, shot.camera)
    assert np.count_nonzero(covered & shot.mask) / np.count_nonzero(covered | shot.mask) > 0.98


@pytest.mark.slow
def test_true_depth_becomes_the_disparity_that_gives_it_back(capture: Capture) -> None:
    stream = capture.sensors[0]
    view = rectify(stream.sensor, capture.bounds)
    disparity = true_disparity(read_depth(capture, stream.id, "left", 0), stream.left.camera, view)
    points = depth_points(disparity, view, capture.bounds)
    mesh = read_mesh(capture.folder / MESH.format(frame=0))
    distances = distances_to(Shape(mesh.vertices.astype(np.float64), mesh.faces), points)
    assert len(points) > 500
    assert np.percentile(distances, 90) < 0.3


def test_true_depths_of_two_sensors_agree_and_shifted_ones_are_off_by_the_shift(capture: Capture) -> None:
    views = [rectify(stream.sensor, capture.bounds) for stream in capture.sensors]
    maps = [
        true_disparity(read_depth(capture, stream.id, "left", 0), stream.left.camera, view)
        for stream, view in zip(capture.sensors, views, strict=True)
    ]
    points = depth_points(maps[0], views[0], capture.bounds)
    gaps = depth_gaps(points, maps[1], views[1])
    near = gaps[np.abs(gaps) < 20]
    assert len(near) > 300
    assert np.median(np.abs(near)) < 0.5
    towards = views[1].left.rotation[2]
    shifted = depth_gaps(points - 10 * towards, maps[1], views[1])
    assert np.median(shifted[np.abs(shifted) < 30]) == pytest.approx(-10, abs=1.0)


@pytest.mark.slow
def test_the_floor_is_nearer_to_the_truth_than_the_model(capture: Capture, run: Path) -> None:
    mesh = true_mesh(capture, 0, "fb", CloudParameters(), SurfaceParameters(voxel_mm=12.0))
    truth = read_mesh(capture.folder / MESH.format(frame=0))
    shape = Shape(truth.vertices.astype(np.float64), truth.faces)
    assert np.percentile(distances_to(shape, mesh.vertices.astype(np.float64)), 90) < 2.0
    report, shown = measure_views(run, ViewSettings())
    means = {row["approach"]: row for row in report["means"] if (row["kind"], row["region"]) == (HELD_OUT, "all")}
    assert set(means) == {"id_fb", FLOOR}
    assert means[FLOOR]["psnr_db"] > means["id_fb"]["psnr_db"]
    assert means[FLOOR]["spill"] < means["id_fb"]["spill"]
    assert shown[0].photograph.kind == HELD_OUT
    measures = {row["measure"]: row for row in report["measures"]}
    assert measures["novel view PSNR"]["value"] == means["id_fb"]["psnr_db"]
    assert {(row["dataset"], row["approach"]) for row in report["measures"]} == {("sphere", "id_fb")}


def other_models(run: Path, folder: Path, **changes: object) -> Path:
    """Lay out the run's own models as if another program had made them."""
    (folder / "mine").mkdir(parents=True)
    copyfile(run / mesh_name("id_fb", 0), folder / "mine" / "7.ply")
    scene = {
        "schema_version": 1,
        "dataset": "sphere",
        "fps": 25,
        "units": "mm",
        "up": "y",
        "path": {"sensors_of": str(run)},
    }
    (folder / "scene.json").write_text(json.dumps(scene | changes), encoding="utf-8")
    return folder


@pytest.mark.slow
def test_models_by_another_program_are_compared_with_the_same_photographs(run: Path, tmp_path: Path) -> None:
    settings = ViewSettings(models=(other_models(run, tmp_path / "models"),))
    measures = measure_views(run, settings)[0]["measures"]
    values = {(row["approach"], row["measure"]): row["value"] for row in measures}
    mine = {measure: value for (approach, measure), value in values.items() if approach == "mine"}
    assert "novel view PSNR" in mine
    assert mine == {measure: values["id_fb", measure] for measure in mine}


def test_models_of_another_scene_or_of_another_length_are_named(run: Path, tmp_path: Path) -> None:
    strangers = other_models(run, tmp_path / "strangers", dataset="box")
    with pytest.raises(ValueError, match="is of dataset box, expected that of the run, sphere"):
        measure_views(run, ViewSettings(models=(strangers,)))
    longer = other_models(run, tmp_path / "longer")
    copyfile(longer / "mine" / "7.ply", longer / "mine" / "8.ply")
    with pytest.raises(ValueError, match="has 2 models, expected 1, one for each frame"):
        measure_views(run, ViewSettings(models=(longer,)))


def test_sensors_of_a_run_are_compared_in_both_directions(run: Path) -> None:
    rows = cross_sensor_rows(read_run(run), [0], 40.0)
    assert [(row["of"], row["by"]) for row in rows] == [("S1", "S2"), ("S2", "S1")]
    assert all(row["agree"] > 0.5 and row["agree"] + row["in_front"] <= 1 for row in rows)


def test_agreement_weighs_frames_by_the_points_they_share_and_is_none_where_none_are() -> None:
    columns = ("agree", "in_front", "median_abs_mm")
    rows = [{"n_compared": n} | dict.fromkeys(columns, value) for n, value in ((10, 1.0), (30, 0.0), (0, None))]
    assert mean_agreement(rows) == {"n_compared": 40} | dict.fromkeys(columns, 0.25)
    assert mean_agreement(rows[2:]) == {"n_compared": 0} | dict.fromkeys(columns)


@pytest.mark.slow
def test_the_command_finds_the_recording_and_writes_a_report(run: Path, capture: Capture, tmp_path: Path) -> None:
    assert recorded_in(read_run(run)).resolve() == capture.folder.resolve()
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["validate", "views", str(run), "-o", str(out), "--frames", "0:1", "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["settings"]["has_floor"] is True
    for name in ("report.json", "views.csv", "means.csv", "sensors.csv", "psnr.svg", "report.html"):
        assert (out / name).stat().st_size > 0
    assert len(list(out.glob("view_*.png"))) > 0


@pytest.mark.slow
def test_a_missing_recording_or_frame_is_named(run: Path, capture: Capture, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="none of them in 5:9"):
        measure_views(run, ViewSettings(frames=range(5, 9)))
    with pytest.raises(ValueError, match="--capture FOLDER"):
        measure_views(run, ViewSettings(capture=tmp_path))
    move(str(capture.folder), str(tmp_path / "moved"))
    try:
        assert measure_views(run, ViewSettings(capture=tmp_path / "moved"))[0]["views"]
    finally:
        move(str(tmp_path / "moved"), str(capture.folder))


@pytest.mark.slow
def test_the_photographs_of_another_scene_are_refused(run: Path, tmp_path: Path) -> None:
    synthesise(tmp_path / "ball", SynthParameters(scene="ball", n_sensors=2, n_frames=1, size=(64, 48)))
    with pytest.raises(ValueError, match=r"is the recording of ball, the run is of sphere; say where .* --capture FOL"):
        measure_views(run, ViewSettings(capture=tmp_path / "ball"))


@pytest.mark.parametrize("threshold", [0.0, -1.0, float("nan"), float("inf")])
def test_a_threshold_that_is_no_length_is_refused(threshold: float) -> None:
    with pytest.raises(ValueError, match=f"threshold is {threshold:g} mm, expected a length above 0"):
        ViewSettings(threshold=threshold)
