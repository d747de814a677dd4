"""What `render` reads, `export` writes anew."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from recon.geometry.mesh import Mesh
from recon.models.convert import read_as_it_stands, write_model
from recon.models.splats.read import read_with_warnings
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
