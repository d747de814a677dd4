from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    Connection,
    DateTime,
    Float,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    insert,
    inspect,
    select,
    text,
)

from app.store.database.engine import Database, open_database
from app.store.database.migrate import newest_version, revisions, upgrade, upgrade_within, version_of, why_not_ready
from app.store.database.tables import metadata
from app.store.participants.participants import exclusion_records
from app.store.studies.studies import study_by_slug
from app.study.options.options import StudyOptions, parse_options
from app.study.options.wording import missing_texts, own_texts

ROOT = Path(__file__).parents[4]
REVISIONS = revisions()[::-1]
SOME_REVISIONS = [*REVISIONS[:-7:3], *REVISIONS[-7:-1]]  # the first goes all the way, the newest change most
CHECKED = {
    "study.state": "open",
    "assignment.a_half": "top",
    "assignment.first_shown": "a",
    "assignment.role": "identical",
    "measurement.direction": "less is better",
    "vote.choice": "none",
    "vote.first_shown": "b",
    "job.state": "done",
    "queued_job.state": "queued",
    "screening_test.test": "colour",
    "screening_entry.test": "acuity",
    "comment_tagging.source": "written",
    "model.kind": "mesh",
    "single_film.strip": "reference",
}


def test_the_migrated_schema_is_the_one_in_the_code(database: Database) -> None:
    is_sqlite = database.engine.dialect.name == "sqlite"  # PostgreSQL cannot compare the defaults of JSON columns
    with database.reading() as connection:
        opts = {"compare_type": True, "compare_server_default": is_sqlite}
        assert compare_metadata(MigrationContext.configure(connection, opts=opts), metadata) == []


def test_checks_are_migrated_too(database: Database, new_database_url: Callable[[], str]) -> None:
    """Alembic does not compare CHECK constraints."""
    direct = open_database(new_database_url())
    with direct.writing() as connection:
        metadata.create_all(connection)
    assert checks(database) == checks(direct)
    assert len(checks(database)) > 0
    direct.dispose()


def checks(database: Database) -> set[tuple[str, str | None, str]]:
    with database.reading() as connection:
        found = inspect(connection)
        return {
            (table, check["name"], check["sqltext"])
            for table in metadata.tables
            for check in found.get_check_constraints(table)
        }


def test_upgrading_again_changes_nothing(database: Database) -> None:
    assert upgrade(database) == version_of(database) == newest_version()
    assert why_not_ready(database) is None


def test_a_new_database_is_not_ready(tmp_path: Path) -> None:
    database = open_database(f"sqlite:///{tmp_path / 'new.sqlite'}")
    assert "reconstudy db upgrade" in (why_not_ready(database) or "")
    database.dispose()


def test_a_database_of_a_newer_program_is_left_as_it_is_with_a_word_on_what_to_do(database: Database) -> None:
    with database.writing() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    told = "at version 9999, which this program does not know"
    assert told in (why_not_ready(database) or "")
    with pytest.raises(ValueError, match=f"{told}.*install the version of reconstudy that upgraded it"):
        upgrade(database)
    assert version_of(database) == "9999"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("new_database_url", "revision"),
    [*product(["sqlite"], SOME_REVISIONS), *product(["postgresql"], SOME_REVISIONS[::3])],
    indirect=["new_database_url"],
)
def test_rows_of_every_older_version_live_on(new_database_url: Callable[[], str], revision: str) -> None:
    database = open_database(new_database_url())
    with database.writing() as connection:
        upgrade_within(connection, revision)
        before = {table.name: insert_some_row(connection, table) for table in tables_of(connection)}
    upgrade(database)
    sees_both = revision >= "0016"  # the option came then; older studies go on without it
    if not sees_both and "options" in before["study"]:
        before["study"]["options"] |= {"see_both": False}
    with database.reading() as connection:
        for table in tables_of(connection):
            if table.name in before:
                (row,) = connection.execute(select(table)).all()
                assert row._mapping.items() >= before[table.name].items()
        if database.engine.dialect.name == "sqlite":
            assert connection.execute(text("PRAGMA foreign_key_check")).all() == []
        kept = study_by_slug(connection, "study.slug")
    assert kept is not None
    assert parse_options(kept.options) == StudyOptions(see_both=sees_both)
    database.dispose()


@pytest.mark.slow
def test_an_older_study_with_texts_of_its_own_is_offered_as_before(new_database_url: Callable[[], str]) -> None:
    database = open_database(new_database_url())
    question = {"name": "job", "kind": "choice", "text": "Your job?", "options": ["x", "y"]}
    old = {"consent": "We compare.", "questions": [question, {"name": "age", "kind": "number"}]}
    with database.writing() as connection:
        upgrade_within(connection, "0018")
        study = next(table for table in tables_of(connection) if table.name == "study")
        insert_some_row(connection, study)
        connection.execute(study.update().values(options=old))
    upgrade(database)
    with database.reading() as connection:
        kept = study_by_slug(connection, "study.slug")
    assert kept is not None
    options = parse_options(kept.options)
    assert options.languages == ("en", "de")
    assert missing_texts(options, "de") == []
    assert own_texts(options, "de") == own_texts(options, "en")
    assert own_texts(options, "de")["questions.job.labels"] == ["x", "y"]
    database.dispose()


@pytest.mark.slow
def test_who_was_excluded_twice_is_so_once_by_the_first_reason(new_database_url: Callable[[], str]) -> None:
    database = open_database(new_database_url())
    reasons = ("first", "second", "third")
    with database.writing() as connection:
        upgrade_within(connection, "0011")
        tables = {table.name: table for table in tables_of(connection)}
        for name in ("study", "invitation", "participant", "exclusion"):
            insert_some_row(connection, tables[name])
        row = {"participant_id": 1, "excluded_by": "Eva", "excluded_at": datetime(2026, 1, 1, tzinfo=UTC)}
        for number, reason in enumerate(reasons, 2):
            connection.execute(insert(tables["exclusion"]).values(id=number, reason=reason, **row))
    upgrade(database)
    with database.reading() as connection:
        rows = exclusion_records(connection, 1)
    undone_by = {row["reason"]: row["undone_by"] for row in rows}
    assert [undone_by[reason] for reason in reasons] == [None, "database upgrade", "database upgrade"]
    database.dispose()


@pytest.mark.slow
def test_older_votes_on_films_that_did_not_run_are_found_by_their_counts_of_frames(
    new_database_url: Callable[[], str],
) -> None:
    slept = {"shown_ms": 15_915.0, "n_frames": 28, "n_dropped": 0, "n_stalls": 0, "switches": []}
    looks = {1: slept, 2: slept | {"shown_ms": 4000.0, "n_frames": 100}, 3: {"shown_ms": 4000.0, "switches": []}}
    database = open_database(new_database_url())
    with database.writing() as connection:
        upgrade_within(connection, "0032")
        tables = {table.name: table for table in tables_of(connection)}
        rows = {name: insert_some_row(connection, table) for name, table in tables.items()}
        connection.execute(tables["pair"].update().values(fps=25.0))
        connection.execute(tables["vote"].update().values(viewing=looks[1]))
        for key in (2, 3):
            new = {"id": key, "trial_id": key, "viewing": looks[key], "client_id": f"{key}"}
            trial = {"id": key, "public_id": f"{key}", "attempt": key}
            connection.execute(insert(tables["trial"]).values(**rows["trial"] | trial))
            connection.execute(insert(tables["vote"]).values(**rows["vote"] | new))
    upgrade(database)
    with database.reading() as connection:
        judged = {row[0]: row[1] for row in connection.execute(text("SELECT id, shown_smoothly FROM vote"))}
    assert {key: None if value is None else bool(value) for key, value in judged.items()} == {
        1: False,
        2: True,
        3: None,
    }
    database.dispose()


def tables_of(connection: Connection) -> list[Table]:
    """The tables that are there, each after those it refers to."""
    found = MetaData()
    found.reflect(connection)
    return [table for table in found.sorted_tables if table.name != "alembic_version"]


def insert_some_row(connection: Connection, table: Table) -> dict[str, Any]:
    row = {column.name: some_value(column) for column in table.columns}
    connection.execute(insert(table).values(**row))
    (stored,) = connection.execute(select(table)).all()
    return dict(stored._mapping)


def some_value(column: Column[Any]) -> Any:
    """A value that the column takes; each table has one row, so references are to the first."""
    name = f"{column.table.name}.{column.name}"
    if name in CHECKED:
        return CHECKED[name]
    if isinstance(column.type, String):
        return name[: column.type.length]
    moment = datetime(2026, 1, 1, tzinfo=UTC)
    kinds = {Boolean: True, Integer: 1, Float: 1.5, DateTime: moment, JSON: {}, LargeBinary: b"x"}
    return next(value for kind, value in kinds.items() if isinstance(column.type, kind))


def test_developers_and_the_server_mean_the_same_migrations() -> None:
    scripts = ScriptDirectory.from_config(Config(ROOT / "alembic.ini"))
    assert [script.revision for script in scripts.walk_revisions()] == revisions()


def test_migrations_go_forward_only() -> None:
    scripts = sorted((ROOT / "migrations" / "versions").glob("*.py"))
    assert scripts
    assert not [script.name for script in scripts if "def downgrade" in script.read_text(encoding="utf-8")]
