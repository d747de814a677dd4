"""Every importer on one recording: four labelled points have to be where the pictures show them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.capture.checking.check import check_capture
from recon.capture.format import (
    Capture,
    CaptureError,
    DepthMaps,
    read_capture,
    read_frame,
    read_held_out,
    read_plates,
)
from recon.capture.importing.colmap import import_colmap
from recon.capture.importing.json_file import import_json
from recon.capture.importing.opencv import import_opencv, write_calibration
from recon.capture.importing.sources import GapWarning, ImportOptions, parse_unit
from recon.capture.pictures import find_pictures
from recon.rig import Camera, Rig, Sensor, look_at
from tests.command_line import Command

SIZE = (320, 240)
BOUNDS = np.array([[-500.0, -500, -500], [500, 500, 500]])
POINTS = np.array([[0.0, 0, 0], [120, 30, -40], [-60, 90, 50], [40, -110, 70]])  # mm, labelled in the pictures below
OPTIONS = ImportOptions(bounds=BOUNDS)
TURNED = np.diag([1.0, -1.0, -1.0])  # the world where nobody tells one: the first left camera, y up


def camera(x: float, dist: list[float] | None = None) -> Camera:
    K = np.array([[410.0 + x / 10, 0, 158.5], [0, 405.0, 121.25], [0, 0, 1]])
    return Camera(K, SIZE, look_at((x, 40.0, 1500.0), (0, 0, 0)), np.array(dist or []))


RIG = Rig(
    tuple(
        Sensor(name, camera(x, [-0.1, 0.05, 0.001, -0.002]), camera(x + 150.0, [-0.12, 0.03, -0.001, 0.0005]))
        for name, x in (("S1", -300.0), ("S2", 200.0))
    )
)


def seen(view: Camera, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The labels: where a picture shows world points, by OpenCV."""
    pose = view.cam_from_world
    dist = view.dist if view.dist.size else np.zeros(5)
    return np.asarray(cv2.projectPoints(points, cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3], view.K, dist)[0][:, 0])


def write_picture(path: Path, grey: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((SIZE[1], SIZE[0], 3), grey, dtype=np.uint8))


def write_video(path: Path, greys: list[int], fps: float = 25.0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), fps, SIZE)
    for grey in greys:
        writer.write(np.full((SIZE[1], SIZE[0], 3), grey, dtype=np.uint8))
    writer.release()


def record(folder: Path, *, n_frames: int = 2) -> None:
    """Pictures of the rig beside a calibration: `S1/left/7.png` and so on."""
    for number, sensor in enumerate(RIG.sensors):
        for side, grey in (("left", 50), ("right", 100)):
            for frame in range(n_frames):
                write_picture(folder / sensor.id / side / f"{frame + 9}.png", grey + 10 * number + frame)
            write_picture(folder / sensor.id / side / "plate.png", 7)


def colmap_model(folder: Path, *, unit_mm: float = 1000.0, model: str = "OPENCV") -> Path:
    """The rig as COLMAP writes it: principal points half a pixel further, poses as quaternions, any unit."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras, images = ["# cameras"], ["# images"]
    sides = [(sensor.id, side, getattr(sensor, side)) for sensor in RIG.sensors for side in ("left", "right")]
    for number, (name, side, view) in enumerate(sides, start=1):
        focal = [view.K[0, 0], view.K[1, 1]]
        numbers = [*focal, view.K[0, 2] + 0.5, view.K[1, 2] + 0.5, *view.dist]
        cameras.append(f"{number} {model} {SIZE[0]} {SIZE[1]} " + " ".join(map(str, numbers)))
        x, y, z, w = Rotation.from_matrix(view.rotation).as_quat()
        t = view.cam_from_world[:3, 3] / unit_mm
        images += [f"{10 + number} {w} {x} {y} {z} {t[0]} {t[1]} {t[2]} {number} {name}_{side}.png", "1.0 2.0 -1"]
        write_picture(folder / "images" / f"{name}_{side}.png", 50 * number)
    points = [f"{number} {x} {y} {z} 0 0 0 0.1" for number, (x, y, z) in enumerate(POINTS / unit_mm)]
    for name, lines in (("cameras", cameras), ("images", images), ("points3D", points)):
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    return folder


def described(folder: Path, *, unit_mm: float = 1.0, pose: str = "cam_from_world", right: str | None = None) -> Path:
    """The rig in the full JSON form."""
    entries = []
    for sensor in RIG.sensors:
        entry: dict[str, Any] = {"id": sensor.id}
        for side in ("left", "right"):
            view = getattr(sensor, side)
            transforms = {
                "cam_from_world": view.cam_from_world,
                "world_from_cam": np.linalg.inv(view.cam_from_world),
                "right_from_left": view.cam_from_world @ np.linalg.inv(sensor.left.cam_from_world),
                "left_from_right": sensor.left.cam_from_world @ np.linalg.inv(view.cam_from_world),
            }
            key = right if right and side == "right" else pose
            transform = transforms[key].copy()
            transform[:3, 3] /= unit_mm
            entry[side] = {"K": view.K.tolist(), "dist": view.dist.tolist(), key: transform.tolist()}
            entry[side]["image"] = f"{sensor.id}/{side}"
        entries.append(entry)
    content = {"units": {1.0: "mm", 1000.0: "m"}[unit_mm], "bounds": (BOUNDS / unit_mm).tolist()}
    (folder / "recording.json").write_text(json.dumps({**content, "sensors": entries}))
    return folder / "recording.json"


def from_opencv(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    write_calibration(tmp_path / "source/calibration.yml", RIG)
    return import_opencv(tmp_path / "source", tmp_path / "out", OPTIONS)


def from_opencv_xml(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    write_calibration(tmp_path / "source/calibration.xml", RIG)
    return import_opencv(tmp_path / "source", tmp_path / "out", OPTIONS)


def from_colmap(tmp_path: Path) -> Capture:
    source = colmap_model(tmp_path / "source")
    return import_colmap(source, tmp_path / "out", [(11, 12), (13, 14)], ImportOptions(unit_mm=1000.0))


def from_json(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    return import_json(described(tmp_path / "source"), tmp_path / "out")


def from_json_in_metres(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    path = described(tmp_path / "source", unit_mm=1000.0, pose="world_from_cam", right="left_from_right")
    return import_json(path, tmp_path / "out")


@pytest.mark.parametrize("importer", [from_opencv, from_opencv_xml, from_colmap, from_json, from_json_in_metres])
def test_four_labelled_points_are_where_the_pictures_show_them(
    tmp_path: Path, importer: Callable[[Path], Capture]
) -> None:
    importer(tmp_path)
    capture = read_capture(tmp_path / "out")
    assert [stream.id for stream in capture.sensors] == ["S1", "S2"]
    for stream, sensor in zip(capture.sensors, RIG.sensors, strict=True):
        for side in ("left", "right"):
            found, truth = getattr(stream, side).camera, getattr(sensor, side)
            np.testing.assert_allclose(seen(found, POINTS), seen(truth, POINTS), atol=1e-6)
            assert found.size == SIZE


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


def test_colmap_bounds_hold_its_points_and_unused_images_are_held_out(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source", unit_mm=250.0)
    capture = import_colmap(source, tmp_path / "out", [(11, 12)], ImportOptions(unit_mm=250.0))
    assert (capture.bounds[0] <= POINTS.min(axis=0)).all()
    assert (capture.bounds[1] >= POINTS.max(axis=0)).all()
    assert [shot.image for shot in capture.held_out] == ["held_out/S2_left.png", "held_out/S2_right.png"]
    np.testing.assert_allclose(seen(capture.held_out[0].camera, POINTS), seen(RIG.sensors[1].left, POINTS), atol=1e-6)


def test_the_axis_that_points_upwards_becomes_y(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    for up, turned in (("z", POINTS[:, [0, 2, 1]] * (1, 1, -1)), ("-y", POINTS * (1, -1, -1))):
        out = tmp_path / up
        capture = import_colmap(source, out, [(11, 12)], ImportOptions(unit_mm=1000.0, up=up))
        np.testing.assert_allclose(
            seen(capture.sensors[0].left.camera, turned), seen(RIG.sensors[0].left, POINTS), atol=1e-6
        )
        assert (capture.bounds[0] <= turned.min(axis=0)).all()


@pytest.mark.parametrize("n_sensors", [1, 2])
def test_a_written_calibration_is_read_back(tmp_path: Path, n_sensors: int) -> None:
    rig = Rig(RIG.sensors[:n_sensors])
    record(tmp_path)
    write_calibration(tmp_path / "calibration.yml", rig)
    again = import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    for sensor, found in zip(rig.sensors, again.rig.sensors, strict=True):
        np.testing.assert_allclose(seen(found.right, POINTS), seen(sensor.right, POINTS), atol=1e-6)
        np.testing.assert_allclose(found.left.cam_from_world, sensor.left.cam_from_world, atol=1e-9)


def test_images_are_taken_in_the_order_of_their_numbers_and_plates_are_kept(tmp_path: Path) -> None:
    capture = from_opencv(tmp_path)
    assert [int(read_frame(capture, "S2", frame)[0][0, 0, 0]) for frame in (0, 1)] == [60, 61]  # 9.png, 10.png
    plates = read_plates(capture, "S1")
    assert plates is not None
    assert plates[1][0, 0, 0] == 7


def test_a_folder_with_one_json_is_imported_by_it(tmp_path: Path) -> None:
    record(tmp_path / "source")
    path = described(tmp_path / "source")
    by_file, by_folder = import_json(path, tmp_path / "1"), import_json(path.parent, tmp_path / "2")
    assert [sensor.id for sensor in by_folder.sensors] == [sensor.id for sensor in by_file.sensors]
    assert by_folder.n_frames == by_file.n_frames
    (path.parent / "other.json").write_text("{}")
    with pytest.raises(CaptureError, match=r"holds 2 JSON files \(.*other.json.*\), expected one that describes"):
        import_json(path.parent, tmp_path / "3")


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


def test_unequal_counts_are_named_unless_fewer_frames_are_asked_for(tmp_path: Path) -> None:
    record(tmp_path)
    write_picture(tmp_path / "S2/left/99.png", 1)
    path = described(tmp_path)
    with pytest.raises(CaptureError, match="sensor S1, left has 2 frames, expected 3"):
        import_json(path, tmp_path / "out")
    assert import_json(path, tmp_path / "out", ImportOptions(n_frames=2)).n_frames == 2


def test_videos_of_different_rates_are_named(tmp_path: Path) -> None:
    write_calibration(tmp_path / "calibration.yml", Rig(RIG.sensors[:1]))
    write_video(tmp_path / "left.avi", [10, 20, 30])
    write_video(tmp_path / "right.avi", [10, 20, 30], fps=30.0)
    with pytest.raises(CaptureError, match=r"left has 25\.000 frames a second, sensor S1, right 30\.000"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)


def test_a_variable_frame_rate_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_calibration(tmp_path / "calibration.yml", Rig(RIG.sensors[:1]))
    for side in ("left", "right"):
        write_video(tmp_path / f"{side}.avi", [10, 20, 30])
    monkeypatch.setattr("recon.capture.pictures.video_times", lambda _: np.array([0.0, 0.04, 0.12]))
    with pytest.raises(CaptureError, match=r"variable frame rate, intervals of 40\.0 to 80\.0 ms"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    assert not (tmp_path / "out").exists()


def without(content: dict[str, Any], key: str, sensor: int = 0) -> None:
    del content["sensors"][sensor]["left"][key]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: without(content, "K"), "sensor S1: K is missing"),
        (lambda content: without(content, "image"), "sensor S1: image is missing"),
        (lambda content: without(content, "cam_from_world", sensor=1), "sensor S2: a camera has the poses"),
        (lambda content: content["sensors"][0]["right"].update(image="nowhere"), "found nothing, expected one folder"),
        (lambda content: content["sensors"][0]["right"].update(K=[[1, 2], [3]]), "expected numbers"),
        (lambda content: content.update(units="furlong"), "unit 'furlong'"),
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


def test_what_is_wrong_in_a_colmap_model_is_named(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    with pytest.raises(CaptureError, match="scale is arbitrary"):
        import_colmap(source, tmp_path / "out", [(11, 12)])
    with pytest.raises(CaptureError, match=r": no pairs are given, expected LEFT-RIGHT .* out of: 11 S1_left\.png"):
        import_colmap(source, tmp_path / "out", None, ImportOptions(unit_mm=1.0))
    colmap_model(source, model="THIN_PRISM_FISHEYE")
    with pytest.raises(CaptureError, match=r"cameras.txt, line 2: camera model THIN_PRISM_FISHEYE"):
        import_colmap(source, tmp_path / "out", [(11, 12)], ImportOptions(unit_mm=1.0))


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
    with pytest.raises(CaptureError, match=r"calibration.yml: D1|K2 is missing"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)
    (tmp_path / "calibration.yml").write_text("not: [a, file")
    with pytest.raises(CaptureError, match="is not an OpenCV YAML or XML file"):
        import_opencv(tmp_path, tmp_path / "out", OPTIONS)


def test_units_are_names_or_numbers() -> None:
    assert [parse_unit(text) for text in ("mm", "m", "2.5")] == [1.0, 1000.0, 2.5]
    for text in ("-1", "nan", "ell"):
        with pytest.raises(CaptureError, match="expected mm, cm, m, in"):
            parse_unit(text)


def test_two_recordings_of_one_name_are_not_guessed_between(tmp_path: Path) -> None:
    write_picture(tmp_path / "left.png", 1)
    write_picture(tmp_path / "left.jpg", 1)
    with pytest.raises(CaptureError, match=r"found left.jpg, left.png, expected one"):
        find_pictures(tmp_path / "left")


@pytest.mark.slow
def test_the_real_sphere_comes_in_by_its_own_calibration(real_data: Path, tmp_path: Path) -> None:
    bounds = np.array([[-700.0, -400, -7300], [800, 550, -4700]])
    capture = import_json(real_data / "sphere/calibration.json", tmp_path / "sphere", ImportOptions(bounds=bounds))
    assert (capture.kind, capture.object, capture.n_frames) == ("sphere", {"radius_mm": 300.0}, 4)
    (report,) = check_capture(capture.folder).sensors
    assert report.rows is not None
    assert report.rows.vertical_error_px is not None
    assert report.rows.vertical_error_px < 0.25


def test_held_out_photographs_of_one_name_in_several_folders_stay_apart(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    table = (source / "images.txt").read_text()
    for name in ("S2_left", "S2_right"):
        (source / "images" / name).mkdir()
        (source / "images" / f"{name}.png").rename(source / "images" / name / "0001.png")
        table = table.replace(f"{name}.png", f"{name}/0001.png")
    (source / "images.txt").write_text(table)
    made = import_colmap(source, tmp_path / "out", [(11, 12)], ImportOptions(unit_mm=1000.0, bounds=BOUNDS))
    photographs = [read_held_out(made, photograph) for photograph in made.held_out]
    assert [picture[0, 0, 0] for picture in photographs] == [150, 200]  # as colmap_model paints S2's


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


@pytest.mark.parametrize(
    ("keys", "wrong", "said"),
    [
        (("sensors",), [], "names no sensors"),
        (("sensors", 0, "left", "image"), 5, "sensor S1: image is 5"),
        (("sensors", 0, "left", "image"), [], r"sensor S1: image is \[\]"),
        (("sensors", 0, "left", "distortion"), [0.1, 0, 0, 0], "sensor S1: distortion is not read, expected dist"),
        (("sensors", 0, "depth"), {"image": []}, "sensor S1: depth: image is an empty list"),
        (("sensors", 0, "depth"), {"image": ["d.png"], "size": ["a", "b"]}, "sensor S1: size is .*whole pixels"),
        (("sensors", 0, "depth"), {"image": ["d.png"], "size": [3]}, "sensor S1: size is .*whole pixels"),
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


@pytest.mark.parametrize(
    ("kind", "option", "sentence"),
    [
        ("middlebury", "--up", "middlebury takes no --up"),
        ("middlebury", "--units", "middlebury takes no --units"),
        ("opencv", "--pairs", "opencv takes no --pairs"),
        ("json", "--shots", "shots are of the short form"),
    ],
)
def test_an_option_that_a_format_does_not_take_is_refused(
    command: Command, tmp_path: Path, kind: str, option: str, sentence: str
) -> None:
    record(tmp_path / "source")
    path = described(tmp_path / "source")
    value = {"--up": "z", "--units": "cm", "--pairs": "1-2", "--shots": "1"}[option]
    told = command("capture", "import", kind, path, tmp_path / "out", option, value)
    assert told.code != 0
    assert sentence in told.err
    assert not (tmp_path / "out").exists()


def test_frames_beside_the_photograph_that_placed_a_camera_are_taken_instead_of_it(tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "colmap")
    for image in list((source / "images").iterdir()):
        for frame in range(3):
            write_picture(image.with_suffix("") / f"{frame}.png", 10 + frame)
    options = ImportOptions(unit_mm=1000.0, bounds=BOUNDS)
    capture = import_colmap(source, tmp_path / "out", [(11, 12), (13, 14)], options)
    assert capture.n_frames == 3
    assert read_frame(capture, "S2", 2)[0][0, 0, 0] == 12
