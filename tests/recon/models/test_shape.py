"""Models by other programs are measured as ours are, whatever their format."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from recon.cli.main import app
from recon.geometry.mesh import Mesh
from recon.geometry.mesh_files import read_mesh, write_mesh
from recon.geometry.obj import obj_text
from recon.models.shape import read_model_shape
from recon.studio.objects import ball
from recon.validation.clouds import read_measured
from tests.recon.models.model_files import textured_obj

RADIUS = 150.0


def sphere(scale: float = 1.0) -> Mesh:
    vertices, faces = ball(RADIUS * scale, 25 * scale)
    normals = (vertices / np.linalg.norm(vertices, axis=1, keepdims=True)).astype(np.float32)
    return Mesh(vertices.astype(np.float32), faces, normals, np.full((len(normals), 3), 90, np.uint8))


def write_obj(path: Path, mesh: Mesh) -> Path:
    text = obj_text(mesh.vertices, mesh.faces, mesh.normals, np.zeros((len(mesh.vertices), 2), np.float32), "none.mtl")
    lines = [line for line in text.splitlines() if not line.startswith(("mtllib", "usemtl"))]
    path.write_text("\n".join(lines) + "\n")
    return path


WRITERS: dict[str, Callable[[Path, Mesh], Path]] = {".ply": write_mesh, ".glb": write_mesh, ".obj": write_obj}


def test_a_glb_of_ours_has_the_shape_and_colours_that_were_written(tmp_path: Path) -> None:
    path = write_mesh(tmp_path / "a.glb", sphere())
    mesh, shape = read_mesh(path), read_model_shape(path)
    np.testing.assert_allclose(shape.points, mesh.vertices, atol=1e-3)
    assert np.array_equal(shape.faces, mesh.faces)
    assert shape.colours is not None
    assert np.array_equal(shape.colours, mesh.colours)


def test_parts_with_textures_and_plain_colours_have_the_colours_of_their_vertices(tmp_path: Path) -> None:
    shape = read_model_shape(textured_obj(tmp_path))
    assert shape.colours is not None
    assert {tuple(colour) for colour in shape.colours[shape.faces].reshape(-1, 3).tolist()} == {
        (200, 10, 10),
        (10, 200, 10),
        (10, 10, 204),
    }


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_gltf_is_in_metres_whatever_the_unit_of_other_files(tmp_path: Path, unit: str) -> None:
    points = read_measured(write_mesh(tmp_path / "a.glb", sphere()), unit)
    assert np.linalg.norm(points, axis=1).max() == pytest.approx(RADIUS, rel=1e-3)
    points = read_measured(write_obj(tmp_path / "a.obj", sphere(1 / {"mm": 1, "m": 1000}[unit])), unit)
    assert np.linalg.norm(points, axis=1).max() == pytest.approx(RADIUS, rel=1e-3)


def report(out: Path, *words: Any) -> dict[str, Any]:
    done = CliRunner().invoke(app, ["validate", *map(str, words), "-o", str(out)])
    assert done.exit_code == 0, done.output
    content: dict[str, Any] = json.loads((out / "report.json").read_text())
    return content


OF_COLOURS = ("y_mse", "cb_mse", "cr_mse", "pointssim_colour")
COMMANDS = {  # and where the report holds its numbers
    "table": ("sphere", "MODEL", "--radius", RADIUS, "--thresholds", "1:5:1"),
    "accuracy": ("mesh", "MODEL", "--truth", "TRUTH", "--thresholds", "1:5:1"),
    "measures": ("cloud", "MODEL", "--reference", "TRUTH", "--density", 0.02),
}


@pytest.mark.slow
@pytest.mark.parametrize("key", COMMANDS)
def test_a_measure_is_the_same_in_every_format(key: str, tmp_path: Path) -> None:
    found = {}
    for suffix, write in WRITERS.items():
        files = {
            "MODEL": write(tmp_path / f"model{suffix}", sphere(1.01)),
            "TRUTH": write(tmp_path / f"truth{suffix}", sphere()),
        }
        measured = report(tmp_path / suffix[1:], *(files.get(str(word), word) for word in COMMANDS[key]))
        found[suffix] = list(numbers(measured[key]))
    assert len(found[".ply"]) > 3
    for suffix in (".glb", ".obj"):
        assert found[suffix] == pytest.approx(found[".ply"], rel=1e-3, abs=1e-3)


def numbers(content: Any) -> Iterator[float]:
    """All numbers of a part of a report but those of colours, which OBJ has in textures alone."""
    if isinstance(content, dict) and content.get("measure") not in OF_COLOURS:
        content = list(content.values())
    if isinstance(content, list):
        for part in content:
            yield from numbers(part)
    elif isinstance(content, int | float) and not isinstance(content, bool):
        yield float(content)
