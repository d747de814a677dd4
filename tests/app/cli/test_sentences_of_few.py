"""What is said of one vote, one participant and one condition is said in the singular."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import app
from tests.app.sentences import OF_ONE, words_of

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
    report = words_of((tmp_path / "out" / "report.html").read_text(encoding="utf-8"))
    said = [*(answer.output for answer in told), report]
    assert [match[0] for text in said for match in OF_ONE.finditer(text)] == []
