"""Importers of every format put the cameras where the pictures show them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from recon.capture.format import Capture, CaptureError, read_capture
from recon.capture.importing.colmap import import_colmap
from recon.capture.importing.formats import AUTO, FORMATS, import_recording
from recon.capture.importing.json_file import import_json
from recon.capture.importing.opencv import import_opencv, write_calibration
from recon.capture.importing.sources import ImportOptions, parse_unit
from tests.command_line import Command
from tests.recon.capture.importing.labelled_recording import (
    OPTIONS,
    POINTS,
    RIG,
    SIZE,
    colmap_model,
    described,
    from_opencv,
    record,
    seen,
)


def from_opencv_xml(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    write_calibration(tmp_path / "source/calibration.xml", RIG)
    return import_opencv(tmp_path / "source", tmp_path / "out", OPTIONS)


def from_colmap(tmp_path: Path) -> Capture:
    source = colmap_model(tmp_path / "source")
    return import_colmap(source, tmp_path / "out", [(11, 12), (13, 14)], ImportOptions(unit_mm=1000.0))


def from_json(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    return import_json(described(tmp_path / "source"), tmp_path / "out")


def from_json_in_metres(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    path = described(tmp_path / "source", unit_mm=1000.0, pose="world_from_cam", right="left_from_right")
    return import_json(path, tmp_path / "out")


def windows_file(path: Path) -> None:
    """Write a file as an editor of Windows does: a mark at its beginning, its ends of lines, a name in capitals."""
    text = path.read_text().replace("\n", "\r\n")
    path.unlink()
    path.with_name(path.stem + path.suffix.upper()).write_bytes(b"\xef\xbb\xbf" + text.encode())


def from_opencv_of_windows(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    write_calibration(tmp_path / "source/calibration.yml", RIG)
    windows_file(tmp_path / "source/calibration.yml")
    return import_recording(AUTO, tmp_path / "source", tmp_path / "out", OPTIONS)


def from_json_of_windows(tmp_path: Path) -> Capture:
    record(tmp_path / "source")
    windows_file(described(tmp_path / "source"))
    return import_recording(AUTO, tmp_path / "source", tmp_path / "out", OPTIONS)


def from_colmap_with_marks(tmp_path: Path) -> Capture:
    source = colmap_model(tmp_path / "source")
    for name in ("cameras", "images", "points3D"):
        text = (source / f"{name}.txt").read_text().replace("# ", " # ")
        (source / f"{name}.txt").write_bytes(b"\xef\xbb\xbf" + text.encode())
    options = ImportOptions(unit_mm=1000.0, pairs=[(11, 12), (13, 14)])
    return import_recording(AUTO, source, tmp_path / "out", options)


@pytest.mark.parametrize(
    "importer",
    [
        from_opencv,
        from_opencv_xml,
        from_opencv_of_windows,
        from_colmap,
        from_colmap_with_marks,
        from_json,
        from_json_of_windows,
        from_json_in_metres,
    ],
)
def test_four_labelled_points_are_where_the_pictures_show_them(
    tmp_path: Path, importer: Callable[[Path], Capture]
) -> None:
    importer(tmp_path)
    capture = read_capture(tmp_path / "out")
    assert [stream.id for stream in capture.sensors] == ["S1", "S2"]
    for stream, sensor in zip(capture.sensors, RIG.sensors, strict=True):
        for side in ("left", "right"):
            found, truth = getattr(stream, side).camera, getattr(sensor, side)
            np.testing.assert_allclose(seen(found, POINTS), seen(truth, POINTS), atol=1e-6)
            assert found.size == SIZE


def test_units_are_names_or_numbers() -> None:
    assert [parse_unit(text) for text in ("mm", "m", "2.5")] == [1.0, 1000.0, 2.5]
    for text in ("-1", "nan", "ell"):
        with pytest.raises(CaptureError, match="expected mm, cm, in, m"):
            parse_unit(text)


@pytest.mark.parametrize(
    ("kind", "option", "sentence"),
    [
        ("middlebury", "--up", "middlebury takes no --up"),
        ("middlebury", "--units", "middlebury takes no --units"),
        ("opencv", "--pairs", "opencv takes no --pairs"),
        ("json", "--shots", "shots are of the short form"),
    ],
)
def test_an_option_that_a_format_does_not_take_is_refused(
    command: Command, tmp_path: Path, kind: str, option: str, sentence: str
) -> None:
    record(tmp_path / "source")
    path = described(tmp_path / "source")
    value = {"--up": "z", "--units": "cm", "--pairs": "1-2", "--shots": "1"}[option]
    told = command("capture", "import", kind, path, tmp_path / "out", option, value)
    assert told.code != 0
    assert sentence in told.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", FORMATS)
def test_a_source_that_is_not_there_is_said_not_to_be_there(name: str, tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"absent: there is no such file or folder$"):
        import_recording(name, tmp_path / "absent", tmp_path / "out", ImportOptions(unit_mm=1.0))


def test_a_source_of_two_formats_says_which_was_read(command: Command, tmp_path: Path) -> None:
    source = colmap_model(tmp_path / "source")
    described(source)
    told = command("capture", "import", "auto", source, tmp_path / "out", "--pairs", "11-12,13-14", "--units", "m")
    assert told.out.startswith(f"Read {source} as colmap: COLMAP's model\n")
    assert "is read as colmap (cameras.txt); it may be json (recording.json) as well: name the format" in told.err
