"""An erasure is on the list that every restore applies, or it has not happened."""

from __future__ import annotations

import json
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from sqlalchemy import func, insert, select, update

from app.errors import UnavailableError
from app.operations.upkeep.backup import back_up, restore
from app.operations.upkeep.erasure import LIST, enforce_retention, erase_participant
from app.settings import Settings
from app.store.database.engine import Database, open_database
from app.store.database.migrate import upgrade
from app.store.database.tables import participant, session, stage_record, study
from app.store.participants.participants import participant_labelled
from app.store.studies.audit import Actor
from app.store.studies.studies import set_standing, study_by_slug
from tests.seeded_studies import NOW, seed_voters

EARLIER = json.dumps({"session": "x" * 22, "at": NOW.isoformat()}) + "\n"
MANY = 40_000  # so that the list is the longest file of the server


@contextmanager
def no_file_grows_past(n_bytes: int) -> Iterator[None]:
    """Writing takes what still fits, then nothing, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    settings = Settings(data_dir=tmp_path / "data", database_url=None)
    with open_database(settings.url) as database:
        upgrade(database)
        seed_voters(database, 2, 3)
    return settings


def erase(settings: Settings, database: Database, label: str) -> None:
    with database.reading() as connection:
        study = study_by_slug(connection, "test")
        assert study is not None
        person = participant_labelled(connection, study.id, label)
    erase_participant(settings, database, study, person, Actor(0, "Eva", NOW))


def erased(settings: Settings) -> set[str]:
    with open_database(settings.url) as database, database.reading() as connection:
        return set(connection.scalars(select(participant.c.label).where(participant.c.erased_at.is_not(None))))


@pytest.mark.slow
@pytest.mark.parametrize("n_left", [0, 10])
def test_who_cannot_be_noted_on_a_full_disk_is_not_erased(settings: Settings, tmp_path: Path, n_left: int) -> None:
    back_up(settings, tmp_path / "before.zip")
    noted = settings.data_dir / LIST
    noted.write_text(EARLIER * MANY)
    with open_database(settings.url) as database:
        with (
            no_file_grows_past(noted.stat().st_size + n_left),
            pytest.raises(UnavailableError, match="disk is full"),
        ):
            erase(settings, database, "P001")
        assert erased(settings) == set()
        assert noted.read_text() == EARLIER * MANY
        erase(settings, database, "P001")
    noted.write_text("".join(noted.read_text().splitlines(keepends=True)[MANY:]))
    assert restore(settings, tmp_path / "before.zip", replace=True)["erased_again"] == 1
    assert erased(settings) == {"P001"}


@pytest.mark.slow
def test_a_line_that_a_power_cut_tore_takes_no_later_one_with_it(settings: Settings, tmp_path: Path) -> None:
    back_up(settings, tmp_path / "before.zip")
    noted = settings.data_dir / LIST
    noted.write_text(EARLIER + EARLIER[:20])
    with open_database(settings.url) as database:
        erase(settings, database, "P002")
    with pytest.raises(ValueError, match=f"{LIST}, line 2: is no erasure.*tore the line, delete it"):
        restore(settings, tmp_path / "before.zip", replace=True)
    lines = noted.read_text().splitlines(keepends=True)
    noted.write_text(lines[0] + lines[2])
    assert restore(settings, tmp_path / "before.zip", replace=True)["erased_again"] == 1
    assert erased(settings) == {"P002"}


def answer(database: Database, label: str, at: datetime) -> None:
    """Let a participant answer the questionnaire."""
    with database.writing() as connection:
        theirs = select(session.c.id).join(participant).where(participant.c.label == label).scalar_subquery()
        row = {"session_id": theirs, "stage": "interview", "data": {"answers": {}}, "completed_at": at}
        connection.execute(insert(stage_record).values(**row))


def n_answers(settings: Settings) -> int:
    with open_database(settings.url) as database, database.reading() as connection:
        return connection.scalar(select(func.count()).select_from(stage_record)) or 0


@pytest.mark.slow
def test_a_restore_deletes_no_answers_that_were_given_after_the_study_had_forgotten_its_people(
    settings: Settings, tmp_path: Path
) -> None:
    first_end, again, second_end = (NOW + timedelta(days=days) for days in (11, 12, 40))
    with open_database(settings.url) as database:
        with database.writing() as connection:
            keeps = {"privacy": {"keep_days": 10}}
            study_id = connection.execute(update(study).values(options=keeps).returning(study.c.id)).scalar_one()
            set_standing(connection, study_id, "closed", NOW)
        answer(database, "P001", NOW)
        back_up(settings, tmp_path / "first.zip")
        assert enforce_retention(settings, database, first_end) == ["test"]
        with database.writing() as connection:
            set_standing(connection, study_id, "open", again)
        answer(database, "P002", again)
        back_up(settings, tmp_path / "second.zip")
    assert restore(settings, tmp_path / "second.zip", replace=True)["erased_again"] == 0
    assert n_answers(settings) == 1
    with open_database(settings.url) as database:
        with database.writing() as connection:
            set_standing(connection, study_id, "closed", again)
        assert enforce_retention(settings, database, second_end) == ["test"]
    for backup in ("first.zip", "second.zip"):
        assert restore(settings, tmp_path / backup, replace=True)["erased_again"] >= 1
        assert n_answers(settings) == 0, backup
