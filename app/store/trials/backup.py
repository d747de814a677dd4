"""Write all rows of a database to a file, and restore them into either kind of database.

A ZIP archive: `backup.json` (version of the schema, and for each table the number of rows and their digest), and
`tables/NAME.jsonl`, one JSON object a row, bytes in it as base64. All tables are of one moment, and the server may run
meanwhile.
"""

from __future__ import annotations

import hashlib
import json
import time
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from datetime import UTC, datetime
from itertools import islice
from typing import Any
from zipfile import ZipFile

from alembic.migration import MigrationContext
from sqlalchemy import (
    JSON,
    Connection,
    DateTime,
    LargeBinary,
    MetaData,
    Select,
    Table,
    func,
    insert,
    inspect,
    select,
    text,
)
from sqlalchemy.exc import OperationalError
from sqlalchemy.types import TypeEngine

from app.store.access.experimenters import UNNAMED
from app.store.database.engine import Database
from app.store.database.migrate import newest_version, revisions, upgrade_within, why_not_ready
from app.store.database.schema import metadata
from app.store.database.tables import experimenter, participant, session, trial, vote
from app.store.trials.trials import is_voted_on
from app.study.stages import FINISHED

FACTS = "backup.json"
STUDY_FACTS = "study.json"  # of the archive of one study, which app/store/travel.py writes
WRITERS = {FACTS: "reconstudy backup", STUDY_FACTS: "reconstudy study export"}
SCHEMA_VERSION = 1
ROWS_AT_ONCE = 500
LOCK_ATTEMPT_MS = 500  # PostgreSQL looks for a deadlock after 1 s
LOCKED_WITHIN_S = 30
TABLES_NAMED = 3  # in the message about another program's tables
VERSION_TABLE = "alembic_version"
MISSED = {  # by table; a restore drops these rows only with --replace, and all other rows belong to them
    "study": ("study", "studies"),
    "experimenter": ("experimenter", "experimenters"),
    "api_token": ("token", "tokens"),
    "audit_entry": ("entry of the audit log", "entries of the audit log"),
}


def write_tables(database: Database, archive: ZipFile, now: datetime) -> dict[str, int]:
    """Write every row, as of one moment, into an archive; returns the number of rows by table.

    Raises
    ------
    ValueError
        If the database is not at the newest version.
    """
    if reason := why_not_ready(database):
        raise ValueError(reason)
    facts: dict[str, Any] = {}
    with database.snapshot() as connection:
        for table in metadata.sorted_tables:
            facts[table.name] = write_rows(connection, select(table).order_by(*table.primary_key), table.name, archive)
    write_facts(archive, FACTS, {"created_at": now.isoformat(), "tables": facts})
    return {name: table["rows"] for name, table in facts.items()}


def write_facts(archive: ZipFile, name: str, facts: Mapping[str, Any]) -> None:
    """Write what `read_tables` needs to know of an archive's rows, and more."""
    content = {"schema_version": SCHEMA_VERSION, "revision": newest_version(), **facts}
    archive.writestr(name, json.dumps(content, indent=2))


def read_tables(
    database: Database,
    archive: ZipFile,
    *,
    replace: bool = False,
    before_commit: Callable[[Connection], None],
    facts_name: str = FACTS,
) -> dict[str, int]:
    """Fill a database with the rows of an archive, all or none; returns the number of rows by table.

    An older version's rows are migrated. Whoever reads or writes meanwhile waits, and then sees the restored rows.

    Parameters
    ----------
    replace : drop what the database holds; otherwise it must hold no studies, people, tokens or entries of its log
    before_commit : called with the transaction when all rows are there; where it raises, nothing has changed
    facts_name : of the file in the archive that says what it holds

    Raises
    ------
    ValueError
        If the archive is not whole or of a newer version, or the database holds these or tables of another program.
    """
    facts = read_facts(archive, facts_name)
    for name, table_facts in facts["tables"].items():  # before anybody has to wait
        _check_rows(archive, name, table_facts)
    with database.writing() as connection:
        _empty(connection, replace=replace)
        upgrade_within(connection, facts["revision"])
        if unknown := facts["tables"].keys() - set(inspect(connection).get_table_names()):
            raise ValueError(f"{archive.filename}: holds a table {min(unknown)!r}, which its version does not have")
        reflected = MetaData()
        reflected.reflect(connection, only=list(facts["tables"]))
        for table in reflected.sorted_tables:
            with archive.open(file_of(table.name)) as lines:
                _fill(connection, table, map(json.loads, lines))
        upgrade_within(connection, newest_version())
        before_commit(connection)
    return {name: table["rows"] for name, table in facts["tables"].items()}


def write_rows(
    connection: Connection, query: Select[Any], name: str, archive: ZipFile, shown: Callable[[Any], Any] = dict
) -> dict[str, Any]:
    """Write rows of a table into an archive; returns how many, and their digest.

    Parameters
    ----------
    query : of the rows, in order
    name : of the table
    shown : makes of a row what is written of it
    """
    digest, n_rows = hashlib.sha256(), 0
    with archive.open(file_of(name), "w", force_zip64=True) as file:
        for row in connection.execute(query.execution_options(yield_per=ROWS_AT_ONCE)):
            line = json.dumps(shown(row._mapping), default=_as_text).encode() + b"\n"
            digest.update(line)
            file.write(line)
            n_rows += 1
    return {"rows": n_rows, "sha256": digest.hexdigest()}


def _as_text(value: datetime | bytes) -> str:
    """Return what JSON does not have as a text, from which `_reader` makes it again."""
    return b64encode(value).decode() if isinstance(value, bytes) else value.isoformat()


def file_of(table_name: str) -> str:
    """Return the name of a table's rows in an archive."""
    return f"tables/{table_name}.jsonl"


def read_facts(archive: ZipFile, name: str = FACTS) -> dict[str, Any]:
    """Read what an archive says of its rows.

    Raises
    ------
    ValueError
        If it says nothing, or is of a version that is not known here.
    """
    writer = WRITERS[name]
    if name not in archive.namelist():
        raise ValueError(f"{archive.filename}: holds no {name}; expected a file that `{writer}` wrote")
    try:
        facts = json.loads(archive.read(name))
    except ValueError as error:
        raise ValueError(f"{archive.filename}: {name} is not readable as JSON: {error}") from error
    if not isinstance(facts, dict) or not isinstance(facts.get("tables"), dict):
        raise ValueError(f"{archive.filename}: {name} lists no tables; expected a file that `{writer}` wrote")
    if facts.get("schema_version") != SCHEMA_VERSION or facts.get("revision") not in revisions():
        raise ValueError(
            f"{archive.filename}: is of version {facts.get('revision')}, which this program does not know; "
            "take the version of reconstudy that wrote it, or a newer one"
        )
    return facts


def refuse_what_is_held(database: Database, *, replace: bool = False) -> None:
    """Check, before any work is done, whether `read_tables` would fill this database.

    Raises
    ------
    ValueError
    """
    with database.reading() as connection:
        _droppable(connection, replace=replace)


def holds_nothing(database: Database) -> bool:
    """Whether there is nothing in a database that somebody would miss."""
    with database.reading() as connection:
        present = MetaData()
        present.reflect(connection, only=lambda name, _: name in metadata.tables)
        return not _held(connection, present)


def _empty(connection: Connection, *, replace: bool) -> None:
    if connection.dialect.name == "postgresql":
        _lock(connection)
    _droppable(connection, replace=replace).drop_all(connection)


def _lock(connection: Connection) -> None:
    """Lock all tables, although a server may be using them.

    Its transactions go first: each attempt ends before PostgreSQL looks for deadlocks and might abort one of them.
    """
    names = metadata.tables.keys() & set(inspect(connection).get_table_names())
    if not names:
        return
    lock = text(f"LOCK TABLE {', '.join(sorted(names))} IN ACCESS EXCLUSIVE MODE")
    until_s = time.monotonic() + LOCKED_WITHIN_S
    connection.execute(text(f"SET LOCAL statement_timeout = {LOCK_ATTEMPT_MS}"))
    while True:
        try:
            with connection.begin_nested():
                connection.execute(lock)
            break
        except OperationalError as error:
            if connection.invalidated:  # the database is away
                raise
            if time.monotonic() > until_s:
                raise ValueError("the database is in use all the time; stop the server, then restore again") from error
    connection.execute(text("SET LOCAL statement_timeout TO DEFAULT"))


def _droppable(connection: Connection, *, replace: bool) -> MetaData:
    """Return this program's tables in the database; raises if they hold rows that somebody would miss."""
    names = set(inspect(connection).get_table_names())
    _refuse_tables_of_others(connection, names)
    present = MetaData()
    present.reflect(connection, only=sorted(names))
    if not replace and (held := _held(connection, present)):
        raise ValueError(f"the database holds {held}; restore into an empty one, or give --replace to drop them")
    return present


def _refuse_tables_of_others(connection: Connection, names: Set[str]) -> None:
    """Raise unless every table is ours: another program's table may have the same name as one of ours."""
    strange = names - {*metadata.tables, VERSION_TABLE}
    if names and MigrationContext.configure(connection).get_current_revision() not in revisions():
        strange = names
    if strange:
        some = ", ".join(sorted(strange)[:TABLES_NAMED]) + (", …" if len(strange) > TABLES_NAMED else "")
        raise ValueError(
            f"the database holds tables of another program, or of another version of this one ({some}); restore into a "
            "database of its own: create an empty one and name it by RECONSTUDY_DATABASE_URL"
        )


def _held(connection: Connection, present: MetaData) -> str:
    """Name what somebody would miss in a database; empty if there is nothing."""
    held = []
    for name, (singular, plural) in MISSED.items():
        if (table := present.tables.get(name)) is not None:
            rows = select(func.count()).select_from(table)
            if name == experimenter.name:
                rows = rows.where(table.c.name != UNNAMED)  # not a person: the set-up link of a server's first start
            if count := connection.scalar(rows):
                held.append(f"{count} {singular if count == 1 else plural}")
    return ", ".join(held)


def _check_rows(archive: ZipFile, name: str, facts: Any) -> None:
    """Raise unless the rows of a table are those that were written."""
    if file_of(name) not in archive.namelist():
        raise ValueError(f"{archive.filename}: the rows of {name} are missing; it is damaged")
    digest, n_rows = hashlib.sha256(), 0
    with archive.open(file_of(name)) as file:
        for line in file:
            digest.update(line)
            n_rows += 1
    if facts != {"rows": n_rows, "sha256": digest.hexdigest()}:
        raise ValueError(f"{archive.filename}: the rows of {name} are not those that were written; it is damaged")


def _fill(connection: Connection, table: Table, rows: Iterable[Mapping[str, Any]]) -> None:
    for column in table.columns:
        if isinstance(column.type, JSON):
            column.type.none_as_null = True
    is_sqlite = connection.dialect.name == "sqlite"
    readers = {column.name: read for column in table.columns if (read := _reader(column.type, is_sqlite=is_sqlite))}
    left = iter(rows)
    while some := list(islice(left, ROWS_AT_ONCE)):
        connection.execute(insert(table), [{**row, **_read(row, readers)} for row in some])
    if not is_sqlite and "id" in table.c:
        newest = select(func.coalesce(func.max(table.c.id), 0) + 1).scalar_subquery()
        connection.execute(select(func.setval(func.pg_get_serial_sequence(table.name, "id"), newest, False)))


def _reader(kind: TypeEngine[Any], *, is_sqlite: bool) -> Callable[[str], Any] | None:
    """Return what makes a column's value from its text in a backup; None: it stands there as it is."""
    if isinstance(kind, LargeBinary):
        return b64decode
    if not isinstance(kind, DateTime):
        return None
    return _without_zone if is_sqlite else datetime.fromisoformat


def _without_zone(text: str) -> datetime:
    return datetime.fromisoformat(text).astimezone(UTC).replace(tzinfo=None)  # SQLite keeps no time zone


def _read(row: Mapping[str, Any], readers: Mapping[str, Callable[[str], Any]]) -> dict[str, Any]:
    return {name: read(row[name]) for name, read in readers.items() if row[name] is not None}


def faults_of(database: Database) -> list[str]:
    """List what is wrong with a database's structure and votes."""
    if reason := why_not_ready(database):
        return [reason]
    with database.snapshot() as connection:
        return [*_structure(connection), *_contradictions(connection)]


def _structure(connection: Connection) -> Iterator[str]:
    if connection.dialect.name == "sqlite":
        yield from (f"SQLite: {row[0]}" for row in connection.execute(text("PRAGMA integrity_check")) if row[0] != "ok")
        for row in connection.execute(text("PRAGMA foreign_key_check")):
            yield f"row {row[1]} of {row[0]} refers to a row of {row[2]} that is not there"
    for name in set(metadata.tables) - set(inspect(connection).get_table_names()):
        yield f"the table {name} is missing"


def _contradictions(connection: Connection) -> Iterator[str]:
    voided = select(func.count()).select_from(vote.join(trial)).where(trial.c.voided_at.is_not(None))
    twice = (
        select(trial.c.assignment_id).join(vote, is_voted_on()).group_by(trial.c.assignment_id).having(func.count() > 1)
    )
    ended = (
        select(func.count(session.c.id.distinct()))
        .join(participant)
        .join(trial, trial.c.session_id == session.c.id)
        .outerjoin(vote, is_voted_on())
        .where(session.c.stage == FINISHED, trial.c.voided_at.is_(None), vote.c.id.is_(None))
        .where(participant.c.is_preview.is_(False))  # previews skip stages, and their votes are forgotten
    )
    counts = {
        "votes on trials that were interrupted": connection.scalar(voided),
        "pairs that one participant voted on twice": len(connection.execute(twice).all()),
        "finished sessions with trials without a vote": connection.scalar(ended),
    }
    yield from (f"{count} {what}" for what, count in counts.items() if count)
