"""Recordings of RGB-D cameras in the form of their benchmarks: what they show is where it was."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from recon.capture.depth_maps import rays, read_depth_map
from recon.capture.format import Capture, CaptureError, read_capture
from recon.capture.importing.formats import AUTO, find_format, import_recording
from recon.capture.importing.sources import ImportOptions
from recon.geometry.rig import Camera, look_at, transformed
from recon.runtime.notices import Notice
from tests.recon.capture.importing.labelled_recording import SIZE, seen, write_picture

K = np.array([[517.3 / 2, 0, 159.0], [0, 516.5 / 2, 127.5], [0, 0, 1]])
Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of a world with y up, as one with z up
MIDDLE = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # of a pixel, from its corner
N = 5
WALL_Z = -800.0  # mm, in the world with y up


def cameras(size: tuple[int, int] = SIZE, matrix: np.ndarray = K) -> list[Camera]:
    return [Camera(matrix, size, look_at((100.0 * number, 60.0, 900.0), (0, 0, 0))) for number in range(N)]


def wall_depth(camera: Camera) -> np.ndarray:
    """The depth z, mm, of a wall, at each pixel."""
    directions = rays(camera) @ camera.rotation
    return (WALL_Z - camera.centre[2]) / directions[..., 2]


def pose_in_metres(camera: Camera) -> np.ndarray:
    pose = np.linalg.inv(camera.cam_from_world)
    pose[:3] = Z_UP @ pose[:3]
    pose[:3, 3] /= 1000
    return pose


def tum(folder: Path, *, is_moving: bool = True) -> None:
    lists: dict[str, list[str]] = {"rgb": ["# color images"], "depth": ["# depth maps"], "groundtruth": ["# tx ty tz"]}
    for number, camera in enumerate(cameras()):
        stamp = 1305031102.175304 + number / 30
        write_picture(folder / f"rgb/{stamp:.6f}.png", 50 * number)
        values = np.rint(wall_depth(camera) * 5).astype(np.uint16)
        (folder / "depth").mkdir(exist_ok=True)
        cv2.imwrite(str(folder / f"depth/{stamp + 0.012:.6f}.png"), values)
        lists["rgb"].append(f"{stamp:.6f} rgb/{stamp:.6f}.png")
        lists["depth"].append(f"{stamp + 0.012:.6f} depth/{stamp + 0.012:.6f}.png")
        pose = pose_in_metres(camera)
        words = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
        lists["groundtruth"].append(f"{stamp - 0.004:.6f} " + " ".join(map(repr, map(float, words))))
    if not is_moving:
        del lists["groundtruth"]
    for name, lines in lists.items():
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    (folder / "calibration.txt").write_text(f"{K[0, 0]} {K[1, 1]} {K[0, 2]} {K[1, 2]}\n")


def scannet(folder: Path, *, is_moving: bool = True) -> None:
    """The colours in twice the size of the depth maps, whose camera has a matrix of its own."""
    own = np.array([[260.0, 0, 155.0], [0, 262.0, 120.0], [0, 0, 1]])
    colour = np.diag([2.0, 2, 1]) @ (K + MIDDLE) - MIDDLE
    for number, (camera, shown) in enumerate(zip(cameras(matrix=own), cameras((640, 480), colour), strict=True)):
        for name in ("color", "depth", "pose", "intrinsic"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / f"color/{number}.jpg"), np.full((480, 640, 3), 50 * number, np.uint8))
        cv2.imwrite(str(folder / f"depth/{number}.png"), np.rint(wall_depth(camera)).astype(np.uint16))
        np.savetxt(folder / f"pose/{number}.txt", pose_in_metres(shown))
    if not is_moving:
        for path in (folder / "pose").iterdir():
            path.unlink()
        (folder / "pose").rmdir()
    for name, matrix in (("color", colour), ("depth", own)):
        whole = np.eye(4)
        whole[:3, :3] = matrix
        np.savetxt(folder / f"intrinsic/intrinsic_{name}.txt", whole)


def check_wall(capture: Capture, folder: Path, tolerance_mm: float) -> None:
    """All sensors show the wall where it is."""
    for stream in capture.sensors:
        depth = read_depth_map(folder, stream, 0).astype(float)
        size = depth.shape[::-1]
        scale = np.diag([size[0] / stream.left.camera.size[0], size[1] / stream.left.camera.size[1], 1])
        camera = Camera(scale @ (stream.left.camera.K + MIDDLE) - MIDDLE, size, stream.left.camera.cam_from_world)
        points = transformed((rays(camera) * depth[..., None]).reshape(-1, 3), np.linalg.inv(camera.cam_from_world))
        points = points[np.isfinite(points).all(axis=1)]
        assert len(points) > 60_000
        assert np.abs(points[:, 2] - WALL_Z).max() < tolerance_mm


@pytest.mark.parametrize(("name", "write", "tolerance_mm"), [("tum", tum, 0.3), ("scannet", scannet, 8.0)])
def test_a_camera_that_moved_gives_sensors_and_views_to_hold_out(
    tmp_path: Path, name: str, write: Callable[[Path], None], tolerance_mm: float
) -> None:
    write(tmp_path / "sequence")
    assert find_format(tmp_path / "sequence") == name
    names = ("0", "2", "4")
    if name == "tum":
        names = tuple(f"{1305031102.175304 + number / 30:.6f}" for number in (0, 2, 4))
    import_recording(AUTO, tmp_path / "sequence", tmp_path / "out", ImportOptions(shots=names))
    capture = read_capture(tmp_path / "out")
    assert (len(capture.sensors), len(capture.held_out), capture.n_frames) == (3, 2, 1)
    truth = cameras() if name == "tum" else cameras((640, 480), capture.sensors[0].left.camera.K)
    points = np.array([[0.0, 0, WALL_Z], [200, 100, -300], [-150, 50, 0]])
    for stream, number in zip(capture.sensors, (0, 2, 4), strict=True):
        np.testing.assert_allclose(seen(stream.left.camera, points), seen(truth[number], points), atol=1e-6)
    check_wall(capture, tmp_path / "out", tolerance_mm)
    assert capture.bounds[0, 2] <= WALL_Z + 1 <= capture.bounds[1, 2] + 2


@pytest.mark.parametrize(("name", "write"), [("tum", tum), ("scannet", scannet)])
def test_a_camera_that_stood_still_is_one_sensor_of_many_frames(
    tmp_path: Path, name: str, write: Callable[..., None]
) -> None:
    write(tmp_path / "sequence", is_moving=False)
    import_recording(name, tmp_path / "sequence", tmp_path / "out", ImportOptions(fps=30))
    capture = read_capture(tmp_path / "out")
    assert (len(capture.sensors), capture.n_frames, capture.sensors[0].right) == (1, N, None)
    first = read_depth_map(tmp_path / "out", capture.sensors[0], 0)
    assert np.nanmedian(first) == pytest.approx(np.median(wall_depth(cameras()[0])), rel=0.02)


def test_what_a_sequence_lacks_is_named(tmp_path: Path) -> None:
    tum(tmp_path / "a")
    with pytest.raises(CaptureError, match=r"has no shot 7; its shots are 1305031102\.175304 to"):
        import_recording("tum", tmp_path / "a", tmp_path / "out", ImportOptions(shots=["7"]))
    next(iter((tmp_path / "a/depth").iterdir())).unlink()
    with pytest.warns(Notice, match="lists pictures that are not there"):
        import_recording("tum", tmp_path / "a", tmp_path / "out", ImportOptions())
    (tmp_path / "a/calibration.txt").unlink()
    with pytest.warns(Notice), pytest.raises(CaptureError, match="nothing tells its camera; write fx fy cx cy"):
        import_recording("tum", tmp_path / "a", tmp_path / "other", ImportOptions())
    scannet(tmp_path / "b")
    np.savetxt(tmp_path / "b/pose/0.txt", np.full((4, 4), -np.inf))
    with pytest.warns(Notice, match="without finite pose, and left out: 1 of the pictures"):
        import_recording("scannet", tmp_path / "b", tmp_path / "placed", ImportOptions())
    assert len(read_capture(tmp_path / "placed").sensors) == N - 1


def test_a_list_of_poses_that_holds_none_or_no_rotation_is_refused(tmp_path: Path) -> None:
    tum(tmp_path / "source")
    truth = tmp_path / "source/groundtruth.txt"
    text = truth.read_text()
    truth.write_text("# tx ty tz\n")
    with pytest.raises(CaptureError, match=r"groundtruth\.txt: holds no pose; remove it if the camera stood still"):
        import_recording("tum", tmp_path / "source", tmp_path / "out", ImportOptions())
    words = text.split("\n")[1].split()
    truth.write_text(text.replace(" ".join(words[4:]), "25.4 0 0 0.7"))
    with pytest.raises(CaptureError, match=r"groundtruth\.txt: a rotation is a quaternion of the length 25\.4\d*, "):
        import_recording("tum", tmp_path / "source", tmp_path / "out", ImportOptions())
    truth.write_text("\n".join(text.split("\n")[:1] + text.split("\n")[2:]))
    with pytest.warns(Notice, match="without depth map or pose of their time, and left out: 1 of the pictures"):
        import_recording("tum", tmp_path / "source", tmp_path / "out", ImportOptions())


def test_a_picture_whose_two_files_are_absent_hides_no_other_that_is_left_out(tmp_path: Path) -> None:
    tum(tmp_path / "source")
    for kind in ("rgb", "depth"):
        min((tmp_path / "source" / kind).iterdir()).unlink()
    poses = (tmp_path / "source/groundtruth.txt").read_text().split("\n")
    (tmp_path / "source/groundtruth.txt").write_text("\n".join(poses[:2] + poses[3:]))  # without the second one's
    with pytest.warns(Notice) as told:
        import_recording("tum", tmp_path / "source", tmp_path / "out", ImportOptions())
    said = " ".join(str(each.message) for each in told)
    assert "lists pictures that are not there" in said
    assert "without depth map or pose of their time, and left out: 1 of the pictures" in said
