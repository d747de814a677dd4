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
    """Return the preferred and the other item of each row, both in order without a preference, and what was said."""
    table, said = understand_votes([recognise_file(path, Told(**told))])
    rows = zip(table.item_a, table.item_b, table.choice, strict=True)
    names = [(table.items[a], table.items[b], choice) for a, b, choice in rows]
    return [(b, a) if choice == 1 else tuple(sorted((a, b))) + ("",) * (choice == 2) if choice else (a, b)
            for a, b, choice in names], said  # fmt: skip


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
