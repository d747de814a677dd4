"""`validate films`: what it writes, and what it says of sets that cannot be compared."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pytest

from recon.render.encoding.video import read_luma
from recon.validation.films import evaluation, film
from recon.validation.films.evaluation import FilmSettings, measure_films
from recon.validation.films.film import MeasuredFilm
from recon.validation.films.kinds import KINDS
from recon.validation.films.tables import pooled_measures
from recon.validation.films.vmaf import vmaf_scores
from tests.command_line import Command
from tests.recon.validation.films.clips import N_FRAMES, blurred, disc, noisy, write_film, write_set

pytestmark = pytest.mark.slow

FRAMES, MASKS = disc()
WHOLE = ("psnr_y", "ssim", "ms_ssim", "vmaf")
ACTOR = ("psnr_y_actor", "ssim_actor", "ms_ssim_actor")
Measured = tuple[dict[str, Any], list[MeasuredFilm]]


@pytest.fixture(scope="module")
def stimuli(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A set of the disc: as it is, twice, blurred, and with noise."""
    films = {"truth": FRAMES, "same": FRAMES, "soft": blurred(FRAMES, 1), "noisy": noisy(FRAMES, 6)}
    named = {f"disc/{name}": frames for name, frames in films.items()}
    return write_set(tmp_path_factory.mktemp("films") / "set", named, MASKS)


@pytest.fixture(scope="module")
def measured(stimuli: Path) -> Measured:
    """What the set of the disc measures."""
    return measure_films(stimuli, FilmSettings("truth"))


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "measures.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def means(report: dict[str, Any]) -> dict[tuple[str, str], float]:
    return {(row["approach"], row["measure"]): row["mean"] for row in report["films"]}


def test_a_report_has_every_measure_pooled_and_by_frame(command: Command, stimuli: Path, tmp_path: Path) -> None:
    told = command("validate", "films", stimuli, "--reference", "truth", "-o", tmp_path, "--json")
    assert told.code == 0, told.err
    assert json.loads(told.out)["kind"] == "films"
    rows = table(tmp_path)
    assert {row["approach"] for row in rows} == {"same", "soft", "noisy"}
    soft = [row for row in rows if row["approach"] == "soft"]
    pooled = {row["measure"]: float(row["value"]) for row in soft if not row["frame"]}
    assert pooled.keys() == {
        *(f"{name}{end}" for name in (*WHOLE, *ACTOR) for end in ("", "_harmonic", "_p5")),
        "flicker",
        "flicker_p95",
    }
    for name in (*WHOLE, *ACTOR, "flicker"):
        values = [float(row["value"]) for row in soft if row["measure"] == name and row["frame"]]
        assert len(values) == N_FRAMES - (name == "flicker")
        assert pooled[name] == pytest.approx(np.mean(values))
    assert {row["source"] for row in soft} == {"validate films, whole frame", "validate films, actor"}
    assert {row["measure"] for row in rows if row["better"] == "lower"} == {"flicker", "flicker_p95"}
    page = (tmp_path / "report.html").read_text()
    assert "soft: its worst frame" in page
    assert (tmp_path / "disc_frames.svg").exists()


def test_a_program_of_others_measures_each_film_once(command: Command, stimuli: Path, tmp_path: Path) -> None:
    count = "import os, sys; print('ratio', os.path.getsize(sys.argv[2]) / os.path.getsize(sys.argv[1]))"
    (tmp_path / "ratio.py").write_text(count)
    (tmp_path / "methods.toml").write_text(
        f"[film.ratio]\nbetter = 'lower'\n"
        f"command = '{sys.executable} {{folder}}/ratio.py {{reference}} {{distorted}}'\n"
    )
    options = ("--methods", tmp_path / "methods.toml", "--every", len(FRAMES))
    told = command("validate", "films", stimuli, "--reference", "truth", "-o", tmp_path / "report", *options)
    assert told.code == 0, told.err
    ratios = {row["approach"]: row for row in table(tmp_path / "report") if row["measure"] == "ratio"}
    sizes = {name: (stimuli / f"disc/{name}.mp4").stat().st_size for name in (*ratios, "truth")}
    assert {name: float(row["value"]) for name, row in ratios.items()} == {
        name: sizes[name] / sizes["truth"] for name in ("same", "soft", "noisy")
    }
    assert {(row["better"], row["frame"]) for row in ratios.values()} == {("lower", "")}
    assert ">ratio<" in (tmp_path / "report/report.html").read_text()


def test_equal_films_are_best_and_every_measure_sees_noise(measured: Measured) -> None:
    report, _ = measured
    values = means(report)
    assert values["same", "psnr_y"] is None, "infinite"
    assert [values["same", name] for name in ("ssim", "ms_ssim", "ssim_actor", "flicker")] == [1, 1, 1, 0]
    for name in ("ssim", "ms_ssim", "vmaf", *ACTOR[1:]):
        assert values["same", name] > values["noisy", name]
    assert values["noisy", "flicker"] > 10 * values["soft", "flicker"]
    (remark,) = report["remarks"]
    told = f"disc/same: {N_FRAMES} frames equal the reference's; their PSNR is infinite, and so is its mean"
    assert remark == told, "the harmonic mean is infinite, too"
    assert {row["measure"] for row in report["measures"] if row["approach"] == "soft"} == {*WHOLE, *ACTOR, "flicker"}


def test_psnr_is_what_ffmpeg_computes(stimuli: Path, measured: Measured, tmp_path: Path) -> None:
    noisy_film = next(film for film in measured[1] if film.pair.film.approach == "noisy")
    inputs = [part for name in ("noisy", "truth") for part in ("-i", str(stimuli / f"disc/{name}.mp4"))]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *inputs, "-lavfi", "psnr=stats_file=psnr.log"]
    subprocess.run([*command, "-f", "null", "-"], check=True, cwd=tmp_path, stdin=subprocess.DEVNULL)
    expected = [float(psnr) for psnr in re.findall(r"psnr_y:(\S+)", (tmp_path / "psnr.log").read_text())]
    assert noisy_film.values["psnr_y"] == pytest.approx(expected, abs=0.006), "the log has two digits"


def test_vmaf_is_near_100_for_an_equal_film_and_falls_with_blur(stimuli: Path, tmp_path: Path) -> None:
    truth = stimuli / "disc/truth.mp4"
    blurs = [write_film(tmp_path / f"{sigma}.mp4", blurred(FRAMES, sigma)) for sigma in (0.7, 1.2, 2.5)]
    scores = [np.mean(vmaf_scores(path, truth)) for path in (stimuli / "disc/same.mp4", *blurs)]
    assert scores[0] > 95
    assert (np.diff(scores) < 0).all()
    assert vmaf_scores(blurs[0], truth, threads=2) == vmaf_scores(blurs[0], truth)


def test_a_film_of_full_range_is_compared_by_what_it_shows(tmp_path: Path) -> None:
    stimuli = write_set(tmp_path / "set", {"disc/truth": FRAMES, "disc/phone": FRAMES})
    film, full = stimuli / "disc/phone.mp4", tmp_path / "full.mp4"
    ranges = ["-vf", "scale=in_range=tv:out_range=pc,format=yuvj420p", "-color_range", "pc", "-crf", "4"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(film), *ranges, str(full)]
    subprocess.run(command, check=True, stdin=subprocess.DEVNULL)
    full.replace(film)
    (measured,) = measure_films(stimuli, FilmSettings("truth"))[1]
    assert min(measured.values["psnr_y"]) > 45  # 28 where 0 to 255 are taken for 16 to 235
    assert min(measured.values["vmaf"]) > 95
    assert np.nanmax(measured.values["flicker"]) < 0.3


def test_films_without_masks_are_measured_whole_and_it_is_said(command: Command, tmp_path: Path) -> None:
    stimuli = write_set(tmp_path / "set", {"disc/truth": FRAMES, "disc/soft": blurred(FRAMES, 1)})
    told = command("validate", "films", stimuli, "--reference", "truth", "-o", tmp_path / "report")
    assert "remark: disc: disc/truth, disc/soft have no mask of the model" in told.out
    rows = table(tmp_path / "report")
    assert not [row for row in rows if "actor" in row["measure"]]
    assert {row["source"] for row in rows if row["measure"] == "flicker"} == {"validate films, whole frame"}


def test_without_libvmaf_the_other_measures_go_on(stimuli: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (evaluation, film):
        monkeypatch.setattr(module, "has_vmaf", lambda: False)
    report, _ = measure_films(stimuli, FilmSettings("truth"))
    assert "no filter libvmaf" in report["remarks"][0]
    assert {row["measure"] for row in report["films"]} == {*WHOLE, *ACTOR, "flicker"} - {"vmaf"}


def test_some_frames_have_the_values_that_all_give_them(stimuli: Path, measured: Measured) -> None:
    _, all_frames = measured
    _, some = measure_films(stimuli, FilmSettings("truth", every=2))
    for few, every in zip(some, all_frames, strict=True):
        assert few.frames == [0, 2, 4]
        for name, values in few.values.items():
            np.testing.assert_allclose(values, every.values[name][::2], rtol=1e-9, err_msg=name)


@pytest.mark.slow
def test_several_processes_measure_the_same(stimuli: Path, measured: Measured) -> None:
    alone, _ = measured
    told: list[int] = []
    shared, _ = measure_films(stimuli, FilmSettings("truth", workers=2), lambda _what, done, _total: told.append(done))
    assert shared == alone
    assert told == [0, 6, 12, 18]


def test_scenes_that_cannot_be_compared_are_named(tmp_path: Path) -> None:
    films = {"a/truth": FRAMES, "a/soft": blurred(FRAMES, 1), "b/soft": FRAMES, "c/truth": FRAMES}
    report, _ = measure_films(write_set(tmp_path, films), FilmSettings("truth"))
    assert {row["dataset"] for row in report["films"]} == {"a"}
    assert "b: has no film of the reference truth, only of soft: not measured" in report["remarks"]
    assert "c: has no other film than the reference truth: not measured" in report["remarks"]


@pytest.mark.parametrize(
    ("films", "message"),
    [
        ({"a/pm": FRAMES, "a/dr": FRAMES}, r"no film is of the reference 'truth'; the set's conditions are pm, dr"),
        ({"a/truth": FRAMES}, r"nothing to compare with 'truth': a: has no other film"),
        (
            {"a/truth": FRAMES, "a/pm": FRAMES[:4]},
            r"a/pm.mp4 is 192x176, 4 frames at 25 a second, but the reference .*a/truth.mp4 is 192x176, 6 frames",
        ),
        (
            {"a/truth": FRAMES, "a/pm": [np.ascontiguousarray(frame[:, :96]) for frame in FRAMES]},
            r"a/pm.mp4 is 96x176, 6 frames.*a/truth.mp4 is 192x176",
        ),
    ],
)
def test_a_set_that_cannot_be_compared_is_refused(tmp_path: Path, films: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        measure_films(write_set(tmp_path, films), FilmSettings("truth"))


def test_films_of_another_rate_are_refused(tmp_path: Path) -> None:
    write_set(tmp_path, {"a/truth": FRAMES, "a/pm": FRAMES})
    write_film(tmp_path / "a/pm.mp4", FRAMES, fps=30)
    with pytest.raises(ValueError, match=r"a/pm.mp4 is .* at 30 a second.*truth.mp4 is .* at 25 a second"):
        measure_films(tmp_path, FilmSettings("truth"))


def test_a_corrupt_film_is_named(command: Command, tmp_path: Path) -> None:
    write_set(tmp_path, {"a/truth": FRAMES, "a/pm": noisy(FRAMES, 20)})
    content = bytearray((tmp_path / "a/pm.mp4").read_bytes())
    middle = content.index(b"mdat") + 2000
    content[middle : middle + 3000] = bytes(3000)
    (tmp_path / "a/pm.mp4").write_bytes(content)
    told = command("validate", "films", tmp_path, "--reference", "truth", "-o", tmp_path / "report")
    assert told.code == 1
    assert "a/pm.mp4" in told.err
    assert not (tmp_path / "report").exists()


def test_a_manifest_that_is_none_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"manifest.json: there is no such file"):
        measure_films(tmp_path, FilmSettings("truth"))
    (tmp_path / "manifest.json").write_text('{"stimuli": [{"dataset": "a", "approach": 3}]}')
    with pytest.raises(ValueError, match=r"stimuli\[0\].approach is 3, expected a text"):
        measure_films(tmp_path, FilmSettings("truth"))


def test_masters_are_measured_where_asked_for(tmp_path: Path) -> None:
    write_set(tmp_path, {"a/truth": FRAMES, "a/pm": FRAMES})
    with pytest.raises(ValueError, match=r"a/truth has no master; measure the videos"):
        measure_films(tmp_path, FilmSettings("truth", masters=True))
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    for entry in manifest["stimuli"]:
        entry["master"] = f"{entry['approach']}.master.mp4"
        write_film(tmp_path / entry["master"], noisy(FRAMES, 5) if entry["approach"] == "pm" else FRAMES)
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    assert means(measure_films(tmp_path, FilmSettings("truth"))[0])["pm", "ssim"] == pytest.approx(1)
    assert means(measure_films(tmp_path, FilmSettings("truth", masters=True))[0])["pm", "ssim"] < 0.95


def test_frames_are_pooled_by_mean_harmonic_mean_and_worst_percentile() -> None:
    values = [0.0, *[1.0] * 9, *[3.0] * 30]
    pooled = pooled_measures(values, "vmaf", KINDS["vmaf"])
    assert pooled["vmaf"] == pytest.approx(np.mean(values))
    assert pooled["vmaf_harmonic"] == pytest.approx(40 / (1 + 9 / 2 + 30 / 4) - 1)
    assert pooled["vmaf_p5"] == 1.0
    assert pooled_measures([np.nan, *values], "flicker", KINDS["flicker"]) == {
        "flicker": pytest.approx(np.mean(values)),
        "flicker_p95": 3.0,
    }
    assert pooled_measures([np.nan], "vmaf", KINDS["vmaf"]) == {}
    assert pooled_measures([np.inf, np.inf], "psnr_y", KINDS["psnr_y"]) == dict.fromkeys(
        ("psnr_y", "psnr_y_harmonic", "psnr_y_p5"), np.inf
    )


def test_frames_that_show_nothing_of_the_actor_count_for_the_whole_frame_only(tmp_path: Path) -> None:
    masks = [np.zeros_like(MASKS[0]), *MASKS[1:]]
    write_set(tmp_path, {"a/truth": FRAMES, "a/pm": noisy(FRAMES, 5)}, masks)
    report, _ = measure_films(tmp_path, FilmSettings("truth"))
    n_frames = {row["measure"]: row["n_frames"] for row in report["films"]}
    assert (n_frames["ssim"], n_frames["ssim_actor"]) == (N_FRAMES, N_FRAMES - 1)
    assert next(read_luma(tmp_path / "a/pm.mask.mp4")).max() == 16
