"""Votes as other tools export them: what is understood, what is said about it, and what is refused."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from app.analysis import VotesError, analyse, analyse_file, analyse_ratings_file, read_votes, votes_from_rows
from app.analysis.ratings.reading import understand_ratings
from app.analysis.reading.description import Told
from app.analysis.reading.read_votes import understand_votes
from app.analysis.report.write import table_csv

VOTES = [
    {"participant": "p1", "dataset": "ball", "item_a": "x", "item_b": "y", "choice": "a"},
    {"participant": "p1", "dataset": "ball", "item_a": "x", "item_b": "z", "choice": "none"},
    {"participant": "p2", "dataset": "box", "item_a": "z", "item_b": "y", "choice": "b"},
]
COMMAS = pd.DataFrame(VOTES).to_csv(index=False)


def outcomes(path: Path, **options: Any) -> list[tuple[str, str, str, str]]:
    """Participant, the two items in alphabetical order, and the preferred one, of each vote."""
    votes = read_votes(path, **options)
    rows = []
    for person, a, b, choice, count in zip(
        votes.participant, votes.item_a, votes.item_b, votes.choice, votes.count, strict=True
    ):
        names = votes.items[a], votes.items[b]
        preferred = "" if choice == 2 else names[choice]
        rows += [(votes.participants[person], *sorted(names), preferred)] * count
    return sorted(rows)


WANTED = [("p1", "x", "y", "x"), ("p1", "x", "z", ""), ("p2", "y", "z", "y")]


def write(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(
    ("name", "content", "understood"),
    [
        ("votes.csv", COMMAS.replace(",", ";").encode("utf-8-sig"), "a byte-order mark, semicolons between cells"),
        ("votes.tsv", COMMAS.replace(",", "\t"), "tabs between cells"),
        ("votes.csv", COMMAS.replace(",", "|"), "bars between cells"),
        ("votes.csv.gz", gzip.compress(COMMAS.encode(), mtime=0), "commas between cells"),
        ("votes.jsonl", "\n".join(map(json.dumps, VOTES)) + "\n\n", "JSON, an object on each line"),
        ("VOTES.JSON", json.dumps(VOTES), "JSON"),
    ],
)
def test_a_format_is_understood_by_its_ending_and_content(
    tmp_path: Path, name: str, content: str | bytes, understood: str
) -> None:
    path = write(tmp_path, name, content)
    assert outcomes(path) == WANTED
    assert understood in understand_votes([path])[1][0]


def test_a_line_of_json_ends_at_the_end_of_the_line_alone(tmp_path: Path) -> None:
    """A pasted comment may hold U+2028, which JSON allows in a text as it is."""
    lines = [json.dumps({**vote, "reason": "pasted\u2028text"}, ensure_ascii=False) for vote in VOTES]
    assert outcomes(write(tmp_path, "votes.jsonl", "\r\n".join(lines))) == WANTED


def test_excel_is_read_from_its_first_sheet(tmp_path: Path) -> None:
    pytest.importorskip("openpyxl")
    with pd.ExcelWriter(tmp_path / "votes.xlsx") as book:
        pd.DataFrame(VOTES).to_excel(book, sheet_name="Votes", index=False)
        pd.DataFrame([{"a": 1}]).to_excel(book, sheet_name="Notes", index=False)
    assert outcomes(tmp_path / "votes.xlsx") == WANTED
    assert "Excel, sheet Votes, the first of 2" in understand_votes([tmp_path / "votes.xlsx"])[1][0]
    with pytest.raises(VotesError, match="not readable as Excel"):
        read_votes(write(tmp_path, "other.xlsx", b"PK\x03\x04nonsense"))


@pytest.mark.parametrize(
    ("content", "note"),
    [
        ("Subject,Scene,left,right,winner\np1,d,x,y,left\np1,d,x,z,tie\np2,e,z,y,right\n", "right for item_b, tie"),
        ("worker_id,src,model_a,model_b,winner\np1,d,x,y,model_a\np1,d,x,z,Tie\np2,e,z,y,model_b\n", "model_a for"),
        ("user,scene,A,B,preferred\np1,d,x,y,x\np1,d,x,z,no preference\np2,e,z,y,y\n", "name of the preferred"),
        ("judge,scene,item1,item2,choice\np1,ball,x,y,1\np2,box,z,y,2\n", "1 for item_a and 2 for item_b"),
        ("participant,winner,loser\np1,x,y\np2,y,z\n", "item_a is always preferred"),
        ("participant,dataset,x vs y,x vs. z,z - y\np1,ball,x,tie,\np2,box,,,y\n", "a column for each of 3 pairs"),
    ],
)  # fmt: skip
def test_names_and_words_of_real_exports_are_recognised_and_said(tmp_path: Path, content: str, note: str) -> None:
    path = write(tmp_path, "votes.csv", content)
    assert outcomes(path) == [row for row in WANTED if row[3] or "tie" in content.lower() or "no pref" in content]
    assert note in understand_votes([path])[1][0]


def test_columns_that_may_name_the_dataset_are_said_not_to_be_used(tmp_path: Path) -> None:
    path = write(tmp_path, "votes.csv", "worker,stimulus,type_a,type_b,choice\np1,d,x,y,a\np1,e,x,y,b\n")
    items = {"item_a": "type_a", "item_b": "type_b"}
    assert "all votes are on one dataset; not used: stimulus" in understand_votes([path], Told(items))[1][0]
    assert "not used" not in understand_votes([path], Told(items | {"dataset": "stimulus"}))[1][0]


def test_a_wide_table_may_have_columns_that_say_nothing_about_votes(tmp_path: Path) -> None:
    form = "Timestamp,Name,x vs y,y vs z\n12:00,p1,x,same\n12:05,p2,,y\n"
    path = write(tmp_path, "form.csv", form)
    with pytest.raises(VotesError, match=r"a column for each of 2 pairs.*Timestamp, Name.*--columns participant="):
        read_votes(path)
    assert outcomes(path, columns={"participant": "Name"}) == [("p1", "x", "y", "x"), ("p1", "y", "z", ""), WANTED[2]]
    sentence = understand_votes([path], Told({"participant": "Name"}))[1][0]
    assert "2 rows, 3 votes" in sentence
    assert "not used: Timestamp" in sentence
    assert outcomes(write(tmp_path, "user.csv", form.replace("Name", "User ID")))[2] == WANTED[2]


def test_a_word_for_no_preference_may_be_told_beside_names_of_items(tmp_path: Path) -> None:
    path = write(tmp_path, "v.csv", "participant,x vs y,x vs z,z vs y\np1,x,Egal,\np2,,,y\n")
    assert outcomes(path, choices={"none": "Egal"}) == WANTED


def test_words_that_mean_a_missing_value_elsewhere_are_words_in_excel(tmp_path: Path) -> None:
    pytest.importorskip("openpyxl")
    rows = [("NA", "ball", "null", "n/a", "None"), ("nan", "ball", "null", "n/a", "a"), (None,) * 5]
    frame = pd.DataFrame(rows, columns=["participant", "dataset", "item_a", "item_b", "choice"])
    frame.to_excel(tmp_path / "votes.xlsx", index=False)
    votes = read_votes(tmp_path / "votes.xlsx")
    assert (votes.participants, votes.items, votes.choice.tolist()) == (("NA", "nan"), ("null", "n/a"), [2, 0])


def test_a_matrix_of_win_counts_becomes_votes(tmp_path: Path) -> None:
    path = write(tmp_path, "wins.csv", ";x;y;z\nx;;3;1\ny;2;0;0\nz;0;4;\n")
    votes, (sentence, *_) = understand_votes([path])
    assert votes.n_votes == 10
    assert [row[3] for row in outcomes(path)].count("x") == 4
    assert "a matrix of win counts of 3 items" in sentence
    with pytest.raises(VotesError, match="row 2: the column 'x' is '0,5', expected a whole number of wins"):
        read_votes(write(tmp_path, "shares.csv", ";x;y\nx;;0,5\ny;0,5;\n"))


def test_decimal_commas_are_numbers_and_thousands_are_not_guessed(tmp_path: Path) -> None:
    text = "participant;dataset;item_a;item_b;choice;response_ms\np1;d;x;y;a;{}\n"
    assert read_votes(write(tmp_path, "a.csv", text.format("812,5"))).response_ms.tolist() == [812.5]
    with pytest.raises(VotesError, match="row 1: response_ms is '1,234', expected a number"):
        read_votes(write(tmp_path, "b.csv", text.format("1,234")))


def test_an_item_in_two_columns_is_joined(tmp_path: Path) -> None:
    path = write(tmp_path, "v.csv", "participant,type_a,level_a,type_b,level_b,choice\np1,jpeg,10,avif,10,b\n")
    columns = {"item_a": "type_a+level_a", "item_b": "type_b + level_b"}
    assert outcomes(path, columns=columns) == [("p1", "avif 10", "jpeg 10", "avif 10")]
    with pytest.raises(VotesError, match=r"lacks the column type_a\+grade"):
        read_votes(path, columns | {"item_a": "type_a+grade"})


def test_several_files_are_one_table(tmp_path: Path) -> None:
    first = write(tmp_path, "a.csv", COMMAS)
    second = write(tmp_path, "b.tsv", "participant\tdataset\titem_a\titem_b\tchoice\np1\tball\tw\tX\tb\n")
    votes, sentences = understand_votes([first, second])
    assert votes.n_votes == 4
    assert set(votes.items) == {"w", "x", "X", "y", "z"}
    assert "'x' and 'X' look alike and are counted as 2 items" in sentences
    assert "p1 is in several files and counted as the same people" in sentences
    nameless = write(tmp_path, "c.csv", "item_a,item_b,choice\nx,y,a\n")
    with pytest.raises(VotesError, match="some of the 2 files name participants and others do not"):
        understand_votes([first, nameless])


def test_a_name_whose_accents_are_written_in_two_ways_is_said_to_look_alike(tmp_path: Path) -> None:
    """macOS writes accents of the names of files as signs of their own; elsewhere they are part of the letter."""
    path = write(tmp_path, "v.csv", "item_a,item_b,choice\n\u00e9,y,a\ne\u0301,y,b\n")
    assert "'\u00e9' and 'e\u0301' look alike and are counted as 2 items" in understand_votes([path])[1]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("votes.csv", b"\x89PNG\r\n\x1a\n\x00\x01", "is a picture, expected a table of text"),
        ("votes.csv", b"PK\x03\x04\x14\x00", "is a zip or Excel file"),
        ("votes.csv", bytes(range(128, 256)) + b"\x01\x02", "is no text"),
        ("votes.csv.gz", b"no gzip", "not readable as gzip"),
        ("votes.jsonl", b'{"participant": "p"}\n{oops\n', "line 2 is not readable as JSON"),
        ("votes.csv", b"participant,item_a,item_b,choice\np1,x,y,3\n", "row 1: choice is '3', expected a, b, none"),
        ("votes.csv", b"participant,item_a,item_b,choice\np1,x,y,\x1b[2J\x07\n", "row 1: choice is '�.2J�', expected"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_without_printing_it(
    tmp_path: Path, name: str, content: bytes, message: str
) -> None:
    with pytest.raises(VotesError, match=message) as refused:
        read_votes(write(tmp_path, name, content))
    assert str(refused.value).isprintable()


@pytest.mark.slow
def test_a_notebook_passes_what_it_has(tmp_path: Path) -> None:
    frame = pd.DataFrame(VOTES, index=[5, 6, 7])
    assert votes_from_rows(frame).n_votes == 3
    assert analyse(frame)["votes"] == analyse(VOTES)["votes"]
    assert read_votes(str(write(tmp_path, "x.csv", COMMAS))).n_votes == 3
    with pytest.raises(VotesError, match="str is no table of votes, expected rows with named values or a DataFrame"):
        votes_from_rows("votes.csv")  # type: ignore[arg-type]  # what a newcomer tries


@pytest.mark.slow
def test_files_may_be_named_by_text(tmp_path: Path) -> None:
    votes, out = str(write(tmp_path, "votes.csv", COMMAS)), str(tmp_path / "out")
    items = str(write(tmp_path, "items.csv", "item,depth\nx,id\ny,pm\nz,dr\n"))
    people = str(write(tmp_path, "people.csv", "participant,age\np1,old\np2,young\n"))
    measures = str(write(tmp_path, "measures.csv", "dataset,item,psnr\nball,x,30\nball,y,31\n"))
    ratings = str(write(tmp_path, "ratings.csv", "participant,dataset,condition,rating\np1,ball,x,3\np2,ball,y,4\n"))
    beside = {"items": items, "participants": people, "measures": measures, "ratings": ratings}
    assert analyse_file(votes, out, **beside)["votes"]["analysed"] == 3
    assert analyse_file([votes], out)["votes"]["analysed"] == 3
    assert analyse_ratings_file(ratings, out, measures=measures)["rating_items"]
    assert len(understand_ratings(ratings)[0]) == 2
    assert (tmp_path / "out" / "analysis.json").is_file()


@pytest.mark.slow
def test_a_second_analysis_leaves_nothing_of_the_first_in_its_folder(tmp_path: Path) -> None:
    factors = write(tmp_path, "items.csv", "item,depth\nx,id\ny,pm\nz,dr\n")
    votes, out = write(tmp_path, "votes.csv", COMMAS), tmp_path / "out"
    analyse_file(votes, out, items=factors)
    (out / "figures" / "mine.png").write_bytes(b"mine")
    (out / "notes.csv").write_text("mine", encoding="utf-8")
    analyse_file(votes, tmp_path / "alone")
    analyse_file(votes, out)
    expected = {path.relative_to(tmp_path / "alone") for path in (tmp_path / "alone").rglob("*")}
    more = {path.relative_to(out) for path in out.rglob("*")} - expected
    assert more == {Path("figures/mine.png"), Path("notes.csv")}


def test_results_never_replace_a_file_that_they_follow_from(tmp_path: Path) -> None:
    pairs = write(tmp_path, "pairs.csv", COMMAS)
    with pytest.raises(VotesError, match=r"pairs.csv: a table of the results would replace it; choose another folder"):
        analyse_file(pairs, tmp_path)
    votes = write(tmp_path, "votes.csv", COMMAS)
    measures = write(tmp_path, "measures.csv", "dataset,item,psnr\nball,x,30\nball,y,31\n")
    with pytest.raises(VotesError, match=r"measures.csv: a table of the results would replace it"):
        analyse_file(votes, tmp_path, measures=measures)
    assert {path.name for path in tmp_path.iterdir()} == {"pairs.csv", "votes.csv", "measures.csv"}


def test_a_folder_in_place_of_votes_is_named_as_one(tmp_path: Path) -> None:
    with pytest.raises(VotesError, match=r"is a folder, expected a file: .*csv"):
        read_votes(tmp_path)


def test_nothing_that_counts_is_an_error_and_nothing_is_written(tmp_path: Path) -> None:
    path = write(tmp_path, "practice.csv", pd.DataFrame(VOTES).assign(practice=1).to_csv(index=False))
    with pytest.raises(VotesError, match=r"practice.csv: none of 3 votes counts: 3 practice, 0 checks"):
        analyse_file(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    single = write(tmp_path, "single.csv", pd.DataFrame(VOTES[:1]).assign(practice=1).to_csv(index=False))
    with pytest.raises(VotesError, match=r"none of 1 vote counts: 1 practice, 0 checks"):
        analyse_file(single, tmp_path / "out")


def test_formulas_are_disarmed_in_tables_and_read_back_as_they_were(tmp_path: Path) -> None:
    text = table_csv([{"item_a": "=cmd|' /C calc'!A0", "item_b": "-3 dB", "score": -1.5}], ("item_a", "item_b"))
    assert text.splitlines()[1] == "'=cmd|' /C calc'!A0,'-3 dB,-1.5"
    for mark in "=+-@\t\r\n＝＋－＠":
        assert table_csv([{"item_a": f"{mark}1"}], ()).partition("item_a\n")[2].lstrip('"').startswith(f"'{mark}1")
    path = write(tmp_path, "v.csv", "participant,dataset,item_a,item_b,choice\np,d,'=cmd,'-3 dB,a\n")
    assert read_votes(path).items == ("=cmd", "-3 dB")


def test_sides_are_said_to_be_meant_where_items_are_named_like_them(tmp_path: Path) -> None:
    header = "participant,dataset,item_a,item_b,choice\n"
    sides = "choice a is item_a and b is item_b, although items are named a and b, too"
    for rows, is_said in (
        ("p1,d,a,b,a\np1,d,b,a,a\n", True),
        ("p1,d,a,b,a\np1,d,b,a,none\n", False),  # both readings say the same
        ("p1,d,b,a,a\np1,d,x,y,a\n", False),  # no names: a is none of x and y
    ):
        path = write(tmp_path, "votes.csv", header + rows)
        assert any(sides in sentence for sentence in understand_votes([path])[1]) == is_said
