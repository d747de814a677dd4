"""Approaches of any name, with levels or without, go from the manifest to the analysis."""

from __future__ import annotations

import io
import shutil
import zipfile
from pathlib import Path

import httpx
import pytest

from app.analysis import analyse_file
from app.operations.studies import create
from app.settings import Settings
from app.simulation.participants import simulate
from tests.app.tiny_stimuli import encode, flat, stimulus, write_manifest, write_set

pytestmark = pytest.mark.slow

NAMES = {"neus": {}, "My Method 2": {"depth": "pm"}, "colmap-poissön": {}}  # with some levels, or none
ITEMS = ["id_fb", "pm_fb", *NAMES]


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


@pytest.fixture(scope="module")
def voted(server: str, settings: Settings, token: str, open_set: Path) -> str:
    """The address of a study of the set, which six artificial participants have taken."""
    study = create.create_study(settings, open_set, "Open names", exposure_s=0.4, seed=1)
    abilities = {name: number / 2 for number, name in enumerate(ITEMS)}
    simulate(server, study["slug"], study["invitation"], token, 6, abilities, 0.3, seed=4)
    return f"/api/v1/studies/{study['slug']}"


def test_approaches_without_levels_are_compared_and_left_out_by_factor(analyst: httpx.Client, voted: str) -> None:
    told = analyst.get(voted).json()
    assert {row["item"]: row["levels"] for row in told["conditions"]}.items() >= NAMES.items()
    analysis = analyst.get(f"{voted}/analysis").json()
    scored = {row["item"] for row in analysis["scores"] if row["comparison"] == "all"}
    assert scored == set(ITEMS)
    assert {row["item"] for row in analysis["scores"] if row["comparison"] == "depth"} == {"id", "pm"}
    assert "My Method 2 has no level of fusion: the analysis by factor leaves it out" in analysis["warnings"]
    assert (
        "neus, colmap-poissön have no level of depth or fusion: the analysis by factor leaves them out"
        in analysis["warnings"]
    )


def test_the_archive_gives_the_same_analysis_by_factor(analyst: httpx.Client, voted: str, tmp_path: Path) -> None:
    analysis = analyst.get(f"{voted}/analysis").json()
    with zipfile.ZipFile(io.BytesIO(analyst.get(f"{voted}/archive.zip").content)) as archive:
        archive.extractall(tmp_path)
    folder = tmp_path / Path(voted).name
    again = analyse_file(folder / "votes.csv", tmp_path / "results", items=folder / "items.csv")
    assert again["scores"] == analysis["scores"]
    assert again["warnings"] == analysis["warnings"]
