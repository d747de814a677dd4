"""Pictures of every kind come into a capture with the colours they have, under the suffix of what they are."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

from recon.capture.exporting.colmap import export_colmap
from recon.capture.exporting.nerfstudio import export_nerfstudio
from recon.capture.format import Capture, CaptureError, read_capture, read_frame, read_held_out, read_masks
from recon.capture.importing.colmap import import_colmap
from recon.capture.importing.json_file import import_json
from recon.capture.importing.nerfstudio import import_nerfstudio
from recon.capture.importing.opencv import import_opencv
from recon.capture.importing.sources import ImportOptions
from recon.geometry.srgb import light_of
from tests.recon.capture.importing.labelled_recording import (
    BOUNDS,
    OPTIONS,
    SIZE,
    described,
    from_opencv,
    record,
    write_picture,
)

RAMP = np.repeat(np.linspace(0, 1, SIZE[0])[None, :, None], SIZE[1], axis=0) * np.array([1.0, 0.8, 0.5])
BYTES = np.rint(RAMP * 255)


def stereo(folder: Path, suffix: str, picture: NDArray[np.generic]) -> Path:
    """The recording of two sensors whose pictures are of a kind; those of OpenCV are BGR."""
    record(folder)
    for path in folder.rglob("*.png"):
        path.unlink()
        if path.stem != "plate":
            cv2.imwrite(str(path.with_suffix(suffix)), picture[..., ::-1])
    return described(folder)


@pytest.mark.parametrize("suffix", [".bmp", ".tif", ".tiff", ".ppm", ".png"])
def test_pictures_without_loss_keep_their_bytes_and_become_png(tmp_path: Path, suffix: str) -> None:
    capture = import_json(stereo(tmp_path / "source", suffix, BYTES.astype(np.uint8)), tmp_path / "out")
    assert capture.sensors[0].left.image.endswith(".png")
    np.testing.assert_array_equal(read_frame(capture, "S1", 1)[0], BYTES)
    assert (tmp_path / "out/S1/left/0000.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_bits_of_a_camera_are_spread_all_alike(tmp_path: Path, bits: int, suffix: str) -> None:
    levels = np.rint(RAMP * (2**bits - 1)).astype(np.uint16)
    source = stereo(tmp_path / "source", suffix, levels)
    cv2.imwrite(str(tmp_path / f"source/S1/left/9{suffix}"), levels[..., ::-1] // 5)  # a dark one
    if bits == 16:
        capture = import_json(source, tmp_path / "out")
    else:
        with pytest.warns(match=f"have 16 bits, of which their values fill {bits}"):
            capture = import_json(source, tmp_path / "out")
    bright, dark = (read_frame(capture, "S1", frame)[0].astype(int) for frame in (1, 0))
    assert np.abs(bright - RAMP * 255).max() <= 1
    assert np.abs(dark - RAMP * 51).max() <= 1


def test_the_largest_value_that_a_pgm_names_is_white(tmp_path: Path) -> None:
    record(tmp_path / "source")
    for path in (tmp_path / "source").rglob("*.png"):
        path.unlink()
        levels = np.rint(RAMP[..., 0] * 1023).astype(">u2")
        path.with_suffix(".pgm").write_bytes(b"P5\n# by a camera\n320 240\n1023\n" + levels.tobytes())
    capture = import_json(described(tmp_path / "source"), tmp_path / "out")
    assert np.abs(read_frame(capture, "S1", 0)[0][..., 1] - RAMP[..., 0] * 255).max() <= 1


def test_the_light_of_an_exr_becomes_srgb(tmp_path: Path) -> None:
    record(tmp_path / "source")
    light = light_of(RAMP).astype(np.float32)
    for path in (tmp_path / "source").rglob("*.png"):
        path.unlink()
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"RGB": light}) as file:
            file.write(str(path.with_suffix(".exr")))
    capture = import_json(described(tmp_path / "source"), tmp_path / "out")
    np.testing.assert_array_equal(read_frame(capture, "S2", 0)[1], BYTES)


def test_an_exr_that_announces_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    path = stereo(tmp_path / "source", ".png", BYTES.astype(np.uint8)).parent / "S1/left"
    for picture in path.iterdir():
        picture.unlink()
    window = b"dataWindow\0box2i\0" + np.array([16, 0, 0, 99_999, 99_999], "<i4").tobytes()
    (path / "0.exr").write_bytes(b"\x76\x2f\x31\x01\x02\0\0\0" + window)
    with pytest.raises(CaptureError, match="announces 100000x100000 pixels, more than its"):
        import_json(path.parents[1] / "recording.json", tmp_path / "out")


def test_a_picture_under_the_name_of_another_kind_is_stored_as_what_it_is(tmp_path: Path) -> None:
    source = stereo(tmp_path / "source", ".png", BYTES.astype(np.uint8))
    for path in (tmp_path / "source").rglob("*.png"):
        path.rename(path.with_suffix(".jpg"))
    capture = import_json(source, tmp_path / "out")
    assert capture.sensors[0].left.image == "S1/left/{frame:04d}.png"
    np.testing.assert_array_equal(read_frame(capture, "S1", 0)[0], BYTES)


@pytest.fixture
def masked(tmp_path: Path) -> Capture:
    from_opencv(tmp_path / "first")
    folder = tmp_path / "first/out"
    content = json.loads((folder / "capture.json").read_text())
    for number, sensor in enumerate(content["sensors"]):
        sensor["mask"] = {}
        for place, side in enumerate(("left", "right")):
            sensor["mask"][side] = f"{sensor['id']}/mask/{side}/{{frame:04d}}.png"
            for frame in range(2):
                path = folder / sensor["mask"][side].format(frame=frame)
                path.parent.mkdir(parents=True, exist_ok=True)
                mask = np.zeros(SIZE[::-1], np.uint8)
                cv2.circle(mask, (60 + 50 * number, 90 + 20 * place), 30, 255, -1)
                cv2.imwrite(str(path), mask)
    (folder / "capture.json").write_text(json.dumps(content))
    return read_capture(folder)


@pytest.mark.parametrize("program", ["nerfstudio", "colmap"])
def test_masks_come_back_from_our_own_exports(masked: Capture, tmp_path: Path, program: str) -> None:
    pairs = [(1, 2), (3, 4)]
    if program == "nerfstudio":
        export_nerfstudio(masked, tmp_path / "source", frame=0)
        again = import_nerfstudio(tmp_path / "source", tmp_path / "out", pairs, ImportOptions(bounds=masked.bounds))
    else:
        export_colmap(masked, tmp_path / "source", frame=0)
        options = ImportOptions(bounds=masked.bounds, unit_mm=1000.0)
        again = import_colmap(tmp_path / "source", tmp_path / "out", pairs, options)
    for sensor in ("S1", "S2"):
        found, expected = read_masks(again, sensor, 0), read_masks(masked, sensor, 0)
        assert found is not None
        assert expected is not None
        np.testing.assert_array_equal(found, expected)


def test_json_and_opencv_bring_held_out_photographs(tmp_path: Path) -> None:
    record(tmp_path / "source", n_frames=1)
    write_picture(tmp_path / "source/extra/new.png", 222)
    path = described(tmp_path / "source")
    content = json.loads(path.read_text())
    shot = {key: value for key, value in content["sensors"][0]["right"].items() if key != "image"}
    content["held_out"] = [{**shot, "image": "extra/new.png"}]
    path.write_text(json.dumps(content))
    capture = import_json(path, tmp_path / "out")
    assert len(capture.held_out) == 1
    assert int(read_held_out(capture, capture.held_out[0])[0, 0, 0]) == 222
    np.testing.assert_allclose(
        capture.held_out[0].camera.cam_from_world,
        capture.sensors[0].right.camera.cam_from_world,  # type: ignore[union-attr]  # a pair
    )
    cameras = [capture.sensors[0].left.camera, capture.sensors[0].right.camera]  # type: ignore[union-attr]  # a pair
    storage = cv2.FileStorage(str(tmp_path / "source/c.yml"), cv2.FILE_STORAGE_WRITE)
    relative = cameras[1].cam_from_world @ np.linalg.inv(cameras[0].cam_from_world)
    facts = {"K1": cameras[0].K, "D1": cameras[0].dist, "K2": cameras[1].K, "D2": cameras[1].dist}
    for key, value in (facts | {"R": relative[:3, :3], "T": relative[:3, 3:]}).items():
        storage.write(key, value)
    storage.startWriteStruct("held_out", cv2.FILE_NODE_SEQ)
    storage.startWriteStruct("", cv2.FILE_NODE_MAP)
    storage.write("image", "extra/new.png")
    for key, value in (("K", cameras[1].K), ("D", cameras[1].dist), ("cam_from_world", np.eye(4))):
        storage.write(key, value)
    storage.endWriteStruct()
    storage.endWriteStruct()
    storage.release()
    path.unlink()
    (tmp_path / "source/S1").rename(tmp_path / "moved")
    for side in ("left", "right"):
        (tmp_path / "moved" / side).rename(tmp_path / "source" / side)
    again = import_opencv(tmp_path / "source", tmp_path / "again", ImportOptions(bounds=BOUNDS))
    np.testing.assert_allclose(again.held_out[0].camera.cam_from_world, np.eye(4))
    np.testing.assert_allclose(again.held_out[0].camera.K, cameras[1].K)


def test_pictures_that_a_description_of_held_out_ones_lacks_are_named(tmp_path: Path) -> None:
    record(tmp_path / "source", n_frames=1)
    path = described(tmp_path / "source")
    content = json.loads(path.read_text())
    content["held_out"] = [{**content["sensors"][0]["right"], "image": "gone.png"}]
    path.write_text(json.dumps(content))
    with pytest.warns(match=r"gone\.png"):
        capture = import_json(path, tmp_path / "out", OPTIONS)
    assert capture.held_out == ()
