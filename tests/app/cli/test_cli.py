"""The command line as its users meet it: what it prints, where, and how it ends; above all when the input is bad."""

from __future__ import annotations

import errno
import html
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fsspec.implementations.memory import MemoryFileSystem
from numpy.typing import NDArray

from app.cli.studies import _balance_lines
from app.settings import Settings
from recon.render.video import write_video
from recon.storage.files import read_json, write_json
from tests.app import tiny_stimuli
from tests.command_line import Command


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from recon.studio import SynthParameters, synthesise

    folder = tmp_path_factory.mktemp("recorded") / "ball"
    synthesise(folder, SynthParameters(scene="ball", n_sensors=2, n_frames=1, size=(160, 120)))
    return folder


@pytest.fixture
def capture(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "capture"))


@pytest.fixture
def stimuli(tmp_path: Path) -> Path:
    """A stimulus set of two tiny videos."""
    from recon.pipeline.manifest import Stimulus, write_manifest

    folder = tmp_path / "stimuli"
    made = []
    for grey, approach in ((60, "id_fa"), (180, "id_fb")):
        frames = [np.full((48, 64, 3), grey + 5 * frame, np.uint8) for frame in range(5)]
        facts = write_video(folder / f"ball/{approach}.mp4", frames, size=(64, 48), fps=25)
        levels = {"depth": "id", "fusion": approach[3:]}
        made.append(
            Stimulus(
                "ball",
                approach,
                levels,
                f"ball/{approach}.mp4",
                None,
                64,
                48,
                25.0,
                facts.n_frames,
                facts.codec,
                "software",
                1,
                "static",
                {},
            )
        )
    write_manifest(folder, "tiny", made, {})
    return folder


def edit(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = read_json(folder / "capture.json")
    change(content)
    write_json(folder / "capture.json", content)


def commands_of(*group: str) -> Iterator[tuple[str, ...]]:
    """Every command of the installed program, asked of the program itself."""
    import typer

    from app.cli import app

    def walk(node: Any, path: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
        for name, child in getattr(node, "commands", {}).items():
            yield (*path, name)
            yield from walk(child, (*path, name))

    yield from walk(typer.main.get_command(app), group)


@pytest.mark.slow
@pytest.mark.parametrize("path", [(), *commands_of()], ids=" ".join)
def test_every_command_explains_itself(command: Command, path: tuple[str, ...]) -> None:
    told = command(*path, "--help")
    assert told.code == 0
    assert "Usage" in told.out


def test_the_contract_names_its_commands() -> None:
    single = {"demo", "match", "reconstruct", "render", "serve", "simulate", "analyse", "status"}
    groups = {"capture", "stimuli", "study", "admin", "token", "db"}
    assert single | groups <= {path[0] for path in commands_of() if len(path) == 1}


@pytest.mark.slow
def test_help_and_server_load_no_reconstruction_backend() -> None:
    heavy = "{'cv2', 'numba', 'pyrender', 'trimesh', 'skimage', 'open3d'}"
    code = f"import sys, app.cli, app.main; sys.exit(' '.join({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert not done.stderr.strip()


def test_wrong_use_ends_with_2(command: Command, tmp_path: Path) -> None:
    assert command("reconstruct").code == 2
    assert command("no-such-command").code == 2
    told = command("render", tmp_path, "-o", tmp_path / "set", "--size", "huge")
    assert told.code == 2
    assert "'huge' is not a size" in told.err
    told = command("validate", "sphere", tmp_path, "--radius", 150, "-o", tmp_path / "r", "--viewpoint", "1,nan,3")
    assert told.code == 2
    assert "'1,nan,3' is not a position" in told.err


def test_what_is_wrong_behind_a_url_is_named_by_it(command: Command, capture: Path, tmp_path: Path) -> None:
    store = MemoryFileSystem()
    store.put(str(capture), "/half", recursive=True)
    store.rm("/half/S1/left/0000.png")
    outcome = command("reconstruct", "memory://half", "-o", tmp_path / "run")
    assert "reconstudy: memory://half/S1/left/0000.png: there is no such file" in outcome.err
    store.pipe("/half/S1/left/0000.png", b"<html>")
    outcome = command("reconstruct", "memory://half", "-o", tmp_path / "run")
    assert "`reconstudy capture segment FOLDER` on a copy of it here makes masks" in outcome.err
    assert "reconstudy: memory://half/S1/left/0000.png: is not readable as an image" in outcome.err


@pytest.mark.parametrize(
    "words",
    [
        ("export", "MESH", "s3://bucket/a b/0000.glb"),
        ("export", "https://host:80/0000.ply", "OUT"),
        ("capture", "check", "file:///recordings/ball"),
        ("validate", "cuboid", "MESH", "memory://box.ply", "--size", "1x1x1", "-o", "OUT"),
        ("validate", "mesh", "MESH", "--truth", "MESH", "-o", "s3://bucket/report"),
    ],
)
def test_a_url_is_refused_where_paths_of_this_machine_are_expected(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = command(*words)
    url = next(word for word in words if "://" in word).replace(":///", "://")
    assert outcome.code == 2
    assert f"{url} is a URL; expected a file or folder of this machine" in outcome.err
    assert not list(tmp_path.iterdir())


def test_a_command_that_takes_urls_still_does(command: Command, tmp_path: Path) -> None:
    outcome = command("reconstruct", "memory://nothing", "-o", tmp_path / "run")
    assert outcome.code == 1
    assert "memory://nothing/capture.json: there is no such file" in outcome.err


def test_memory_that_is_not_enough_is_told_in_a_sentence(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_large(*_: object, progress: object) -> None:  # noqa: ARG001
        raise MemoryError("Unable to allocate 74.5 GiB")

    monkeypatch.setattr("recon.studio.synthesise", too_large)
    told = command("capture", "synth", tmp_path / "out", "--scene", "ball")
    assert told.code == 1
    assert told.err.startswith("reconstudy: the memory is not enough (Unable to allocate 74.5 GiB); ask for less")


def test_a_set_of_one_condition_says_what_a_study_needs(command: Command, stimuli: Path, tmp_path: Path) -> None:
    (tmp_path / "one" / "ball").mkdir(parents=True)
    shutil.copy(stimuli / "ball" / "id_fa.mp4", tmp_path / "one" / "ball" / "a.mp4")
    told = command("stimuli", "import", tmp_path / "one", "-o", tmp_path / "my set")
    assert f"OTHER_SET '{tmp_path / 'my set'}' -o SET" in told.out, "the command can be copied"
    assert "1 video: 1 condition of 1 dataset" in told.out
    assert "A study compares two or more conditions of each dataset, and ball has one." in told.out
    missing = command("study", "create", stimuli, "--name", "X", "--options", tmp_path / "nothing.toml")
    assert f"{tmp_path / 'nothing.toml'}: there is no such file; expected a TOML file" in missing.err
    assert "Errno" not in missing.err
    folder = command("study", "create", stimuli, "--name", "X", "--options", tmp_path)
    assert f"{tmp_path}: is a folder; expected a TOML file" in folder.err


def test_no_help_loses_words_in_brackets(command: Command) -> None:
    assert "seed and options; `study export` writes one" in " ".join(command("study", "import", "--help").out.split())


def test_match_writes_a_disparity_and_reports_as_json(command: Command, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    left = rng.integers(0, 256, (40, 60), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "left.png"), left)
    cv2.imwrite(str(tmp_path / "right.png"), np.roll(left, -4, axis=1))
    told = command(
        "match", tmp_path / "left.png", tmp_path / "right.png", "--method", "id", "--disparities", 8,
        "-o", tmp_path / "d.npy", "--json",
    )  # fmt: skip
    assert told.code == 0, told.err
    result = json.loads(told.out)
    disparity = np.load(tmp_path / "d.npy")
    assert result["density"] == pytest.approx(np.isfinite(disparity).mean())
    assert np.nanmedian(disparity) == 4
    assert {"n_disparities": 8, "min_disparity": 0, "sigma": 12.0, "levels": 2}.items() <= result["parameters"].items()


@pytest.mark.parametrize(
    ("right", "sentence"),
    [
        (np.zeros((40, 60, 3), np.uint8), "the left image has 1 channels, the right 3; expected the same"),
        (np.zeros((40, 60), np.uint16), "the right image is uint16; expected 8 bits a channel"),
    ],
)
def test_match_takes_no_image_for_one_of_another_kind(
    command: Command, tmp_path: Path, right: NDArray[np.generic], sentence: str
) -> None:
    cv2.imwrite(str(tmp_path / "left.png"), np.zeros((40, 60), np.uint8))
    cv2.imwrite(str(tmp_path / "right.png"), np.asarray(right))
    told = command("match", tmp_path / "left.png", tmp_path / "right.png", "--disparities", 8, "-o", tmp_path / "d.npy")
    assert told.code == 1
    assert sentence in told.err
    assert not (tmp_path / "d.npy").exists()


def test_permission_that_is_missing_is_told_with_the_folder_that_denies_it(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def denied(out: Path, *_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(out.with_name(f".{out.name}.77.part")))

    monkeypatch.setattr("recon.studio.synthesise", denied)
    told = command("capture", "synth", tmp_path / "new" / "out", "--scene", "ball")
    assert told.err == f"reconstudy: {tmp_path}: permission denied; look at who may read or write it\n"


def test_match_says_in_a_sentence_that_a_pair_has_no_texture(command: Command, tmp_path: Path) -> None:
    for side in ("left", "right"):
        cv2.imwrite(str(tmp_path / f"{side}.png"), np.zeros((40, 60), np.uint8))
    told = command(
        "match", tmp_path / "left.png", tmp_path / "right.png", "--disparities", 8, "-o", tmp_path / "d.npy", "--json"
    )
    assert told.code == 0, told.err
    sentence = "the images have no texture: nothing can be matched, every disparity is NaN"
    assert told.err == f"warning: {sentence}\n"
    assert json.loads(told.out)["warnings"] == [sentence]
    assert np.isnan(np.load(tmp_path / "d.npy")).all()


def test_a_missing_image_is_named(command: Command, tmp_path: Path) -> None:
    told = command("match", tmp_path / "no.png", tmp_path / "no.png", "--disparities", 8, "-o", tmp_path / "d.npy")
    assert told.code == 1
    assert f"{tmp_path / 'no.png'}: there is no such" in told.err
    assert not (tmp_path / "d.npy").exists()


def without_frames(content: dict[str, Any]) -> None:
    content["n_frames"] = 0


def without_baseline(content: dict[str, Any]) -> None:
    content["sensors"][0]["right"]["cam_from_world"] = content["sensors"][0]["left"]["cam_from_world"]


def with_sheared_rotation(content: dict[str, Any]) -> None:
    content["sensors"][0]["left"]["cam_from_world"][0][1] += 0.5


def with_other_size(content: dict[str, Any]) -> None:
    content["sensors"][1]["right"]["size"] = [80, 60]


BROKEN = [
    (without_frames, "n_frames is 0"),
    (without_baseline, "the baseline is 0 mm"),
    (with_sheared_rotation, "not a rigid transform"),
    (with_other_size, "sizes must be equal"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("change", "problem"), BROKEN, ids=[change.__name__ for change, _ in BROKEN])
def test_a_broken_calibration_stops_before_anything_is_made(
    command: Command, capture: Path, tmp_path: Path, change: Callable[[dict[str, Any]], None], problem: str
) -> None:
    edit(capture, change)
    told = command("reconstruct", capture, "-o", tmp_path / "run")
    assert told.code == 1
    assert problem in told.err
    assert str(capture) in told.err
    assert not (tmp_path / "run").exists()
    checked = command("capture", "check", capture)
    assert checked.code == 1
    assert problem in checked.out


@pytest.mark.parametrize("damage", ["missing", "unreadable"])
def test_a_bad_picture_is_named(command: Command, capture: Path, tmp_path: Path, damage: str) -> None:
    picture = capture / "S2/right/0000.png"
    picture.unlink() if damage == "missing" else picture.write_bytes(b"no picture")
    told = command("reconstruct", capture, "-o", tmp_path / "run", "--depth", "id")
    assert told.code == 1
    assert str(picture) in told.err
    assert not (tmp_path / "run/run.json").exists()
    assert not list((tmp_path / "run").rglob("*.part*"))


def test_a_file_where_a_folder_should_be_made_is_named(command: Command, capture: Path, tmp_path: Path) -> None:
    (tmp_path / "run").write_text("mine")
    outcome = command("reconstruct", capture, "-o", tmp_path / "run", "--depth", "id", "--fusion", "fb")
    assert outcome.code == 1
    assert (
        outcome.err.splitlines()[-1]
        == f"reconstudy: {tmp_path / 'run'}: is a file, expected a folder; choose another name"
    )
    assert (tmp_path / "run").read_text() == "mine"
    (tmp_path / "folder.glb").mkdir()
    outcome = command("export", capture / "truth/mesh/0000.ply", tmp_path / "folder.glb")
    assert outcome.err == f"reconstudy: {tmp_path / 'folder.glb'}: is a directory\n"


def test_a_mesh_is_exported_for_viewers(command: Command, recorded: Path, tmp_path: Path) -> None:
    told = command("export", recorded / "truth/mesh/0000.ply", tmp_path / "model.glb", "--json")
    assert told.code == 0, told.err
    assert (tmp_path / "model.glb").read_bytes()[:4] == b"glTF"
    assert json.loads(told.out)["faces"] > 100


def test_a_study_is_created_and_listed(command: Command, stimuli: Path) -> None:
    created = command("study", "create", stimuli, "--name", "Tiny", "--seed", 1, "--json")
    assert created.code == 0, created.err
    assert json.loads(created.out)["n_pairs"] == 1
    listed = command("study", "list")
    assert "tiny (open): 0 of 0 participants finished, 0 votes" in listed.out


@pytest.mark.slow
def test_a_video_with_another_digest_is_named(command: Command, stimuli: Path) -> None:
    video = stimuli / "ball/id_fa.mp4"
    shutil.copy(stimuli / "ball/id_fb.mp4", video)
    told = command("study", "create", stimuli, "--name", "Tiny")
    assert told.code == 1
    assert "ball/id_fa.mp4" in told.err
    assert "no study yet" in command("study", "list").out


def test_a_video_that_cannot_be_decoded_is_named(command: Command, stimuli: Path) -> None:
    import hashlib

    video = stimuli / "ball/id_fa.mp4"
    video.write_bytes(b"no video")
    manifest = read_json(stimuli / "manifest.json")
    manifest["stimuli"][0]["sha256"] = hashlib.sha256(b"no video").hexdigest()
    write_json(stimuli / "manifest.json", manifest)
    for arguments in (("stimuli", "check", stimuli), ("study", "create", stimuli, "--name", "Tiny")):
        told = command(*arguments)
        assert told.code == 1
        assert "id_fa.mp4" in told.err
        assert len(told.err.strip().splitlines()[-1]) < 400


@pytest.mark.slow
def test_simulated_participants_fill_a_study(command: Command, stimuli: Path, tmp_path: Path) -> None:
    command("study", "create", stimuli, "--name", "Tiny", "--seed", 1)
    (tmp_path / "abilities.json").write_text('{"id_fa": -3, "id_fb": 3}')
    told = command(
        "simulate", "--study", "tiny", "--participants", 3, "--abilities", tmp_path / "abilities.json", "--json"
    )
    assert told.code == 0, told.err
    assert json.loads(told.out)["votes"] == 3
    assert "3 of 3 participants finished, 3 votes" in command("study", "list").out


VOTES = "participant,dataset,item_a,item_b,choice\np1,ball,x,y,a\np2,ball,x,y,b\np3,ball,x,y,a\np4,ball,x,y,none\n"


@pytest.mark.slow
def test_votes_become_scores_tables_and_a_report(command: Command, tmp_path: Path) -> None:
    (tmp_path / "votes.csv").write_text(VOTES)
    dry = command("analyse", tmp_path / "votes.csv", "--dry-run")
    assert "votes.csv: text in UTF-8, commas between cells; 4 rows, 4 votes" in dry.out
    (tmp_path / "ratings.csv").write_text("participant,dataset,condition,rating\nr1,ball,x,4\n")
    both = command("analyse", tmp_path / "votes.csv", "--ratings", tmp_path / "ratings.csv", "--dry-run")
    assert "ratings.csv: text in UTF-8, commas between cells; 1 ratings by 1 participants of 1 items" in both.out
    assert not (tmp_path / "out").exists()
    assert "--out is missing" in command("analyse", tmp_path / "votes.csv").err
    told = command("analyse", tmp_path / "votes.csv", "-o", tmp_path / "out", "--json", "--width", "one")
    assert told.code == 0, told.err
    report = html.unescape((tmp_path / "out" / "report.html").read_text()).replace("\u00a0", " ")
    assert all(row["text"] in report for row in json.loads(told.out)["findings"])
    scores = {row["item"]: row["score"] for row in json.loads(told.out)["scores"] if row["dataset"] == "all"}
    assert scores["x"] == pytest.approx(np.log(2) / 2, abs=1e-6)  # two wins to one: the ties favour neither
    for name in ("analysis.json", "scores.csv", "triads.csv", "observers.csv", "report.html"):
        assert (tmp_path / "out" / name).stat().st_size > 0


def test_an_unknown_choice_is_named_with_its_row(command: Command, tmp_path: Path) -> None:
    (tmp_path / "votes.csv").write_text(VOTES.replace("p3,ball,x,y,a", "p3,ball,x,y,left"))
    told = command("analyse", tmp_path / "votes.csv", "-o", tmp_path / "out")
    assert told.code == 1
    assert "votes.csv: row 3" in told.err
    assert "'left'" in told.err
    assert not (tmp_path / "out").exists()


RATINGS = "participant,dataset,condition,rating\n" + "".join(
    f"p{p},ball,{item},{rating + p % 2}\n" for p in range(4) for item, rating in (("x", 1), ("y", 3), ("z", 4))
)


@pytest.mark.slow
def test_ratings_become_opinion_scores_and_a_report(command: Command, tmp_path: Path) -> None:
    (tmp_path / "ratings.csv").write_text(RATINGS)
    told = command("analyse", tmp_path / "ratings.csv", "-o", tmp_path / "out")
    assert told.code == 0, told.err
    lines = [line.split() for line in told.out.splitlines() if line.startswith("  ")]
    assert [line[:2] for line in lines] == [["z", "4.50"], ["y", "3.50"], ["x", "1.50"]]
    assert "4 participants are few" in told.out
    for name in ("analysis.json", "rating_items.csv", "raters.csv", "report.html"):
        assert (tmp_path / "out" / name).stat().st_size > 0


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (("--scale", "1:4"), 1, "row 6: rating is 5, expected 1 to 4"),
        (("--scale", "5"), 2, "expected two numbers"),
        (("--scale", "5:1"), 2, "expected its low end first"),
        (("--ties", "half"), 2, "--ties is for votes"),
    ],
)
def test_options_that_do_not_fit_ratings_are_refused(
    command: Command, tmp_path: Path, options: tuple[str, str], code: int, says: str
) -> None:
    (tmp_path / "ratings.csv").write_text(RATINGS)
    told = command("analyse", tmp_path / "ratings.csv", "-o", tmp_path / "out", *options)
    assert told.code == code
    assert says in " ".join(told.err.replace("│", " ").split())
    assert not (tmp_path / "out").exists()


def test_a_scale_of_votes_is_refused(command: Command, tmp_path: Path) -> None:
    (tmp_path / "votes.csv").write_text(VOTES)
    told = command("analyse", tmp_path / "votes.csv", "-o", tmp_path / "out", "--scale", "1:5")
    assert told.code == 2
    assert "--ratings FILE" in told.err


@pytest.mark.slow
def test_published_scores_come_back_from_the_votes(command: Command, real_data: Path, tmp_path: Path) -> None:
    votes = real_data / "votes/pwcmp_tone_mapping.csv"
    told = command("analyse", votes, "-o", tmp_path / "out", "--json")
    assert told.code == 0, told.err
    analysis = json.loads(told.out)
    pooled = [row for row in analysis["scores"] if row["dataset"] == "all" and row["comparison"] == "all"]
    assert {row["item"]: round(row["score"], 3) for row in pooled} == {
        "irawan05": 1.187,
        "mantiuk08": 0.678,
        "tmo_camera": 0.425,
        "ronan12": 0.046,
        "ferwerda96": -0.118,
        "pattanaik00": -0.628,
        "hateren06": -1.59,
    }
    assert sum(row["circular"] for row in analysis["triads"]) == 0


@pytest.mark.slow
def test_a_study_starts_from_a_preset_and_the_command_overrides_it(command: Command, stimuli: Path) -> None:
    created = command("study", "create", stimuli, "--name", "Home", "--preset", "online", "--break-every", 7)
    assert created.code == 0, created.err
    told = json.loads(command("study", "export", "home", "--json").out)["toml"]
    for line in ('distance = "blind spot"', "identical_pairs = 1", "break_every = 7", 'name = "experience"'):
        assert line in told


def test_an_unknown_preset_is_refused_in_one_sentence(command: Command, stimuli: Path) -> None:
    told = command("study", "create", stimuli, "--name", "Tiny", "--preset", "papr")
    assert told.code == 1
    assert told.err.strip().endswith("preset 'papr' is not known; expected one of paper, quick, online")


OPTIONS = """optional_stages = ["practice"]
both_orders = true
identical_pairs = 1
"""


@pytest.mark.slow
def test_a_studys_options_come_from_a_file_and_from_the_command(
    command: Command, stimuli: Path, tmp_path: Path
) -> None:
    (tmp_path / "options.toml").write_text(OPTIONS)
    created = command(
        "study", "create", stimuli, "--name", "Tiny", "--options", tmp_path / "options.toml", "--identical-pairs", 2
    )
    assert created.code == 0, created.err
    exported = command("study", "export", "tiny", "--json")
    told = json.loads(exported.out)["toml"]
    assert 'optional_stages = ["practice"]' in told
    assert "both_orders = true\nidentical_pairs = 2\n" in told


@pytest.mark.slow
def test_a_dataset_for_practice_is_left_out_of_the_trials_and_comes_back_with_the_study_file(
    command: Command, tmp_path: Path
) -> None:
    stimuli = tiny_stimuli.write_set(tmp_path / "set", ("ball", "box"), tiny_stimuli.APPROACHES).parent
    (tmp_path / "options.toml").write_text('optional_stages = ["practice"]')
    lent = command("study", "create", stimuli, "--name", "Lent", "--options", tmp_path / "options.toml")
    assert "The practice shows ball/id_fa and ball/pm_fb, and the trials compare these two films, too" in lent.out
    spared = command("study", "create", stimuli, "--name", "Spared", "--practice", "box", "--json")
    assert spared.code == 0, spared.err
    told = json.loads(spared.out)
    assert (told["n_datasets"], told["n_pairs"], "notes" in told) == (1, 3, False)
    exported = json.loads(command("study", "export", "spared", "--json").out)["toml"]
    assert 'practice_pairs = [{ dataset = "box", a = "id_fa", b = "pm_fb" }]' in exported
    (tmp_path / "again.toml").write_text(exported.replace('"Spared"', '"Again"'))
    assert command("study", "import", tmp_path / "again.toml", "--stimuli", stimuli).code == 0
    again = json.loads(command("study", "export", "again", "--json").out)["toml"]
    assert again == exported.replace('"Spared"', '"Again"')


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ("breaks = 3", "option 'breaks' is not known"),
        ("both_orders = 'yes'", "both_orders is 'yes'"),
        ("x", "options"),
        ("\xb0", "is no text in UTF-8; expected a TOML file"),
    ],
)
def test_options_that_are_not_right_are_named_with_their_file(
    command: Command, stimuli: Path, tmp_path: Path, options: str, complaint: str
) -> None:
    (tmp_path / "options.toml").write_text(options, encoding="latin-1")
    told = command("study", "create", stimuli, "--name", "Tiny", "--options", tmp_path / "options.toml")
    assert told.code == 1
    assert f"{tmp_path / 'options.toml'}: " in told.err
    assert complaint in told.err


def test_a_reference_that_is_not_there_is_named(command: Command, stimuli: Path) -> None:
    told = command("study", "create", stimuli, "--name", "Tiny", "--reference", "truth")
    assert told.code == 1
    assert "the reference 'truth' is not among them" in told.err


@pytest.mark.parametrize("exposure", ["nan", "-3", "inf"])
def test_a_plan_is_made_for_films_of_a_possible_length_only(command: Command, exposure: str) -> None:
    told = command("plan", "--conditions", 2, "--datasets", 1, "--participants", 9, "--exposure", exposure)
    assert told.code == 2
    assert "expected 0.1 to 3600 seconds" in " ".join(told.err.replace("│", " ").split())


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--effect", "-1", "--effect is -1, expected more than 0"),
        ("--inconsistency", "nan", "--inconsistency is nan, expected more than 0"),
        ("--replicates", "1000000", "Invalid value for '--replicates'"),
    ],
)
@pytest.mark.parametrize("protocol", ["PC", "ACR"])
def test_a_plan_of_impossible_numbers_is_refused_by_its_options(
    command: Command, option: str, value: str, expected: str, protocol: str
) -> None:
    sizes = ("--conditions", 2, "--datasets", 1, "--participants", 9, "--protocol", protocol)
    told = command("plan", *sizes, option, value)
    assert told.code == 2
    assert expected in " ".join(told.err.replace("│", " ").split())


def test_a_plan_tells_how_far_its_simulation_is(command: Command) -> None:
    told = command("plan", "--conditions", 2, "--datasets", 1, "--participants", 30, "--replicates", 10, "--json")
    assert json.loads(told.out)["replicates"] == 10
    assert "studies of one dataset simulated: 110/110" in told.err
    assert "studies of all datasets simulated: 110/110" in told.err


@pytest.mark.slow
def test_films_are_rated_where_the_protocol_says_so_and_planned_in_grades(command: Command, stimuli: Path) -> None:
    refused = command("study", "create", stimuli, "--name", "Rated", "--protocol", "DCR")
    assert refused.code == 1
    assert "protocol DCR needs a reference" in refused.err
    created = command("study", "create", stimuli, "--name", "Rated", "--protocol", "ACR", "--scale", "slider")
    assert "2 trials of 2 conditions" in created.out
    told = json.loads(command("study", "export", "rated", "--json").out)["toml"]
    assert 'protocol = "ACR"\nscale = "slider"\n' in told
    sizes = ("--conditions", 2, "--datasets", 1, "--participants", 20, "--exposure", 11)
    plan = json.loads(command("plan", *sizes, "--protocol", "ACR", "--json").out)
    assert (plan["trials"], plan["minutes"], plan["votes"]) == (2, 1, 40)
    assert "grades" in command("plan", *sizes, "--protocol", "DCR").out
    assert "protocol is 'MOS', expected one of PC" in command("plan", *sizes, "--protocol", "MOS").err


@pytest.mark.slow
def test_an_exported_study_is_imported_beside_the_same_stimuli_only(
    command: Command, stimuli: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command("study", "create", stimuli, "--name", "Tiny", "--seed", 5, "--both-orders", "--break-every", 0)
    file = tmp_path / "tiny.toml"
    assert command("study", "export", "tiny", "-o", file).code == 0
    first = file.read_text()
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(tmp_path / "elsewhere"))
    assert "names no stimuli" in command("study", "import", file).err
    imported = command("study", "import", file, "--stimuli", stimuli, "--json")
    assert imported.code == 0, imported.err
    assert json.loads(imported.out)["seed"] == 5
    assert json.loads(command("study", "export", "tiny", "--json").out)["toml"] == first

    manifest = read_json(stimuli / "manifest.json")
    write_json(stimuli / "manifest.json", manifest | {"name": "another"})
    file.write_text(f'stimuli = "{stimuli.name}"\n' + first.replace('"Tiny"', '"Other"'))
    told = command("study", "import", file)
    assert told.code == 1
    assert "this is another stimulus set" in told.err


@pytest.mark.parametrize("url", ["https://study.example.org", "https://study.example.org/"])
def test_a_link_leads_to_the_address_that_is_given_with_or_without_a_slash_at_its_end(
    command: Command, url: str
) -> None:
    added = json.loads(command("admin", "add", "Me", "--url", url, "--json").out)
    assert added["link"] == f"https://study.example.org{added['path']}"


@pytest.mark.parametrize(
    ("name", "value"),
    [("PUBLIC_URL", "https://study.example.org/"), ("LOG_FORMAT", "JSON"), ("LARGEST_UPLOAD_MB", "4 GB")],
)
def test_a_setting_that_is_wrong_is_named_in_one_line(
    command: Command, monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv(f"RECONSTUDY_{name}", value)
    told = command("status")
    assert told.code == 1
    assert told.err.startswith(f"reconstudy: RECONSTUDY_{name} is '{value}': ")
    assert told.err.count("\n") == 1
    assert str(Settings.model_fields[name.lower()].description) in told.err


@pytest.mark.parametrize(
    ("misspelled", "meant"),
    [("SECURE_COOKIE", "SECURE_COOKIES"), ("DATADIR", "DATA_DIR"), ("DATABSE_URL", "DATABASE_URL")],
)
def test_a_misspelled_setting_is_named_with_what_was_meant(
    command: Command, monkeypatch: pytest.MonkeyPatch, misspelled: str, meant: str
) -> None:
    """Nothing else would tell that the server goes without it."""
    monkeypatch.setenv(f"RECONSTUDY_{misspelled}", "true")
    told = command("--version").err
    assert told == (
        f"warning: RECONSTUDY_{misspelled} is no setting and changes nothing; did you mean RECONSTUDY_{meant}?\n"
    )


def test_no_other_variable_is_taken_for_a_misspelled_setting(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("REAL_DATA", "DEBUG", "FILES_BELOW", "PROGRESS_FILE", "PUBLIC_URL"):
        monkeypatch.setenv(f"RECONSTUDY_{name}", "x")
    assert command("--version").err == ""


@pytest.mark.parametrize("url", ["study.example.org", "https://", "https://study.example.org/s"])
def test_an_address_for_links_that_leads_nowhere_is_refused(command: Command, url: str) -> None:
    told = command("admin", "add", "Me", "--url", url)
    assert told.code == 2
    assert "is no address of a server; expected" in told.err


@pytest.mark.parametrize("key", ['name = "Tiny"', "exposure_s = 1.5", "[options]"])
def test_a_study_file_in_place_of_its_options_is_named(command: Command, tmp_path: Path, key: str) -> None:
    path = tmp_path / "tiny.toml"
    path.write_text(key, encoding="utf-8")
    told = command("study", "create", tmp_path, "--name", "Tiny", "--options", path)
    assert told.code == 1
    assert "tiny.toml: is a study file; make its study by `reconstudy study import FILE" in told.err


@pytest.mark.slow
def test_an_invitation_is_made_for_so_many(command: Command, stimuli: Path) -> None:
    command("study", "create", stimuli, "--name", "Tiny")
    made = json.loads(command("study", "invite", "tiny", "--places", 3, "--json").out)
    assert made["link"].endswith(f"/s/{made['invitation']}")
    assert made["invitation"] in command("study", "list").out
    assert "there is no study 'none'" in command("study", "invite", "none").err


def test_a_rule_of_who_finished_is_not_broken_but_not_reached_yet() -> None:
    rules = [
        {"rule": "spread", "of": of, "worst": 2, "allowed": 1, "ok": False}
        for of in ("who hold a slot", "who finished")
    ]
    lines = list(_balance_lines({"seed": 1, "ok": False, "participants": {}, "rules": rules}))
    assert [line.split()[0] for line in lines[-2:]] == ["NO", "not"]


@pytest.mark.slow
def test_balance_is_told(command: Command, stimuli: Path) -> None:
    command("study", "create", stimuli, "--name", "Tiny", "--seed", 1)
    assert command("simulate", "--study", "tiny", "--participants", 3).code == 0
    told = command("study", "balance", "tiny")
    assert "Orders from the seed 1: balanced" in told.out
    assert "3 finished" in told.out
    report = json.loads(command("study", "balance", "tiny", "--json").out)
    assert report["pairs"][0]["n_shown"] == 3
