"""Tables with a trap: a reading of them is right, or the trap is asked about or warned of."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.analysis.ratings.reading import understand_ratings
from app.analysis.ratings.table import RatingTable
from app.analysis.reading.description import QuestionError, Told
from app.analysis.reading.read_votes import understand_votes
from app.analysis.reading.sources import WARNING, recognise_file
from app.analysis.reading.votes_table import VotesError

VOTED = "participant,item_a,item_b,choice"


def write(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


ASKED = {
    "order of presentation": f"{VOTED},order\np,x,y,first,AB\nq,x,y,first,BA\n",
    "what was shown first": f"{VOTED},first_shown\np,x,y,first,x\nq,x,y,first,y\n",
    "side of an item": f"{VOTED},position_a\np,x,y,left,left\nq,x,y,left,right\n",
    "is on the left": f"{VOTED},a_on_left\np,x,y,left,1\nq,x,y,left,0\n",
    "place of a numbered option": "participant,option_1,option_2,selected,option_1_pos\np,x,y,1,2\nq,x,y,2,1\n",
    "ABX": "subject,A,B,X,answer\np,x,y,x,A\nq,x,y,y,A\n",
    "points of a game": "user,player1,player2,score\np,x,y,1\nq,x,y,0\nr,x,y,0.5\n",
    "a number about people": "participant,low,mid,high,SSQ total\np,1,2,3,4\nq,2,2,4,3\n",
    "a count beside each rating": "participant,x,y,x_loads,y_loads\np,1,2,3,4\nq,2,2,4,3\n",
    "means among whole numbers": "condition,Ann,Bob,Cy,Ø\nx,1,2,3,2\ny,2,2,3,2.33\n",
}


@pytest.mark.parametrize("trap", ASKED)
def test_what_may_mean_something_else_is_asked_and_each_answer_is_taken(tmp_path: Path, trap: str) -> None:
    path = write(tmp_path, ASKED[trap])
    with pytest.raises(QuestionError) as asked:
        recognise_file(path)
    for reading in asked.value.readings:
        source = recognise_file(path, reading.told)
        assert understand_votes([source]) if source.holds_votes else understand_ratings(source)


WARNED = {
    "right answers": (f"{VOTED},correct_answer\np,x,y,a,b\n", "'correct_answer' is not used"),
    "rows that are kept": (f"{VOTED},include\np,x,y,a,0\n", "'include' is not used"),
    "rows that were deleted": (f"{VOTED},deleted\np,x,y,a,1\n", "'deleted' is not used"),
    "state of a person": (f"{VOTED},status\np,x,y,a,RETURNED\n", "'status' is not used"),
    "a second factor": (
        "participant,method,level,rating\np,x,low,3\np,x,high,4\nq,x,low,2\nq,x,high,2\n",
        "--columns dataset=level keeps them apart",
    ),
    "a scene by another name": (f"{VOTED},shot\np,x,y,a,u\np,x,y,a,v\n", "--columns dataset=shot keeps them apart"),
    "people of two labs": (
        f"{VOTED},lab\np,x,y,a,u\np,x,y,b,v\n",
        "--columns participant=participant+lab takes them for other people's",
    ),
    "a scale from 1": ("participant,item_a,item_b,rating\np,x,y,1\nq,x,y,3\n", "if the scale begins at 1"),
    "counted ratings": ("participant,condition,rating,count\np,x,3,2\nq,x,4,1\n", "each row is one rating"),
    "a row of means": ("participant,x,y\np,1,2\nq,2,2\nr,4,5\nPanel,2.33,3\n", "row 4 is not used: 'Panel' is nobody"),
}  # fmt: skip


@pytest.mark.parametrize("trap", WARNED)
def test_what_is_left_out_and_may_matter_is_warned_of(tmp_path: Path, trap: str) -> None:
    text, warning = WARNED[trap]
    source = recognise_file(write(tmp_path, text))
    said = understand_votes([source])[1] if source.holds_votes else understand_ratings(source)[1]
    assert any(line.startswith(WARNING) and warning in line for line in said), said


def test_a_column_of_ties_makes_rows_of_no_preference(tmp_path: Path) -> None:
    for text in (f"{VOTED},is_tie\np,x,y,a,0\nq,x,y,b,1\n", "judge,winner,loser,draw\np,x,y,0\nq,x,y,1\n"):
        votes, said = understand_votes([recognise_file(write(tmp_path, text))])
        assert votes.choice.tolist() == [0, 2]
        assert "is true are no preference" in said[0]


def test_totals_of_a_matrix_are_no_item(tmp_path: Path) -> None:
    votes, _ = understand_votes([recognise_file(write(tmp_path, ",x,y,Total\nx,,3,3\ny,4,,4\nTotal,4,3,7\n"))])
    assert (votes.items, votes.n_votes) == (("y", "x"), 7)


def test_what_stands_for_nothing_is_empty_and_a_mistake_in_a_column_of_numbers_is_named(tmp_path: Path) -> None:
    table, said = understand_ratings(recognise_file(write(tmp_path, "participant,c1,c2\np,1,NA\nq,2,5\n")))
    assert isinstance(table, RatingTable)
    assert sorted(table.rating.tolist()) == [1, 2, 5]
    assert "NA and the like are empty cells in 'c2'" in said[0]
    with pytest.raises(VotesError, match=r"row 1: the column 'c2' is '4\?', expected a number"):
        understand_ratings(recognise_file(write(tmp_path, "participant,c1,c2\np,1,4?\nq,2,5\nr,2,3\n")))


def test_trials_of_other_programs_are_read_without_their_other_screens(tmp_path: Path) -> None:
    gorilla = (
        "Event Index,Participant Private ID,Trial Number,Zone Type,Reaction Time,Response,ImageLeft,ImageRight\n"
        "1,77,1,fixation,250,,x.png,y.png\n2,77,1,response_button_image,812.3,y.png,x.png,y.png\n"
    )
    jspsych = (
        "rt,stimulus,response,trial_type,trial_index,time_elapsed,subject,left,right\n"
        "900,<p>Welcome</p>, ,html-keyboard-response,0,901,s,,\n700,<img>,1,html-button-response,1,1700,s,x.png,y.png\n"
    )
    told = Told(columns={"choice": "response"}, choices={"a": "0", "b": "1"})
    for text, edits in ((gorilla, Told()), (jspsych, told)):
        votes, _ = understand_votes([recognise_file(write(tmp_path, text), edits)])
        assert (votes.items, votes.choice.tolist()) == (("x.png", "y.png"), [1])


def said_of(path: Path, told: Told = Told()) -> list[str]:
    source = recognise_file(path, told)
    return (understand_votes([source]) if source.holds_votes else understand_ratings(source))[1]


@pytest.mark.parametrize(
    ("column", "cells"),
    [
        ("trial", ("practice", "practice", "1", "2")),
        ("trial_type", ("Practice trial", "practice 2", "main", "main")),
        ("phase", ("training", "warm-up", "test", "test")),
        ("trial", ("-2", "-1", "1", "2")),
        ("trialNr", ("-1", "-1", "0", "1")),
    ],
)
@pytest.mark.parametrize("header", [VOTED, "participant,condition,rating"])
def test_rows_of_practice_are_left_out_and_counted_unless_the_column_is_told(
    tmp_path: Path, header: str, column: str, cells: tuple[str, ...]
) -> None:
    begin = "p,x,y,a" if header == VOTED else "p,x,3"
    path = write(tmp_path, "\n".join([f"{header},{column}", *(f"{begin},{cell}" for cell in cells)]))
    said = said_of(path)
    assert f"2 rows are left out as practice (the column '{column}' is" in said[0]
    assert ("2 of them count" if header == VOTED else "2 ratings") in said[0] or "4 rows, 2 votes" in said[0]
    assert "are left out as practice" not in "".join(said_of(path, Told(columns={"dataset": column})))


def test_a_number_of_practice_that_may_be_the_first_trial_is_warned_of(tmp_path: Path) -> None:
    for cells in (("-1", "0", "1", "2"), ("0", "0", "0", "1", "2")):
        path = write(tmp_path, "\n".join([f"{VOTED},trial", *(f"p,x,y,a,{cell}" for cell in cells)]))
        assert any(line.startswith(WARNING) and "'trial' is 0" in line for line in said_of(path))
    path = write(tmp_path, "\n".join([f"{VOTED},trial", *(f"{who},x,y,a,{cell}" for who in "pq" for cell in "012")]))
    assert not any("'trial' is 0" in line for line in said_of(path))


def test_a_group_that_was_trained_is_no_practice(tmp_path: Path) -> None:
    path = write(tmp_path, f"{VOTED},group\np,x,y,a,training\nq,x,y,a,control\n")
    assert "left out" not in said_of(path)[0]
