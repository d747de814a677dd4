"""Stimulus sets come together: what is kept, and what cannot be merged."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from app.cli import app
from app.errors import StimuliError
from app.files import file_digest
from app.intake.import_videos import import_stimuli
from app.intake.merge import merge_sets
from app.intake.stimuli import read_stimulus_set
from app.operations.studies.create import create_study
from app.settings import Settings
from tests.app import tiny_stimuli

Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sets: `ours` of two scenes with masters and camera paths, and `theirs` of an imported film of one scene."""
    folder = tmp_path_factory.mktemp("sets")
    ours = folder / "ours"
    tiny_stimuli.write_set(ours, ("ball", "box"), ("id_fa", "pm_fb"))
    entries = [tiny_stimuli.stimulus(ours, scene, name) for scene in ("ball", "box") for name in ("id_fa", "pm_fb")]
    for entry in entries:
        entry |= {"master": entry["video"].replace(".mp4", ".master.mp4"), "loop": "bounce", "model_frames": 3}
        shutil.copy(ours / entry["video"], ours / entry["master"])
    paths = {scene: write_path(ours, scene, "[0, 1, 2]") for scene in ("ball", "box")}
    tiny_stimuli.write_manifest(ours, entries, name="ours", provenance={"runs": ["ball", "box"], "paths": paths})
    tiny_stimuli.encode(folder / "splats" / "ball" / "splat.mp4", tiny_stimuli.flat("0x705030"))
    import_stimuli(folder / "splats", folder / "theirs")
    return folder


def write_path(folder: Path, scene: str, cameras: str) -> dict[str, str]:
    file = folder / "paths" / f"{scene}.json"
    file.parent.mkdir(exist_ok=True)
    file.write_text(f'{{"camera_path": {cameras}}}', encoding="utf-8")
    return {"file": f"paths/{scene}.json", "sha256": file_digest(file)}


@pytest.fixture
def sets(made_once: Path, tmp_path: Path) -> Path:
    shutil.copytree(made_once, tmp_path / "sets")
    return tmp_path / "sets"


def manifest_of(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    return content


def rewrite(folder: Path, change: Change) -> None:
    manifest = manifest_of(folder)
    change(manifest)
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")


@pytest.mark.slow
def test_films_of_another_program_join_ours_in_a_study(sets: Path, tmp_path: Path) -> None:
    out = tmp_path / "all"
    given = ["stimuli", "merge", str(sets / "ours"), str(sets / "theirs"), "-o", str(out), "--json"]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert (told["videos"], told["conditions"]) == (5, ["id_fa", "pm_fb", "splat"])
    assert told["notes"] == [
        "no level of depth, fusion: splat; compared with all others, and left out where factors are compared",
        "ball: no master of splat, which the others have; a study encodes these once more",
        "box: no film of splat, which other datasets have",
    ]
    merged = read_stimulus_set(out)
    assert [stimulus.name for stimulus in merged.stimuli] == [
        *("ball/id_fa", "ball/pm_fb", "ball/splat", "box/id_fa", "box/pm_fb")
    ]
    study = create_study(Settings(data_dir=tmp_path / "server"), out, "All", exposure_s=0.4)
    assert (study["n_conditions"], study["n_pairs"]) == (3, 4)


def test_what_the_sets_knew_is_kept(sets: Path, tmp_path: Path) -> None:
    merge_sets([sets / "ours", sets / "theirs"], tmp_path / "all")
    ours, theirs, merged = (manifest_of(folder) for folder in (sets / "ours", sets / "theirs", tmp_path / "all"))
    kept = {(entry["dataset"], entry["approach"]): entry for entry in merged["stimuli"]}
    for entry in (*ours["stimuli"], *theirs["stimuli"]):
        assert kept[entry["dataset"], entry["approach"]] == entry
    assert merged["factors"] == ours["factors"]
    provenance = merged["provenance"]
    assert [origin["provenance"] for origin in provenance["merged"]] == [ours["provenance"], theirs["provenance"]]
    assert [origin["manifest_sha256"] for origin in provenance["merged"]] == [
        file_digest(sets / name / "manifest.json") for name in ("ours", "theirs")
    ]
    assert provenance["paths"] == ours["provenance"]["paths"]
    for path in provenance["paths"].values():
        assert file_digest(tmp_path / "all" / path["file"]) == path["sha256"]


def test_a_merged_set_can_be_merged_again_and_films_are_taken_once(sets: Path, tmp_path: Path) -> None:
    merge_sets([sets / "ours", sets / "theirs"], tmp_path / "all")
    again = merge_sets([tmp_path / "all", sets / "theirs"], tmp_path / "again")
    assert again.notes[0] == "ball/splat is the same film in 2 sets: taken once"
    assert len(read_stimulus_set(tmp_path / "again").stimuli) == 5


def test_files_of_the_same_name_do_not_overwrite_each_other(sets: Path, tmp_path: Path) -> None:
    rewrite(sets / "theirs", lambda manifest: manifest["stimuli"][0].update(video="ball/id_fa.mp4"))
    (sets / "theirs" / "ball" / "splat.mp4").rename(sets / "theirs" / "ball" / "id_fa.mp4")
    merge_sets([sets / "ours", sets / "theirs"], tmp_path / "all")
    videos = [stimulus.video for stimulus in read_stimulus_set(tmp_path / "all").of_dataset("ball")]
    assert videos == ["ball/id_fa.mp4", "ball/pm_fb.mp4", "2/ball/id_fa.mp4"]


def test_a_camera_path_stays_in_the_new_set_whatever_its_dataset_is_called(sets: Path, tmp_path: Path) -> None:
    def called(manifest: dict[str, Any]) -> None:
        manifest["stimuli"][0]["dataset"] = "../../ball"
        manifest["provenance"] = {"paths": {"../../ball": write_path(sets / "theirs", "ball", "[5]")}}

    rewrite(sets / "theirs", called)
    before = set(tmp_path.rglob("*"))
    merge_sets([sets / "ours", sets / "theirs"], tmp_path / "all")
    made = {path for path in set(tmp_path.rglob("*")) - before if not path.is_relative_to(tmp_path / "all")}
    assert made == set()
    path = manifest_of(tmp_path / "all")["provenance"]["paths"]["../../ball"]
    assert file_digest(tmp_path / "all" / path["file"]) == path["sha256"]


def test_levels_of_a_factor_are_united(sets: Path, tmp_path: Path) -> None:
    def with_levels(manifest: dict[str, Any]) -> None:
        manifest["factors"] = {"depth": ["dr", "pm"], "kind": ["splat"]}
        manifest["stimuli"][0]["levels"] = {"depth": "dr", "kind": "splat"}

    rewrite(sets / "theirs", with_levels)
    merged = merge_sets([sets / "ours", sets / "theirs"], tmp_path / "all").stimulus_set
    assert merged.factors == {"depth": ["id", "pm", "dr"], "fusion": ["fa", "fb"], "kind": ["splat"]}


def test_a_set_that_cannot_compare_factors_says_so(sets: Path, tmp_path: Path) -> None:
    def with_another_factor(manifest: dict[str, Any]) -> None:
        manifest["factors"] = {"renderer": ["gs"]}
        manifest["stimuli"][0]["levels"] = {"renderer": "gs"}

    rewrite(sets / "theirs", with_another_factor)
    made = merge_sets([sets / "ours", sets / "theirs"], tmp_path / "all")
    assert "no level of renderer: id_fa, pm_fb; compared with all others" in made.notes[0]
    assert made.notes[2].startswith("no condition has a level of every factor (depth, fusion, renderer)")


def other_film(manifest: dict[str, Any]) -> None:
    manifest["stimuli"][0]["approach"] = "pm_fb"


def other_codec(manifest: dict[str, Any]) -> None:
    manifest["stimuli"][0]["codec"] = "av1"


def changed_film(manifest: dict[str, Any]) -> None:
    manifest["stimuli"][0]["sha256"] = "0" * 64


def path_of(file: str) -> Change:
    return lambda manifest: manifest.update(provenance={"paths": {"ball": {"file": file, "sha256": "0" * 64}}})


def odd_provenance(manifest: dict[str, Any]) -> None:
    manifest["provenance"] = {"paths": {"ball": "paths/ball.json"}}


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (other_film, "ours and .*theirs both hold ball/pm_fb, with different films; import or render .* another name"),
        (other_codec, r"theirs: ball/splat is encoded as av1, ball/id_fa in .*ours as h264; .* must be alike"),
        (changed_film, r"theirs/ball/splat\.mp4: its SHA-256 is [0-9a-f]{64}, the manifest says 0{64}"),
        (path_of("paths/ball.json"), r"theirs/paths/ball\.json: its SHA-256 is .* it was changed"),
        (path_of("../ours/paths/ball.json"), "the camera path of ball lies outside"),
        (path_of("paths/none.json"), r"paths/none\.json: the camera path of ball is missing; copy the whole folder"),
        (odd_provenance, r"manifest\.json: provenance\.paths\.ball is "),
    ],
)
def test_what_cannot_be_merged_is_named_and_leaves_nothing(
    sets: Path, tmp_path: Path, change: Change, fault: str
) -> None:
    write_path(sets / "theirs", "ball", "[0, 1]")
    rewrite(sets / "theirs", change)
    with pytest.raises(StimuliError, match=fault):
        merge_sets([sets / "ours", sets / "theirs"], tmp_path / "all")
    assert [path.name for path in tmp_path.iterdir()] == ["sets"]


def test_two_camera_paths_of_a_dataset_are_named(sets: Path, tmp_path: Path) -> None:
    path = write_path(sets / "theirs", "ball", "[5]")
    rewrite(sets / "theirs", lambda manifest: manifest.update(provenance={"paths": {"ball": path}}))
    fault = r"ours/paths/ball\.json and .*theirs/paths/ball\.json are different camera paths of ball; render one"
    with pytest.raises(StimuliError, match=fault):
        merge_sets([sets / "ours", sets / "theirs"], tmp_path / "all")


def test_a_film_that_came_back_too_short_is_told_what_to_be(sets: Path, tmp_path: Path) -> None:
    tiny_stimuli.encode(sets / "short" / "ball" / "nerf.mp4", tiny_stimuli.flat("black"), "-frames:v", "9")
    import_stimuli(sets / "short", sets / "nerfs")
    fault = (
        "ball/nerf has 9 frames at 25/s of 64x48, the others of ball have 10 frames at 25/s of 64x48; the stimuli of a "
        "dataset must be alike: make ball/nerf with 10 frames"
    )
    with pytest.raises(StimuliError, match=fault):
        merge_sets([sets / "ours", sets / "nerfs"], tmp_path / "all")
    assert not (tmp_path / "all").exists()


def test_a_copy_that_fails_leaves_nothing(sets: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_source: Path, _target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shutil, "copyfile", full)
    with pytest.raises(OSError, match="No space left"):
        merge_sets([sets / "ours", sets / "theirs"], tmp_path / "all")
    assert [path.name for path in tmp_path.iterdir()] == ["sets"]


def test_a_folder_in_use_and_a_lone_set_are_refused(sets: Path) -> None:
    with pytest.raises(StimuliError, match="is not empty; choose a new folder"):
        merge_sets([sets / "ours", sets / "theirs"], sets / "ours")
    result = CliRunner().invoke(app, ["stimuli", "merge", str(sets / "ours"), "-o", str(sets / "all")])
    assert result.exit_code == 2
    assert not (sets / "all").exists()
