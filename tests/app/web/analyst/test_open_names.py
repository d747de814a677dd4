"""Approaches of any name, with levels or without, go from the manifest to the analysis."""

from __future__ import annotations

import shutil
from pathlib import Path

import httpx
import pytest

from app.operations import create
from app.settings import Settings
from app.simulation.participants import simulate
from tests.app.tiny_stimuli import encode, flat, stimulus, write_manifest, write_set

NAMES = {"neus": {}, "My Method 2": {"depth": "pm"}, "colmap-poissön": {}}  # with some levels, or none


@pytest.fixture(scope="module")
def open_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("open")
    write_set(folder, ("ball",), ("id_fb", "pm_fb"))
    entries = [stimulus(folder, "ball", approach) for approach in ("id_fb", "pm_fb")]
    for number, (name, levels) in enumerate(NAMES.items()):
        encode(folder / "ball" / "x_y.mp4", flat(f"0x{0x90 + 0x10 * number:02x}8080"))
        entry = stimulus(folder, "ball", "x_y")
        shutil.move(folder / "ball/x_y.mp4", folder / f"ball/{name}.mp4")
        entries.append(entry | {"approach": name, "levels": levels, "video": f"ball/{name}.mp4"})
    return write_manifest(folder, entries)


def test_approaches_without_levels_are_compared_and_left_out_by_factor(
    server: str, settings: Settings, token: str, analyst: httpx.Client, open_set: Path
) -> None:
    study = create.create_study(settings, open_set, "Open names", exposure_s=0.4, seed=1)
    names = ["id_fb", "pm_fb", *NAMES]
    abilities = {name: number / 2 for number, name in enumerate(names)}
    simulate(server, study["slug"], study["invitation"], token, 6, abilities, 0.3, seed=4)
    told = analyst.get(f"/api/v1/studies/{study['slug']}").json()
    assert {row["item"]: row["levels"] for row in told["conditions"]}.items() >= NAMES.items()
    analysis = analyst.get(f"/api/v1/studies/{study['slug']}/analysis").json()
    scored = {row["item"] for row in analysis["scores"] if row["comparison"] == "all"}
    assert scored == set(names)
    assert {row["item"] for row in analysis["scores"] if row["comparison"] == "depth"} == {"id", "pm"}
    assert "My Method 2 has no level of fusion: the analysis by factor leaves it out" in analysis["warnings"]
    assert (
        "neus, colmap-poissön have no level of depth or fusion: the analysis by factor leaves them out"
        in analysis["warnings"]
    )
