from __future__ import annotations

import json
import re
import shutil
from base64 import b64decode
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.capture.calibration import run
from recon.capture.calibration.board import Board, Corners, parse_board
from recon.capture.calibration.run import calibrate_folders
from recon.capture.calibration.solve import calibrate_camera, calibrate_pair, calibrate_rig
from recon.capture.images import CaptureError, read_video_frame
from recon.geometry.rig import Rig
from tests.command_line import Command
from tests.recon.capture.calibration.board_pictures import (
    board_picture,
    board_pose,
    corners_seen,
    photograph_board,
    project,
    relative_error,
    studio_camera,
    studio_rig,
)

BOARD = parse_board("charuco:14x10:50:37")
COARSE = parse_board("charuco:8x6:90:66")
SIZE = (480, 270)


def calibrated(board: Board, rig: Rig, seen: dict[str, list[dict[str, Corners]]]) -> Rig:
    size = rig.sensors[0].left.size
    pairs = []
    for name, (left, right) in seen.items():
        cameras = [calibrate_camera(f"{name}/{side}", board, size, views) for side, views in enumerate((left, right))]
        pairs.append(calibrate_pair(name, board, (cameras[0], cameras[1]), (left, right)))
    found = calibrate_rig(board, pairs, {name: (left, right) for name, (left, right) in seen.items()})
    return Rig(tuple(pair.sensor for pair in found))


@pytest.mark.slow
def test_corners_with_noise_of_a_third_of_a_pixel_give_the_truth() -> None:
    rig = studio_rig(n_sensors=2)
    found = calibrated(BOARD, rig, corners_seen(BOARD, rig, n_views=70, noise_px=0.3, seed=1))
    for sensor, truth in zip(found.sensors, rig.sensors, strict=True):
        error = relative_error(sensor, truth)
        assert error["focal"] < 0.002
        assert error["baseline"] < 0.002
        assert error["rotation_deg"] < 0.05
    apart = [sensors[1].left.rotation @ sensors[0].left.rotation.T for sensors in (found.sensors, rig.sensors)]
    assert np.rad2deg(np.linalg.norm(cv2.Rodrigues(apart[0] @ apart[1].T)[0])) < 0.05


@pytest.mark.slow
def test_exact_corners_give_the_exact_rig_and_the_world_is_the_first_left_camera_with_y_up() -> None:
    rig = studio_rig(n_sensors=2)
    found = calibrated(COARSE, rig, corners_seen(COARSE, rig, n_views=30, noise_px=0.0, seed=4))
    np.testing.assert_allclose(found.sensors[0].left.cam_from_world, np.diag([1.0, -1, -1, 1]), atol=1e-12)
    first = rig.sensors[0].left.cam_from_world
    for sensor, truth in zip(found.sensors, rig.sensors, strict=True):
        for side in ("left", "right"):
            moved = getattr(sensor, side).cam_from_world @ np.linalg.inv(found.sensors[0].left.cam_from_world)
            expected = getattr(truth, side).cam_from_world @ np.linalg.inv(first)
            np.testing.assert_allclose(moved[:3, :3], expected[:3, :3], atol=2e-6)
            np.testing.assert_allclose(moved[:3, 3], expected[:3, 3], atol=0.02)


def test_an_image_whose_corners_do_not_fit_is_rejected_with_the_reason() -> None:
    rig = studio_rig()
    views = corners_seen(COARSE, rig, n_views=20, noise_px=0.1, seed=5)["S1"][0]
    spoilt = next(iter(views))
    shaken = views[spoilt].pixels + np.random.default_rng(0).normal(0, 4.0, views[spoilt].pixels.shape)
    camera = calibrate_camera("S1/left", COARSE, (1280, 720), {**views, spoilt: Corners(views[spoilt].ids, shaken)})
    assert list(camera.rejected) == [spoilt]
    assert "reprojection error" in camera.rejected[spoilt]


@pytest.mark.slow
def test_views_that_are_all_alike_are_refused() -> None:
    rig = studio_rig()
    views = corners_seen(COARSE, rig, n_views=20, noise_px=0.3, seed=5)["S1"][0]
    flat = np.column_stack([COARSE.points[:, 0] + 200, COARSE.points[:, 1] + 100])  # face on, at one distance
    rng = np.random.default_rng(1)
    ids = np.arange(len(flat))
    alike = {name: Corners(ids, flat * 1.0 + rng.normal(0, 0.3, flat.shape)) for name in views}
    with pytest.raises(CaptureError, match=r"S1/left: the views are too alike"):
        calibrate_camera("S1/left", COARSE, (1280, 720), alike)


@pytest.mark.slow
def test_sensors_that_share_no_view_are_named() -> None:
    rig = studio_rig(n_sensors=2)
    seen = corners_seen(COARSE, rig, n_views=24, noise_px=0.1, seed=6)
    seen["S2"] = [{f"other {name}": corners for name, corners in side.items()} for side in seen["S2"]]
    with pytest.raises(CaptureError, match="sensor S2: shares no image of the board with S1"):
        calibrated(COARSE, rig, seen)


def test_too_few_images_and_pairs_are_named() -> None:
    rig = studio_rig()
    left, right = corners_seen(COARSE, rig, n_views=12, noise_px=0.1, seed=7)["S1"]
    with pytest.raises(CaptureError, match="S1/left: 3 usable images of the board, expected at least 6"):
        calibrate_camera("S1/left", COARSE, (1280, 720), dict(list(left.items())[:3]))
    renamed = {f"r{name}": corners for name, corners in right.items()}
    cameras = [calibrate_camera(side, COARSE, (1280, 720), views) for side, views in (("l", left), ("r", renamed))]
    with pytest.raises(CaptureError, match="sensor S1: 0 instants show the board to both cameras"):
        calibrate_pair("S1", COARSE, (cameras[0], cameras[1]), (left, renamed))


@pytest.mark.slow
def test_images_of_one_name_that_are_not_of_one_instant_are_refused() -> None:
    rig = studio_rig()
    left, right = corners_seen(COARSE, rig, n_views=14, noise_px=0.1, seed=7)["S1"]
    late = dict(zip(right, [*list(right.values())[1:], next(iter(right.values()))], strict=True))
    cameras = [calibrate_camera(side, COARSE, (1280, 720), views) for side, views in (("l", left), ("r", late))]
    with pytest.raises(CaptureError, match=r"sensor S1: corners are \d.* px off .* must be of one instant"):
        calibrate_pair("S1", COARSE, (cameras[0], cameras[1]), (left, late))


@pytest.mark.parametrize(
    "text",
    [
        "chessboard:9x6",
        "chessboard:9:25",
        "charuco:11x8:30",
        "dots:4x4:5",
        "charuco:11x8:30:31",
        "chessboard:2x9:5",
        "chessboard:3x3:25",
        "charuco:4x4:30:22",
        "chessboard:9x6:nan",
        "charuco:9x6:inf:5",
        "charuco:40x40:50:37",
        "charuco:5x5:30:22:Board",
        "charuco:5x5:30:22:CORNER_REFINE_NONE",
    ],
)
def test_a_board_that_cannot_be_is_refused(text: str) -> None:
    with pytest.raises(CaptureError, match=r"expected|do not fit"):
        parse_board(text)


def test_sensors_are_calibrated_in_the_order_of_their_numbers_and_called_as_a_capture_can(tmp_path: Path) -> None:
    for name in ("S1", "S10", "S2"):
        for side in ("left", "right"):
            (tmp_path / "images" / name / side).mkdir(parents=True)
            cv2.imwrite(str(tmp_path / "images" / name / side / "1.png"), np.zeros((9, 9), np.uint8))
    assert list(run._camera_folders([tmp_path / "images"])) == ["S1", "S2", "S10"]
    (tmp_path / "images/S2").rename(tmp_path / "images/sensor 2")
    with pytest.raises(CaptureError, match="sensor id 'sensor 2' is no file name"):
        calibrate_folders([tmp_path / "images"], COARSE, tmp_path / "calibration.yml")


def test_a_folder_of_board_pictures_that_is_not_there_is_named(tmp_path: Path) -> None:
    for sources in ([tmp_path / "gone"], [tmp_path / "gone", tmp_path]):
        with pytest.raises(ValueError, match=r"gone: there is no such file or folder"):
            calibrate_folders(sources, COARSE, tmp_path / "calibration.yml")


@pytest.mark.parametrize("text", ["charuco:8x6:90:66", "chessboard:7x6:90"])
@pytest.mark.parametrize("is_turned", [False, True])
def test_a_printed_board_is_found_where_it_is_also_turned_round(text: str, is_turned: bool) -> None:
    board = parse_board(text)
    scale = 0.5
    picture = board.picture(scale)
    found = board.find(np.ascontiguousarray(picture[::-1, ::-1]) if is_turned else picture)
    first = board.square_mm * (1 if board.kind == "charuco" else 2)
    expected = (board.points[found.ids, :2] + first) * scale - 0.5
    if is_turned:
        expected = np.array(picture.shape[::-1]) - 1 - expected
    np.testing.assert_allclose(found.pixels, expected, atol=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("text", ["charuco:14x10:50:37", "chessboard:9x6:22.5"])
def test_a_board_is_drawn_in_its_true_size(text: str, tmp_path: Path, command: Command) -> None:
    board, out = parse_board(text), tmp_path / "board.svg"
    command("capture", "board", text, "-o", out)
    drawn = out.read_text()
    width_mm = float(re.findall(r'width="([\d.]+)mm"', drawn)[0])
    picture = cv2.imdecode(np.frombuffer(b64decode(drawn.partition("base64,")[2].partition('"')[0]), np.uint8), 0)
    assert picture is not None
    found = board.find(picture)
    assert len(found) == len(board.points)
    distance = np.linalg.norm(found.pixels[-1] - found.pixels[0]) * width_mm / picture.shape[1]
    assert distance == pytest.approx(np.linalg.norm(board.points[-1] - board.points[0]), rel=1e-3)


@pytest.mark.slow
def test_corners_of_a_tilted_chessboard_lie_where_its_edges_meet() -> None:
    board, camera, rng = parse_board("chessboard:14x9:50"), studio_camera(0.0, seed=1), np.random.default_rng(2)
    errors = []
    while len(errors) < 4:
        pose = board_pose(board, rng)
        expected = project(camera, board.points @ pose[:3, :3].T + pose[:3, 3])
        if (expected > 20).all() and (expected < np.array(camera.size) - 20).all():
            found = board.find(board_picture(board, camera, pose, rng))
            errors.append(np.linalg.norm(found.pixels - expected[found.ids], axis=1))
    assert np.sqrt(np.mean(np.square(errors))) < 0.07  # 0.15 as OpenCV's search for chessboards leaves them
    assert np.max(errors) < 0.3


def test_corners_on_one_line_are_not_enough() -> None:
    picture = BOARD.picture(1.0)
    strip = picture[: round(3.05 * BOARD.square_mm)]  # the margin and two rows of squares: one row of corners
    with pytest.raises(CaptureError, match="on one line"):
        BOARD.find(np.ascontiguousarray(np.pad(strip, ((0, 100), (0, 0)), constant_values=255)))


def test_a_board_that_is_hidden_but_for_a_corner_is_refused() -> None:
    picture = BOARD.picture(1.0)
    with pytest.raises(CaptureError, match="only 4 corners of the board are found, expected at least 12"):
        BOARD.find(np.ascontiguousarray(np.pad(picture[:200, :200], 100, constant_values=255)))


@pytest.mark.slow
def test_a_chessboard_that_looks_the_same_turned_round_cannot_join_sensors() -> None:
    rig = studio_rig(n_sensors=2)
    seen = corners_seen(COARSE, rig, n_views=24, noise_px=0.1, seed=6)
    with pytest.raises(CaptureError, match=r"looks the same turned by half a circle.*one more or one fewer corner"):
        calibrated(replace(COARSE, kind="chessboard", columns=7, rows=5), rig, seen)


@pytest.fixture(scope="module")
def photographed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Rig]:
    folder, rig = tmp_path_factory.mktemp("board"), studio_rig(size=SIZE)
    photograph_board(folder, COARSE, rig, n_views=14, seed=3)
    return folder, rig


@pytest.mark.slow
def test_photographs_of_a_board_become_a_calibration_file_with_its_report(
    photographed: tuple[Path, Rig], tmp_path: Path
) -> None:
    folder, rig = photographed
    images = Path(shutil.copytree(folder, tmp_path / "images"))
    blank = np.full((SIZE[1], SIZE[0]), 90, dtype=np.uint8)
    cv2.imwrite(str(images / "S1/left/blank.png"), blank)
    report = calibrate_folders([images], COARSE, tmp_path / "calibration.yml")
    assert (tmp_path / "calibration.yml").is_file()
    error = relative_error(report.rig.sensors[0], rig.sensors[0])
    assert error["focal"] < 0.012  # 480 pixels wide, 14 views
    assert error["baseline"] < 0.012
    assert report.rejected[str(images / "S1/left/blank.png")] == "the board is not found"
    content = json.loads((tmp_path / "calibration_report/report.json").read_text())
    assert set(content["sensors"][0]["left"]["images"]) == set(report.pairs[0].cameras[0].errors)
    drawn = cv2.imread(str(tmp_path / "calibration_report/rectified/S1.jpg"))
    assert drawn is not None
    assert drawn.shape[:2] == (SIZE[1], 2 * SIZE[0])
    found = {path.stem for path in (tmp_path / "calibration_report/corners/S1/left").iterdir()}
    assert found >= set(report.pairs[0].cameras[0].errors)
    with pytest.raises(CaptureError, match=r"calibration.yml: exists already; .*--replace"):
        calibrate_folders([images], COARSE, tmp_path / "calibration.yml")
    (tmp_path / "calibration_report/old").touch()
    again = calibrate_folders([images], COARSE, tmp_path / "calibration.yml", replaces=True)
    assert again.rejected == report.rejected
    assert not (tmp_path / "calibration_report/old").exists()


def too_few(images: Path) -> None:
    for path in sorted((images / "S1/left").iterdir())[3:]:
        path.unlink()


def all_alike(images: Path) -> None:
    for side in ("left", "right"):
        first, *others = sorted((images / "S1" / side).iterdir())
        for path in others:
            shutil.copy(first, path)


def without_overlap(images: Path) -> None:
    for path in shutil.copytree(images / "S1", images / "S2").rglob("*.png"):
        path.rename(path.with_name(f"later_{path.name}"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (too_few, "S1/left: 3 usable images of the board, expected at least 6"),
        (all_alike, "S1/left: the views are too alike"),
        (without_overlap, "sensor S2: shares no image of the board with S1"),
    ],
)
def test_nothing_is_written_of_a_calibration_that_cannot_be_made(
    photographed: tuple[Path, Rig], tmp_path: Path, fault: Callable[[Path], None], message: str
) -> None:
    fault(shutil.copytree(photographed[0], tmp_path / "images"))
    with pytest.raises(CaptureError, match=message):
        calibrate_folders([tmp_path / "images"], COARSE, tmp_path / "calibration.yml")
    assert [path.name for path in tmp_path.iterdir()] == ["images"]


def test_an_empty_picture_is_said_to_show_no_chessboard() -> None:
    with pytest.raises(CaptureError, match="the board is not found; all of it has to be in the picture"):
        parse_board("chessboard:9x6:25").find(np.full((120, 160), 90, dtype=np.uint8))


def test_nothing_is_written_when_no_board_is_found(tmp_path: Path) -> None:
    for side in ("left", "right"):
        (tmp_path / "images" / side).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / "images" / side / "1.png"), np.full((SIZE[1], SIZE[0]), 90, dtype=np.uint8))
    with pytest.raises(CaptureError, match=r"S1/left: 0 usable images.*1\.png: the board is not found"):
        calibrate_folders([tmp_path / "images"], COARSE, tmp_path / "calibration.yml")
    assert [path.name for path in tmp_path.iterdir()] == ["images"]


def film_of(pictures: Path, film: Path, fps: float = 25.0, most: int | None = None) -> Path:
    writer = cv2.VideoWriter(str(film), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), fps, SIZE)
    for path in sorted(pictures.iterdir())[:most]:
        writer.write(cv2.imread(str(path)))
    writer.release()
    return film


@pytest.mark.slow
def test_videos_give_the_calibration_that_their_frames_give(photographed: tuple[Path, Rig], tmp_path: Path) -> None:
    folder, _ = photographed
    films = [film_of(folder / "S1" / side, tmp_path / f"{side}.avi") for side in ("left", "right")]
    by_videos = calibrate_folders(films, COARSE, tmp_path / "by_videos.yml")
    by_images = calibrate_folders([folder], COARSE, tmp_path / "by_images.yml")
    error = relative_error(by_videos.rig.sensors[0], by_images.rig.sensors[0])
    assert max(error.values()) < 0.002  # the codec rounds colours


@pytest.mark.slow
def test_videos_of_different_rates_make_no_calibration(photographed: tuple[Path, Rig], tmp_path: Path) -> None:
    folder = photographed[0] / "S1"
    films = [film_of(folder / side, tmp_path / f"{side}.avi", fps) for side, fps in (("left", 25), ("right", 30))]
    with pytest.raises(CaptureError, match=r"left.avi has 25.000 frames a second, .*right.avi 30.000; expected one"):
        calibrate_folders(films, COARSE, tmp_path / "calibration.yml")
    assert sorted(tmp_path.iterdir()) == films


@pytest.mark.slow
def test_videos_of_different_lengths_are_looked_at_in_the_same_frames(
    photographed: tuple[Path, Rig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = photographed[0] / "S1"
    films = [film_of(folder / side, tmp_path / f"{side}.avi", most=n) for side, n in (("left", 12), ("right", 14))]
    looked_at: dict[Path, set[int]] = {film: set() for film in films}

    def read(path: Path, frame: int) -> NDArray[np.uint8]:
        looked_at[path].add(frame)
        return read_video_frame(path, frame)

    monkeypatch.setattr(run, "MAX_VIDEO_FRAMES", 10)
    monkeypatch.setattr(run, "read_video_frame", read)
    calibrate_folders(films, COARSE, tmp_path / "calibration.yml")
    assert len(looked_at[films[0]]) == 10
    assert looked_at[films[0]] == looked_at[films[1]]
