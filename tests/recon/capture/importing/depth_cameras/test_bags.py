"""Bags as ROS writes them: pairs and depth cameras are where their camera_info says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from recon.capture.depth_maps import read_depth_map
from recon.capture.format import CaptureError, read_capture, read_frame
from recon.capture.importing.formats import AUTO, find_format, import_recording
from recon.capture.importing.sources import ImportOptions
from recon.capture.rectify import scaled_camera
from recon.geometry.rig import Camera, rigid
from tests.recon.capture.importing.labelled_recording import BOUNDS, OPTIONS, RIG, SIZE, TURNED, seen

rosbags = pytest.importorskip("rosbags")

from rosbags.rosbag1 import Writer as Writer1  # noqa: E402
from rosbags.rosbag2 import Writer as Writer2  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_HUMBLE)}
LEFT, RIGHT = RIG.sensors[0].left, RIG.sensors[0].right
RELATIVE = RIGHT.cam_from_world @ np.linalg.inv(LEFT.cam_from_world)
AHEAD = np.array([[100.0, 50, 1500], [-200, 100, 1200]])
Messages = Iterator[tuple[str, int, Any]]


def header(types: Any, stamp_ns: int, frame: str) -> Any:
    time = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    more = {"seq": 0} if "seq" in types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    return types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **more)


def image(types: Any, stamp_ns: int, frame: str, encoding: str, pixels: np.ndarray) -> Any:
    """With four bytes more in each row than the picture needs."""
    rows = np.pad(np.ascontiguousarray(pixels).reshape(pixels.shape[0], -1).view(np.uint8), ((0, 0), (0, 4)))
    return types["sensor_msgs/msg/Image"](
        header=header(types, stamp_ns, frame),
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=rows.shape[1],
        data=rows.ravel(),
    )


def info(version: int, types: Any, K: np.ndarray, dist: np.ndarray, R: np.ndarray, P: np.ndarray) -> Any:
    roi = types["sensor_msgs/msg/RegionOfInterest"](x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    matrices = {"d": dist, "k": K.ravel(), "r": R.ravel(), "p": P.ravel()}
    if version == 1:
        matrices = {name.upper(): values for name, values in matrices.items()}
    return types["sensor_msgs/msg/CameraInfo"](
        header=header(types, 10**9, "camera"),
        height=SIZE[1],
        width=SIZE[0],
        distortion_model="plumb_bob",
        binning_x=0,
        binning_y=0,
        roi=roi,
        **matrices,
    )


def write(folder: Path, version: int, messages: Callable[[int, Any], Messages]) -> Path:
    store = STORES[version]
    path = folder / ("bag.bag" if version == 1 else "bag")
    folder.mkdir(parents=True, exist_ok=True)
    with Writer1(path) if version == 1 else Writer2(path, version=9) as writer:
        connections: dict[str, Any] = {}
        for topic, stamp_ns, message in messages(version, store.types):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=store)
            pack = store.serialize_ros1 if version == 1 else store.serialize_cdr
            writer.write(connections[topic], stamp_ns, pack(message, message.__msgtype__))
    return path


def stereo(version: int, types: Any) -> Messages:
    dist = np.append(LEFT.dist, 0), np.append(RIGHT.dist, 0)
    R1, R2, P1, P2 = cv2.stereoRectify(
        LEFT.K, dist[0], RIGHT.K, dist[1], SIZE, RELATIVE[:3, :3], RELATIVE[:3, 3:] / 1000
    )[:4]
    for name, camera, lens, R, P in (("right", RIGHT, dist[1], R2, P2), ("left", LEFT, dist[0], R1, P1)):
        yield f"/{name}/camera_info", 10**9, info(version, types, camera.K, lens, R, P)
    for frame in range(3):
        for name, grey, encoding in (("right", 100, "mono8"), ("left", 50, "bgr8")):
            shape = SIZE[::-1] if encoding == "mono8" else (*SIZE[::-1], 3)
            pixels = np.full(shape, grey + frame, np.uint8)
            if encoding == "bgr8":
                pixels[..., 2] = 200
            if (frame, name) != (1, "left"):  # which was lost
                stamp_ns = 10**9 + frame * 40_000_000 + (3_000_000 if name == "left" else 0)
                yield f"/{name}/image_raw", stamp_ns, image(types, stamp_ns, name, encoding, pixels)


@pytest.mark.parametrize("version", [1, 2])
def test_a_stereo_bag_is_a_pair_whose_instants_belong_together(tmp_path: Path, version: int) -> None:
    source = write(tmp_path / "source", version, stereo)
    assert find_format(source) == "rosbag"
    import_recording(AUTO, source, tmp_path / "out", OPTIONS)
    capture = read_capture(tmp_path / "out")
    for stream, camera in zip(capture.sensors[0].cameras, (LEFT, RIGHT), strict=True):
        relative = replace(camera, cam_from_world=camera.cam_from_world @ np.linalg.inv(LEFT.cam_from_world))
        np.testing.assert_allclose(seen(stream.camera, AHEAD @ TURNED.T), seen(relative, AHEAD), atol=1e-6)
    assert capture.n_frames == 2
    left, right = read_frame(capture, "S1", 1)
    assert left[5, 5].tolist() == [200, 52, 52]
    assert right[5, 5].tolist() == [102] * 3


def depth_camera(topic: str) -> Callable[[int, Any], Messages]:
    def messages(version: int, types: Any) -> Messages:
        P = np.column_stack([LEFT.K, np.zeros(3)])
        for name in ("/camera/color", topic):
            yield f"{name}/camera_info", 10**9, info(version, types, LEFT.K, np.append(LEFT.dist, 0), np.eye(3), P)
        for frame in range(2):
            stamp_ns = 10**9 + frame * 33_000_000
            colours = np.full((*SIZE[::-1], 3), 60 + frame, np.uint8)
            yield "/camera/color/image_raw", stamp_ns, image(types, stamp_ns, "color_optical", "rgb8", colours)
            depth = np.full(SIZE[::-1], 1500 + 10 * frame, np.uint16)
            yield f"{topic}/image_raw", stamp_ns, image(types, stamp_ns, "depth_optical", "16UC1", depth)

    return messages


def test_aligned_depth_maps_of_a_bag_come_in_and_others_are_refused(tmp_path: Path) -> None:
    source = write(tmp_path / "a", 2, depth_camera("/camera/aligned_depth_to_color"))
    import_recording("rosbag", source, tmp_path / "out", ImportOptions(fps=30))
    capture = read_capture(tmp_path / "out")
    assert (len(capture.sensors), capture.n_frames) == (1, 2)
    assert np.nanmax(np.abs(read_depth_map(tmp_path / "out", capture.sensors[0], 1) - 1510)) < 1e-3
    np.testing.assert_allclose(capture.sensors[0].left.camera.dist[:4], LEFT.dist)
    other = write(tmp_path / "b", 1, depth_camera("/camera/depth"))
    with pytest.raises(
        CaptureError, match="belong to another camera than /camera/color/image_raw; record them aligned"
    ):
        import_recording("rosbag", other, tmp_path / "other", ImportOptions())


COLOUR_POSE = rigid(Rotation.from_euler("xyz", (0.4, -0.3, 1.0), degrees=True).as_matrix(), (14.7, -0.2, 0.3))
INFRARED = np.array([[380.0, 0, 160.5], [0, 380, 118.0], [0, 0, 1]])


def viewer(with_depth: bool, lens: str = "Inverse Brown Conrady", k1: float = 0.0) -> Callable[[int, Any], Messages]:
    """As RealSense's viewer records: all frames are called 0, the reference is the left infrared camera."""

    def messages(version: int, types: Any) -> Messages:
        apart = rigid(np.eye(3), (-50.0, 0, 0))
        names = {"sensor_0/Depth_0": np.eye(4), "sensor_1/Color_0": COLOUR_POSE}
        names = names if with_depth else {"sensor_0/Infrared_2": apart, "sensor_0/Infrared_1": np.eye(4)}
        for name, pose in names.items():
            K = LEFT.K if "Color" in name else INFRARED
            content = info(version, types, K, np.array([k1, 0, 0, 0, 0]), np.zeros((3, 3)), np.zeros((3, 4)))
            yield f"/device_0/{name}/info/camera_info", 0, replace(content, distortion_model=lens)
            x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
            yield (
                f"/device_0/{name}/tf/0",
                0,
                types["geometry_msgs/msg/Transform"](
                    translation=types["geometry_msgs/msg/Vector3"](*(pose[:3, 3] / 1000).tolist()),
                    rotation=types["geometry_msgs/msg/Quaternion"](x, y, z, w),
                ),
            )
        yield "/device_0/sensor_0/option/Depth Units/value", 0, types["std_msgs/msg/Float32"](data=0.0001)
        for frame in range(2):
            stamp_ns = 10**9 + frame * 33_000_000
            for name in names:
                kind = "mono16" if "Depth" in name else "rgb8" if "Color" in name else "mono8"
                depth = np.full(SIZE[::-1], 15000 + 100 * frame, np.uint16)
                shape = (*SIZE[::-1], 3) if kind == "rgb8" else SIZE[::-1]
                pixels = depth if kind == "mono16" else np.full(shape, 60 + 10 * ("_2" in name), np.uint8)
                yield f"/device_0/{name}/image/data", stamp_ns, image(types, stamp_ns, "0", kind, pixels)

    return messages


def test_depth_of_realsenses_viewer_is_brought_into_its_pictures(tmp_path: Path) -> None:
    source = write(tmp_path / "a", 1, viewer(with_depth=True))
    capture = import_recording(AUTO, source, tmp_path / "out", ImportOptions(fps=30))
    assert capture.n_frames == 2
    np.testing.assert_allclose(capture.sensors[0].left.camera.K, LEFT.K)
    values = read_depth_map(tmp_path / "out", capture.sensors[0], 1)  # a plane at 1510 mm from the depth camera
    K = scaled_camera(Camera(LEFT.K, SIZE, np.eye(4)), values.shape[::-1]).K
    rows, columns = np.nonzero(np.isfinite(values))
    rays = np.column_stack([columns, rows, np.ones(len(rows))]) @ np.linalg.inv(K).T
    normal = COLOUR_POSE[:3, 2]
    plane = (1510 + normal @ COLOUR_POSE[:3, 3]) / (rays @ normal)
    assert np.abs(values[rows, columns] - plane).max() < 0.2
    assert np.isfinite(values[80:120, 100:150]).all()


def test_infrared_of_realsenses_viewer_is_a_pair_by_its_transforms(tmp_path: Path) -> None:
    source = write(tmp_path / "a", 1, viewer(with_depth=False, lens="Brown Conrady"))
    import_recording("rosbag", source, tmp_path / "out", OPTIONS)
    sensor = read_capture(tmp_path / "out").sensors[0]
    assert sensor.right is not None
    relative = sensor.right.camera.cam_from_world @ np.linalg.inv(sensor.left.camera.cam_from_world)
    np.testing.assert_allclose(relative, rigid(np.eye(3), (-50.0, 0, 0)), atol=1e-9)
    left, right = read_frame(read_capture(tmp_path / "out"), "S1", 0)
    assert (left[0, 0, 0], right[0, 0, 0]) == (60, 70)


def test_a_lens_of_realsense_that_opencv_has_not_is_refused_where_it_has_numbers(tmp_path: Path) -> None:
    source = write(tmp_path / "a", 1, viewer(with_depth=True, k1=0.1))
    with pytest.raises(CaptureError, match="the camera model is Inverse Brown Conrady, expected one of"):
        import_recording("rosbag", source, tmp_path / "out", ImportOptions())


def test_topics_that_are_no_pair_are_listed(tmp_path: Path) -> None:
    source = write(tmp_path / "a", 2, stereo)
    options = ImportOptions(bounds=BOUNDS, shots=["/left/image_raw"])
    with pytest.raises(CaptureError, match=r"are /left/image_raw; expected two: .* Name them by --shots"):
        import_recording("rosbag", source, tmp_path / "out", options)
    (tmp_path / "no.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(50))
    with pytest.raises(CaptureError, match="is not readable as a bag"):
        import_recording("rosbag", tmp_path / "no.bag", tmp_path / "out", OPTIONS)


def test_packed_depth_maps_of_a_bag_are_named_with_the_way_out(tmp_path: Path) -> None:
    def messages(version: int, types: Any) -> Messages:
        for topic, stamp_ns, message in depth_camera("/camera/aligned")(version, types):
            if topic == "/camera/aligned/image_raw":
                packed = types["sensor_msgs/msg/CompressedImage"](
                    header=message.header, format="16UC1; compressedDepth png", data=np.zeros(20, np.uint8)
                )
                yield f"{topic}/compressedDepth", stamp_ns, packed
            else:
                yield topic, stamp_ns, message

    source = write(tmp_path / "a", 2, messages)
    with pytest.raises(CaptureError, match="/camera/aligned/image_raw/compressedDepth: not read; republish as raw"):
        import_recording("rosbag", source, tmp_path / "out", OPTIONS)


@pytest.mark.parametrize(
    ("suffix", "form", "n_lost"), [(".jpg", "bgr8; jpeg compressed bgr8", 40), (".png", "16UC1; png compressed ", 0)]
)
def test_a_packed_picture_that_is_cut_off_or_of_depths_is_refused(
    tmp_path: Path, suffix: str, form: str, n_lost: int
) -> None:
    def packed(version: int, types: Any) -> Messages:
        for topic, stamp_ns, message in stereo(version, types):
            if topic.endswith("image_raw"):
                values = np.random.default_rng(1).integers(0, 255, SIZE[::-1]).astype(np.uint8)
                content = cv2.imencode(suffix, values)[1]
                kind = types["sensor_msgs/msg/CompressedImage"]
                whole = kind(header=message.header, format=form, data=content[: len(content) - n_lost].copy())
                yield f"{topic}/compressed", stamp_ns, whole
            else:
                yield topic, stamp_ns, message

    source = write(tmp_path / "source", 2, packed)
    with pytest.raises(CaptureError, match=f"a picture as {form} of .* is not readable, cut off, or a depth map"):
        import_recording("rosbag", source, tmp_path / "out", OPTIONS)
