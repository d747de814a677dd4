from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.capture.checking.check import check_capture
from recon.capture.checking.continuity import continuity_warnings, glance_at
from recon.capture.format import Capture, image_path, read_frame
from tests.recon.capture.calibration.board_geometry import SIZE, record_board

N_FRAMES = 6


@pytest.fixture
def board(tmp_path: Path) -> Capture:
    """A moving board with sensor noise; nothing is wrong with it."""
    capture = record_board(tmp_path / "board", n_sensors=1, n_frames=N_FRAMES)
    rng = np.random.default_rng(3)
    for side in ("left", "right"):
        for frame in range(N_FRAMES):
            path = picture(capture, side, frame)
            noisy = cv2.imread(str(path)) + rng.normal(30.0, 1.5, (SIZE[1], SIZE[0], 3))
            cv2.imwrite(str(path), noisy.clip(0, 255).astype(np.uint8))
    return capture


def picture(capture: Capture, side: str, frame: int) -> Path:
    return image_path(capture.folder, getattr(capture.sensors[0], side).image, frame)


def brighten(path: Path, factor: float) -> None:
    cv2.imwrite(str(path), (cv2.imread(str(path)) * factor).clip(0, 255).astype(np.uint8))


@pytest.mark.slow
def test_a_sound_recording_has_no_problems(board: Capture) -> None:
    report = check_capture(board.folder)
    assert report.problems == report.warnings == ()


@pytest.mark.slow
def test_pictures_of_16_bits_that_may_be_read_too_dark_are_named(board: Capture) -> None:
    for side in ("left", "right"):
        for frame in range(N_FRAMES):
            path = picture(board, side, frame)
            cv2.imwrite(str(path), cv2.imread(str(path)).astype(np.uint16) * 64)  # as of 14 bits
    assert any(
        "16383: whether they are dark, or a camera's of 14 bits" in said
        for said in check_capture(board.folder).warnings
    )


@pytest.mark.slow
def test_a_repeated_frame_is_named(board: Capture) -> None:
    shutil.copyfile(picture(board, "left", 2), picture(board, "left", 3))
    assert check_capture(board.folder).warnings == ("S1/left/{frame:04d}.png: frame 3 repeats frame 2",)


@pytest.mark.slow
def test_a_frozen_camera_is_named(board: Capture) -> None:
    for frame in range(1, N_FRAMES):
        shutil.copyfile(picture(board, "right", 0), picture(board, "right", frame))
    (problem,) = check_capture(board.folder).problems
    assert problem.startswith("S1/right/{frame:04d}.png: the camera is frozen")
    assert problem.endswith("from frame 0 to 5")


@pytest.mark.slow
def test_one_cameras_pictures_on_both_sides_are_named_and_not_taken_for_a_turned_camera(board: Capture) -> None:
    for frame in range(N_FRAMES):
        shutil.copyfile(picture(board, "left", frame), picture(board, "right", frame))
    assert check_capture(board.folder).problems == (
        "sensor S1: its left and right pictures are the same, one camera's; give each camera its own",
    )
    content = json.loads((board.folder / "capture.json").read_text())
    content["sensors"][0]["right"]["image"] = content["sensors"][0]["left"]["image"]
    (board.folder / "capture.json").write_text(json.dumps(content))
    assert any("pictures are the same" in problem for problem in check_capture(board.folder).problems)


def test_a_frame_that_only_differs_by_compression_is_a_repeated_one(board: Capture) -> None:
    rng = np.random.default_rng(1)
    frames = [read_frame(board, "S1", frame)[0] for frame in (0, 1, 1, 2, 3, 4)]
    noisy = (frames[2] + rng.normal(0, 0.3, frames[2].shape)).round().clip(0, 255).astype(np.uint8)
    glances = {"left.mp4": dict(enumerate(map(glance_at, [*frames[:2], noisy, *frames[3:]])))}
    assert list(continuity_warnings(glances)) == ["left.mp4: frame 2 repeats frame 1"]


@pytest.mark.slow
def test_a_jump_of_the_exposure_is_named(board: Capture) -> None:
    for frame in range(3, N_FRAMES):
        brighten(picture(board, "left", frame), 0.8)
    warnings = check_capture(board.folder).warnings
    (jump,) = (warning for warning in warnings if "jumps" in warning)
    assert jump.startswith("S1/left/{frame:04d}.png: the exposure jumps at frame 3, to 0.8")


@pytest.mark.slow
def test_a_camera_that_is_darker_than_its_neighbour_is_named(board: Capture) -> None:
    for frame in range(N_FRAMES):
        brighten(picture(board, "right", frame), 0.7)
    report = check_capture(board.folder)
    (warning,) = report.warnings
    assert report.problems == ()
    assert warning.startswith("sensor S1: the left pictures are 1.4")


@pytest.mark.slow
def test_more_pictures_than_frames_are_unequal_counts(board: Capture) -> None:
    for extra in range(2):
        shutil.copyfile(picture(board, "left", 0), picture(board, "left", N_FRAMES + extra))
    (warning,) = check_capture(board.folder).warnings
    assert "left/{frame:04d}.png: has 8 frames, the capture 6" in warning


@pytest.mark.slow
def test_a_frame_that_all_cameras_lack_is_named(board: Capture) -> None:
    for side in ("left", "right"):
        picture(board, side, N_FRAMES - 2).unlink()
    path = board.folder / "capture.json"
    path.write_text(path.read_text().replace(f'"n_frames": {N_FRAMES}', f'"n_frames": {N_FRAMES - 2}'))
    left, right = check_capture(board.folder).warnings
    assert "left/{frame:04d}.png: lacks frame 4 but has later ones, up to 5; where all cameras lack a frame" in left
    assert "right/{frame:04d}.png" in right


@pytest.mark.slow
def test_a_longer_video_is_an_unequal_count(board: Capture) -> None:
    writer = cv2.VideoWriter(
        str(board.folder / "left.avi"), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 25.0, SIZE
    )
    for frame in [*range(N_FRAMES), 0]:
        writer.write(cv2.imread(str(picture(board, "left", frame))))
    writer.release()
    path = board.folder / "capture.json"
    path.write_text(path.read_text().replace("S1/left/{frame:04d}.png", "left.avi"))
    (warning,) = check_capture(board.folder).warnings
    assert "left.avi: has 7 frames, the capture 6" in warning
