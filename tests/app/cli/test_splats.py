"""From files of splats to the figure of score against size, by the commands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.operations.database import open_store
from app.settings import Settings
from app.store.studies.studies import study_by_slug
from app.web.analyst.results import results_of
from recon.geometry.mesh_files import read_mesh
from recon.runtime.files import write_json
from recon.studio import SynthParameters, synthesise
from recon.studio.truth import MESH
from tests.command_line import Command
from tests.recon.models.splats.made import splats_on, write_splats

SHARES = (1.0, 0.4, 0.1)
FULL = 4000


@pytest.mark.slow
def test_splats_of_two_methods_at_three_levels_of_pruning_get_their_rates(command: Command, tmp_path: Path) -> None:
    capture = synthesise(
        tmp_path / "capture", SynthParameters(scene="ball", n_sensors=2, n_frames=1, size=(160, 120), noise=0.0)
    )
    mesh = read_mesh(capture.folder / MESH.format(frame=0))
    full, folder, levels = splats_on(mesh, FULL), tmp_path / "models", {}
    for share in SHARES:
        n = int(share * FULL)
        models = {"pruned": full.select(np.arange(n)), "grown": splats_on(mesh, n)}
        for method, splats in models.items():
            write_splats(folder / f"{method}_{share:g}.ply", splats)
            levels[f"{method}_{share:g}"] = {"method": method, "share": f"{share:g}"}
    scene = {"schema_version": 1, "dataset": "ball", "fps": 25, "units": "mm", "up": "y", "levels": levels}
    write_json(folder / "scene.json", scene | {"path": {"sensors_of": "../capture"}})

    made = command("render", folder, "-o", tmp_path / "set", "--size", "64x48", "--seconds", "0.16", "--no-master")
    assert made.code == 0
    assert command("study", "create", tmp_path / "set", "--name", "Splats").code == 0
    abilities = {name: float(level["share"]) + 0.3 * (level["method"] == "grown") for name, level in levels.items()}
    write_json(tmp_path / "abilities.json", abilities)
    asked = ("--study", "splats", "--participants", 3, "--abilities", tmp_path / "abilities.json")
    assert command("simulate", *asked).code == 0

    with open_store(Settings()) as database:
        with database.reading() as connection:
            study = study_by_slug(connection, "splats")
        assert study is not None
        results = results_of(database, study.id)
    assert results.analysis is not None
    sizes = {row["item"]: row["bytes"] for row in results.analysis["rates"] if row["dataset"] == "ball"}
    assert sizes == {name: (folder / f"{name}.ply").stat().st_size for name in levels}
    compared = {(row["method_a"], row["method_b"]) for row in results.analysis["rate_differences"]}
    assert {frozenset(pair) for pair in compared} == {frozenset({"pruned", "grown"})}
    assert "rates" in results.charts
