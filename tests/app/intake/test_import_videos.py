"""Somebody else's videos become a stimulus set that a study can use, or nothing is left of the attempt."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import app
from app.errors import StimuliError, said_on_page
from app.files import file_digest
from app.intake.import_videos import import_stimuli
from app.intake.stimuli import read_stimulus_set
from tests.app import tiny_stimuli

GUESSED = "all {0} films: colours read as 8 bits, smpte170m, range tv (matrix and range guessed from size and format)"
LEVELS = "condition,codec,bitrate\nlow,av1,1\nhigh,av1,4\n"


@pytest.fixture
def videos(tmp_path: Path) -> Path:
    """Two datasets of two conditions, and a scene for practice."""
    folder = tmp_path / "my videos"
    for dataset in ("street", "forest", "warm-up"):
        for level, condition in ((0x30, "high"), (0x60, "low")):
            tiny_stimuli.encode(
                folder / dataset / f"{condition}.mp4", tiny_stimuli.flat(f"0x{level:02x}{level:02x}{level:02x}")
            )
    (folder / "conditions.csv").write_text(LEVELS, encoding="utf-8")
    return folder


def test_a_folder_of_videos_becomes_a_stimulus_set(videos: Path, tmp_path: Path) -> None:
    out = tmp_path / "set"
    result = CliRunner().invoke(
        app, ["stimuli", "import", str(videos), "-o", str(out), "--practice", "warm-up", "--json"]
    )
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["videos"] == 4
    found = read_stimulus_set(out)
    assert (found.datasets, found.conditions) == (("forest", "street"), ("high", "low"))
    assert found.factors == {"codec": ["av1"], "bitrate": ["1", "4"]}
    assert found.stimuli[0].levels == {"codec": "av1", "bitrate": "4"}
    assert [one.name for one in found.practice] == ["warm-up/high", "warm-up/low"]


def test_conditions_need_no_factors(videos: Path, tmp_path: Path) -> None:
    (videos / "conditions.csv").unlink()
    found = import_stimuli(videos, tmp_path / "set").stimulus_set
    assert found.factors == {}
    assert len(found.datasets) == 3


def test_a_condition_may_have_no_level_of_a_factor(videos: Path, tmp_path: Path) -> None:
    (videos / "conditions.csv").write_text("condition,codec,bitrate\nlow,av1,1\nhigh,,4\n", encoding="utf-8")
    made = import_stimuli(videos, tmp_path / "set")
    assert made.stimulus_set.factors == {"codec": ["av1"], "bitrate": ["1", "4"]}
    assert made.stimulus_set.stimuli[0].levels == {"bitrate": "4"}
    assert made.notes == (
        GUESSED.format(6),
        "no level of codec: high; compared with all others, and left out where factors are compared",
    )


def test_a_table_of_conditions_may_come_from_a_spreadsheet_with_semicolons(videos: Path, tmp_path: Path) -> None:
    (videos / "conditions.csv").write_text("condition ;codec ; bitrate\nlow;av1;1\nhigh;av1;'=4\n", encoding="utf-16")
    made = import_stimuli(videos, tmp_path / "set").stimulus_set
    assert made.factors == {"codec": ["av1"], "bitrate": ["1", "=4"]}
    assert made.stimuli[0].levels == {"codec": "av1", "bitrate": "=4"}


def test_a_film_keeps_its_master_its_mask_its_quality_and_its_camera_path(videos: Path, tmp_path: Path) -> None:
    for ending in ("master", "mask"):
        shutil.copy(videos / "street" / "low.mp4", videos / "street" / f"low.{ending}.mp4")
    (videos / "street" / "low.quality.json").write_text('{"psnr_y_mean_db": 50.5}', encoding="utf-8")
    (videos / "street" / "thumbs.db").write_text("what is this", encoding="utf-8")
    (videos / "paths").mkdir()
    (videos / "paths" / "street.json").write_text('{"camera_path": []}', encoding="utf-8")
    made = import_stimuli(videos, tmp_path / "set")
    assert made.stimulus_set.conditions == ("high", "low")
    read_stimulus_set(tmp_path / "set")
    manifest = json.loads((tmp_path / "set" / "manifest.json").read_text(encoding="utf-8"))
    (low,) = (entry for entry in manifest["stimuli"] if (entry["dataset"], entry["approach"]) == ("street", "low"))
    assert (low["master"], low["quality"]) == ("street/low.master.mp4", {"psnr_y_mean_db": 50.5})
    assert low["mask"] == "street/low.mask.mp4"
    path = manifest["provenance"]["paths"]["street"]
    assert file_digest(tmp_path / "set" / path["file"]) == path["sha256"]
    assert made.notes == (
        "left out, as neither film nor master: street/thumbs.db",
        GUESSED.format(6),
        "street: no master of high, which the others have; a study encodes these once more",
    )


def test_a_rendered_folder_keeps_all_that_its_manifest_says(tmp_path: Path) -> None:
    folder = tmp_path / "rendered"
    tiny_stimuli.write_set(folder, ("ball",), ("id_fa", "pm_fb"))
    entries = [tiny_stimuli.stimulus(folder, "ball", name) for name in ("id_fa", "pm_fb")]
    for entry in entries:
        for key in ("master", "mask"):
            entry[key] = entry["video"].replace(".mp4", f".{key}.mp4")
            shutil.copy(folder / entry["video"], folder / entry[key])
    tiny_stimuli.write_manifest(folder, entries, provenance={"runs": [{"dataset": "ball"}]})
    made = import_stimuli(folder, tmp_path / "set")
    assert made.notes[0].endswith("is a stimulus set: its factors, masters, camera paths and provenance are kept")
    assert read_stimulus_set(tmp_path / "set").stimuli == read_stimulus_set(folder).stimuli
    manifest = json.loads((tmp_path / "set" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["provenance"]["merged"][0]["provenance"] == {"runs": [{"dataset": "ball"}]}
    shutil.copy(folder / "ball" / "id_fa.mp4", folder / "ball" / "splat.mp4")
    with pytest.raises(StimuliError, match=r"splat\.mp4: .*does not name it; remove it if .*stimuli merge"):
        import_stimuli(folder, tmp_path / "again")
    with pytest.raises(StimuliError, match="which says what is for practice"):
        import_stimuli(folder, tmp_path / "again", practice="ball")
    assert not (tmp_path / "again").exists()


def test_a_manifest_of_another_program_is_named_and_left_out(videos: Path, tmp_path: Path) -> None:
    (videos / "manifest.json").write_text('{"name": "an app"}', encoding="utf-8")
    made = import_stimuli(videos, tmp_path / "set")
    assert made.notes == ("left out, as neither film nor master: manifest.json", GUESSED.format(6))


def spoil(videos: Path, fault: str) -> None:
    if fault == "missing":
        (videos / "street" / "low.mp4").unlink()
    if fault == "long":
        tiny_stimuli.encode(videos / "street" / "low.mp4", tiny_stimuli.flat("black"), "-frames:v", "12")
    if fault == "uneven":
        frames = ["-vf", "setpts=if(gt(N\\,4)\\,2*N\\,N)/25/TB", "-fps_mode", "vfr"]
        tiny_stimuli.encode(videos / "street" / "low.mp4", tiny_stimuli.flat("black"), *frames)
    if fault == "text":
        (videos / "street" / "low.mp4").write_text("<html>no video</html>", encoding="utf-8")
    if fault == "twice":
        shutil.copy(videos / "street" / "low.mp4", videos / "street" / "low.mkv")
    if fault == "row":
        (videos / "conditions.csv").write_text("condition,codec\nlow,av1\n", encoding="utf-8")
    if fault == "unknown":
        (videos / "conditions.csv").write_text(LEVELS + "middle,av1,2\n", encoding="utf-8")
    if fault == "master":
        (videos / "street" / "low.mp4").rename(videos / "street" / "low.master.mp4")
    if fault == "long master":
        tiny_stimuli.encode(videos / "street" / "low.master.mp4", tiny_stimuli.flat("black"), "-frames:v", "12")
    if fault == "columns":
        (videos / "conditions.csv").write_text("name,codec\nlow,av1\n", encoding="utf-8")
    if fault == "bytes":
        (videos / "conditions.csv").write_bytes(b"condition,codec\n\xf9\x8f")
    if fault == "empty":
        shutil.rmtree(videos)
        videos.mkdir()


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        ("missing", "street: has no video of low, which other datasets have; .* to practise with .*--practice DATASET"),
        (
            "long",
            "street/low has 12 frames at 25/s .*, expected 10 frames .* `--conform` makes them so, or `ffmpeg -i low",
        ),
        ("uneven", r"low.mp4: its frames are \d+ to \d+ ms apart, .* encode it again by `ffmpeg -i low.mp4 -r 25 "),
        ("bytes", r"conditions\.csv: row 1: .* is not UTF-8"),
        ("text", "low.mp4: cannot be decoded as a video"),
        ("twice", "low.mkv and low.mp4 are both the condition low"),
        ("row", "has no row for high"),
        ("unknown", "names middle, of which there is no video"),
        (
            "master",
            "low.master.mp4: is the master of a film low.mp4 that is not there; put the film beside it",
        ),
        (
            "long master",
            r"low.master.mp4: has 12 frames at 25/s of 64x48, its film low.mp4 has 10 frames at 25/s of 64x48",
        ),
        ("columns", "has the columns name, codec; expected condition"),
        ("empty", "holds no video; expected a folder for each dataset"),
    ],
)
def test_what_cannot_be_compared_is_refused_and_leaves_nothing(
    videos: Path, tmp_path: Path, fault: str, why: str
) -> None:
    spoil(videos, fault)
    with pytest.raises(StimuliError, match=why):
        import_stimuli(videos, tmp_path / "set")
    assert not (tmp_path / "set").exists()


def test_a_folder_with_something_in_it_is_not_written_to(videos: Path, tmp_path: Path) -> None:
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "mine.txt").write_text("keep", encoding="utf-8")
    with pytest.raises(StimuliError, match="is not empty; choose a new folder"):
        import_stimuli(videos, tmp_path / "set")
    assert (tmp_path / "set" / "mine.txt").read_text(encoding="utf-8") == "keep"


def test_a_scene_for_practice_has_two_videos(videos: Path, tmp_path: Path) -> None:
    (videos / "warm-up" / "low.mp4").unlink()
    with pytest.raises(StimuliError, match="has 1 video; practice needs two"):
        import_stimuli(videos, tmp_path / "set", practice="warm-up")


def test_the_range_of_prores_which_no_file_says_is_said_to_be_guessed(tmp_path: Path) -> None:
    for condition in ("a", "b"):
        film = tmp_path / "videos" / "street" / f"{condition}.mov"
        chain = ("-pix_fmt", "yuv422p10le", "-c:v", "prores_ks", "-color_range", "pc", "-colorspace", "bt709")
        tiny_stimuli.encode(film, tiny_stimuli.flat("gray"), *chain)
    notes = import_stimuli(tmp_path / "videos", tmp_path / "set").notes
    assert "all 2 films: colours read as 10 bits, bt709, range tv (range guessed from size and format)" in notes


def changing_rate(folder: Path) -> None:
    frames = ("-vf", "setpts=if(gt(N\\,4)\\,2*N\\,N)/25/TB", "-fps_mode", "vfr")
    tiny_stimuli.encode(folder / "street" / "a.mp4", tiny_stimuli.flat("gray"), *frames)


def transparent(folder: Path) -> None:
    chain = ("-pix_fmt", "yuva444p10le", "-c:v", "prores_ks", "-profile:v", "4444")
    tiny_stimuli.encode(folder / "street" / "a.mov", tiny_stimuli.flat("gray"), *chain)


def unlike(folder: Path) -> None:
    tiny_stimuli.encode(folder / "street" / "a.mp4", tiny_stimuli.flat("gray"))
    tiny_stimuli.encode(folder / "street" / "b.mp4", "color=gray:size=128x96:rate=25")


def incomplete(folder: Path) -> None:
    for place in ("street/a", "street/b", "forest/a"):
        tiny_stimuli.encode(folder / f"{place}.mp4", tiny_stimuli.flat("gray"))


@pytest.mark.parametrize("make", [changing_rate, transparent, unlike, incomplete])
def test_a_refusal_has_a_way_out_for_who_has_commands_and_one_for_who_has_pages(
    make: Callable[[Path], None], tmp_path: Path
) -> None:
    make(tmp_path / "films")
    with pytest.raises(StimuliError) as refused:
        import_stimuli(tmp_path / "films", tmp_path / "set")
    assert re.search("`(ffmpeg|--)", str(refused.value))
    told = said_on_page(refused.value)
    assert not re.search("`|ffmpeg|--", told)
    assert told.rpartition("; ")[2].startswith(("export it again", "tick ", "add what lacks"))
