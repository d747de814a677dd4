"""Names of files in capitals, as cameras and disks of Windows give them, are the names that a format has."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from recon.capture.format import read_capture
from recon.capture.importing.formats import AUTO, find_format, import_recording
from recon.capture.importing.opencv import write_calibration
from recon.capture.importing.sources import ImportOptions
from tests.recon.capture.importing.calibrations import test_calibrations as calibrations
from tests.recon.capture.importing.depth_cameras import test_sequences as sequences
from tests.recon.capture.importing.labelled_recording import BOUNDS, RIG, colmap_model, described, record, write_picture
from tests.recon.capture.importing.test_middlebury import PAIRS, ring
from tests.recon.capture.importing.test_structure_from_motion import (
    CAMERAS,
    nerfstudio_source,
    scene,
    transforms,
    write_pictures,
)


def opencv(folder: Path) -> None:
    record(folder)
    write_calibration(folder / "calibration.yml", RIG)


def json_file(folder: Path) -> None:
    record(folder)
    path = described(folder)
    content = json.loads(path.read_text())
    content["sensors"][0]["left"]["image"] = [f"S1/left/{number}.png" for number in (9, 10)]
    for side in ("left", "right"):
        content["sensors"][0][side]["plate"] = f"S1/{side}/plate.png"
    path.write_text(json.dumps(content))


def json_of_patterns(folder: Path) -> None:
    record(folder)
    path = described(folder)
    content = json.loads(path.read_text())
    for name in ("S1", "S2"):
        for side in ("left", "right"):
            for frame in (0, 1):
                (folder / name / side / f"{frame + 9}.png").rename(folder / name / side / f"{frame:04d}.png")
            content["sensors"][name == "S2"][side]["image"] = f"{name}/{side}/{{frame:04d}}.png"
    path.write_text(json.dumps(content))


def colmap(folder: Path) -> None:
    colmap_model(folder)
    for name in ("S1_left", "S1_right", "S2_left", "S2_right"):
        write_picture(folder / f"masks/{name}.png", 255)


def nerfstudio(folder: Path) -> None:
    content = transforms(CAMERAS, np.eye(3), 1000.0)
    for number, frame in enumerate(content["frames"], start=1):
        frame["mask_path"] = f"masks/{number}.png"
        write_picture(folder / f"masks/{number}.png", 255)
    nerfstudio_source(folder, content)


def meshroom(folder: Path) -> None:
    write_pictures(folder / "images")
    (folder / "cameras.sfm").write_text(json.dumps(scene(CAMERAS, "1.2.11")))


def in_capitals(folder: Path) -> None:
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rename(path.with_name(path.name.upper()))


@pytest.mark.parametrize(
    ("name", "write", "pairs"),
    [
        ("middlebury", ring, PAIRS),
        ("middlebury-pair", calibrations.middlebury_pair, None),
        ("kitti", calibrations.kitti_odometry, None),
        ("kitti", calibrations.kitti_raw, None),
        ("euroc", calibrations.euroc, None),
        ("kalibr", calibrations.kalibr, None),
        ("ros", calibrations.ros, None),
        ("matlab", calibrations.matlab, None),
        ("strecha", calibrations.strecha, [(0, 1)]),
        ("mvsnet", calibrations.mvsnet, [(0, 1)]),
        ("miv", calibrations.miv, [(0, 1)]),
        ("colmap", colmap, [(11, 12), (13, 14)]),
        ("nerfstudio", nerfstudio, [(1, 2)]),
        ("meshroom", meshroom, [(1, 2)]),
        ("tum", sequences.tum, None),
        ("scannet", sequences.scannet, None),
        ("opencv", opencv, None),
        ("json", json_file, None),
        ("json", json_of_patterns, None),
    ],
)
@pytest.mark.filterwarnings("ignore:.*(viewport|never_placed|VIEWPORT)")
def test_a_recording_in_capitals_comes_in_as_the_same(
    tmp_path: Path, name: str, write: Callable[[Path], object], pairs: list[tuple[int, int]] | None
) -> None:
    source = tmp_path / "source"
    write(source)
    unit = 1000.0 if name in ("colmap", "nerfstudio", "meshroom", "mvsnet") else None
    options = ImportOptions(pairs=pairs, unit_mm=unit, bounds=BOUNDS)
    below = source / "date/drive" if (source / "date").exists() else source
    expected = import_recording(name, below, tmp_path / "small", options)
    in_capitals(source)
    below = source / "DATE/DRIVE" if (source / "DATE").exists() else source
    assert find_format(below) == name
    import_recording(AUTO, below, tmp_path / "capitals", options)
    made = read_capture(tmp_path / "capitals")
    assert made.n_frames == expected.n_frames
    assert len(made.held_out) == len(expected.held_out)
    for stream, other in zip(made.sensors, expected.sensors, strict=True):
        for what in ("mask", "depth", "plate"):
            assert (getattr(stream, what) is None) == (getattr(other, what) is None)
        for side, wanted in zip(stream.cameras, other.cameras, strict=True):
            np.testing.assert_array_equal(side.camera.cam_from_world, wanted.camera.cam_from_world)
            np.testing.assert_array_equal(side.camera.K, wanted.camera.K)


def test_pictures_whose_suffixes_differ_in_capitals_only_are_one_folder(tmp_path: Path) -> None:
    opencv(tmp_path / "source")
    for side in ("left", "right"):
        for name in ("S1", "S2"):
            first = tmp_path / f"source/{name}/{side}/9.png"
            first.rename(first.with_suffix(".PNG"))
    made = import_recording(AUTO, tmp_path / "source", tmp_path / "out", ImportOptions(bounds=BOUNDS))
    assert made.n_frames == 2


def test_jpegs_of_every_suffix_are_one_folder(tmp_path: Path) -> None:
    opencv(tmp_path / "source")
    for side in ("left", "right"):
        for name in ("S1", "S2"):
            folder = tmp_path / f"source/{name}/{side}"
            for path in folder.iterdir():
                path.unlink()
            for place, suffix in enumerate((".JPG", ".jpeg", ".jpg")):
                write_picture(folder / f"{place}.jpg", 50 + place)
                (folder / f"{place}.jpg").rename(folder / f"{place}{suffix}")
    made = import_recording(AUTO, tmp_path / "source", tmp_path / "out", ImportOptions(bounds=BOUNDS))
    assert made.n_frames == 3


def test_two_names_that_differ_in_capitals_only_are_a_question(tmp_path: Path) -> None:
    calibrations.middlebury_pair(tmp_path / "source")
    text = (tmp_path / "source/calib.txt").read_text()
    (tmp_path / "source/calib.txt").unlink()
    for name in ("CALIB.TXT", "Calib.txt"):
        (tmp_path / f"source/{name}").write_text(text)
    with pytest.raises(ValueError, match=r"CALIB.TXT and Calib.txt.*keep one"):
        import_recording(AUTO, tmp_path / "source", tmp_path / "out", ImportOptions(bounds=BOUNDS))
