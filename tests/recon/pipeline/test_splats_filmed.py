"""Splats are filmed beside meshes, clouds and runs: in the same place, by the same path, over the same floor."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from recon.capture.exporting.colmap import export_colmap
from recon.capture.exporting.nerfstudio import export_nerfstudio
from recon.capture.format import Capture, read_capture
from recon.geometry.mesh import Cloud, Mesh
from recon.geometry.mesh_files import read_mesh, write_cloud, write_mesh
from recon.geometry.splats import Splats
from recon.models.inspection import inspect_model
from recon.models.read import Placement, read_model
from recon.models.scene_file import read_scene_file
from recon.models.trained_on import world_from_trained
from recon.pipeline.film import Film, RenderOptions
from recon.pipeline.film_plan import planned_films
from recon.pipeline.render import render
from recon.pipeline.sources import read_sources
from recon.render.encoding.video import read_video
from recon.render.frames import render_masked_frames
from recon.render.scene import scene_around
from recon.runtime.files import read_json, write_json
from recon.runtime.workers import ThisProcess
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MESH
from recon.validation.views.novel_view import photographs, rendered, view_rows
from tests.recon.models.splats.made import splats_on, write_splats

N_SPLATS = 30_000
OPTIONS = RenderOptions(size=(320, 240), seconds=0.08, renderer="software", light="flat", master=False)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Capture:
    folder = tmp_path_factory.mktemp("studio") / "ball"
    synthesise(folder, SynthParameters(scene="ball", n_sensors=2, n_frames=2, size=(160, 120), noise=0.0))
    return read_capture(folder)


def true_mesh(capture: Capture, frame: int = 0) -> Mesh:
    return read_mesh(capture.folder / MESH.format(frame=frame))


def scene(folder: Path, capture: Capture, **changes: Any) -> Path:
    content = {"schema_version": 1, "dataset": capture.name, "fps": 25, "units": "mm", "up": "y"}
    write_json(folder / "scene.json", content | {"path": {"sensors_of": str(capture.folder)}} | changes)
    return folder


def films_of(folder: Path, options: RenderOptions = OPTIONS) -> dict[str, Film]:
    films, _ = planned_films(read_sources([folder]), options, ThisProcess(), lambda *_: None)
    return {film.sequence.approach: film for film in films}


def frames_of(film: Film) -> list[tuple[NDArray[np.uint8], NDArray[np.bool_]]]:
    cameras = film.cameras()
    around = scene_around(film.bounds, cameras, film.options.background)
    around = around.without_light() if film.options.light == "flat" else around
    models = (film.sequence.read(number) for number in film.shown)
    return [
        (picture.copy(), mask) for picture, mask in render_masked_frames(models, cameras, around, renderer="software")
    ]


def overlap(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    return float((first & second).sum() / (first | second).sum())


def similarity() -> NDArray[np.float64]:
    transform = np.eye(4)
    transform[:3, :3] = 0.37 * Rotation.from_rotvec([0.4, 1.0, -0.3]).as_matrix()
    transform[:3, 3] = [0.5, -0.2, 0.9]
    return transform


@pytest.mark.slow
def test_a_splat_a_mesh_and_a_cloud_stand_in_one_place_over_one_floor(capture: Capture, tmp_path: Path) -> None:
    mesh = true_mesh(capture)
    splats = splats_on(mesh, N_SPLATS)
    write_mesh(tmp_path / "mesh.ply", mesh)
    write_cloud(tmp_path / "cloud.ply", Cloud(splats.centres, np.tile([0.0, 0, 1], (N_SPLATS, 1)), shades(splats)))
    write_splats(tmp_path / "splat.ply", splats)
    films = films_of(scene(tmp_path, capture, splat_mm=5))
    (mesh_frame, mesh_mask), *_ = frames_of(films["mesh"])
    for other in ("splat", "cloud"):
        (frame, mask), *_ = frames_of(films[other])
        assert overlap(mask, mesh_mask) > 0.85
        inside, outside = mask & mesh_mask, ~(mask | mesh_mask)
        difference = np.abs(frame.astype(int) - mesh_frame)
        assert difference[inside].mean() < 15  # as large as the splats blur the mesh's pattern
        assert difference[outside].mean() < 2  # the shadow on the floor


def shades(splats: Splats) -> NDArray[np.uint8]:
    return np.rint(np.clip(0.5 + 0.28209479 * splats.harmonics[:, 0], 0, 1) * 255).astype(np.uint8)


@pytest.mark.slow
def test_light_falls_on_meshes_alone_unless_it_is_flat(capture: Capture, tmp_path: Path) -> None:
    mesh = true_mesh(capture)
    write_mesh(tmp_path / "mesh.ply", mesh)
    write_splats(tmp_path / "splat.ply", splats_on(mesh, N_SPLATS))
    lit, flat = (films_of(scene(tmp_path, capture), replace(OPTIONS, light=light)) for light in ("studio", "flat"))
    means = {
        (name, light): float(frame[mask].mean())
        for light, films in (("studio", lit), ("flat", flat))
        for name, film in films.items()
        for frame, mask in frames_of(film)[:1]
    }
    assert means["splat", "studio"] == means["splat", "flat"]
    assert means["mesh", "studio"] < 0.92 * means["mesh", "flat"]
    assert means["mesh", "flat"] == pytest.approx(means["splat", "flat"], rel=0.05)
    with pytest.raises(ValueError, match="light is 'dim', expected one of studio, flat"):
        RenderOptions(light="dim")


@pytest.mark.slow
def test_a_folder_of_splats_is_a_model_that_moves(capture: Capture, tmp_path: Path) -> None:
    for frame in range(2):
        mesh = true_mesh(capture, 0)
        moved = replace(mesh, vertices=mesh.vertices + np.float32(60 * frame))
        write_splats(tmp_path / f"moving/{frame:04d}.ply", splats_on(moved, 2000))
    manifest = read_json(render([scene(tmp_path, capture)], tmp_path / "set", OPTIONS))
    (entry,) = manifest["stimuli"]
    assert (entry["model_frames"], entry["loop"]) == (2, "bounce")
    assert entry["model_bytes"] == (tmp_path / "moving/0000.ply").stat().st_size
    first, second = read_video(tmp_path / "set" / entry["video"])
    assert np.abs(first.astype(int) - second).mean() > 1


def test_splats_of_nerfstudio_come_back_in_place_without_a_number(capture: Capture, tmp_path: Path) -> None:
    export_nerfstudio(capture, tmp_path / "dataset")
    theirs = similarity()
    scale = float(np.cbrt(np.linalg.det(theirs[:3, :3])))
    transform = np.column_stack([theirs[:3, :3] / scale, theirs[:3, 3] / scale])
    true = splats_on(true_mesh(capture), 500)
    trained = true.moved(np.diag([1e-3, 1e-3, 1e-3, 1])).moved(theirs)  # in metres, then as nerfstudio moves the world
    folder = tmp_path / "models"
    write_splats(folder / "splatfacto/0000.ply", trained)
    write_json(folder / "splatfacto/dataparser_transforms.json", {"transform": transform.tolist(), "scale": scale})
    check_in_place(scene(folder, capture), "splatfacto", true)


@pytest.mark.parametrize("form", ["transforms.json", "colmap"])
def test_splats_trained_on_our_export_come_back_in_place_from_its_cameras(
    capture: Capture, tmp_path: Path, form: str
) -> None:
    true = splats_on(true_mesh(capture), 500)
    if form == "colmap":
        export_colmap(capture, tmp_path / "dataset")
        trained, place = true.moved(np.diag([1e-3, 1e-3, 1e-3, 1])), "../dataset"
    else:
        export_nerfstudio(capture, tmp_path / "dataset")
        z_up = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
        trained, place = true.moved(np.diag([1e-3, 1e-3, 1e-3, 1])).moved(z_up), "../dataset/transforms.json"
    folder = tmp_path / "models"
    write_splats(folder / "trained.ply", trained)
    check_in_place(scene(folder, capture, placements={"trained": {"trained_on": place}}), "trained", true)


def check_in_place(folder: Path, approach: str, true: Splats) -> None:
    (source,) = read_sources([folder])
    (sequence,) = [item for item in source.sequences if item.approach == approach]
    assert sequence.placement is not None
    read = read_model(sequence.files[0], sequence.placement).model
    assert isinstance(read, Splats)
    assert np.abs(read.centres - true.centres).max() < 0.01
    assert np.allclose(read.scales[:, :2], true.scales[:, :2], rtol=1e-3)
    same = np.abs((read.rotations * true.rotations).sum(axis=1))
    assert same.min() > 0.9999


def test_cameras_that_colmap_found_anew_lead_back_whatever_their_world(capture: Capture, tmp_path: Path) -> None:
    export_colmap(capture, tmp_path / "dataset")
    images = tmp_path / "dataset/sparse/0/images.bin"
    theirs = similarity()
    scale = float(np.cbrt(np.linalg.det(theirs[:3, :3])))
    moved, at = bytearray(images.read_bytes()), 8
    for _ in range(struct.unpack_from("<Q", moved)[0]):
        w, x, y, z, *translation = struct.unpack_from("<7d", moved, at + 4)
        turn = Rotation.from_quat([x, y, z, w]).as_matrix() @ theirs[:3, :3].T / scale
        x, y, z, w = Rotation.from_matrix(turn).as_quat()
        struct.pack_into("<7d", moved, at + 4, w, x, y, z, *(scale * np.array(translation) - turn @ theirs[:3, 3]))
        at = moved.index(b"\0", at + 64) + 9
    images.write_bytes(moved)
    expected = np.diag([1000.0, 1000, 1000, 1]) @ np.linalg.inv(theirs)
    assert np.allclose(world_from_trained(tmp_path / "dataset", capture), expected, rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize(
    ("placed", "sentence"),
    [
        ({"trained_on": "gone.json"}, "gone.json"),
        ({"trained_on": "empty.json"}, "empty.json: is not the file of a training: 'transform'"),
        ({"trained_on": "others.json"}, "has 1 images, of which 0 have names of photographs of ball"),
        ({"trained_on": "dataparser_transforms.json", "up": "z"}, "leave out units, up and world_from_model"),
        ({"scale": 2}, "placements"),
        ({"up": "w"}, "placements"),
    ],
)
def test_a_placement_that_cannot_be_told_is_refused(
    capture: Capture, tmp_path: Path, placed: dict[str, Any], sentence: str
) -> None:
    write_json(tmp_path / "empty.json", {})
    write_json(tmp_path / "others.json", {"frames": [{"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}]})
    write_json(tmp_path / "dataparser_transforms.json", {"transform": np.eye(4)[:3].tolist(), "scale": 1})
    _, problems = read_scene_file(scene(tmp_path, capture, placements={"splat": placed}))
    assert sentence in " ".join(problems)


def test_an_approach_may_stand_in_another_way_than_the_others(capture: Capture, tmp_path: Path) -> None:
    splats = splats_on(true_mesh(capture), 500)
    turned = splats.moved(np.diag([1e-3, -1e-3, -1e-3, 1]))  # metres, y down, as COLMAP leaves it
    write_splats(tmp_path / "usual.ply", splats)
    write_splats(tmp_path / "other.ply", turned)
    placements = {"other": {"units": "m", "up": "-y", "antialiased": True}}
    (source,) = read_sources([scene(tmp_path, capture, placements=placements)])
    read = {item.approach: read_model(item.files[0], item.placement).model for item in source.sequences}  # type: ignore[arg-type]  # none is a run's
    usual, other = read["usual"], read["other"]
    assert isinstance(usual, Splats)
    assert isinstance(other, Splats)
    assert np.abs(usual.centres - other.centres).max() < 0.001
    assert (usual.antialiased, other.antialiased) == (False, True)


def test_a_wrong_unit_is_named_before_anything_is_filmed(capture: Capture, tmp_path: Path) -> None:
    write_splats(tmp_path / "splat.ply", splats_on(true_mesh(capture), 500).moved(np.diag([1e-3, 1e-3, 1e-3, 1])))
    with pytest.raises(ValueError, match=r"it is probably in m, but scene.json says mm"):
        films_of(scene(tmp_path, capture))


def test_a_few_splats_that_fly_far_off_do_not_make_a_scene_large(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    near = rng.normal(size=(1000, 3)) * 100
    near[:10] *= 1e6
    one = np.ones(1000)
    turns = np.tile([1.0, 0, 0, 0], (1000, 1))
    splats = Splats(near, np.ones((1000, 3)), turns, 0.9 * one, np.zeros((1000, 1, 3)))
    facts = inspect_model(write_splats(tmp_path / "a.ply", splats), Placement("mm", tuple(map(tuple, np.eye(4)))))
    assert 300 < facts.size < 1200


def test_splats_are_measured_on_photographs_as_the_mesh_they_lie_on(capture: Capture) -> None:
    mesh = true_mesh(capture)
    photograph = next(photographs(capture, [0]))
    of_mesh, of_splats = (
        view_rows(rendered(model, photograph.camera), photograph)[0] for model in (mesh, splats_on(mesh, 20_000))
    )
    assert of_splats["psnr_db"] > 15
    assert of_splats["psnr_db"] == pytest.approx(of_mesh["psnr_db"], abs=6)
    if of_mesh["coverage"] is not None:
        assert of_splats["coverage"] == pytest.approx(of_mesh["coverage"], abs=0.05)
