from __future__ import annotations

from pathlib import Path

from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from sqlalchemy import text

from app.store.engine import Database, open_database
from app.store.migrate import ROOT, newest_version, upgrade, version_of, why_not_ready
from app.store.studies import study_by_slug
from app.store.tables import metadata
from app.study.options import StudyOptions, parse_options

OLD_STUDY = """INSERT INTO study (id, slug, name, state, exposure_s, seed, factors, manifest_sha256, created_at)
    VALUES (1, 'old', 'Old', 'open', 15.0, 1, '{}', 'x', '2026-01-01 00:00:00')"""


def test_the_migrated_schema_is_the_one_in_the_code(database: Database) -> None:
    with database.reading() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True, "compare_server_default": True})
        assert compare_metadata(context, metadata) == []


def test_checks_are_migrated_too(database: Database, tmp_path: Path) -> None:
    """Alembic does not compare CHECK constraints: compare the tables' own texts."""
    direct = open_database(f"sqlite:///{tmp_path / 'direct.sqlite'}")
    with direct.writing() as connection:
        metadata.create_all(connection)
    assert checks(database) == checks(direct)
    assert sum(map(len, checks(database).values())) > 0
    direct.dispose()


def checks(database: Database) -> dict[str, list[str]]:
    with database.reading() as connection:
        rows = connection.execute(text("SELECT name, sql FROM sqlite_master WHERE type = 'table'")).all()
    texts = {name: [line.strip(" \t,") for line in sql.splitlines() if "CHECK" in line] for name, sql in rows}
    return {name: sorted(lines) for name, lines in texts.items() if lines}


def test_upgrading_again_changes_nothing(database: Database) -> None:
    assert upgrade(database) == version_of(database) == newest_version()
    assert why_not_ready(database) is None


def test_a_new_database_is_not_ready(tmp_path: Path) -> None:
    database = open_database(f"sqlite:///{tmp_path / 'new.sqlite'}")
    assert "reconstudy db upgrade" in (why_not_ready(database) or "")
    database.dispose()


def test_rows_of_an_older_version_live_on(tmp_path: Path) -> None:
    database = open_database(f"sqlite:///{tmp_path / 'old.sqlite'}")
    config = Config(ROOT / "alembic.ini")
    with database.writing() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "0001")
        connection.execute(text(OLD_STUDY))
        connection.execute(text("INSERT INTO invitation VALUES (1, 1, 'code', NULL, '2026-01-01')"))
    upgrade(database)
    with database.reading() as connection:
        kept = study_by_slug(connection, "old")
        assert connection.execute(text("PRAGMA foreign_key_check")).all() == []
    assert kept is not None
    assert parse_options(kept.options) == StudyOptions()
    database.dispose()


def test_migrations_go_forward_only() -> None:
    scripts = sorted((ROOT / "migrations" / "versions").glob("*.py"))
    assert scripts
    assert not [script.name for script in scripts if "def downgrade" in script.read_text(encoding="utf-8")]
