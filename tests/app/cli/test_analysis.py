"""Votes and ratings become scores by the command line."""

from __future__ import annotations

import html
import json
from pathlib import Path

import numpy as np
import pytest

from app import main
from app.main import running_server
from app.operations.running import noted
from app.settings import Settings
from tests.command_line import Command


@pytest.mark.slow
def test_simulated_participants_fill_a_study(
    command: Command, stimuli: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command("study", "create", stimuli, "--name", "Tiny", "--seed", 1)
    (tmp_path / "abilities.json").write_text('{"id_fa": -3, "id_fb": 3}')
    told = command(
        "simulate", "--study", "tiny", "--participants", 3, "--abilities", tmp_path / "abilities.json", "--json"
    )
    assert told.code == 0, told.err
    result = json.loads(told.out)
    assert result["votes"] == 3
    assert result["put_in"] == {"id_fa": -3, "id_fb": 3}
    assert result["came_out"].keys() == {"id_fa", "id_fb"}
    with running_server(Settings()) as url, noted(Settings(), url), monkeypatch.context() as patched:
        patched.setattr(main, "running_server", lambda *_: pytest.fail("a second server began to serve the folder"))
        told = command("simulate", "--study", "tiny", "--participants", 1)
    assert "Put in: artificial people prefer id_fb +0.75, id_fa -0.75 (log-odds), in the paper's order" in told.out
    assert "\nCame out: id_fb +" in told.out
    assert "the order that was put in." in told.out
    assert "4 of 4 participants finished, 4 votes" in command("study", "list").out


VOTES = "participant,dataset,item_a,item_b,choice\np1,ball,x,y,a\np2,ball,x,y,b\np3,ball,x,y,a\np4,ball,x,y,none\n"


@pytest.mark.slow
def test_votes_become_scores_tables_and_a_report(command: Command, tmp_path: Path) -> None:
    (tmp_path / "votes.csv").write_text(VOTES)
    dry = command("analyse", tmp_path / "votes.csv", "--dry-run")
    assert "votes.csv: text in UTF-8, commas between cells; 4 rows, 4 votes" in dry.out
    (tmp_path / "ratings.csv").write_text("participant,dataset,condition,rating\nr1,ball,x,4\n")
    both = command("analyse", tmp_path / "votes.csv", "--ratings", tmp_path / "ratings.csv", "--dry-run")
    assert "ratings.csv: text in UTF-8, commas between cells; 1 rating by 1 participant of 1 item" in both.out
    assert not (tmp_path / "out").exists()
    assert "--out is missing" in command("analyse", tmp_path / "votes.csv").err
    told = command("analyse", tmp_path / "votes.csv", "-o", tmp_path / "out", "--json", "--width", "one")
    assert told.code == 0, told.err
    report = html.unescape((tmp_path / "out" / "report.html").read_text()).replace("\u00a0", " ")
    assert all(row["text"] in report for row in json.loads(told.out)["findings"])
    scores = {row["item"]: row["score"] for row in json.loads(told.out)["scores"] if row["dataset"] == "all"}
    assert scores["x"] == pytest.approx(np.log(2) / 2, abs=1e-6)  # two wins to one: the ties favour neither
    for name in ("analysis.json", "scores.csv", "triads.csv", "observers.csv", "report.html"):
        assert (tmp_path / "out" / name).stat().st_size > 0


def test_a_dry_run_reads_the_files_beside_the_votes_too(command: Command, tmp_path: Path) -> None:
    files = {
        "votes": VOTES,
        "items": "item,depth\nx,id\ny,pm\n",
        "people": "participant,age\np1,old\np2,old\np3,young\np4,young\n",
        "measures": "dataset,item,psnr\nball,x,30\nball,y,31\nbox,x,9\n",
    }
    for name, text in files.items():
        (tmp_path / f"{name}.csv").write_text(text)
    votes, items, people, measures = (tmp_path / f"{name}.csv" for name in files)
    asked = ("analyse", votes, "--items", items, "--participants", people, "--measures", measures, "--dry-run")
    told = command(*asked)
    assert told.code == 0, told.err
    for sentence in ("Factor depth: id, pm", "Grouping age: old, young", "Measures: psnr", "measures: box/x not among"):
        assert sentence in told.out
    wrong = command(*asked, "--factor", "fusion")
    assert wrong.code == 1
    assert "has no factor 'fusion'; it has depth" in wrong.err


def test_a_dry_run_of_ratings_reads_their_measures(command: Command, tmp_path: Path) -> None:
    (tmp_path / "ratings.csv").write_text(RATINGS)
    (tmp_path / "measures.csv").write_text("dataset,item,psnr\nbox,x,30\n")
    told = command("analyse", tmp_path / "ratings.csv", "--measures", tmp_path / "measures.csv", "--dry-run")
    assert told.code == 1
    assert "measures box/x; the ratings are on x, y, z" in told.err


def test_an_unknown_choice_is_named_with_its_row(command: Command, tmp_path: Path) -> None:
    (tmp_path / "votes.csv").write_text(VOTES.replace("p3,ball,x,y,a", "p3,ball,x,y,left"))
    told = command("analyse", tmp_path / "votes.csv", "-o", tmp_path / "out")
    assert told.code == 1
    assert "votes.csv: row 3" in told.err
    assert "'left'" in told.err
    assert not (tmp_path / "out").exists()


RATINGS = "participant,dataset,condition,rating\n" + "".join(
    f"p{p},ball,{item},{rating + p % 2}\n" for p in range(4) for item, rating in (("x", 1), ("y", 3), ("z", 4))
)


ASKED = "participant,item_a,item_b,choice,rating\n" + "".join(f"P{n},x,y,{'ab'[n % 2]},{n % 3}\n" for n in range(6))


def test_what_can_be_read_in_two_ways_is_shown_with_the_options_and_each_is_taken(
    command: Command, tmp_path: Path
) -> None:
    (tmp_path / "table.csv").write_text(ASKED)
    told = command("analyse", tmp_path / "table.csv", "--dry-run")
    assert told.code == 1
    assert "1. votes: 'choice' says which item is preferred: --columns choice=choice" in told.err
    assert "2. comparison ratings: 'rating' is the grade: --columns rating=rating" in told.err
    votes = command("analyse", tmp_path / "table.csv", "--dry-run", "--columns", "choice=choice")
    assert "choices: a 3, b 3, none 0" in votes.out
    ratings = command("analyse", tmp_path / "table.csv", "--dry-run", "--columns", "rating=rating")
    assert "ratings: 0 2x, 1 2x, 2 2x" in ratings.out


def test_a_question_is_answered_at_once_in_a_terminal(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from app.analysis.reading.description import Told
    from app.cli import analysis

    (tmp_path / "table.csv").write_text(ASKED)
    monkeypatch.setattr(analysis.sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(analysis.sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(analysis.typer, "prompt", lambda *_, **__: "2")
    (source,) = analysis._recognised([tmp_path / "table.csv"], Told(), can_ask=True)
    assert source.description.holds == "comparisons"


def test_ratings_take_the_same_columns_and_formats_as_votes(command: Command, tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_bytes("who;what;how\nJ\xfcrgen;x;3\nAnn;x;4\n".encode("latin-1"))
    told = ("--columns", "participant=who,condition=what,rating=how", "--encoding", "latin-1", "--format", "ratings")
    dry = command("analyse", tmp_path / "r.csv", "--dry-run", *told)
    assert "2 participants: J\xfcrgen, Ann; 1 condition: x" in dry.out
    wrong = command("analyse", tmp_path / "r.csv", "--dry-run", *told[:4], "--format", "nonsense")
    assert "--format nonsense is not known; known are votes, ratings, ccr" in wrong.err


@pytest.mark.slow
def test_ratings_become_opinion_scores_and_a_report(command: Command, tmp_path: Path) -> None:
    (tmp_path / "ratings.csv").write_text(RATINGS)
    told = command("analyse", tmp_path / "ratings.csv", "-o", tmp_path / "out")
    assert told.code == 0, told.err
    lines = [line.split() for line in told.out.splitlines() if line.startswith("  ")]
    assert [line[:2] for line in lines] == [["z", "4.50"], ["y", "3.50"], ["x", "1.50"]]
    assert "4 participants are few" in told.out
    for name in ("analysis.json", "rating_items.csv", "raters.csv", "report.html"):
        assert (tmp_path / "out" / name).stat().st_size > 0


@pytest.mark.parametrize(
    ("options", "code", "says"),
    [
        (("--scale", "1:4"), 1, "row 6: rating is 5, expected 1 to 4"),
        (("--scale", "5"), 2, "expected two numbers"),
        (("--scale", "5:1"), 2, "expected its low end first"),
        (("--ties", "half"), 2, "--ties is for votes"),
    ],
)
def test_options_that_do_not_fit_ratings_are_refused(
    command: Command, tmp_path: Path, options: tuple[str, str], code: int, says: str
) -> None:
    (tmp_path / "ratings.csv").write_text(RATINGS)
    told = command("analyse", tmp_path / "ratings.csv", "-o", tmp_path / "out", *options)
    assert told.code == code
    assert says in " ".join(told.err.replace("│", " ").split())
    assert not (tmp_path / "out").exists()


def test_a_scale_of_votes_is_refused(command: Command, tmp_path: Path) -> None:
    (tmp_path / "votes.csv").write_text(VOTES)
    told = command("analyse", tmp_path / "votes.csv", "-o", tmp_path / "out", "--scale", "1:5")
    assert told.code == 2
    assert "--ratings FILE" in told.err


@pytest.mark.parametrize("dry_run", [(), ("--dry-run",)])
@pytest.mark.parametrize(
    ("option", "value", "says"),
    [
        ("--ties", "davison", "ties is 'davison', expected one of davidson"),
        ("--penalty", "lasso", "penalty is 'lasso', expected one of firth"),
        ("--equivalence", "-1", "expected a number of JOD above 0"),
        ("--columns", "item_a=x,item_a=y", "--columns names item_a twice"),
        ("--choices", "a=1,a=first", "--choices names a twice"),
    ],
)
def test_values_that_an_option_does_not_take_are_wrong_use(
    command: Command, tmp_path: Path, option: str, value: str, says: str, dry_run: tuple[str, ...]
) -> None:
    (tmp_path / "votes.csv").write_text(VOTES)
    told = command("analyse", tmp_path / "votes.csv", "-o", tmp_path / "out", option, value, *dry_run)
    assert told.code == 2
    assert says in " ".join(told.err.replace("│", " ").split())
    assert not (tmp_path / "out").exists()


def test_a_file_of_utf_16_that_is_cut_off_is_named(command: Command, tmp_path: Path) -> None:
    (tmp_path / "votes.csv").write_bytes(VOTES.encode("utf-16")[:-1])
    told = command("analyse", tmp_path / "votes.csv", "--dry-run")
    assert told.code == 1
    assert "votes.csv: begins as UTF-16, and cannot be read as such: truncated data" in told.err


@pytest.mark.parametrize("value", ["NaN", "1e400", "true", '"1"'])
def test_abilities_that_are_no_numbers_are_refused(command: Command, tmp_path: Path, value: str) -> None:
    (tmp_path / "abilities.json").write_text(f'{{"id_fa": {value}}}')
    told = command("simulate", "--study", "any", "--abilities", tmp_path / "abilities.json")
    assert told.code == 1
    assert "the ability of id_fa is" in told.err


@pytest.mark.slow
def test_published_scores_come_back_from_the_votes(command: Command, real_data: Path, tmp_path: Path) -> None:
    votes = real_data / "votes/pwcmp_tone_mapping.csv"
    told = command("analyse", votes, "-o", tmp_path / "out", "--json")
    assert told.code == 0, told.err
    analysis = json.loads(told.out)
    pooled = [row for row in analysis["scores"] if row["dataset"] == "all" and row["comparison"] == "all"]
    assert {row["item"]: round(row["score"], 3) for row in pooled} == {
        "irawan05": 1.187,
        "mantiuk08": 0.678,
        "tmo_camera": 0.425,
        "ronan12": 0.046,
        "ferwerda96": -0.118,
        "pattanaik00": -0.628,
        "hateren06": -1.59,
    }
    assert sum(row["circular"] for row in analysis["triads"]) == 0
