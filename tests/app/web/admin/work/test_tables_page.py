"""A table from elsewhere is shown as it is read, asked about, changed, and analysed, on the dashboard and over REST."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Iterator
from typing import Any
from uuid import uuid4

import httpx
import pandas as pd
import pytest

from app.main import running_server
from app.operations.studies import manage
from app.settings import Settings
from tests.app.web.admin.dashboard_client import Dashboard, ends, signed_in
from tests.app.web.http_checks import is_problem

pytestmark = pytest.mark.slow
PAIRS = (("x", "y"), ("x", "z"), ("y", "z"))
VOTES = "judge,scene,item_a,item_b,choice,age\n" + "".join(
    f"P{person},ball,{a},{b},{'a' if (person + len(b)) % 3 else 'b'},{20 + person}\n"
    for person in range(6)
    for a, b in PAIRS
)
BOTH = "participant,item_a,item_b,choice,rating\n" + "".join(
    f"P{person},{a},{b},{'a' if person % 3 else 'b'},{1 if person % 3 else -2}\n"
    for person in range(6)
    for a, b in PAIRS
)


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    settings = Settings(data_dir=tmp_path_factory.mktemp("tables"))
    shelf = settings.intake_dir / "votes"
    shelf.mkdir(parents=True)
    (shelf / "votes.csv").write_text(VOTES)
    (shelf / "both.csv").write_text(BOTH)
    (shelf / "renamed.csv").write_text(
        VOTES.replace("judge,", "seat,").replace("item_a,item_b,choice", "item_a,item_b,q7")
    )
    of_gold = re.sub(r",(\d+)\n", lambda age: f",{int(age[1]) % 2}\n", VOTES.replace("age", "Is Gold", 1))
    (shelf / "gold.csv").write_text(of_gold)
    (shelf / "wrong.csv").write_text(VOTES.replace(",a,", ",lft,", 1))
    (shelf / "ratings.csv").write_text("participant,condition,rating\nP1,x,4\nP1,y,7\nP2,x,3\nP2,y,5\n")
    with pd.ExcelWriter(shelf / "book.xlsx") as book:
        for sheet in ("Lab", "Online"):
            pd.read_csv(io.StringIO(VOTES)).to_excel(book, sheet_name=sheet, index=False)
    return settings


@pytest.fixture(scope="module")
def address(tables: Settings) -> Iterator[str]:
    with running_server(tables) as url:
        yield url


@pytest.fixture
def eva(address: str, tables: Settings) -> Iterator[Dashboard]:
    with signed_in(address, tables, "Eva", "experimenter") as dashboard:
        yield dashboard


@pytest.fixture
def program(address: str, tables: Settings) -> Iterator[httpx.Client]:
    token = manage.add_token(tables, f"tables {uuid4()}", ["jobs"])["token"]
    with httpx.Client(
        base_url=f"{address}/api/v1/", headers={"Authorization": f"Bearer {token}"}, timeout=60
    ) as client:
        yield client


def reading(dashboard: Dashboard, name: str, **said: Any) -> str:
    page = html.unescape(dashboard.get(f"/admin/files/votes/{name}/reading", params=said).text)
    assert not re.search(r"(?<![\w-])--[a-z]", page), "a page has fields, and names no option of a command"
    return page


def test_the_three_lists_are_shown_and_the_table_analysed(eva: Dashboard) -> None:
    assert "/admin/files/votes/votes.csv/reading" in eva.get("/admin/files/votes/votes.csv").text
    page = reading(eva, "votes.csv")
    assert "It holds votes" in page
    assert "participant is the column 'judge'" in page
    assert "not used: age" in page
    assert "3 conditions: x, y, z" in page
    done = eva.act("/admin/files/votes/votes.csv/analyse")
    report = ends(eva, done.url.path)
    assert report.url.path == "/admin/files/runs/votes-analysis"
    assert "report.html" in report.text
    assert "analysis of votes or ratings" in report.text
    assert "Render films" not in report.text


def test_a_table_with_two_readings_is_asked_about_and_the_answer_reads_it(eva: Dashboard) -> None:
    page = reading(eva, "both.csv")
    assert "The columns can be read in 2 ways: which is meant?" in page
    assert "Analyse it so" not in page
    links = re.findall(r'class="button" href="(/admin/files/votes/both\.csv/reading\?[^"]+)">', page)
    answers = [html.unescape(eva.get(link).text) for link in links]
    assert [re.search(r"It holds ([a-z ]+)", answer)[1] for answer in answers] == [
        "votes",
        "ratings of one against another",
    ]  # type: ignore[index]  # each holds something


def test_a_column_gets_another_role_and_nothing_else_changes(eva: Dashboard) -> None:
    page = reading(eva, "renamed.csv")
    assert "It cannot be read yet" in page
    columns = re.findall(r'name="column" value="([^"]*)"', page)
    was = re.findall(r'name="was" value="([^"]*)"', page)
    assert columns == ["seat", "scene", "item_a", "item_b", "q7", "age"]
    role = ["participant", "", "", "", "choice", ""]
    now = reading(eva, "renamed.csv", column=columns, was=was, role=role)
    assert "participant is the column 'seat'" in now
    assert "choice is the column 'q7'" in now
    assert "not used: age" in now
    assert 'name="columns" value="' in now
    hidden = dict(re.findall(r'type="hidden" name="(columns|choices)" value="([^"]*)"', now))
    again = reading(eva, "renamed.csv", **hidden)
    assert "participant is the column 'seat'" in again


def test_a_wrong_cell_is_named_and_a_word_for_it_is_taken(eva: Dashboard) -> None:
    page = reading(eva, "wrong.csv")
    assert "choice is 'lft'" in page
    refused = eva.act("/admin/files/votes/wrong.csv/analyse")
    ended = html.unescape(ends(eva, refused.url.path).text)
    assert "choice is 'lft'" in ended
    assert "--choices" not in ended
    assert eva.get("/admin/files/votes/votes.csv/reading", params={"scale": "5:1"}).status_code == 422


def test_a_column_that_may_be_practice_is_warned_about_in_words_of_the_page(eva: Dashboard) -> None:
    page = reading(eva, "gold.csv")
    assert "“practice” for Is Gold below leaves out those of which it is true" in page
    assert "Attach the measures" not in eva.get("/admin/files/votes/gold.csv").text


def test_what_more_may_be_said_of_a_table_is_told_by_the_page_s_fields(eva: Dashboard) -> None:
    assert "'Online' (to read one: “NAME” as Sheet below)" in reading(eva, "book.xlsx")
    assert "expected 1 to 5 (another scale: “LOW:HIGH” as Scale of ratings below; " in reading(eva, "ratings.csv")
    assert "It holds ratings" in reading(eva, "ratings.csv", scale="1:9")


def test_votes_are_posted_read_and_analysed(program: httpx.Client) -> None:
    answer = program.post("votes", content=VOTES.encode()).json()
    assert (answer["holds"], answer["columns"][0]) == ("votes", {"column": "judge", "role": "participant"})
    assert {row["item"] for row in answer["analysis"]["scores"]} == {"x", "y", "z"}
    dry = program.post("votes?analyse=false&columns=participant=age", content=VOTES.encode()).json()
    assert dry["analysis"] is None
    assert {"column": "age", "role": "participant"} in dry["columns"]


def test_a_posted_table_with_two_readings_is_asked_about_as_on_the_command_line(program: httpx.Client) -> None:
    asked = program.post("votes", content=BOTH.encode())
    assert is_problem(asked, 409)
    readings = asked.json()["readings"]
    assert [reading["columns"] for reading in readings] == ["choice=choice", "rating=rating"]
    for reading, holds in zip(readings, ("votes", "comparisons"), strict=True):
        told = {key: reading[key] for key in ("columns", "choices", "format")} | {"analyse": "false"}
        assert program.post("votes", params=told, content=BOTH.encode()).json()["holds"] == holds


def test_a_posted_table_that_cannot_be_read_says_where(program: httpx.Client) -> None:
    wrong = program.post("votes", content=VOTES.replace(",a,", ",lft,", 1).encode())
    assert is_problem(wrong, 422)
    assert "choice is 'lft'" in wrong.json()["detail"]
    assert is_problem(program.post("votes?name=votes.exe", content=b"x"), 422)
    assert is_problem(program.post("votes?columns=participant", content=VOTES.encode()), 422)
