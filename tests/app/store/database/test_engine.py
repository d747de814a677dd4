"""What a transaction promises."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from sqlalchemy import func, insert, select, text
from sqlalchemy.exc import IntegrityError

from app.errors import InvalidError, NotFoundError, UnavailableError
from app.store.database.engine import Database, embedded_file, open_database, without_password
from app.store.database.migrate import upgrade
from app.store.database.tables import api_token, trial, vote
from tests.postgresql import PostgresServer
from tests.seeded_studies import seed_voters


def token_row(name: str) -> dict[str, object]:
    return {"name": name, "token_hash": name, "scopes": [], "created_at": datetime.now(UTC)}


def n_tokens(database: Database) -> int:
    with database.reading() as connection:
        return connection.scalar(select(func.count()).select_from(api_token)) or 0


@pytest.fixture
def sqlite(tmp_path: Path) -> Iterator[Database]:
    database = open_database(f"sqlite:///{tmp_path / 'study.sqlite'}")
    upgrade(database)
    yield database
    database.dispose()


@pytest.mark.parametrize(
    ("pragma", "expected"), [("journal_mode", "wal"), ("synchronous", 2), ("foreign_keys", 1)]
)  # 2 is FULL
def test_sqlite_is_set_to_lose_nothing(sqlite: Database, pragma: str, expected: object) -> None:
    with sqlite.reading() as connection:
        assert connection.scalar(text(f"PRAGMA {pragma}")) == expected


def test_what_was_written_before_an_error_is_undone(database: Database) -> None:
    with pytest.raises(RuntimeError, match="midway"), database.writing() as connection:  # noqa: PT012
        connection.execute(insert(api_token).values(**token_row("one")))
        raise RuntimeError("midway")
    assert n_tokens(database) == 0


@pytest.mark.slow
def test_postgresql_acknowledges_what_is_on_disk(postgres: PostgresServer) -> None:
    url = postgres.new_database("asynchronous")
    setting = open_database(url)
    with setting.writing() as connection:
        connection.execute(text("ALTER DATABASE asynchronous SET synchronous_commit = off"))
    setting.dispose()
    database = open_database(url.replace("+psycopg", ""))
    with database.reading() as connection:
        assert connection.scalar(text("SHOW synchronous_commit")) == "on"
    database.dispose()


def test_a_writing_transaction_holds_the_write_lock_from_its_beginning(sqlite: Database, tmp_path: Path) -> None:
    other = sqlite3.connect(tmp_path / "study.sqlite", timeout=0, isolation_level=None)
    with sqlite.writing(), pytest.raises(sqlite3.OperationalError, match="locked"):
        other.execute("BEGIN IMMEDIATE")
    other.close()


def test_one_can_read_while_another_writes(database: Database) -> None:
    with database.writing() as connection:
        connection.execute(insert(api_token).values(**token_row("one")))
        assert n_tokens(database) == 0
    assert n_tokens(database) == 1


def test_a_vote_for_no_trial_of_its_session_is_refused(database: Database, now: datetime) -> None:
    seed_voters(database, n_voters=2, n_approaches=2)
    with database.reading() as connection:
        trials = connection.execute(select(trial.c.session_id, trial.c.id)).all()
    (of_one, _), (_, of_another) = trials
    for trial_id in (of_another, 9):
        row = {
            "client_id": "x",
            "session_id": of_one,
            "trial_id": trial_id,
            "choice": "a",
            "first_shown": "a",
            "n_switches": 0,
            "shown_ms": 0.0,
            "response_ms": 0.0,
            "viewing": {},
            "received_at": now,
        }
        with pytest.raises(IntegrityError, match=r"(?i)foreign key"), database.writing() as connection:
            connection.execute(insert(vote).values(**row))


def test_a_database_is_written_to_again_after_a_failure(database: Database) -> None:
    for name in ("one", "two", "three"):
        with pytest.raises(RuntimeError, match="midway"), database.writing() as connection:  # noqa: PT012
            connection.execute(insert(api_token).values(**token_row(f"not {name}")))
            raise RuntimeError("midway")
        with database.writing() as connection:
            connection.execute(insert(api_token).values(**token_row(name)))
    assert n_tokens(database) == 3


@pytest.mark.slow
def test_a_connection_that_was_cut_is_replaced(postgres: PostgresServer) -> None:
    url = postgres.new_database("cut")
    database, elsewhere = open_database(url), open_database(url)
    upgrade(database)
    with database.writing() as connection:
        number = connection.scalar(text("SELECT pg_backend_pid()"))
    with elsewhere.writing() as connection:
        connection.execute(text("SELECT pg_terminate_backend(:pid)"), {"pid": number})
    with database.writing() as connection:
        connection.execute(insert(api_token).values(**token_row("one")))
    assert n_tokens(elsewhere) == 1
    with pytest.raises(UnavailableError), database.writing() as connection:  # noqa: PT012
        connection.execute(text("SELECT pg_terminate_backend(pg_backend_pid())"))
        connection.execute(insert(api_token).values(**token_row("two")))
    assert n_tokens(database) == 1
    database.dispose()
    elsewhere.dispose()


def test_many_threads_write_one_after_another(database: Database) -> None:
    def write(number: int) -> None:
        for turn in range(10):
            with database.writing() as connection:
                connection.execute(insert(api_token).values(**token_row(f"{number}-{turn}")))

    threads = [threading.Thread(target=write, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert n_tokens(database) == 80


def test_a_moment_without_a_time_zone_is_refused(database: Database) -> None:
    naive = token_row("one") | {"created_at": datetime(2026, 3, 1)}  # noqa: DTZ001
    with pytest.raises(Exception, match="no time zone"), database.writing() as connection:
        connection.execute(insert(api_token).values(**naive))


def test_moments_come_back_in_utc(database: Database, now: datetime) -> None:
    with database.writing() as connection:
        connection.execute(insert(api_token).values(**token_row("one") | {"created_at": now}))
        found = connection.scalar(select(api_token.c.created_at))
    assert found == now
    assert found is not None
    assert found.tzinfo is UTC


@pytest.mark.parametrize("url", ["sqlite://", "sqlite:///:memory:"])
def test_a_database_in_memory_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="on disk"):
        open_database(url)


def test_what_is_no_database_that_can_be_used_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="expected a database of SQLite or PostgreSQL"):
        open_database("mysql://somewhere/study")
    (tmp_path / "study.sqlite").write_bytes(b"\x8f random bytes")
    (tmp_path / "study.sqlite").chmod(0o644)
    with (
        pytest.raises(ValueError, match=r"study\.sqlite: is no SQLite database"),
        open_database(f"sqlite:///{tmp_path / 'study.sqlite'}").reading(),
    ):
        pass
    assert (tmp_path / "study.sqlite").stat().st_mode & 0o777 == 0o644


@pytest.mark.parametrize(
    "address",
    [
        "nonsense",
        "postgresql+psycopg:/reader:secret@host/study",
        "postgresql://reader:secret",
        "postgresql://reader:a@secret:b@host/study",
        "postgresql://reader:first@host:secret/study",
    ],
)
def test_an_address_that_cannot_be_read_is_refused_without_a_word_of_it(address: str) -> None:
    for read in (open_database, embedded_file, without_password):
        with pytest.raises(ValueError, match=r"RECONSTUDY_DATABASE_URL .*expected .*%40 for @") as refused:
            read(address)
        assert "secret" not in str(refused.value)


def test_a_password_in_an_addresss_query_is_not_shown() -> None:
    address = "postgresql+psycopg://reader@host/study?sslmode=verify-full&{}=secret"
    for name in ("password", "sslpassword"):
        assert without_password(address.format(name)) == "postgresql+psycopg://reader@host/study?sslmode=verify-full"
    with pytest.raises(ValueError, match="expected a database of SQLite or PostgreSQL") as refused:
        open_database("mysql://host/study?password=secret")
    assert "secret" not in str(refused.value)


def test_a_database_that_is_opened_twice_stays_locked_against_other_programs(tmp_path: Path) -> None:
    path = tmp_path / "study.sqlite"
    first = open_database(f"sqlite:///{path}")
    with first.writing() as connection:
        connection.exec_driver_sql("CREATE TABLE word (text TEXT)")
    open_database(f"sqlite:///{path}")  # closing the file itself here would give up the locks of this process
    other = f"import sqlite3; c = sqlite3.connect({str(path)!r}); c.execute('SELECT * FROM word').fetchall(); c.close()"
    subprocess.run([sys.executable, "-c", other], check=True)
    assert (tmp_path / "study.sqlite-wal").exists()  # whoever closes a database last removes its log
    first.dispose()


def test_who_lacks_the_driver_of_postgresql_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(ValueError, match=r"reader:\*\*\*@host.*an extra package.*psycopg"):
        open_database("postgresql://reader:secret@host/study")


@pytest.mark.slow
def test_a_database_that_is_away_is_unavailable(postgres: PostgresServer) -> None:
    database = open_database(postgres.new_database("there").replace("there", "away"))
    with pytest.raises(UnavailableError), database.reading():
        pass
    database.dispose()


def test_a_full_disk_is_unavailable_said_to_be_full_and_changes_nothing(sqlite: Database) -> None:
    with sqlite.reading() as connection:
        n_pages = connection.scalar(text("PRAGMA page_count"))
    fill = insert(api_token).values(**token_row("big") | {"scopes": ["x" * 100_000]})
    with pytest.raises(UnavailableError, match="disk is full"), sqlite.writing() as connection:  # noqa: PT012
        connection.execute(text(f"PRAGMA max_page_count = {n_pages}"))
        connection.execute(fill)
    assert n_tokens(sqlite) == 0
    with sqlite.writing() as connection:
        connection.execute(text("PRAGMA max_page_count = 1000000"))
        connection.execute(fill)
    assert n_tokens(sqlite) == 1


@pytest.mark.slow
def test_what_postgresql_cannot_hold_is_not_found_and_not_kept(postgres: PostgresServer) -> None:
    database = open_database(postgres.new_database("nul"))
    upgrade(database)
    with pytest.raises(NotFoundError), database.reading() as connection:
        connection.execute(select(api_token).where(api_token.c.name == "\0"))
    with pytest.raises(InvalidError), database.writing() as connection:
        connection.execute(insert(api_token).values(**token_row("\0")))
    database.dispose()


@pytest.mark.slow
def test_what_two_add_at_once_is_kept_once_and_the_other_may_try_again(postgres: PostgresServer) -> None:
    database = open_database(postgres.new_database("at-once"))
    upgrade(database)
    both_looked = threading.Barrier(2)
    refused = []

    def add() -> None:
        try:
            with database.writing() as connection:
                assert connection.scalar(select(func.count()).select_from(api_token)) == 0
                both_looked.wait(timeout=20)
                connection.execute(insert(api_token).values(**token_row("same")))
        except UnavailableError as error:
            refused.append(error.detail)

    adding = [threading.Thread(target=add) for _ in range(2)]
    for thread in adding:
        thread.start()
    for thread in adding:
        thread.join()
    assert refused == ["This was changed by somebody else at this moment. Please try again."]
    assert n_tokens(database) == 1
    database.dispose()


def test_a_database_that_cannot_be_opened_is_named_in_the_log(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    place = tmp_path / "study.sqlite"
    place.mkdir()
    with open_database(f"sqlite:///{place}") as database, pytest.raises(UnavailableError), database.reading():
        pass
    assert f"the database {place} does not answer: unable to open database file" in caplog.text
