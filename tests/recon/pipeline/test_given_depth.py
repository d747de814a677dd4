"""A run whose depth the capture brings along: alone, beside pairs, and where a method does not fit a sensor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from recon.capture.format import Capture, CaptureError, DepthMaps, read_masks, write_capture
from recon.cloud import CloudParameters
from recon.geometry.mesh_files import read_cloud, read_mesh
from recon.methods.approaches import PHOTOGRAPHS, VERTICES
from recon.pipeline.job import ALL, FEW, PACKED, ReconstructOptions
from recon.pipeline.reconstruct import match_files, reconstruct
from recon.pipeline.run import View, mesh_name, read_run
from recon.runtime.files import read_json
from recon.runtime.workers import no_progress
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MESH, read_depth
from recon.surface import SurfaceParameters
from recon.validation.clouds import read_shape
from recon.validation.export_models import write_models
from recon.validation.truth.evaluation import signed_distances_to
from recon.validation.views.evaluation import ViewSettings, measure_views

pytestmark = pytest.mark.slow

GIVEN_FB = ReconstructOptions(("given",), ("fb",))


def recorded(folder: Path, *, depth_maps: bool) -> Capture:
    return synthesise(folder, SynthParameters("sphere", 2, 2, (160, 90), depth_maps=depth_maps))


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    return recorded(tmp_path_factory.mktemp("depth") / "capture", depth_maps=True)


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    """A pair with depth maps, and a pair without."""
    made = recorded(tmp_path_factory.mktemp("mixed") / "capture", depth_maps=False)
    first, second = made.sensors
    for frame in range(2):
        np.save(made.folder / f"{frame}.npy", read_depth(made, "S1", "left", frame))
    made = replace(made, sensors=(replace(first, depth=DepthMaps("{frame}.npy")), second))
    write_capture(made)
    return made


def test_a_capture_of_depth_maps_alone_becomes_true_models(capture: Capture, tmp_path: Path) -> None:
    content = reconstruct(capture.folder, tmp_path / "run", ReconstructOptions())
    assert content["approaches"] == ["given_fa", "given_fb"]
    truth = read_shape(capture.folder / MESH.format(frame=1))
    for stream in capture.sensors:
        cloud = read_cloud(tmp_path / "run" / View("given", stream.id, 1).cloud)
        assert np.abs(signed_distances_to(truth, cloud.points)).max() < 0.5  # mm
        assert cloud.sigma is not None
        assert cloud.sigma.min() > 0
    errors = np.abs(signed_distances_to(truth, read_mesh(tmp_path / "run/meshes/given_fb/0001.ply").vertices))
    assert np.median(errors) < 1.0
    assert len(write_models([tmp_path / "run"], tmp_path / "models", None, lambda *_: None)) == 4
    report, _ = measure_views(tmp_path / "run", ViewSettings(frames=range(1)))
    assert {row["view"] for row in report["views"] if row["kind"] == "sensor"} == {"S1/left", "S2/left"}
    assert report["agreement"][0]["agree"] > 0.95


def test_colours_are_balanced_by_the_method_that_all_sensors_have(
    mixed: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recon.surface.colours.MIN_SHARED_PLACES", 10)  # the pictures are small
    folder, options = (
        tmp_path / "run",
        ReconstructOptions(("id", "given"), ("fb",), frames=range(1), surface=SurfaceParameters(voxel_mm=8.0)),
    )
    reconstruct(mixed.folder, folder, options)
    before = read_mesh(folder / "meshes/given_fb/0000.ply")
    reconstruct(mixed.folder, folder, replace(options, balance_colours=True))
    gain, offset = (np.array(read_json(folder / "colours.json")[name]) for name in ("gain", "offset"))
    assert gain.shape == (2, 3)
    after = read_mesh(folder / "meshes/given_fb/0000.ply")  # of S1 alone
    assert np.abs(after.colours - (gain[0] * before.colours + offset[0]).clip(0, 255)).max() < 1.5


def test_a_tsdf_of_given_depth_is_near_the_truth(capture: Capture, tmp_path: Path) -> None:
    content = reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(fusions=("tsdf",), frames=range(1)))
    truth = read_shape(capture.folder / MESH.format(frame=0))
    errors = np.abs(signed_distances_to(truth, read_mesh(tmp_path / "run/meshes/given_tsdf/0000.ply").vertices))
    assert errors.mean() < content["options"]["surface"]["voxel_mm"] / 2


def test_a_changed_depth_map_is_taken_again_and_the_rest_is_kept(capture: Capture, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    reconstruct(capture.folder, folder, GIVEN_FB)
    path = capture.folder / "S1/depth/0001.png"
    before = path.read_bytes()
    try:
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) + np.uint16(10))
        made: list[str] = []
        times = {name: (folder / name).stat().st_mtime_ns for name in names(capture)}
        reconstruct(capture.folder, folder, GIVEN_FB)
        made = [name for name, time in times.items() if (folder / name).stat().st_mtime_ns != time]
        assert made == [View("given", "S1", 1).matched]
    finally:
        path.write_bytes(before)


def names(capture: Capture) -> list[str]:
    return [View("given", stream.id, frame).matched for stream in capture.sensors for frame in (0, 1)]


def test_given_depth_uses_the_sensors_that_have_it_beside_methods_for_all_pairs(mixed: Capture, tmp_path: Path) -> None:
    options = ReconstructOptions(("id", "given"), ("fb",), frames=range(1), temporal=None)
    reconstruct(mixed.folder, tmp_path / "run", options)
    run = read_run(tmp_path / "run")
    assert not (run.folder / "clouds/given/S2").exists()
    assert (run.folder / "clouds/id/S2").is_dir()
    truth = read_shape(mixed.folder / MESH.format(frame=0))
    cloud = read_cloud(run.folder / View("given", "S1", 0).cloud)
    assert np.abs(signed_distances_to(truth, cloud.points)).max() < 0.5
    report, _ = measure_views(run.folder, ViewSettings())
    assert [row["depth"] for row in report["agreement"]] == ["id"]


def test_a_method_that_a_sensor_cannot_serve_is_named_with_the_sensor(capture: Capture, tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="depth method id needs stereo pairs, and sensor S1 has one camera"):
        reconstruct(capture.folder, tmp_path / "run", ReconstructOptions(("given", "id")))
    pairs = recorded(tmp_path / "pairs", depth_maps=False)
    with pytest.raises(CaptureError, match="given needs depth maps, and sensors S1, S2 have none"):
        reconstruct(pairs.folder, tmp_path / "run", GIVEN_FB)
    image = pairs.folder / "S1/left/0000.png"
    with pytest.raises(ValueError, match="given takes the depth maps of a capture"):
        match_files(image, image, tmp_path / "out.npy", method="given", n_disparities=8)
    assert not (tmp_path / "run").exists()


def test_masks_cut_given_depth_and_erode_cuts_further(capture: Capture, tmp_path: Path) -> None:
    made = replace(capture, sensors=tuple(replace(s, mask=(f"{s.id}.png",)) for s in capture.sensors), n_frames=1)
    try:
        for stream in made.sensors:
            half = np.zeros((90, 160), np.uint8)
            half[:, :80] = 255
            cv2.imwrite(str(capture.folder / f"{stream.id}.png"), half)
        write_capture(made)
        masks = read_masks(made, "S1", 0)
        assert masks is not None
        counts = []
        for erode in (0, 3):
            folder = tmp_path / str(erode)
            reconstruct(made.folder, folder, replace(GIVEN_FB, cloud=CloudParameters(erode_px=erode)))
            cloud = read_cloud(folder / View("given", "S1", 0).cloud)
            columns = made.sensors[0].left.camera.project(cloud.points)[:, 0]
            assert columns.max() < 80 - erode
            counts.append(len(cloud))
        assert counts[1] < counts[0]
    finally:
        write_capture(capture)


def test_clouds_that_do_not_stay_are_made_when_they_are_needed_and_give_the_same_meshes(tmp_path: Path) -> None:
    capture = synthesise(tmp_path / "capture", SynthParameters("sphere", 2, 3, (160, 90), depth_maps=True)).folder
    options = ReconstructOptions(fusions=("fb",))
    for clouds in (ALL, FEW):
        reconstruct(capture, tmp_path / clouds, replace(options, clouds=clouds))
    meshes = [[(tmp_path / kept / mesh_name("given_fb", n)).read_bytes() for n in range(3)] for kept in (ALL, FEW)]
    assert meshes[0] == meshes[1]
    stay = [path.name for path in sorted((tmp_path / FEW / "clouds/given/S1").iterdir())]
    assert stay == ["0000.ply", "0001.ply"], "of the first and the middle frame"
    (tmp_path / FEW / mesh_name("given_fb", 2)).unlink()
    reconstruct(capture, tmp_path / FEW, replace(options, clouds=FEW))
    assert (tmp_path / FEW / mesh_name("given_fb", 2)).read_bytes() == meshes[0][2]
    with pytest.raises(ValueError, match="clouds of frame 2 are not on disk, those of frames 0 and 1 are"):
        write_models([tmp_path / FEW], tmp_path / "models", 2, no_progress)


def test_rims_of_textured_surfaces_are_steadied_by_frames_on_both_sides_and_come_back_as_they_were(
    tmp_path: Path,
) -> None:
    capture = synthesise(tmp_path / "capture", SynthParameters("sphere", 2, 3, (160, 90), depth_maps=True)).folder
    options = ReconstructOptions(fusions=("fb",), colours=(PHOTOGRAPHS,), steady=0)
    run, names = tmp_path / "run", [mesh_name("given_fb_photographs", frame) for frame in range(3)]
    reconstruct(capture, run, options)
    loose = [(run / name).read_bytes() for name in names]
    reconstruct(capture, run, replace(options, steady=2))
    steadied = [(run / name).read_bytes() for name in names]
    assert [a == b for a, b in zip(loose, steadied, strict=True)] == [True, False, True], "the ends have one neighbour"
    (run / names[1]).unlink()
    reconstruct(capture, run, replace(options, steady=2))
    assert (run / names[1]).read_bytes() == steadied[1]


def test_packed_meshes_are_the_plain_ones_and_replace_them(tmp_path: Path) -> None:
    capture = synthesise(tmp_path / "capture", SynthParameters("sphere", 2, 4, (96, 54), depth_maps=True)).folder
    options = ReconstructOptions(fusions=("fb",), colours=(VERTICES, PHOTOGRAPHS))
    run, approaches = tmp_path / "run", ("given_fb", "given_fb_photographs")
    reconstruct(capture, run, options)
    plain = {each: [read_mesh(run / mesh_name(each, frame)) for frame in range(4)] for each in approaches}
    reconstruct(capture, run, replace(options, meshes=PACKED))
    for approach, ending in zip(approaches, ("ply", "glb"), strict=True):
        names = sorted(path.name for path in (run / "meshes" / approach).iterdir())
        assert names == [f"0000.{ending}", "0001.parquet", f"0002.{ending}", "0003.parquet"]
        for frame, mesh in enumerate(plain[approach]):
            back = read_mesh(run / read_run(run).mesh_name(approach, frame))
            for field in ("vertices", "faces", "normals", "colours"):
                assert np.array_equal(getattr(back, field), getattr(mesh, field)), (approach, frame, field)
    reconstruct(capture, run, options)
    assert not list(run.rglob("*.parquet"))
    assert read_run(run).packed == ()
