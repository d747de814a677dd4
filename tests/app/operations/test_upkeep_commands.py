"""Studies, tokens and experimenters are looked after from the command line, by the operations of the dashboard."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import pytest
from typer.testing import CliRunner

from app.cli import app
from app.errors import ConflictError
from app.operations.studies import manage
from app.settings import Settings
from app.store.database.engine import open_database
from tests.seeded_studies import seed_voters

pytestmark = pytest.mark.slow


@pytest.fixture
def settings(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> Settings:
    settings = Settings(data_dir=tmp_path / "server")
    monkeypatch.setenv("RECONSTUDY_DATA_DIR", str(settings.data_dir))
    monkeypatch.delenv("RECONSTUDY_DATABASE_URL", raising=False)
    return settings


def run(*arguments: str) -> Any:
    """What a command prints with --json."""
    done = CliRunner().invoke(app, [*arguments, "--json"], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def test_a_study_is_closed_copied_archived_and_deleted(settings: Settings) -> None:
    manage.upgrade_database(settings)
    database = open_database(settings.url)
    seed_voters(database, 2, 3)
    database.dispose()
    assert run("study", "close", "test")["before"] == "open"
    assert run("study", "duplicate", "test", "--name", "Second round")["study"] == "second-round"
    with pytest.raises(ConflictError, match="Archive it first"):
        run("study", "delete", "test", "--yes")
    run("study", "archive", "test")
    assert run("study", "delete", "test", "--yes")["participants"] == 2
    assert [study["slug"] for study in run("study", "list")["studies"]] == ["second-round"]


def test_tokens_and_experimenters_are_listed_and_end(settings: Settings) -> None:
    manage.upgrade_database(settings)
    run("token", "add", "notebook", "--scope", "read", "--all-studies")
    with manage.own_token(settings, "simulate"):
        pass
    assert run("token", "revoke", "notebook") == {"name": "notebook", "was_valid": True}
    assert {token["state"] for token in run("token", "list")["tokens"]} == {"revoked"}
    for name in ("Eva", "Tom"):
        run("admin", "add", name)
    run("admin", "remove", "Tom")
    assert {person["name"]: person["state"] for person in run("admin", "list")["experimenters"]} == {
        "Eva": "invited",
        "Tom": "removed",
    }
    with pytest.raises(ValueError, match="no token called 'nobody'"):
        run("token", "revoke", "nobody")


def test_a_token_reads_one_study_for_a_year_unless_asked_for_more(settings: Settings) -> None:
    manage.upgrade_database(settings)
    with pytest.raises(ValueError, match="study"):  # there is none yet
        run("token", "add", "notebook")
    database = open_database(settings.url)
    seed_voters(database, 2, 3)
    database.dispose()
    made = run("token", "add", "notebook")
    assert (made["scopes"], made["studies"]) == (["read"], ["test"])
    assert 364 <= (datetime.fromisoformat(made["expires_at"]) - datetime.now(UTC)).days <= 365
    more = run("token", "add", "owner", "--scope", "read", "--scope", "audit", "--all-studies", "--days", "0")
    assert (more["scopes"], more["studies"], more["expires_at"]) == (["read", "audit"], None, None)
    run("study", "duplicate", "test", "--name", "Second")
    with pytest.raises(ValueError, match="study"):  # which of the two?
        run("token", "add", "another")
    told = CliRunner().invoke(app, ["token", "add", "said", "--study", "second"])
    assert "It grants read of second until 20" in told.output


def test_a_database_or_backup_that_is_not_there_is_named_and_nothing_is_made(settings: Settings) -> None:
    folder = settings.data_dir.parent
    for wrong, complaint in (
        (("backup", folder / "backup.zip"), r"study\.sqlite: there is no database"),
        (("db", "check"), r"study\.sqlite: there is no database"),
        (("restore", folder / "missing.zip"), r"missing\.zip: there is no such file"),
    ):
        with pytest.raises(ValueError, match=complaint):
            run(*map(str, wrong))
    assert list(folder.iterdir()) == []
