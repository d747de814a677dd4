"""Files of ratings: what is read, what is refused and why, and the folder that an analysis writes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from app.analysis import AnalysisSettings, analyse_file, analyse_ratings_file
from app.analysis.ratings.reading import understand_ratings
from app.analysis.ratings.table import ComparisonTable, RatingTable
from app.analysis.reading.read_votes import read_votes
from app.analysis.reading.sources import recognise_file
from app.analysis.reading.votes_table import VotesError

HEADER = "participant,dataset,condition,rating"
COMPARED = "participant,dataset,item_a,item_b,rating,first_shown"

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_rows(*rows: str, header: str = HEADER) -> Path:
        path = tmp_path / "ratings.csv"
        path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
        return path

    return write_rows


def table_in(path: Path, scale: tuple[float, float] | None = None) -> RatingTable | ComparisonTable:
    return understand_ratings(path, scale)[0]


def panel(scale: float = 1.0) -> list[str]:
    """Ratings of three conditions on two datasets by eight people, one of whom is contrary."""
    rng = np.random.default_rng(6)
    rows = []
    for person in range(8):
        for dataset in ("ball", "box"):
            for index, condition in enumerate(("low", "middle", "high")):
                quality = index if person else 2 - index
                rating = np.clip(round(1.5 + 1.3 * quality + 0.6 * rng.normal()), 1, 5) * scale
                rows.append(f"p{person},{dataset},{condition},{rating:g}")
    return rows


def test_ratings_are_read_by_name(write: Write) -> None:
    table = table_in(write("ann,ball,x,4", "bob,ball,x,2.5", "ann,ball,y,1"))
    assert isinstance(table, RatingTable)
    assert (table.participants, table.items) == (("ann", "bob"), (("ball", "x"), ("ball", "y")))
    assert (table.person.tolist(), table.item.tolist()) == ([0, 1, 0], [0, 0, 1])
    assert (table.rating.tolist(), table.protocol, table.low, table.high) == ([4, 2.5, 1], "acr", 1, 5)


def test_long_numbers_that_name_participants_stay_apart(tmp_path: Path) -> None:
    rows = {
        "participant": [1234567.0, 1234568.0],
        "dataset": ["ball"] * 2,
        "condition": ["x"] * 2,
        "rating": [4.0, 2.5],
    }
    pd.DataFrame(rows).to_parquet(tmp_path / "ratings.parquet")
    table = table_in(tmp_path / "ratings.parquet")
    assert table.participants == ("1234567", "1234568")
    assert table.rating.tolist() == [4, 2.5]


def test_a_cell_that_holds_a_list_is_refused_by_row(tmp_path: Path) -> None:
    rows = [{"participant": "ann", "x": 4, "y": [1, 2]}, {"participant": "bob", "x": 3, "y": 2}]
    (tmp_path / "ratings.json").write_text(json.dumps(rows))
    with pytest.raises(VotesError, match="found participant, x, y"):
        table_in(tmp_path / "ratings.json")


def test_the_reference_and_the_protocol_are_read(write: Write) -> None:
    table = table_in(
        write("ann,ball,x,4,acr-hr,false", "ann,ball,original,5,acr-hr,true", header=f"{HEADER},protocol,reference")
    )
    assert isinstance(table, RatingTable)
    assert (table.protocol, table.is_reference.tolist()) == ("acr-hr", [False, True])


def test_a_protocol_may_be_written_in_capitals(tmp_path: Path) -> None:
    for name, other, protocol in (("condition", "", "DCR"), ("item_a", "y,", "Ccr")):
        columns = f"participant,dataset,{name},{'item_b,' if other else ''}rating,protocol"
        (tmp_path / "r.csv").write_text(f"{columns}\np1,ball,x,{other}2,{protocol}\n", encoding="utf-8")
        assert len(table_in(tmp_path / "r.csv")) == 1


def test_comparisons_are_known_by_their_columns(write: Write) -> None:
    table = table_in(write("ann,ball,x,y,-2,y", "bob,ball,y,x,1,", header=COMPARED))
    assert isinstance(table, ComparisonTable)
    assert (table.rating.tolist(), table.a_first.tolist()) == ([-2, 1], [False, True])


@pytest.mark.parametrize(
    ("rows", "header", "says"),
    [
        (["a,d,x,6"], HEADER, "row 1: rating is 6, expected 1 to 5 (another scale: --scale LOW:HIGH; a code"),
        (["a,d,x,3", "a,d,y,nan"], HEADER, "row 2: rating is empty"),
        (["a,d,x,"], HEADER, "row 1: rating is empty"),
        (["a,d,x,good"], HEADER, "row 1: rating is 'good', expected a number"),
        ([",d,x,3"], HEADER, "row 1: participant is empty"),
        (["a,d,x,3,mushra"], f"{HEADER},protocol", "row 1: protocol is 'mushra', expected acr, acr-hr, dcr"),
        (["a,d,x,3,acr", "a,d,y,3,dcr"], f"{HEADER},protocol", "row 2: protocol is dcr, in the rows above acr"),
        (
            ["a,d,x,3,acr-hr"],
            f"{HEADER},protocol",
            "has the protocol acr-hr, but no row whose column reference is true",
        ),
        (["a,d,x,3,maybe"], f"{HEADER},reference", "row 1: reference is 'maybe', expected true or false"),
        (["a,d,x,3,true", "b,d,x,3,false"], f"{HEADER},reference", "row 2: x of d is not the reference here"),
        (["a,x,3,true", "b,x,3,false"], "participant,condition,rating,reference", "row 2: x is not the reference here"),
        (["a,d,x,3,true", "b,d,y,3,true"], f"{HEADER},reference", "the dataset 'd' has several references"),
        (["a,d,3"], "participant,dataset,rating", "lacks the column condition; found participant, dataset, rating"),
        ([], HEADER, "has no row, expected at least one rating"),
        (["a,d,x,x,1,x"], COMPARED, "row 1: the item 'x' is compared with itself"),
        (["a,d,x,y,4,x"], COMPARED, "row 1: rating is 4, expected -3 to 3"),
        (["a,d,x,y,1,z"], COMPARED, "row 1: first_shown is 'z', expected 'x' or 'y' or nothing"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(write: Write, rows: list[str], header: str, says: str) -> None:
    path = write(*rows, header=header)
    with pytest.raises(VotesError) as refusal:
        table_in(path)
    assert str(refusal.value).startswith(f"{path}: ")
    assert says in str(refusal.value)


@pytest.mark.parametrize("rows", [[], ["a,d,x,", "a,d,y,"]])
def test_a_table_of_ratings_without_any_is_known_as_such(write: Write, rows: list[str]) -> None:
    assert not recognise_file(write(*rows, header=HEADER)).holds_votes


def test_another_scale_is_accepted_when_it_is_named(write: Write) -> None:
    table = table_in(write("a,d,x,87.5"), (0.0, 100.0))
    assert (table.rating.tolist(), table.high) == ([87.5], 100.0)


@pytest.mark.parametrize(
    ("table", "note"),
    [
        (
            "Observer;PVS;Opinion score\nann;x;4\nann;y;2,5\nbob;x;3",
            "participant is the column 'Observer'; condition is the column 'PVS'; rating is the column 'Opinion score'",
        ),
        ("subject\tx\ty\nann\t4\t2.5\nbob\t3\t", "a row for each participant, a column for each of 2 conditions"),
        ("HRC,ann,bob\nx,4,3\ny,2.5,", "a row for each condition, a column for each of 2 participants"),
    ],
)
def test_tables_in_other_words_and_shapes_are_the_same_ratings(tmp_path: Path, table: str, note: str) -> None:
    path = tmp_path / "ratings.tsv"
    path.write_text(table, encoding="utf-8-sig")
    ratings, understood = understand_ratings(path)
    assert isinstance(ratings, RatingTable)
    people, items = np.array(ratings.participants)[ratings.person], [ratings.items[item] for item in ratings.item]
    assert {*zip(people.tolist(), items, ratings.rating.tolist(), strict=True)} == {
        ("ann", ("", "x"), 4.0),
        ("ann", ("", "y"), 2.5),
        ("bob", ("", "x"), 3.0),
    }
    assert "3 ratings by 2 participants of 2 items" in understood[0]
    assert note in understood[0]


def test_a_wide_table_has_datasets_and_names_the_cell_that_is_no_rating(write: Write) -> None:
    table = table_in(write("ann,ball,4,3", "ann,box,2,1", header="participant,scene,x,y"))
    assert table.items == (("ball", "x"), ("box", "x"), ("ball", "y"), ("box", "y"))
    with pytest.raises(VotesError, match="row 2: the column 'y' is 31, expected 1 to 5"):
        table_in(write("ann,4,5", "bob,3,31", header="participant,x,y"))


@pytest.mark.parametrize(
    "table",
    [
        "model,x,y\nx,,3\ny,1,",
        "participant,left,right,winner,score\nann,x,y,left,3",
        "participant,item_a,item_b,choice,rating\nann,x,y,a,",
        "winner,loser,participant\nx,y,1",
        "participant,x vs y,x vs z\nann,x,z",
    ],
)
def test_tables_of_votes_are_not_taken_for_ratings(tmp_path: Path, table: str) -> None:
    path = tmp_path / "votes.csv"
    path.write_text(table, encoding="utf-8")
    assert recognise_file(path).holds_votes
    assert read_votes(path).n_votes > 0


@pytest.mark.slow
def test_the_folder_holds_tables_figures_and_a_report(write: Write, tmp_path: Path) -> None:
    out = tmp_path / "out"
    analysis = analyse_ratings_file(write(*panel()), out)
    assert json.loads((out / "analysis.json").read_text(encoding="utf-8")) == analysis
    tables = {"rating_items.csv", "rating_conditions.csv", "rating_contrasts.csv", "rating_model.csv", "raters.csv"}
    assert {path.name for path in out.glob("*.csv")} == tables
    assert {path.name for path in (out / "figures").glob("*.svg")} == {"opinion_scores.svg", "raters.svg"}
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Mean opinion scores" in page
    assert "Participants who rated" in page
    assert "Bradley-Terry" not in page
    assert "ITU-R BT.500" in (out / "report.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_contrary_participant_is_named_and_still_counts(write: Write, tmp_path: Path) -> None:
    analysis = analyse_ratings_file(write(*panel()), tmp_path / "out")
    flagged = [row["participant"] for row in analysis["raters"] if row["flags"]]
    assert flagged == ["p0"]
    assert any("look at p0" in warning for warning in analysis["warnings"])
    assert all(row["n"] == 8 for row in analysis["rating_items"])


@pytest.mark.slow
def test_ratings_of_fewer_people_than_planned_are_interim(write: Write, tmp_path: Path) -> None:
    early = analyse_ratings_file(write(*panel()), tmp_path / "early", planned=22)
    assert early["findings"][0]["text"].startswith("Interim: 8 of 22 planned participants. Do not conclude")
    enough = analyse_ratings_file(write(*panel()), tmp_path / "enough", planned=8)
    assert all(found["about"] != "interim" for found in enough["findings"])


@pytest.mark.slow
def test_who_is_excluded_does_not_count(write: Write, tmp_path: Path) -> None:
    path = write(*panel())
    analysis = analyse_ratings_file(path, tmp_path / "out", exclude=("p0",))
    assert analysis["settings"]["exclude"] == ["p0"]
    assert {row["participant"] for row in analysis["raters"]} == {f"p{index}" for index in range(1, 8)}
    with pytest.raises(VotesError, match="'zoe', is not among the 8 who rated"):
        analyse_ratings_file(path, tmp_path / "other", exclude=("zoe",))
    assert not (tmp_path / "other").exists()


@pytest.mark.slow
def test_all_numbers_scale_with_the_scale(write: Write, tmp_path: Path) -> None:
    small = analyse_ratings_file(write(*panel()), tmp_path / "small")
    large = analyse_ratings_file(write(*panel(20.0)), tmp_path / "large", (20.0, 100.0))
    for row, other in zip(small["rating_items"], large["rating_items"], strict=True):
        for name in ("mos", "sd", "ci_low", "quality", "quality_se"):
            assert other[name] == pytest.approx(20 * row[name], rel=1e-6)
    for row, other in zip(small["raters"], large["raters"], strict=True):
        assert other["correlation"] == pytest.approx(row["correlation"])


@pytest.mark.slow
def test_votes_and_ratings_of_the_same_items_share_a_scale(write: Write, tmp_path: Path) -> None:
    ratings = write(*panel())
    votes = tmp_path / "votes.csv"
    lines = ["participant,dataset,item_a,item_b,choice"]
    rng = np.random.default_rng(1)
    for person in range(8):
        for dataset in ("ball", "box"):
            for a, b in (("low", "middle"), ("low", "high"), ("middle", "high")):
                lines.append(f"p{person},{dataset},{a},{b},{'b' if rng.random() < 0.8 else 'a'}")
    votes.write_text("\n".join([*lines, ""]), encoding="utf-8")
    analysis = analyse_file(votes, tmp_path / "out", ratings=ratings)
    assert analysis["alignment"][0]["status"] == "ok"
    assert len(analysis["alignment_items"]) == 6
    assert analysis["scores"]
    assert analysis["understood"][1].startswith(f"{ratings.name}: text in UTF-8, commas between cells; ")
    assert analysis["understood"][2].endswith(" more are in several files and counted as the same people")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Ratings and votes on one scale" in page
    assert (tmp_path / "out" / "alignment_items.csv").exists()
    less = tmp_path / "less.csv"  # p7 rated and did not vote
    less.write_text("\n".join(line for line in lines if not line.startswith("p7")), encoding="utf-8")
    without = analyse_file(less, tmp_path / "without", settings=AnalysisSettings(exclude=("p0", "p7")), ratings=ratings)
    assert without["settings"]["exclude"] == ["p0", "p7"]
    assert {row["participant"] for row in without["raters"]} == {f"p{index}" for index in range(1, 7)}
    with pytest.raises(ValueError, match="'zoe', is not among"):
        analyse_file(less, tmp_path / "zoe", settings=AnalysisSettings(exclude=("zoe",)), ratings=ratings)


def test_comparisons_cannot_be_put_on_a_scale_with_votes(write: Write, tmp_path: Path) -> None:
    path = write("ann,ball,x,y,-2,y", header=COMPARED)
    votes = tmp_path / "votes.csv"
    votes.write_text("participant,dataset,item_a,item_b,choice\nann,ball,x,y,a\n", encoding="utf-8")
    with pytest.raises(VotesError, match="compares items, expected ratings of single ones"):
        analyse_file(votes, tmp_path / "out", ratings=path)


def test_comparisons_have_a_report_of_their_own(write: Write, tmp_path: Path) -> None:
    rows = [f"p{p},ball,x,y,{1 + p % 2},{'x' if p < 3 else 'y'}" for p in range(6)]
    analysis = analyse_ratings_file(write(*rows, header=COMPARED), tmp_path / "out")
    assert analysis["comparison_pairs"][0]["n_ratings"] == 6
    assert "Comparison ratings" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "out" / "comparison_items.csv").exists()
