"""The way from a capture to a stimulus set: resumable, and the same for every approach of a scene."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer import BadParameter

from app.intake.models import read_models
from recon.capture.format import Capture, read_capture
from recon.capture.images import read_image
from recon.capture.masks import segment_capture
from recon.cli.options import parse_frames, parse_loops
from recon.depth.disparity_io import read_disparity
from recon.geometry.mesh_files import read_mesh
from recon.pipeline import stages
from recon.pipeline.film import Film, RenderOptions, make_part, make_path, shown_frames
from recon.pipeline.film_plan import check_loops, planned_films
from recon.pipeline.job import FIRST_WORK, PM_WORK, ReconstructOptions, planned_job
from recon.pipeline.methods import match
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.render import render
from recon.pipeline.run import mesh_name, read_run, recorded_in
from recon.pipeline.sources import run_source
from recon.render.camera_path import camera_path
from recon.render.encoding.video import probe_video, read_luma
from recon.render.path_file import read_path
from recon.runtime.artefacts import file_digest
from recon.runtime.files import read_json, write_json
from recon.runtime.workers import ThisProcess
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MESH
from recon.surface import SurfaceParameters
from recon.validation.clouds import read_shape
from recon.validation.export_models import write_models
from recon.validation.truth.evaluation import signed_distances_to
from tests.command_line import Command, command_line

WHOLE_WAY = """
import os
import signal
import sys
from pathlib import Path
from recon.pipeline.film import RenderOptions
from recon.pipeline.reconstruct import reconstruct
from recon.pipeline.render import render
from recon.pipeline.job import ReconstructOptions

capture, run, stimuli = map(Path, sys.argv[1:4])
n_left = int(sys.argv[4])

def die_after_some(event, arguments):
    global n_left
    if event in ("open", "os.rename") and str(arguments[0]).startswith((str(run), str(stimuli))):
        n_left -= 1
        if n_left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

sys.addaudithook(die_after_some)
reconstruct(capture, run, ReconstructOptions(depths=("id",)))
render([run], stimuli, RenderOptions(size=(96, 64), seconds=2.4, renderer="software"))
"""
LONG = RenderOptions(size=(96, 64), seconds=2.4, renderer="software")  # in two parts
SMALL = RenderOptions(size=(96, 64), seconds=0.4, renderer="software")


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    folder = tmp_path_factory.mktemp("studio") / "ball"
    return synthesise(folder, SynthParameters(scene="ball", n_sensors=2, n_frames=2, size=(320, 240), noise=0.5))


@pytest.fixture(scope="module")
def run(capture: Capture, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    reconstruct(capture.folder, folder, ReconstructOptions(depths=("id",)))
    return folder


@pytest.fixture(scope="module")
def long_set(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return render([run], tmp_path_factory.mktemp("long"), LONG).parent


@pytest.fixture(scope="module")
def small_set(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return render([run], tmp_path_factory.mktemp("small"), SMALL).parent


def films_of(run: Path, options: RenderOptions) -> list[Film]:
    source = run_source(read_run(run))
    return [Film(sequence, source.setting, options) for sequence in source.sequences]


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    return command_line(monkeypatch, capsys)


def digests(folder: Path, pattern: str) -> dict[str, str]:
    return {str(path.relative_to(folder)): file_digest(path) for path in sorted(folder.rglob(pattern))}


@pytest.mark.slow
def test_models_of_one_frame_are_gathered_with_their_errors(run: Path, capture: Capture, tmp_path: Path) -> None:
    write_models([run], tmp_path, None, lambda *_: None)
    found = read_models(tmp_path)
    assert {(one.dataset, one.condition, one.kind) for one in found} == {
        ("ball", approach, kind) for approach in ("id_fa", "id_fb") for kind in ("mesh", "cloud")
    }
    mesh = next(one for one in found if (one.condition, one.kind) == ("id_fb", "mesh"))
    truth = read_shape(capture.folder / MESH.format(frame=1))
    errors = np.abs(signed_distances_to(truth, read_mesh(mesh.path).vertices))
    assert mesh.error_limit_mm == pytest.approx(np.percentile(errors, 95), rel=1e-6)
    with pytest.raises(ValueError, match="has no frame 7; it has 0 to 1"):
        write_models([run], tmp_path, 7, lambda *_: None)


@pytest.mark.slow
def test_models_from_before_beside_those_of_the_run_are_named(command: Command, run: Path, tmp_path: Path) -> None:
    before = tmp_path / "meshes/ball/pm_fb.ply"
    before.parent.mkdir(parents=True)
    before.touch()
    told = command("models", run, "-o", tmp_path, "--frame", "0")
    assert told.code == 0
    assert "has models from before, too: meshes/ball/pm_fb.ply" in told.err


@pytest.mark.slow
def test_a_run_has_a_contact_sheet_of_all_approaches(run: Path) -> None:
    sheet = read_image(run / "previews/0000.png")
    assert sheet.shape[0] > 2 * 480  # a row of four pictures for each of two approaches
    assert sheet.shape[1] > 4 * 480
    assert len(np.unique(sheet.reshape(-1, 3), axis=0)) > 1000


@pytest.mark.slow
def test_a_run_that_lost_a_cloud_makes_it_again_and_nothing_else(capture: Capture, run: Path) -> None:
    before = digests(run, "*.ply")
    lost = run / "clouds/id/S1/0001.ply"
    lost.unlink()
    n_made = len((run / "log.jsonl").read_text().splitlines())
    reconstruct(capture.folder, run, ReconstructOptions(depths=("id",)))
    assert len((run / "log.jsonl").read_text().splitlines()) == n_made + 1
    assert digests(run, "*.ply") == before


@pytest.mark.slow
def test_what_an_earlier_start_finished_does_not_make_the_time_that_is_left_short(
    capture: Capture, run: Path, tmp_path: Path
) -> None:
    again = Path(copytree(run, tmp_path / "run"))
    (again / "clouds/id/S1/0001.ply").unlink()
    told: list[tuple[str, int, int]] = []
    reconstruct(capture.folder, again, ReconstructOptions(depths=("id",)), lambda *event: told.append(event))
    n_clouds = next(total for stage, _, total in told if stage == "clouds")
    assert [total for stage, done, total in told if (stage, done) == ("clouds", 1)][-1] == 1 < n_clouds
    assert [event for event in told if event[0] == "matching"][-1] == ("matching", n_clouds, n_clouds)


@pytest.mark.slow
def test_a_frame_by_pm_counts_as_the_work_that_it_is_so_that_the_time_left_can_be_told(
    capture: Capture, tmp_path: Path
) -> None:
    job = planned_job(capture, tmp_path / "run", ReconstructOptions(depths=("id", "pm")))
    assert [job.work(each) for each in job.stretches if each[0].method == "id"] == [1] * 4
    assert [job.work(each) for each in job.stretches if each[0].method == "pm"] == [PM_WORK * (FIRST_WORK + 1)] * 2


@pytest.mark.slow
def test_frames_are_made_one_after_the_other_so_that_slow_methods_do_not_come_last(
    capture: Capture, tmp_path: Path
) -> None:
    reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(depths=("id", "dr")))
    made = [json.loads(line)["made"] for line in (tmp_path / "run/log.jsonl").read_text().splitlines()]
    for stage in ("matched", "meshes"):
        frames = [Path(name).stem for name in made if name.startswith(stage)]
        assert frames == ["0000"] * 4 + ["0001"] * 4


@pytest.mark.slow
def test_another_voxel_makes_only_the_meshes_again(capture: Capture, run: Path, tmp_path: Path) -> None:
    again = tmp_path / "run"
    copytree(run, again)
    n_made = len((again / "log.jsonl").read_text().splitlines())
    options = ReconstructOptions(depths=("id",), surface=SurfaceParameters(voxel_mm=60.0))
    reconstruct(capture.folder, again, options)
    made = (again / "log.jsonl").read_text().splitlines()[n_made:]
    assert len(made) == 4
    assert all("meshes/" in line for line in made)


@pytest.mark.slow
def test_a_run_that_is_started_with_other_methods_names_those_that_it_leaves(
    capture: Capture, run: Path, tmp_path: Path
) -> None:
    again = copytree(run, tmp_path / "run")
    found = reconstruct(capture.folder, again, ReconstructOptions(depths=("id",), fusions=("fb",)))
    assert found["approaches"] == ["id_fb"]
    assert [text for text in found["warnings"] if text.startswith("models of id_fa from an earlier start stay")]
    assert (again / "meshes/id_fa/0000.ply").is_file()


@pytest.mark.slow
def test_a_start_with_other_options_that_is_stopped_leaves_no_run(capture: Capture, run: Path, tmp_path: Path) -> None:
    changed = copytree(run, tmp_path / "run")

    def stop(what: str, done: int, _total: int) -> None:
        if what == "meshes" and done == 1:
            raise KeyboardInterrupt

    options = ReconstructOptions(depths=("id",), surface=SurfaceParameters(voxel_mm=60.0))
    with pytest.raises(KeyboardInterrupt):
        reconstruct(capture.folder, changed, options, stop)
    with pytest.raises(ValueError, match="is not a finished run"):
        read_run(changed)
    assert reconstruct(capture.folder, changed, options)["options"]["surface"]["voxel_mm"] == 60.0


@pytest.mark.slow
def test_integer_disparities_stay_whole_when_they_are_filtered_in_time(run: Path) -> None:
    paths = list((run / "depth/id").rglob("*.tiff"))
    assert paths
    for path in paths:
        disparity = read_disparity(path)
        assert np.array_equal(disparity, np.rint(disparity), equal_nan=True)


@pytest.mark.slow
def test_balanced_colours_make_other_colours_and_the_same_shapes(capture: Capture, run: Path, tmp_path: Path) -> None:
    again = Path(copytree(run, tmp_path / "run"))
    reconstruct(capture.folder, again, ReconstructOptions(depths=("id",), balance_colours=True))
    gain = np.array(read_json(again / "colours.json")["gain"])
    assert gain.shape == (2, 3)
    assert np.allclose(gain.mean(axis=0), 1)
    before, after = (read_mesh(folder / "meshes/id_fb/0000.ply") for folder in (run, again))
    assert np.array_equal(before.vertices, after.vertices)
    assert not np.array_equal(before.colours, after.colours)


@pytest.mark.slow
def test_photographs_are_a_level_of_the_colour_and_leave_shapes_and_vertices_as_they_were(
    capture: Capture, run: Path, tmp_path: Path
) -> None:
    again = Path(copytree(run, tmp_path / "run"))
    options = ReconstructOptions(depths=("id",), fusions=("fb",), colours=("vertices", "photographs"))
    described = reconstruct(capture.folder, again, options)
    assert described["approaches"] == ["id_fb", "id_fb_photographs"]
    assert digests(again, "meshes/id_fb/*.ply") == digests(run, "meshes/id_fb/*.ply")
    plain, pictured = (read_mesh(again / mesh_name(name, 0)) for name in described["approaches"])
    assert pictured.texture is not None
    assert len(pictured.faces) == len(plain.faces)
    assert np.array_equal(np.unique(pictured.vertices, axis=0), np.unique(plain.vertices, axis=0))
    assert np.mean(np.abs(pictured.colours.mean(axis=0) - plain.colours.mean(axis=0))) < 10
    manifest = read_json(render([again], tmp_path / "set", SMALL))
    assert manifest["factors"] == {"depth": ["id"], "fusion": ["fb"], "colour": ["vertices", "photographs"]}
    n_made = len((again / "log.jsonl").read_text().splitlines())
    reconstruct(capture.folder, again, options)
    assert len((again / "log.jsonl").read_text().splitlines()) == n_made


@pytest.mark.slow
def test_holes_are_filled_and_marked_where_masks_show_the_object(capture: Capture, tmp_path: Path) -> None:
    masked = Path(copytree(capture.folder, tmp_path / "masked"))
    segment_capture(masked)
    options = ReconstructOptions(depths=("id",), fusions=("fb",), frames=range(1), colours=("vertices", "photographs"))
    made = {}
    for name, fill_px in (("open", 0), ("filled", 16)):
        reconstruct(masked, tmp_path / name, replace(options, fill_px=fill_px))
        made[name] = read_mesh(tmp_path / name / mesh_name("id_fb", 0))
    assert made["open"].filled is None
    assert made["filled"].filled is not None
    assert 0.001 < made["filled"].filled.mean() < 0.3
    textured = read_mesh(tmp_path / "filled" / mesh_name("id_fb_photographs", 0))
    assert textured.filled is not None
    assert 0 < textured.filled.mean() < 0.3


def test_an_unknown_source_of_colours_is_named(capture: Capture, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="unknown colour 'photos', expected one of vertices, photographs"):
        reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(colours=("photos",)))
    with pytest.raises(ValueError, match="no colours were chosen, expected some of vertices, photographs"):
        reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(colours=()))
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_worker_processes_make_the_same_files(capture: Capture, run: Path, tmp_path: Path) -> None:
    reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(depths=("id",), workers=2))
    assert digests(tmp_path / "run", "*.ply") == digests(run, "*.ply")


@pytest.mark.slow
def test_runs_killed_at_random_moments_end_with_the_same_files(
    capture: Capture, run: Path, long_set: Path, tmp_path: Path
) -> None:
    """`kill -9` of the whole way before it opens or renames some file, again and again; then it is left alone."""
    again, stimuli = tmp_path / "run", tmp_path / "set"
    command = [sys.executable, "-c", WHOLE_WAY, str(capture.folder), str(again), str(stimuli)]
    for n_files in np.random.default_rng(7).integers(20, 130, 3):  # of some 400
        assert subprocess.run([*command, str(n_files)]).returncode == -signal.SIGKILL
    assert subprocess.run([*command, "0"]).returncode == 0
    assert digests(again, "*.ply") == digests(run, "*.ply")
    assert digests(stimuli, "*.mp4") == digests(long_set, "*.mp4")
    assert not list(tmp_path.rglob(".*.part*"))


@pytest.mark.slow
def test_a_stimulus_set_has_a_video_and_a_master_of_every_approach(small_set: Path) -> None:
    manifest = read_json(small_set / "manifest.json")
    assert [entry["approach"] for entry in manifest["stimuli"]] == ["id_fa", "id_fb"]
    assert manifest["factors"] == {"depth": ["id"], "fusion": ["fa", "fb"]}
    for entry in manifest["stimuli"]:
        facts = probe_video(small_set / entry["video"])
        assert (facts.width, facts.height, facts.n_frames, facts.fps) == (96, 64, 10, 25.0)
        assert entry["sha256"] == file_digest(small_set / entry["video"])
        assert probe_video(small_set / entry["master"]).n_frames == 10
        assert probe_video(small_set / entry["mask"]).n_frames == 10
        mask = next(read_luma(small_set / entry["mask"]))
        assert set(np.unique(mask)) == {16, 235}
        assert 0.02 < (mask == 235).mean() < 0.6
        assert entry["model_frames"] == 2


@pytest.mark.slow
def test_a_path_that_is_read_back_makes_the_same_videos_for_every_approach(run: Path, tmp_path: Path) -> None:
    first = read_json(render([run], tmp_path / "one", replace(SMALL, path="orbit")))
    written = tmp_path / "one/paths/ball.json"
    digest = {"ball": {"file": "paths/ball.json", "sha256": file_digest(written)}}
    assert (first["provenance"]["render"]["path"], first["provenance"]["paths"]) == ("orbit", digest)
    again = read_json(render([run], tmp_path / "two", replace(SMALL, path=written)))
    assert again["provenance"]["render"]["path"] == "ball.json"
    assert digests(tmp_path / "one", "*.mp4") == digests(tmp_path / "two", "*.mp4")


@pytest.mark.slow
def test_another_path_makes_other_videos_and_the_same_path_none(run: Path, tmp_path: Path) -> None:
    made: list[dict[str, str]] = []
    for path in ("auto", "sensors", "swing"):
        seen: dict[str, int] = {}
        render(
            [run], tmp_path, replace(SMALL, path=path), lambda what, _done, total, seen=seen: seen.update({what: total})
        )
        n_frames = 0 if path == "sensors" else 20
        assert seen == {"models checked": 4, "video frames": n_frames}, "of two sensors, auto goes along the sensors"
        made.append(digests(tmp_path, "*.mp4") | digests(tmp_path / "paths", "*.json"))
    assert made[0] == made[1]
    assert not made[1].items() & made[2].items()


@pytest.mark.slow
def test_all_approaches_of_a_run_have_the_cameras_that_are_written(run: Path, tmp_path: Path) -> None:
    films = films_of(run, SMALL)
    texts = []
    for film in films:
        make_path(film, tmp_path / film.sequence.approach)
        texts.append((tmp_path / film.sequence.approach / "paths/ball.json").read_bytes())
    assert texts[0] == texts[1]
    read = read_path(tmp_path / "id_fa/paths/ball.json", SMALL.n_frames, SMALL.size)
    for camera, expected in zip(read, films[0].cameras(), strict=True):
        assert np.allclose(camera.cam_from_world, expected.cam_from_world, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_runs_of_one_dataset_with_other_bounds_would_take_other_paths(run: Path) -> None:
    described = read_run(run)
    source = run_source(described)
    wider = replace(described, capture=replace(described.capture, bounds=described.capture.bounds * 1.1))
    with pytest.raises(ValueError, match=r"ball: .* would be filmed along different paths"):
        planned_films([source, run_source(wider)], SMALL, ThisProcess(), lambda *_: None)


@pytest.mark.slow
def test_a_set_is_not_rendered_by_the_path_that_it_would_replace(run: Path, tmp_path: Path) -> None:
    written = tmp_path / "paths/ball.json"
    with pytest.raises(ValueError, match="is written by this command"):
        render([run], tmp_path, replace(SMALL, path=written))


@pytest.mark.slow
def test_the_command_offers_each_kind_of_path(command: Command, run: Path, tmp_path: Path) -> None:
    where = ("--size", "96x64", "--seconds", 0.2, "--renderer", "software", "--path", "orbit")
    told = command("render", run, "-o", tmp_path, *where)
    assert told.code == 0, told.err
    assert read_json(tmp_path / "manifest.json")["provenance"]["render"]["path"] == "orbit"
    capture = read_run(run).capture
    expected = camera_path(capture.rig, capture.bounds, 5, (96, 64), kind="orbit")
    for camera, wanted in zip(read_path(tmp_path / "paths/ball.json", 5, (96, 64)), expected, strict=True):
        assert np.allclose(camera.cam_from_world, wanted.cam_from_world, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_the_command_refuses_a_path_that_is_neither_kind_nor_fitting_file(
    command: Command, run: Path, tmp_path: Path
) -> None:
    told = command("render", run, "-o", tmp_path / "set", "--path", "spiral")
    assert told.code == 2
    assert "'spiral' is no file of cameras, and none of auto, sensors, orbit, swing" in told.err
    make_path(films_of(run, SMALL)[0], tmp_path)
    told = command("render", run, "-o", tmp_path / "set", "--size", "96x64", "--path", tmp_path / "paths/ball.json")
    assert told.code == 1
    assert "paths/ball.json: found 10 cameras, the film has 375 frames" in told.err
    assert not (tmp_path / "set").exists()


@pytest.mark.slow
def test_worker_processes_share_a_video_and_make_the_same_bytes(run: Path, long_set: Path, tmp_path: Path) -> None:
    seen: list[tuple[str, int, int]] = []
    render([run], tmp_path, replace(LONG, workers=2), lambda *event: seen.append(event))
    assert digests(tmp_path, "*.mp4") == digests(long_set, "*.mp4")
    assert ("video frames", 0, 120) in seen
    assert seen[-1] == ("video frames", 120, 120)
    assert not (tmp_path / ".parts").exists()


@pytest.mark.slow
def test_a_video_that_was_stopped_is_resumed_by_its_parts(run: Path, tmp_path: Path) -> None:
    options = replace(LONG, floor="bounds")
    films = films_of(run, options)
    make_part(films[0], tmp_path / "set", films[0].parts[1], threads=1)
    part = tmp_path / "set" / films[0].names(films[0].parts[1])[0]
    written = part.stat().st_mtime_ns

    told: list[tuple[int, int]] = []

    def stop(what: str, done: int, total: int) -> None:
        if what == "video frames":
            told.append((done, total))
            if done == 100:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render([run], tmp_path / "set", options, stop)
    assert told == [(0, 120), (50, 120), (50, 110), (100, 110)], "what was there says nothing about the time left"
    assert part.stat().st_mtime_ns == written
    seen: list[tuple[str, int]] = []
    manifest = read_json(render([run], tmp_path / "set", options, lambda what, done, _total: seen.append((what, done))))
    assert [entry["n_frames"] for entry in manifest["stimuli"]] == [60, 60]
    seen.clear()
    render([run], tmp_path / "set", options, lambda what, done, _total: seen.append((what, done)))
    assert [event for event in seen if event[0] == "video frames"] == [("video frames", 0)], "nothing is rendered again"


@pytest.mark.slow
def test_a_set_whose_films_were_being_replaced_has_no_manifest(run: Path, small_set: Path, tmp_path: Path) -> None:
    changed = copytree(small_set, tmp_path / "set")

    def stop(what: str, done: int, _total: int) -> None:
        if what == "video frames" and done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render([run], changed, replace(SMALL, background="dark"), stop)
    assert not (changed / "manifest.json").exists()


def test_a_folder_that_is_no_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="is not a finished run"):
        render([tmp_path], tmp_path / "set", SMALL)


@pytest.mark.slow
def test_a_run_from_before_recordings_were_noted_is_read_as_before(run: Path, tmp_path: Path) -> None:
    older = Path(copytree(run, tmp_path / "run"))
    content = read_json(older / "run.json")
    del content["recording"]
    write_json(older / "run.json", content)
    assert read_run(older).approaches == ("id_fa", "id_fb")
    with pytest.raises(ValueError, match="does not say where its recording is"):
        recorded_in(read_run(older))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"size": (0, 0)}, "size is 0x0, expected even numbers of pixels from 2 to 16384"),
        ({"size": (96, 65)}, "size is 96x65, expected even"),
        ({"size": (96, 100_000)}, "size is 96x100000, expected even"),
        ({"background": "pink"}, "there is no background 'pink'; expected one of studio, dark, plain"),
        ({"fps": 0.0}, "fps is 0, expected a number above 0"),
        ({"fps": float("nan")}, "fps is nan, expected a number above 0"),
        ({"seconds": float("nan")}, "seconds is nan, expected a number above 0"),
        ({"seconds": float("inf")}, "seconds is inf, expected a number above 0"),
    ],
)
def test_how_to_film_is_checked_before_anything_is_read(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        RenderOptions(**wrong)


def test_a_folder_of_films_does_not_become_a_run(capture: Capture, tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text("{}", encoding="utf-8")
    with pytest.raises(ValueError, match=r"holds manifest\.json, which no reconstruction wrote"):
        reconstruct(capture.folder, tmp_path, ReconstructOptions(depths=("id",)))
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]


def test_frames_that_a_capture_does_not_have_are_named(capture: Capture, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="has frames 0 to 1, none of them in 5:9"):
        reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(frames=range(5, 9)))
    with pytest.raises(ValueError, match=r"none of them in 5:$"):
        reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(frames=parse_frames("5:")))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("text", "frames"), [("3", range(3)), ("2:5", range(2, 5)), (":4", range(4)), ("1:", range(1, sys.maxsize))]
)
def test_frames_are_counted_from_the_first_or_named_from_one_to_the_next(text: str, frames: range) -> None:
    assert parse_frames(text) == frames


@pytest.mark.parametrize("text", ["0", "-1", "a:b", "1.5", ""])
def test_what_names_no_frames_is_refused(text: str) -> None:
    with pytest.raises(BadParameter, match=re.escape(f"{text!r} are no frames; expected their number")):
        parse_frames(text)


def test_a_loop_is_for_all_approaches_or_for_one_and_is_told_once() -> None:
    assert parse_loops(["a=repeat", "static", "b = bounce"], "c, d") == (
        "static",
        {"a": "repeat", "b": "bounce", "c": "static", "d": "static"},
    )
    for texts, static, sentence in (
        (["a=repeat", "a=bounce"], "", "a would be both repeat and bounce"),
        (["a=bounce"], "a", "a would be both static and bounce"),
        (["repeat", "bounce"], "", "all would be both repeat and bounce"),
    ):
        with pytest.raises(BadParameter, match=sentence):
            parse_loops(texts, static)


def test_an_unknown_method_is_named_before_anything_is_made(capture: Capture, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="unknown depth method 'xx'"):
        reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(depths=("xx",)))
    with pytest.raises(ValueError, match="unknown fusion method 'fc', expected one of fa, fb"):
        reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(fusions=("fc",)))
    with pytest.raises(ValueError, match="no fusion was named, so there is nothing to make; expected some of fa, fb"):
        reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(fusions=()))
    assert not (tmp_path / "run").exists()


@given(st.integers(1, 9), st.integers(1, 60), st.floats(0.05, 3), st.sampled_from(["repeat", "bounce", "static"]))
def test_a_video_shows_only_frames_that_were_recorded(n_recorded: int, n_shown: int, step: float, loop: str) -> None:
    shown = shown_frames(n_recorded, n_shown, step, loop)
    assert len(shown) == n_shown
    assert shown[0] == 0
    assert set(shown) <= set(range(n_recorded))


def test_a_recording_is_played_again_or_back_and_forth_or_not_at_all() -> None:
    assert shown_frames(3, 8, 1.0, "repeat") == [0, 1, 2, 0, 1, 2, 0, 1]
    assert shown_frames(3, 8, 1.0, "bounce") == [0, 1, 2, 1, 0, 1, 2, 1]
    assert shown_frames(3, 4, 0.5, "bounce") == [0, 0, 1, 1]
    assert shown_frames(3, 3, 1.0, "static") == [0, 0, 0]


@pytest.mark.slow
def test_patchmatch_stands_still_where_it_is_asked_to_and_its_film_shows_a_still(
    capture: Capture, tmp_path: Path
) -> None:
    options = ReconstructOptions(depths=("id", "pm"), fusions=("fb",), pm="static")
    content = reconstruct(capture.folder, tmp_path / "run", options)
    assert content["static"] == ["pm_fb"]
    assert set(content["meshes"]) == {f"meshes/{name}.ply" for name in ("id_fb/0000", "id_fb/0001", "pm_fb/0000")}
    assert sorted(path.stem for path in (tmp_path / "run/matched/pm/S1").iterdir()) == ["0000"]
    run = read_run(tmp_path / "run")
    sequences = {sequence.approach: sequence for sequence in run_source(run).sequences}
    assert RenderOptions().loop_of(sequences["pm_fb"]) == "static"
    assert RenderOptions().loop_of(sequences["id_fb"]) == "bounce"
    check_loops([run_source(run)], RenderOptions())  # raises where lengths differ
    write_models([tmp_path / "run"], tmp_path / "models", 1, lambda *_: None)
    moving = ReconstructOptions(depths=("id", "pm"), fusions=("fb",))
    again = reconstruct(capture.folder, tmp_path / "run", moving)
    assert again["static"] == []
    assert again["meshes"]["meshes/pm_fb/0000.ply"] == content["meshes"]["meshes/pm_fb/0000.ply"]
    assert "meshes/pm_fb/0001.ply" in again["meshes"]


@pytest.mark.slow
def test_a_lost_depth_map_of_patchmatch_is_made_again_from_the_frames_before(capture: Capture, tmp_path: Path) -> None:
    options = ReconstructOptions(depths=("pm",), fusions=("fb",))
    reconstruct(capture.folder, tmp_path / "run", options)
    before = digests(tmp_path / "run/matched", "*.tiff")
    (tmp_path / "run/matched/pm/S1/0001.tiff").unlink()
    reconstruct(capture.folder, tmp_path / "run", options)
    assert digests(tmp_path / "run/matched", "*.tiff") == before


@pytest.mark.slow
def test_a_frame_with_the_pictures_of_the_one_before_is_taken_as_it_was_matched(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    still = Path(copytree(capture.folder, tmp_path / "still"))
    for second in still.rglob("0001.png"):
        second.write_bytes(second.with_name("0000.png").read_bytes())
    matched: list[Path] = []

    def counting(method: Any, pair: Any, folder: Path, *rest: Any) -> Any:
        matched.append(folder)
        return match(method, pair, folder, *rest)

    monkeypatch.setattr(stages, "match", counting)
    job = planned_job(read_capture(still), tmp_path / "run", ReconstructOptions(depths=("id", "dr")))
    for sensor in job.matched_sensors:
        stages.measure_rows(job, sensor)
    for stretch in job.stretches:
        stages.match_stretch(job, stretch)
    assert [folder.name for folder in matched] == ["0000"] * 4
    for sequence in job.sequences:
        first, second = (read_disparity(job.artefacts.path(view.matched)) for view in sequence)
        np.testing.assert_array_equal(first, second)
