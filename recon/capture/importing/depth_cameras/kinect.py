"""Recordings of Azure Kinect and Femto cameras: Matroska with tracks of pictures and depth maps, and the calibration.

Convention: the calibration's numbers are shares of the whole sensor, whose corner is the origin; a mode of the camera
scales them to a grid and cuts a part out. Poses are the camera from the world, metres; depth maps are in mm.

Source: Azure Kinect Sensor SDK, "Recording file format", and its mode-specific calibration.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import imageio_ffmpeg
import numpy as np

from recon.capture.depth_maps import read_depth_values
from recon.capture.format import Capture
from recon.capture.images import CaptureError
from recon.capture.importing.calibrations.placed import pinhole
from recon.capture.importing.depth_cameras.aligned import Alignment
from recon.capture.importing.depth_cameras.sequences import LATEST_S, METRE, DepthCamera, Shot, recorded
from recon.capture.importing.into_capture import write_recording
from recon.capture.importing.sources import ImportOptions, faults_at
from recon.capture.importing.views import HALF_PIXEL
from recon.capture.pictures import Pictures
from recon.geometry.rig import Camera, rigid
from recon.runtime.files import files_like, read_json

DEPTH_MODES = {  # the grid's side, and where the picture begins in it, by the picture's size
    (640, 576): (1024, (192, 180)),
    (320, 288): (512, (96, 90)),
    (512, 512): (512, (0, 0)),
    (1024, 1024): (1024, (0, 0)),
}
COLOUR_ASPECT = 4 / 3  # of the whole sensor, of which wide pictures are the middle
WHICH = {"COLOR": "CALIBRATION_CameraLocationPV0", "DEPTH": "CALIBRATION_CameraLocationD0"}
MODEL = "CALIBRATION_LensDistortionModelBrownConrady"
TO_OPENCV = (4, 5, 13, 12, 6, 7, 8, 9)  # places of k1, k2, p1, p2, k3 to k6
TICKS = re.compile(r"([\d.]+)(k?) tbn")  # of the file's clock, a second
KILO = 1000


def import_kinect(source: Path, out: Path, options: ImportOptions) -> Capture:
    """Turn a recording of `k4arecorder` into a capture of one camera with depth maps, brought into its pictures.

    Parameters
    ----------
    source : the `.mkv`, or a folder with one
    out : the capture's folder, absent or empty
    options : `n_frames` how many to read

    Raises
    ------
    CaptureError
        If it lacks a track or the calibration, or is of a mode that is not known.
    """
    inside = files_like(source, "*.mkv") if source.is_dir() else [source]
    if len(inside) != 1:
        raise CaptureError(f"{source}: holds {len(inside)} files .mkv, expected one; name it")
    path = inside[0].resolve()
    with TemporaryDirectory() as work:
        taken, fps = _unpacked(path, Path(work), options.n_frames)
        return write_recording(out, replace(recorded(path, taken, options), fps=fps), options)


def _unpacked(path: Path, work: Path, n_frames: int | None) -> tuple[DepthCamera, float | None]:
    """Write pictures and depth maps of the same instants, and return what recorded them, and frames a second."""
    calibration = work / "calibration.json"
    _ffmpeg("-dump_attachment:t:0", str(calibration), "-i", str(path))
    if not calibration.is_file():
        raise CaptureError(f"{path}: has no calibration attached, as recordings of k4arecorder have")
    listed = _ffmpeg("-i", str(path))
    told = TICKS.search(listed)
    if told is None:
        raise CaptureError(f"{path}: holds no track that can be read")
    ticks = float(told[1]) * (KILO if told[2] else 1)
    pictures = _frames(path, work, "COLOR", "jpg" if "Video: mjpeg" in listed else "png", n_frames)
    depths = _frames(path, work, "DEPTH", "png", n_frames)
    with faults_at(f"{path}: calibration"):
        content = read_json(calibration)["CalibrationInformation"]["Cameras"]
        cameras = {
            track: _camera(content, track, Pictures((next(iter(files.values())),)).size)
            for track, files in (("COLOR", pictures), ("DEPTH", depths))
        }
    alignment = Alignment(cameras["DEPTH"], cameras["COLOR"])
    stamps, shots = np.array(list(depths)), []
    for number, (stamp, picture) in enumerate(pictures.items()):
        nearest = int(np.abs(stamps - stamp).argmin())
        if abs(stamps[nearest] - stamp) <= LATEST_S * ticks:
            depth = work / f"aligned/{number:06d}.npy"
            depth.parent.mkdir(exist_ok=True)
            np.save(depth, alignment.moved(read_depth_values(depths[stamps[nearest]])))
            shots.append(Shot(f"{number:06d}", picture, depth, None))
    steps = np.diff(list(pictures))
    fps = round(ticks / float(np.mean(steps)), 1) if len(steps) else None
    return DepthCamera(cameras["COLOR"], 1.0, shots, size=alignment.target.size), fps


def _frames(path: Path, work: Path, track: str, suffix: str, n_frames: int | None) -> dict[int, Path]:
    """Write the frames of a track, and return their files by their times, in ticks of the file's clock."""
    folder = work / track
    folder.mkdir()
    kept = ("-c", "copy") if suffix == "jpg" else ("-enc_time_base", "demux")
    timed = ("-copyts", "-fps_mode", "passthrough", *kept, "-frame_pts", "1")
    most = () if n_frames is None else ("-frames:v", str(2 * n_frames))
    told = _ffmpeg("-i", str(path), "-map", f"0:m:title:{track}", *timed, *most, str(folder / f"%d.{suffix}"))
    files = {int(file.stem): file for file in sorted(folder.iterdir(), key=lambda file: int(file.stem))}
    if not files:
        raise CaptureError(f"{path}: has no track {track} that can be read: {told.strip().rpartition(chr(10))[2]}")
    return files


def _ffmpeg(*words: str) -> str:
    """Run ffmpeg on a file alone, whatever it refers to, and return what it says."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-y", "-protocol_whitelist", "file", *words]
    return subprocess.run(command, capture_output=True, check=False).stderr.decode("utf-8", "replace")


def _camera(cameras: list[Mapping[str, Any]], track: str, size: tuple[int, int]) -> Camera:
    """Return a camera in the mode that its pictures' size tells."""
    entry = next((camera for camera in cameras if camera["Location"] == WHICH[track]), None)
    if entry is None:
        raise CaptureError(f"no camera has the Location {WHICH[track]}, that of the track {track}")
    if (model := entry["Intrinsics"]["ModelType"]) != MODEL:
        raise CaptureError(f"the lens's model is {model}, expected {MODEL}")
    if track == "DEPTH":
        if size not in DEPTH_MODES:
            raise CaptureError(f"depth maps have {size[0]}x{size[1]} pixels, expected {[*DEPTH_MODES]}")
        side, corner = DEPTH_MODES[size]
        grid = (side, side)
    else:
        grid = (size[0], round(size[0] / COLOUR_ASPECT))
        corner = (0, (grid[1] - size[1]) // 2)
        sensor = entry["SensorWidth"] / entry["SensorHeight"]
        if abs(sensor - COLOUR_ASPECT) > 1e-3:
            raise CaptureError(f"the calibration is for a sensor of {sensor:.3f} to 1, expected 4 to 3")
    numbers = [float(number) for number in entry["Intrinsics"]["ModelParameters"]]
    cx, cy = (numbers[axis] * grid[axis] - corner[axis] - HALF_PIXEL for axis in (0, 1))
    K = pinhole((numbers[2] * grid[0], numbers[3] * grid[1], cx, cy))
    pose = entry["Rt"]
    rotation = np.array(pose["Rotation"], np.float64).reshape(3, 3)
    return Camera(
        K,
        size,
        rigid(rotation, np.array(pose["Translation"], np.float64) * METRE),
        np.array([numbers[place] for place in TO_OPENCV]),
    )
