"""The long table of measures: what is read, averaged, left out and refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.analysis.reading import measures_table
from app.analysis.reading.measures_table import MeasuresTable, is_long, measures_from_columns, read_measures_table
from app.analysis.reading.votes_table import VotesError

HEADER = "dataset,approach,frame,measure,direction,value,unit,better,source"
ANYBODYS = "dataset,approach,measure,value,better"


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return tmp_path / "measures.csv"


def read(path: Path, *rows: str, header: str = HEADER) -> MeasuresTable:
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return read_measures_table(path)


def values(read_table: MeasuresTable) -> dict[tuple[str, str, str], float]:
    return {(value.dataset, value.approach, value.measure): value.value for value in read_table.values}


def test_only_five_columns_are_needed(table: Path) -> None:
    read_table = read(table, "ball, pm_fb, psnr, 30.5, higher", header=ANYBODYS)
    assert [(v.measure, v.value, v.better, v.unit, v.source) for v in read_table.values] == [
        ("psnr", 30.5, "higher", "", "")
    ]
    assert not read_table.notes


def test_a_table_of_a_spreadsheet_may_have_semicolons_and_decimal_commas(table: Path) -> None:
    read_table = read(table, "ball;pm_fb;psnr;30,5;higher", header=ANYBODYS.replace(",", ";"))
    assert values(read_table) == {("ball", "pm_fb", "psnr"): 30.5}


def test_the_long_table_is_told_from_the_wide_one() -> None:
    assert is_long(ANYBODYS.split(","))
    assert not is_long(["dataset", "item", "psnr"])


def test_a_value_of_the_whole_sequence_stands_before_those_of_frames(table: Path) -> None:
    rows = ("ball,a,0,ssim,,0.5,,higher,", "ball,a,,ssim,,0.9,,higher,us", "ball,b,all,ssim,,0.8,,higher,us")
    read_table = read(table, *rows)
    assert values(read_table) == {("ball", "a", "ssim"): 0.9, ("ball", "b", "ssim"): 0.8}
    assert not read_table.notes


def test_values_of_frames_alone_become_their_mean_which_a_note_tells(table: Path) -> None:
    rows = [f"ball,a,{frame},d1_mse,symmetric,{value},mm²,lower,us" for frame, value in enumerate((1, 2, 6))]
    read_table = read(table, *rows)
    assert values(read_table) == {("ball", "a", "d1_mse"): 3.0}
    assert read_table.values[0].unit == "mm²"
    assert read_table.notes == ("d1_mse is the mean of 3 frames",)
    fewer = read(table, *rows, "ball,b,0,d1_mse,symmetric,1,mm²,lower,us")
    assert fewer.notes == ("d1_mse is the mean of 1 to 3 frames; not all approaches have equally many",)


def test_a_direction_becomes_part_of_the_name_unless_it_is_symmetric(table: Path) -> None:
    read_table = read(
        table,
        "ball,a,,d1_mse,symmetric,3,,lower,",
        "ball,a,,d1_mse,reference_to_distorted,2,,lower,",
        "ball,a,,d1_mse,distorted_to_reference,4,,lower,",
    )
    assert {name for _, _, name in values(read_table)} == {
        "d1_mse",
        "d1_mse (reference to distorted)",
        "d1_mse (distorted to reference)",
    }


def test_a_study_s_own_table_of_measures_can_be_read_again(table: Path) -> None:
    header = "dataset,approach,measure,value,direction,unit,better,source,attached_at"
    read_table = read(table, "ball,a,psnr,30,more is better,dB,higher,,2026-03-02T09:00:00+00:00", header=header)
    assert values(read_table) == {("ball", "a", "psnr"): 30.0}


def test_a_table_without_rows_has_no_values(table: Path) -> None:
    assert read(table) == MeasuresTable(())


def test_values_that_are_not_finite_are_left_out_and_named(table: Path) -> None:
    read_table = read(
        table,
        "ball,a,,psnr,,inf,dB,higher,",
        "ball,b,,psnr,,40,dB,higher,",
        "ball,c,,psnr,,nan,dB,higher,",
        "box,a,0,psnr,,inf,dB,higher,",
        "box,a,1,psnr,,30,dB,higher,",
        "box,b,,psnr,,,dB,higher,",
    )
    assert values(read_table) == {("ball", "b", "psnr"): 40.0, ("box", "a", "psnr"): 30.0}
    assert read_table.notes == (
        "psnr is the mean of 1 frame",
        "psnr leaves out what has no finite value: ball/a (+inf), ball/c (not a number), box/a frame 0 (+inf), "
        "box/b (not a number)",
    )


@pytest.mark.parametrize(
    ("rows", "fault"),
    [
        (["b,a,,m,,good,,lower,"], "row 1: value is 'good', expected a number"),
        (["b,a,,m,,1,,less,"], "row 1: better is 'less', expected higher or lower"),
        (["b,a,first,m,,1,,lower,"], "row 1: frame is 'first', expected a whole number"),
        (["b,a,,m,both,1,,lower,"], "row 1: direction is 'both', expected symmetric, reference_to_distorted"),
        (["b,a,,m,,1,,lower,", "b,,,m,,1,,lower,"], "row 2: approach is empty"),
        (["b,a,,m,,1,,lower,", f"b,{'x' * 201},,m,,1,,lower,"], "row 2: approach has 201 characters, expected 200"),
        (["b,a,,m,,1,,lower,", "b,c,,m,,1,,lower,", "b,a,,m,,2,,lower,"], "row 3: m of b/a is 2, row 1 has it .* 1;"),
        (["b,a,,m,,1,,lower,", "b,a,,m,symmetric,1,,lower,"], "row 2: m of b/a is 1, row 1 has it already"),
        (["b,a,7,m,,1,,lower,", "b,a,07,m,,1,,lower,"], "row 2: m of b/a in frame 7 is 1, row 1 has it already"),
        (["b,a,,m,,1,,lower,", "b,c,,m,,1,,higher,"], "row 2: better of m is 'higher', row 1 says 'lower'"),
        (["b,a,,m,,1,mm,lower,", "b,c,,m,,1,m,lower,"], "row 2: unit of m is 'm', row 1 says 'mm'"),
        (["b,a,,m,,1,,lower,,surplus"], "not a table of equally long rows"),
        (["b,a,,m,more is better,1,,lower,"], "row 1: direction is 'more is better', expected symmetric"),
    ],
)
def test_a_row_that_cannot_be_used_is_named(table: Path, rows: list[str], fault: str) -> None:
    with pytest.raises(VotesError, match=f"measures.csv: .*{fault}"):
        read(table, *rows)


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        (b"", "is empty"),
        (b"dataset,approach,measure,value\nb,a,m,1\n", "without better; .*higher or lower, for each measure"),
        (
            b"dataset,item,psnr\nb,a,1\n",
            "has the columns dataset, item, psnr, without approach, measure, value, better",
        ),
        (ANYBODYS.encode() + b",value\nb,a,m,1,lower,2\n", "has 2 columns named 'value', expected one"),
        (ANYBODYS.encode() + b"\nb\xe4r,a,m,1,lower\n", "row 1: .* is not UTF-8"),
        (b"\xe4" * 900, "row 0: 'ä{80}…' is not UTF-8"),
    ],
)
def test_a_file_that_is_no_such_table_is_refused(table: Path, content: bytes, fault: str) -> None:
    table.write_bytes(content)
    with pytest.raises(VotesError, match=f"measures.csv: .*{fault}"):
        read_measures_table(table)


def test_a_file_that_is_too_large_or_missing_is_refused(table: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(VotesError, match="there is no such file"):
        read_measures_table(table)
    monkeypatch.setattr(measures_table, "LARGEST_TABLE", 10)
    with pytest.raises(VotesError, match="MB at most"):
        read(table, "b,a,,m,,1,,lower,")


def test_columns_may_come_from_elsewhere_than_a_file() -> None:
    columns = {
        "dataset": ["b"],
        "approach": ["a"],
        "measure": ["m"],
        "value": ["1"],
        "better": ["lower"],
        "note": ["x"],
    }
    assert values(measures_from_columns(columns)) == {("b", "a", "m"): 1.0}
