"""The manifest says what the videos are, with their digests."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from recon.methods.approaches import approaches, levels_of, parse_approach
from recon.pipeline.manifest import Stimulus, write_manifest
from recon.runtime.files import read_json


def stimulus(folder: Path, approach: str) -> Stimulus:
    (folder / f"{approach}.mp4").write_bytes(approach.encode())
    depth, fusion = approach.split("_")
    levels = {"depth": depth, "fusion": fusion}
    return Stimulus(
        "ball", approach, levels, f"{approach}.mp4", None, 64, 48, 25.0, 10, "h264", "software", 3, "bounce", {}
    )


def test_the_manifest_lists_videos_digests_and_factors(tmp_path: Path) -> None:
    path = write_manifest(tmp_path, "set", [stimulus(tmp_path, "id_fb"), stimulus(tmp_path, "dr_fb")], {})
    content = read_json(path)
    assert content["schema_version"] == 1
    assert [entry["sha256"] for entry in content["stimuli"]] == [
        hashlib.sha256(name).hexdigest() for name in (b"id_fb", b"dr_fb")
    ]
    assert content["factors"] == {"depth": ["id", "dr"], "fusion": ["fb"]}
    assert "master" not in content["stimuli"][0]


def test_two_videos_of_one_stimulus_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"more than one video for .*id_fb"):
        write_manifest(tmp_path, "set", [stimulus(tmp_path, "id_fb")] * 2, {})
    assert not (tmp_path / "manifest.json").exists()


def test_an_empty_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one video"):
        write_manifest(tmp_path, "set", [], {})


def test_the_papers_methods_make_six_approaches() -> None:
    names = [str(approach) for approach in approaches(("id", "dr", "pm"), ("fa", "fb"))]
    assert names == ["id_fa", "id_fb", "dr_fa", "dr_fb", "pm_fa", "pm_fb"]


@pytest.mark.parametrize("name", ["id_fa", "dr-sigma8_fb", "raft-stereo_fb-2mm", "8_9"])
def test_an_approach_is_any_two_methods(name: str) -> None:
    approach = parse_approach(name)
    assert str(approach) == name
    assert list(approach.levels.values()) == name.split("_")


def test_a_third_part_says_that_colours_come_from_photographs() -> None:
    approach = parse_approach("pm_fb_photographs")
    assert (str(approach), approach.levels) == ("pm_fb_photographs", parse_approach("pm_fb").levels)
    assert levels_of(["pm_fb", "id_fa"]) == {
        "pm_fb": {"depth": "pm", "fusion": "fb"},
        "id_fa": {"depth": "id", "fusion": "fa"},
    }
    alike = levels_of(["pm_fb_photographs", "id_fa_photographs"])
    assert all("colour" not in levels for levels in alike.values()), "all have the same"
    both = levels_of(["pm_fb", "pm_fb_photographs"])
    assert [level["colour"] for level in both.values()] == ["vertices", "photographs"]


@pytest.mark.parametrize(
    "name",
    [
        "id",
        "_fa",
        "id_",
        "ID_fa",
        "id_fa_fb",
        "id_photographs_",
        "id_fa_photographs_photographs",
        "../id_fa",
        "i d_fa",
        "-id_fa",
        "id_fa\n",
    ],
)
def test_a_name_that_is_not_safe_in_files_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"is not an approach|is no name of a method"):
        parse_approach(name)


def test_levels_of_any_method_are_factors(tmp_path: Path) -> None:
    path = write_manifest(
        tmp_path, "set", [stimulus(tmp_path, name) for name in ("id_fb", "dr-sigma8_fb", "id_fx")], {}
    )
    assert read_json(path)["factors"] == {"depth": ["id", "dr-sigma8"], "fusion": ["fb", "fx"]}
