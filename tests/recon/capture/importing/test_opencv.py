"""Recordings with OpenCV's calibration files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from recon.capture.format import CaptureError, read_frame
from recon.capture.importing.calibrations.stereo_entry import stereo_sensor
from recon.capture.importing.formats import find_format
from recon.capture.importing.opencv import import_opencv, write_calibration
from recon.geometry.rig import Rig
from tests.recon.capture.importing.labelled_recording import (
    OPTIONS,
    POINTS,
    RIG,
    TURNED,
    record,
    seen,
    write_picture,
    write_video,
)


def test_a_flat_opencv_file_puts_the_world_into_the_left_camera_with_y_up(tmp_path: Path) -> None:
    left, right = RIG.sensors[0].left, RIG.sensors[0].right
    relative = right.cam_from_world @ np.linalg.inv(left.cam_from_world)
    for name, keys in (("intrinsics", ("M1", "D1", "M2", "D2")), ("extrinsics", ("R", "T"))):
        storage = cv2.FileStorage(str(tmp_path / f"{name}.yml"), cv2.FILE_STORAGE_WRITE)
        values = (left.K, left.dist[None], right.K, right.dist[None], relative[:3, :3], relative[:3, 3:] / 10.0)
        named = dict(zip(("M1", "D1", "M2", "D2", "R", "T"), values, strict=True))
        for key in keys:
            storage.write(key, named[key])
        storage.release()
    write_video(tmp_path / "left.avi", [10, 20, 30])
    write_video(tmp_path / "right.avi", [15, 25, 35])
    capture = import_opencv(tmp_path, tmp_path / "out", replace(OPTIONS, unit_mm=10.0))
    in_world = left.points_in_camera(POINTS) @ TURNED.T
    stream = capture.sensors[0]
    np.testing.assert_allclose(seen(stream.left.camera, in_world), seen(left, POINTS), atol=1e-6)
    np.testing.assert_allclose(seen(stream.right.camera, in_world), seen(right, POINTS), atol=1e-6)
    assert (capture.n_frames, capture.fps) == (3, 25.0)
    assert [int(image[0, 0, 0]) for image in read_frame(capture, "S1", 2)] == [30, 35]


@pytest.mark.parametrize("n_sensors", [1, 2])
def test_a_written_calibration_is_read_back(tmp_path: Path, n_sensors: int) -> None:
    rig = Rig(RIG.sensors[:n_sensors])
    record(tmp_path)
    write_calibration(tmp_path / "calibration.yml", rig)
    again = import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    for sensor, found in zip(rig.sensors, again.rig.sensors, strict=True):
        np.testing.assert_allclose(seen(found.right, POINTS), seen(sensor.right, POINTS), atol=1e-6)
        np.testing.assert_allclose(found.left.cam_from_world, sensor.left.cam_from_world, atol=1e-9)


def test_a_job_of_the_server_reads_no_photograph_elsewhere_that_a_calibration_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "source"
    record(source)
    write_picture(tmp_path / "elsewhere.png", 5)
    write_calibration(source / "calibration.yml", RIG)
    with (source / "calibration.yml").open("a") as file:
        file.write('held_out:\n   - { image: "../elsewhere.png" }\n')
    monkeypatch.setenv("RECONSTUDY_FILES_BELOW", str(source))
    with pytest.raises(ValueError, match="lies outside the server's folders"):
        import_opencv(source, tmp_path / "out", OPTIONS)


def test_what_is_wrong_in_an_opencv_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="holds no calibration file"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    for sensor in ("S1", "S2"):
        (tmp_path / "apart" / sensor).mkdir(parents=True)
        (tmp_path / "apart" / sensor / "calibration.yml").touch()
    with pytest.raises(CaptureError, match="but in S1, S2: name one of these folders, or write one file"):
        import_opencv(tmp_path / "apart", tmp_path / "out", OPTIONS)
    (tmp_path / "calibration.yml").write_text("%YAML:1.0\n---\nK1: 5\n")
    for side in ("left", "right"):
        write_picture(tmp_path / f"{side}.png", 5)
    with pytest.raises(CaptureError, match=r"calibration\.yml: K2 is missing"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    for sensors, complaint in (
        ("{id: A}, {id: A}", "sensor ids must differ, found A, A"),
        ("1, 2", "calibration.yml: "),
    ):
        (tmp_path / "calibration.yml").write_text(f"%YAML:1.0\n---\nsensors: [{sensors}]\n")
        with pytest.raises(CaptureError, match=complaint):
            import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    (tmp_path / "calibration.yml").write_text("not: [a, file")
    with pytest.raises(CaptureError, match="is not an OpenCV YAML or XML file"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("cols: 4", "cols: -4", r"a matrix has \[1, -4\] rows and columns"),  # OpenCV's own reader ends the process
        ("   cols: 4\n", "", "NaN stands where a count is expected"),
        ("cols: 4", "cols: 3", "4 numbers stand where 1,3 are expected"),
    ],
)
def test_a_matrix_whose_size_is_wrong_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    write_calibration(tmp_path / "c.yml", Rig(RIG.sensors[:1]))
    text = (tmp_path / "c.yml").read_text()
    assert old in text
    (tmp_path / "c.yml").write_text(text.replace(old, new, 1))
    with pytest.raises(CaptureError, match=rf"c\.yml: .*({sentence})"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)


def test_a_rotation_of_another_shape_is_named_in_words() -> None:
    lens = np.diag([400.0, 400.0, 1.0])
    entry = {"": Path("c.yml"), "K1": lens, "K2": lens, "R": [[1.0, 0.0], [0.0, 1.0]], "T": [0.1, 0, 0]}
    with pytest.raises(CaptureError, match=r"^c\.yml: sensor S1: R has the shape \(2, 2\), expected \(3, 3\), or"):
        stereo_sensor("S1", entry, (640, 480), 1.0)
    assert stereo_sensor("S1", {**entry, "R": [[0.0, 0.0, 0.0]]}, (640, 480), 1.0).id == "S1"


def test_distortion_of_one_camera_alone_is_asked_about(tmp_path: Path) -> None:
    write_calibration(tmp_path / "c.yml", Rig(RIG.sensors[:1]))
    (tmp_path / "c.yml").write_text((tmp_path / "c.yml").read_text().replace("D2: ", "E2: "))
    for side in ("left", "right"):
        write_picture(tmp_path / f"{side}.png", 5)
    with pytest.raises(CaptureError, match="has distortion of one camera only, expected D1 and D2"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("camera_matrix_left dist_coeffs_left", "camera_matrix_right dist_coeffs_right"),
        ("K_left D_left", "K_right D_right"),
        ("mtxL distL", "mtxR distR"),
        ("leftCameraMatrix leftDistCoeffs", "rightCameraMatrix rightDistCoeffs"),
        ("k1 d1", "k2 d2"),
    ],
)
def test_matrices_are_known_by_the_names_that_people_give_them(tmp_path: Path, left: str, right: str) -> None:
    write_calibration(tmp_path / "c.yml", Rig(RIG.sensors[:1]))
    text = (tmp_path / "c.yml").read_text()
    for number, names in ((1, left), (2, right)):
        for key, name in zip("KD", names.split(), strict=True):
            text = text.replace(f"{key}{number}:", f"{name}:")
        write_picture(tmp_path / f"{('left', 'right')[number - 1]}.png", 5)
    (tmp_path / "c.yml").write_text(text)
    stream = import_opencv(tmp_path, tmp_path / "out", OPTIONS).sensors[0]
    for found, written in zip(stream.cameras, (RIG.sensors[0].left, RIG.sensors[0].right), strict=True):
        np.testing.assert_allclose(seen(found.camera, POINTS), seen(written, POINTS), atol=1e-6)


@pytest.mark.parametrize("head", ["", "%YAML:1.0\n---\n"])
@pytest.mark.parametrize("style", [None, True, False])
@pytest.mark.parametrize("is_flat", [False, True], ids=["rows", "rows, cols and data"])
def test_matrices_may_be_lists_as_pythons_own_yaml_writes_them(
    tmp_path: Path, *, head: str, style: bool | None, is_flat: bool
) -> None:
    sensor = RIG.sensors[0]
    matrices = {
        "K1": sensor.left.K,
        "D1": sensor.left.dist,
        "K2": sensor.right.K,
        "D2": sensor.right.dist,
        "R": sensor.right_from_left[:3, :3],
        "T": sensor.right_from_left[:3, 3],
    }
    content = {
        key: {"rows": value.size // value.shape[-1], "cols": value.shape[-1], "data": value.ravel().tolist()}
        if is_flat
        else value.tolist()
        for key, value in matrices.items()
    }
    (tmp_path / "stereo.yaml").write_text(head + yaml.safe_dump(content, default_flow_style=style))
    for side in ("left", "right"):
        write_picture(tmp_path / f"{side}.png", 5)
    assert find_format(tmp_path) == "opencv"
    found = import_opencv(tmp_path, tmp_path / "out", OPTIONS).rig.sensors[0]
    in_world = sensor.left.points_in_camera(POINTS) @ TURNED.T
    np.testing.assert_allclose(seen(found.right, in_world), seen(sensor.right, POINTS), atol=1e-6)
