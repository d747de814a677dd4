"""Tables with more under their header than data: rows of options, of import ids and of units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from app.analysis.ratings.reading import understand_ratings
from app.analysis.reading.description import Told
from app.analysis.reading.read_votes import understand_votes
from app.analysis.reading.sources import Source, recognise_file
from app.analysis.reading.votes_table import VotesError

WHO = "Respondent ID,Collector ID,Start Date,End Date,IP Address,Email Address,First Name,Last Name,Custom Data 1"
PEOPLE = ("101,9,2024-01-01,2024-01-01,1.1.1.1,,,,", "102,9,2024-01-01,2024-01-01,1.1.1.2,,,,")


def source(folder: Path, text: str, **told: Any) -> Source:
    (folder / "table.csv").write_text(text, encoding="utf-8")
    return recognise_file(folder / "table.csv", Told(**told))


def survey(questions: str, options: str, *answers: str) -> str:
    """Return a table as SurveyMonkey exports it."""
    rows = [f"{person},{answer}" for person, answer in zip(PEOPLE, answers, strict=True)]
    return "\n".join([f"{WHO},{questions}", f",,,,,,,,,{options}", *rows, ""])


def test_pairs_of_surveymonkey_are_the_questions_or_the_options(tmp_path: Path) -> None:
    for questions, options in (
        ("Which is better? - red vs blue,red vs green", "Response,Response"),
        ("Which is better?,", "red vs blue,red vs green"),
    ):
        votes, said = understand_votes([source(tmp_path, survey(questions, options, "red,green", "blue,red"))])
        assert votes.participants == ("101", "102")
        assert sorted(votes.items) == ["blue", "green", "red"]
        assert votes.n_votes == 4
        assert "a table of surveymonkey" in said[0]


@pytest.mark.parametrize("answers", [("4,3,1", "5,2,3"), ("Good,Fair,Bad", "Excellent,Poor,Fair")])
def test_conditions_of_surveymonkey_are_the_options_of_its_question(tmp_path: Path, answers: tuple[str, str]) -> None:
    text = survey('"Rate, please:",,', "red,green,blue", *answers)
    ratings, said = understand_ratings(source(tmp_path, text))
    assert [condition for _, condition in ratings.items] == ["red", "green", "blue"]
    assert sorted(ratings.rating.tolist()) == [1, 2, 3, 3, 4, 5]
    assert "the row of options is left out" in said[0]


def test_options_of_several_questions_are_told_apart_by_these(tmp_path: Path) -> None:
    text = survey("Park: rate,,Sea: rate,", "red,green,red,green", "4,3,1,2", "5,2,3,2")
    ratings, _ = understand_ratings(source(tmp_path, text))
    names = ["Park: rate: red", "Park: rate: green", "Sea: rate: red", "Sea: rate: green"]
    assert [condition for _, condition in ratings.items] == names


def test_a_second_header_of_options_names_the_columns_that_the_first_leaves_without_a_name(tmp_path: Path) -> None:
    ratings, _ = understand_ratings(source(tmp_path, "participant,Rate:,,\n,red,green,blue\nA,4,3,1\nB,5,2,3\n"))
    assert [condition for _, condition in ratings.items] == ["red", "green", "blue"]


def test_the_same_pair_under_two_questions_is_warned_of(tmp_path: Path) -> None:
    text = survey("Park: which?,,Sea: which?", "red vs blue,red vs green,red vs blue", "red,red,red", "blue,red,red")
    _, said = understand_votes([source(tmp_path, text)])
    assert any("'Sea: which?: red vs blue' are the same pair and count together" in line for line in said)


UNITS = {
    "votes": "participant,item_a,item_b,choice,response_ms,length\n,,,,ms,s\nA,x,y,a,300,4\nB,x,y,b,400,5\n",
    "ratings": "participant,condition,rating,rt\n-,-,1-5,ms\nA,x,3,300\nA,y,4,400\n",
    "columns": "participant,x,y,rt\n,MOS,MOS,s\n1,3,4,3\n2,4,4,4\n",
}


@pytest.mark.parametrize("kind", UNITS)
def test_a_row_of_units_is_left_out_and_said(tmp_path: Path, kind: str) -> None:
    read = source(tmp_path, UNITS[kind])
    said = (understand_votes([read]) if read.holds_votes else understand_ratings(read))[1]
    assert len(read.table) == 2
    assert "row 1 is left out, as it names units (" in said[0]


@pytest.mark.parametrize(
    "text",
    [
        "participant,c1,c2\np,1,4?\nq,2,5\nr,2,3\n",  # somebody's
        "participant,item_a,item_b,choice,response_ms\nA,x,y,a,slow\nB,x,y,b,4\n",
        ",x,y\nx,,3\ny,4,\n",
    ],
)
def test_a_first_row_with_a_mistake_is_no_row_of_units(tmp_path: Path, text: str) -> None:
    read = source(tmp_path, text)
    assert len(read.table) == len(text.splitlines()) - 1


def test_a_row_of_labels_that_is_no_data_is_refused_with_what_to_do(tmp_path: Path) -> None:
    text = "participant,x,y\nWho,Picture x,Picture y\nA,3,4\nB,4,4\n"
    with pytest.raises(VotesError, match=r"row 1: the column 'x' is 'Picture x'.*\n.*delete row 1"):
        understand_ratings(source(tmp_path, text))
