from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.capture.checking.check import check_capture
from recon.capture.checking.consistency import Shared, compared
from recon.capture.checking.continuity import exposure_warnings, matched_levels, unlike
from recon.capture.checking.diagnosis import MIN_MATCHES
from recon.capture.checking.matches import Matches, epipolar_errors
from recon.capture.format import Capture, image_path, read_frame, write_capture
from recon.capture.images import read_image
from recon.geometry.rig import rigid
from recon.studio import SynthParameters, synthesise
from tests.command_line import Command
from tests.recon.capture.calibration.board_geometry import SIZE, record_board


@pytest.fixture
def board(tmp_path: Path) -> Capture:
    return record_board(tmp_path / "board")


def turn_right_camera(capture: Capture, turn_deg: float) -> Capture:
    """The capture with a wrong calibration: S1's right camera turned about its horizontal axis."""
    stream = capture.sensors[0]
    turn = rigid(cv2.Rodrigues(np.array([np.deg2rad(turn_deg), 0.0, 0.0]))[0], (0, 0, 0))
    camera = replace(stream.right.camera, cam_from_world=turn @ stream.right.camera.cam_from_world)
    changed = replace(stream, right=replace(stream.right, camera=camera))
    capture = replace(capture, sensors=(changed, *capture.sensors[1:]))
    write_capture(capture)
    return capture


@pytest.mark.slow
def test_a_sound_capture_has_no_problems_and_its_rows_agree(board: Capture) -> None:
    report = check_capture(board.folder)
    assert report.problems == ()
    assert report.n_frames == 2
    for sensor in report.sensors:
        assert sensor.baseline_mm == pytest.approx(40.0)
        assert sensor.rows is not None
        assert sensor.rows.n_matches >= MIN_MATCHES
        assert sensor.rows.vertical_error_px is not None
        assert sensor.rows.vertical_error_px < 0.25  # made from pictures of 160x120 pixels
        assert sensor.mask_coverage is None


@pytest.mark.slow
def test_the_expected_depth_resolution_is_that_of_the_middle_of_the_bounds(board: Capture) -> None:
    (sensor, _) = check_capture(board.folder).sensors
    assert sensor.depth_per_disparity_mm == pytest.approx(600.0**2 / (502.5 * 40.0))  # the baseline is along the board


def test_everything_wrong_is_listed_in_one_go(board: Capture) -> None:
    content = json.loads((board.folder / "capture.json").read_text())
    content["kind"] = "film"
    content["sensors"][1]["right"]["cam_from_world"] = content["sensors"][1]["left"]["cam_from_world"]
    (board.folder / "capture.json").write_text(json.dumps(content))
    missing = image_path(board.folder, board.sensors[0].left.image, 1)
    missing.unlink()
    cut = image_path(board.folder, board.sensors[1].left.image, 0)
    cut.write_bytes(cut.read_bytes()[:500])
    small = image_path(board.folder, board.sensors[1].right.image, 1)
    cv2.imwrite(str(small), np.zeros((60, 80, 3), dtype=np.uint8))
    problems = check_capture(board.folder).problems
    expected = [
        "kind is 'film'",
        "baseline is 0 mm",
        f"{missing}: there is no",
        f"{cut}: is cut off after 500",
        f"{small}: is 80x60",
    ]
    assert len(problems) == len(expected)
    for part in expected:
        assert sum(part in problem for problem in problems) == 1, part


@pytest.mark.slow
def test_keys_that_a_capture_does_not_have_are_pointed_out(board: Capture) -> None:
    content = json.loads((board.folder / "capture.json").read_text())
    content["note"] = "first try"
    content["sensors"][0]["masks"] = {"left": "a.png", "right": "b.png"}
    content["sensors"][1]["right"]["distortion"] = [0.1, 0, 0, 0]
    (board.folder / "capture.json").write_text(json.dumps(content))
    report = check_capture(board.folder)
    assert report.problems == ()
    names = ("note", "sensor S1, masks", "sensor S2, right, distortion")
    *warnings, instants = report.warnings
    assert "same instants could not be checked" in instants  # the recording is short
    for name, warning in zip(names, warnings, strict=True):
        assert f"capture.json: {name} is no key of a capture, and is ignored; expected " in warning


@pytest.mark.slow
def test_a_camera_that_was_turned_after_calibration_is_noticed(board: Capture) -> None:
    turn_right_camera(board, turn_deg=0.5)
    (problem,) = check_capture(board.folder).problems
    assert problem.startswith("sensor S1: ")
    assert "the right camera is rotated by 0.50 degrees" in problem
    rows = check_capture(turn_right_camera(board, turn_deg=0.0).folder).sensors[1].rows
    assert rows is not None
    assert rows.vertical_error_px is not None
    assert rows.vertical_error_px < 0.25


def test_sensors_that_see_no_point_in_common_are_no_problem(board: Capture) -> None:
    (first, second) = board.sensors
    nothing = Matches(np.zeros((0, 2)), np.zeros((0, 2)))
    assert len(epipolar_errors(first.sensor, nothing)) == 0
    assert not compared(first.sensor, second.sensor, [Shared(nothing, nothing)], tolerance_mm=5.0).is_known


@pytest.mark.slow
@pytest.mark.parametrize("both", [True, False], ids=["sensor", "right camera"])
def test_a_pose_that_two_cameras_have_is_a_problem(both: bool, board: Capture) -> None:
    first, second = board.sensors
    left, right = (
        replace(its, camera=replace(its.camera, cam_from_world=others.camera.cam_from_world))
        for its, others in zip(second.cameras, first.cameras, strict=True)
    )
    write_capture(replace(board, sensors=(first, replace(second, left=left if both else second.left, right=right))))
    problems = check_capture(board.folder).problems
    told = [problem for problem in problems if "have the same pose, but not the same pictures" in problem]
    assert len(told) == 1 + both
    assert "S1/right/{frame:04d}.png and S2/right/{frame:04d}.png" in told[-1]


@pytest.mark.slow
def test_pairs_may_share_a_camera(board: Capture) -> None:
    first, second = board.sensors
    write_capture(replace(board, sensors=(first, replace(second, left=first.right))))
    assert not any("have the same pose" in problem for problem in check_capture(board.folder).problems)


@pytest.mark.slow
def test_what_only_another_sensor_can_tell_could_not_be_checked_with_one(board: Capture) -> None:
    words = (
        "whether its focal lengths, principal points and the angle between its cameras are right could not be checked"
    )
    both = check_capture(board.folder)
    assert [sensor.is_compared for sensor in both.sensors] == [True, True]
    assert not any(words in verdict for verdict in both.verdicts)
    write_capture(replace(board, sensors=board.sensors[:1]))
    alone = check_capture(board.folder)
    assert words in alone.verdicts[0]


@pytest.mark.slow
def test_a_recording_without_masks_is_said_not_to_be_checked_for_background(board: Capture) -> None:
    words = "whether background stands within the bounds could not be checked"
    assert all(words in verdict for verdict in check_capture(board.folder).verdicts)
    for frame in range(board.n_frames):
        cv2.imwrite(str(board.folder / f"mask{frame}.png"), np.full((SIZE[1], SIZE[0]), 255, np.uint8))
    masked = tuple(replace(stream, mask=("mask{frame}.png", "mask{frame}.png")) for stream in board.sensors)
    write_capture(replace(board, sensors=masked))
    assert not any(words in verdict for verdict in check_capture(board.folder).verdicts)


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["ball", "face", "cuboid"])  # in this size neighbours share no point of the cuboid
def test_nothing_is_wrong_with_a_recording_of_the_studio(scene: str, tmp_path: Path) -> None:
    synthesise(tmp_path / scene, SynthParameters(scene, n_frames=1, size=(480, 270), seed=4))
    assert check_capture(tmp_path / scene).problems == ()


@pytest.mark.slow
def test_an_object_outside_the_bounds_is_noticed(board: Capture) -> None:
    write_capture(replace(board, bounds=np.subtract(board.bounds, (0.0, 0.0, 80.0))))
    problems = check_capture(board.folder).problems
    assert len(problems) == 2
    assert all("px (median), the bounds span 0 to" in problem for problem in problems)


@pytest.mark.slow
def test_bounds_beside_the_pictures_are_named(board: Capture) -> None:
    write_capture(replace(board, bounds=np.add(board.bounds, (100.0, 0.0, 0.0))))
    warnings = check_capture(board.folder).warnings
    assert "no camera shows the middle of the bounds; they are the box around the object, in mm" in warnings


@pytest.mark.slow
def test_bounds_in_metres_are_noticed(board: Capture) -> None:
    middle = board.bounds.mean(axis=0)
    write_capture(replace(board, bounds=middle + (board.bounds - middle) / 1000))
    problems = check_capture(board.folder).problems
    assert [problem.partition(":")[0] for problem in problems] == ["sensor S1", "sensor S2"]
    assert all("pixels of the left picture, expected at least 256; they are the box" in problem for problem in problems)


def masked(board: Capture, left_out: int) -> Capture:
    """The capture with one mask for all pictures: white but for the first rows."""
    mask = np.full((SIZE[1], SIZE[0]), 255, dtype=np.uint8)
    mask[:left_out] = 0
    for frame in range(board.n_frames):
        cv2.imwrite(str(board.folder / f"mask{frame}.png"), mask)
    streams = (replace(stream, mask=("mask{frame}.png", "mask{frame}.png")) for stream in board.sensors)
    return replace(board, sensors=tuple(streams))


@pytest.mark.slow
def test_masks_that_lie_outside_the_bounds_are_noticed(board: Capture) -> None:
    low = masked(board, SIZE[1] * 9 // 10)
    write_capture(low)
    assert not any("lies within the bounds" in problem for problem in check_capture(board.folder).problems)
    (x, y, z), (right, top, near) = board.bounds
    write_capture(replace(low, bounds=np.array([[x, (y + 2 * top) / 3, z], [right, top, near]])))
    problems = check_capture(board.folder).problems
    assert any(
        "S1: 0% of what the left masks show lies within the bounds; check the bounds" in text for text in problems
    )


@pytest.mark.slow
def test_masks_that_cover_the_pictures_edges_are_named(board: Capture) -> None:
    write_capture(masked(board, 0))
    assert any("S1: the masks of a camera cover" in warning for warning in check_capture(board.folder).warnings)
    write_capture(masked(board, SIZE[1] // 3))
    assert not any("cover" in warning for warning in check_capture(board.folder).warnings)


@pytest.mark.slow
def test_masks_are_measured_and_empty_ones_are_a_problem(board: Capture) -> None:
    streams = []
    for stream, height in zip(board.sensors, (SIZE[1] // 2, 0), strict=True):
        mask = np.zeros((SIZE[1], SIZE[0]), dtype=np.uint8)
        mask[:height] = 255
        for side in "lr":
            for frame in range(board.n_frames):
                cv2.imwrite(str(board.folder / f"{stream.id}_{side}{frame}.png"), mask)
        streams.append(replace(stream, mask=(f"{stream.id}_l{{frame}}.png", f"{stream.id}_r{{frame}}.png")))
    write_capture(replace(board, sensors=tuple(streams)))
    report = check_capture(board.folder)
    assert [sensor.mask_coverage for sensor in report.sensors] == [(0.5, 0.5), (0.0, 0.0)]
    assert report.problems == ("sensor S2: the masks of a camera are empty in all frames",)


@pytest.mark.slow
def test_a_mask_of_a_frame_that_is_not_measured_closely_is_read_once(
    board: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recon.capture.checking.sensor.measured_frames", lambda _n: [0])
    read: list[str] = []
    monkeypatch.setattr("recon.capture.format.read_image", lambda path: read.append(path.name) or read_image(path))
    write_capture(masked(board, SIZE[1] // 3))
    check_capture(board.folder)
    assert read.count("mask1.png") == 4  # it is that of four cameras


@pytest.mark.slow
def test_frames_with_empty_masks_and_sensors_without_masks_are_named(board: Capture) -> None:
    for frame, level in enumerate((255, 0)):
        cv2.imwrite(str(board.folder / f"mask{frame}.png"), np.full((SIZE[1], SIZE[0]), level, dtype=np.uint8))
    masked = replace(board.sensors[0], mask=("mask{frame}.png", "mask{frame}.png"))
    write_capture(replace(board, sensors=(masked, board.sensors[1])))
    report = check_capture(board.folder)
    assert any("sensor S2 has no masks, but others have" in warning for warning in report.warnings)
    assert any("sensor S1: a mask is empty in frame 1;" in warning for warning in report.warnings)
    cv2.imwrite(str(board.folder / "mask1.png"), np.full((SIZE[1], SIZE[0]), 255, dtype=np.uint8))
    whole = check_capture(board.folder).sensors[0].textured
    assert report.sensors[0].textured == pytest.approx(whole, rel=0.2)  # the empty one says nothing about texture


def test_few_points_that_differ_much_in_brightness_say_nothing() -> None:
    few = np.array([1.1, 1.1, 1.2, 1.3, 1.6, 1.8, 5.6, 0.9, 1.4, 1.3, 1.5, 1.0])  # highlights and wrong matches
    assert np.median(few) > 1.25
    assert unlike(few, 1.25) is None
    assert unlike(np.random.default_rng(0).normal(1.4, 0.15, 60), 1.25) == pytest.approx(1.4, abs=0.05)
    assert unlike(1 / np.random.default_rng(0).normal(1.4, 0.15, 60), 1.25) == pytest.approx(1 / 1.4, abs=0.05)
    assert unlike(np.zeros(0), 1.25) is None


@pytest.mark.slow
@pytest.mark.parametrize("colour", [(255, 255, 255), (180, 255, 255)], ids=["white", "yellow"])
def test_an_object_that_is_overexposed_is_named(board: Capture, colour: tuple[int, int, int]) -> None:
    for path in (board.folder / "S2").rglob("*.png"):
        picture = cv2.imread(str(path))
        picture[:, : picture.shape[1] * 4 // 5] = colour
        cv2.imwrite(str(path), picture)
    warnings = check_capture(board.folder).warnings
    assert any("S2: " in warning and "is overexposed, without structure" in warning for warning in warnings)


def test_colours_of_another_white_balance_or_order_are_named_and_those_of_noise_are_not() -> None:
    rng = np.random.default_rng(0)
    picture = cv2.resize(rng.integers(20, 240, (12, 16, 3), np.uint8), (320, 240))
    noisy = np.clip(picture + rng.normal(0, 3, picture.shape), 0, 255).astype(np.uint8)
    places = rng.uniform(10, 230, (80, 2))

    def told(other: np.ndarray) -> list[str]:
        return list(exposure_warnings("S1", matched_levels(picture, other, Matches(places, places))))

    assert told(noisy) == []
    (sentence,) = told(np.rint(noisy * (1.0, 1.0, 0.7)).astype(np.uint8))
    assert sentence.startswith("sensor S1: for their brightness, matched points differ 1.")
    assert "in blue between the left and the right pictures" in sentence
    (sentence,) = told(np.ascontiguousarray(noisy[..., ::-1]))
    assert "what is red in the left pictures is blue in the right ones" in sentence


def test_pale_colours_in_another_order_are_named_and_grey_is_not() -> None:
    rng = np.random.default_rng(1)
    grey = cv2.resize(rng.integers(60, 200, (12, 16, 1), np.uint8), (320, 240))[..., None]
    tint = cv2.resize(rng.normal(1.0, 0.06, (12, 16, 3)), (320, 240))
    places = rng.uniform(10, 230, (80, 2))

    def told(picture: np.ndarray, order: int) -> list[str]:
        left, right = (np.clip(picture + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8) for _ in range(2))
        levels = matched_levels(left, np.ascontiguousarray(right[..., ::order]), Matches(places, places))
        return list(exposure_warnings("S1", levels))

    assert [told(grey * tint, 1), told(grey * np.ones(3), 1), told(grey * np.ones(3), -1)] == [[], [], []]
    alike = matched_levels(plain := np.full((240, 320, 3), 90, np.uint8), plain, Matches(places, places))
    assert list(exposure_warnings("S1", alike)) == []
    assert ["order of red, green and blue is reversed" in sentence for sentence in told(grey * tint, -1)] == [True]


@pytest.mark.slow
def test_a_sensor_that_shows_red_as_blue_is_named_beside_another(board: Capture) -> None:
    for path in (board.folder / "S2").rglob("*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path))[..., ::-1])
    warnings = check_capture(board.folder).warnings
    assert any("what is red in the pictures of sensor S1 is blue in those of sensor S2" in told for told in warnings)


@pytest.mark.slow
def test_a_camera_that_shows_everything_mirrored_is_named(board: Capture) -> None:
    assert not any("mirrored" in problem for problem in check_capture(board.folder).problems)
    for path in (board.folder / "S2/right").rglob("*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path))[:, ::-1])
    problems = check_capture(board.folder).problems
    assert any("S2: one of its cameras shows everything mirrored" in problem for problem in problems)


@pytest.mark.slow
def test_a_sensor_that_is_darker_than_another_is_named(board: Capture) -> None:
    for path in (board.folder / "S2").rglob("*.png"):
        cv2.imwrite(str(path), np.rint(0.7 * cv2.imread(str(path))).astype(np.uint8))
    warning, instants = check_capture(board.folder).warnings
    assert "could not be checked" in instants
    assert "sensor S1 are 1.4" in warning
    assert "as bright as those of sensor S2" in warning


def test_bounds_behind_the_cameras_are_a_problem_of_each_sensor(board: Capture) -> None:
    write_capture(replace(board, bounds=np.add(board.bounds, (0.0, 0.0, 2000.0))))
    problems = check_capture(board.folder).problems
    assert [problem[:10] for problem in problems] == ["sensor S1:", "sensor S2:"]
    assert all("in front of the cameras" in problem for problem in problems)


@pytest.mark.slow
def test_a_short_video_is_one_problem(board: Capture) -> None:
    path = board.folder / "left.avi"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*"FFV1"), 25.0, SIZE)
    writer.write(read_frame(board, "S1", 0)[0])
    writer.release()
    content = json.loads((board.folder / "capture.json").read_text())
    content["sensors"][0]["left"]["image"] = "left.avi"
    (board.folder / "capture.json").write_text(json.dumps(content))
    (problem,) = check_capture(board.folder).problems
    assert problem == f"{path}: ends after 1 frames, frame 1 was asked for"


@pytest.mark.slow
def test_a_video_that_cannot_be_decoded_is_one_problem(board: Capture) -> None:
    path = board.folder / "left.avi"
    path.write_bytes(b"no video")
    content = json.loads((board.folder / "capture.json").read_text())
    content["sensors"][0]["left"]["image"] = "left.avi"
    (board.folder / "capture.json").write_text(json.dumps(content))
    (problem,) = check_capture(board.folder).problems
    assert problem == f"{path}: is not a video that can be decoded"


@pytest.mark.slow
def test_the_report_is_json_and_text(board: Capture) -> None:
    report = check_capture(board.folder)
    content = json.loads(json.dumps(report.as_json(), allow_nan=False))
    assert content["schema_version"] == 1
    assert content["sensors"][0]["rows"]["n_matches"] >= MIN_MATCHES
    assert report.as_text().startswith("S1: baseline 40.00 mm, rectified ")


def test_a_folder_without_a_capture_has_no_frames(command: Command, tmp_path: Path) -> None:
    assert f"{tmp_path}: no frames, 0 sensors\n" in command("capture", "check", tmp_path).out


def test_a_folder_without_a_capture_is_one_problem(tmp_path: Path) -> None:
    (problem,) = check_capture(tmp_path).problems
    assert "capture.json: there is no such file" in problem
