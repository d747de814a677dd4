"""What the shelves list, and that no name leads out of them."""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from app.errors import ForbiddenError, InvalidError
from app.files import is_plain_name
from app.intake.shelves import KINDS, entries, entry_path, free_path, remove_entry, shelf
from app.intake.summaries import walk
from app.intake.zips import check_zip

SENSOR = {"id": "S1", "left": {"image": "l.mp4", "size": [64, 48]}, "right": {"image": "r.mp4", "size": [64, 48]}}
NO_CAPTURE = "capture.json does not describe a capture: 'n_frames' is missing. “Check a recording” tells more."


def put(folder: Path, path: str, content: str = "x") -> Path:
    file = folder / path
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(content)
    return file


def test_a_missing_folder_has_empty_shelves(tmp_path: Path) -> None:
    assert [entries(tmp_path / "intake", kind) for kind in KINDS] == [[]] * len(KINDS)


@pytest.mark.parametrize(
    ("kind", "name", "files", "summary"),
    [
        (
            "captures",
            "ball",
            {"capture.json": json.dumps({"name": "b", "sensors": [SENSOR], "n_frames": 3, "fps": 25})},
            "1 sensor, 3 frames, 25 a second",
        ),
        ("captures", "empty", {"notes.txt": "x"}, "recording without capture.json: no picture"),
        ("captures", "damaged", {"capture.json": "{}"}, NO_CAPTURE),
        ("calibration", "board", {"left/1.png": "x", "right/1.JPG": "x"}, "2 pictures"),
        ("models", "m", {"pm/0.ply": "x", "b.glb": "x"}, "2 approaches, 2 models; scene.json is missing or damaged"),
        ("films", "f", {"ball/a.mp4": "x", "ball/b.mp4": "x", "ball/b.mask.mp4": "x"}, "2 films of 1 dataset"),
        ("clouds", "c", {"a.ply": "x"}, "1 cloud"),
        ("measures", "m.csv", {"": "dataset,value\nball,1\n\n"}, "1 row: dataset, value"),
        ("runs", "set", {"manifest.json": '{"stimuli": [{}, {}]}'}, "stimulus set of 2 films"),
        ("runs", "odd", {"manifest.json": "[", "a": "x", "link/b": "x"}, "3 files"),
    ],
)
def test_an_entry_says_in_a_line_what_it_holds(
    tmp_path: Path, kind: str, name: str, files: dict[str, str], summary: str
) -> None:
    for path, content in files.items():
        put(tmp_path, f"{kind}/{name}/{path}" if path else f"{kind}/{name}", content)
    (entry,) = entries(tmp_path, kind)
    assert (entry.name, entry.summary) == (name, summary)
    assert entry.size == sum(map(len, files.values()))
    assert entry_path(tmp_path, kind, name) == tmp_path / kind / name


@pytest.mark.parametrize(
    "name", ["..", ".", "", "../secret", "a/b", ".hidden", "-o", "a\n", "a ", "a\u202eb", "录" * 70, "link", "nothing"]
)
def test_no_name_leads_out_of_a_shelf(tmp_path: Path, name: str) -> None:
    put(tmp_path, "secret/capture.json")
    put(tmp_path, "captures/.hidden/capture.json")
    (tmp_path / "captures" / "link").symlink_to(tmp_path / "secret")
    assert entries(tmp_path, "captures") == []
    with pytest.raises(InvalidError):
        entry_path(tmp_path, "captures", name)


def test_there_are_no_other_kinds(tmp_path: Path) -> None:
    with pytest.raises(InvalidError, match="expected one of captures"):
        shelf(tmp_path, "..")


def test_a_link_inside_an_entry_is_not_followed(tmp_path: Path) -> None:
    put(tmp_path, "secret.csv", "a long secret")
    put(tmp_path, "runs/r/log.txt", "1234")
    (tmp_path / "runs" / "r" / "link.csv").symlink_to(tmp_path / "secret.csv")
    (entry,) = entries(tmp_path, "runs")
    assert (entry.size, entry.summary) == (4, "1 file")


def refuse(*_: object, **__: object) -> None:
    raise PermissionError(13, "Permission denied")


def test_an_entry_that_the_server_may_not_read_is_listed_with_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, "captures/closed/capture.json")
    put(tmp_path, "captures/open/left/1.png")
    monkeypatch.setattr(os, "access", lambda path, _: Path(path).name != "closed")
    listed = {entry.name: entry.summary for entry in entries(tmp_path, "captures")}
    assert listed.keys() == {"open", "closed"}
    assert listed["closed"] == "cannot be read: give the server's user access to it"
    assert listed["open"].endswith("1 picture")
    with pytest.raises(
        ForbiddenError, match="'closed' in captures cannot be read: give the server's user access to it"
    ):
        entry_path(tmp_path, "captures", "closed")


def test_a_folder_in_an_entry_that_the_server_may_not_read_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def scan(folder: Path | str) -> Any:
        return refuse() if Path(folder).name == "closed" else whole(folder)

    whole = os.scandir
    put(tmp_path, "runs/r/closed/a.txt")
    put(tmp_path, "runs/r/b.txt", "1234")
    monkeypatch.setattr(os, "scandir", scan)
    (entry,) = entries(tmp_path, "runs")
    assert (entry.size, entry.summary) == (4, "1 file")


@pytest.mark.parametrize("where", [(Path, "rename"), (shutil, "rmtree")])
def test_an_entry_that_the_server_may_not_delete_stays_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: tuple[Any, str]
) -> None:
    file = put(tmp_path, "runs/r/a.txt")
    with monkeypatch.context() as patched:
        patched.setattr(*where, refuse)
        with pytest.raises(InvalidError, match="another user of the server, who has to delete it there"):
            remove_entry(tmp_path, "runs", "r")
    assert file.is_file()
    remove_entry(tmp_path, "runs", "r")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_an_entry_that_is_deleted_while_it_is_counted_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, "runs/kept/a")
    put(tmp_path, "runs/large/a")

    def counted(path: Path) -> Iterator[os.DirEntry[str]]:
        if path.name == "large":
            remove_entry(tmp_path, "runs", "large")
        return walk(path)

    monkeypatch.setattr("app.intake.shelves.walk", counted)
    assert [entry.name for entry in entries(tmp_path, "runs")] == ["kept"]


def test_a_taken_name_and_a_wrong_ending_are_refused(tmp_path: Path) -> None:
    put(tmp_path, "measures/m.csv")
    with pytest.raises(InvalidError, match="another name"):
        free_path(tmp_path, "measures", "m.csv")
    with pytest.raises(InvalidError, match=r"end in \.csv"):
        free_path(tmp_path, "measures", "m.txt")
    assert free_path(tmp_path, "captures", "new") == tmp_path / "captures" / "new"


@pytest.mark.parametrize("name", ["CON", "nul.mp4", "Com1", "lpt\u00b9.csv", "aux.tar.gz"])
def test_a_name_that_windows_keeps_for_devices_is_refused_everywhere(tmp_path: Path, name: str) -> None:
    assert not is_plain_name(name)
    with pytest.raises(InvalidError, match="CON or NUL"):
        free_path(tmp_path, "runs", name)
    with zipfile.ZipFile(tmp_path / "films.zip", "w") as archive:
        archive.writestr(f"street/{name}", b"x")
    with pytest.raises(InvalidError, match="is not plain"):
        check_zip(tmp_path / "films.zip", 1)


@pytest.mark.parametrize("name", ["console", "nullable.csv", "com10", "auxiliary"])
def test_names_that_only_begin_so_are_taken(tmp_path: Path, name: str) -> None:
    assert is_plain_name(name)
    assert free_path(tmp_path, "runs", name).name == name
