"""The page on R: its code gives our numbers, and prints what the page shows; where R is installed."""

from __future__ import annotations

import csv
import io
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from app.analysis import AnalysisSettings, analyse, read_votes

DOCS = Path(__file__).parents[3] / "docs"
TABLES = ("bradley_terry", "davidson", "contrasts", "jod")
MARK = "the tables in all digits"


def blocks(language: str) -> list[str]:
    page = (DOCS / "r.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", page, re.DOTALL | re.MULTILINE)


@pytest.fixture(scope="module")
def said() -> list[str]:
    return said_by_r(DOCS)


def said_by_r(folder: Path) -> list[str]:
    """Return what the page's code prints of a folder's file, and then each table as CSV."""
    if shutil.which("Rscript") is None:
        pytest.skip("R is not installed (package r-base-core)")
    written = "".join(f'cat("{MARK}\\n"); write.csv({name}, row.names = FALSE)\n' for name in TABLES)
    code = "".join([*blocks("r")[1:], "options(digits = 15)\n", written])
    done = subprocess.run(["Rscript", "-"], input=code, capture_output=True, text=True, cwd=folder, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout.split(f"{MARK}\n")


def test_the_page_shows_what_r_prints(said: list[str]) -> None:
    assert said[0] == "".join(blocks("text"))


def test_r_gives_our_digits(said: list[str]) -> None:
    check_digits(said, DOCS / "r_votes.csv")


def test_r_gives_our_digits_of_few_people_too(tmp_path: Path) -> None:
    header, *lines = (DOCS / "r_votes.csv").read_text(encoding="utf-8").splitlines()
    few = sorted({line.split(",")[0] for line in lines})[:9]
    kept = [header, *(line for line in lines if line.split(",")[0] in few)]
    (tmp_path / "r_votes.csv").write_text("\n".join(kept) + "\n", encoding="utf-8")
    check_digits(said_by_r(tmp_path), tmp_path / "r_votes.csv")


def check_digits(said: list[str], path: Path) -> None:
    votes = read_votes(path)
    dropped, davidson = (analyse(votes, AnalysisSettings(ties=ties)) for ties in ("drop", "davidson"))
    ours = dropped["scores"], davidson["scores"], davidson["contrasts"], davidson["scores"]
    for text, rows in zip(said[1:], ours, strict=True):
        by_r = [{name: number(value) for name, value in row.items()} for row in csv.DictReader(io.StringIO(text))]
        assert len(by_r) == len(rows)
        names = [name for name in by_r[0] if name.startswith("item")]
        by_name = {tuple(row[name] for name in names): row for row in rows}
        for row in by_r:
            assert {name: by_name[tuple(row[name] for name in names)][name] for name in row} == pytest.approx(
                row, abs=1e-8
            )


def number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text
