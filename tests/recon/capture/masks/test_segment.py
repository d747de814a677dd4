from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from recon.capture.format import Capture, CaptureError, image_path, read_capture, read_masks
from recon.capture.importing.middlebury import import_middlebury
from recon.capture.masks import evidence, segment
from recon.capture.masks.evidence import dark_background_threshold
from recon.capture.masks.segment import CleanUp, clean_mask, mask_on_dark, segment_capture
from recon.runtime.files import read_json, write_json
from recon.runtime.workers import no_progress
from recon.studio import SynthParameters, synthesise
from tests.recon.capture.calibration.board_geometry import BOARD_BOUNDS, SIZE, board_view, record_board
from tests.recon.capture.masks.drawn_scribbles import intersection_over_union, write_strokes


def true_masks(capture: Capture, sensor_id: str, frame: int) -> list[NDArray[np.bool_]]:
    stream, white = capture.stream(sensor_id), np.full((200, 200, 3), 255, dtype=np.uint8)
    return [board_view(side.camera, white, shift_mm=3.0 * frame)[..., 0] > 128 for side in (stream.left, stream.right)]


def overlap(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return float((a & b).sum() / (a | b).sum())


def assert_masks_are_true(capture: Capture, at_least: float) -> None:
    for stream in capture.sensors:
        for frame in range(capture.n_frames):
            masks = read_masks(capture, stream.id, frame)
            assert masks is not None
            for mask, truth in zip(masks, true_masks(capture, stream.id, frame), strict=True):
                assert overlap(mask, truth) > at_least


def add_noise(capture: Capture, deviation: float) -> None:
    rng = np.random.default_rng(5)
    for path in sorted(capture.folder.rglob("*.png")):
        image = cv2.imread(str(path)) + rng.normal(0.0, deviation, (SIZE[1], SIZE[0], 3))
        cv2.imwrite(str(path), image.clip(0, 255).astype(np.uint8))


def brighten_background(capture: Capture) -> None:
    """A background as bright as the board, with a step in it, in pictures and plates."""
    background = np.full((SIZE[1], SIZE[0], 3), 150, dtype=np.uint8)
    background[:, 60:] = 210
    for stream in capture.sensors:
        for frame in range(capture.n_frames):
            truths = true_masks(capture, stream.id, frame)
            for side, truth in zip((stream.left, stream.right), truths, strict=True):
                path = str(image_path(capture.folder, side.image, frame))
                cv2.imwrite(path, np.where(truth[..., None], cv2.imread(path), background))
        for name in stream.plate or ():
            cv2.imwrite(str(capture.folder / name), background)


@pytest.mark.parametrize("noise", [0.0, 4.0])
def test_the_board_is_found_before_a_dark_background(tmp_path: Path, noise: float) -> None:
    board = record_board(tmp_path / "board")
    add_noise(board, noise)
    segment_capture(board.folder)
    assert_masks_are_true(read_capture(board.folder), at_least=0.95)


@pytest.mark.parametrize("noise", [0.0, 3.0])
def test_the_board_is_found_before_a_bright_background_with_a_clean_plate(tmp_path: Path, noise: float) -> None:
    board = record_board(tmp_path / "board", plates=True)
    brighten_background(board)
    add_noise(board, noise)
    segment_capture(board.folder)
    assert_masks_are_true(read_capture(board.folder), at_least=0.93)


def test_a_soft_shadow_on_the_background_is_not_foreground(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board", plates=True)
    brighten_background(board)
    for stream in board.sensors:
        for frame in range(board.n_frames):
            truths = true_masks(board, stream.id, frame)
            for side, truth in zip((stream.left, stream.right), truths, strict=True):
                path = str(image_path(board.folder, side.image, frame))
                shaded = np.where(truth[..., None], 1.0, np.linspace(0.7, 1.0, SIZE[0])[:, None]) * cv2.imread(path)
                cv2.imwrite(path, shaded.astype(np.uint8))
    segment_capture(board.folder)
    assert_masks_are_true(read_capture(board.folder), at_least=0.93)


@pytest.mark.slow
def test_masks_are_named_in_the_capture_and_nothing_else_changes(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board")
    seen: list[tuple[str, int, int]] = []
    made = segment_capture(board.folder, threshold=40, progress=lambda *step: seen.append(step))
    assert [stream.mask for stream in made.sensors] == [
        (f"{name}/mask/left/{{frame:04d}}.png", f"{name}/mask/right/{{frame:04d}}.png") for name in ("S1", "S2")
    ]
    assert seen == [("masks", n, 8) for n in range(1, 9)]
    assert not list(board.folder.glob(".*"))
    np.testing.assert_array_equal(read_capture(board.folder).bounds, BOARD_BOUNDS)
    again = segment_capture(board.folder, threshold=40)
    assert [stream.mask for stream in again.sensors] == [stream.mask for stream in made.sensors]


def test_what_others_wrote_into_a_capture_stays_when_masks_are_named(tmp_path: Path) -> None:
    path = record_board(tmp_path / "board").folder / "capture.json"
    content = read_json(path)
    content["sensors"][1]["serial"] = "A-17"
    write_json(path, content | {"note": "the second take"})
    segment_capture(path.parent)
    again = read_json(path)
    assert again.pop("note") == "the second take"
    assert [sensor.pop("mask")["left"] for sensor in again["sensors"]] == [
        f"{name}/mask/left/{{frame:04d}}.png" for name in ("S1", "S2")
    ]
    assert again == content


def test_masks_that_were_deleted_are_made_again(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board")
    segment_capture(board.folder)
    shutil.rmtree(board.folder / "S1" / "mask")
    segment_capture(board.folder)
    assert_masks_are_true(read_capture(board.folder), at_least=0.95)


@pytest.mark.slow
def test_masks_do_not_depend_on_how_many_frames_are_segmented_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synthesise(tmp_path / "studio", SynthParameters(scene="standing", n_frames=4, size=(160, 90)), progress=no_progress)
    written = {}
    for at_once in (1, 4):
        monkeypatch.setattr(segment, "FRAMES_AT_ONCE", at_once)
        segment_capture(tmp_path / "studio")
        written[at_once] = {path: path.read_bytes() for path in sorted(tmp_path.rglob("mask/*/*.png"))}
    assert written[1] == written[4]
    assert len(written[1]) == 3 * 2 * 4


def test_a_failure_leaves_the_capture_as_it_was(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board")
    before = (board.folder / "capture.json").read_bytes()
    last = image_path(board.folder, board.sensors[1].right.image, 1)
    cv2.imwrite(str(last), np.zeros((SIZE[1], SIZE[0], 3), dtype=np.uint8))
    with pytest.raises(CaptureError, match=r"S2/mask/right/0001.png: no foreground is found"):
        segment_capture(board.folder, threshold=40)
    assert (board.folder / "capture.json").read_bytes() == before
    assert not list(board.folder.rglob("*mask*"))


def test_a_background_that_is_not_dark_is_not_taken_for_the_object(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board")
    brighten_background(board)
    with pytest.raises(CaptureError, match=r"S1/left, frame 0: \d+% of the picture's edge .* so the background is not"):
        segment_capture(board.folder, method="threshold")
    assert read_capture(board.folder).sensors[0].mask is None


def test_a_method_that_is_unknown_or_lacks_its_plate_is_named(tmp_path: Path) -> None:
    board = record_board(tmp_path / "board")
    with pytest.raises(CaptureError, match="method is 'magic', expected one of plate, threshold"):
        segment_capture(board.folder, method="magic")
    with pytest.raises(CaptureError, match="S1, S2 has no clean plate"):
        segment_capture(board.folder, method="plate")


def test_crevices_are_filled_and_gaps_stay() -> None:
    raw = np.zeros((100, 100), dtype=bool)
    raw[20:80, 10:90] = True
    raw[30:35, 20:25] = False  # a crevice of 25 pixels
    raw[30:70, 50:60] = False  # a gap of 400
    raw[5:8, 5:8] = True  # a speck
    mask = clean_mask(raw, CleanUp(max_hole=1e-2, min_part=1e-2))
    assert mask[30:35, 20:25].all()
    assert not mask[32:68, 52:58].any()
    assert not mask[:15].any()


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 0.8))
@settings(deadline=None, max_examples=30)
def test_a_clean_mask_has_neither_small_parts_nor_small_holes(seed: int, share: float) -> None:
    raw = np.random.default_rng(seed).random((60, 70)) < share
    smooth = cv2.GaussianBlur(raw.astype(np.float32), (0, 0), 2) > share
    mask = clean_mask(smooth, CleanUp(max_hole=0.01, min_part=0.01))
    _, _, parts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    _, _, holes, _ = cv2.connectedComponentsWithStats((~mask).astype(np.uint8), connectivity=4)
    assert (parts[1:, cv2.CC_STAT_AREA] >= 42).all()
    assert (holes[1:, cv2.CC_STAT_AREA] >= 42).all()


@given(st.integers(4, 30), st.integers(110, 220), st.floats(0.1, 0.8), st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=40)
def test_the_threshold_lies_between_a_dark_background_and_the_object(
    dark: int, bright: int, share: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    is_object = rng.random(40_000) < share
    values = np.where(is_object, rng.normal(bright, 12, 40_000), rng.normal(dark, 4, 40_000)).clip(0, 255)
    threshold = dark_background_threshold(np.bincount(values.astype(np.uint8), minlength=256))
    assert ((values > threshold) != is_object).mean() < 0.01


def test_before_a_dark_background_an_outline_lies_where_half_of_the_contrast_is_left() -> None:
    statue, cloth = np.zeros((200, 240), np.uint8), np.zeros((200, 240), np.uint8)
    cv2.circle(statue, (120, 90), 50, 1, -1)
    cv2.rectangle(cloth, (0, 170), (240, 200), 1, -1)
    clean = np.full((*statue.shape, 3), 4.0)
    clean[cloth > 0] = (46, 46, 48)
    clean[statue > 0] = (190, 160, 100)
    noise = np.random.default_rng(0).normal(0, 1.5, clean.shape)
    mask = mask_on_dark((cv2.GaussianBlur(clean, (0, 0), 1.2) + noise).clip(0, 255).astype(np.uint8))
    assert overlap(mask, statue > 0) > 0.98  # a pixel all around would be 0.96
    assert not mask[cloth > 0].any()


def test_a_picture_of_one_brightness_has_no_threshold() -> None:
    with pytest.raises(CaptureError, match="equally bright"):
        dark_background_threshold(np.bincount([7] * 100, minlength=256))


def test_a_sensor_whose_pictures_are_black_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = record_board(tmp_path / "capture")
    monkeypatch.setattr(evidence, "read_frame", lambda *_: [np.zeros((9, 9, 3), np.uint8)] * 2)
    with pytest.raises(CaptureError, match="sensor S1: all pixels are equally bright"):
        segment_capture(capture.folder, method="threshold")


def test_what_a_killed_process_of_the_same_number_left_becomes_no_mask(tmp_path: Path) -> None:
    left = tmp_path / f".masks.{os.getpid()}.part/S1/mask/left/0099.png"
    left.parent.mkdir(parents=True)
    left.touch()
    with segment._staged(tmp_path):
        pass
    assert list(tmp_path.rglob("*.png")) == []


def test_the_temples_own_shadows_belong_to_it(real_data: Path) -> None:
    """The pediment's recess and the shadow beside the capital are no brighter than the cloth under the temple."""
    picture = cv2.imread(str(real_data / "temple" / "templeR0030.png"))[..., ::-1].copy()
    mask = mask_on_dark(picture)
    assert mask[138, 523]
    assert mask[172, 448]
    assert not mask[:, :60].any()


def test_the_cloth_that_the_temple_lights_up_does_not_belong_to_it(real_data: Path) -> None:
    """Beside the base's edge, which lies at column 126, it is brighter than the threshold."""
    mask = mask_on_dark(cv2.imread(str(real_data / "temple" / "templeR0022.png"))[..., ::-1].copy())
    assert not mask[140, :125].any()
    assert mask[140, 128:180].all()


@pytest.mark.slow
def test_the_temple_is_whole_and_the_cloth_is_gone(real_data: Path, tmp_path: Path) -> None:
    capture = import_middlebury(real_data / "temple", tmp_path / "temple", n_frames=1)
    segment_capture(capture.folder)
    segmented = read_capture(capture.folder)
    axis = np.array([[28.0, y, -55.0] for y in (-20.0, 80.0)])  # in the base and in the entablature
    for stream in segmented.sensors:
        masks = read_masks(segmented, stream.id, 0)
        assert masks is not None
        for side, mask in zip((stream.left, stream.right), masks, strict=True):
            assert 0.18 < mask.mean() < 0.30
            n_parts = cv2.connectedComponents(mask.astype(np.uint8))[0] - 1
            assert n_parts == 1
            columns, rows = np.round(side.camera.project(axis)).astype(int).T
            assert mask[rows, columns].all()
            towards = (side.camera.centre - axis[0]) * (1.0, 0.0, 1.0)
            cloth = np.array([28.0, -55.0, -55.0]) + 75.0 * towards / np.linalg.norm(towards)
            column, row = np.round(side.camera.project(cloth[None])[0]).astype(int)
            assert not mask[row, column]


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["people", "face"])
def test_people_of_the_studio_are_found_by_their_clean_plate(scene: str, tmp_path: Path) -> None:
    capture = synthesise(tmp_path / scene, SynthParameters(scene, n_sensors=1, n_frames=2, size=(960, 540), seed=2))
    assert np.mean(intersection_over_union(segment_capture(capture.folder))) > 0.965  # of 20 frames 0.97: bench


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["box", "standing"])
def test_people_of_the_studio_are_found_by_strokes_on_another_frame(scene: str, tmp_path: Path) -> None:
    capture = synthesise(tmp_path / scene, SynthParameters(scene, n_sensors=1, n_frames=7, size=(480, 270), seed=2))
    strokes = write_strokes(tmp_path / "strokes", capture, frame=3)
    assert np.mean(intersection_over_union(segment_capture(capture.folder, scribbles=strokes))) > 0.94
