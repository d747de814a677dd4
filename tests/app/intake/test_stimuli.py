"""What makes a stimulus set acceptable, and what a pair's video holds."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest

from app.errors import StimuliError
from app.ffmpeg import decode
from app.films.pairs import FilmMaker, prepare_pairs
from app.films.strips import GUARD_ROWS, check_strip
from app.intake.stimuli import StimulusSet, read_stimulus_set
from tests.app import tiny_stimuli
from tests.app.tiny_stimuli import frames

Spoil = Callable[[Path, list[dict[str, Any]]], None]


@pytest.fixture
def folder(stimulus_set: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(stimulus_set.parent, tmp_path / "set"))


def entries(folder: Path) -> list[dict[str, Any]]:
    return [
        tiny_stimuli.stimulus(folder, dataset, a) for dataset in ("ball", "box") for a in ("id_fa", "id_fb", "pm_fb")
    ]


def test_a_set_is_read_from_its_folder_or_its_manifest(folder: Path) -> None:
    by_folder, by_manifest = read_stimulus_set(folder), read_stimulus_set(folder / "manifest.json")
    assert by_folder == by_manifest
    assert by_folder.datasets == ("ball", "box")
    assert by_folder.conditions == ("id_fa", "id_fb", "pm_fb")


@pytest.mark.slow
def test_progress_is_told_to_the_end(folder: Path, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    stimulus_set = read_stimulus_set(folder, lambda _, done, total: told.append((done, total)))
    assert told == [(done, 6) for done in range(7)]
    told.clear()
    maker = FilmMaker(tmp_path / "pairs", progress=lambda _, done, total: told.append((done, total)))
    prepare_pairs(stimulus_set, maker)
    assert told == [(done, 6) for done in range(7)]


def missing(folder: Path, stimuli: list[dict[str, Any]]) -> None:
    (folder / stimuli[0]["video"]).unlink()


def changed(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
    stimuli[1]["sha256"] = "0" * 64


def undecodable(folder: Path, stimuli: list[dict[str, Any]]) -> None:
    (folder / stimuli[0]["video"]).write_bytes(b"this is no video at all" * 100)
    stimuli[0] |= tiny_stimuli.stimulus(folder, "ball", "id_fa")


def cut_short(folder: Path, stimuli: list[dict[str, Any]]) -> None:
    path = folder / stimuli[0]["video"]
    path.write_bytes(path.read_bytes()[:-200])
    stimuli[0] |= tiny_stimuli.stimulus(folder, "ball", "id_fa")


def not_as_long_as_it_says(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
    for one in stimuli:
        one["n_frames"] = 11


def slower_than_it_says(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
    for one in stimuli:
        one["fps"] = 24.0


def unlike_others(fact: str, value: float) -> Spoil:
    def spoil(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
        stimuli[2][fact] = value

    return spoil


def twice(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
    stimuli.append(stimuli[0])


def like_all_together(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
    for one in stimuli:
        one["dataset"] = "all"


def alone(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
    del stimuli[1:3]


def outside(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
    stimuli[0]["video"] = "../elsewhere.mp4"


def unknown_level(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
    stimuli[0]["levels"] = {"depth": "xy"}


def odd(_folder: Path, stimuli: list[dict[str, Any]]) -> None:
    for one in stimuli:
        one["height"] = 47


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (missing, r"ball/id_fa\.mp4: the video of ball/id_fa is missing"),
        (changed, r"ball/id_fb\.mp4: its SHA-256 is [0-9a-f]{64}, the manifest says 0{64}"),
        (undecodable, r"ball/id_fa\.mp4: cannot be decoded"),
        (cut_short, r"ball/id_fa\.mp4: "),
        (not_as_long_as_it_says, r"\.mp4: n_frames is 10, the manifest says 11"),
        (slower_than_it_says, r"\.mp4: fps is 25, the manifest says 24"),
        (
            unlike_others("width", 66),
            r"manifest\.json: ball/pm_fb has .* of 66x48, the others of ball have .* of 64x48; ",
        ),
        (
            unlike_others("height", 50),
            r"manifest\.json: ball/pm_fb has .* of 64x50, the others of ball have .* of 64x48; ",
        ),
        (
            unlike_others("fps", 30.0),
            r"ball/pm_fb has 10 frames at 30/s of .*, the others of ball have 10 frames at 25/s",
        ),
        (
            unlike_others("n_frames", 9),
            r"ball/pm_fb has 9 frames at 25/s of .*, the others of ball have 10 frames at 25/s",
        ),
        (unlike_others("width", True), r"manifest\.json: stimuli\.2\.width is True, expected a whole number from 2"),
        (twice, r"manifest\.json: ball/id_fa is there twice"),
        (like_all_together, r"manifest\.json: a dataset is called 'all'"),
        (alone, r"manifest\.json: dataset ball has one stimulus, .*stimuli merge` joins it"),
        (outside, r"elsewhere\.mp4: ball/id_fa lies outside"),
        (unknown_level, r"ball/id_fa has depth = xy"),
        (odd, r"ball/id_fa is 64x47, expected even numbers"),
    ],
)
def test_a_set_that_is_not_right_is_refused_with_file_and_value(folder: Path, spoil: Spoil, complaint: str) -> None:
    stimuli = entries(folder)
    spoil(folder, stimuli)
    tiny_stimuli.write_manifest(folder, stimuli)
    with pytest.raises(StimuliError, match=complaint):
        read_stimulus_set(folder)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{", "not readable as JSON"),
        ("[]", r"the file is \[\], expected an object with keys"),
        ('{"schema_version": 2}', "schema_version"),
        (r'{"datasets": ["temple\u0000"]}', "datasets.1 holds a NUL character"),
        ("[" * 50_000 + "]" * 50_000, "too many lists within one another"),
    ],
)
def test_a_manifest_that_is_not_one_is_refused(tmp_path: Path, text: str, complaint: str) -> None:
    (tmp_path / "manifest.json").write_text(text, encoding="utf-8")
    with pytest.raises(StimuliError, match=complaint):
        read_stimulus_set(tmp_path)


def test_a_missing_manifest_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StimuliError, match=r"manifest\.json: there is no such file"):
        read_stimulus_set(tmp_path)


@pytest.fixture(scope="module")
def checked(stimulus_set: Path) -> StimulusSet:
    return read_stimulus_set(stimulus_set)


@pytest.fixture(scope="module")
def media_dir(checked: StimulusSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    media_dir = tmp_path_factory.mktemp("pairs")
    prepare_pairs(checked, FilmMaker(media_dir))
    return media_dir


@pytest.mark.slow
def test_a_pair_holds_both_stimuli_and_the_guard_band(checked: StimulusSet, media_dir: Path) -> None:
    for pair in prepare_pairs(checked, FilmMaker(media_dir)):
        found = frames(media_dir / pair.file)
        assert found.shape == (tiny_stimuli.N_FRAMES, 2 * tiny_stimuli.HEIGHT + GUARD_ROWS, tiny_stimuli.WIDTH)
        seam = tiny_stimuli.HEIGHT + GUARD_ROWS // 2
        for half, one in ((found[:, :seam], pair.top), (found[:, seam:], pair.bottom)):
            expected = frames(checked.folder / one.video)
            assert np.abs(half.astype(int) - int(expected[0, 0, 0])).max() <= 3  # lossy, but one flat grey


def test_the_guard_band_repeats_the_outermost_rows(tmp_path: Path) -> None:
    """A gradient's last row differs from its first: smearing the wrong one would show."""
    gradient = "gradients=size=64x48:rate=25:c0=black:c1=white:x0=0:y0=0:x1=0:y1=47:nb_colors=2:speed=0.00001"
    for approach in ("id_fa", "id_fb"):
        tiny_stimuli.encode(tmp_path / "ball" / f"{approach}.mp4", gradient)
    tiny_stimuli.write_manifest(tmp_path, [tiny_stimuli.stimulus(tmp_path, "ball", one) for one in ("id_fa", "id_fb")])
    (pair,) = prepare_pairs(read_stimulus_set(tmp_path), FilmMaker(tmp_path / "pairs"))
    rows = frames(tmp_path / "pairs" / pair.file)[0].mean(axis=1)
    half = GUARD_ROWS // 2
    assert np.abs(rows[48 : 48 + half] - rows[47]).max() <= 6
    assert np.abs(rows[48 + half : 48 + 2 * half] - rows[48 + 2 * half]).max() <= 6
    assert abs(rows[47] - rows[48 + 2 * half]) > 100


@pytest.mark.slow
def test_a_pair_is_h264_that_every_browser_plays_and_tells_nothing(checked: StimulusSet, media_dir: Path) -> None:
    for pair in prepare_pairs(checked, FilmMaker(media_dir)):
        path = media_dir / pair.file
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-i", str(path)]
        facts = subprocess.run(command, capture_output=True, text=True, check=False).stderr
        assert re.search(r"Video: h264 .*yuv420p\(tv, bt709[,)]", facts)
        content = path.read_bytes()
        assert content.index(b"moov") < content.index(b"mdat")  # it can play before it is whole
        for secret in (tiny_stimuli.TITLE, *checked.datasets, *checked.conditions):
            assert secret.encode() not in content


def test_a_pair_is_encoded_once_for_its_content(checked: StimulusSet, media_dir: Path) -> None:
    before = {path: path.stat().st_ino for path in media_dir.iterdir()}
    told: list[int] = []
    prepare_pairs(checked, FilmMaker(media_dir, progress=lambda _, __, total: told.append(total)))
    assert told == [0]
    assert {path: path.stat().st_ino for path in media_dir.iterdir()} == before
    assert len(before) == 6


def test_a_set_that_breaks_while_pairs_are_made_leaves_nothing_half_written(folder: Path, tmp_path: Path) -> None:
    checked = read_stimulus_set(folder)
    for video in folder.rglob("pm_fb.mp4"):
        video.write_bytes(b"broken")
    with pytest.raises(StimuliError, match="cannot be decoded as a video: it is cut off"):
        prepare_pairs(checked, FilmMaker(tmp_path / "pairs"))
    assert not list((tmp_path / "pairs").glob("*part*"))


def test_a_master_is_what_pairs_are_made_from(folder: Path, tmp_path: Path) -> None:
    for approach in ("id_fa", "id_fb"):
        tiny_stimuli.encode(
            folder / "ball" / f"{approach}.mkv", tiny_stimuli.flat("white"), "-c:v", "ffv1", "-pix_fmt", "bgr0"
        )
    stimuli = [tiny_stimuli.stimulus(folder, "ball", a) | {"master": f"ball/{a}.mkv"} for a in ("id_fa", "id_fb")]
    tiny_stimuli.write_manifest(folder, stimuli)
    (pair,) = prepare_pairs(read_stimulus_set(folder), FilmMaker(tmp_path / "pairs"))
    assert frames(tmp_path / "pairs" / pair.file).min() >= 252  # white, while the videos are grey


@pytest.mark.slow
@pytest.mark.parametrize("codec", ["vp9", "av1"])
def test_a_second_codec_holds_the_same_frames(checked: StimulusSet, media_dir: Path, codec: str) -> None:
    for pair in prepare_pairs(
        replace(checked, stimuli=checked.of_dataset("ball")), FilmMaker(media_dir, second_codec=codec)
    ):
        assert pair.second is not None
        assert pair.second.codec == codec
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-i", str(media_dir / pair.second.file)]
        assert f"Video: {codec}" in subprocess.run(command, capture_output=True, text=True, check=False).stderr
        found, first = (frames(media_dir / name).astype(int) for name in (pair.second.file, pair.file))
        assert np.abs(found - first).max() <= 6


def test_a_lighter_film_holds_the_same_frames_in_fewer_bytes(checked: StimulusSet, media_dir: Path) -> None:
    (pair,) = prepare_pairs(
        replace(checked, stimuli=checked.of_dataset("ball")[:2]), FilmMaker(media_dir, has_lighter=True)
    )
    assert pair.lighter is not None
    whole, lighter = media_dir / pair.file, media_dir / pair.lighter.file
    assert decode(lighter) == decode(whole)
    assert lighter.stat().st_size < whole.stat().st_size
    assert [film.file for film in pair.films] == [pair.file, pair.lighter.file]
    assert pair.second is None


def test_a_strip_that_is_not_its_source_is_found(checked: StimulusSet, media_dir: Path) -> None:
    (pair, *_) = prepare_pairs(checked, FilmMaker(media_dir))
    film, top = media_dir / pair.file, pair.top
    check_strip(film, 0, top, checked.source(top), "film")
    with pytest.raises(StimuliError, match=r"film: frame 0 differs from .* \(PSNR \d+\.\d dB, expected at least 25\)"):
        check_strip(film, 0, top, checked.source(pair.bottom), "film")
