from __future__ import annotations

from pathlib import Path

from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import text

from app.store.engine import Database, open_database
from app.store.migrate import ROOT, newest_version, upgrade, version_of, why_not_ready
from app.store.tables import metadata


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


def test_migrations_go_forward_only() -> None:
    scripts = sorted((ROOT / "migrations" / "versions").glob("*.py"))
    assert scripts
    assert not [script.name for script in scripts if "def downgrade" in script.read_text(encoding="utf-8")]
