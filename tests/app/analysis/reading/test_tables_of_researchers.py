"""Tables as researchers have them at hand: read rightly, or asked about, or refused with the way out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from app.analysis.ratings.reading import understand_ratings
from app.analysis.ratings.table import RatingTable
from app.analysis.reading.description import QuestionError, Told
from app.analysis.reading.read_votes import understand_votes
from app.analysis.reading.sources import WARNING, recognise_file
from app.analysis.reading.votes_table import VotesError

VOTED = "participant,item_a,item_b,choice"
RATED = "participant,condition,rating"


def write(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def ratings(path: Path, scale: tuple[float, float] | None = None, **told: Any) -> tuple[list[Any], list[str]]:
    """Return participant, condition and rating of each row, and what was said."""
    table, said = understand_ratings(recognise_file(path, Told(**told)), scale)
    assert isinstance(table, RatingTable)
    rows = zip(table.person, table.item, table.rating.tolist(), strict=True)
    return [(table.participants[person], table.items[item][1], rating) for person, item, rating in rows], said


def votes(path: Path, **told: Any) -> tuple[list[Any], list[str]]:
    """Return the preferred and the other item of each row, marked without a preference; and what was said."""
    table, said = understand_votes([recognise_file(path, Told(**told))])
    rows = zip(table.item_a, table.item_b, table.choice, strict=True)
    items = [((table.items[a], table.items[b]), choice) for a, b, choice in rows]
    return [(pair, pair[::-1], (*sorted(pair), ""))[choice] for pair, choice in items], said


def warnings(said: list[str]) -> str:
    return "\n".join(line for line in said if line.startswith(WARNING))


def test_statistics_below_a_long_table_are_nobody(tmp_path: Path) -> None:
    path = write(tmp_path, f"{RATED}\nA,x,3\nB,x,4\nMean,x,3.5\nSD,x,0.7\n")
    read, said = ratings(path)
    assert read == [("A", "x", 3), ("B", "x", 4)]
    assert "row 3, 4 is not used: 'Mean', 'SD' is nobody but a summary" in warnings(said)
    read, said = ratings(write(tmp_path, f"{RATED}\nSD,x,3\nMM,x,4\n"))
    assert [name for name, _, _ in read] == ["SD", "MM"]
    assert "participants are called SD: leave out statistics" in warnings(said)
    read, _ = votes(write(tmp_path, f"{VOTED}\nA,x,y,a\nB,y,x,b\nTotal,,,0.5\n"))
    assert read == [("x", "y"), ("x", "y")]
    read, _ = ratings(write(tmp_path, "clip,R1,R2\nx,3,4\ny,2,2\nMittelwert,2.5,3\nAnzahl,2,2\n"))
    assert {condition for _, condition, _ in read} == {"x", "y"}


def test_names_of_ratings_that_look_alike_are_named_and_so_are_numbers(tmp_path: Path) -> None:
    _, said = ratings(write(tmp_path, f"{RATED}\n1,x,3\n1.0,X,4\n10,x,4\n"))
    assert "'1' and '1.0' look alike and are counted as 2 participants" in said
    assert "'x' and 'X' look alike and are counted as 2 conditions" in said
    assert not any("'10'" in line for line in said[1:])


def test_a_matrix_that_may_not_be_of_wins_of_the_row_is_asked_about_or_warned_of(tmp_path: Path) -> None:
    with pytest.raises(VotesError, match=r"'loser \\\\ winner'.*exchange its rows and columns"):
        votes(write(tmp_path, "loser \\ winner,x,y\nx,,3\ny,4,\n"))
    _, said = votes(write(tmp_path, ",x,y,z\nx,0,5,5\ny,5,0,5\nz,5,5,0\n"))
    assert "number of comparisons rather than of wins" in warnings(said)
    _, said = votes(write(tmp_path, ",x,y,z\nx,,5,4\ny,,,3\nz,,,\n"))
    assert "only one side of the diagonal is filled" in warnings(said)
    _, said = votes(write(tmp_path, "winner \\ loser,x,y,z\nx,,5,4\ny,2,,3\nz,2,1,\n"))
    assert not warnings(said)


NUMBERED = {
    "halves for ties": (f"{VOTED}\nA,x,y,1\nB,x,y,0.5\nC,x,y,0\n", "--choices a=1,none=0.5,b=0", 3),
    "halves with commas": (
        'participant;item_a;item_b;choice\nA;x;y;1,0\nB;x;y;0,5\nC;x;y;0,0\n',
        "--choices a=1,none=0.5,b=0",
        3,
    ),
    "codes of keys": (f"{VOTED}\nA,x,y,37\nB,x,y,39\n", "--choices a=37,b=39", 2),
    "codes as decimals": (f"{VOTED}\nA,x,y,1.0\nB,x,y,0.0\n", "--choices a=1,b=0", 2),
    "strengths": (f"{VOTED}\nA,x,y,-3\nB,x,y,2\nC,x,y,3\n", "item_a is than item_b: --columns item_a=item_b", 3),
}  # fmt: skip


@pytest.mark.parametrize("kind", NUMBERED)
def test_numbers_that_may_mean_either_item_are_asked_with_an_option_for_each(tmp_path: Path, kind: str) -> None:
    text, option, n = NUMBERED[kind]
    path = write(tmp_path, text)
    with pytest.raises(QuestionError) as asked:
        recognise_file(path)
    assert option in str(asked.value)
    read = set()
    for reading in asked.value.readings:
        source = recognise_file(path, reading.told)
        _, said = understand_votes([source]) if source.holds_votes else understand_ratings(source)
        assert f"{n} rows, {n} votes" in said[0] or f"{n} ratings" in said[0]
        read.add(said[0].rpartition("fingerprint")[2])
    assert len(read) == len(asked.value.readings) > 1


CONFIRMED = {
    "1 and 2 without names of pairs": ("participant,Q1,Q2\nA,1,2\nB,2,2\n", "rename each column by its pair"),
    "who stood left": (f"{VOTED},left_item\nA,x,y,left,x\nB,x,y,left,y\n", "give the items as they stood"),
}


@pytest.mark.parametrize("kind", CONFIRMED)
def test_what_a_single_option_confirms_is_refused_with_both_ways_out(tmp_path: Path, kind: str) -> None:
    text, way = CONFIRMED[kind]
    with pytest.raises(QuestionError, match=way) as asked:
        recognise_file(write(tmp_path, text))
    assert "which is meant" not in str(asked.value)
    assert f"{asked.value.readings[0].told} takes it as: " in str(asked.value)


def test_two_items_without_a_known_choice_are_no_ratings_by_what_else_is_there(tmp_path: Path) -> None:
    path = write(tmp_path, "participant,item_a,item_b,chose_left,left_is_a\nA,x,y,1,0\nA,x,z,0,1\n")
    with pytest.raises(VotesError, match="lacks the column choice; found"):
        recognise_file(path)


@pytest.mark.parametrize("name", ["swapped", "left_is_a", "mirrored", "item_a_position"])
def test_a_column_that_may_turn_choices_is_never_advised_to_leave_rows_out(tmp_path: Path, name: str) -> None:
    path = write(tmp_path, f"participant,item_a,item_b,response,{name}\nA,x,y,1,0\nB,x,y,0,1\n")
    with pytest.raises(QuestionError):
        recognise_file(path)
    _, said = votes(path, choices={"a": "1", "b": "0"})
    assert f"'{name}' is not used, and may say that items stood the other way round in some rows" in warnings(said)
    assert "practice" not in warnings(said)


def test_the_reading_that_a_question_promises_is_what_its_option_gives(tmp_path: Path) -> None:
    path = write(tmp_path, "subject,stimulus,response,left,right\nA,<img>,1,x,y\nB,<b>,2,x,y\n")
    with pytest.raises(QuestionError) as asked:
        recognise_file(path)
    promised = {reading.text.partition(" ")[0]: reading.told for reading in asked.value.readings}
    assert recognise_file(path, promised["ratings"]).description.holds == "ratings"


ABROAD = {
    "German": "Versuchsperson;Links;Rechts;Antwort;Zeit\nA;x;y;links;1,2\nA;z;x;rechts;0,9\nB;x;y;gleich;2\n",
    "French": "sujet,image_gauche,image_droite,choix\nA,x,y,gauche\nA,z,x,droite\nB,x,y,égal\n",
    "Chinese": "被试,左,右,选择\nA,x,y,左\nA,z,x,右\nB,x,y,相同\n",
    "file names": "worker_id,left_url,right_url,chosen\n"
    "A,s/x.png,s/y.png,x.png\nA,s/z.png,s/x.png,x\nB,s/x.png,s/y.png,same\n",
    "oTree": "participant.code,session.code,player.left_stim,player.right_stim,player.choice,subsession.round_number\n"
    "A,s,x,y,left,1\nA,s,z,x,right,2\nB,s,x,y,same,1\n",
    "Mechanical Turk": "HITId,WorkerId,AssignmentStatus,Input.image_a,Input.image_b,Answer.choice\n"
    "h,A,Submitted,x,y,A\nh,A,Submitted,z,x,B\nh,B,Submitted,x,y,same\n",
}  # fmt: skip


@pytest.mark.parametrize("kind", ABROAD)
def test_votes_in_the_words_of_other_languages_and_programs_are_read(tmp_path: Path, kind: str) -> None:
    read, _ = votes(write(tmp_path, ABROAD[kind]))
    names = [tuple(name.removeprefix("s/").removesuffix(".png") for name in row) for row in read]
    assert names == [("x", "y"), ("x", "z"), ("x", "y", "")]


def test_file_names_that_only_their_folders_tell_apart_are_compared_whole(tmp_path: Path) -> None:
    with pytest.raises(VotesError, match=r"row 2: choice is 'x.png', expected the name of one of the two"):
        votes(write(tmp_path, f"{VOTED}\nA,p/x.png,q/x.png,q/x.png\nA,p/x.png,q/x.png,x.png\n"))


GRADED = {
    "labelled numbers": f"{RATED}\nA,x,5 - Excellent\nA,y,2\nB,x,1 (bad)\n",
    "German words": f"{RATED}\nA,x,ausgezeichnet\nA,y,dürftig\nB,x,schlecht\n",
    "words in columns": "participant,x,y,age\nA,Excellent,Poor,33\nB,Bad,,44\n",
    "labels in columns": "Teilnehmer;x;y;Kommentar\nA;5 = sehr gut;2;so\nB;1 = schlecht;;\n",
}


@pytest.mark.parametrize("kind", GRADED)
def test_words_of_scales_are_grades_and_which_is_said(tmp_path: Path, kind: str) -> None:
    read, said = ratings(write(tmp_path, GRADED[kind]))
    assert sorted(read) == [("A", "x", 5), ("A", "y", 2), ("B", "x", 1)]
    assert " is 5" in said[0].partition("words are grades: ")[2]


REFUSED = {
    "a title above": ("Experiment 3\n\nparticipant,condition,rating\nA,x,3\n", "the first line is to name the columns"),
    "blanks between": ("participant condition rating\nA x 3\n", "has a single column; the first line is to name them"),
    "a code for nothing": (f"{RATED}\nA,x,3\nB,x,-99\n", "a code for no answer is to be an empty cell"),
    "no answer": (f"{RATED}\nA,x,3\nB,x,NA\n", "leave out rows without a rating"),
    "seven points": ("participant,item_a,item_b,rating\nA,x,y,7\nB,x,y,4\n", "0 is to be its middle"),
    "one column missing": ("name of yours,x,y\nA,3,4\nB,2,5\n", "lacks the column participant"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_a_refusal_says_what_to_do(tmp_path: Path, kind: str) -> None:
    text, way = REFUSED[kind]
    with pytest.raises(VotesError, match=way):
        ratings(write(tmp_path, text)) if "item_a" not in text else understand_ratings(write(tmp_path, text))


def test_rows_that_were_joined_twice_or_begun_again_are_warned_of_and_repeats_are_not(tmp_path: Path) -> None:
    header = "participant,trial,item_a,item_b,choice"
    path = write(tmp_path, f"{header}\nA,1,x,y,a\nA,2,x,z,b\nB,1,x,y,a\nB,2,x,z,a\nA,1,x,y,b\n")
    _, said = votes(path)
    assert "1 row of the same participant and items as another also has the same 'trial'" in warnings(said)
    _, said = votes(write(tmp_path, f"{header}\nA,1,x,y,a\nA,2,x,z,b\nA,3,x,y,b\nA,4,x,z,a\n"))
    assert not warnings(said)
    _, said = votes(write(tmp_path, f"block,{header}\n1,A,1,x,y,a\n1,A,2,x,z,b\n2,A,1,x,y,b\n3,A,1,x,y,b\n"))
    assert "joined twice" not in warnings(said)


def test_a_scale_that_may_be_turned_is_warned_of(tmp_path: Path) -> None:
    _, said = ratings(write(tmp_path, f"{RATED},reversed\nA,x,1,1\nB,x,2,1\n"))
    assert "'reversed' is not used, and may say that a scale is turned: more counts as better" in warnings(said)
    name = "rating (1 = best)"
    path = write(tmp_path, f"participant,condition,{name}\nA,x,1\nB,x,2\n")
    _, said = ratings(path, columns={"rating": name})
    assert "'rating (1 = best)' may be a scale that is turned: more counts as better" in warnings(said)


def test_a_vote_that_was_not_given_is_refused_with_the_way_out(tmp_path: Path) -> None:
    for nothing in ("NA", ""):
        with pytest.raises(
            VotesError, match=r"row 2: choice is '.*', expected a, b, none; leave out rows without an answer"
        ):
            votes(write(tmp_path, f"{VOTED}\nA,x,y,a\nA,x,y,{nothing}\n"))


def test_people_who_may_have_used_another_scale_are_named(tmp_path: Path) -> None:
    rows = "".join(f"A,{name},{20 * n}\nB,{name},{n}\n" for n, name in enumerate("xyz", start=1))
    _, said = ratings(write(tmp_path, f"{RATED}\n{rows}"), (0, 100))
    assert "B never rated above 10 of 100: on another scale than the others?" in warnings(said)
    _, said = ratings(write(tmp_path, f"{RATED}\n{rows.replace(',3', ',30')}"), (0, 100))
    assert not warnings(said)


@pytest.mark.parametrize("symbols", ["★★★☆☆ ★★★★★ ★☆☆☆☆", "*** ***** *", "⭐⭐⭐ ⭐️⭐️⭐️⭐️⭐️ ⭐"])
def test_stars_are_counted(tmp_path: Path, symbols: str) -> None:
    cells = symbols.split()
    wanted = [("A", f"c{n}", value) for n, value in enumerate((3, 5, 1))]
    for text in (
        "\n".join([RATED, *(f"A,c{n},{cell}" for n, cell in enumerate(cells))]),
        f"participant,c0,c1,c2\nA,{','.join(cells)}\n",
    ):
        rated, said = ratings(write(tmp_path, text))
        assert rated == wanted
        assert f"words are grades: {cells[1]} is 5" in said[0]
    alone = write(tmp_path, f"{RATED}\nA,c0,{cells[0]}\n")
    if cells[0] != "***":
        assert ratings(alone)[0] == wanted[:1]
    else:  # rather what stands for a rating that is hidden
        with pytest.raises(VotesError, match=r"rating is '\*\*\*', expected a number$"):
            ratings(alone)


def test_stars_of_another_number_than_five_are_refused_with_what_to_write(tmp_path: Path) -> None:
    path = write(tmp_path, f"{RATED}\nA,x,★★★☆☆☆☆☆☆☆\nA,y,★★★★★☆☆☆☆☆\n")
    with pytest.raises(VotesError, match=r"row 1: rating is '★★★☆☆☆☆☆☆☆', expected a number: write 3, of --scale 0:10"):
        ratings(path)
