"""Recordings that a JSON file describes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from recon.capture.checking.check import check_capture
from recon.capture.depth_maps import read_depth_map
from recon.capture.format import CaptureError, DepthMaps, read_frame
from recon.capture.importing.json_file import import_json
from recon.capture.importing.sources import ImportOptions
from tests.recon.capture.importing.labelled_recording import (
    OPTIONS,
    POINTS,
    RIG,
    SIZE,
    TURNED,
    described,
    record,
    seen,
    write_picture,
    write_video,
)


def test_the_short_json_form_takes_shots_and_other_units(tmp_path: Path) -> None:
    left, right = RIG.sensors[0].left, RIG.sensors[0].right
    relative = left.cam_from_world @ np.linalg.inv(right.cam_from_world)
    for number in (1, 2):
        write_picture(tmp_path / f"C1_{number}.png", 10 * number)
        write_picture(tmp_path / f"C2_{number}.png", 10 * number + 5)
    content = {
        "units": "m",
        "K_left": left.K.tolist(),
        "K_right": right.K.tolist(),
        "dist_left": left.dist.tolist(),
        "dist_right": right.dist.tolist(),
        "R_left_from_right": relative[:3, :3].tolist(),
        "t_left_from_right_m": (relative[:3, 3] / 1000).tolist(),
        "radius_m": 0.3,
        "left_file": {"1": "C2_1.png", "2": "C1_2.png"},
        "right_file": {"1": "C1_1.png", "2": "C2_2.png"},
    }
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    capture = import_json(tmp_path / "calibration.json", tmp_path / "out", OPTIONS)
    in_world = left.points_in_camera(POINTS) @ TURNED.T
    np.testing.assert_allclose(seen(capture.sensors[0].right.camera, in_world), seen(right, POINTS), atol=1e-6)
    assert (capture.kind, capture.object, capture.n_frames) == ("sphere", {"radius_mm": 300.0}, 2)
    assert [[int(image[0, 0, 0]) for image in read_frame(capture, "S1", frame)] for frame in (0, 1)] == [
        [15, 10],
        [20, 25],
    ]
    one = import_json(tmp_path / "calibration.json", tmp_path / "second", OPTIONS, shots=["2"])
    assert one.n_frames == 1
    assert read_frame(one, "S1", 0)[0][0, 0, 0] == 20
    with pytest.raises(CaptureError, match="asked: \\['3'\\]"):
        import_json(tmp_path / "calibration.json", tmp_path / "third", OPTIONS, shots=["3"])


def test_both_forms_that_the_page_shows_are_imported(tmp_path: Path) -> None:
    page = (Path(__file__).parents[4] / "docs" / "capture.md").read_text(encoding="utf-8")
    short, full = re.findall(r"^```json\n(.*?)^```", page, re.DOTALL | re.MULTILINE)[:2]
    for name in ("C1_S1", "C1_S2", "C2_S1", "C2_S2", "left_plate", "right_plate", "left/0000", "left/0001"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        picture(tmp_path / f"{name}.png")
    video(tmp_path / "right.mp4", n_frames=2)
    for name, content in (("short", short), ("full", full)):
        (tmp_path / f"{name}.json").write_text(content, encoding="utf-8")
        assert import_json(tmp_path / f"{name}.json", tmp_path / name, OPTIONS).n_frames == 2


def picture(path: Path) -> None:
    cv2.imwrite(str(path), np.full((720, 1280, 3), 90, np.uint8))


def video(path: Path, n_frames: int) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25, (1280, 720))
    for _ in range(n_frames):
        writer.write(np.full((720, 1280, 3), 90, np.uint8))
    writer.release()


def test_a_folder_is_imported_by_the_one_json_that_describes_a_recording(tmp_path: Path) -> None:
    record(tmp_path / "source")
    path = described(tmp_path / "source")
    by_file, by_folder = import_json(path, tmp_path / "1"), import_json(path.parent, tmp_path / "2")
    assert [sensor.id for sensor in by_folder.sensors] == [sensor.id for sensor in by_file.sensors]
    assert by_folder.n_frames == by_file.n_frames
    (path.parent / "manifest.json").write_text("[]")
    assert import_json(path.parent, tmp_path / "3").n_frames == by_file.n_frames
    (path.parent / "other.json").write_text('{"sensors": []}')
    with pytest.raises(CaptureError, match=r"other\.json"):
        import_json(path.parent, tmp_path / "4")


def test_a_json_may_describe_a_camera_with_depth_maps(tmp_path: Path) -> None:
    record(tmp_path)
    for frame in (1, 2):
        np.save(tmp_path / f"depth{frame}.npy", np.full((SIZE[1], SIZE[0]), float(frame)))
    path = described(tmp_path)
    content = json.loads(path.read_text())
    del content["sensors"][1]["right"]
    content["sensors"][1]["depth"] = {"image": "depth{frame}.npy", "scale_mm": 1000.0, "kind": "distance"}
    path.write_text(json.dumps(content))
    capture = import_json(path, tmp_path / "out")
    assert [stream.sides for stream in capture.sensors] == [("left", "right"), ("left",)]
    assert capture.sensors[1].depth == DepthMaps("S2/depth/{frame:04d}.npy", 1000.0, "distance")
    np.testing.assert_array_equal(np.load(tmp_path / "out/S2/depth/0001.npy"), 2.0)
    (tmp_path / "depth2.npy").unlink()
    with pytest.raises(CaptureError, match="sensor S2, depth has 1 frames, expected 2"):
        import_json(path, tmp_path / "again")


def test_pictures_of_several_formats_in_a_list_lose_nothing(tmp_path: Path) -> None:
    record(tmp_path)
    deep = np.full((SIZE[1], SIZE[0], 3), 30_000, np.uint16)
    deep[0, 0] = 65_535
    cv2.imwrite(str(tmp_path / "deep.png"), deep)
    write_picture(tmp_path / "first.jpg", 50)
    np.save(tmp_path / "far.npy", np.full((SIZE[1], SIZE[0]), 2000.0))
    cv2.imwrite(str(tmp_path / "near.png"), np.full((SIZE[1], SIZE[0]), 1000, np.uint16))
    path = described(tmp_path)
    content = json.loads(path.read_text())
    content["sensors"][0]["left"]["image"] = ["first.jpg", "deep.png"]
    content["sensors"][0]["right"]["image"] = [f"S1/right/{number}.png" for number in (9, 10)]
    content["sensors"][0]["depth"] = {"image": ["near.png", "far.npy"]}
    path.write_text(json.dumps(content))
    capture = import_json(path, tmp_path / "out")
    assert read_frame(capture, "S1", 1)[0][9, 9].tolist() == [30_000 >> 8] * 3
    depths = [read_depth_map(capture.folder, capture.sensors[0], frame)[9, 9] for frame in (0, 1)]
    assert depths == [1000.0, 2000.0]


def test_several_videos_of_one_camera_are_refused(tmp_path: Path) -> None:
    record(tmp_path)
    for name in ("a.avi", "b.avi"):
        write_video(tmp_path / name, [50, 60])
    path = described(tmp_path)
    content = json.loads(path.read_text())
    content["sensors"][0]["left"]["image"] = ["a.avi", "b.avi"]
    path.write_text(json.dumps(content))
    with pytest.raises(CaptureError, match=r"S1: .*a\.avi, .*b\.avi are several files, expected pictures or one video"):
        import_json(path, tmp_path / "out")


def without(content: dict[str, Any], key: str, sensor: int = 0) -> None:
    del content["sensors"][sensor]["left"][key]


def renamed(content: dict[str, Any], key: str, name: str) -> None:
    left = content["sensors"][0]["left"]
    left[name] = left.pop(key)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: without(content, "K"), "sensor S1: K is missing"),
        (lambda content: without(content, "image"), "sensor S1: image is missing"),
        (lambda content: without(content, "cam_from_world", sensor=1), "sensor S2: a camera has the poses"),
        (lambda content: renamed(content, "dist", "D"), "sensor S1: D is not read, expected dist"),
        (lambda content: content["sensors"][0]["left"].update(k1=0.1), "sensor S1: k1 is not read, expected dist"),
        (lambda content: renamed(content, "cam_from_world", "c2w"), "sensor S1: c2w is not read, expected one of cam"),
        (
            lambda content: content["sensors"][0]["right"].update(image="nowhere"),
            "S1: right, image: .*found nothing, e",
        ),
        (lambda content: content["sensors"][0]["left"].update(image=["no.png"]), "S1: left, image: .*no.png: there is"),
        (lambda content: content["sensors"][0]["right"].update(K=[[1, 2], [3]]), "expected numbers"),
        (lambda content: content.update(units="furlong"), "unit 'furlong'"),
        (lambda content: content.update(fps=0), "fps is 0, expected a positive number"),
        (lambda content: content.pop("bounds"), "nothing tells the bounds"),
    ],
)
def test_what_is_wrong_in_a_description_is_named(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], message: str
) -> None:
    record(tmp_path)
    path = described(tmp_path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(CaptureError, match=message):
        import_json(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_real_sphere_comes_in_by_its_own_calibration(real_data: Path, tmp_path: Path) -> None:
    bounds = np.array([[-700.0, -400, -7300], [800, 550, -4700]])
    capture = import_json(real_data / "sphere/calibration.json", tmp_path / "sphere", ImportOptions(bounds=bounds))
    assert (capture.kind, capture.object, capture.n_frames) == ("sphere", {"radius_mm": 300.0}, 4)
    (report,) = check_capture(capture.folder).sensors
    assert report.rows is not None
    assert report.rows.vertical_error_px is not None
    assert report.rows.vertical_error_px < 0.25


@pytest.mark.parametrize(
    ("keys", "wrong", "said"),
    [
        (("sensors",), [], "names no sensors"),
        (("sensors", 0, "left", "image"), 5, "sensor S1: left, image: is 5"),
        (("sensors", 0, "left", "image"), [], r"sensor S1: left, image: is \[\]"),
        (("sensors", 0, "left", "distortion"), [0.1, 0, 0, 0], "sensor S1: distortion is not read, expected dist"),
        (("sensors", 0, "depth"), {"image": []}, "sensor S1: depth: image is an empty list"),
        (("sensors", 0, "depth"), {"image": ["d.png"], "size": ["a", "b"]}, "sensor S1: depth: size is .*whole pixels"),
        (("sensors", 0, "depth"), {"image": ["d.png"], "size": [3]}, "sensor S1: depth: size is .*whole pixels"),
    ],
)
def test_parts_of_a_json_that_hold_nothing_are_named(
    tmp_path: Path, keys: tuple[str | int, ...], wrong: Any, said: str
) -> None:
    record(tmp_path / "source")
    path = described(tmp_path / "source")
    content = json.loads(path.read_text())
    part = content
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = wrong
    path.write_text(json.dumps(content))
    with pytest.raises(CaptureError, match=said):
        import_json(path, tmp_path / "out", OPTIONS)


@pytest.mark.parametrize(
    ("keys", "named"),
    [
        (("sensors", 0, "depth"), {"image": "{elsewhere}/{frame}.npy"}),
        (("held_out",), [{"image": "{elsewhere}/1.png"}]),
    ],
)
def test_a_job_of_the_server_reads_no_file_elsewhere_that_a_json_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keys: tuple[str | int, ...], named: Any
) -> None:
    record(tmp_path / "source")
    write_picture(tmp_path / "elsewhere/1.png", 5)
    for frame in (1, 2):
        np.save(tmp_path / f"elsewhere/{frame}.npy", np.full((SIZE[1], SIZE[0]), 1.0))
    path = described(tmp_path / "source")
    content = json.loads(path.read_text())
    part = content
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = json.loads(json.dumps(named).replace("{elsewhere}", str(tmp_path / "elsewhere")))
    path.write_text(json.dumps(content))
    monkeypatch.setenv("RECONSTUDY_FILES_BELOW", str(tmp_path / "source"))
    with pytest.raises(ValueError, match="lies outside the server's folders"):
        import_json(path, tmp_path / "out", OPTIONS)
    assert not (tmp_path / "out").exists()
