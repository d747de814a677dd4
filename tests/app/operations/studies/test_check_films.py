"""Films are right only when each was decoded to its end and, where a browser is installed, played in it."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from app.errors import ConflictError, InvalidError, UnavailableError
from app.ffmpeg import no_progress
from app.files import file_digest
from app.films.pairs import FilmMaker, prepare_pairs
from app.films.strips import MEDIA_TYPES
from app.intake.stimuli import read_stimulus_set
from app.operations.database import open_store, study_named
from app.operations.studies import check_films
from app.operations.studies.check_films import check_study
from app.operations.studies.create import create_study
from app.operations.studies.edit import mend_films
from app.operations.studies.play_films import PlayedFilm, find_browser, play_films
from app.settings import Settings
from app.study.options.options import parse_options
from tests.app import tiny_stimuli
from tests.command_line import Command
from tests.conftest import browser_path

HEIGHT = 2 * tiny_stimuli.HEIGHT + 16


def film(path: Path, **changes: Any) -> PlayedFilm:
    facts = {"width": tiny_stimuli.WIDTH, "height": HEIGHT, "n_frames": tiny_stimuli.N_FRAMES, "fps": 25.0}
    return PlayedFilm(path, "video", MEDIA_TYPES["h264"], **(facts | changes))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tiny_stimuli.write_set(tmp_path / "set", ("ball",), ("id_fa", "pm_fb")).parent


@pytest.mark.slow
def test_a_browser_tells_films_that_play_from_those_that_it_cannot_show(folder: Path, tmp_path: Path) -> None:
    (pair,) = prepare_pairs(read_stimulus_set(folder), FilmMaker(tmp_path))
    good, broken, wide = tmp_path / pair.file, tmp_path / "broken.mp4", tmp_path / "wide.mp4"
    content = good.read_bytes()
    broken.write_bytes(content[: len(content) // 2])
    tiny_stimuli.encode(wide, f"color=gray:size=64x{HEIGHT}:rate=25", "-vf", "setsar=2/1")
    films = [film(good), film(broken), film(wide), film(good, n_frames=500), film(tmp_path / "none.mp4")]
    played, damaged, other_size, short, missing = play_films(browser_path(), films)
    assert played == ""
    assert damaged != ""
    assert other_size == f"the film is 128x{HEIGHT}, expected 64x{HEIGHT}"
    assert "early" in short
    assert "cannot be read (404)" in missing


@pytest.mark.slow
def test_what_is_no_browser_is_told_and_none_may_be_wanted(tmp_path: Path) -> None:
    assert find_browser("none") is None
    assert find_browser(str(tmp_path / "nothing")) is None
    with pytest.raises(UnavailableError, match="could not be used to play"):
        play_films("false", [film(tmp_path / "x.mp4")])


@pytest.mark.slow
def test_a_studys_films_are_played_before_the_first_invitation(folder: Path, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "server", check_browser=browser_path())
    options = parse_options({"optional_stages": ["practice"], "lighter_films": True})
    made = create_study(settings, folder, "Played", options=options)
    (note,) = (note for note in made["notes"] if "played to the end" in note)
    assert note.startswith("All 6 films were decoded to their last picture")
    assert "and all were played" in note
    assert json.loads((settings.data_dir / "checks" / "played.json").read_text())["n_played"] == 6


@pytest.mark.slow
def test_the_check_decodes_every_film_and_says_what_it_could_not_do(
    folder: Path, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(data_dir=tmp_path / "study")
    made = create_study(settings, folder, "Checked")
    checked = json.loads(command("study", "check", made["slug"], "--json").out)
    assert (checked["faults"], checked["browser"]) == ({}, "")
    assert "could not be played in a browser" in command("study", "check", made["slug"]).out
    first = next(settings.media_dir.glob("*.mp4"))
    digest = file_digest(first)
    first.write_bytes(first.read_bytes() + b"x")
    assert list(check_study(settings, made["slug"])["faults"].values()) == [
        "the file is not what it was when the study was made"
    ]
    monkeypatch.setattr(check_films, "file_digest", lambda _path: digest)
    first.write_bytes(b"no film, though its digest is right")
    (fault,) = check_study(settings, made["slug"])["faults"].values()
    assert fault.startswith("cannot be decoded as a video")
    tiny_stimuli.encode(first, "color=gray:size=64x104:rate=25", "-vf", "setsar=2")
    (fault,) = check_study(settings, made["slug"])["faults"].values()
    assert re.fullmatch(r"it has .*, pixels 2:1, its player expects \d+ frames at 25/s of 64x\d+", fault)
    tiny_stimuli.encode(first, "color=gray:size=64x104:rate=20")
    (fault,) = check_study(settings, made["slug"])["faults"].values()
    assert re.fullmatch(r"it has \d+ frames at 20/s .* its player expects \d+ frames at 25/s .*", fault)
    monkeypatch.undo()
    first.unlink()
    assert list(check_study(settings, made["slug"])["faults"].values()) == ["the file is missing"]
    with pytest.raises(ValueError, match="there is no study 'nobodys'"):
        check_study(settings, "nobodys")


@pytest.mark.slow
def test_the_check_names_films_by_scene_and_conditions(folder: Path, tmp_path: Path) -> None:
    settings, told = Settings(data_dir=tmp_path / "study"), set[str]()
    options = parse_options({"optional_stages": ["practice"], "lighter_films": True})
    made = create_study(settings, folder, "Named", options=options)
    check_study(settings, made["slug"], progress=lambda what, _done, _total: told.add(what))
    assert {"decoding ball: id_fa and pm_fb", "decoding ball: id_fa and pm_fb (lighter)", "decoding practice"} <= told


@pytest.mark.slow
def test_damaged_films_are_made_again_exactly_as_they_were(folder: Path, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "server")
    slug = create_study(settings, folder, "Mended", options=parse_options({"repeated_pairs": 0}))["slug"]
    before = {path.name: path.read_bytes() for path in settings.media_dir.glob("*.mp4")}
    with open_store(settings) as database:
        with database.reading() as connection:
            study = study_named(connection, slug)
        with pytest.raises(InvalidError, match="as they were when the study was made"):
            mend_films(settings, database, study, no_progress)
        for name, content in before.items():
            (settings.media_dir / name).write_bytes(content[:-1] + b"x")
        assert len(mend_films(settings, database, study, no_progress)) == len(before)
        assert {path.name: path.read_bytes() for path in settings.media_dir.glob("*.mp4")} == before
        next(settings.media_dir.glob("*.mp4")).unlink()
        shutil.rmtree(folder)
        with pytest.raises(ConflictError, match="upload it again"):
            mend_films(settings, database, study, no_progress)
