"""Models of other programs are filmed beside those of a run: the same path, light and backdrop, in one set."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from recon.capture.format import CameraStream, Capture, SensorStream, write_capture
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.mesh_files import write_cloud, write_mesh
from recon.geometry.normals import surface_normals
from recon.geometry.rig import Camera, look_at
from recon.models.inspection import standing_height
from recon.pipeline.film import Film, RenderOptions
from recon.pipeline.film_plan import planned_films
from recon.pipeline.render import render
from recon.pipeline.run import Run, mesh_name, read_run, write_run
from recon.pipeline.sources import read_sources
from recon.runtime.artefacts import Artefacts, file_digest
from recon.runtime.files import read_json, write_json
from recon.runtime.workers import ThisProcess
from tests.command_line import Command, command_line

pytestmark = pytest.mark.slow

BOUNDS = np.array([[-500.0, 0, -500], [500, 1000, 500]])
SHORT = RenderOptions(size=(64, 48), seconds=0.16, renderer="software")  # four frames


def blob(frame: int) -> Mesh:
    """A coloured octahedron that grows."""
    corners = np.array([[1, 0, 0], [0, 0, 1], [-1, 0, 0], [0, 0, -1], [0, 1, 0], [0, -1, 0]], np.float64)
    sides = [[0, 1], [1, 2], [2, 3], [3, 0]]
    faces = np.array([[b, a, 4] for a, b in sides] + [[a, b, 5] for a, b in sides])
    vertices = corners * (300 + 40 * frame) + [0, 450, 0]
    colours = np.array([[220, 40, 40], [40, 220, 40], [40, 40, 220], [220, 220, 40], [40, 220, 220], [220, 40, 220]])
    normals = surface_normals(vertices, faces)
    return Mesh(vertices.astype(np.float32), faces.astype(np.int32), normals, colours.astype(np.uint8))


def recording(folder: Path) -> Capture:
    K = np.array([[300.0, 0, 159.5], [0, 300, 119.5], [0, 0, 1]])
    sensors = []
    for number, x in enumerate((-800.0, 800.0)):
        left, right = (
            CameraStream(
                Camera(K, (320, 240), look_at([x + side, 700, 2000], [side, 500, 0])), f"{name}{{frame:04d}}.png"
            )
            for side, name in ((-40, f"S{number}/left/"), (40, f"S{number}/right/"))
        )
        sensors.append(SensorStream(f"S{number}", left, right))
    return Capture(folder, "ball", "scene", 25.0, 3, BOUNDS, {}, tuple(sensors))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three frames by one approach, as `reconstruct` leaves it."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    artefacts = Artefacts(folder)
    for frame in range(3):
        artefacts.make(mesh_name("pm_fb", frame), {}, lambda path, frame=frame: write_mesh(path, blob(frame)) and None)
    described = Run(folder, recording(folder), ("pm_fb",), (0, 1, 2), {"python": "3"}, "../ball")
    write_run(described, options={}, timings={}, warnings=())
    return folder


@pytest.fixture
def models(run: Path, tmp_path: Path) -> Path:
    """A folder of models that are those of the run, and a cube that does not move."""
    folder = tmp_path / "models"
    for frame in range(3):
        write_mesh(folder / f"theirs/{frame + 1:04d}.ply", blob(frame))
    write_obj(folder / "cube.obj")
    describe(folder, path={"sensors_of": str(run)}, levels={"theirs": {"depth": "pm"}})
    return folder


def write_obj(path: Path, size: float = 400.0, colour: tuple[int, int, int] = (30, 90, 200)) -> None:
    """A textured cube on the floor."""
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = ((1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6))
    lines = [f"v {(x - 0.5) * size} {y * size} {(z - 0.5) * size}" for x, y, z in corners]
    lines += ["mtllib cube.mtl", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "usemtl skin"]
    lines += ["f " + " ".join(f"{v}/{t}" for t, v in enumerate(quad, 1)) for quad in quads]
    path.write_text("\n".join(lines) + "\n")
    path.with_name("cube.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    cv2.imwrite(str(path.with_name("skin.png")), np.full((8, 8, 3), colour[::-1], np.uint8))


def describe(folder: Path, **changes: Any) -> None:
    scene = {"schema_version": 1, "dataset": "ball", "fps": 25, "units": "mm", "up": "y", "path": {"orbit": {}}}
    write_json(folder / "scene.json", scene | changes)


def films_of(folders: list[Path], options: RenderOptions = SHORT) -> dict[str, Film]:
    films, _ = planned_films(read_sources(folders), options, ThisProcess(), lambda *_: None)
    return {film.sequence.approach: film for film in films}


def digests(folder: Path) -> dict[str, str]:
    return {path.name: file_digest(path) for path in folder.rglob("*.mp4")}


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Command:
    return command_line(monkeypatch, capsys)


def test_a_folder_that_is_not_there_is_named_as_missing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"rnu: there is no such folder"):
        read_sources([tmp_path / "rnu"])


def test_a_packed_mesh_of_a_run_is_filmed_as_the_plain_one(run: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed"
    for frame in range(3):
        name = mesh_name("pm_fb", frame, packed=frame == 1)
        Artefacts(packed).make(name, {}, lambda path, frame=frame: write_mesh(path, blob(frame)) and None)
    write_run(replace(read_run(run), folder=packed, packed=(1,)), options={}, timings={}, warnings=())
    (source,) = read_sources([packed])
    assert [file.suffix for file in source.sequences[0].files] == [".ply", ".parquet", ".ply"]
    for frame in range(3):
        mesh = source.sequences[0].read(frame)
        assert isinstance(mesh, Mesh)
        assert np.array_equal(mesh.vertices, blob(frame).vertices)
        assert np.array_equal(mesh.colours, blob(frame).colours)


def test_a_run_and_models_become_one_set(run: Path, models: Path, tmp_path: Path) -> None:
    manifest = read_json(render([run, models], tmp_path / "set", SHORT))
    entries = {entry["approach"]: entry for entry in manifest["stimuli"]}
    told = {name: (entry["levels"], entry["model_frames"], entry["loop"]) for name, entry in entries.items()}
    assert told == {
        "cube": ({}, 1, "static"),
        "pm_fb": ({"depth": "pm", "fusion": "fb"}, 3, "bounce"),
        "theirs": ({"depth": "pm"}, 3, "bounce"),
    }
    assert manifest["factors"] == {"depth": ["pm"], "fusion": ["fb"]}
    (source,) = manifest["provenance"]["models"]
    assert source["scene"] == read_json(models / "scene.json")
    assert source["scene_sha256"] == file_digest(models / "scene.json")
    assert list(source["sha256"]["theirs"]) == ["0001.ply", "0002.ply", "0003.ply"]
    made = digests(tmp_path / "set")
    assert made["theirs.mp4"] == made["pm_fb.mp4"], "the same models make the same film, to the byte"
    assert made["cube.mp4"] != made["pm_fb.mp4"]


def test_models_by_the_sensors_of_a_capture_have_its_cameras_and_bounds(
    run: Path, models: Path, tmp_path: Path
) -> None:
    write_capture(replace(recording(tmp_path / "capture"), folder=tmp_path / "capture"))
    describe(models, path={"sensors_of": "../capture"})
    alone, beside = films_of([models])["cube"], films_of([run])["pm_fb"]
    assert np.array_equal(alone.bounds, beside.bounds)
    for camera, other in zip(alone.cameras(), beside.cameras(), strict=True):
        assert np.array_equal(camera.cam_from_world, other.cam_from_world)
        assert np.array_equal(camera.K, other.K)


def test_a_changed_file_is_filmed_anew_and_nothing_else(run: Path, models: Path, tmp_path: Path) -> None:
    on_ground = replace(SHORT, floor=0.0)  # else the floor follows the models, in all films

    def n_rendered() -> int:
        seen: dict[str, int] = {}
        render([run, models], tmp_path / "set", on_ground, lambda what, _done, total: seen.update({what: total}))
        return seen["video frames"]

    assert n_rendered() == 12
    assert n_rendered() == 0
    describe(models, path={"sensors_of": str(run)}, levels={"cube": {"depth": "none"}})
    assert n_rendered() == 0, "levels are not in the pictures"
    write_obj(models / "cube.obj", colour=(200, 30, 30))
    assert n_rendered() == 4
    write_mesh(models / "theirs/0002.ply", blob(5))
    assert n_rendered() == 4
    describe(models, path={"sensors_of": str(run)}, world_from_model=np.diag([0.9, 0.9, 0.9, 1]).tolist())
    assert n_rendered() == 8


def test_a_mesh_of_a_run_that_was_replaced_is_refused(run: Path, tmp_path: Path) -> None:
    mesh = run / mesh_name("pm_fb", 1)
    original = mesh.read_bytes()
    try:
        write_mesh(mesh, blob(7))
        with pytest.raises(ValueError, match=r"pm_fb/0001\.ply: is not the mesh that was reconstructed here"):
            render([run], tmp_path / "set", SHORT)
        mesh.unlink()
        with pytest.raises(ValueError, match=r"pm_fb/0001\.ply: this mesh of the run is missing"):
            render([run], tmp_path / "set", SHORT)
    finally:
        mesh.write_bytes(original)
    assert not (tmp_path / "set").exists()


def test_every_wrong_model_is_named_and_nothing_is_written(models: Path, tmp_path: Path, command: Command) -> None:
    write_obj(models / "huge.obj", size=1e6)
    (models / "skin.png").unlink()
    (models / "nan.obj").write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (models / "theirs/0002.ply").write_bytes((models / "theirs/0002.ply").read_bytes()[:-5])
    told = command("render", models, "-o", tmp_path / "set", "--size", "64x48", "--seconds", 0.2)
    assert told.code == 1
    for sentence in (
        "nan.obj: its v number 1",
        "cube.obj: its texture skin.png is missing",
        "0002.ply: is not a whole PLY",
    ):
        assert told.err.count(sentence) == 1
    assert not (tmp_path / "set").exists()


def test_a_mesh_that_has_lost_its_faces_is_no_cloud_among_meshes(run: Path, models: Path, tmp_path: Path) -> None:
    describe(models, path={"sensors_of": str(run)}, splat_mm=3)
    mesh = blob(1)
    write_cloud(models / "theirs/0002.ply", Cloud(mesh.vertices, mesh.normals, mesh.colours))
    with pytest.raises(
        ValueError, match=r"^\S*0002\.ply: has points and no faces, but other models of theirs have faces"
    ):
        render([run, models], tmp_path / "set", SHORT)
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, "theirs has 2 models, pm_fb has 3, so they would show different moments"),
        ({"loops": {"thiers": "repeat"}}, "a loop is chosen for 'thiers', but there is no such approach; there are"),
    ],
)
def test_sequences_that_would_drift_apart_are_refused(
    run: Path, models: Path, options: dict[str, Any], sentence: str, tmp_path: Path
) -> None:
    (models / "theirs/0003.ply").unlink()
    with pytest.raises(ValueError, match=sentence):
        render([run, models], tmp_path / "set", replace(SHORT, **options))


@pytest.mark.parametrize(("loop", "n_models"), [("repeat", 2), ("static", 1)])
def test_an_approach_may_have_a_loop_of_its_own(
    run: Path, models: Path, tmp_path: Path, command: Command, loop: str, n_models: int
) -> None:
    (models / "theirs/0003.ply").unlink()
    chosen = ("--static", "theirs") if loop == "static" else ("--loop", "theirs=repeat", "--loop", "bounce")
    where = ("--size", "64x48", "--seconds", 0.16, "--renderer", "software")
    told = command("render", run, models, "-o", tmp_path / "set", *where, *chosen)
    assert told.code == 0, told.err
    entries = {entry["approach"]: entry for entry in read_json(tmp_path / "set/manifest.json")["stimuli"]}
    assert (entries["theirs"]["loop"], entries["theirs"]["model_frames"]) == (loop, n_models)
    assert (entries["pm_fb"]["loop"], entries["pm_fb"]["model_frames"]) == ("bounce", 3)


def test_another_frame_rate_of_models_is_refused(run: Path, models: Path, tmp_path: Path) -> None:
    describe(models, path={"sensors_of": str(run)}, fps=30)
    with pytest.raises(ValueError, match="theirs has 30 models a second, pm_fb 25"):
        render([run, models], tmp_path / "set", SHORT)


def test_the_floor_lies_where_the_models_stand_unless_it_is_said(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
    stand = {"a": 0.0, "b": -7.0, "c": 650.0}  # one whose feet are missing does not raise the floor of the others
    for name, height in stand.items():
        place = [[1, 0, 0, 0], [0, 1, 0, height], [0, 0, 1, 0], [0, 0, 0, 1]]
        describe(tmp_path / name, bounds=[[-900, -400, -900], [900, 900, 900]], world_from_model=place)
        write_obj(tmp_path / name / f"cube_{name}.obj")
    folders = [tmp_path / name for name in stand]

    def floors(folders: list[Path], **changes: Any) -> set[float]:
        return {film.floor_y for film in films_of(folders, replace(SHORT, **changes)).values()}

    assert floors(folders) == {0.0}
    assert floors(folders[1:2]) == {-7.0}
    assert floors(folders, floor="bounds") == {-400.0}
    assert floors(folders, floor=12.5) == {12.5}
    with pytest.raises(ValueError, match="floor is 'sky', expected model, bounds, or a height in mm"):
        replace(SHORT, floor="sky")


def test_specks_below_a_model_do_not_lower_the_floor() -> None:
    points = np.random.default_rng(0).uniform(0, 1000, (5000, 3)).astype(np.float32)
    points[:5, 1] = -300.0
    faces = np.array([[0, 1, 2]], np.int32)
    mesh = Mesh(points, faces, np.ones((5000, 3), np.float32) / np.float32(3**0.5), np.zeros((5000, 3), np.uint8))
    bounds = np.array([[-2000.0] * 3, [2000.0] * 3])
    height = standing_height(mesh, bounds)
    assert height is not None
    assert 0 <= height < 3
    assert standing_height(mesh, bounds + 5000) is None


def test_a_scene_has_one_path_and_one_floor(run: Path, models: Path, tmp_path: Path) -> None:
    describe(models, path={"orbit": {}})
    with pytest.raises(ValueError, match=r"ball: .*run and .*models would be filmed along different paths"):
        render([run, models], tmp_path / "set", SHORT)
    render([run], tmp_path / "path", SHORT)
    along = replace(SHORT, path=tmp_path / "path/paths/ball.json")
    describe(models, path={"orbit": {}}, bounds=(BOUNDS * 1.1).tolist())
    with pytest.raises(ValueError, match=r"ball: .* differ in bounds, so their light would differ"):
        render([run, models], tmp_path / "set", along)
    describe(models, path={"orbit": {}}, bounds=BOUNDS.tolist())
    assert len(read_json(render([run, models], tmp_path / "set", along))["stimuli"]) == 3


def test_without_a_capture_an_orbit_frames_all_models_of_all_approaches(models: Path, tmp_path: Path) -> None:
    describe(models, path={"orbit": {"elevation_deg": 20}})
    films = films_of([models])
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for mesh in (blob(0), blob(1), blob(2)):
        low, high = np.minimum(low, mesh.vertices.min(axis=0)), np.maximum(high, mesh.vertices.max(axis=0))
    low, high = np.minimum(low, [-200, 0, -200]), np.maximum(high, [200, 400, 200])
    for film in films.values():
        assert np.allclose(film.bounds, [low, high])
    around = [camera.centre - film.bounds.mean(axis=0) for camera in films["cube"].cameras()]
    assert np.allclose([np.arctan2(place[0], place[2]) for place in around], [0, np.pi / 2, np.pi, -np.pi / 2])
    manifest = read_json(render([models], tmp_path / "set", SHORT))
    describe(models, path={"file": "../set/paths/ball.json"}, bounds=film.bounds.tolist())
    assert manifest["provenance"]["paths"]["ball"]["file"] == "paths/ball.json"
    render([models], tmp_path / "again", SHORT)
    assert digests(tmp_path / "again") == digests(tmp_path / "set"), "the path that was written is the same path"


def test_a_model_that_no_camera_sees_is_named(models: Path, tmp_path: Path) -> None:
    render([models], tmp_path / "set", SHORT)
    describe(
        models,
        path={"file": "../set/paths/ball.json"},
        world_from_model=[*np.eye(4)[:2].tolist(), [0, 0, 1, 9e5], [0, 0, 0, 1]],
    )
    with pytest.raises(ValueError, match=r"cube\.obj: no camera of the path sees it; look at up, units"):
        render([models], tmp_path / "other", SHORT)


def test_a_model_without_colours_is_filmed_with_a_warning(models: Path, tmp_path: Path, command: Command) -> None:
    (models / "bare.obj").write_text("v -200 0 0\nv 200 0 0\nv 0 400 0\nf 1 2 3\n")
    where = ("--size", "64x48", "--seconds", 0.16, "--renderer", "software")
    told = command("render", models, "-o", tmp_path / "set", *where)
    assert told.code == 0, told.err
    assert f"warning: {models / 'bare.obj'}: has no colours and is shown in neutral grey" in told.err
    (warning,) = read_json(tmp_path / "set/manifest.json")["provenance"]["warnings"]
    assert "neutral grey" in warning


def test_a_scene_along_the_sensors_of_a_run_under_another_name_is_pointed_out(
    models: Path, run: Path, tmp_path: Path
) -> None:
    describe(models, dataset="temple", path={"sensors_of": str(run)})
    (warning,) = read_json(render([run, models], tmp_path / "set", SHORT))["provenance"]["warnings"]
    assert "temple is filmed by the sensors of ball, but is another scene, so nobody compares the two" in warning
    write_mesh(models / "second.ply", blob(0))
    (models / "theirs").rename(tmp_path / "put away")
    practice = render([run, models], tmp_path / "other", SHORT, practice="temple")
    assert read_json(practice)["provenance"]["warnings"] == []


def test_folders_that_have_an_approach_in_common_are_refused_before_rendering(models: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="ball: 2 of the folders have models by theirs"):
        render([models, models], tmp_path / "set", SHORT)


def test_a_scene_with_two_videos_is_for_practice(run: Path, tmp_path: Path) -> None:
    def never(what: str, _done: int, _total: int) -> None:
        raise AssertionError(f"{what}: work began with a wrong practice")

    warm_up = tmp_path / "warm-up"
    write_mesh(warm_up / "good.ply", blob(2))
    write_obj(warm_up / "coarse.obj")
    describe(warm_up, dataset="warm-up", path={"sensors_of": str(run)})
    for wrong, found in (
        ("ball", "'ball' has 1 videos, and other scenes have 2"),
        ("wram-up", "'wram-up' has 0 videos"),
    ):
        with pytest.raises(ValueError, match=f"the practice {found}"):
            render([run, warm_up], tmp_path / "set", SHORT, never, practice=wrong)
    assert not (tmp_path / "set" / "ball").exists(), "nothing is rendered for a wrong name"
    manifest = read_json(render([run, warm_up], tmp_path / "set", SHORT, practice="warm-up"))
    assert [entry["dataset"] for entry in manifest["stimuli"]] == ["ball"]
    assert [entry["approach"] for entry in manifest["practice"]] == ["coarse", "good"]


@pytest.mark.slow
def test_worker_processes_film_models_to_the_same_bytes(run: Path, models: Path, tmp_path: Path) -> None:
    render([run, models], tmp_path / "one", SHORT)
    render([run, models], tmp_path / "two", replace(SHORT, workers=2))
    assert digests(tmp_path / "one") == digests(tmp_path / "two")
