"""What is uploaded reaches its shelf if it is what the shelf takes, whatever its files are called."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

import pytest

from app.intake.arrivals import Limits, shelve

MP4 = b"\0\0\0\x18ftypmp42"


@pytest.mark.parametrize("kind", ["captures", "calibration", "films"])
@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".m4v", ".M4V"])
def test_videos_by_any_name_of_their_format_are_shelved(tmp_path: Path, kind: str, suffix: str) -> None:
    packed = tmp_path / "packed.zip"
    with ZipFile(packed, "w") as archive:
        for place in ("left", "right"):
            archive.writestr(f"{place}/a{suffix}", MP4)
    shelved = shelve(tmp_path, kind, "board", packed, tmp_path / "work", Limits(1, 10))
    assert sorted(path.name for path in shelved.rglob("*.*")) == [f"a{suffix}"] * 2


def test_models_bring_textures_of_every_format_that_render_reads(tmp_path: Path) -> None:
    content = {"scene.json": b"{}", "neus/0000.gltf": b"{}", "neus/skin.webp": b"RIFF\0\0\0\0WEBPVP8 "}
    packed = tmp_path / "packed.zip"
    with ZipFile(packed, "w") as archive:
        for place, written in content.items():
            archive.writestr(place, written)
    shelved = shelve(tmp_path, "models", "neus", packed, tmp_path / "work", Limits(1, 10))
    assert {path.relative_to(shelved).as_posix() for path in shelved.rglob("*.*")} == set(content)
