"""What is uploaded reaches its shelf if it is what the shelf takes, whatever its files are called."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

import pytest

from app.errors import InvalidError
from app.intake.arrivals import Limits, shelve

MP4 = b"\0\0\0\x18ftypmp42"


@pytest.mark.parametrize(
    ("name", "content"), [("a.spz", b"\x1f\x8b"), ("a.spz", b"NGSP"), ("a.sog", b"PK\x03\x04"), ("a.ksplat", b"\0\1")]
)
def test_models_may_be_splats_of_every_form(tmp_path: Path, name: str, content: bytes) -> None:
    places = {"scene.json": b"{}", f"mcmc/{name}": content + b"rest"}
    assert shelved(tmp_path, "models", places) == [f"mcmc/{name}", "scene.json"]


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


def shelved(folder: Path, kind: str, places: dict[str, bytes]) -> list[str]:
    """Where the files of an upload lie on its shelf."""
    packed = folder / "packed.zip"
    with ZipFile(packed, "w") as archive:
        for place, written in places.items():
            archive.writestr(place, written)
    entry = shelve(folder, kind, "sent", packed, folder / "work", Limits(1, 10))
    return sorted(path.relative_to(entry).as_posix() for path in entry.rglob("*") if path.is_file())


@pytest.mark.parametrize(
    ("kind", "places", "kept"),
    [
        ("films", ["ball/a.mp4", "ball/b.mp4"], ["ball/a.mp4", "ball/b.mp4"]),  # the only dataset
        ("films", ["mine/ball/a.mp4"], ["ball/a.mp4"]),
        ("captures", ["mine/left.mp4", "mine/right.mp4"], ["left.mp4", "right.mp4"]),
        ("clouds", ["mine/ball/0.ply"], ["0.ply"]),
        ("clouds", ["mine/0.pcd", "mine/1.stl"], ["0.pcd", "1.stl"]),
    ],
)
def test_a_folder_around_what_is_sent_is_taken_off(
    tmp_path: Path, kind: str, places: list[str], kept: list[str]
) -> None:
    assert shelved(tmp_path, kind, dict.fromkeys(places, MP4 if places[0].endswith("mp4") else b"ply\n")) == kept


def test_clouds_without_a_cloud_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidError):
        shelved(tmp_path, "clouds", {"notes.md": b"a,b\n"})
