"""Pictures and truth of the studio tell the same story."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from recon.capture.checking.check import check_capture
from recon.capture.checking.matches import epipolar_errors, match_pictures
from recon.capture.format import Capture, CaptureError, read_capture, read_frame, read_held_out, read_plates
from recon.geometry.mesh import Mesh
from recon.geometry.mesh_files import read_mesh
from recon.geometry.rig import Camera, Sensor, look_at
from recon.runtime.files import read_json, write_json
from recon.studio import SynthParameters, synthesise
from recon.studio.actors.atlas import lay_out
from recon.studio.objects import ball
from recon.studio.rasterise import see
from recon.studio.synthesis import restaged
from recon.studio.truth import MESH, read_depth
from recon.studio.truth_models import write_truth_models
from tests.command_line import Command

N_RAYS = 60


@pytest.fixture(scope="module")
def quiet(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """A person without sensor noise or exposure differences."""
    parameters = SynthParameters("ball", n_sensors=2, n_frames=2, size=(360, 420), noise=0, exposure_spread=0, seed=4)
    return synthesise(tmp_path_factory.mktemp("studio") / "quiet", parameters)


def in_world(camera: Camera, pixels: NDArray[np.floating], depth: NDArray[np.floating]) -> NDArray[np.float64]:
    """World points (N, 3) at depths z (N,) of pixels (N, 2)."""
    rays = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ np.linalg.inv(camera.K).T
    return np.asarray((rays * depth[:, None] - camera.cam_from_world[:3, 3]) @ camera.rotation)


def nearest_hit(origin: NDArray[np.float64], ray: NDArray[np.float64], corners: NDArray[np.float64]) -> float:
    """Distance along a ray to the nearest of triangles (M, 3, 3), by Moeller and Trumbore (1997)."""
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(ray, edge2)
    determinant = np.einsum("ij,ij->i", edge1, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = origin - corners[:, 0]
        u = np.einsum("ij,ij->i", s, p) / determinant
        q = np.cross(s, edge1)
        v = q @ ray / determinant
        t = np.einsum("ij,ij->i", edge2, q) / determinant
        hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t > 0)
    return float(t[hit].min()) if hit.any() else np.inf


@pytest.mark.slow
def test_depth_is_where_a_ray_meets_the_mesh(quiet: Capture) -> None:
    mesh = read_mesh(quiet.folder / MESH.format(frame=1))
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    camera = quiet.sensors[1].right.camera
    depth = read_depth(quiet, "S2", "right", 1)
    rows, columns = np.nonzero(np.isfinite(depth))
    chosen = np.random.default_rng(0).choice(len(rows), N_RAYS, replace=False)
    pixels = np.stack([columns[chosen], rows[chosen]], axis=1).astype(float)
    ends = in_world(camera, pixels, np.ones(N_RAYS))
    expected = [nearest_hit(camera.centre, end - camera.centre, corners) for end in ends]
    np.testing.assert_allclose(depth[rows[chosen], columns[chosen]], expected, atol=0.06)


@pytest.mark.slow
def test_the_right_picture_warped_by_depth_matches_the_left(quiet: Capture) -> None:
    for stream in quiet.sensors:
        left, right = (picture.astype(np.float32) for picture in read_frame(quiet, stream.id, 0))
        depth, other = read_depth(quiet, stream.id, "left", 0), read_depth(quiet, stream.id, "right", 0)
        inner = cv2.erode(np.isfinite(depth).astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
        rows, columns = np.nonzero(inner)
        world = in_world(stream.left.camera, np.stack([columns, rows], axis=1), depth[inner].astype(np.float64))
        seen = stream.right.camera.project(world).astype(np.float32)
        there = stream.right.camera.points_in_camera(world)[:, 2]
        measured = cv2.remap(other, seen[:, :1], seen[:, 1:], cv2.INTER_NEAREST, borderValue=np.nan)[:, 0]
        visible = np.abs(measured - there) < 6
        assert visible.mean() > 0.85
        warped = cv2.remap(right, seen[:, :1], seen[:, 1:], cv2.INTER_LINEAR)[:, 0]
        difference = np.abs(warped - left[inner])[visible].mean()
        shifted = cv2.remap(right, seen[:, :1] + 2, seen[:, 1:], cv2.INTER_LINEAR)[:, 0]
        assert difference < 5.0
        assert difference < 0.55 * np.abs(shifted - left[inner])[visible].mean()


def test_the_mask_is_where_the_depth_is(quiet: Capture) -> None:
    mask = cv2.imread(str(quiet.folder / "truth/mask/S1/left/0001.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(mask == 255, np.isfinite(read_depth(quiet, "S1", "left", 1)))
    assert set(np.unique(mask)) == {0, 255}


def test_bounds_contain_the_meshes_of_all_frames_tightly(quiet: Capture) -> None:
    vertices = np.concatenate([read_mesh(quiet.folder / MESH.format(frame=frame)).vertices for frame in range(2)])
    np.testing.assert_allclose(quiet.bounds, [vertices.min(axis=0) - 15, vertices.max(axis=0) + 15], atol=0.01)


def test_without_noise_the_plate_is_what_lies_behind_the_actor(quiet: Capture) -> None:
    plates = read_plates(quiet, "S1")
    assert plates is not None
    picture = read_frame(quiet, "S1", 0)[0].astype(int)
    far = ~cv2.dilate(np.isfinite(read_depth(quiet, "S1", "left", 0)).astype(np.uint8), np.ones((9, 9))).astype(bool)
    far[210:] = False  # the shadow falls on the floor
    np.testing.assert_array_equal(picture[far], plates[0][far])


def test_held_out_photographs_are_of_the_same_instant(quiet: Capture) -> None:
    (photograph,) = quiet.held_out
    assert read_held_out(quiet, photograph).shape == (420, 360, 3)
    truth = read_json(quiet.folder / "truth/truth.json")
    assert [camera["view"] for camera in truth["cameras"]][-1] == "held_out/S1_S2"


def test_a_calibration_error_is_written_to_the_capture_but_not_to_the_truth(tmp_path: Path) -> None:
    parameters = SynthParameters("sphere", n_sensors=1, n_frames=1, size=(96, 96), calibration_error_px=2.0)
    synthesise(tmp_path / "off", parameters)
    capture = read_capture(tmp_path / "off")
    true = {
        camera["view"]: np.array(camera["cam_from_world"])
        for camera in read_json(tmp_path / "off/truth/truth.json")["cameras"]
    }
    written = capture.sensors[0].left.camera
    off_deg = np.degrees(np.arccos((np.trace(written.rotation @ true["S1/left"][:3, :3].T) - 1) / 2))
    assert 0.001 < off_deg < 10
    np.testing.assert_allclose(written.centre, -true["S1/left"][:3, :3].T @ true["S1/left"][:3, 3], atol=1e-6)


@pytest.mark.parametrize("noise", [0.0, 1.0, 4.0])
def test_sensor_noise_has_the_deviation_that_was_asked_for(noise: float, tmp_path: Path) -> None:
    parameters = SynthParameters("sphere", n_sensors=1, n_frames=2, size=(240, 160), noise=noise)
    capture = synthesise(tmp_path / "out", parameters)
    first, second = (read_frame(capture, "S1", frame)[0].astype(float) for frame in (0, 1))
    still = ~(np.isfinite(read_depth(capture, "S1", "left", 0)) | np.isfinite(read_depth(capture, "S1", "left", 1)))
    still[:, 60:180] = False
    deviation = (first - second)[still].std() / np.sqrt(2)
    rounding = np.sqrt(noise**2 + 1 / 12) if noise else 0.0
    assert deviation == pytest.approx(rounding, abs=0.05)


def test_a_camera_inside_a_surface_is_refused() -> None:
    vertices, faces = ball(100.0, 40.0)
    camera = Camera(np.array([[90.0, 0, 50], [0, 90.0, 50], [0, 0, 1]]), (100, 100), look_at((0, 0, 80), (0, 0, 0)))
    with pytest.raises(ValueError, match="of a camera"):
        see(camera, vertices, faces)


@pytest.fixture(scope="module")
def bent(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """A person seen through lenses that make barrels of squares."""
    parameters = SynthParameters("people", n_sensors=1, n_frames=1, size=(540, 480), distortion=-0.2, noise=0.5)
    return synthesise(tmp_path_factory.mktemp("studio") / "bent", parameters)


@pytest.mark.slow
def test_a_point_seen_through_two_lenses_is_at_one_depth(bent: Capture) -> None:
    (stream,) = bent.sensors
    assert stream.left.camera.dist[0] == pytest.approx(-0.2, rel=0.3)
    depth, other = read_depth(bent, "S1", "left", 0), read_depth(bent, "S1", "right", 0)
    rows, columns = np.nonzero(cv2.erode(np.isfinite(depth).astype(np.uint8), np.ones((5, 5), np.uint8)))
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)[:, None]
    slopes = cv2.undistortPoints(pixels, stream.left.camera.K, stream.left.camera.dist)[:, 0]
    z = depth[rows, columns].astype(np.float64)
    pose = np.linalg.inv(stream.left.camera.cam_from_world)
    world = np.column_stack([slopes * z[:, None], z]) @ pose[:3, :3].T + pose[:3, 3]
    right = stream.right.camera
    turn = cv2.Rodrigues(right.rotation)[0]
    seen = cv2.projectPoints(world, turn, right.cam_from_world[:3, 3], right.K, right.dist)[0][:, 0].astype(np.float32)
    there = np.rint(seen).astype(int).clip(0, np.array(right.size) - 1)
    error = np.abs(other[there[:, 1], there[:, 0]] - right.points_in_camera(world)[:, 2])
    assert np.nanmedian(error) < 1.0
    straight = right.project(world).astype(np.float32)
    assert np.abs(straight - seen).max() > 3.0  # pixels: the lens matters


@pytest.mark.slow
def test_matches_fit_the_calibration_only_with_its_distortion(bent: Capture) -> None:
    (stream,) = bent.sensors
    matches = match_pictures(*read_frame(bent, "S1", 0))
    without = Sensor("S1", *(replace(side.camera, dist=np.zeros(0)) for side in (stream.left, stream.right)))
    error, wrong = (np.median(np.abs(epipolar_errors(s, matches))) for s in (stream.sensor, without))
    assert error < 0.15
    assert wrong > 1.2 * error  # lenses of a pair bend alike: rows hardly tell
    (report,) = check_capture(bent.folder).sensors
    assert report.rows is not None
    assert report.rows.vertical_error_px is not None
    assert report.rows.vertical_error_px < 0.25


@pytest.mark.slow
def test_the_true_meshes_become_the_models_of_an_approach(quiet: Capture, tmp_path: Path) -> None:
    out = tmp_path / "models"
    assert write_truth_models(quiet, out) == [0, 1]
    scene = read_json(out / "scene.json")
    assert (scene["dataset"], scene["fps"], scene["units"], scene["up"]) == ("ball", quiet.fps, "m", "y")
    assert (out / scene["path"]["sensors_of"]).resolve() == quiet.folder.resolve()
    for frame in range(2):
        written, recorded = (
            read_mesh(out / f"truth/{frame:04d}.glb"),
            read_mesh(quiet.folder / MESH.format(frame=frame)),
        )
        np.testing.assert_allclose(corners(written), corners(recorded), atol=0.01)


def corners(mesh: Mesh) -> NDArray[np.float32]:
    return mesh.vertices[mesh.faces]


@pytest.mark.slow
def test_a_texel_of_the_truth_has_the_colour_of_its_place(quiet: Capture, tmp_path: Path) -> None:
    write_truth_models(quiet, tmp_path / "models", range(1))
    mesh = read_mesh(tmp_path / "models/truth/0000.glb")
    assert mesh.texture is not None
    stage, texel_mm = restaged(SynthParameters("ball", n_sensors=2, n_frames=2, size=(360, 420), seed=4))
    atlas = lay_out(stage.places, stage.faces, stage.owners, texel_mm)
    height, width = atlas.owners.shape
    shares = np.random.default_rng(0).dirichlet(np.ones(3), len(stage.faces))
    places = np.einsum("fc,fcx->fx", shares, stage.places[stage.faces])
    u, v = np.einsum("fc,fcx->fx", shares, atlas.uv[atlas.faces].astype(np.float64)).T
    row, column = ((1 - v) * height).astype(int), (u * width).astype(int)
    away = np.linalg.norm(atlas.places[row, column] - places, axis=1)
    assert (away < 2 * texel_mm).mean() > 0.999  # a chart that overlaps itself would show another place
    assert (atlas.owners[row, column] == stage.owners).mean() > 0.999
    expected = stage.colours(stage.at(0.0), atlas.places, atlas.owners, texel_mm)
    np.testing.assert_array_equal(mesh.texture.pixels, expected)


@pytest.mark.slow
def test_a_recording_of_another_studio_has_no_textured_truth(quiet: Capture, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(quiet.folder / "truth", other / "truth")
    facts = read_json(other / "truth/truth.json")
    write_json(other / "truth/truth.json", facts | {"parameters": facts["parameters"] | {"seed": 5}})
    with pytest.raises(CaptureError, match="another version of the studio recorded this; record it again"):
        write_truth_models(replace(quiet, folder=other), tmp_path / "models")
    assert not (tmp_path / "models").exists()


@pytest.mark.slow
def test_the_frames_of_the_truth_can_be_chosen(quiet: Capture, tmp_path: Path, command: Command) -> None:
    told = command("capture", "truth", quiet.folder, "-o", tmp_path / "models", "--frames", "1:")
    assert told.code == 0, told.err
    assert [path.name for path in (tmp_path / "models/truth").iterdir()] == ["0001.glb"]
    told = command("capture", "truth", quiet.folder, "-o", tmp_path / "none", "--frames", "2:5")
    assert told.code == 1
    assert "has frames 0 to 1, none of them in 2:5" in told.err
    assert not (tmp_path / "none").exists()


def test_a_capture_without_a_truth_is_named(quiet: Capture, tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"0000.ply: there is no such mesh; only synthetic captures"):
        write_truth_models(replace(quiet, folder=tmp_path), tmp_path / "models")
