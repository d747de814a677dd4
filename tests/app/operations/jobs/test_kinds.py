"""What a form or a client gives becomes a command of this program, and nothing else."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from typer.main import get_command

from app.cli import app as command_line
from app.errors import InvalidError
from app.files import write_json
from app.intake.shelves import is_plain
from app.operations.jobs.fields import Choice, Choices, Entries, Entry, NewName, Number, Switch, Text
from app.operations.jobs.kinds import KINDS, in_page_words, job_kind, kinds_for
from app.settings import Settings

FILES = (
    "captures/ball/capture.json",
    "captures/ball/strokes.json",
    "captures/recording/calibration.yml",
    "calibration/board/left/0.png",
    "models/theirs/scene.json",
    "films/mine/ball/pm_fb.mp4",
    "clouds/S1.ply",
    "clouds/placed/1.ply",
    "clouds/placed/2.ply",
    "runs/done/run.json",
)


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    settings = Settings(data_dir=tmp_path_factory.mktemp("shelves"))
    for name in FILES:
        path = settings.intake_dir / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    manifest = settings.sets_dir / "set" / "manifest.json"
    manifest.parent.mkdir(parents=True)
    manifest.touch()
    (settings.intake_dir / "captures" / "link").symlink_to(settings.intake_dir / "captures" / "ball")
    return settings


def some_value(field: Any, settings: Settings) -> Any:
    """A value that a field takes, if possible not its default."""
    if isinstance(field, Entry):
        name = field.names(settings)[0]
        return [name] if isinstance(field, Entries) else name
    if isinstance(field, Choice | Choices):
        last = list(field.choices)[-1]
        return [last] if isinstance(field, Choices) else last
    if isinstance(field, Number):
        return max(field.low, 2)
    if isinstance(field, Text):
        return re.split(r" or ", field.example)[0]
    return not field.default if isinstance(field, Switch) else "new name"


@pytest.mark.parametrize("name", KINDS)
def test_every_field_of_every_kind_is_one_that_the_command_takes(name: str, here: Settings) -> None:
    kind = job_kind(name)
    new = kind.read({field.name: some_value(field, here) for field in kind.fields}, here)
    words = kind.argv(new.arguments, here)
    context, command = None, get_command(command_line)
    while hasattr(command, "commands"):
        command = command.commands[words.pop(0)]
    context = command.make_context(name, list(words))  # a UsageError for what it does not take
    assert context.args == []


@pytest.mark.parametrize("name", KINDS)
def test_what_is_required_is_enough_and_what_is_missing_is_named(name: str, here: Settings) -> None:
    kind = job_kind(name)
    required = {field.name: some_value(field, here) for field in kind.fields if field.is_required}
    new = kind.read(required, here)
    assert kind.argv(new.arguments, here)[: len(kind.command.split())] == kind.command.split()
    for field in kind.fields:
        if field.is_required:
            with pytest.raises(InvalidError, match=re.escape(f"{field.label}: is missing")):
                kind.read({key: value for key, value in required.items() if key != field.name}, here)


OUTSIDE = ["../captures/ball", "/etc/passwd", "..", ".", "ball/../../x", "link", "ball/", "", "-o", "ball\0", "ball\n"]


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_path_or_a_link_is_no_entry(name: str, here: Settings) -> None:
    with pytest.raises(InvalidError):
        job_kind("check").read({"capture": name}, here)
    with pytest.raises(InvalidError):
        job_kind("render").read({"sources": ["runs/done", f"runs/{name}"]}, here)


@pytest.mark.parametrize("name", ["../x", "/tmp/x", ".hidden", "a/b", "-o", "x" * 101, "new\nline"])
def test_a_path_is_no_new_name(name: str, here: Settings) -> None:
    with pytest.raises(InvalidError, match="name"):
        job_kind("reconstruct").read({"capture": "ball", "name": name}, here)


@hypothesis_settings(max_examples=60)
@example({"name": "../x"})
@example({"name": "--out=/tmp"})
@example({"capture": "../captures/ball"})
@given(st.dictionaries(st.sampled_from(["capture", "name", "depth", "frames", "voxel", "temporal"]), st.text()))
def test_no_text_becomes_an_option_or_a_path_outside(here: Settings, texts: dict[str, str]) -> None:
    kind = job_kind("reconstruct")
    try:
        words = kind.argv(kind.read({"capture": "ball", **texts}, here).arguments, here)
    except InvalidError:
        return
    inside = str(here.intake_dir.absolute())
    options = [word.partition("=") for word in words[2:]]
    assert words[0] == "reconstruct"
    assert Path(words[1]) == here.intake_dir.absolute() / "captures" / "ball"
    assert {option for option, _, _ in options} <= {
        "--depth",
        "--frames",
        "--voxel",
        "--no-temporal",
        "--pm",
        "--clouds",
        "--meshes",
        "--fill",
        "--steady",
        "--out",
    }
    out = next(value for option, _, value in options if option == "--out")
    assert Path(out).parent == Path(inside) / "runs"


def test_settings_say_where_a_reconstruction_runs(here: Settings) -> None:
    kind = job_kind("reconstruct")
    arguments = kind.read({"capture": "ball"}, here).arguments
    there = here.model_copy(update={"jobs_device": "gpu", "jobs_cluster": "tcp://host:8786"})
    assert set(kind.argv(arguments, there)) - set(kind.argv(arguments, here)) == {
        "--device=gpu",
        "--cluster=tcp://host:8786",
    }


def test_values_are_refused_with_what_was_expected(here: Settings) -> None:
    kind = job_kind("reconstruct")
    for wrong, said in (
        ({"voxel": "thick"}, "Voxel: 'thick' was given, expected a number from 0.01 to 10000"),
        ({"erode": 1.5}, "expected a whole number from 0 to 100"),
        ({"voxel": float("nan")}, "expected a number"),
        ({"depth": ["id", "best"]}, "expected some of id, dr, pm, sgm, given"),
        ({"frames": "1-2"}, "expected for example 0:25"),
        ({"frames": "5:1"}, "Frames: '5:1' was given, expected an end after the first frame"),
        ({"frames": ":0"}, "expected an end after the first frame"),
        ({"temporal": "maybe"}, "expected yes or no"),
        ({"methods": "x.toml"}, "There is no field 'methods'"),
        ({"name": "done"}, "there is 'done' already"),
    ):
        with pytest.raises(InvalidError, match=re.escape(said)):
            kind.read({"capture": "ball", **wrong}, here)
    with pytest.raises(InvalidError, match="no kind of job 'serve'"):
        job_kind("serve")


def test_a_name_is_made_where_none_is_given_and_numbered_where_it_is_taken(here: Settings) -> None:
    assert job_kind("reconstruct").read({"capture": "ball"}, here).output == "runs/ball"
    assert job_kind("render").read({"sources": ["runs/done"]}, here).output == "sets/done"
    assert job_kind("validate-views").read({"run": "done"}, here).output == "runs/done-views"
    (here.intake_dir / "runs" / "done-views").mkdir()
    assert job_kind("validate-views").read({"run": "done"}, here).output == "runs/done-views-2"


@pytest.mark.parametrize(
    ("recording", "capture"),
    [("../../captures/ball", "ball"), ("../../captures/gone", None), ("../../../elsewhere/ball", None), (None, None)],
)
def test_a_validation_of_views_reads_the_recording_that_the_run_names(
    here: Settings, tmp_path: Path, recording: str | None, capture: str | None
) -> None:
    """So it does not run beside a job that changes the recording."""
    settings = Settings(data_dir=tmp_path)
    shutil.copytree(here.intake_dir, settings.intake_dir, symlinks=True)
    write_json(settings.intake_dir / "runs" / "done" / "run.json", {"recording": recording})
    kind = job_kind("validate-views")
    read = kind.reads(kind.read({"run": "done"}, settings).arguments)
    assert read == {"runs/done"} | ({f"captures/{capture}"} if capture else set())
    (settings.intake_dir / "captures" / "other").mkdir()
    (settings.intake_dir / "captures" / "other" / "capture.json").touch()
    chosen = kind.reads(kind.read({"run": "done", "capture": "other"}, settings).arguments)
    assert chosen == {"runs/done", "captures/other"}


def test_a_folder_of_clouds_stands_for_its_files(here: Settings) -> None:
    kind = job_kind("validate-sphere")
    words = kind.argv(kind.read({"clouds": ["S1.ply", "placed"], "radius": 150}, here).arguments, here)
    assert [Path(word).name for word in words[2:5]] == ["S1.ply", "1.ply", "2.ply"]


def test_a_folder_of_clouds_holds_some_in_any_case_of_letters(here: Settings) -> None:
    clouds = here.intake_dir / "clouds"
    for name in ("upper/1.PLY", "nested/S1/1.ply", "noted/1.las", "noted/2.xyz", "noted/notes.txt", "text/1.txt"):
        (clouds / name).parent.mkdir(parents=True, exist_ok=True)
        (clouds / name).touch()
    kind = job_kind("validate-sphere")
    words = kind.argv(kind.read({"clouds": "upper", "radius": 150}, here).arguments, here)
    assert Path(words[2]) == (clouds / "upper/1.PLY").absolute()
    assert [
        len(kind.argv(kind.read({"clouds": name, "radius": 150}, here).arguments, here)) - len(words)
        for name in ("noted", "text")
    ] == [1, 0]  # notes beside clouds are none of them
    with pytest.raises(InvalidError, match="expected the name of something that is or holds clouds in clouds"):
        kind.read({"clouds": "nested", "radius": 150}, here)


def test_a_whole_number_of_hundreds_of_digits_is_no_number_here(here: Settings) -> None:
    with pytest.raises(InvalidError, match="expected a number from"):
        job_kind("validate-sphere").read({"clouds": "S1.ply", "radius": 10**400}, here)


@pytest.mark.parametrize("made", ["calibration.yml", "calibration_report/report.json"])
def test_an_earlier_calibration_gives_way_only_where_that_is_said(here: Settings, made: str) -> None:
    kind = job_kind("calibrate")
    recording = here.intake_dir / "captures" / "by hand"
    (recording / made).parent.mkdir(parents=True)
    (recording / made).touch()
    asked = {"pictures": "board", "board": "chessboard:9x6:25", "recording": "by hand"}
    try:
        with pytest.raises(InvalidError, match="captures/by hand has a calibration already"):
            kind.read(asked, here)
        words = kind.argv(kind.read(asked | {"replace": "yes"}, here).arguments, here)
        assert "--replace" in words
        assert [Path(word).name for word in words[2:] if not word.startswith("--")] == ["board"]  # holds no pictures
    finally:
        shutil.rmtree(recording)


def test_clouds_of_several_sensors_are_named_in_order(here: Settings) -> None:
    for name, size in (("validate-sphere", {"radius": 150}), ("validate-cuboid", {"size": "1x2x3"})):
        kind = job_kind(name)
        asked = {"clouds": ["placed"], **size, "sensors": "S1, left one,S1"}
        words = kind.argv(kind.read(asked, here).arguments, here)
        assert [word for word in words if word.startswith("--sensor")] == [
            "--sensor=S1",
            "--sensor=left one",
            "--sensor=S1",
        ]
        for wrong in (",", "S1,,S2", "S1,-x", "S1=0"):
            with pytest.raises(InvalidError, match=r"Sensors: .* expected for example S1,S2"):
                kind.read(asked | {"sensors": wrong}, here)


def test_an_imported_scene_is_called_as_the_form_says_else_as_its_source(here: Settings) -> None:
    kind = job_kind("import-recording")

    def names(**asked: str) -> list[str]:
        words = kind.argv(kind.read({"format": "opencv", "source": "recording", **asked}, here).arguments, here)
        return [word for word in words if word.startswith("--name")] + [Path(words[-1]).name]

    assert names(name="table tennis") == ["--name=table tennis", "table tennis"]
    assert names() == ["recording-capture"]
    taken = here.intake_dir / "captures" / "recording-capture"
    taken.mkdir()
    assert names() == ["recording-capture-2"]
    taken.rmdir()


def test_an_entry_knows_what_can_be_done_with_it(here: Settings) -> None:
    starts = {kind.name: (field, value) for kind, field, value in kinds_for(here, "runs", "done")}
    assert starts["render"] == ("sources", "runs/done")
    assert starts["validate-views"] == ("run", "done")
    assert "reconstruct" not in starts
    names = {name: {kind.name for kind, _, _ in kinds_for(here, "captures", name)} for name in ("ball", "recording")}
    assert names == {"ball": {"check", "segment", "reconstruct"}, "recording": {"import-recording"}}


def test_a_page_names_the_job_instead_of_its_command() -> None:
    assert (
        in_page_words("no masks; make them by `capture segment`")
        == "no masks; make them by the job “Segment a capture”"
    )
    said = "is no finished run; make one with `reconstudy reconstruct CAPTURE -o RUN`, or choose `voxel`"
    assert in_page_words(said) == "is no finished run; make one with the job “Reconstruct”, or choose `voxel`"


@pytest.mark.parametrize("source", ["録" * 66, "a" * 79 + " b", "ball", "é" * 90])
def test_a_name_that_is_made_of_a_long_one_can_be_used(here: Settings, source: str) -> None:
    assert is_plain(source), "an entry may be called so"
    field = NewName(name="name", label="Name", shelf="runs", pattern="{capture}-check")
    first = field.made_from({"capture": source}, here)
    (here.intake_dir / "runs" / first).mkdir()
    assert field.made_from({"capture": source}, here) == f"{first}-2"
