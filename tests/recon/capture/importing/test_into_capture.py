"""Pictures and videos of a recording are found, put in order and held against each other."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.capture.format import CaptureError, read_capture, read_frame, read_plates
from recon.capture.importing.colmap import import_colmap
from recon.capture.importing.into_capture import GapWarning
from recon.capture.importing.json_file import import_json
from recon.capture.importing.opencv import import_opencv, write_calibration
from recon.capture.importing.sources import ImportOptions
from recon.capture.pictures import find_pictures
from recon.geometry.rig import Rig
from recon.runtime.notices import Notice
from tests.command_line import Command
from tests.recon.capture.importing.labelled_recording import (
    OPTIONS,
    RIG,
    colmap_model,
    described,
    from_opencv,
    record,
    write_picture,
    write_video,
)


def test_images_are_taken_in_the_order_of_their_numbers_and_plates_are_kept(tmp_path: Path) -> None:
    capture = from_opencv(tmp_path)
    assert [int(read_frame(capture, "S2", frame)[0][0, 0, 0]) for frame in (0, 1)] == [60, 61]  # 9.png, 10.png
    plates = read_plates(capture, "S1")
    assert plates is not None
    assert plates[1][0, 0, 0] == 7


def test_unequal_counts_are_named_unless_fewer_frames_are_asked_for(tmp_path: Path) -> None:
    record(tmp_path)
    write_picture(tmp_path / "S2/left/99.png", 1)
    path = described(tmp_path)
    with pytest.raises(CaptureError, match="sensor S1, left has 2 frames, expected 3"):
        import_json(path, tmp_path / "out")
    assert import_json(path, tmp_path / "out", ImportOptions(n_frames=2)).n_frames == 2


@pytest.mark.parametrize("fps", [None, 25.0])  # a rate that is said makes frames of one number no more of one instant
def test_videos_of_different_rates_are_named(tmp_path: Path, fps: float | None) -> None:
    write_calibration(tmp_path / "calibration.yml", Rig(RIG.sensors[:1]))
    write_video(tmp_path / "left.avi", [10, 20, 30])
    write_video(tmp_path / "right.avi", [10, 20, 30], fps=30.0)
    with pytest.raises(CaptureError, match=r"left has 25\.000 frames a second, sensor S1, right 30\.000"):
        import_opencv(tmp_path, tmp_path / "out", replace(OPTIONS, fps=fps))


def test_the_frame_rate_of_videos_is_that_which_is_said(tmp_path: Path) -> None:
    write_calibration(tmp_path / "calibration.yml", Rig(RIG.sensors[:1]))
    for side in ("left", "right"):
        write_video(tmp_path / f"{side}.avi", [10, 20, 30])
    assert import_opencv(tmp_path, tmp_path / "out", replace(OPTIONS, fps=240.0)).fps == 240.0


def test_a_variable_frame_rate_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_calibration(tmp_path / "calibration.yml", Rig(RIG.sensors[:1]))
    for side in ("left", "right"):
        write_video(tmp_path / f"{side}.avi", [10, 20, 30])
    monkeypatch.setattr("recon.capture.pictures.video_times", lambda _: np.array([0.0, 0.04, 0.12]))
    with pytest.raises(CaptureError, match=r"variable frame rate, intervals of 40\.0 to 80\.0 ms"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    assert not (tmp_path / "out").exists()


def test_two_recordings_of_one_name_are_not_guessed_between(tmp_path: Path) -> None:
    write_picture(tmp_path / "left.png", 1)
    write_picture(tmp_path / "left.jpg", 1)
    with pytest.raises(CaptureError, match=r"found left.jpg, left.png, expected one"):
        find_pictures(tmp_path / "left")


def test_cameras_that_lack_pictures_of_different_instants_are_refused(tmp_path: Path) -> None:
    record(tmp_path / "source")
    path = described(tmp_path / "source")
    for frame in range(9, 14):
        for sensor in RIG.sensors:
            for side in ("left", "right"):
                write_picture(path.parent / sensor.id / side / f"cam4_{frame}.png", frame)
                (path.parent / sensor.id / side / f"{frame}.png").unlink(missing_ok=True)
    (path.parent / "S1/left/cam4_11.png").unlink()
    for place in ("S1/right", "S2/left", "S2/right"):
        (path.parent / place / "cam4_10.png").unlink()
    with pytest.raises(CaptureError, match=r"cam4_10\.png of sensor S1, left .* as cam4_11\.png of sensor S1, right"):
        import_json(path, tmp_path / "out", OPTIONS)
    assert not (tmp_path / "out").exists()
    (path.parent / "S1/left/cam4_10.png").unlink()
    for place in ("S1/right", "S2/left", "S2/right"):
        (path.parent / place / "cam4_11.png").unlink()
    with pytest.warns(GapWarning, match=r"sensor S1, left: cam4_12\.png follows cam4_9\.png"):
        assert import_json(path, tmp_path / "out", OPTIONS).n_frames == 3


@pytest.mark.slow
def test_an_instant_that_no_camera_has_is_named(command: Command, tmp_path: Path) -> None:
    record(tmp_path / "source", n_frames=3)
    path = described(tmp_path / "source")
    for later in path.parent.rglob("11.png"):
        later.rename(later.with_name("12.png"))
    told = command("capture", "import", "json", path, tmp_path / "out")
    assert "warning: sensor S1, left: 12.png follows 10.png; where pictures between them are missing" in told.err
    assert read_capture(tmp_path / "out").n_frames == 3


def test_pictures_that_are_named_by_their_times_need_not_have_the_same_numbers(tmp_path: Path) -> None:
    record(tmp_path / "source")
    path = described(tmp_path / "source")
    for number, sensor in enumerate(RIG.sensors):
        for side in ("left", "right"):
            for frame in (9, 10):
                place = path.parent / sensor.id / side
                (place / f"{frame}.png").rename(place / f"{40_000_000 * frame + 7 * number * frame}.png")
    assert import_json(path, tmp_path / "out", OPTIONS).n_frames == 2


def test_a_pattern_with_a_frame_missing_in_the_middle_is_refused(tmp_path: Path) -> None:
    record(tmp_path / "source")
    path = described(tmp_path / "source")
    content = json.loads(path.read_text())
    for entry in content["sensors"]:
        for side in ("left", "right"):
            for frame in (0, 1, 3):
                write_picture(path.parent / f"shot{frame:03d}/{entry['id']}_{side}.png", frame)
            entry[side]["image"] = f"shot{{frame:03d}}/{entry['id']}_{side}.png"
    path.write_text(json.dumps(content))
    with pytest.raises(CaptureError, match=r"shot002/S1_left\.png: there is no such image, but later ones"):
        import_json(path, tmp_path / "out", OPTIONS)


def test_files_that_a_system_hides_are_no_pictures(tmp_path: Path) -> None:
    record(tmp_path / "source")
    for side in ("left", "right"):  # as macOS writes beside each file on disks of other systems
        (tmp_path / "source/S1" / side / "._9.png").write_bytes(b"\0\5\x16\7")
    assert from_opencv(tmp_path).n_frames == 2


def test_a_video_may_end_in_capital_letters(tmp_path: Path) -> None:
    write_calibration(tmp_path / "calibration.yml", Rig(RIG.sensors[:1]))
    for side in ("left", "right"):
        write_video(tmp_path / f"{side}.avi", [10, 20, 30])
        (tmp_path / f"{side}.avi").rename(tmp_path / f"{side}.AVI")
    assert import_opencv(tmp_path, tmp_path / "out", OPTIONS).n_frames == 3


@pytest.mark.parametrize("is_pattern", [False, True])
def test_cameras_whose_numbers_begin_apart_are_pointed_out(tmp_path: Path, is_pattern: bool) -> None:
    record(tmp_path / "source", n_frames=4)
    path = described(tmp_path / "source")
    for number, old in enumerate(range(9, 13)):
        for sensor in RIG.sensors:
            for side in ("left", "right"):
                first = (sensor.id, side) == ("S2", "right")
                place = path.parent / sensor.id / side
                (place / f"{old}.png").rename(place / f"{number + first}.png")
    if is_pattern:
        path.write_text(
            path.read_text().replace('left"}', 'left/{frame}.png"}').replace('right"}', 'right/{frame}.png"}')
        )
    with pytest.warns(GapWarning, match=r"sensor S1, left begins with 0\.png, sensor S2, right with 1\.png"):
        assert import_json(path, tmp_path / "out", OPTIONS).n_frames == 4


def test_pictures_of_another_size_than_their_calibrations_are_refused(tmp_path: Path) -> None:
    record(tmp_path)
    write_calibration(tmp_path / "calibration.yml", RIG)
    for path in (tmp_path / "S2/right").iterdir():
        cv2.imwrite(str(path), np.zeros((120, 160, 3), np.uint8))
    with pytest.raises(
        CaptureError, match=r"sensor S2, right: .*9\.png has 160x120 pixels, its calibration is for 320x24"
    ):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)


def test_held_out_photographs_and_masks_of_another_size_are_refused(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    options = ImportOptions(unit_mm=1000.0)
    for name in ("S1_left", "S1_right"):
        (source / "masks").mkdir(exist_ok=True)
        cv2.imwrite(str(source / f"masks/{name}.png"), np.zeros((120, 160), np.uint8))
    with pytest.raises(CaptureError, match=r"S1_left\.png: a mask of 160x120, expected 320x240"):
        import_colmap(source, tmp_path / "out", [(11, 12)], options)
    cv2.imwrite(str(source / "images/S2_left.png"), np.zeros((120, 160, 3), np.uint8))
    with pytest.raises(CaptureError, match=r"held out: .*S2_left\.png has 160x120 pixels"):
        import_colmap(source, tmp_path / "out", [(11, 12)], options)


def test_a_doubt_that_several_sensors_share_is_told_once_and_names_them(tmp_path: Path) -> None:
    record(tmp_path)
    path = described(tmp_path)
    entry = json.loads(path.read_text())
    for number, sensor in enumerate(entry["sensors"]):
        sensor["left"]["K"][0][2] = 4000.0 + number
    path.write_text(json.dumps(entry))
    with pytest.warns(Notice, match="principal point of left") as notices:
        import_json(path, tmp_path / "out")
    told = [str(notice.message) for notice in notices if "principal point" in str(notice.message)]
    assert len(told) == 1
    assert told[0].startswith("sensor S1 (likewise in S2")
