"""A models folder: which files are whose, and what its scene.json says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.intake.summaries import CLOUDS, MODELS
from recon.models.folder import find_models
from recon.models.inspection import Facts, check_sizes, union
from recon.models.read import MODEL_SUFFIXES, READERS
from recon.models.scene_file import Orbit, orbit_rig, read_scene_file
from recon.runtime.files import check_safe_name, write_json
from recon.validation.clouds import TEXT_SUFFIXES

SCENE: dict[str, Any] = {
    "schema_version": 1,
    "dataset": "ball",
    "fps": 25,
    "units": "mm",
    "up": "y",
    "path": {"orbit": {}},
}
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n"


def touch(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(SQUARE)


def test_frames_are_ordered_by_their_numbers_whatever_stands_before(tmp_path: Path) -> None:
    touch(tmp_path, *(f"neus/mesh_{number}.obj" for number in (10, 8, 9)), "neus/mesh.mtl", "neus/skin.png")
    touch(
        tmp_path, "still.glb", "colmap-poisson/0001.ply", "colmap-poisson/0002.ply", "My Method 2/1.ply", "größe/7.OBJ"
    )
    touch(tmp_path, "scene.json", "README.md", ".hidden/0000.ply", "textures/skin.png")
    models, problems = find_models(tmp_path)
    assert problems == []
    names = {approach: [path.name for path in files] for approach, files in models.items()}
    assert names == {
        "My Method 2": ["1.ply"],
        "colmap-poisson": ["0001.ply", "0002.ply"],
        "größe": ["7.OBJ"],
        "neus": ["mesh_8.obj", "mesh_9.obj", "mesh_10.obj"],
        "still": ["still.glb"],
    }


def test_a_model_may_lie_elsewhere(tmp_path: Path) -> None:
    touch(tmp_path, "elsewhere/0000.ply")
    (tmp_path / "models").mkdir()
    (tmp_path / "models/neus").symlink_to(tmp_path / "elsewhere")
    assert find_models(tmp_path / "models") == ({"neus": (tmp_path / "models/neus/0000.ply",)}, [])


def test_a_link_to_nowhere_is_a_frame_that_reading_refuses(tmp_path: Path) -> None:
    touch(tmp_path, "neus/0000.ply")
    (tmp_path / "neus/0001.ply").symlink_to(tmp_path / "gone.ply")
    models, _ = find_models(tmp_path)
    assert [path.name for path in models["neus"]] == ["0000.ply", "0001.ply"]


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (("a/0000.ply", "a/0001.ply", "a/0003.ply"), "a: frame 2 is missing between 0000.ply and 0003.ply"),
        (("a/0.ply", "a/9.ply"), "a: frame 1, 2, 3, 4, 5 and 3 more is missing between 0.ply and 9.ply"),
        (("a/1.ply", "a/20261127031500123.ply"), "5, 6 and 20261127031500116 more is missing between 1.ply and 2026"),
        (("a/0001.ply", "a/1.ply"), "a/1.ply: is frame 1, as 0001.ply is; keep one of them"),
        (("a/0.ply", "a/0.obj"), "a/0.ply: is frame 0, as 0.obj is; keep one of them"),
        (("a/left_0.ply", "a/right_1.ply"), "a: holds two sequences, left_0.ply and right_1.ply"),
        (("a/body.ply",), "a/body.ply: its name does not end in the number of a frame, such as 0000.ply"),
        (("a.ply", "a/0.ply"), "a.ply: "),
        (("a.ply", "a.obj"), "a.ply: "),
        (("b.fbx",), "b.fbx: is no model that can be read; expected .ply, .obj, .glb, .gltf"),
        (("a/0.fbx",), "a: holds no model that can be read; expected numbered files with .ply"),
        (("a/meta.json", "a/means_l.webp", "b/0.ply"), "a: is a SOG that is not bundled; zip its files as a.sog"),
        ((), ": holds no model; expected APPROACH/FRAME"),
        (("all.ply",), "all.ply: 'all' is what results call everything together"),
        (("a.master.ply",), "a.master.ply: 'a.master' is no name for files"),
    ],
)
def test_files_that_make_no_sequence_are_named(tmp_path: Path, names: tuple[str, ...], sentence: str) -> None:
    touch(tmp_path, *names)
    _, problems = find_models(tmp_path)
    assert len(problems) == 1
    assert sentence in problems[0]


@pytest.mark.parametrize("name", ["neus", "colmap-poisson", "My Method 2", "größe", "方法", "a.b_c"])
def test_a_name_may_be_of_any_letters(name: str) -> None:
    assert check_safe_name(name) == name


@pytest.mark.parametrize(
    "name", ["", ".a", "a/b", "..", "a\\b", "a\nb", " a", "a ", "a:b", "x" * 101, "a.quality", "a.mask", "all"]
)
def test_a_name_that_files_cannot_have_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"is no name for files|choose another name"):
        check_safe_name(name)


def test_units_axes_and_transform_follow_each_other(tmp_path: Path) -> None:
    moved = [[0, 0, 2, 100], [0, 2, 0, 0], [-2, 0, 0, 0], [0, 0, 0, 1]]  # twice as large, turned about y
    write_json(tmp_path / "scene.json", SCENE | {"units": "cm", "up": "z", "world_from_model": moved, "splat_mm": 3})
    scene, problems = read_scene_file(tmp_path)
    assert problems == []
    assert scene is not None
    matrix = np.array(scene.placement.world_from_model)
    assert np.allclose(matrix @ [0, 0, 1, 1], [100, 20, 0, 1]), "up is y; a centimetre is 10 mm, twice as large"
    assert np.allclose(matrix @ [1, 0, 0, 1], [100, 0, -20, 1])
    assert scene.placement.splat_mm == 3


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"units": "inch"}, "units is 'inch', expected one of mm, cm, m"),
        ({"up": "Y"}, "up is 'Y', expected one of x, y, z"),
        ({"fps": 0}, "fps is 0, expected a positive number up to 1000"),
        ({"fps": "25"}, "fps is '25', expected a positive number"),
        ({"dataset": "a/b"}, "dataset: 'a/b' is no name for files"),
        ({"schema_version": 2}, "schema_version is 2, expected 1"),
        ({"splatt_mm": 2}, "splatt_mm is unknown, expected one of schema_version, dataset"),
        ({"path": {}}, "path has nothing, expected one of sensors_of"),
        ({"path": {"orbit": {}, "file": "a.json"}}, "path has orbit and file, expected one of"),
        ({"path": {"orbit": {"angle": 3}}}, "path.orbit.angle is unknown, expected one of azimuth_deg"),
        ({"path": {"file": "a.json"}}, "path.file names 'a.json', but there is no file at"),
        ({"path": {"sensors_of": "../ball"}}, "ball is no capture and no run: it has no capture.json"),
        ({"bounds": [[0, 0, 0], [1, 0, 1]]}, "bounds: the lowest corner"),
        ({"world_from_model": [[1, 0, 0, 0]] * 4}, "world_from_model is"),
        ({"world_from_model": np.diag([-1.0, 1, 1, 1]).tolist()}, "not a mirror"),
        ({"levels": {"a": {"depth": 3}}}, "levels.a.depth is 3, expected a text"),
        ({"splat_mm": float("1e999")}, "splat_mm is"),
    ],
)
def test_a_wrong_value_is_named_with_its_key(tmp_path: Path, changes: dict[str, Any], sentence: str) -> None:
    text = str(SCENE | changes).replace("'", '"').replace("inf", "1e999")
    (tmp_path / "scene.json").write_text(text)
    scene, problems = read_scene_file(tmp_path)
    assert scene is None
    assert len(problems) == 1
    assert problems[0].startswith(f"{tmp_path / 'scene.json'}: ")
    assert sentence in problems[0]


@pytest.mark.parametrize(
    "path", [{"sensors_of": "ftp://localhost/x"}, {"sensors_of": "/etc"}, {"file": "../../a.json"}]
)
def test_a_job_of_the_server_follows_no_name_to_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: dict[str, str]
) -> None:
    monkeypatch.setenv("RECONSTUDY_FILES_BELOW", str(tmp_path))
    monkeypatch.chdir(tmp_path)  # from where a URL would look like a path below it
    write_json(tmp_path / "scene.json", SCENE | {"path": path})
    scene, (problem,) = read_scene_file(tmp_path)
    assert scene is None
    assert "lies outside the server's folders" in problem


def test_all_that_is_missing_is_said_at_once(tmp_path: Path) -> None:
    write_json(tmp_path / "scene.json", {})
    _, problems = read_scene_file(tmp_path)
    keys = ("schema_version", "dataset", "fps", "units", "up", "path")
    assert problems == [f"{tmp_path / 'scene.json'}: {key} is missing" for key in keys]


def test_an_orbit_begins_where_it_is_told_to() -> None:
    bounds = np.array([[0.0, 0, 0], [200, 200, 200]])
    (sensor,) = orbit_rig(Orbit(azimuth_deg=90, elevation_deg=30, distance_mm=1000), bounds).sensors
    middle = (sensor.left.centre + sensor.right.centre) / 2
    assert np.allclose(middle - 100, [1000 * np.cos(np.pi / 6), 500, 0])


def facts(size: float, at: float = 0.0) -> Facts:
    return Facts("0", ((at, at, at), (at + size, at + size, at + size)))


@pytest.mark.parametrize(
    ("size", "unit", "sentence"),
    [
        (1e6, "m", "times the bounds of the scene (1 732 mm); it is probably in mm, but scene.json says m"),
        (1.0, "mm", "it is probably in m, but scene.json says mm"),
        (1e5, "m", "it is probably in cm, but scene.json says m"),
        (1e6, "mm", "scene.json says that it is in mm; look at units"),
    ],
)
def test_a_model_in_another_unit_is_named_with_the_likely_one(size: float, unit: str, sentence: str) -> None:
    path = Path("a/0000.ply")
    problems, warnings = check_sizes({path: facts(size)}, {path: unit}, np.array([[0.0] * 3, [1000.0] * 3]))
    assert warnings == []
    assert len(problems) == 1
    assert problems[0].startswith("a/0000.ply: is ")
    assert sentence in problems[0]


def test_models_of_mixed_units_are_found_without_bounds() -> None:
    models = {Path(f"{name}.ply"): facts(size) for name, size in (("a", 1000), ("b", 1100), ("c", 1))}
    problems, _ = check_sizes(models, dict.fromkeys(models, "mm"), None)
    assert len(problems) == 1
    assert problems[0].startswith("c.ply: is 1.73 mm across, 1/1 000 of the other models")
    assert "probably in m" in problems[0]


def test_of_two_approaches_the_one_that_is_too_large_is_named() -> None:
    models = {Path(f"{name}/{frame}.ply"): facts(size) for name, size in (("a", 1), ("b", 1000)) for frame in (0, 1)}
    problems, _ = check_sizes(models, dict.fromkeys(models, "mm"), None)
    assert [problem.split(":")[0] for problem in problems] == ["b/0.ply", "b/1.ply"]
    assert "1 000 times the other models (1.73 mm)" in problems[0]


def test_a_model_beside_the_bounds_is_refused_and_an_odd_size_warned_of() -> None:
    bounds = np.array([[0.0] * 3, [1000.0] * 3])
    path = Path("a.ply")
    assert "lies outside the bounds of the scene" in check_sizes({path: facts(500, 2000)}, {path: "mm"}, bounds)[0][0]
    problems, warnings = check_sizes({path: facts(6000)}, {path: "mm"}, bounds)
    assert (problems, len(warnings)) == ([], 1)
    assert check_sizes({path: facts(900)}, {path: "mm"}, bounds) == ([], [])


def test_the_union_holds_every_model_and_is_never_flat() -> None:
    flat = Facts("0", ((0, 0, 0), (100, 50, 0)))
    assert union([facts(10, at=-20), facts(10, at=200)]).tolist() == [[-20] * 3, [210] * 3]
    assert union([flat]).tolist() == [[0, 0, -0.5], [100, 50, 0.5]]


def test_the_server_takes_what_is_read() -> None:
    assert set(MODELS) == set(MODEL_SUFFIXES)
    assert set(CLOUDS) == {*READERS, *TEXT_SUFFIXES}
