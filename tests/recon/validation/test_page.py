"""The page of a report says what it is given, and nothing in it becomes markup by accident."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from recon.cli.main import app
from recon.runtime.files import alone_in, read_json, write_bytes
from recon.validation.page import Section, plain_name, save_picture, write_figure, write_page, write_report


def test_words_are_escaped_and_drawings_are_not(tmp_path: Path) -> None:
    drawing = '<?xml version="1.0"?>\n<svg width="9"><rect/></svg>'
    rows = [{"n_samples": 12345, "sensor": "<S1>", "mean_mm": 0.25}, {"sensor": None, "is_sound": True}]
    sections = [Section("A & B", "x < y", rows, [('"Drawn"', drawing), ("Seen", b"\x89PNG")])]
    page = write_page(tmp_path / "report.html", "<b>Title</b>", sections).read_text(encoding="utf-8")
    assert "<h1>&lt;b&gt;Title&lt;/b&gt;</h1>" in page
    assert "<h2>A &amp; B</h2>\n<p>x &lt; y</p>" in page
    assert '<th scope="col">samples</th>\n<th scope="col" class="words">sensor</th>' in page
    assert '<td>12\u202f345</td>\n<td class="words">&lt;S1&gt;</td>\n<td>0.25</td>\n<td class="words">–</td>' in page
    assert '<figure>\n<svg width="9"><rect/></svg>\n<figcaption>&#34;Drawn&#34;</figcaption>' in page
    assert '<img alt="Seen" src="data:image/png;base64,iVBORw==">' in page


def test_long_paths_break_between_folders(tmp_path: Path) -> None:
    page = write_page(tmp_path / "report.html", "Clouds", [Section("Files", rows=[{"file": "run/<a>/0000.ply"}])])
    assert '<td class="words">run/<wbr>&lt;a&gt;/<wbr>0000.ply</td>' in page.read_text(encoding="utf-8")


def test_names_in_other_scripts_stay_different_files() -> None:
    assert [plain_name(name) for name in ("1/左", "1/右", "a b")] == ["1_左", "1_右", "a_b"]


def report_of(out: Path, name: str, sections: Callable[[Path], list[Section]] | None = None) -> Path:
    """Write a report with a table and a picture of its name."""

    def with_picture(folder: Path) -> list[Section]:
        write_bytes(folder / f"{name}.png", b"picture")
        return []

    return write_report(out, name, {"kind": "mesh", "measures": []}, {name: [{"a": 1}]}, sections or with_picture)


def files_of(name: str) -> set[str]:
    return {"report.json", "report.html", "measures.csv", f"{name}.csv", f"{name}.png"}


def test_a_second_report_replaces_the_files_of_the_first_and_no_others(tmp_path: Path) -> None:
    (tmp_path / "mine.csv").write_text("x,y,z\n", encoding="utf-8")
    os.utime(tmp_path / "mine.csv", (2e9, 2e9))  # newer than any report, as from a machine whose clock is ahead
    for name in ("first", "second"):
        assert report_of(tmp_path, name) == tmp_path / "report.html"
    assert {path.name for path in tmp_path.iterdir()} == files_of("second") | {"mine.csv"}
    assert read_json(tmp_path / "report.json")["files"] == sorted(files_of("second"))


def test_a_report_that_is_interrupted_leaves_the_one_before_it_whole(tmp_path: Path) -> None:
    def interrupted(folder: Path) -> list[Section]:
        write_bytes(folder / "half.png", b"picture")
        raise KeyboardInterrupt

    report_of(tmp_path, "first")
    with pytest.raises(KeyboardInterrupt):
        report_of(tmp_path, "second", interrupted)
    assert {path.name for path in tmp_path.iterdir()} == files_of("first")


def test_a_file_of_somebody_elses_is_not_overwritten_and_the_report_is_kept_beside_it(tmp_path: Path) -> None:
    (tmp_path / "second.csv").write_text("mine", encoding="utf-8")
    report_of(tmp_path, "first")
    with pytest.raises(
        ValueError, match=r"holds second\.csv that no evaluation wrote.*/\.report, where the whole report"
    ):
        report_of(tmp_path, "second")
    assert (tmp_path / "second.csv").read_text(encoding="utf-8") == "mine"
    assert {path.name for path in tmp_path.iterdir()} == files_of("first") | {"second.csv", ".report"}
    assert {path.name for path in (tmp_path / ".report").iterdir()} == files_of("second")


@pytest.mark.parametrize("files", ["", ', "files": null'])
def test_a_report_replaces_one_by_a_version_that_did_not_list_its_files(tmp_path: Path, files: str) -> None:
    for name in ("report.json", "first.csv"):
        (tmp_path / name).write_text(f'{{"kind": "mesh", "measures": []{files}}}', encoding="utf-8")
    report_of(tmp_path, "first")
    assert {path.name for path in tmp_path.iterdir()} == files_of("first")


def test_two_reports_are_not_written_into_one_folder_at_once(tmp_path: Path) -> None:
    with alone_in(tmp_path), pytest.raises(ValueError, match="another start is writing into it"):
        report_of(tmp_path, "first")
    assert not list(tmp_path.iterdir())


def test_names_that_are_alike_as_names_of_files_have_a_picture_each(tmp_path: Path) -> None:
    pixels = [np.full((2, 2, 3), grey, np.uint8) for grey in (1, 2, 3)]
    pictures = [
        save_picture(tmp_path, name, picture) for name, picture in zip(("a_b", "a b", "a:b"), pixels, strict=True)
    ]
    assert len(set(pictures)) == 3
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == dict(
        zip(("a_b.png", "a_b_2.png", "a_b_3.png"), pictures, strict=True)
    )


@pytest.mark.parametrize("name", ["report.json", "report.html", "measures.csv"])
def test_a_folder_with_files_that_no_evaluation_wrote_is_refused_before_anything_is_measured(
    tmp_path: Path, name: str
) -> None:
    theirs = {name: '{"files": ["data.csv"]}', "data.csv": "x,y,z\n"}
    for path, text in theirs.items():
        (tmp_path / path).write_text(text, encoding="utf-8")
    words = ["validate", "mesh", "absent.ply", "--truth", "absent.ply", "-o", str(tmp_path)]
    with pytest.raises(ValueError, match=f"holds {name} that no evaluation wrote"):
        CliRunner().invoke(app, words, catch_exceptions=False)
    with pytest.raises(ValueError, match="choose another folder"):
        report_of(tmp_path, "first")
    assert {path.name: path.read_text(encoding="utf-8") for path in tmp_path.iterdir()} == theirs


@pytest.mark.parametrize(
    ("values", "cells"),
    [
        ((220.0, 319.8123, -5.0), ("220.0", "319.8", "-5.0")),
        ((138.1623, 0.396), ("138.16", "0.40")),
        ((5.0, 7.5, 10.0), ("5.0", "7.5", "10.0")),
        ((0.02168, 0.0), ("0.02168", "0.00000")),
        ((5.181e-05, 3.7e-05), ("5.181e-05", "3.7e-05")),
        ((1e6, 2e-6), ("1e+06", "2e-06")),
        ((float("inf"), 3.25), ("inf", "3.25")),
    ],
)
def test_the_numbers_of_a_column_have_as_many_decimals_unless_they_differ_too_much(
    tmp_path: Path, values: tuple[float, ...], cells: tuple[str, ...]
) -> None:
    rows = [{"length_mm": value} for value in values]
    page = write_page(tmp_path / "report.html", "Lengths", [Section("Lengths", rows=rows)])
    assert tuple(re.findall(r"<td>(.*)</td>", page.read_text(encoding="utf-8"))) == cells


@pytest.mark.slow
def test_the_numbers_of_an_axis_do_not_overlap(tmp_path: Path) -> None:
    import altair as alt

    points = alt.Chart(alt.Data(values=[{"x": x} for x in (0.2264, 0.2368)])).mark_circle()
    axis = alt.X("x:Q", scale=alt.Scale(zero=False), axis=alt.Axis(tickCount=4, format=".4~r"))
    svg = write_figure(tmp_path / "points", points.encode(x=axis).properties(width=210))
    labels = re.findall(r'text-anchor="(\w+)" transform="translate\(([-\d.]+),15\)"[^>]*>([\d.]+)<', svg)
    assert len(labels) > 4
    edges = []
    for anchor, x, label in labels:
        width = 6.2 * len(label)  # pixels: digits of 10 px
        left = float(x) - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * width
        edges += [left, left + width]
    assert edges == sorted(edges), labels
