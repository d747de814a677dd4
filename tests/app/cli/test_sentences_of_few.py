"""What is said of one vote, one participant and one condition is said in the singular."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import app

VOTES, RATINGS = "participant,dataset,item_a,item_b,choice", "participant,dataset,condition,rating"
TABLES = {
    "one vote": (VOTES, "P1,ball,x,y,a"),
    "one tie": (VOTES, "P1,ball,x,y,a", "P2,ball,x,y,b", "P1,ball,y,z,a", "P2,ball,z,y,a", "P1,ball,x,z,none"),
    "a circle": (VOTES, "P1,ball,x,y,a", "P1,ball,y,z,a", "P1,ball,x,z,b"),
    "one vote left out": (f"{VOTES},excluded", "P1,ball,x,y,a,false", "P2,ball,x,y,a,true"),
    "one rating": (RATINGS, "P1,ball,x,3"),
    "two ratings": (RATINGS, "P1,ball,x,3", "P1,ball,y,4"),
    "one rating left out": (f"{RATINGS},excluded", "P1,ball,x,3,false", "P1,ball,y,4,false", "P2,ball,x,5,true"),
}
MANY = (
    "answers|are|checks|columns|comparisons|conditions|datasets|films|frames|items|measures|pairs|participants|people|"
    "points|ratings|rows|sets|studies|times|trials|triads|votes|were"
)
OF_ONE = re.compile(rf"(?<![\d.,−-] )(?<![\d.,])\b1 (?:[a-z]+ )?(?:{MANY})\b|\b1 of \d+ \w+ (?:\(\d+ %\) )?are\b")


@pytest.mark.slow
@pytest.mark.parametrize("rows", TABLES.values(), ids=TABLES)
def test_one_of_a_kind_is_counted_in_the_singular(rows: tuple[str, ...], tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text("\n".join(rows) + "\n")
    told = [
        CliRunner().invoke(app, ["analyse", str(table), *more])
        for more in (["--dry-run"], ["-o", str(tmp_path / "out")])
    ]
    assert [answer.exit_code for answer in told] == [0, 0]
    report = (tmp_path / "out" / "report.html").read_text()
    sentences = html.unescape(re.sub(r"<[^>]*>", " ", re.sub(r"(?s)<(script|style|svg|td)\b.*?</\1>", "", report)))
    assert [
        said[0] for text in (*(answer.output for answer in told), sentences) for said in OF_ONE.finditer(text)
    ] == []
