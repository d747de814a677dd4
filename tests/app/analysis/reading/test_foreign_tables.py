"""Tables as other people and programs make them: understood rightly, or asked; each kind by a file like it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from app.analysis.ratings.comparisons import analyse_comparisons
from app.analysis.ratings.opinion_scores import item_rows
from app.analysis.ratings.reading import understand_ratings
from app.analysis.ratings.table import ComparisonTable, RatingTable
from app.analysis.reading.description import QuestionError, Told
from app.analysis.reading.read_votes import understand_votes
from app.analysis.reading.sources import recognise_file
from app.analysis.reading.votes_table import VotesError, VotesTable

REAL = {"practice_cap.csv": 18, "is_practice.csv": 18, "count_cap2.csv": 252, "wide_12.csv": 36, "wide_q.csv": 6}


def write(folder: Path, text: str, name: str = "table.csv") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def votes_in(path: Path, **told: Any) -> tuple[VotesTable, list[str]]:
    return understand_votes([recognise_file(path, Told(**told))])


def ratings_in(path: Path, scale: tuple[float, float] | None = None, **told: Any) -> tuple[RatingTable, list[str]]:
    table, said = understand_ratings(recognise_file(path, Told(**told)), scale)
    assert isinstance(table, RatingTable)
    return table, said


def wins(votes: VotesTable) -> dict[tuple[str, str], int]:
    """Count the votes that count of each (winner, loser)."""
    counts: dict[tuple[str, str], int] = {}
    for a, b, choice, count in zip(votes.item_a, votes.item_b, votes.choice, votes.count, strict=True):
        names = (votes.items[a], votes.items[b])
        key = names if choice == 0 else names[::-1] if choice == 1 else ("=".join(sorted(names)), "")
        counts[key] = counts.get(key, 0) + int(count)
    return counts


@pytest.mark.parametrize(("name", "n"), REAL.items())
def test_real_tables_of_votes_give_what_their_page_says(real_data: Path, name: str, n: int) -> None:
    votes, _ = votes_in(real_data / "foreign/tables" / name)
    assert votes.used().n_votes == n


def test_real_tables_of_ratings_give_what_their_page_says(real_data: Path) -> None:
    tables = real_data / "foreign/tables"
    parts, said = ratings_in(tables / "colpart.csv")
    assert (len(parts), parts.participants) == (18, ("S1", "S2", "S3"))
    assert "not used: MOS, CI" in said[0]
    aged, said = ratings_in(tables / "wide_age.csv", (0, 100))
    assert (len(aged), [condition for _, condition in aged.items]) == (60, ["c1", "c2", "c3"])
    assert "not used: age" in said[0]
    dmos = {row["condition"]: row["dmos"] for row in item_rows(ratings_in(tables / "hr_title.csv")[0])}
    assert (dmos["x"], dmos["y"]) == (2.5, 3.5)
    with pytest.raises(VotesError, match="none of 18 ratings counts: 18 practice, 18 excluded"):
        ratings_in(tables / "rprac.csv")


def test_a_question_shows_all_readings_and_each_options_answer_is_taken(tmp_path: Path) -> None:
    rows = "\n".join(f"P{n},x,y,{'b' if n % 3 else 'a'},{n % 3}" for n in range(6))
    path = write(tmp_path, f"participant,item_a,item_b,choice,rating\n{rows}\n")
    with pytest.raises(QuestionError, match=r"read in 2 ways") as asked:
        recognise_file(path)
    told = {reading.told.columns.get("choice"): reading.told for reading in asked.value.readings}
    assert "--columns choice=choice" in str(asked.value)
    assert "--columns rating=rating" in str(asked.value)
    votes, said = understand_votes([recognise_file(path, told["choice"])])
    assert wins(votes) == {("x", "y"): 2, ("y", "x"): 4}
    assert "not used: rating" in said[0]
    compared, said = understand_ratings(recognise_file(path, told[None]))
    assert isinstance(compared, ComparisonTable)
    assert compared.rating.tolist() == [0, 1, 2, 0, 1, 2]
    assert "not used: choice" in said[0]


def test_items_called_like_choices_are_asked_about_and_told(tmp_path: Path) -> None:
    path = write(tmp_path, "subject,stim1,stim2,resp\n1,1,2,1\n1,1,3,2\n1,2,3,1\n2,1,2,1\n2,1,3,1\n2,2,3,2\n")
    with pytest.raises(QuestionError, match="items are called 1, 2, and choices are, too"):
        recognise_file(path)
    wanted = {("1", "2"): 2, ("3", "1"): 1, ("1", "3"): 1, ("2", "3"): 1, ("3", "2"): 1}
    columns = {"participant": "subject", "item_a": "stim1", "item_b": "stim2", "choice": "resp"}
    assert wins(votes_in(path, columns=columns)[0]) == wanted
    assert wins(votes_in(path, choices={"a": "1", "b": "2"})[0]) == wanted
    with pytest.raises(
        VotesError, match=r"row 2: choice .the column 'resp'. is '2', expected the name of one of the two"
    ):
        votes_in(path, choices={"by": "item"})
    both = write(tmp_path, "subject,stim1,stim2,resp\n1,1,2,1\n1,2,1,1\n", "both.csv")
    with pytest.raises(QuestionError, match="can be read in 2 ways"):
        votes_in(both, columns=columns)
    assert wins(votes_in(both, choices={"by": "item"})[0]) == {("1", "2"): 2}


@pytest.mark.parametrize(
    ("cells", "option"),
    [
        (("0", "1"), "--choices a=1,b=0"),
        (("-1", "0", "1"), "--format ccr"),
        (("1", "2", "3"), "--choices a=1,none=2,b=3"),
    ],
)
def test_numbers_that_may_mean_either_side_are_asked(tmp_path: Path, cells: tuple[str, ...], option: str) -> None:
    rows = "".join(f"p{n},x,y,{cell}\n" for n, cell in enumerate(cells))
    with pytest.raises(QuestionError) as asked:
        recognise_file(write(tmp_path, f"participant,item_a,item_b,choice\n{rows}"))
    assert option in str(asked.value)


def test_two_columns_that_may_be_the_choice_are_asked_unless_they_agree(tmp_path: Path) -> None:
    header = "participant,item_a,item_b,response,winner\n"
    votes, _ = votes_in(write(tmp_path, f"{header}p,x,y,left,x\np,y,z,right,z\n"))
    assert wins(votes) == {("x", "y"): 1, ("z", "y"): 1}
    path = write(tmp_path, f"{header}p,x,y,left,y\np,y,z,right,z\n")
    with pytest.raises(QuestionError, match="2 columns may be the choice, and do not say the same"):
        recognise_file(path)
    assert wins(votes_in(path, columns={"choice": "winner"})[0]) == {("y", "x"): 1, ("z", "y"): 1}


def test_a_side_is_asked_about_where_another_column_says_who_stood_there(tmp_path: Path) -> None:
    text = "participant,item_a,item_b,left_item,choice\np,x,y,x,left\np,x,y,y,left\n"
    with pytest.raises(QuestionError, match="the column 'left_item' may say that items stood the other way"):
        recognise_file(write(tmp_path, text))


def test_every_wrong_cell_is_named_by_its_row_in_the_file_and_no_right_one_is_blamed(tmp_path: Path) -> None:
    text = "participant,item_a,item_b,choice,count\nA,x,y,left,1\n\nA,y,z,right,2\n"
    text += "B,x,y,lft,many\nB,y,z,rght,3\nC,x,x,left,1\n"
    with pytest.raises(VotesError) as refused:
        votes_in(write(tmp_path, text))
    lines = str(refused.value).partition(": ")[2].splitlines()
    assert lines[0].startswith("row 6: the item 'x' is compared with itself")
    assert lines[1] == "row 4: choice is 'lft', expected left or right (and 1 more row like it)"
    assert lines[2].startswith("row 4: count is 'many', expected a whole number")
    wide = write(tmp_path, "participant,x vs y,y vs z\nA,left,right\nB,left,lft\n", "wide.csv")
    with pytest.raises(VotesError, match="row 2: the column 'y vs z' is 'lft', expected left or right"):
        votes_in(wide)


def test_numbering_and_comments_are_no_part_of_a_pair(tmp_path: Path) -> None:
    text = (
        'Name,"P1 - red vs blue","x","P2 - vp9 - 2 vs red",red vs blue Comment\nA,left,1,right,nice\nB,right,2,left,\n'
    )
    votes, said = votes_in(write(tmp_path, text), columns={"participant": "Name"})
    assert wins(votes) == {("red", "blue"): 1, ("blue", "red"): 1, ("red", "vp9 - 2"): 1, ("vp9 - 2", "red"): 1}
    assert "not used: x, red vs blue Comment" in said[0]


def test_a_column_that_looks_like_an_exclusion_is_a_warning_and_may_be_used(tmp_path: Path) -> None:
    path = write(tmp_path, "participant,item_a,item_b,choice,failed check\nA,x,y,a,0\nB,x,y,b,1\n")
    votes, said = votes_in(path)
    assert len(votes.used()) == 2
    assert any(line.startswith("Warning: ") and "'failed check' is not used" in line for line in said)
    used, said = votes_in(path, columns={"excluded": "failed check"})
    assert len(used.used()) == 1
    assert not any(line.startswith("Warning: ") for line in said)


def test_statistics_and_facts_about_people_are_no_conditions_unless_told(tmp_path: Path) -> None:
    path = write(tmp_path, "Subject,Age,x,y,SD,Unnamed: 5\nA,3,1,2,1,4\nB,4,3,4,2,4\nMean,3.5,2,3,1.5,4\n")
    ratings, said = ratings_in(path)
    assert ([condition for _, condition in ratings.items], ratings.participants) == (["x", "y"], ("A", "B"))
    assert "not used: Age, SD, Unnamed: 5" in said[0]
    assert any("row 3 is not used: 'Mean' is nobody but a summary" in line for line in said)
    told, _ = ratings_in(path, columns={"rating": "x+y+Age"})
    assert [condition for _, condition in told.items] == ["x", "y", "Age"]


def test_a_number_that_may_be_about_people_is_asked_about(tmp_path: Path) -> None:
    path = write(tmp_path, "participant,c1,c2,c3,wibble\nA,1,2,3,4\nB,2,3,4,5\n")
    with pytest.raises(QuestionError, match="wibble may be something else than c1, c2, c3") as asked:
        recognise_file(path)
    assert len(understand_ratings(recognise_file(path, asked.value.readings[1].told))[0]) == 6


@pytest.mark.parametrize("rating", ["3", "2"])
def test_no_order_effect_is_invented_where_no_order_is_recorded(tmp_path: Path, rating: str) -> None:
    rows = [(a, b) for a, b in ("ab", "ac", "bc")]
    text = "".join(f"P{person},{a},{b},{rating}\n" for person in range(5) for a, b in rows)
    table, _ = understand_ratings(write(tmp_path, f"participant,item_a,item_b,rating\n{text}"))
    assert isinstance(table, ComparisonTable)
    found = analyse_comparisons(table)
    assert [row["cmos"] for row in found["comparison_pairs"]] == [float(rating)] * 3
    assert found["comparison_models"][0]["order_effect"] is None
    assert "first_shown" in found["rating_warnings"][0]["warning"]
    ordered = "".join(f"P{person},{a},{b},{rating},{a}\n" for person in range(5) for a, b in rows)
    table, _ = understand_ratings(write(tmp_path, f"participant,item_a,item_b,rating,first_shown\n{ordered}"))
    assert analyse_comparisons(table)["comparison_models"][0]["order_effect"] is None  # type: ignore[arg-type]


def test_an_order_effect_is_not_told_from_the_end_of_the_scale() -> None:
    n, a, b = 12, np.array([0, 1] * 6), np.array([1, 0] * 6)
    rating = np.array([3.0, -3.0] * 6)
    table = ComparisonTable(
        tuple("abcdef"), (("d", "x"), ("d", "y")), np.repeat(np.arange(6), 2), a, b, rating, np.ones(n, bool)
    )
    model = analyse_comparisons(table)["comparison_models"][0]
    assert model["order_effect"] is None
    assert "ends of the scale" in model["order_left_out"]


# What is in the file, how it is told, and the wins of each over each.
OTHER_SHAPES: dict[str, tuple[str, dict[str, Any], dict[tuple[str, str], int]]] = {
    "told winner and loser": (
        "voter,best_one,other\np,x,y\nq,y,z\n",
        {"columns": {"winner": "best_one", "loser": "other"}},
        {("x", "y"): 1, ("y", "z"): 1},
    ),
    "counts of wins": (
        "home.team,away.team,home.wins,away.wins,ties\nx,y,4,3,1\nx,z,0,2,\n",
        {},
        {("x", "y"): 4, ("y", "x"): 3, ("x=y", ""): 1, ("z", "x"): 2},
    ),
    "ranks in rows": (
        "participant,item,rank\np,x,1\np,y,2\np,z,2\n",
        {},
        {("x", "y"): 1, ("x", "z"): 1, ("y=z", ""): 1},
    ),
    "ranking in columns": (
        "participant,rank_1,rank_2,rank_3\np,z,x,y\n",
        {},
        {("z", "x"): 1, ("z", "y"): 1, ("x", "y"): 1},
    ),
    "best and worst": (
        "participant,option1,option2,option3,best,worst\np,x,y,z,y,x\n",
        {},
        {("y", "x"): 1, ("y", "z"): 1, ("z", "x"): 1},
    ),
    "strengths of sides": (
        "participant,item_a,item_b,choice\np,x,y,left much better\nq,x,y,right slightly better\nr,x,y,same\n",
        {},
        {("x", "y"): 1, ("y", "x"): 1, ("x=y", ""): 1},
    ),
    "strengths as votes": (
        "participant,item_a,item_b,choice\np,x,y,much better\nq,x,y,slightly worse\n",
        {"format": "votes"},
        {("y", "x"): 1, ("x", "y"): 1},
    ),
    "chosen and rejected": ("user,chosen,rejected\np,x,y\n", {}, {("x", "y"): 1}),
    "places as words": ("participant,first,second,third\np,a,b,c\n", {}, {("a", "b"): 1, ("a", "c"): 1, ("b", "c"): 1}),
    "an arena": (
        "model_a,model_b,winner,judge\nx,y,model_a,j\nx,y,tie (bothbad),j\n",
        {},
        {("x", "y"): 1, ("x=y", ""): 1},
    ),
    "pair in a cell": ("participant,pair,choice\np,x vs y,left\np,y vs z,right\n", {}, {("x", "y"): 1, ("z", "y"): 1}),
    "sep line": ("sep=;\nparticipant;item_a;item_b;choice\np;x;y;a\n", {}, {("x", "y"): 1}),
    "row numbers of R": (
        ",participant,item_a,item_b,choice\n1,p,x,y,a\n2,q,x,y,b\n",
        {},
        {("x", "y"): 1, ("y", "x"): 1},
    ),
    "is_A_selected": (
        "observer,scene,condition_A,condition_B,is_A_selected\no,s,x,y,0\no,s,x,z,1\n",
        {},
        {("y", "x"): 1, ("x", "z"): 1},
    ),
    "choix without a header": ("x,y\ny,z\n", {"format": "choix"}, {("x", "y"): 1, ("y", "z"): 1}),
}


@pytest.mark.parametrize("shape", OTHER_SHAPES)
def test_votes_of_other_shapes_are_read(tmp_path: Path, shape: str) -> None:
    text, told, wanted = OTHER_SHAPES[shape]
    votes, said = votes_in(write(tmp_path, text), **told)
    assert wins(votes) == wanted
    if "ranking" in shape or "rank" in shape or "best" in shape.split():
        assert "not independent" in said[0]


PROGRAMS = {
    "qualtrics": (
        'StartDate,ResponseId,Q1,Q2\n"Start Date","Response ID","Which is better? - red vs blue","red vs green"\n'
        '"{""ImportId"":""startDate""}","{""ImportId"":""_recordId""}","{""ImportId"":""QID1""}","{""ImportId"":""QID2""}"\n'
        "2024-01-01,R_1,red,green\n2024-01-02,R_2,blue,red\n",
        {("red", "blue"): 1, ("blue", "red"): 1, ("green", "red"): 1, ("red", "green"): 1},
    ),
    "psychopy": (
        "left_image,right_image,trials.thisRepN,trials.thisN,thisRow.t,notes,key_resp_instr.keys,key_resp_instr.rt,"
        "key_resp.keys,key_resp.rt,key_resp.duration,participant,session,date,expName,psychopyVersion,frameRate,\n"
        ",,,,0.01,,space,1.0,,,,P1,001,2023-05-04_10h33.21.001,e,2023.1.2,59.9,\n"
        "x,y,0,0,2.2,,,,left,0.5,None,P1,001,2023-05-04_10h33.21.001,e,2023.1.2,59.9,\n"
        "y,z,0,1,4.4,,,,right,0.6,None,P1,001,2023-05-04_10h33.21.001,e,2023.1.2,59.9,\n",
        {("x", "y"): 1, ("z", "y"): 1},
    ),
    "revisit": (
        "participantId,trialId,trialOrder,responseId,status,answer,duration,parameters_left,parameters_right\n"
        '"p","participantTags","null","participantTags","undefined","[]","undefined","undefined","undefined"\n'
        '"p","intro","0","","completed","undefined","9","undefined","undefined"\n'
        '"p","demographics","1","age","completed","42","16","undefined","undefined"\n'
        '"p","t1","2","q1","completed","left","9","x","y"\n"p","t2","3","q1","completed","right","9","y","z"\n',
        {("x", "y"): 1, ("z", "y"): 1},
    ),
    "webmushra-pairs": (
        "session_test_id,email,age,trial_id,choice_reference,choice_non_reference,choice_answer,choice_time,choice_comment\n"
        "t,a@b,30,piano,x,y,correct,5321,\nt,c@d,31,piano,x,y,incorrect,612,\nt,c@d,31,piano,x,z,undecided,99,\n"
        "t,e@f,31,piano,x,z,unknown,99,\n",
        {("x", "y"): 1, ("y", "x"): 1, ("x=z", ""): 1},
    ),
}


@pytest.mark.parametrize("program", PROGRAMS)
def test_votes_of_programs_are_read_as_they_write_them(tmp_path: Path, program: str) -> None:
    text, wanted = PROGRAMS[program]
    path = write(tmp_path, text)
    votes, said = votes_in(path)
    assert wins(votes) == wanted
    assert f"a table of {program}" in said[0]
    assert wins(votes_in(path, format=program)[0]) == wanted
    with pytest.raises(VotesError, match=f"is no table of {program}"):
        recognise_file(write(tmp_path, "participant,item_a,item_b,choice\np,x,y,a\n"), Told(format=program))


RATED = {
    "p910-crowd": (
        "HITId,WorkerId,input.tp,answer.q0_url,answer.q0,answer.q1_url,answer.q1,answer.q2_url,answer.q2\n"
        "h,W1,http://s/trap.mp4,http://s/a/x.mp4,4,http://s/y.mp4,2,http://s/trap.mp4,5\n",
        (1, 5), [("W1", "", "x.mp4", 4), ("W1", "", "y.mp4", 2)],
    ),
    "revisit": (
        "participantId,trialId,trialOrder,responseId,answer,startTime\np,intro,0,,,1\np,x,1,q,4,2\np,y,2,q,2,3\n",
        (1, 5),
        [("p", "", "x", 4), ("p", "", "y", 2)],
    ),
    "webmushra": (
        "session_test_id,email,age,session_uuid,trial_id,rating_stimulus,rating_score,rating_time,rating_comment\n"
        "t,a@b,30,u1,piano,reference,100,5,\nt,a@b,30,u1,piano,x,55,5,\n",
        (0, 100), [("u1", "piano", "reference", 100), ("u1", "piano", "x", 55)],
    ),
    "avrateng": (
        "rating;rating_type;timestamp;user_ID;video_ID;video_name\n"
        "4;quality;2019-06-03 14:22:01 112233;1;0;['videos/x.mkv']\n"
        "2;quality;2019-06-03 14:23:01 112233;1;1;['videos/y.mkv']\n",
        (1, 5), [("1", "", "videos/x.mkv", 4), ("1", "", "videos/y.mkv", 2)],
    ),
    "webmushra-likert": (
        "session_test_id,email,age,gender,trial_id,stimuli_rating,stimuli,rating_time\n"
        'lss,a@b,30,f,piano," 4 ",x,5123\nlss,a@b,30,f,piano," 2 ",y,987\n',
        (1, 5), [("a@b", "piano", "x", 4), ("a@b", "piano", "y", 2)],
    ),
}  # fmt: skip


@pytest.mark.parametrize("program", RATED)
def test_ratings_of_programs_are_read_as_they_write_them(tmp_path: Path, program: str) -> None:
    text, scale, wanted = RATED[program]
    table, said = ratings_in(write(tmp_path, text), scale)
    assert rated(table) == wanted
    assert f"a table of {program}" in said[0]


def test_what_real_exports_leave_open_is_refused_with_the_way_out(tmp_path: Path) -> None:
    header = "rating;rating_type;timestamp;user_ID;video_ID;video_name\n"
    with pytest.raises(VotesError, match=r"row 1: .* shows 2 films.*item_a and item_b"):
        recognise_file(write(tmp_path, f"{header}4;quality;t;1;0;['ref.mkv', 'x.mkv']\n"))
    header = "session_test_id,age,trial_id,rating_stimulus,rating_score,rating_time,rating_comment\n"
    with pytest.raises(VotesError, match="participant"):
        recognise_file(write(tmp_path, f"{header}t,30,piano,x,4,9,\nt,30,piano,y,4,9,\n"))
    questions = "participantId,trialId,responseId,answer\np,x,quality,4\np,x,depth,2\n"
    with pytest.raises(VotesError, match=r"several questions \('quality', 'depth'\).*--sheet quality"):
        recognise_file(write(tmp_path, questions))
    assert ratings_in(write(tmp_path, questions), sheet="depth")[0].rating.tolist() == [2]
    with pytest.raises(VotesError, match="no answers to 'sound'; questions are 'quality', 'depth'"):
        recognise_file(write(tmp_path, questions), Told(sheet="sound"))


def test_comparisons_of_p910_crowd_turn_with_the_order_that_they_were_shown_in(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        "HITId,WorkerId,Answer.q0_url,Answer.q0,Answer.q0_order,Answer.q1_url,Answer.q1,Answer.q1_order\n"
        "h,W1,http://s/x.mp4,-2,rp,http://s/y.mp4,-1,pr\n",
    )
    table, _ = understand_ratings(recognise_file(path))
    assert isinstance(table, ComparisonTable)
    names = [(table.items[a][1], table.items[b][1]) for a, b in zip(table.item_a, table.item_b, strict=True)]
    assert names == [("reference", "x.mp4"), ("reference", "y.mp4")]
    assert table.rating.tolist() == [-2, 1]
    assert table.a_first.tolist() == [True, False]


def test_paired_comparisons_of_sureal_are_votes(tmp_path: Path) -> None:
    python = (
        "ref_videos = [{'content_id': 0, 'content_name': 'caps', 'path': 'c.png'}]\n"
        "dis_videos = [{'asset_id': 0, 'content_id': 0, 'path': 'a.png', 'os': {('ann', 1): 1, ('bob', 1): 1}},\n"
        "  {'asset_id': 1, 'content_id': 0, 'path': 'b.png', 'os': {('cy', 0): 1}}]\n"
    )
    votes, _ = votes_in(write(tmp_path, python, "pairs.py"))
    assert (wins(votes), votes.participants) == ({("0", "1"): 2, ("1", "0"): 1}, ("ann", "bob", "cy"))
    with pytest.raises(VotesError, match=r"0\.5, expected a whole number of votes"):
        recognise_file(write(tmp_path, python.replace("1}", "0.5}"), "half.py"))


def rated(table: RatingTable) -> list[tuple[str, str, str, float]]:
    rows = zip(table.person, table.item, table.rating.tolist(), strict=True)
    return [(table.participants[person], *table.items[item], rating) for person, item, rating in rows]


SUREAL = {
    "ref_videos": [{"content_id": 0, "content_name": "ball", "path": "ref.yuv"}],
    "dis_videos": [{"content_id": 0, "asset_id": 0, "os": [4, None, 2], "path": "x.yuv"},
                   {"content_id": 0, "asset_id": 1, "os": {"ann": 5, "bob": [3, 4]}, "path": "y.yuv"}],
}  # fmt: skip
SUREAL_ROWS = [
    ("1", "ball", "0", 4),
    ("3", "ball", "0", 2),
    ("ann", "ball", "1", 5),
    ("bob", "ball", "1", 3),
    ("bob", "ball", "1", 4),
]


def test_a_dataset_of_sureal_is_read_from_json_and_from_python_that_is_not_run(tmp_path: Path) -> None:
    assert rated(ratings_in(write(tmp_path, json.dumps(SUREAL), "d.json"))[0]) == SUREAL_ROWS
    python = f"import os\nraise SystemExit\nref_videos = {SUREAL['ref_videos']}\ndis_videos = {SUREAL['dis_videos']}\n"
    python = python.replace("'x.yuv'", "os.path.join('d', 'x.yuv')")
    table, said = ratings_in(write(tmp_path, python, "d.py"))
    assert rated(table) == SUREAL_ROWS
    assert "read as literals and not run" in said[0]
    with pytest.raises(VotesError, match="line 1: dis_videos is put together by a program, which is not run"):
        recognise_file(write(tmp_path, "dis_videos = [{'os': list(range(3))}]\n", "e.py"))
    for text in ("dis_videos = [", "x = 1\n"):
        with pytest.raises(VotesError):
            recognise_file(write(tmp_path, text, "f.py"))


def test_annotations_of_label_studio_and_argilla_are_votes(tmp_path: Path) -> None:
    task = {"id": 1, "data": {"model_a": "x", "model_b": "y", "text_a": "t"}, "annotations": [
        {"id": 3, "completed_by": 7, "ground_truth": False, "lead_time": 4.2, "result": [
            {"id": "Dx_a", "from_name": "pw", "to_name": "a,b", "type": "pairwise", "value": {"selected": "right"}},
            {"id": "Dx_b", "from_name": "why", "to_name": "a", "type": "choices", "value": {"choices": ["left"]}}]},
        {"completed_by": 8, "was_cancelled": True, "result": [{"value": {"selected": "left"}}]}]}  # fmt: skip
    path = write(tmp_path, json.dumps([task]), "label.json")
    with pytest.raises(VotesError, match=r"several questions \('pw', 'why'\)"):
        recognise_file(path)
    votes, said = votes_in(path, sheet="pw")
    assert (wins(votes), votes.participants) == ({("y", "x"): 1}, ("7",))
    assert "1 cancelled annotations are left out" in said[0]
    record = {"fields": {"response1": "t", "response2": "u"}, "metadata": {"model_1": "x", "model_2": "y"},
              "responses": {"preference": [{"value": "response2", "user_id": "u1", "status": "submitted"},
                                           {"value": "response1", "user_id": "u2", "status": "draft"}],
                            "why": [{"value": "shorter", "user_id": "u1", "status": "submitted"}]}}  # fmt: skip
    path = write(tmp_path, json.dumps([record]), "argilla.json")
    with pytest.raises(VotesError, match=r"several questions \('preference', 'why'\)"):
        recognise_file(path)
    votes, said = votes_in(path, sheet="preference")
    assert (wins(votes), votes.participants) == ({("y", "x"): 1}, ("u1",))
    assert "1 responses that were not submitted are left out" in said[0]


def test_lists_of_choix_are_votes_and_rankings(tmp_path: Path) -> None:
    assert wins(votes_in(write(tmp_path, "[[0, 1], [2, 0]]", "pairs.json"))[0]) == {("0", "1"): 1, ("2", "0"): 1}
    ranked = votes_in(write(tmp_path, '[["x", "y", "z"]]', "ranked.json"))[0]
    assert wins(ranked) == {("x", "y"): 1, ("x", "z"): 1, ("y", "z"): 1}


def test_strengths_are_grades_where_that_is_told_and_asked_where_it_is_not(tmp_path: Path) -> None:
    path = write(
        tmp_path, "participant,item_a,item_b,choice\np,x,y,much better\nq,x,y,slightly worse\nr,x,y,about the same\n"
    )
    with pytest.raises(QuestionError, match="do not say which item is better"):
        recognise_file(path)
    table, said = understand_ratings(recognise_file(path, Told(format="ccr")))
    assert table.rating.tolist() == [3, -1, 0]
    assert "how much better item_b is than item_a" in said[0]


def test_encodings_sheets_and_ends_of_lines_are_explained_with_the_option(tmp_path: Path) -> None:
    text = "participant,item_a,item_b,choice\nJürgen,x,y,a\nb,x,y,b\n"
    path = tmp_path / "t.csv"
    for encoding, said in (("latin-1", "--encoding latin-1"), ("utf-16-le", "--encoding utf-16-le")):
        path.write_bytes(text.encode(encoding))
        with pytest.raises(VotesError, match=said):
            recognise_file(path)
        assert votes_in(path, encoding=encoding)[0].participants == ("Jürgen", "b")
    path.write_bytes(text.replace("\n", "\r").encode())
    assert votes_in(path)[0].participants == ("Jürgen", "b")
    path.write_bytes(text.replace("\n", "\r").encode("latin-1"))
    with pytest.raises(VotesError, match="row 1: 'Jürgen,x,y,a' is not UTF-8"):
        recognise_file(path)
    pytest.importorskip("openpyxl")
    with pd.ExcelWriter(tmp_path / "t.xlsx") as book:
        pd.DataFrame([{"a": "note"}]).to_excel(book, sheet_name="Notes", index=False)
        pd.DataFrame([{"participant": "p", "item_a": "x", "item_b": "y", "choice": "a"}]).to_excel(
            book, sheet_name="Data", index=False
        )
    votes, understood = votes_in(tmp_path / "t.xlsx", sheet="Data")
    assert votes.n_votes == 1
    assert "sheet Data, number 2 of 2; 1 row, 1 vote; the other sheets are 'Notes'" in understood[0]
    with pytest.raises(VotesError, match="has no sheet 'data'; it has 'Notes', 'Data'"):
        recognise_file(tmp_path / "t.xlsx", Told(sheet="data"))


def test_names_that_a_spreadsheet_changed_are_warned_of_and_long_ids_are_ids(tmp_path: Path) -> None:
    long = "https://s/" + "a" * 200
    text = f"participant,item_a,item_b,choice\n5.6E+23,3-Jan,y,a\n{long},3-Jan,y,b\n"
    votes, said = votes_in(write(tmp_path, text))
    assert votes.participants == ("5.6E+23", long)
    assert any("'5.6E+23', a long id that a spreadsheet shortened" in line for line in said)
    assert any("'3-Jan', a date" in line for line in said)


def test_a_column_is_taken_for_nothing_where_that_is_told(tmp_path: Path) -> None:
    path = write(tmp_path, "participant,condition,rating,reference\nA,x,3,orig.mp4\nA,y,4,orig.mp4\n")
    with pytest.raises(
        VotesError, match=r"row 1: reference is 'orig.mp4', expected true or false .--columns reference=-"
    ):
        ratings_in(path)
    assert len(ratings_in(path, columns={"reference": "-"})[0]) == 2


def test_sides_that_were_exchanged_and_rows_that_may_count_often_are_asked_about(tmp_path: Path) -> None:
    path = write(tmp_path, "participant,item_a,item_b,choice,swapped\nA,x,y,left,1\nB,x,y,right,0\n")
    with pytest.raises(QuestionError, match="'swapped' may say that items stood the other way round in some rows"):
        recognise_file(path)
    path = write(tmp_path, "item_a,item_b,choice,freq\nx,y,a,4\nx,y,b,5\n")
    with pytest.raises(QuestionError, match="'freq' may say how often a row counts") as asked:
        recognise_file(path)
    counts = [understand_votes([recognise_file(path, reading.told)])[0].n_votes for reading in asked.value.readings]
    assert counts == [9, 2]


def test_many_rows_of_numbers_of_the_same_person_are_asked_about(tmp_path: Path) -> None:
    with pytest.raises(QuestionError, match="participant '1' has several rows of numbers"):
        recognise_file(write(tmp_path, "subject,foo,bar,baz\n1,1,2,1\n1,2,3,2\n2,1,3,1\n"))


def test_words_of_absolute_categories_are_grades_and_several_questions_are_a_warning(tmp_path: Path) -> None:
    text = "participant,condition,rating,attribute\nA,x,Excellent,sharp\nA,y,poor,sharp\nA,x,Good,colour\n"
    table, said = ratings_in(write(tmp_path, text))
    assert table.rating.tolist() == [5, 2, 4]
    assert any(
        "'attribute' is not used: what it tells apart ('sharp', 'colour') counts as the same" in line for line in said
    )


def test_a_question_at_the_end_of_every_pairs_name_is_no_part_of_an_item(tmp_path: Path) -> None:
    asked = "participant,Q1. x vs. y - Which is better?,Q2. x vs. z - Which is better?\nA,left,left\nB,right,left\n"
    votes, _ = votes_in(write(tmp_path, asked))
    assert votes.items == ("x", "y", "z")
    in_cells = "participant,pair,choice\nA,x vs y (which is better?),left\nB,z vs x (which is better?),left\n"
    votes, _ = votes_in(write(tmp_path, in_cells))
    assert sorted(votes.items) == ["x", "y", "z"]


def test_items_whose_names_all_end_alike_keep_their_ends(tmp_path: Path) -> None:
    votes, _ = votes_in(write(tmp_path, "participant,x - fast vs y - fast,z - fast vs y - fast\nA,left,right\n"))
    assert sorted(votes.items) == ["x - fast", "y - fast", "z - fast"]


def test_a_score_of_conditions_in_two_columns_is_offered_as_a_reading(tmp_path: Path) -> None:
    rows = [f"{who},{codec},{rate},{rate // 250}" for who in "ABC" for codec in ("avc", "hevc") for rate in (500, 1000)]
    path = write(tmp_path, "\n".join(["observer,codec,bitrate,score", *rows]))
    with pytest.raises(QuestionError) as raised:
        ratings_in(path)
    told = raised.value.readings[0].told
    table, _ = ratings_in(path, columns=told.columns)
    assert [name for _, name in table.items] == ["avc 500", "avc 1000", "hevc 500", "hevc 1000"]


def test_rankings_of_one_person_that_an_unused_column_tells_apart_are_warned_about(tmp_path: Path) -> None:
    ranked = "rater,image,rank_1,rank_2,rank_3\nA,sea,x,y,z\nA,park,y,x,z\nB,sea,x,z,y\nB,park,z,x,y\n"
    _, said = votes_in(write(tmp_path, ranked))
    assert any("differ in the column 'image'" in line for line in said)


def test_ids_that_repeat_where_nobody_is_named_are_warned_about(tmp_path: Path) -> None:
    best = 'id,options,best,worst\n7,"x;y;z",x,z\n7,"x;y;u",u,y\n8,"x;y;z",y,z\n'
    _, said = votes_in(write(tmp_path, best))
    assert any("may name the participants: --columns participant=id" in line for line in said)


@pytest.mark.parametrize(
    ("name", "cells", "way"),
    [
        ("gold", ("1", "0", "0"), "--columns practice=gold leaves out those of which it is true"),
        ("invalid", ("no", "yes", "no"), "--columns practice=invalid leaves out those of which it is true"),
        ("valid", ("yes", "no", "yes"), "if rows of which it is false should not count, leave them out"),
        ("check_passed", ("1", "1", "0"), "if rows of which it is false should not count, leave them out"),
        ("session", ("1", "2", "2"), "--columns dataset=session keeps them apart"),
        ("session", ("0", "1", "1"), "--columns dataset=session keeps them apart"),
        ("session", ("1", "1", "1"), ""),
        ("status", ("done", "rejected", "done"), "leave out rows that should not count"),
    ],
)
def test_a_column_that_may_say_which_rows_count_is_never_advised_the_wrong_way_round(
    tmp_path: Path, name: str, cells: tuple[str, ...], way: str
) -> None:
    rows = [f"P{n},id,pm,{choice},{cell}" for n, (choice, cell) in enumerate(zip("aba", cells, strict=True))]
    path = write(tmp_path, "\n".join([f"participant,item_a,item_b,choice,{name}", *rows]))
    (warning,) = [said for said in votes_in(path)[1] if repr(name) in said and "looks as if" in said]
    assert warning.endswith(f"; {way}" if way else ")")
    if way.startswith("--columns"):
        role = way.removeprefix("--columns ").partition("=")[0]
        assert len(votes_in(path, columns={role: name})[0]) == 3
