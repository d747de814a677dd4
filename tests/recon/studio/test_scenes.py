"""The synthetic studio: whole captures with a truth that agrees with the pictures."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from recon.capture.format import read_capture, read_frame, read_plates
from recon.studio import SCENES, SynthParameters, synthesise
from recon.studio.truth import read_depth

TINY = (96, 72)


def digest(folder: Path) -> str:
    content = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            content.update(path.relative_to(folder).as_posix().encode() + path.read_bytes())
    return content.hexdigest()


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_becomes_a_capture_that_can_be_read_back(scene: str, tmp_path: Path) -> None:
    synthesise(tmp_path / "out", SynthParameters(scene, n_sensors=2, n_frames=2, size=TINY))
    capture = read_capture(tmp_path / "out")
    assert (capture.name, capture.n_frames, len(capture.sensors)) == (scene, 2, 2)
    left, right = read_frame(capture, "S2", 1)
    assert left.shape == right.shape == (72, 96, 3)
    plates = read_plates(capture, "S1")
    assert plates is not None
    actor = np.isfinite(read_depth(capture, "S1", "left", 0))
    difference = np.abs(read_frame(capture, "S1", 0)[0].astype(int) - plates[0]).max(axis=2)
    assert difference[actor].mean() > 5 * difference[~actor].mean()


@pytest.mark.slow
def test_the_same_seed_makes_the_same_bytes_and_another_seed_others(tmp_path: Path) -> None:
    for name, seed in (("a", 5), ("b", 5), ("c", 6)):
        synthesise(tmp_path / name, SynthParameters("sphere", n_sensors=1, n_frames=2, size=TINY, seed=seed))
    assert digest(tmp_path / "a") == digest(tmp_path / "b") != digest(tmp_path / "c")


@pytest.mark.slow
def test_points_of_the_sphere_lie_on_the_sphere(tmp_path: Path) -> None:
    position = (60.0, -40.0, 110.0)
    parameters = SynthParameters("sphere", n_sensors=2, n_frames=1, size=(320, 240), noise=0, position=position)
    capture = synthesise(tmp_path / "out", parameters)
    middle = capture.bounds.mean(axis=0)
    for stream in capture.sensors:
        for side, camera in (("left", stream.left.camera), ("right", stream.right.camera)):
            depth = read_depth(capture, stream.id, side, 0)
            rows, columns = np.nonzero(np.isfinite(depth))
            rays = np.stack([columns, rows, np.ones(len(rows))]) * depth[rows, columns]
            points = camera.rotation.T @ np.linalg.inv(camera.K) @ rays + camera.centre[:, None]
            radii = np.linalg.norm(points.T - middle, axis=1)
            assert len(radii) > 2000
            assert np.abs(radii - 150.0).max() < 0.1


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"scene": "opera"}, "opera"),
        ({"n_frames": 0}, "n_frames is 0"),
        ({"n_sensors": 0}, "n_sensors is 0"),
        ({"size": (20, 400)}, "20x400"),
        ({"noise": -1.0}, "noise is -1"),
        ({"noise": float("nan")}, "noise is nan"),
        ({"fps": 0.0}, "fps is 0"),
        ({"seed": -3}, "seed is -3"),
        ({"scene": "sphere", "position": (0.0, 900.0, 0.0)}, "900"),
        ({"scene": "ball", "position": (10.0, 0.0, 0.0)}, "position is for"),
    ],
)
def test_bad_parameters_are_named(changes: dict[str, object], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        SynthParameters(**changes)  # type: ignore[arg-type]


@pytest.mark.slow
def test_a_wide_spread_of_exposures_leaves_every_camera_some_light(tmp_path: Path) -> None:
    parameters = SynthParameters(scene="standing", n_frames=1, size=(64, 48), exposure_spread=2.0)
    capture = synthesise(tmp_path / "studio", parameters)
    for stream in capture.sensors:
        plates = read_plates(capture, stream.id)
        assert plates is not None
        for picture, plate in zip(read_frame(capture, stream.id, 0), plates, strict=True):
            assert plate.mean() > 2
            assert picture.mean() - plate.mean() < 40


def test_a_folder_that_is_not_empty_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(ValueError, match="exists already"):
        synthesise(tmp_path, SynthParameters("sphere", n_sensors=1, n_frames=1, size=TINY))
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
