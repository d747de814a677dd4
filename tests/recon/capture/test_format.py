from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from recon.capture.format import (
    Capture,
    CaptureError,
    HeldOut,
    SensorStream,
    image_path,
    read_capture,
    read_draft,
    read_frame,
    read_held_out,
    read_masks,
    read_plates,
    write_capture,
)
from recon.geometry.rig import Camera
from tests.recon.capture.calibration.board_geometry import SIZE, board_camera, record_board
from tests.recon.capture.importing.labelled_recording import from_opencv

Content = dict[str, Any]


@pytest.fixture
def board(tmp_path: Path) -> Capture:
    return record_board(tmp_path / "board")


def changed(capture: Capture, change: Callable[[Content], object]) -> Path:
    """The capture's folder after a change of its JSON."""
    path = capture.folder / "capture.json"
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return capture.folder


def all_cameras(capture: Capture) -> list[Camera]:
    sides = [side.camera for stream in capture.sensors for side in (stream.left, stream.right)]
    return sides + [photograph.camera for photograph in capture.held_out]


def test_a_capture_is_read_as_it_was_written(board: Capture) -> None:
    distorted = replace(board.sensors[0].left.camera, dist=np.array([0.1, -0.2, 1e-3, 0.0, 1 / 3]))
    left = replace(board.sensors[0].left, camera=distorted)
    written = replace(
        board,
        kind="sphere",
        fps=29.97,
        object={"radius_mm": 150},
        sensors=(replace(board.sensors[0], left=left), board.sensors[1]),
        held_out=(HeldOut(board_camera(33.0), "S1/left/0001.png", 1),),
    )
    write_capture(written)
    read = read_capture(board.folder)
    assert (read.name, read.kind, read.fps, read.n_frames) == ("board", "sphere", 29.97, 2)
    assert read.object == {"radius_mm": 150}
    np.testing.assert_array_equal(read.bounds, board.bounds)
    assert [(s.id, s.left.image, s.right.image, s.plate, s.mask) for s in read.sensors] == [
        (s.id, s.left.image, s.right.image, s.plate, s.mask) for s in written.sensors
    ]
    for a, b in zip(all_cameras(read), all_cameras(written), strict=True):
        for name in ("K", "dist", "cam_from_world"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
        assert a.size == b.size


def test_the_json_has_the_keys_that_other_programs_rely_on(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board", plates=True)
    content = json.loads((board.folder / "capture.json").read_text())
    assert list(content) == [
        "$schema", "schema_version", "name", "kind", "fps", "n_frames", "bounds", "object", "sensors", "held_out",
    ]  # fmt: skip
    assert list(content["sensors"][0]) == ["id", "left", "right", "plate"]
    assert list(content["sensors"][0]["left"]) == ["image", "K", "dist", "size", "cam_from_world"]
    assert content["sensors"][0]["plate"] == {"left": "S1/plate_l.png", "right": "S1/plate_r.png"}


def test_a_frame_is_red_green_blue(board: Capture) -> None:
    path = image_path(board.folder, board.sensors[0].left.image, 0)
    cv2.imwrite(str(path), np.full((SIZE[1], SIZE[0], 3), (10, 20, 200), dtype=np.uint8))  # OpenCV writes BGR
    left, right = read_frame(board, "S1", 0)
    assert left.shape == right.shape == (SIZE[1], SIZE[0], 3)
    assert left[0, 0].tolist() == [200, 20, 10]


def test_a_grey_image_has_three_equal_channels(board: Capture) -> None:
    path = image_path(board.folder, board.sensors[0].right.image, 1)
    grey = np.arange(SIZE[0] * SIZE[1], dtype=np.uint8).reshape(SIZE[1], SIZE[0])
    cv2.imwrite(str(path), grey)
    np.testing.assert_array_equal(read_frame(board, "S1", 1)[1], np.dstack([grey] * 3))


def test_masks_are_true_where_they_are_bright_and_none_without(board: Capture) -> None:
    assert read_masks(board, "S1", 0) is None
    assert read_plates(board, "S1") is None
    masked = replace(board.sensors[0], mask=("m_l{frame}.png", "m_r{frame}.png"))
    board = replace(board, sensors=(masked,))
    grey = np.tile(np.linspace(0, 255, SIZE[0]).astype(np.uint8), (SIZE[1], 1))
    for side in "lr":
        cv2.imwrite(str(board.folder / f"m_{side}1.png"), grey)
    masks = read_masks(board, "S1", 1)
    assert masks is not None
    np.testing.assert_array_equal(masks[0], grey >= 128)


def test_a_held_out_photograph_has_its_own_camera(board: Capture) -> None:
    shot = HeldOut(board_camera(33.0), "S1/left/{frame:04d}.png", 1)
    np.testing.assert_array_equal(read_held_out(board, shot), read_frame(board, "S1", 1)[0])


@given(st.integers(0, 99_999), st.integers(1, 6))
@settings(deadline=None)
def test_patterns_take_the_frame_with_and_without_leading_zeros(frame: int, width: int) -> None:
    folder = Path("capture")
    assert image_path(folder, f"a/{{frame:0{width}d}}.png", frame) == folder / f"a/{frame:0{width}d}.png"
    assert image_path(folder, "a/{frame}_x.png", frame) == folder / f"a/{frame}_x.png"


def swap_rotation(content: Content) -> None:
    content["sensors"][1]["right"]["cam_from_world"][0][0] = 0.3


def no_baseline(content: Content) -> None:
    sensor = content["sensors"][0]
    sensor["right"]["cam_from_world"] = sensor["left"]["cam_from_world"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c.update(schema_version=2), "schema_version is 2, expected 1, the version that this program reads"),
        (lambda c: c.pop("schema_version"), "schema_version is missing"),
        (lambda c: c.update(name=""), "name: '' is no name for files"),
        (lambda c: c.update(name="../ball"), "name: '../ball' is no name for files"),  # films lie in DATASET/
        (lambda c: c.update(name="/ball"), "name: '/ball' is no name for files"),
        (lambda c: c.update(name="two\nlines"), "is no name for files"),
        (lambda c: c.update(kind="film"), "kind is 'film', expected one of scene, sphere, cuboid"),
        (lambda c: c.update(fps=0), "fps is 0, expected a positive number"),
        (lambda c: c.update(fps="25"), "fps is '25'"),
        (lambda c: c.update(n_frames=0), "n_frames is 0, expected a whole number of at least 1"),
        (lambda c: c.update(n_frames=2.5), "n_frames is 2.5"),
        (lambda c: c.update(n_frames=True), "n_frames is True"),
        (lambda c: c["bounds"].reverse(), "bounds: the lowest corner [70.0, 70.0, 15.0] is not below the highest"),
        (lambda c: c["bounds"][0].pop(), "bounds"),
        (lambda c: c.update(bounds=None), "bounds is"),
        (lambda c: c.update(object={"radius_mm": -5}), "radius_mm is -5"),
        (lambda c: c.update(object={"size_mm": [1, 2]}), "size_mm is [1, 2], expected three positive numbers"),
        (lambda c: c.update(sensors=[]), "sensors is [], expected a list of at least one sensor"),
        (lambda c: c.update(sensors="S1"), "sensors is 'S1', expected a list"),
        (lambda c: c["sensors"][1].update(id="S1"), "sensor ids must differ, found S1, S1"),
        (lambda c: c["sensors"][1].update(id="../S1"), "sensor id '../S1' is no file name"),
        (lambda c: c["sensors"][1].pop("left"), "sensor S2: left is missing"),
        (lambda c: c["sensors"][1]["left"].pop("K"), "sensor S2, left: K is missing"),
        (lambda c: c["sensors"][1]["left"].update(K=[[1, 2], [3]]), "K is [[1, 2], [3]], expected three rows of three"),
        (lambda c: c["sensors"][1]["left"].update(size=[160.5, 120]), "size is [160.5, 120], expected [width, height]"),
        (lambda c: c["sensors"][1]["left"].update(size=[320, 240]), "sensor S2: left is (320, 240), right (160, 120)"),
        (swap_rotation, "sensor S2, right: cam_from_world is not a rigid transform"),
        (no_baseline, "sensor S1: the baseline is 0 mm"),
        (lambda c: c["sensors"][0]["left"].update(image="/etc/a.png"), "path '/etc/a.png' leaves the capture's folder"),
        (lambda c: c["sensors"][0]["left"].update(image="a/../../b.png"), "leaves the capture's folder"),
        (lambda c: c["sensors"][0]["left"].update(image="C:\\b.png"), "leaves the capture's folder"),
        (lambda c: c["sensors"][0].update(mask={"left": "../a.png", "right": "b.png"}), "'../a.png' leaves"),
        (lambda c: c["sensors"][0]["left"].update(image="{frame.__class__}.png"), "the only placeholder is {frame}"),
        (lambda c: c["sensors"][0]["left"].update(image="{frame:04d}.txt"), "ends in '.txt', expected one of .png"),
        (lambda c: c["sensors"][0]["left"].update(image="left.png"), "left.png names one image for 2 frames"),
        (lambda c: c.update(fps=1e-300), "fps: is 1e-300, expected at least 1e-06"),
        (lambda c: c.update(fps=1e308), "fps is 1e+308, expected a positive number up to 1e+06"),
        (lambda c: c.update(n_frames=10**18), "expected at most 1000000"),
        (lambda c: c.update(object={"radius_mm": 1e308}), "object: radius_mm is 1e+308, expected"),
        (lambda c: c["sensors"][0]["left"].update(dist=[1e308, 0, 0, 0]), "sensor S1, left: dist[0] is 1e+308"),
        (lambda c: c["sensors"][0]["left"].update(image=7), "image is 7, expected a text"),
        (lambda c: c["sensors"][0].update(plate={"left": "a.png"}), "sensor S1: plate: right is missing"),
        (lambda c: c.update(held_out=[{"image": "a.png", "frame": 0}]), "held_out a.png: K is missing"),
        (lambda c: c.update(held_out=[{**c["sensors"][0]["left"], "frame": 2}]), "frame 2 of a capture of 2 frames"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_in_one_sentence(
    board: Capture, change: Callable[[Content], object], message: str
) -> None:
    folder = changed(board, change)
    with pytest.raises(CaptureError, match=re.escape(message)) as raised:
        read_capture(folder)
    assert "capture.json" in str(raised.value)
    assert "\n" not in str(raised.value)


def test_everything_that_is_wrong_is_collected(board: Capture) -> None:
    def spoil(content: Content) -> None:
        content.update(kind="film", fps=-1)
        content["sensors"][0]["left"]["size"] = []
        swap_rotation(content)

    draft = read_draft(changed(board, spoil))
    assert draft.capture is None
    assert len(draft.problems) == 4
    assert (len(draft.cameras), len(draft.sensors)) == (2, 0)
    with pytest.raises(CaptureError, match=r"kind is 'film'.*3 more"):
        read_capture(board.folder)


@pytest.mark.parametrize(
    ("content", "message"), [(None, "there is no such file"), ("{", "not readable as JSON"), ("[]", "holds a list")]
)
def test_a_capture_without_its_json_is_named(tmp_path: Path, content: str | None, message: str) -> None:
    if content is not None:
        (tmp_path / "capture.json").write_text(content)
    with pytest.raises(CaptureError, match=message):
        read_capture(tmp_path)


def test_a_missing_image_is_named_before_any_work_begins(board: Capture) -> None:
    missing = image_path(board.folder, board.sensors[1].right.image, 1)
    missing.unlink()
    with pytest.raises(CaptureError, match=f"{missing}: there is no such file"):
        read_capture(board.folder)


def test_an_image_of_another_size_than_its_calibration_is_named(board: Capture) -> None:
    path = image_path(board.folder, board.sensors[0].left.image, 1)
    cv2.imwrite(str(path), np.zeros((60, 80, 3), dtype=np.uint8))
    with pytest.raises(CaptureError, match=f"{path}: is 80x60 pixels, its calibration is for 160x120"):
        read_frame(board, "S1", 1)


def test_a_frame_or_sensor_that_is_not_there_is_named(board: Capture) -> None:
    with pytest.raises(CaptureError, match="no frame 2, frames are 0 to 1"):
        read_frame(board, "S1", 2)
    with pytest.raises(CaptureError, match="no sensor 'S9', there are S1, S2"):
        read_frame(board, "S9", 0)


def test_a_failed_write_leaves_the_old_capture(board: Capture) -> None:
    before = (board.folder / "capture.json").read_bytes()
    with pytest.raises(ValueError, match="JSON compliant"):
        write_capture(replace(board, object={"note": float("nan")}))
    assert (board.folder / "capture.json").read_bytes() == before
    assert not list(board.folder.glob(".*"))


def test_cameras_of_different_sizes_cannot_be_put_into_a_sensor(board: Capture) -> None:
    other = replace(board.sensors[0].right, camera=Camera(np.diag([9.0, 9, 1]), (10, 10), np.eye(4)))
    with pytest.raises(CaptureError, match="sizes must be equal"):
        SensorStream("S1", board.sensors[0].left, other)


def test_the_rig_has_the_sensors_in_their_order(board: Capture) -> None:
    assert [sensor.id for sensor in board.rig.sensors] == ["S1", "S2"]


@pytest.mark.parametrize("place", ["camera", "sensor", "file"])
@pytest.mark.parametrize("key", ["distortion_model", "camera_model"])
def test_a_lens_that_the_numbers_of_a_capture_do_not_mean_is_refused_by_name(
    tmp_path: Path, place: str, key: str
) -> None:
    from_opencv(tmp_path)
    path = tmp_path / "out/capture.json"
    content = json.loads(path.read_text())
    part = {"camera": content["sensors"][0]["left"], "sensor": content["sensors"][0], "file": content}[place]
    part[key] = "equidistant"
    path.write_text(json.dumps(content))
    with pytest.raises(CaptureError, match=f"{key}:? is equidistant, which the numbers of a capture"):
        read_capture(tmp_path / "out")
    part[key] = "plumb_bob"
    path.write_text(json.dumps(content))
    assert read_capture(tmp_path / "out").n_frames == 2
