"""A large clean file is cut into cells at once; its votes and the sentences on them are those of a small file."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from app.analysis.reading.files import tabular
from app.analysis.reading.files import text as text_tables
from app.analysis.reading.read_votes import read_votes, understand_votes
from app.analysis.reading.votes_table import VotesTable

PLAIN = """participant,dataset,item_a,item_b,choice
 P2 ,ball,x,y,a
P1,ball,y,z,none
P2,box,z,x,b
"""
WHOLE = """trial,participant,dataset,item_a,item_b,choice,first_shown,response_ms,\
practice,excluded,reason,count,role,both_seen
t1,P1,ball,x,y,a,y,812.5,false,true,"left, early",1,main,true
t2,P1,ball,y,y,none,y,,false,false,,2,identical,
t3,P2,box,y,x,b,,90,TRUE,0,,1,,false
"""
JUDGES = PLAIN.replace("participant", "judge")


@pytest.mark.parametrize("text", [PLAIN, WHOLE, JUDGES, "\ufeff" + PLAIN], ids=["plain", "whole", "judges", "marked"])
def test_a_clean_file_is_the_same_table(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "votes.csv"
    path.write_text(text, encoding="utf-8")
    strict, said = understand_votes([path])
    monkeypatch.setattr(text_tables, "QUICK_FROM", 0)
    monkeypatch.setattr(tabular, "table_of_text", None)  # cells are not read one by one
    quick, said_quickly = understand_votes([path])
    assert said_quickly == said
    for field in fields(VotesTable):
        column, wanted = getattr(quick, field.name), getattr(strict, field.name)
        if isinstance(wanted, tuple):
            assert column == wanted, field.name
        else:
            assert column.dtype == wanted.dtype, field.name
            np.testing.assert_array_equal(column, wanted, field.name)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("none", "nobody", "row 2: choice is 'nobody'"),
        ("y,z", "y,y", "row 2: the item 'y' is compared with itself"),
        ("P1", "", "row 2: participant is empty"),
        ("P1,ball,y,z,none", "P1,ball,y,z", "row 2: choice is ''"),
        ("choice", "chioce", "lacks the column choice"),
    ],
)
def test_what_is_wrong_is_named_as_in_a_small_file(
    old: str, new: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "votes.csv"
    path.write_text(PLAIN.replace(old, new), encoding="utf-8")
    monkeypatch.setattr(text_tables, "QUICK_FROM", 0)
    with pytest.raises(ValueError, match=message):
        read_votes(path)
