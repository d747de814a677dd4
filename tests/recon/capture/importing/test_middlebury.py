from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.capture.checking.check import check_capture
from recon.capture.format import CaptureError, read_capture, read_frame, read_held_out
from recon.capture.importing.middlebury import import_middlebury
from recon.geometry.rig import bounds_corners, look_at
from recon.runtime.notices import Notice
from tests.command_line import Command

SIZE = (40, 30)
N_VIEWS = 8
K = [[50.0, 0, 19.5], [0, 51.0, 14.5], [0, 0, 1]]
PAIRS = [(1, 2), (4, 5)]


def ring(folder: Path, *, bent: int | None = None, n_views: int = N_VIEWS) -> Path:
    """A data set of views 10 degrees apart around the y axis, 0.6 m away; view n is a picture of grey level 20 n."""
    folder.mkdir()
    lines = [str(n_views)]
    for view in range(1, n_views + 1):
        angle = np.deg2rad(10.0 * view + (1.5 if view == bent else 0.0))
        pose = look_at((0.6 * np.sin(angle), 0.0, 0.6 * np.cos(angle)), (0.0, 0.0, 0.0))
        numbers = [*np.ravel(K), *pose[:3, :3].ravel(), *pose[:3, 3]]
        lines.append(f"ringR{view:04d}.png " + " ".join(f"{number:.12f}" for number in numbers))
        cv2.imwrite(str(folder / f"ringR{view:04d}.png"), np.full((SIZE[1], SIZE[0], 3), 20 * view, dtype=np.uint8))
    (folder / "ring_par.txt").write_text("\n".join(lines) + "\n")
    (folder / "README.txt").write_text("The bounding box is\n(-0.05 -0.06 -0.07)\n(0.05 0.08 0.07)\n")
    return folder


def test_frames_are_the_next_views_with_the_first_calibration(tmp_path: Path) -> None:
    out = tmp_path / "capture"
    listing = ring(tmp_path / "ring") / "ring_par.txt"
    listing.write_text("\ufeff# of a ring\n\n" + listing.read_text())
    made = import_middlebury(listing.parent, out, pairs=PAIRS, n_frames=3)
    capture = read_capture(out)
    assert (capture.name, capture.kind, capture.n_frames) == ("ring", "scene", 3)
    assert made.folder == out
    for stream, pair in zip(capture.sensors, PAIRS, strict=True):
        for frame in range(3):
            greys = [image[0, 0, 0] for image in read_frame(capture, stream.id, frame)]
            assert greys == [20 * (view + frame) for view in pair]
        centre = stream.left.camera.centre
        assert np.rad2deg(np.arctan2(centre[0], centre[2])) == pytest.approx(10.0 * pair[0])
        assert np.linalg.norm(centre) == pytest.approx(600.0)  # millimetres


def test_views_that_frame_0_does_not_use_are_held_out_with_their_own_calibration(tmp_path: Path) -> None:
    capture = import_middlebury(ring(tmp_path / "ring"), tmp_path / "capture", pairs=PAIRS, n_frames=2)
    assert [shot.image for shot in capture.held_out] == [f"held_out/ringR{view:04d}.png" for view in (3, 6, 7, 8)]
    for shot, view in zip(capture.held_out, (3, 6, 7, 8), strict=True):
        assert shot.frame == 0
        assert read_held_out(capture, shot)[0, 0, 0] == 20 * view
        assert np.rad2deg(np.arctan2(shot.camera.centre[0], shot.camera.centre[2])) == pytest.approx(10.0 * view)


def test_the_published_box_is_turned_with_the_object(tmp_path: Path) -> None:
    source = ring(tmp_path / "ring")
    tight = np.array([[-50.0, -60, -70], [50, 80, 70]])
    still = import_middlebury(source, tmp_path / "still", pairs=PAIRS, n_frames=1)
    moving = import_middlebury(source, tmp_path / "moving", pairs=PAIRS, n_frames=3)
    np.testing.assert_allclose(still.bounds, np.add(tight, [[-4.2], [4.2]]), atol=1e-6)  # 3 % of 140 mm
    angle = np.deg2rad(-20.0)  # two views further, the object has turned back by as much
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    turned = bounds_corners(tight) @ turn.T
    assert (moving.bounds[0] <= turned.min(axis=0)).all()
    assert (moving.bounds[1] >= turned.max(axis=0)).all()
    np.testing.assert_allclose(moving.bounds[:, 1], still.bounds[:, 1], atol=1e-6)


def test_given_bounds_are_taken_as_they_are(tmp_path: Path) -> None:
    bounds = [[-10.0, -20, -30], [10, 20, 30]]
    capture = import_middlebury(ring(tmp_path / "ring"), tmp_path / "c", pairs=PAIRS, n_frames=2, bounds=bounds)
    np.testing.assert_array_equal(capture.bounds, bounds)


def test_views_whose_relative_poses_differ_are_no_rig(tmp_path: Path) -> None:
    source = ring(tmp_path / "ring", bent=6)
    with pytest.raises(CaptureError, match=r"ringR0006.png: as frame 1 of view 5 it is off by \d\.\d\d px"):
        import_middlebury(source, tmp_path / "capture", pairs=PAIRS, n_frames=2)
    import_middlebury(source, tmp_path / "still", pairs=PAIRS, n_frames=1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("N_VIEWS", "line 1: announces '9' views, 8 lines follow"),
        ("short", "line 3: 20 numbers after the name, expected 21"),
        ("word", "line 3: 'far' stands where a number is expected"),
        ("scaled", "line 3: cam_from_world is not a rigid transform"),
        ("twice", "line 3: view 1 is listed twice"),
        ("unnumbered", "line 3: the name 'ring.png' does not end with the view's number"),
    ],
)
def test_a_wrong_calibration_file_is_named_with_the_line(tmp_path: Path, change: str, message: str) -> None:
    source = ring(tmp_path / "ring")
    path = source / "ring_par.txt"
    lines = path.read_text().splitlines()
    words = lines[2].split()
    lines[0] = "9" if change == "N_VIEWS" else lines[0]
    lines[2] = " ".join(
        {
            "short": words[:-1],
            "word": [*words[:-1], "far"],
            "scaled": [*words[:10], "3.0", *words[11:]],
            "twice": ["ringR0001.png", *words[1:]],
            "unnumbered": ["ring.png", *words[1:]],
        }.get(change, words)
    )
    path.write_text("\n".join(lines))
    with pytest.raises(CaptureError, match=re.escape(message)):
        import_middlebury(source, tmp_path / "capture", pairs=PAIRS, n_frames=1)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["ring"]


def test_pictures_that_are_listed_and_absent_are_named_and_the_rest_is_imported(tmp_path: Path) -> None:
    source = ring(tmp_path / "ring")
    for view in (7, 8):
        (source / f"ringR{view:04d}.png").unlink()
    with pytest.warns(match=r"pictures that are not there.*ringR0007\.png, ringR0008\.png"):
        capture = import_middlebury(source, tmp_path / "out", pairs=PAIRS, n_frames=1)
    assert [photograph.image for photograph in capture.held_out] == ["held_out/ringR0003.png", "held_out/ringR0006.png"]
    with (
        pytest.warns(Notice),
        pytest.raises(CaptureError, match=r"need views \[7\], .* or whose pictures are not there"),
    ):
        import_middlebury(source, tmp_path / "again", pairs=[(6, 7)], n_frames=1)


def test_the_unit_and_the_axis_that_it_has_may_be_named(command: Command, tmp_path: Path) -> None:
    where = (ring(tmp_path / "ring"), tmp_path / "out", "--pairs", "1-2", "--frames", 1)
    told = command("capture", "import", "middlebury", *where, "--units", "m", "--up", "y")
    assert told.code == 0, told.err


def test_views_that_are_not_listed_are_named(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=re.escape("need views [9, 10], which it does not list")):
        import_middlebury(ring(tmp_path / "ring"), tmp_path / "capture", pairs=[(1, 2), (7, 8)], n_frames=3)


def test_a_source_without_calibration_or_bounds_is_named(tmp_path: Path) -> None:
    source = ring(tmp_path / "ring")
    (source / "README.txt").unlink()
    with pytest.raises(CaptureError, match="no text file holds a bounding box"):
        import_middlebury(source, tmp_path / "capture", pairs=PAIRS, n_frames=1)
    (source / "ring_par.txt").unlink()
    with pytest.raises(CaptureError, match=re.escape("holds 0 files *_par.txt")):
        import_middlebury(source, tmp_path / "capture", pairs=PAIRS)
    with pytest.raises(ValueError, match="there is no such file or folder"):
        import_middlebury(tmp_path / "nowhere", tmp_path / "capture", pairs=PAIRS)


def test_nothing_is_overwritten_and_nothing_half_written_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, out = ring(tmp_path / "ring"), tmp_path / "capture"
    out.mkdir()
    (out / "mine.txt").write_text("keep")
    with pytest.raises(ValueError, match="exists already"):
        import_middlebury(source, out, pairs=PAIRS, n_frames=1)
    (out / "mine.txt").unlink()

    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("recon.capture.importing.into_capture.write_capture", full_disk)
    with pytest.raises(OSError, match="No space"):
        import_middlebury(source, out, pairs=PAIRS, n_frames=1)
    assert list(out.iterdir()) == []
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["capture", "ring"]
    monkeypatch.undo()
    import_middlebury(source, out, pairs=PAIRS, n_frames=1)
    assert (out / "capture.json").is_file()


@pytest.mark.slow
def test_the_temple_becomes_three_sensors_whose_rows_agree(real_data: Path, tmp_path: Path) -> None:
    capture = import_middlebury(real_data / "temple", tmp_path / "temple")
    assert [stream.id for stream in capture.sensors] == ["S1", "S2", "S3"]
    assert len(capture.held_out) == 6
    for stream in capture.sensors:
        assert stream.sensor.baseline == pytest.approx(75.17, abs=0.01)
    checked = check_capture(capture.folder)
    assert checked.problems == ()
    for report in checked.sensors:
        assert report.rows is not None
        assert report.rows.n_matches > 500
        assert report.rows.vertical_error_px is not None
        assert report.rows.vertical_error_px < 0.15, report.id
