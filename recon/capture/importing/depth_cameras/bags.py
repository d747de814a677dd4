"""Bags of ROS 1 and 2: a stereo pair with its camera_info, or a camera with depth maps aligned to its pictures.

The frames are written beside each other in the form that the readers of such recordings take.

RealSense's viewer tells where its cameras are: its depth maps are brought into the pictures.

Source: `sensor_msgs/Image.msg`, `CameraInfo.msg`; REP 104 and 118; librealsense, "Record and playback".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from recon.capture.format import Capture
from recon.capture.images import CaptureError, is_cut, write_picture
from recon.capture.importing.calibrations.placed import CAMERA_FROM_WORLD, Placed, lens_camera
from recon.capture.importing.calibrations.robots import read_ros
from recon.capture.importing.depth_cameras.aligned import Alignment
from recon.capture.importing.depth_cameras.sequences import LATEST_S, METRE, DepthCamera, Shot, recorded
from recon.capture.importing.into_capture import write_recording
from recon.capture.importing.sources import ImportOptions, turn_of
from recon.capture.importing.views import View, choose_sensors
from recon.capture.recording import SIDES
from recon.geometry.rig import Camera, rigid
from recon.runtime.files import files_like
from recon.runtime.picture_size import check_announced

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
INFO = "sensor_msgs/msg/CameraInfo"
COLOURS: Mapping[str, tuple[str, int, int | None]] = {  # type, channels, and what makes RGB of them
    "rgb8": ("u1", 3, None),
    "bgr8": ("u1", 3, cv2.COLOR_BGR2RGB),
    "rgba8": ("u1", 4, cv2.COLOR_RGBA2RGB),
    "bgra8": ("u1", 4, cv2.COLOR_BGRA2RGB),
    "mono8": ("u1", 1, None),
    "8UC1": ("u1", 1, None),
    "mono16": ("u2", 1, None),
    "bayer_rggb8": ("u1", 1, cv2.COLOR_BayerBG2RGB),
    "bayer_bggr8": ("u1", 1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg8": ("u1", 1, cv2.COLOR_BayerGR2RGB),
    "bayer_grbg8": ("u1", 1, cv2.COLOR_BayerGB2RGB),
}  # OpenCV names the pattern by its second row
DEPTHS = {"16UC1": ("u2", None), "32FC1": ("f4", METRE)}  # type, and mm of a 1, None where the bag may tell
ALIGNED = ("aligned", "registered")  # in the topic of depth maps that belong to another camera's pictures
TRANSFORM = "geometry_msgs/msg/Transform"
UNITS = ("option/Depth Units/value", "option/Depth_Units/value")  # of RealSense, in metres


@dataclass(frozen=True)
class _Topic:
    """A topic of pictures, with the first message of its camera_info and the encoding of its first picture.

    Parameters
    ----------
    pose : `cam_from_reference`, mm, where the bag tells it, as RealSense's viewer does; else None
    step_mm : of depth maps in whole numbers
    """

    name: str
    encoding: str
    info: Any
    pose: NDArray[np.float64] | None = None
    step_mm: float = 1.0

    @property
    def is_depth(self) -> bool:
        """Whether it has depth maps."""
        return self.encoding in DEPTHS or (self.encoding == "mono16" and "depth" in self.name.lower())

    @property
    def camera(self) -> Camera:
        """The camera of its pictures."""
        content, size = _camera_info(self), (self.info.width, self.info.height)
        K, pose = np.array(content["k"], np.float64).reshape(3, 3), np.eye(4) if self.pose is None else self.pose
        return lens_camera(self.name, content, K, size, pose, content["d"])


def import_bag(source: Path, out: Path, options: ImportOptions) -> Capture:
    """Turn a bag into a capture of a stereo pair, or of a camera with depth maps.

    Parameters
    ----------
    source : a `.bag` of ROS 1, or the folder of ROS 2, or the file in it
    out : the capture's folder, absent or empty
    options : `shots` are the topics to take, where a bag has more than two; `n_frames` how many instants to read

    Raises
    ------
    CaptureError
        Naming the bag, and what is wrong with it. Nothing is left behind.
    """
    source = source.parent if source.is_file() and source.suffix.lower() != ".bag" else source
    inside = files_like(source, "*.bag") if source.is_dir() else []
    source = inside[0] if len(inside) == 1 else source
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise CaptureError(f"{source}: bags need rosbags: pip install 'reconstudy[ros]'") from error
    try:
        reading = AnyReader([source], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
        with reading as reader, TemporaryDirectory() as work:
            return _import(reader, source, out, Path(work), options)
    except Exception as error:  # of a damaged bag, its reader lets through what its database or its checks raise
        if isinstance(error, ValueError) and not isinstance(error, UnicodeError):
            raise
        raise CaptureError(f"{source}: is not readable as a bag: {error}") from error


def _import(reader: Any, source: Path, out: Path, work: Path, options: ImportOptions) -> Capture:
    first, second = _two_topics(reader, source, options.shots)
    if not second.is_depth and first.pose is not None and second.pose is not None:
        first, second = sorted((first, second), key=lambda topic: float(topic.camera.centre[0]))
    instants = _instants(reader, (first.name, second.name), options.n_frames)
    if second.is_depth:
        camera = _with_depth(source, first, second, instants, work)
        return write_recording(out, recorded(source, camera, options), options)
    for number, messages in enumerate(instants):
        for side, topic, message in zip(SIDES, (first, second), messages, strict=True):
            _write_picture(work / side / f"{number:06d}.png", topic.name, message)
    if first.pose is not None and second.pose is not None:
        poses = CAMERA_FROM_WORLD, second.pose @ np.linalg.inv(first.pose) @ CAMERA_FROM_WORLD
        cameras = [
            replace(topic.camera, cam_from_world=pose) for topic, pose in zip((first, second), poses, strict=True)
        ]
        views = [View(side, camera, work / side) for side, camera in zip(SIDES, cameras, strict=True)]
        placed = Placed(dict(enumerate(views)))
    else:
        for side, topic in zip(SIDES, (first, second), strict=True):
            (work / f"{side}.yaml").write_text(yaml.safe_dump(_camera_info(topic)), encoding="utf-8")
        placed = read_ros(work, options.unit_mm or METRE)
    recording = choose_sensors(source, placed.views, placed.pairs, None)
    return write_recording(out, recording, options)


def _two_topics(reader: Any, source: Path, names: Sequence[str] | None) -> tuple[_Topic, _Topic]:
    """Return the topics of a left and a right camera, in any order, or of pictures and of their depth maps."""
    infos = {_place(connection.topic): connection for connection in reader.connections if connection.msgtype == INFO}
    topics = []
    for connection in reader.connections:
        place = _place(connection.topic)
        camera = infos.get(place)
        if connection.msgtype not in IMAGES or camera is None or (names and connection.topic not in names):
            continue
        picture, info = (_first(reader, each) for each in (connection, camera))
        if picture is not None and info is not None:
            encoding = getattr(picture, "encoding", "compressed")
            topics.append(_Topic(connection.topic, encoding, info, _pose(reader, place), _step_mm(reader, place)))
    depths = [topic for topic in topics if topic.is_depth]
    colours = [topic for topic in topics if not topic.is_depth]
    if len(colours) == 1 and len(depths) == 1:
        return colours[0], depths[0]
    if len(colours) == 2 and not (names and depths):
        return colours[0], colours[1]
    listed = ", ".join(topic.name for topic in topics) or "none"
    packed = [each.topic for each in reader.connections if each.topic.endswith("/compressedDepth")]
    way_out = f". {', '.join(packed)}: not read; republish as raw" if packed else ""
    raise CaptureError(
        f"{source}: its topics of pictures with camera_info are {listed}; expected two: a stereo pair, or pictures and "
        f"depth maps. Name them by --shots TOPIC,TOPIC{way_out}"
    )


def _place(topic: str) -> str:
    """Return what the topics of a camera begin with: `PLACE/camera_info`, of RealSense `PLACE/info/camera_info`."""
    place = topic.removesuffix("/compressed").rpartition("/")[0]
    return place.removesuffix("/info").removesuffix("/image")


def _pose(reader: Any, place: str) -> NDArray[np.float64] | None:
    """Return a camera's pose in the world of the device's reference, mm; None where the bag does not tell it."""
    connection = next(
        (each for each in reader.connections if each.topic == f"{place}/tf/0" and each.msgtype == TRANSFORM), None
    )
    told = None if connection is None else _first(reader, connection)
    if told is None:
        return None
    turn, shift = told.rotation, told.translation
    rotation = turn_of([turn.x, turn.y, turn.z, turn.w])
    return rigid(rotation, np.array([shift.x, shift.y, shift.z], np.float64) * METRE)


def _step_mm(reader: Any, place: str) -> float:
    """Return the length of a depth of 1: a millimetre, as in ROS, unless the device tells another."""
    sensor = place.rpartition("/")[0]
    names = [f"{sensor}/{name}" for name in UNITS]
    told = next((_first(reader, each) for each in reader.connections if each.topic in names), None)
    return 1.0 if told is None else float(told.data) * METRE


def _first(reader: Any, connection: Any) -> Any:
    raw = next(iter(reader.messages(connections=[connection])), None)
    return None if raw is None else reader.deserialize(raw[2], connection.msgtype)


def _instants(reader: Any, names: tuple[str, str], n_frames: int | None) -> Iterator[tuple[Any, Any]]:
    """Return messages of both topics of the same time, one pair in memory at a time."""
    connections = [connection for connection in reader.connections if connection.topic in names]
    return islice(_paired(reader, connections, names), n_frames)


def _paired(reader: Any, connections: Sequence[Any], names: tuple[str, str]) -> Iterator[tuple[Any, Any]]:
    waiting: dict[str, Any] = {}
    for connection, _, raw in reader.messages(connections=connections):
        waiting[connection.topic] = reader.deserialize(raw, connection.msgtype)
        if len(waiting) == len(names) and abs(_stamp(waiting[names[0]]) - _stamp(waiting[names[1]])) <= LATEST_S:
            yield waiting.pop(names[0]), waiting.pop(names[1])


def _stamp(message: Any) -> float:
    return float(message.header.stamp.sec + message.header.stamp.nanosec * 1e-9)


def _with_depth(
    source: Path, colour: _Topic, depth: _Topic, instants: Iterator[tuple[Any, Any]], work: Path
) -> DepthCamera:
    """Write pictures and depth maps; the camera is that of the pictures."""
    shots, is_placed = [], colour.pose is not None and depth.pose is not None
    alignment = Alignment(depth.camera, colour.camera) if is_placed else None
    for number, (picture, values) in enumerate(instants):
        is_aligned = picture.header.frame_id == values.header.frame_id or any(word in depth.name for word in ALIGNED)
        if not (is_aligned or is_placed):
            raise CaptureError(
                f"{source}: the depth maps of {depth.name} belong to another camera than {colour.name}; record them "
                "aligned (RealSense: align_depth.enable:=true; ROS: depth_image_proc/register)"
            )
        shot = Shot(f"{number:06d}", work / f"{number:06d}.png", work / f"depth/{number:06d}.npy", None)
        _write_picture(shot.picture, colour.name, picture)
        kind, step_mm = DEPTHS.get(values.encoding, DEPTHS["16UC1"])
        z = _pixels(depth.name, values, kind, 1)[..., 0].astype(np.float32) * (step_mm or depth.step_mm)
        z = np.where(z > 0, z, np.float32(np.nan))
        shot.depth.parent.mkdir(exist_ok=True)
        np.save(shot.depth, z if alignment is None else alignment.moved(z))
        shots.append(shot)
    return DepthCamera(colour.camera, 1.0, shots, size=None if alignment is None else alignment.target.size)


def _camera_info(topic: _Topic) -> dict[str, Any]:
    """Return a camera_info as `rostopic echo` prints it; of rectified pictures, that of the rectified camera."""
    info = topic.info
    k, d, r, p = (np.array(getattr(info, name, getattr(info, name.upper(), ()))) for name in ("k", "d", "r", "p"))
    if "rect" in topic.name.rpartition("/")[2]:
        k, d, r = p.reshape(3, 4)[:, :3].ravel(), np.zeros(5), np.eye(3).ravel()
    return {
        "width": int(info.width),
        "height": int(info.height),
        "distortion_model": str(info.distortion_model) or "plumb_bob",
        **{name: values.tolist() for name, values in (("k", k), ("d", d), ("r", r), ("p", p))},
    }


def _write_picture(path: Path, topic: str, message: Any) -> None:
    path.parent.mkdir(exist_ok=True)
    if not hasattr(message, "encoding"):  # compressed: JPEG or PNG as they are
        content, flags = bytes(message.data), cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
        check_announced(content, f"{topic}: a picture ")
        is_unread = is_cut(content) or message.format.partition(";")[0] in DEPTHS
        pixels = None if is_unread else cv2.imdecode(np.frombuffer(content, np.uint8), flags)
        if pixels is None:
            raise CaptureError(
                f"{topic}: a picture as {message.format} of {len(content)} bytes is not readable, cut off, or a depth "
                "map; republish it as raw"
            )
        write_picture(path, np.asarray(pixels, np.uint8))
        return
    if message.encoding not in COLOURS:
        raise CaptureError(f"{topic}: has pictures as {message.encoding}, expected one of {', '.join(COLOURS)}")
    kind, n_channels, to_rgb = COLOURS[message.encoding]
    pixels = _pixels(topic, message, kind, n_channels)
    plain = pixels[..., 0] if n_channels == 1 else pixels
    write_picture(path, np.asarray(plain if to_rgb is None else cv2.cvtColor(plain, to_rgb)))


def _pixels(topic: str, message: Any, kind: str, n_channels: int) -> NDArray[Any]:
    """Return the values of a picture (H, W, C), whose rows may be longer than they need to be."""
    dtype = np.dtype((">" if message.is_bigendian else "<") + kind)
    width, height, step = int(message.width), int(message.height), int(message.step)
    if len(message.data) != height * step or step < width * n_channels * dtype.itemsize or not width * height:
        raise CaptureError(
            f"{topic}: a picture of {width}x{height} pixels with rows of {step} bytes has {len(message.data)} bytes"
        )
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(height, step)[:, : width * n_channels * dtype.itemsize]
    values = np.ascontiguousarray(rows).view(dtype).reshape(height, width, n_channels)
    return values.astype(dtype.newbyteorder("="))
