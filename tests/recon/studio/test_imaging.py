"""What is imperfect in the studio's pictures on request, against what light and time must give."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.capture.format import read_capture, read_frame
from recon.geometry.rig import Camera, look_at
from recon.studio import SynthParameters, synthesise
from recon.studio.imaging import READOUT_MS, Imaging, averaged, defocused, rolled
from recon.studio.stage import Staged

CAMERA = Camera(np.array([[400.0, 0, 99.5], [0, 400.0, 49.5], [0, 0, 1]]), (200, 100), look_at((0, 0, 2000), (0, 0, 0)))


def moved(x: float) -> Staged:
    """Stand points along a vertical line at `x` mm."""
    vertices = np.column_stack([np.full(9, x), np.linspace(-200, 200, 9), np.zeros(9)])
    return Staged(np.zeros((9, 11), np.float32), vertices, np.zeros((1, 32)))


def test_the_rows_of_a_rolling_shutter_lean_what_moves_by_its_speed_and_the_readout() -> None:
    leaning = rolled(CAMERA, [moved(-30.0), moved(0.0), moved(30.0)])
    rows = CAMERA.project(leaning.vertices)[:, 1]
    assert leaning.vertices[:, 0] == pytest.approx(30.0 * (rows / 49.5 - 1.0), abs=1e-6)
    assert Imaging(rolling_shutter=True).readout(25.0) == pytest.approx(READOUT_MS / 40.0)


def test_instants_of_an_open_shutter_are_even_symmetric_and_as_dense_as_the_motion_needs() -> None:
    offsets = Imaging(shutter_ms=20.0).offsets(25.0, speed_px=12.0)
    assert len(offsets) == 5
    assert np.diff(offsets) == pytest.approx(0.1)
    assert sum(offsets) == pytest.approx(0.0)
    assert Imaging().offsets(25.0, speed_px=12.0) == [0.0]


def test_averaging_and_defocus_lose_no_light() -> None:
    rng = np.random.default_rng(0)
    windows = [(rng.random((6, 5, 4), np.float32), 20 + k, 30) for k in range(3)]
    for window in (averaged(windows), defocused(windows[0], 1.5, (80, 90))):
        pixels, _, _ = window
        given = windows if pixels.shape[1] == 7 else windows[:1]
        light = np.mean([(part[..., :3] * part[..., 3:]).sum(axis=(0, 1)) for part, _, _ in given], axis=0)
        assert (pixels[..., :3] * pixels[..., 3:]).sum(axis=(0, 1)) == pytest.approx(light, rel=1e-4)


def test_defocus_at_the_edge_of_the_picture_stays_inside_it() -> None:
    pixels, column, row = defocused((np.ones((6, 5, 4), np.float32), 0, 94), 2.0, (200, 100))
    assert (column, row) == (0, 86)
    assert pixels.shape[:2] == (14, 13)


def test_corners_lack_the_share_of_light_that_vignetting_says() -> None:
    dimming = Imaging(vignetting=0.4).dimming((201, 101), 0.0, 25.0)
    assert dimming is not None
    assert dimming[50, 100] == pytest.approx(1.0)
    assert dimming[[0, 0, -1, -1], [0, -1, 0, -1]] == pytest.approx(0.6)
    assert Imaging().dimming((201, 101), 0.0, 25.0) is None


def test_flicker_changes_from_frame_to_frame_and_fades_in_a_long_exposure() -> None:
    def spread(imaging: Imaging) -> float:
        levels = [imaging.dimming((9, 9), frame / 25.0, 25.0) for frame in range(50)]
        return float(np.std([level.mean() for level in levels if level is not None]))

    assert spread(Imaging(flicker=0.2)) == pytest.approx(0.2 / np.sqrt(2), rel=0.1)
    assert spread(Imaging(flicker=0.2, shutter_ms=17.1)) < 0.01


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"shutter_ms": 50.0}, "shutter_ms is 50.*expected 0 to 40"),
        ({"vignetting": 1.0}, "vignetting is 1.0"),
        ({"compression": 0}, "compression is 0"),
        ({"gloss": float("nan")}, "gloss is nan"),
        ({"defocus": (("S9", 1.0),)}, "defocus is S9=1"),
    ],
)
def test_values_that_cannot_be_are_named(changes: dict[str, object], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        SynthParameters(**changes)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_recording_with_everything_at_once_is_read_back_and_looks_the_worse_for_it(tmp_path: Path) -> None:
    size = (192, 144)
    worse = SynthParameters(
        "standing", 2, 2, size, noise=0.0, exposure_spread=0.0, shutter_ms=20.0, rolling_shutter=True, colour_cast=0.1,
        vignetting=0.4, flicker=0.2, compression=40, defocus=(("S2", 1.5),), gloss=4.0,
    )  # fmt: skip
    synthesise(tmp_path / "worse", worse)
    synthesise(tmp_path / "good", SynthParameters("standing", 2, 2, size, noise=0.0, exposure_spread=0.0))
    good, bad = read_capture(tmp_path / "good"), read_capture(tmp_path / "worse")
    assert bad.sensors[0].left.image.endswith(".jpg")
    for sensor, most in (("S1", 1.0), ("S2", 0.7)):
        sharpness = [cv2.Laplacian(read_frame(of, sensor, 0)[0], cv2.CV_64F).std() for of in (bad, good)]
        assert sharpness[0] < most * sharpness[1]
    corner, middle = (np.s_[:10, :10], np.s_[60:80, 10:30])
    before, after = (read_frame(of, "S1", 0)[0].astype(float) for of in (good, bad))
    assert (after[corner] / before[corner]).mean() < 0.9 * (after[middle] / before[middle]).mean()
