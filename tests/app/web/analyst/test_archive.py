"""A study's archive is of one moment, and needs no more memory the more was voted."""

from __future__ import annotations

import csv
import io
import json
import tomllib
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import SpooledTemporaryFile
from typing import Any

import httpx
import pytest
from sqlalchemy import Connection

from app.settings import Settings
from app.store.database.engine import open_database
from app.store.database.migrate import upgrade
from app.store.studies.studies import study_by_slug
from app.store.trials.trial_records import trial_records
from app.store.trials.vote_records import keep_votes, vote_records
from app.web.analyst import archive, routes
from app.web.analyst.formats import IN_MEMORY
from tests.app.web.admin.dashboard_client import Dashboard
from tests.seeded_studies import seed_voters

N_TRIALS = 25_000


def trials(*_: object) -> Iterator[dict[str, Any]]:
    for number in range(N_TRIALS):
        switches = [{"to": "b", "at_ms": at_ms, "frame": number} for at_ms in (100.5, 900.25, 1700.125)]
        yield {"trial": f"trial {number}", "participant": "P001", "viewing": {"switches": switches}}


@pytest.mark.slow
def test_an_archive_of_many_trials_takes_little_memory(
    settings: Settings, study: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archive, "trial_records", trials)
    database = open_database(settings.url)
    with database.reading() as connection:
        of = study_by_slug(connection, study["slug"])
    assert of is not None
    with SpooledTemporaryFile(IN_MEMORY) as content:
        tracemalloc.start()
        archive.write_archive(content, database, of.id)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        with zipfile.ZipFile(content) as written:
            size = written.getinfo(f"{of.slug}/trials.csv").file_size
    database.dispose()
    assert size > 4 * IN_MEMORY
    assert peak < 3 * IN_MEMORY


@pytest.mark.slow
def test_an_archive_is_of_one_moment_while_votes_come_in(
    tmp_path: Path, new_database_url: Callable[[], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    database = open_database(new_database_url())
    upgrade(database)
    (voter,) = seed_voters(database, 1, 3)
    votes = [voter.vote(number) for number in range(len(voter.trials))]
    keep_votes(database, votes[:1])

    def trials_after_a_vote(connection: Connection, study_id: int) -> Iterator[dict[str, Any]]:
        keep_votes(database, votes[1:])
        return trial_records(connection, study_id)

    monkeypatch.setattr(archive, "trial_records", trials_after_a_vote)
    with database.reading() as connection:
        of = study_by_slug(connection, "test")
    assert of is not None
    with (tmp_path / "archive.zip").open("wb") as out:
        archive.write_archive(out, database, of.id)
    with database.reading() as connection:
        assert len(list(vote_records(connection, of.id))) == 3
    database.dispose()
    with zipfile.ZipFile(tmp_path / "archive.zip") as written:
        tables = {
            name: list(csv.DictReader(written.read(f"test/{name}.csv").decode().splitlines()))
            for name in ("votes", "trials", "participants")
        }
        analysis = json.loads(written.read("test/analysis.json"))
        report = written.read("test/report.html").decode()
        figures = {f"test/figures/scores.{kind}" for kind in ("svg", "png", "pdf")}
        assert figures <= set(written.namelist())
        assert all(f"{name}\n".removeprefix("test/") in written.read("test/SHA256SUMS").decode() for name in figures)
    assert len(tables["votes"]) == 1
    assert sum(bool(row["choice"]) for row in tables["trials"]) == 1
    assert [row["n_votes"] for row in tables["participants"]] == ["1"]
    assert sum(row["n_votes"] for row in analysis["observers"]) == 1
    assert analysis["findings"][0]["text"].split(",")[0] in report


@pytest.mark.slow
def test_an_archive_describes_the_study_of_which_its_tables_are(
    experimenter: Dashboard,
    analyst: httpx.Client,
    new_study: Callable[[], dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    slug = new_study()["slug"]

    def written_after_an_edit(*given: Any) -> None:
        edited = experimenter.act(f"/admin/studies/{slug}/edit", revision=1, name="Renamed", exposure_s=2.5)
        assert edited.status_code == 200
        archive.write_archive(*given)

    monkeypatch.setattr(routes, "write_archive", written_after_an_edit)
    content = analyst.get(f"/api/v1/studies/{slug}/archive.zip").content
    with zipfile.ZipFile(io.BytesIO(content)) as written:
        assert b"study edited" in written.read(f"{slug}/audit.csv")
        assert written.read(f"{slug}/README.md").startswith(b"# Renamed\n")
        study_file = tomllib.loads(written.read(f"{slug}/study.toml").decode())
    assert (study_file["name"], study_file["exposure_s"]) == ("Renamed", 2.5)
