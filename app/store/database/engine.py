"""Open the database: transactions that read or write, on SQLite or PostgreSQL.

SQLite keeps a write-ahead log with `synchronous=FULL`, so that a commit is on disk when it returns, and a writing
transaction takes the write lock at its beginning (`BEGIN IMMEDIATE`): what it has read cannot change before it writes.
On PostgreSQL (`synchronous_commit=on`) a writing transaction locks the row that it decides by (`FOR UPDATE`): the study
while somebody is let in; the session while its stage, screening, trials or votes change; all owners while the access of
one of them ends, so that one is always left.
"""

from __future__ import annotations

import fcntl
import json
import logging
import os
import sqlite3
import stat
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

from sqlalchemy import (
    URL,
    Column,
    ColumnElement,
    Connection,
    DateTime,
    Dialect,
    Engine,
    Table,
    TypeDecorator,
    UnaryExpression,
    create_engine,
    event,
    make_url,
)
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.exc import ArgumentError, DataError, IntegrityError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError

from app.errors import InvalidError, NotFoundError, UnavailableError
from app.files import PRIVATE
from app.study.languages.text import storable_content

log = logging.getLogger(__name__)

Transaction = Connection  # the name of a connection for modules outside the store

BUSY_TIMEOUT_S = 20  # another program may hold SQLite's write lock, for example its shell
SHRED_WITHIN_S = 1  # votes wait meanwhile
CONNECT_TIMEOUT_S = 5
SECRETS = ("password", "sslpassword")  # that may stand in the query of an address, by libpq
FULL = ("disk is full", "No space left on device")  # SQLite's words, and PostgreSQL's
UNIQUE_VIOLATION = "23505"  # PostgreSQL's code
POSTGRESQL_OPTIONS = "-c synchronous_commit=on"  # the server's default may be less


class _FairLock:
    """A lock among the threads and processes that write to one SQLite file.

    Who waits for SQLite itself asks again now and then, and under load may never be the first to ask.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._threads = threading.Lock()
        self._file = -1

    def __enter__(self) -> None:
        self._threads.acquire()
        try:
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
            fcntl.flock(self._file, fcntl.LOCK_EX)
        except BaseException:
            self._threads.release()
            raise

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        os.close(self._file)  # which unlocks it, as the end of a process does
        self._threads.release()


class Database:
    """An engine, and the lock under which SQLite is written to: waiting there is fair, SQLite's own is not.

    It is open while a block runs, or until it is disposed of. Both kinds of transaction raise `UnavailableError` while
    the database is away, locked by somebody else for long, or its disk is full, and on PostgreSQL where somebody else
    wrote the same row at that moment: nothing was changed, unless the connection broke while the commit was on its way.
    """

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self._write_lock = _new_write_lock(engine)
        self._is_away = False

    def __enter__(self) -> Database:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.dispose()

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        with self._unavailable_when_away(), self.engine.connect() as connection:
            try:
                yield connection
            except DataError as error:  # for example a NUL character, which PostgreSQL cannot hold
                raise NotFoundError("There is nothing of this name.") from error

    @contextmanager
    def snapshot(self) -> Iterator[Connection]:
        """Read everything as it is at one moment, whatever is written meanwhile."""
        with self._unavailable_when_away(), self.engine.connect() as connection:
            if connection.dialect.name == "postgresql":  # SQLite's transactions read so anyway
                connection = connection.execution_options(isolation_level="REPEATABLE READ")
            yield connection

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """Hold one transaction, on disk when the block ends, undone when it raises."""
        with self._unavailable_when_away(), self._write_lock, self.engine.connect() as connection:
            try:
                with connection.execution_options(is_writing=True).begin():
                    yield connection
            except DataError as error:
                raise InvalidError("This holds a character or a number that cannot be kept.") from error
            except IntegrityError as error:
                if getattr(error.orig, "sqlstate", None) != UNIQUE_VIOLATION:
                    raise
                log.warning("one row was written twice at once; the later is undone: %s", error.orig)
                raise UnavailableError("This was changed by somebody else at this moment. Please try again.") from error

    @contextmanager
    def _unavailable_when_away(self) -> Iterator[None]:
        try:
            yield
        except (OperationalError, InterfaceError, PoolTimeoutError) as error:
            reason = str(getattr(error, "orig", error)).partition("\n")[0]
            if not self._is_away:
                log.warning("the database %s does not answer: %s", self.engine.url.database, reason)
            self._is_away = True
            if any(words in reason for words in FULL):
                raise UnavailableError(
                    "The server's disk is full, so this cannot be kept yet. What came before is kept; please try again "
                    "once somebody has made room."
                ) from error
            raise UnavailableError("This cannot be kept or looked up at the moment. Please try again soon.") from error
        if self._is_away:
            log.warning("the database answers again")
        self._is_away = False

    def shred_deleted(self) -> None:
        """Empty SQLite's write-ahead log, which still holds what was deleted; PostgreSQL's VACUUM is the operator's.

        A page that somebody is still reading keeps the log; housekeeping tries again.
        """
        if self.engine.dialect.name != "sqlite":
            return
        with self._unavailable_when_away(), self._write_lock, self.engine.connect() as connection:
            driver = connection.connection.driver_connection
            assert driver is not None, "it is connected"
            driver.execute(f"PRAGMA busy_timeout={1000 * SHRED_WITHIN_S}").close()
            is_busy = driver.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()[0]
            driver.execute(f"PRAGMA busy_timeout={1000 * BUSY_TIMEOUT_S}").close()
        if is_busy:
            log.warning("the write-ahead log is being read and still holds what was deleted; it is emptied later")

    def dispose(self) -> None:
        self.engine.dispose()


def open_database(url: str) -> Database:
    """Open a database by its SQLAlchemy URL; SQLite's folder is made when it is not there.

    Raises
    ------
    ValueError
        If it is no address of a database that can be used.
    """
    return Database(_new_engine(_address(url)))


def _address(url: str) -> URL:
    try:
        return make_url(url)
    except (ArgumentError, ValueError):  # they repeat a part of the address, which may be its password
        raise ValueError(
            "RECONSTUDY_DATABASE_URL is no address of a database; expected one such as "
            "postgresql+psycopg://user:password@host:5432/study, in whose password stand %40 for @, %3A for : and %2F "
            "for /"
        ) from None


def _shown(address: URL) -> str:
    return address.difference_update_query(SECRETS).render_as_string(hide_password=True)


def _new_write_lock(engine: Engine) -> AbstractContextManager[None]:
    return _FairLock(f"{engine.url.database}-lock") if engine.dialect.name == "sqlite" else nullcontext()


def _new_engine(address: URL) -> Engine:
    if address.get_backend_name() == "postgresql":
        return _postgresql(address)
    if address.get_backend_name() != "sqlite":
        raise ValueError(f"{_shown(address)}: expected a database of SQLite or PostgreSQL (postgresql+psycopg://…)")
    path = address.database
    if path is None or path == ":memory:":
        raise ValueError(
            f"{address}: a study needs a database on disk, for example sqlite:////var/lib/reconstudy/study.sqlite"
        )
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(address, connect_args={"timeout": BUSY_TIMEOUT_S}, json_deserializer=read_json_column)
    event.listen(engine, "connect", partial(_configure_sqlite, Path(path)))
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _postgresql(address: URL) -> Engine:
    try:
        return create_engine(
            address.set(drivername="postgresql+psycopg"),
            pool_pre_ping=True,
            json_deserializer=read_json_column,
            connect_args={"connect_timeout": CONNECT_TIMEOUT_S, "options": POSTGRESQL_OPTIONS},
        )
    except ModuleNotFoundError as error:
        raise ValueError(f"{_shown(address)}: PostgreSQL needs an extra package: {error}") from error


def read_json_column(content: str | bytes) -> Any:
    """Read JSON from the database; characters that no file can hold, from before they were refused, become U+FFFD."""
    raw = content.decode() if isinstance(content, bytes) else content
    held = json.loads(raw)
    if "\\ud" not in raw and "\\u0000" not in raw:  # the common case: json escapes what is not ASCII in lower case
        return held
    readable = storable_content(held)
    if readable != held:
        log.warning("a stored text holds characters that no file can hold; they are shown as U+FFFD")
    return readable


def _configure_sqlite(path: Path, dbapi_connection: Any, _record: Any) -> None:
    dbapi_connection.isolation_level = None  # the driver begins nothing by itself: _begin_sqlite does
    try:
        dbapi_connection.execute("PRAGMA schema_version").close()
    except sqlite3.DatabaseError as error:
        if error.sqlite_errorcode != sqlite3.SQLITE_NOTADB:
            raise
        raise ValueError(
            f"{path}: is no SQLite database, or a damaged one; restore a backup, or name another place"
        ) from error
    if stat.S_IMODE(path.stat().st_mode) != PRIVATE:
        path.chmod(PRIVATE)  # the write-ahead log, made later, takes over its mode
    # temp_store: no file is made for each statement of several rows, which could be undone half way
    # secure_delete: what is deleted is overwritten with zeros
    for pragma in (
        "journal_mode=WAL",
        "synchronous=FULL",
        "foreign_keys=ON",
        "temp_store=MEMORY",
        "secure_delete=ON",
    ):
        dbapi_connection.execute(f"PRAGMA {pragma}").close()


def _begin_sqlite(connection: Connection) -> None:
    is_writing = connection.get_execution_options().get("is_writing", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if is_writing else "BEGIN")


def insert_or_ignore(
    connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]], returning: Column[Any]
) -> list[Any]:
    """Insert the rows that break no unique constraint; the values of a column of those that were inserted."""
    if not rows:
        return []
    insert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
    return list(connection.scalars(insert(table).on_conflict_do_nothing().returning(returning), rows))


def embedded_file(url: str) -> Path | None:
    """Return the file of an SQLite database; None of another one."""
    address = _address(url)
    return Path(str(address.database)) if address.get_backend_name() == "sqlite" else None


def without_password(url: str) -> str:
    """Return a database's address as it may be shown."""
    return _shown(_address(url))


def holds_password(url: str) -> bool:
    """Whether a database's address holds the password, so that its driver takes none from the environment."""
    address = _address(url)
    return address.password is not None or not address.query.keys().isdisjoint(SECRETS)


def sorted_by(columns: Mapping[str, ColumnElement[Any]], sort: str) -> tuple[UnaryExpression[Any], ...]:
    """Return the order that a reader asks for, missing values last; nothing where there is no such column.

    Parameters
    ----------
    columns : that may be asked for, by name
    sort : a name, with "-" before it for descending
    """
    column = columns.get(sort.removeprefix("-"))
    if column is None:
        return ()
    return ((column.desc() if sort.startswith("-") else column.asc()).nulls_last(),)


class UtcDateTime(TypeDecorator[datetime]):
    """A moment; SQLite keeps no time zone, so it is UTC on the way in and out."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        if value.tzinfo is None:
            raise ValueError(f"{value.isoformat()}: has no time zone")
        return value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)
