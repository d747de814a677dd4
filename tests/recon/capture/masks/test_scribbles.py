from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.capture.format import Capture, CaptureError, image_path, read_capture, read_masks
from recon.capture.masks.scribbles import read_scribbles
from recon.capture.masks.segment import segment_capture, try_strokes
from tests.recon.capture.calibration.board_geometry import SIZE, record_board

N_FRAMES = 5
KEY = 2


@pytest.fixture
def ball(tmp_path: Path) -> Capture:
    """A ball that moves by 6 pixels a frame before a striped background as bright as itself."""
    capture = record_board(tmp_path / "ball", n_sensors=1, n_frames=N_FRAMES)
    for side in ("left", "right"):
        for frame in range(N_FRAMES):
            path = image_path(capture.folder, getattr(capture.sensors[0], side).image, frame)
            cv2.imwrite(str(path), picture(frame))
    return capture


def truth(frame: int) -> NDArray[np.bool_]:
    disc = cv2.circle(np.zeros((SIZE[1], SIZE[0]), dtype=np.uint8), (50 + 6 * frame, 60), 28, 1, -1)
    return np.asarray(disc > 0)


def picture(frame: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(frame)
    row, column = np.indices((SIZE[1], SIZE[0]))
    stripes = np.stack([90 + 0 * row, 110 + 30 * np.sin(column / 5), 60 + 0 * row], axis=-1)
    spots = 30 * np.sin((column - 6 * frame) / 3) * np.sin(row / 4)
    inside = np.stack([60 + spots, 80 + spots, 180 + spots], axis=-1)
    shown = np.where(truth(frame)[..., None], inside, stripes) + rng.normal(0, 3, (*row.shape, 3))
    return np.asarray(shown.clip(0, 255), dtype=np.uint8)


def strokes() -> list[dict[str, Any]]:
    x = 50 + 6 * KEY
    drawn = []
    for side in ("left", "right"):
        place = {"sensor": "S1", "side": side, "frame": KEY}
        drawn.append(
            {**place, "label": "foreground", "points": [[x - 22, 60], [x + 22, 60], [x, 40], [x, 80]], "width": 5}
        )
        drawn.append(
            {
                **place,
                "label": "background",
                "points": [[x - 45, 20], [x + 45, 20], [x + 45, 105], [x - 45, 105], [x - 45, 20]],
            }
        )
    return drawn


def write_json(path: Path, entries: list[dict[str, Any]]) -> Path:
    path.write_text(json.dumps({"strokes": entries}))
    return path


def assert_masks_are_true(capture: Capture) -> None:
    for frame in range(N_FRAMES):
        masks = read_masks(read_capture(capture.folder), "S1", frame)
        assert masks is not None
        for mask in masks:
            assert (mask & truth(frame)).sum() / (mask | truth(frame)).sum() > 0.93, frame


def test_strokes_on_one_frame_make_the_masks_of_all(ball: Capture, tmp_path: Path) -> None:
    segment_capture(ball.folder, scribbles=write_json(tmp_path / "strokes.json", strokes()))
    assert_masks_are_true(ball)


def test_painted_pictures_do_the_same_whatever_the_case_of_their_suffix(ball: Capture, tmp_path: Path) -> None:
    x = 50 + 6 * KEY
    for side, suffix in (("left", ".png"), ("right", ".PNG")):
        paint = cv2.line(np.zeros((SIZE[1], SIZE[0], 3), dtype=np.uint8), (x - 15, 60), (x + 15, 60), (0, 255, 0), 5)
        paint = cv2.circle(paint, (x, 60), 42, (0, 0, 255), 3)  # BGR: a red ring
        path = tmp_path / "paint/S1" / side / f"{KEY:04d}.png"
        path.parent.mkdir(parents=True)
        cv2.imwrite(str(path), paint)
        path.rename(path.with_suffix(suffix))
    segment_capture(ball.folder, scribbles=tmp_path / "paint")
    assert_masks_are_true(ball)


def test_scribbles_of_the_wrong_size_are_named(ball: Capture, tmp_path: Path) -> None:
    path = tmp_path / "paint/S1/left/0.png"
    path.parent.mkdir(parents=True)
    cv2.imwrite(str(path), np.zeros((50, 60, 3), dtype=np.uint8))
    before = sorted(ball.folder.rglob("*"))
    with pytest.raises(CaptureError, match=r"0\.png: scribbles are 60x50 pixels, the camera's pictures 160x120"):
        segment_capture(ball.folder, scribbles=tmp_path / "paint")
    assert read_capture(ball.folder).sensors[0].mask is None
    assert sorted(ball.folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda entries: entries.pop(1), "S1/left, frame 2 has no background stroke"),
        (lambda entries: entries.__delitem__(slice(0, 2)), "no strokes for S1/left"),
        (lambda entries: entries[0].update(frame=9), "stroke 1: .*no frame '9', frames are 0 to 4"),
        (lambda entries: entries[0].update(label="sky"), "'sky', expected one of foreground, background"),
        (lambda entries: entries[0].update(sensor="S9"), "there is no sensor 'S9'"),
        (lambda entries: entries[0].update(points=[[1, 2], [500, 2]]), "outside the picture of 160x120"),
        (lambda entries: entries[0].update(points=[[float("nan"), 2], [5, 2]]), "outside the picture of 160x120"),
        (lambda entries: entries[0].pop("points"), "stroke 1: points is missing"),
        (lambda entries: entries[0].update(points=[[9, 9, 0], [30, 30, 0]]), "stroke 1: points has shape .2, 3."),
        (lambda entries: entries[0].update(points=[]), "stroke 1: points has shape .0,."),
        (lambda entries: entries[0].update(width=-1), "stroke 1: width is -1, expected 1 to 1000 pixels"),
        (lambda entries: entries[0].update(width=float("inf")), "stroke 1: width is inf"),
        (lambda entries: entries[0].update(width="thick"), "stroke 1: "),
    ],
)
def test_what_is_wrong_in_scribbles_is_named(
    ball: Capture, tmp_path: Path, change: Callable[[list[dict[str, Any]]], Any], message: str
) -> None:
    entries = strokes()
    change(entries)
    with pytest.raises(CaptureError, match=message):
        read_scribbles(write_json(tmp_path / "strokes.json", entries), ball)


def test_a_stroke_of_one_point_is_a_dot(ball: Capture, tmp_path: Path) -> None:
    entries = strokes()
    entries[0].update(points=[[62, 60]], width=5)
    labels = read_scribbles(write_json(tmp_path / "strokes.json", entries), ball)["S1", "left"][KEY]
    rows, columns = np.nonzero(labels == cv2.GC_FGD)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (57, 63, 59, 65)  # round, as the ends of lines


def test_strokes_that_are_no_list_are_named(ball: Capture, tmp_path: Path) -> None:
    (tmp_path / "strokes.json").write_text('{"strokes": 5}', encoding="utf-8")
    with pytest.raises(CaptureError, match=r"strokes\.json: strokes is 5, expected a list"):
        read_scribbles(tmp_path / "strokes.json", ball)


def test_a_tried_mask_is_a_png_beside_the_picture_and_not_the_picture_itself(ball: Capture, tmp_path: Path) -> None:
    path = write_json(tmp_path / "strokes.json", strokes())
    recorded = image_path(ball.folder, ball.sensors[0].left.image, KEY)
    before = recorded.read_bytes()
    for out, complaint in ((tmp_path / "mask", "unknown kind of file, expected .* in .png"), (recorded, "are read")):
        with pytest.raises(ValueError, match=complaint):
            try_strokes(ball.folder, path, ("S1", "left", KEY), out)
    assert recorded.read_bytes() == before


def test_trying_strokes_overwrites_neither_other_pictures_nor_the_strokes(ball: Capture, tmp_path: Path) -> None:
    drawn = tmp_path / "strokes/S1/left" / f"{KEY}.png"
    drawn.parent.mkdir(parents=True)
    other = image_path(ball.folder, ball.sensors[0].left.image, KEY + 1)
    drawn.write_bytes(other.read_bytes())
    for out in (drawn, other):
        with pytest.raises(ValueError, match="is one of the files that are read"):
            try_strokes(ball.folder, tmp_path / "strokes", ("S1", "left", KEY), out)


def test_strokes_that_are_not_there_are_named(ball: Capture, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"gone\.json: there is no such file or folder"):
        read_scribbles(tmp_path / "gone.json", ball)


def test_strokes_are_tried_on_one_picture_before_other_cameras_have_some(ball: Capture, tmp_path: Path) -> None:
    path, out = write_json(tmp_path / "strokes.json", strokes()[:2]), tmp_path / "mask.png"
    mask = try_strokes(ball.folder, path, ("S1", "left", KEY), out)
    assert (mask ^ truth(KEY)).sum() < 0.05 * truth(KEY).sum()
    assert (cv2.imread(str(out), cv2.IMREAD_GRAYSCALE) == 255 * mask).all()
    assert read_capture(ball.folder).sensors[0].mask is None
    for place, complaint in ((("S1", "right", KEY), "no strokes for"), (("S1", "left", 9), "has no picture S1/left")):
        with pytest.raises(CaptureError, match=complaint):
            try_strokes(ball.folder, path, place, out)
