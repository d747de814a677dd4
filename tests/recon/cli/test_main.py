"""Recordings, depth and models by the command line: what it prints, and how it ends, above all on bad input."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fsspec.implementations.memory import MemoryFileSystem
from numpy.typing import NDArray

from recon.runtime.files import read_json, write_json
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


def edit(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = read_json(folder / "capture.json")
    change(content)
    write_json(folder / "capture.json", content)


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


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("fuse x -o y --voxel -1", "'--voxel': -1.0, expected a positive number"),
        ("reconstruct x -o y --voxel 0", "'--voxel': 0.0, expected a positive number"),
        ("validate object a b -o c --trim 0", "'--trim': 0.0, expected a positive number up to 1"),
        ("validate object a b -o c --trim 2", "'--trim': '2', expected a number of at most 1"),
        ("validate cloud a --reference b -o c --peak -1", "'--peak': -1.0, expected a positive number"),
        ("validate cloud a --reference b -o c --density 0", "'--density': 0.0, expected a positive number"),
        ("capture synth x --fps 0", "'--fps': 0.0, expected a positive number"),
    ],
)
def test_a_number_that_nothing_can_be_made_with_is_refused_by_its_flag(
    command: Command, words: str, sentence: str
) -> None:
    outcome = command(*words.split())
    assert outcome.code == 2
    assert sentence in " ".join(outcome.err.split())


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


@pytest.mark.slow
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
