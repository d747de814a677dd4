"""What `render` reads, `export` writes anew."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from recon.capture.format import read_capture, write_capture
from recon.geometry.mesh import Mesh, Texture
from recon.models.convert import read_as_it_stands, write_model
from recon.models.splats.read import read_with_warnings
from recon.pipeline.run import SCHEMA_VERSION
from tests.command_line import Command

FOREIGN = Path("foreign/models")


@pytest.mark.parametrize("name", ["o_concave_L.obj", "p_polys.ply", "chart_trimesh.glb", "g_instancing.glb"])
@pytest.mark.parametrize("suffix", [".ply", ".glb"])
def test_models_of_other_programs_keep_their_shape(real_data: Path, tmp_path: Path, name: str, suffix: str) -> None:
    model = read_as_it_stands(real_data / FOREIGN / name).model
    again = read_as_it_stands(write_model(tmp_path / f"a{suffix}", model)).model
    assert isinstance(model, Mesh)
    assert isinstance(again, Mesh)
    np.testing.assert_allclose(again.vertices, model.vertices, rtol=1e-6, atol=1e-6)
    np.testing.assert_array_equal(again.faces, model.faces)
    np.testing.assert_array_equal(again.colours, model.colours)


@pytest.mark.parametrize("name", ["minimal-v3.spz", "minimal.ksplat", "minimal.splat", "round_sh0.ply", "flat_sh3.ply"])
def test_splats_of_every_format_are_the_same_as_ply(real_data: Path, tmp_path: Path, name: str) -> None:
    splats, _ = read_with_warnings(real_data / "splats" / name)
    again, _ = read_with_warnings(write_model(tmp_path / "a.ply", splats))
    np.testing.assert_array_equal(again.centres, splats.centres)
    np.testing.assert_allclose(again.scales, splats.scales, rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(again.opacities, splats.opacities, atol=1e-6)
    np.testing.assert_array_equal(again.harmonics, splats.harmonics)


def test_the_command_exports_points_and_says_what_cannot_be_held(command: Command, tmp_path: Path) -> None:
    rows = "0 0 0\n1 0 0\nnan 0 0\n"
    header = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    (tmp_path / "a.ply").write_text(f"{header}end_header\n{rows}")
    told = command("export", tmp_path / "a.ply", tmp_path / "b.ply", "--json")
    assert told.code == 0, told.err
    assert json.loads(told.out)["vertices"] == 2
    assert "has 1 of 3 points without finite coordinates" in told.err
    refused = command("export", tmp_path / "a.ply", tmp_path / "b.glb")
    assert refused.code == 1
    assert "the model is points without faces, which are written as .ply" in refused.err
    assert command("export", tmp_path / "a.ply", tmp_path / "c.ply", "--truth", tmp_path / "a.ply").code == 1


def coloured(shift: float, *, is_textured: bool) -> Mesh:
    vertices = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [10, 10, shift]], np.float32) + np.float32(shift)
    texture = None
    if is_textured:
        pixels = np.full((8, 8, 3), int(40 * shift), np.uint8)
        texture = Texture(pixels, np.array([[0.1, 0.1], [0.9, 0.1], [0.1, 0.9], [0.9, 0.9]], np.float32))
    normals = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))
    faces = np.array([[0, 1, 2], [1, 3, 2]], np.int32)
    return Mesh(vertices, faces, normals, np.full((4, 3), int(40 * shift), np.uint8), texture)


@pytest.mark.parametrize("is_textured", [False, True])
def test_a_sequence_shows_one_mesh_after_the_other_with_an_atlas_each(
    command: Command, tmp_path: Path, is_textured: bool
) -> None:
    (tmp_path / "frames").mkdir()
    meshes = [coloured(float(number + 1), is_textured=is_textured) for number in range(3)]
    for number, mesh in enumerate(meshes):
        write_model(tmp_path / f"frames/{number + 7:04d}.glb", mesh)
    told = command("export", tmp_path / "frames", tmp_path / "out", "--sequence", "--fps", 10, "--json")
    assert told.code == 0, told.err
    assert json.loads(told.out)["frames"] == 3
    scene = trimesh.load_scene(tmp_path / "out/sequence.gltf", process=False)
    assert len(scene.geometry) == 3
    for mesh, loaded in zip(meshes, scene.geometry.values(), strict=True):
        np.testing.assert_allclose(loaded.vertices, mesh.vertices, atol=1e-5)
        if is_textured:
            picture = np.asarray(loaded.visual.material.baseColorTexture)
            assert (picture == mesh.texture.pixels[0, 0, 0]).all()  # type: ignore[union-attr]  # it has one
    document = json.loads((tmp_path / "out/sequence.gltf").read_text())
    assert shown(tmp_path / "out", document, [0.0, 0.05, 0.1, 0.19, 0.25, 9.0]) == [{0}, {0}, {1}, {1}, {2}, {2}]


def shown(folder: Path, document: dict[str, Any], times: list[float]) -> list[set[int]]:
    """Return which nodes have a size at each time, played as glTF says: each step holds until the next."""

    def values(number: int) -> np.ndarray:
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        content = (folder / document["buffers"][view["buffer"]]["uri"]).read_bytes()
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        return np.frombuffer(content, "<f4", accessor["count"] * width, view["byteOffset"]).reshape(-1, width)

    seen: list[set[int]] = [set() for _ in times]
    (animation,) = document["animations"]
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        keys, scales = values(sampler["input"])[:, 0], values(sampler["output"])
        for place, time in enumerate(times):
            if scales[max(np.searchsorted(keys, time + 1e-6, side="right") - 1, 0)].any():
                seen[place].add(channel["target"]["node"])
    return seen


def test_a_sequence_is_of_meshes_without_gaps(command: Command, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    for number in (0, 2):
        write_model(tmp_path / f"frames/{number}.ply", coloured(1.0, is_textured=False))
    told = command("export", tmp_path / "frames", tmp_path / "out", "--sequence")
    assert told.code == 1
    assert "frame 1 is missing" in told.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_sequence_of_a_run_plays_as_fast_as_it_was_recorded(command: Command, tmp_path: Path) -> None:
    synth = ("capture", "synth", tmp_path / "ball", "--scene", "ball", "--frames", 1, "--size", "64x48", "--fps", 12)
    assert command(*synth).code == 0
    capture = read_capture(tmp_path / "ball")
    folder = tmp_path / "run/meshes/dr_fb"
    folder.mkdir(parents=True)
    write_model(folder / "0000.ply", coloured(1.0, is_textured=False))
    json_of_run = {"approaches": ["dr_fb"], "frames": [0], "versions": {}, "schema_version": SCHEMA_VERSION}
    (tmp_path / "run/run.json").write_text(json.dumps(json_of_run))
    write_capture(replace(capture, folder=tmp_path / "run"))
    told = command("export", folder, tmp_path / "out", "--sequence", "--json")
    assert told.code == 0, told.err
    assert json.loads(told.out)["fps"] == 12


def test_a_sequence_tells_what_was_found_in_its_models(command: Command, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    for number in range(2):
        text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl lost\nf 1 2 3\n"
        (tmp_path / f"frames/{number}.obj").write_text(text)
    told = command("export", tmp_path / "frames", tmp_path / "out", "--sequence", "--json")
    assert told.code == 0, told.err
    assert len(json.loads(told.out)["warnings"]) == 1
    assert "warning: " in told.err
    assert "1.obj" not in told.err  # once, not for every frame


def test_a_sequence_is_a_folder_not_a_file(command: Command, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    write_model(tmp_path / "frames/0.ply", coloured(1.0, is_textured=False))
    told = command("export", tmp_path / "frames", tmp_path / "out.glb", "--sequence")
    assert told.code == 1
    assert "expected the name of a folder" in told.err
    assert not (tmp_path / "out.glb").exists()
