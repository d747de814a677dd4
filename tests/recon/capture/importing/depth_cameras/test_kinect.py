"""Recordings as k4arecorder writes them: the cameras are those of its calibration, depth stands in the pictures."""

from __future__ import annotations

import json
import struct
import subprocess
from pathlib import Path
from typing import Any

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from recon.capture.depth_maps import depth_size, read_depth_map
from recon.capture.format import CaptureError, read_frame
from recon.capture.importing.formats import AUTO, find_format, import_recording
from recon.capture.importing.sources import ImportOptions
from recon.capture.rectify import scaled_camera
from recon.geometry.rig import Camera
from tests.recon.capture.importing.labelled_recording import TURNED, seen

SIZE, DEPTH_SIZE = (1280, 720), (320, 288)
LENS = [0.52, -2.5, 0.0008, -0.0004, 1.4, 0.4, -2.3, 1.3]  # k1 k2 p1 p2 k3 to k6, as OpenCV orders them
TURN = cv2.Rodrigues(np.array([0.1, 0.01, -0.02]))[0]
SHIFT = (-0.032, -0.002, 0.004)


def entry(place: str, numbers: tuple[float, float, float, float], lens: list[float], size: tuple[int, int]) -> Any:
    k1, k2, p1, p2, k3, k4, k5, k6 = lens
    is_colour = place == "PV0"
    return {
        "Intrinsics": {
            "ModelParameterCount": 14,
            "ModelParameters": [*numbers, k1, k2, k3, k4, k5, k6, 0, 0, p2, p1],
            "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
        },
        "Location": f"CALIBRATION_CameraLocation{place}",
        "Rt": {
            "Rotation": (TURN if is_colour else np.eye(3)).ravel().tolist(),
            "Translation": list(SHIFT if is_colour else (0, 0, 0)),
        },
        "SensorWidth": size[0],
        "SensorHeight": size[1],
    }


CALIBRATION = {
    "CalibrationInformation": {
        "Cameras": [
            entry("D0", (0.513, 0.517, 0.4928, 0.4929), [0.0] * 8, (1024, 1024)),
            entry("PV0", (0.4998, 0.5066, 0.478, 0.6374), LENS, (4096, 3072)),
        ]
    }
}


def ffmpeg(*words: str) -> None:
    subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error", *words], check=True)


def recording(folder: Path, calibration: Any = CALIBRATION, depth_track: str = "DEPTH") -> Path:
    """Three instants of a plane at 1500 mm; the depth map of the second was lost."""
    folder.mkdir(parents=True)
    (folder / "calibration.json").write_text(json.dumps(calibration))
    for frame in range(3):
        cv2.imwrite(str(folder / f"c{frame}.jpg"), np.full((SIZE[1], SIZE[0], 3), (40, 90, 200), np.uint8))
        depth = np.full(DEPTH_SIZE[::-1], 1500 + frame, np.uint16)
        depth[:20] = 0
        cv2.imwrite(str(folder / f"d{frame}.png"), depth)
    path = folder / "recording.mkv"
    ffmpeg(
        *("-framerate", "15", "-i", str(folder / "c%d.jpg"), "-framerate", "15", "-i", str(folder / "d%d.png")),
        *("-map", "0", "-map", "1", "-c:v:0", "copy", "-bsf:v:1", "noise=drop=eq(n\\,1)"),
        *("-c:v:1", "rawvideo", "-pix_fmt:v:1", "gray16be", "-tag:v:1", "b16g"),
        *("-allow_raw_vfw", "1"),
        *("-metadata:s:v:0", "title=COLOR", "-metadata:s:v:1", f"title={depth_track}"),
        *("-attach", str(folder / "calibration.json"), "-metadata:s:t", "mimetype=application/octet-stream"),
        str(path),
    )
    width, height = DEPTH_SIZE
    content, header = path.read_bytes(), struct.pack("<iihh4x", width, -height, 1, 16)
    assert content.count(header) == 1
    path.write_bytes(content.replace(header, struct.pack("<iihh4s", width, height, 1, 16, b"b16g")))  # as the SDK
    for other in [*folder.glob("*.jpg"), *folder.glob("*.png"), folder / "calibration.json"]:
        other.unlink()
    return path


@pytest.mark.slow
def test_depth_stands_in_the_pictures_of_the_same_instants(tmp_path: Path) -> None:
    source = recording(tmp_path / "source")
    assert find_format(source) == find_format(source.parent) == "kinect"
    capture = import_recording(AUTO, source, tmp_path / "out", ImportOptions())
    assert (capture.n_frames, capture.fps) == (2, 15)
    camera = capture.sensors[0].left.camera
    K = np.array([[0.478 * 1280, 0, 0.4998 * 1280 - 0.5], [0, 0.6374 * 960, 0.5066 * 960 - 120 - 0.5], [0, 0, 1]])
    ahead = np.array([[100.0, 50, 1500], [-600, 300, 1200], [10, -200, 3000]])
    expected = cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), K, np.array(LENS))[0][:, 0]
    np.testing.assert_allclose(seen(camera, ahead @ TURNED.T), expected, atol=1e-6)
    left = read_frame(capture, "S1", 0)[0]
    assert np.abs(left[300, 300].astype(int) - (200, 90, 40)).max() < 4
    size = depth_size(capture.sensors[0])
    values = read_depth_map(tmp_path / "out", capture.sensors[0], 1)  # of the third instant: z' of the plane z = 1502
    target = scaled_camera(Camera(K, SIZE, np.eye(4), np.array(LENS)), size)
    rows, columns = np.nonzero(np.isfinite(values))
    rays = cv2.undistortPoints(np.column_stack([columns, rows]).astype(float), target.K, target.dist)
    normal, offset = TURN @ [0, 0, 1], 1502 + (TURN @ [0, 0, 1]) @ (np.array(SHIFT) * 1000)
    plane = offset / (np.column_stack([rays[:, 0], np.ones(len(rays))]) @ normal)
    off = values[rows, columns] - plane
    assert np.quantile(np.abs(off), 0.99) < 1.5  # half a pixel of a plane that is tilted by 6 degrees
    middle = values[size[1] // 3 : size[1] // 2, size[0] // 3 : size[0] // 2]
    assert np.isfinite(middle).all(), "there are no holes"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "track", "sentence"),
    [
        ({}, "IR", "has no track DEPTH that can be read"),
        ({"ModelType": "CALIBRATION_LensDistortionModelTheta"}, "DEPTH", "the lens's model is .*Theta, expected"),
        ({"ModelParameters": [0.5]}, "DEPTH", "calibration"),
        ({"Location": "elsewhere"}, "DEPTH", "calibration: no camera has the Location CALIBRATION_CameraLocation"),
    ],
)
def test_what_a_recording_lacks_is_named(tmp_path: Path, changes: dict[str, Any], track: str, sentence: str) -> None:
    calibration = json.loads(json.dumps(CALIBRATION))
    calibration["CalibrationInformation"]["Cameras"][0]["Intrinsics"] |= changes
    calibration["CalibrationInformation"]["Cameras"][0] |= {
        key: changes[key] for key in ("Location",) if key in changes
    }
    source = recording(tmp_path / "source", calibration, track)
    with pytest.raises(CaptureError, match=sentence):
        import_recording("kinect", source, tmp_path / "out", ImportOptions())
    assert not (tmp_path / "out").exists()
