"""A capture written for other programs is the same recording: it comes back by the importer, and films match."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.capture.depth_maps import read_depth_map
from recon.capture.exporting.colmap import export_colmap
from recon.capture.exporting.nerfstudio import export_nerfstudio
from recon.capture.format import (
    Capture,
    CaptureError,
    HeldOut,
    frame_pictures,
    image_path,
    read_capture,
    read_frame,
    read_held_out,
    read_picture,
    write_capture,
)
from recon.capture.images import read_image
from recon.capture.importing.colmap import import_colmap
from recon.capture.importing.nerfstudio import import_nerfstudio
from recon.capture.importing.sources import ImportOptions
from recon.geometry.mesh import Cloud
from recon.geometry.mesh_files import read_points
from recon.geometry.rig import Camera, look_at
from recon.render.path_file import write_path
from recon.runtime.files import read_json
from recon.studio import SynthParameters, synthesise

CLOUD = Cloud(
    np.random.default_rng(1).uniform(-100, 100, (50, 3)), np.tile([0.0, 1, 0], (50, 1)), np.full((50, 3), 9, np.uint8)
)
PAIRS = [(1, 2), (3, 4)]


def stereo(folder: Path, distortion: float = -0.1) -> Capture:
    return synthesise(folder, SynthParameters("sphere", 2, 2, (96, 64), distortion=distortion))


def with_masks(capture: Capture) -> Capture:
    sensors = []
    for stream in capture.sensors:
        names = tuple(f"{stream.id}_{side}_mask.png" for side in stream.sides)
        for name in names:
            mask = np.zeros((64, 96), np.uint8)
            mask[20:50, 30:60] = 255
            cv2.imwrite(str(capture.folder / name), mask)
        sensors.append(replace(stream, mask=names))
    return replace(capture, sensors=tuple(sensors), n_frames=1)


def again_by_nerfstudio(source: Path, out: Path) -> Capture:
    return import_nerfstudio(source, out, PAIRS)


def again_by_colmap(source: Path, out: Path) -> Capture:
    return import_colmap(source, out, PAIRS, ImportOptions(unit_mm=1000.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("export", "again"), [(export_nerfstudio, again_by_nerfstudio), (export_colmap, again_by_colmap)]
)
def test_what_is_exported_comes_back_with_the_same_cameras_and_pixels(
    tmp_path: Path, export: Callable[..., None], again: Callable[[Path, Path], Capture]
) -> None:
    capture = stereo(tmp_path / "capture")
    export(capture, tmp_path / "export", frame=0, points=CLOUD)
    made = again(tmp_path / "export", tmp_path / "again")
    for stream, true in zip(made.sensors, capture.sensors, strict=True):
        for side, other in zip(stream.cameras, true.cameras, strict=True):
            assert_same_camera(side.camera, other.camera)
        for pixels, expected in zip(read_frame(made, stream.id, 0), read_frame(capture, true.id, 0), strict=True):
            np.testing.assert_array_equal(pixels, expected)
    for photograph, original in zip(made.held_out, capture.held_out, strict=True):
        assert_same_camera(photograph.camera, original.camera)
        np.testing.assert_array_equal(read_held_out(made, photograph), read_held_out(capture, original))
    if export is export_nerfstudio:
        np.testing.assert_allclose(made.bounds, capture.bounds, atol=1e-6)


def assert_same_camera(camera: Camera, other: Camera) -> None:
    np.testing.assert_allclose(camera.K, other.K, atol=1e-6)
    np.testing.assert_allclose(camera.cam_from_world, other.cam_from_world, atol=1e-6)
    dist = np.concatenate([other.dist, np.zeros(14)])
    np.testing.assert_allclose(np.concatenate([camera.dist, np.zeros(14)])[:8], dist[:8], atol=1e-9)
    assert camera.size == other.size


@pytest.mark.slow
def test_depth_maps_come_back_by_nerfstudio(tmp_path: Path) -> None:
    capture = synthesise(tmp_path / "capture", SynthParameters("sphere", 2, 1, (96, 64), depth_maps=True))
    export_nerfstudio(capture, tmp_path / "export")
    made = import_nerfstudio(tmp_path / "export", tmp_path / "again")
    assert [stream.sides for stream in made.sensors] == [("left",), ("left",)]
    for stream, true in zip(made.sensors, capture.sensors, strict=True):
        expected = read_depth_map(capture.folder, true, 0)
        np.testing.assert_allclose(read_depth_map(made.folder, stream, 0), expected, rtol=1e-6)
    assert len(made.held_out) == len(capture.held_out)


@pytest.mark.slow
def test_held_out_views_are_the_test_split_and_masks_are_for_every_image(tmp_path: Path) -> None:
    capture = with_masks(stereo(tmp_path / "capture"))
    export_nerfstudio(capture, tmp_path / "nerfstudio", points=CLOUD)
    content = read_json(tmp_path / "nerfstudio/transforms.json")
    held_out = "images/held_out_S1_S2_0000.png"
    assert content["test_filenames"] == content["val_filenames"] == [held_out]
    assert content["train_filenames"] == [f"images/{name}" for name in images()]
    shares = {
        frame["file_path"]: cv2.imread(str(tmp_path / "nerfstudio" / frame["mask_path"]), 0).mean() / 255
        for frame in content["frames"]
    }
    assert shares.pop(held_out) == 1.0
    np.testing.assert_allclose(list(shares.values()), 900 / (96 * 64))
    points = read_points(tmp_path / "nerfstudio/points.ply")
    np.testing.assert_allclose(points, CLOUD.points[:, [0, 2, 1]] * (0.001, -0.001, 0.001), atol=1e-9)  # z up, metres
    export_colmap(capture, tmp_path / "colmap")
    assert (tmp_path / "colmap/sparse/0/test.txt").read_text().split() == ["held_out_S1_S2_0000.png"]
    assert sorted(path.name for path in (tmp_path / "colmap/masks").iterdir()) == [f"{name}.png" for name in images()]


def images() -> list[str]:
    return [f"{sensor}_{side}.png" for sensor in ("S1", "S2") for side in ("left", "right")]


@pytest.mark.slow
def test_photographs_whose_names_come_out_alike_do_not_take_each_other_s_place(tmp_path: Path) -> None:
    capture = stereo(tmp_path / "capture", distortion=0.0)
    camera, names = capture.sensors[0].left.camera, ("S1/left.png", "a/b_c.png", "a_b/c.png", "shot_{frame}.jpg")
    for shade, name in enumerate(names, start=10):
        path = image_path(capture.folder, name, 0)
        path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(path), np.full((64, 96, 3), shade, np.uint8))
    capture = with_masks(replace(capture, held_out=tuple(HeldOut(camera, name, 0) for name in names)))
    export_nerfstudio(capture, tmp_path / "export")
    frames = read_json(tmp_path / "export/transforms.json")["frames"]
    for key in ("file_path", "mask_path"):
        assert len({frame[key].lower() for frame in frames}) == 8
    assert not any("{" in frame["file_path"] for frame in frames)
    shown = [read_image(tmp_path / "export" / frame["file_path"]) for frame in frames]
    np.testing.assert_array_equal(shown[0], read_frame(capture, "S1", 0)[0])
    assert [int(pixels[0, 0, 0]) for pixels in shown[4:]] == [10, 11, 12, 13]


@pytest.mark.slow
def test_frames_of_videos_become_pictures_of_the_frame_asked_for(tmp_path: Path) -> None:
    capture = stereo(tmp_path / "capture")
    first = capture.sensors[0]
    writer = cv2.VideoWriter(
        str(capture.folder / "left.avi"), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (96, 64)
    )
    for grey in (10, 200):
        writer.write(np.full((64, 96, 3), grey, np.uint8))
    writer.release()
    sensors = (replace(first, left=replace(first.left, image="left.avi")), *capture.sensors[1:])
    write_capture(replace(capture, sensors=sensors))
    made = read_capture(capture.folder)
    export_colmap(made, tmp_path / "export", frame=1)
    picture = cv2.imread(str(tmp_path / "export/images/S1_left.png"))
    np.testing.assert_array_equal(picture[..., ::-1], read_picture(frame_pictures(made.folder, made.sensors[0], 1)[0]))
    assert not list((tmp_path / "export/images").glob("held_out*"))  # they show frame 0


@pytest.mark.slow
def test_a_film_s_cameras_lead_to_the_same_places_in_the_exported_world(tmp_path: Path) -> None:
    """By what nerfstudio's dataparser notes: its transform after ours, then its scale, on positions in metres."""
    capture = stereo(tmp_path / "capture", distortion=0.0)
    export_nerfstudio(capture, tmp_path / "export")
    content = read_json(tmp_path / "export/transforms.json")
    true = capture.sensors[0].left.camera
    write_path(
        tmp_path / "path.json", [Camera(true.K, true.size, look_at(true.centre, capture.bounds.mean(axis=0)))], 25
    )
    pose = np.reshape(read_json(tmp_path / "path.json")["camera_path"][0]["camera_to_world"], (4, 4))
    pose[:3, 3] *= 0.001
    in_export = np.array(content["applied_transform"]) @ pose
    saved = np.array(content["frames"][0]["transform_matrix"])
    np.testing.assert_allclose(in_export[:3, 3], saved[:3, 3], atol=1e-9)
    turn = saved[:3, :3].T @ in_export[:3, :3]  # both look at the middle of the bounds
    assert np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) < 5.0


@pytest.mark.slow
def test_what_cannot_be_exported_is_named_and_nothing_is_left_behind(tmp_path: Path) -> None:
    capture = stereo(tmp_path / "capture")
    with pytest.raises(CaptureError, match="there is no frame 2, frames are 0 to 1"):
        export_colmap(capture, tmp_path / "out", frame=2)
    strange = replace(capture.sensors[0].left.camera, dist=np.array([0.1, 0, 0, 0, 0, 0, 0, 0, 0.2, 0, 0, 0]))
    held_out = (HeldOut(strange, capture.held_out[0].image, 0),)
    for export, form in ((export_colmap, "COLMAP"), (export_nerfstudio, "nerfstudio")):
        with pytest.raises(CaptureError, match=f"its camera has 12 distortion numbers, which {form} cannot describe"):
            export(replace(capture, held_out=held_out), tmp_path / "out")
    (capture.folder / "S2/right/0000.png").unlink()
    with pytest.raises(CaptureError, match=r"0000\.png: there is no such image"):
        export_nerfstudio(capture, tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture"]
