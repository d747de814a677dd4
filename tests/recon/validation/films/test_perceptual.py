"""Measures by other packages: what the display is, what is missing, and how their values are pooled."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from recon.render.encoding.video import write_video
from recon.validation.films.perceptual import Display, check_measures, parse_display, perceptual_values
from recon.validation.films.stimuli import Film, Pair, probe_video
from recon.validation.films.tables import pooled_measures


def test_a_display_is_read_in_the_units_of_the_lab_sheet() -> None:
    assert parse_display("3840x2160,27,70,350") == Display((3840, 2160), 27, 70, 350)
    assert Display().pixels_per_degree == pytest.approx(37.84, abs=0.01)  # as ColorVideoVDP's standard_fhd
    assert Display(distance_cm=120).pixels_per_degree == pytest.approx(2 * Display().pixels_per_degree, rel=1e-3)


@pytest.mark.parametrize("text", ["", "24,60,200", "1920x1080,24,60", "1920x1080,24,60,nan", "0x1080,24,60,200"])
def test_a_display_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="the display is"):
        parse_display(text)


def test_a_measure_without_its_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(ValueError, match="flip needs a package that is not installed: pip install flip-evaluator"):
        check_measures(["flip"])
    with pytest.raises(ValueError, match="there is no measure 'lpips'; expected one or more of flip, cvvdp"):
        check_measures(["lpips"])


def test_a_measure_of_whole_films_has_one_value() -> None:
    assert pooled_measures([7.5, np.nan, np.nan], "cvvdp") == {"cvvdp": 7.5}
    assert set(pooled_measures([0.1, 0.2], "flip")) == {"flip", "flip_p95"}


def test_flip_is_nothing_for_equal_films_and_grows_with_their_difference(tmp_path: Path) -> None:
    pytest.importorskip("flip_evaluator")
    rng = np.random.default_rng(0)
    frames = [rng.integers(60, 180, (48, 64, 3), np.uint8) for _ in range(2)]
    films = {}
    for name, added in (("same", 0), ("near", 10), ("far", 60)):
        write_video(tmp_path / f"{name}.mp4", [frame + np.uint8(added) for frame in frames], size=(64, 48), fps=2)
        films[name] = Film("ball", name, tmp_path / f"{name}.mp4", None)
    means = [
        np.mean(
            perceptual_values(
                Pair(films[name], films["same"], probe_video(films[name].video), False), "flip", Display(), every=1
            )
        )
        for name in films
    ]
    assert means[0] == 0
    assert 0 < means[1] < means[2] < 1
