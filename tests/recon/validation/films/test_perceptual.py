"""Measures by other packages: what the display is, what is missing, and how their values are pooled."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from recon.render.encoding.video import write_video
from recon.validation.films.kinds import KINDS
from recon.validation.films.perceptual import NETWORKS, Display, Perceptual, parse_display, parse_weights
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
    with pytest.raises(
        ValueError, match=r"flip needs .*pip install 'reconstudy\[perceptual\]', or of that only flip-evaluator"
    ):
        Perceptual(("flip",)).check()
    with pytest.raises(
        ValueError, match="there is no measure 'vif'; expected one or more of flip, cvvdp, lpips, dists"
    ):
        Perceptual(("vif",)).check()


def test_a_measure_without_its_weights_says_which_file_is_meant(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: True)
    with pytest.raises(ValueError, match=r"dists needs the weights of vgg16.*--weights dists=FILE.*vgg16-397923af.pth"):
        Perceptual(("dists",)).check()
    (tmp_path / "a.pth").touch()
    weights = parse_weights([f"dists={tmp_path / 'a.pth'}"])
    assert weights == {"dists": tmp_path / "a.pth"}
    Perceptual(("dists",), weights=weights).check()
    for wrong in ("dists=absent.pth", f"flip={tmp_path / 'a.pth'}", "dists"):
        with pytest.raises(ValueError, match="expected lpips or dists, = and a file that exists"):
            parse_weights([wrong])


def test_a_measure_of_whole_films_has_one_value() -> None:
    assert pooled_measures([7.5, np.nan, np.nan], "cvvdp", KINDS["cvvdp"]) == {"cvvdp": 7.5}
    assert set(pooled_measures([0.1, 0.2], "flip", KINDS["flip"])) == {"flip", "flip_p95"}


@pytest.mark.slow
@pytest.mark.parametrize("name", NETWORKS)
def test_deep_features_are_nothing_for_equal_films_and_grow_with_their_difference(name: str, tmp_path: Path) -> None:
    pytest.importorskip("torchmetrics")
    torchvision, torch = pytest.importorskip("torchvision"), pytest.importorskip("torch")
    torch.manual_seed(0)
    network, file = NETWORKS[name]
    torch.save(getattr(torchvision.models, network)().state_dict(), tmp_path / file)  # features of a random network
    same, near, far = _film_means(Perceptual((name,), weights={name: tmp_path / file}), tmp_path)
    assert same == pytest.approx(0, abs=1e-6)
    assert same < near < far
    (tmp_path / file).write_text("no weights")
    with pytest.raises(ValueError, match=f"holds no weights of {network}; expected torchvision's file"):
        _film_means(Perceptual((name,), weights={name: tmp_path / file}), tmp_path)


def test_flip_is_nothing_for_equal_films_and_grows_with_their_difference(tmp_path: Path) -> None:
    pytest.importorskip("flip_evaluator")
    same, near, far = _film_means(Perceptual(("flip",)), tmp_path)
    assert same == 0
    assert 0 < near < far < 1


def _film_means(perceptual: Perceptual, folder: Path) -> list[float]:
    """Measure equal, near and far films."""
    rng = np.random.default_rng(0)
    frames = [rng.integers(60, 180, (72, 96, 3), np.uint8) for _ in range(2)]
    films = {}
    for name, added in (("same", 0), ("near", 10), ("far", 60)):
        write_video(folder / f"{name}.mp4", [frame + np.uint8(added) for frame in frames], size=(96, 72), fps=2)
        films[name] = Film("ball", name, folder / f"{name}.mp4", None)
    return [
        float(
            np.mean(
                perceptual.values(
                    Pair(film, films["same"], probe_video(film.video), False), perceptual.names[0], every=1
                )
            )
        )
        for film in films.values()
    ]
