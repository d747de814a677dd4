"""OpenCV stereo calibrations (YAML or XML), read and written, and recordings that come with one.

Convention: as `cv2.stereoCalibrate`: X_right = R X_left + T, pixel centres at integers, distortion k1, k2, p1, p2,
k3, ... A file of one sensor has the keys of KEYS at its top; a file of several has `sensors`, a list of maps with
`id`, the same keys and `cam_from_world` (4x4, of the left camera), lengths in the unit of T. Either may have
`held_out`, a list of maps with `image`, `K`, `D` and `cam_from_world` of photographs that no sensor uses. Without a
pose the world is the left camera's frame turned by half a circle about x: x right, y up, the camera looks along -z.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from recon.capture.format import Capture
from recon.capture.images import CaptureError
from recon.capture.importing.calibrations.placed import read_yaml
from recon.capture.importing.calibrations.stereo_entry import stereo_sensor
from recon.capture.importing.into_capture import write_recording
from recon.capture.importing.lenses import with_lens
from recon.capture.importing.sources import ImportOptions, Recording, SensorSource, faults_at
from recon.capture.importing.views import tell_absent
from recon.capture.pictures import Pictures, find_pictures
from recon.geometry.lens_names import model_name
from recon.geometry.rig import Camera, Rig, Sensor
from recon.runtime.files import allowed, check_exists, check_suffix, in_any_case, whole_file

SUFFIXES = (".yml", ".yaml", ".xml")


def import_opencv(source: Path, out: Path, options: ImportOptions | None = None) -> Capture:
    """Turn a stereo calibration and its pictures into a capture.

    Parameters
    ----------
    source : the calibration file, or a folder with one or several (`intrinsics.yml` and `extrinsics.yml`); beside
        it, for one sensor, `left` and `right`, for several `ID/left` and `ID/right`: folders of images, with a clean
        plate `plate.png` or without, or videos (`left.mp4`)
    options : the unit's default is mm

    Raises
    ------
    CaptureError
        Naming the file and what is wrong in it. Nothing is left behind.
    """
    options = options or ImportOptions()
    folder, files = _files(source)
    entries = _merged(files)
    sensors = tuple(
        _source(folder if len(entries) == 1 and not base.is_dir() else base, name, entry, options)
        for name, entry in entries.items()
        for base in [in_any_case(folder / name)]
    )
    held_out = _held_out(folder, files, options.unit_mm or 1.0)
    return write_recording(out, Recording(folder.name, sensors, held_out=held_out), options)


def write_calibration(path: Path, rig: Rig) -> None:
    """Write a rig as an OpenCV file, flat for one sensor, lengths in mm; `import_opencv` reads it.

    A ValueError says that the name does not end in one of SUFFIXES.
    """
    check_suffix(path, SUFFIXES)
    with whole_file(path) as temporary:
        storage = cv2.FileStorage(str(temporary), cv2.FILE_STORAGE_WRITE)
        if len(rig.sensors) == 1:
            _write_sensor(storage, rig.sensors[0])
        else:
            storage.startWriteStruct("sensors", cv2.FILE_NODE_SEQ)
            for sensor in rig.sensors:
                storage.startWriteStruct("", cv2.FILE_NODE_MAP)
                _write_sensor(storage, sensor)
                storage.endWriteStruct()
            storage.endWriteStruct()
        storage.release()


def _write_sensor(storage: Any, sensor: Sensor) -> None:
    storage.write("id", sensor.id)
    storage.write("image_size", np.array([sensor.left.size], dtype=np.int32))
    for number, camera in ((1, sensor.left), (2, sensor.right)):
        storage.write(f"K{number}", camera.K)
        storage.write(f"D{number}", camera.dist[None] if camera.dist.size else np.zeros((1, 5)))
    storage.write("R", sensor.right_from_left[:3, :3])
    storage.write("T", sensor.right_from_left[:3, 3:])
    storage.write("cam_from_world", sensor.left.cam_from_world)


def _files(source: Path) -> tuple[Path, list[Path]]:
    if source.is_file():
        return source.parent, [source]
    check_exists(source)
    files = sorted(path for path in source.iterdir() if path.suffix.lower() in SUFFIXES)
    if not files:
        below = sorted({path.parent.name for path in source.glob("*/*") if path.suffix.lower() in SUFFIXES})
        elsewhere = (
            f" but in {', '.join(below)}: name one of these folders, or write one file that also tells where the "
            "sensors stand, as `capture calibrate` does"
        )
        raise CaptureError(f"{source}: holds no calibration file ({', '.join(SUFFIXES)}){elsewhere if below else ''}")
    return source, files


def _merged(files: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Return the entries of every sensor by its id; several files are one sensor's, each with some of the keys."""
    contents = [_read(path) for path in files]
    place = ", ".join(map(str, files))
    if len(files) == 1 and isinstance(contents[0].get("sensors"), list):
        entries = contents[0]["sensors"]
        with faults_at(place):
            names = [str(entry.get("id", f"S{number}")) for number, entry in enumerate(entries, 1)]
            if len(set(names)) < len(names):
                raise CaptureError(f"sensor ids must differ, found {', '.join(names)}")
        return {name: {**entry, "": place} for name, entry in zip(names, entries, strict=True)}
    merged: dict[str, Any] = {}
    for path, content in zip(files, contents, strict=True):
        twice = [key for key in content if key in merged and not np.array_equal(content[key], merged[key])]
        if twice:
            raise CaptureError(f"{path}: {twice[0]} differs from another file's; name one file as the source")
        merged |= content
    return {str(merged.get("id", "S1")): {**merged, "": place}}


def _read(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        with faults_at(path):
            content = _value(storage.root())
    except (cv2.error, SystemError) as error:
        content = _plain(path, error)
    if not isinstance(content, dict):
        raise CaptureError(f"{path}: is not an OpenCV YAML or XML file")
    return content


def _plain(path: Path, error: Exception) -> Any:
    """Read a file as any other program's YAML, with lists in place of OpenCV's matrices."""
    try:
        content = read_yaml(path)
    except CaptureError:
        raise CaptureError(f"{path}: is not an OpenCV YAML or XML file") from error
    with faults_at(path):
        return _with_matrices(content)


def _with_matrices(value: Any) -> Any:
    if isinstance(value, dict):
        return _map_or_matrix({key: _with_matrices(part) for key, part in value.items()})
    return [_with_matrices(part) for part in value] if isinstance(value, list) else value


def _value(node: Any) -> Any:
    if node.isMap():
        keys = node.keys()
        return _map_or_matrix({key: _value(node.getNode(key)) for key in keys})
    if node.isSeq():
        return [_value(node.at(number)) for number in range(node.size())]
    return node.string() if node.isString() else node.real()


def _map_or_matrix(content: dict[str, Any]) -> Any:
    is_matrix = "data" in content and ("rows" in content or "sizes" in content)  # sizes of one with one dimension
    return _stored_matrix(content) if is_matrix else content


def _stored_matrix(content: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return a matrix of a file; OpenCV's own reader writes past its memory where rows or columns are wrong."""
    told = content["sizes"] if "sizes" in content else [content.get("rows"), content.get("cols")]
    values = np.ravel(content["data"])
    shape = [int(length) for length in np.array(told, np.float64)]
    if min(shape, default=0) < 0:
        raise CaptureError(f"a matrix has {shape} rows and columns")
    channels = values.size // max(1, abs(int(np.prod(shape))))
    return np.asarray(values.reshape(shape if channels <= 1 else [*shape, channels]), np.float64)


def _source(base: Path, name: str, entry: Mapping[str, Any], options: ImportOptions) -> SensorSource:
    pictures = find_pictures(base / "left"), find_pictures(base / "right")
    sensor = stereo_sensor(name, entry, pictures[0].size, options.unit_mm or 1.0)
    return SensorSource(name, sensor.left, sensor.right, pictures)


def _held_out(folder: Path, files: Sequence[Path], unit_mm: float) -> tuple[tuple[Camera, Path], ...]:
    """Return the photographs that no sensor uses, without those that are not there."""
    held_out, absent = [], []
    for entry in (entry for file in files for entry in _read(file).get("held_out", ())):
        with faults_at(f"{folder}: held_out"):
            path = allowed(folder / str(entry["image"]))
            if not path.is_file():
                absent.append(str(entry["image"]))
                continue
            pose = np.array(entry["cam_from_world"], np.float64)
            pose[:3, 3] *= unit_mm
            camera = Camera(entry["K"], Pictures((path,)).size, pose)
            held_out.append((with_lens(camera, model_name(entry), np.asarray(entry.get("D", ()), np.float64)), path))
    tell_absent(folder, absent)
    return tuple(held_out)
