"""Depth maps of a capture: read from any format and meaning, they put points on the true surface."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from recon.capture.checking import depth as depth_check
from recon.capture.checking.check import check_capture
from recon.capture.checking.sensor_report import SensorReport
from recon.capture.depth_maps import depth_view, given_disparity, read_depth_map, read_depth_values
from recon.capture.format import Capture, CaptureError, DepthMaps, SensorStream, read_capture, read_frame, write_capture
from recon.capture.masks.segment import segment_capture
from recon.capture.rectify import rectify_left
from recon.cloud import cloud_from_disparity
from recon.geometry.mesh import Cloud
from recon.geometry.rig import Camera
from recon.runtime.files import read_json, write_json
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MESH
from recon.validation.clouds import read_shape
from recon.validation.truth.evaluation import signed_distances_to

SIZE = (160, 90)


def record(folder: Path, *, distortion: float = 0.0) -> Capture:
    parameters = SynthParameters("sphere", 2, 1, SIZE, depth_maps=True, distortion=distortion)
    return synthesise(folder, parameters)


def cloud_of(capture: Capture, stream: SensorStream) -> Cloud:
    view = depth_view(stream, capture.bounds)
    disparity = given_disparity(read_depth_map(capture.folder, stream, 0), stream, view)
    return cloud_from_disparity(disparity, rectify_left(view, read_frame(capture, stream.id, 0)[0]), view)


def write_exr(path: Path, values: NDArray[np.float32], channel: str = "Z") -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {channel: values}) as file:
        file.write(str(path))


def rewritten(
    capture: Capture, suffix: str, write: Callable[[Path, NDArray[np.float32]], None], **meaning: object
) -> Capture:
    """The capture with its depth maps in another format and, by `meaning`, of other values."""
    sensors = []
    for stream in capture.sensors:
        z = read_depth_map(capture.folder, stream, 0)
        depth = DepthMaps(f"{stream.id}/again{suffix}", **meaning)  # type: ignore[arg-type]  # built by name
        camera = stream.left.camera
        columns, rows = np.meshgrid(np.arange(SIZE[0], dtype=np.float64), np.arange(SIZE[1]))
        pixels = np.stack([columns, rows], axis=2).reshape(-1, 1, 2)
        slopes = cv2.undistortPoints(pixels, camera.K, camera.dist if camera.dist.size else None).reshape(90, 160, 2)
        factor = np.sqrt(1 + (slopes**2).sum(axis=2)) if depth.kind == "distance" else 1.0
        write(capture.folder / depth.image, np.nan_to_num(z * factor / depth.scale_mm).astype(np.float32))
        sensors.append(replace(stream, depth=depth))
    return replace(capture, sensors=tuple(sensors))


@pytest.mark.slow
@pytest.mark.parametrize("distortion", [0.0, -0.1])
def test_true_depth_maps_put_every_point_on_the_true_surface(tmp_path: Path, distortion: float) -> None:
    capture = record(tmp_path / "capture", distortion=distortion)
    in_metres = {"scale_mm": 1000.0, "kind": "distance"}
    for variant in (
        capture,
        rewritten(capture, ".npy", lambda path, values: np.save(path, values), kind="distance"),
        rewritten(capture, ".exr", write_exr, **in_metres),
    ):
        truth = read_shape(capture.folder / MESH.format(frame=0))
        for stream in variant.sensors:
            cloud = cloud_of(variant, stream)
            assert len(cloud) > 400
            assert np.abs(signed_distances_to(truth, cloud.points)).max() < 0.5  # mm


def test_a_map_of_another_resolution_shows_the_same_plane(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    stream = capture.sensors[0]
    camera = stream.left.camera
    size = (SIZE[0] // 2, SIZE[1] // 2)
    normal, distance = np.array([0.2, -0.1, -1.0]), -2300.0  # in the camera's frame: n . X = distance
    columns, rows = np.meshgrid(2 * np.arange(size[0]) + 0.5, 2 * np.arange(size[1]) + 0.5)  # centres, in the picture
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=2) @ np.linalg.inv(camera.K).T
    np.save(capture.folder / "half.npy", distance / (rays @ normal))
    cloud = cloud_of(capture, replace(stream, depth=DepthMaps("half.npy", size=size)))
    assert len(cloud) > 0.9 * size[0] * size[1]
    assert np.abs(camera.points_in_camera(cloud.points) @ normal - distance).max() < 0.01


def test_a_capture_with_depth_maps_is_read_as_it_was_written(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    one, two = capture.sensors
    other = Camera(one.left.camera.K, SIZE, two.left.camera.cam_from_world)
    pair = replace(one, right=replace(one.left, camera=other), plate=None)
    depth = DepthMaps("S2/depth/0000.png", 0.5, "distance", (80, 45))
    write_capture(replace(capture, sensors=(pair, replace(two, depth=depth))))
    again = read_capture(capture.folder)
    assert [stream.sides for stream in again.sensors] == [("left", "right"), ("left",)]
    assert [stream.depth for stream in again.sensors] == [one.depth, depth]
    assert [stream.plate for stream in again.sensors] == [None, two.plate]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"scale_mm": 0}, "scale_mm is 0"),
        ({"kind": "ray"}, "kind is 'ray', expected one of z, distance"),
        ({"image": "S1/depth.tiff"}, "ends in '.tiff', expected one of .png, .exr, .npy"),
        ({"size": [4]}, "size is .4., expected"),
        ({"image": "S1/depth/9.png"}, "9.png: there is no such file"),
    ],
)
def test_what_is_wrong_with_the_description_of_depth_maps_is_named(
    tmp_path: Path, change: dict[str, object], sentence: str
) -> None:
    capture = record(tmp_path / "capture")
    content = read_json(capture.folder / "capture.json")
    content["sensors"][0]["depth"].update(change)
    write_json(capture.folder / "capture.json", content)
    with pytest.raises(CaptureError, match=sentence):
        read_capture(capture.folder)


@pytest.mark.slow
def test_the_check_names_every_fault_of_depth_maps(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    sound = check_capture(capture.folder)
    assert not sound.problems
    assert sound.sensors[0].depth_mm == pytest.approx(2400, abs=200)
    path = capture.folder / "S1/depth/0000.png"
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    for values, sentence in (
        (np.zeros_like(depth), "0000.png: holds no depth at all"),
        (depth[:45], "a depth map of 160x45 pixels, expected 160x90"),
        (depth.astype(np.uint8), "holds uint8 .*, expected one channel of 16 bits"),
        (depth // 10, "sensor S1: the depths are .* mm, about 10 times too small .* set scale_mm to 1 instead of 0.1"),
    ):
        cv2.imwrite(str(path), values)
        problems = check_capture(capture.folder).problems
        assert len(problems) == 1
        assert re.search(sentence, problems[0])
    in_metres = rewritten(record(tmp_path / "metres"), ".npy", lambda file, values: np.save(file, values / 1000))
    write_capture(in_metres)
    problems = check_capture(in_metres.folder).problems
    assert [problem.split(":")[0] for problem in problems] == ["sensor S1", "sensor S2"]
    assert "1000 times too small for the bounds; set scale_mm to 1000 instead of 1" in problems[0]


@pytest.mark.slow
def test_what_a_check_keeps_of_depth_maps_does_not_grow_with_their_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = record(tmp_path / "capture")
    kept: list[int] = []
    monkeypatch.setattr(depth_check, "SAMPLES", 1000)
    monkeypatch.setattr(depth_check, "_unit_problem", lambda _stream, points, _bounds: kept.append(len(points)))
    path = capture.folder / "S1/depth/0000.png"
    for frame in range(1, 8):
        shutil.copyfile(path, path.with_name(f"{frame:04d}.png"))
    for n_frames in (1, 8):
        assert not depth_check.check_depth_maps(capture.folder, capture.sensors[0], n_frames, capture.bounds).problems
    assert 500 < min(kept) <= max(kept) < 1500


def test_the_place_and_the_lens_of_a_camera_with_depth_maps_alone_could_not_be_checked() -> None:
    alone = SensorReport("S1", None, depth_coverage=0.9, depth_mm=2400.0)
    assert "whether its lens and its place are right could not be checked" in alone.verdict()
    assert "as it has no masks" in alone.verdict()
    assert "as it has no masks" not in replace(alone, mask_coverage=(0.3,)).verdict()


def test_a_depth_map_in_a_form_that_is_not_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.tiff").touch()
    with pytest.raises(CaptureError, match=r"a\.tiff: ends in '\.tiff', expected a depth map of \.png, \.npy"):
        read_depth_values(tmp_path / "a.tiff")


def test_damaged_files_and_other_pictures_are_no_depth_maps(tmp_path: Path) -> None:
    values = np.ones((4, 5), np.float32)
    write_exr(tmp_path / "layer.exr", values, "view.Depth.Z")
    np.testing.assert_array_equal(read_depth_values(tmp_path / "layer.exr"), values)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"A": values, "B": values}) as file:
        file.write(str(tmp_path / "two.exr"))
    np.save(tmp_path / "colour.npy", np.ones((4, 5, 3)))
    channels = b"".join(b"c%06d\0" % number + bytes(16) for number in range(5000))
    listed = b"channels\0chlist\0" + len(channels).to_bytes(4, "little") + channels
    (tmp_path / "many.exr").write_bytes(b"v/1\x01\x02\0\0\0" + listed)
    for name in ("cut.exr", "cut.npy"):
        (tmp_path / name).write_bytes(b"\x76\x2f\x31\x01 and no more")
    for name, sentence in (
        ("two.exr", "holds the channels A, B, expected Z"),
        ("many.exr", "lists channels in 120000 bytes, expected 18432 at most"),
        ("cut.exr", "cut.exr: is not readable as EXR"),
        ("cut.npy", "cut.npy: is not readable as NPY"),
        ("colour.npy", "holds float64 of shape"),
        ("none.exr", "there is no such depth map"),
    ):
        with pytest.raises(CaptureError, match=sentence):
            read_depth_values(tmp_path / name)


@pytest.mark.slow
def test_a_camera_with_depth_maps_is_segmented_alone(tmp_path: Path) -> None:
    capture = record(tmp_path / "capture")
    made = segment_capture(capture.folder)
    assert made.sensors[0].mask == ("S1/mask/left/{frame:04d}.png",)
    assert check_capture(capture.folder).sensors[0].depth_coverage == pytest.approx(1.0, abs=0.1)
