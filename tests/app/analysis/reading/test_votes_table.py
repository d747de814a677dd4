"""What is accepted as a votes table, and how everything else is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.analysis import analyse
from app.analysis.reading.attributes import read_items, read_measures
from app.analysis.reading.read_votes import read_votes, votes_from_rows
from app.analysis.reading.votes_table import VotesError, bounds_of, numbered, order_of
from tests.app.analysis.votes_data_frame import frame_from_votes

HEADER = "participant,dataset,item_a,item_b,choice"


def write(folder: Path, text: str | bytes, name: str = "votes.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def row(**changes: object) -> dict[str, object]:
    return {"participant": "p1", "dataset": "ball", "item_a": "x", "item_b": "y", "choice": "a"} | changes


def test_names_become_indices_in_order_of_appearance() -> None:
    votes = votes_from_rows([row(), row(participant="p2", item_a="z", choice="none"), row(dataset="box", choice="b")])
    assert votes.participants == ("p1", "p2")
    assert votes.datasets == ("ball", "box")
    assert set(votes.items) == {"x", "y", "z"}
    assert votes.choice.tolist() == [0, 2, 1]
    assert votes.n_votes == 3


def test_first_shown_is_the_name_of_an_item() -> None:
    votes = votes_from_rows([row(first_shown="x"), row(first_shown="y"), row(first_shown="")])
    assert votes.first_shown.tolist() == [0, 1, -1]


def test_practice_and_excluded_votes_stay_in_the_table_and_out_of_the_analysis() -> None:
    votes = votes_from_rows([row(), row(practice=True), row(excluded="true", reason="colour vision")])
    assert len(votes) == 3
    assert len(votes.used()) == 1
    assert votes.reason.tolist() == ["", "", "colour vision"]


def test_rows_that_stand_for_no_vote_are_as_if_they_were_not_there() -> None:
    votes = [row(), row(choice="b"), row(participant="p2"), row(participant="p3")]
    none = [row(choice="none"), row(item_b="z"), row(participant="p4")]  # as in a table of counts
    table = votes_from_rows([vote | {"count": 1} for vote in votes] + [vote | {"count": 0} for vote in none])
    found, expected = analyse(table), analyse(votes_from_rows(votes))
    assert found["scores"] == expected["scores"]
    assert (found["models"], found["warnings"]) == (expected["models"], expected["warnings"])


@pytest.mark.parametrize("suffix", ["csv", "parquet", "json"])
def test_every_format_gives_the_same_table(tmp_path: Path, suffix: str) -> None:
    rows = [
        row(count=2, response_ms=812.5, first_shown="y"),
        row(participant="ü", choice="none", count=1, first_shown="x"),
    ]
    frame = pd.DataFrame(rows)
    path = tmp_path / f"votes.{suffix}"
    {"csv": lambda: frame.to_csv(path, index=False), "parquet": lambda: frame.to_parquet(path)}.get(
        suffix, lambda: frame.to_json(path, orient="records")
    )()
    pd.testing.assert_frame_equal(frame_from_votes(read_votes(path)), frame_from_votes(votes_from_rows(rows)))


def test_other_names_of_columns_and_choices_are_mapped(tmp_path: Path) -> None:
    path = write(tmp_path, "wer,dataset,item_a,item_b,choice\np1,ball,x,y,gleich\n")
    votes = read_votes(path, {"participant": "wer"}, {"none": "gleich"})
    assert votes.participants == ("p1",)
    assert votes.choice.tolist() == [2]


def test_known_layouts_are_recognised_by_their_columns(tmp_path: Path) -> None:
    judge = write(tmp_path, "judge,dataset,item_a,item_b,choice,count\n,,x,y,tie,4\n")
    votes = read_votes(judge)
    assert votes.choice.tolist() == [2]
    assert not votes.has_participants
    assert votes.n_votes == 4
    pwcmp = write(tmp_path, "observer,scene,condition_A,condition_B,is_A_selected\no,s,x,y,0\n", "pwcmp.csv")
    assert read_votes(pwcmp).choice.tolist() == [1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"choice": "maybe"}, "row 2: choice is 'maybe', expected a, b, none"),
        ({"item_b": "x"}, "row 2: the item 'x' is compared with itself"),
        ({"item_a": ""}, "row 2: item_a is empty"),
        ({"item_b": None}, "row 2: item_b is missing"),
        ({"participant": ""}, "row 2: participant is empty"),
        ({"count": "many"}, "row 2: count is 'many', expected a whole number"),
        ({"count": "1.5"}, "row 2: count is '1.5'"),
        ({"count": "-1"}, "row 2: count is '-1'"),
        ({"count": "inf"}, "row 2: count is 'inf'"),
        ({"count": "1e30"}, "row 2: count is '1e30', expected a whole number, 0 to 1000000000000"),
        ({"response_ms": "fast"}, "row 2: response_ms is 'fast'"),
        ({"practice": "perhaps"}, "row 2: practice is 'perhaps'"),
        ({"first_shown": "q"}, "row 2: first_shown is 'q', expected 'x' or 'y'"),
    ],
)
def test_a_bad_value_is_refused_with_its_row_and_itself(changes: dict[str, object], message: str) -> None:
    good = row(count="1", response_ms="10", practice="0", first_shown="x")
    with pytest.raises(VotesError, match="^" + message.replace("(", r"\(")):
        votes_from_rows([good, good | changes])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty"),
        (HEADER + "\n", "has no row"),
        ("participant,dataset,item_a,item_b\np,d,x,y\n", "lacks the column choice; found participant"),
        (HEADER + "\np,d,x,y,a\np,d,x,y,a,extra\n", "equally long"),
        (HEADER + "\np,d,x,y,a\np,d,x\n", "row 2: item_b is empty"),
        (HEADER.encode() + b"\np,d,x,y,a\np\0r,d,x,y,a\n", "row 2 holds a NUL character"),
        (HEADER.encode() + b"\np,d,x,y,a\np\xe4r,d,x,y,a\n", "row 2: 'pär,d,x,y,a' is not UTF-8"),
        (b"\x1d\x93\x00\xffPK\x07,\n", "is no text .byte 2 is 0x93.; expected a table: CSV in UTF-8"),
    ],
)
def test_a_file_that_is_no_table_is_refused(tmp_path: Path, content: str | bytes, message: str) -> None:
    with pytest.raises(VotesError, match=message):
        read_votes(write(tmp_path, content))


def test_a_missing_file_an_unknown_ending_and_a_wrong_mapping_are_named(tmp_path: Path) -> None:
    with pytest.raises(VotesError, match="there is no such file"):
        read_votes(tmp_path / "none.csv")
    with pytest.raises(VotesError, match=r"ends in '[.]xls'"):
        read_votes(tmp_path / "votes.xls")
    with pytest.raises(VotesError, match="lacks the column who"):
        read_votes(write(tmp_path, HEADER + "\np,d,x,y,a\n"), {"participant": "who"})
    with pytest.raises(VotesError, match="'who' is no column"):
        read_votes(write(tmp_path, HEADER + "\np,d,x,y,a\n"), {"who": "participant"})


@pytest.mark.parametrize("content", ["[1]", "{}", "nonsense", '[{"participant": 1}]'])
def test_json_that_is_no_list_of_votes_is_refused(tmp_path: Path, content: str) -> None:
    with pytest.raises(VotesError):
        read_votes(write(tmp_path, content, "votes.json"))


def test_damaged_parquet_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VotesError, match="not readable as Parquet"):
        read_votes(write(tmp_path, b"PAR1nonsense", "votes.parquet"))


def test_utf_16_and_a_byte_order_mark_are_understood(tmp_path: Path) -> None:
    text = HEADER + "\npär,d,x,y,a\n"
    for content in (text.encode("utf-16"), text.encode("utf-8-sig")):
        assert read_votes(write(tmp_path, content)).participants == ("pär",)


def test_items_and_their_factors_are_read(tmp_path: Path) -> None:
    path = write(tmp_path, "item,depth,fusion\nx,id,fa\ny,pm,fa\n")
    assert read_items(path) == {"depth": {"x": "id", "y": "pm"}, "fusion": {"x": "fa", "y": "fa"}}


def test_an_empty_cell_of_an_items_file_is_no_level(tmp_path: Path) -> None:
    path = write(tmp_path, "item,depth,fusion\nx,id,fa\nneus,,\n")
    assert read_items(path) == {"depth": {"x": "id"}, "fusion": {"x": "fa"}}


@pytest.mark.parametrize("text", ["item\nx\n", "depth\nid\n", "item,depth\nx,id\nx,pm\n", "item,depth\n,id\n"])
def test_an_items_file_that_says_too_little_or_twice_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(VotesError):
        read_items(write(tmp_path, text))


def test_rows_of_the_tables_beside_votes_are_counted_as_in_the_file(tmp_path: Path) -> None:
    with pytest.raises(VotesError, match="row 4: the item 'x' appears a second time"):
        read_items(write(tmp_path, "item,depth\nx,id\n\ny,pm\nx,pm\n"))
    table = "dataset,approach,measure,value,better\nd,x,psnr,2,higher\n\nd,x,psnr,3,higher\n"
    with pytest.raises(VotesError, match="row 3: psnr of d/x is 3, row 1 has it already"):
        read_measures(write(tmp_path, table))


@pytest.mark.filterwarnings("default")
def test_a_cell_beyond_the_header_is_named_and_not_dropped(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    assert read_items(write(tmp_path, "item,depth\nx,id,\ny,pm,\n")) == {"depth": {"x": "id", "y": "pm"}}
    with pytest.raises(VotesError, match="row 2 has more cells than the header's 2"):
        read_items(write(tmp_path, "item,depth\nx,id,\ny,pm,half\n"))
    assert not recwarn.list


def test_columns_are_small_integers() -> None:
    votes = votes_from_rows([row()] * 10)
    assert votes.item_a.dtype == np.int32
    assert votes.choice.dtype == np.int8


@given(st.lists(st.integers(0, 9), min_size=1), st.sampled_from((10, 100_000)))
def test_codes_are_numbered_and_ordered_as_by_sorting(codes: list[int], size: int) -> None:
    column = np.array(codes, np.int32)
    present, place = numbered(column, size)
    expected = np.unique(column, return_inverse=True)
    assert (present.tolist(), place.tolist()) == tuple(part.tolist() for part in expected)
    order = order_of(column, size)
    assert order.tolist() == sorted(range(len(codes)), key=codes.__getitem__)
    bounds = bounds_of(column[order])
    assert [int(column[order][start]) for start in bounds[:-1]] == present.tolist()
    assert bounds[-1] == len(codes)
