"""Write all rows of one study to an archive, and copy them into any server's database.

Nobody's code travels: what lets a person in or go on is made anew where the study arrives. So are all names that must
be different on a server, such as those of films in addresses.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from itertools import islice
from typing import Any
from uuid import uuid4
from zipfile import ZipFile

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Connection,
    Float,
    Integer,
    LargeBinary,
    Select,
    String,
    Table,
    exists,
    insert,
    select,
)
from sqlalchemy.exc import IntegrityError, SQLAlchemyError

from app.store.database.belonging import rows_of_people, rows_of_study
from app.store.database.engine import UtcDateTime, insert_or_ignore, open_database
from app.store.database.keys import new_code, new_opaque_id
from app.store.database.schema import metadata
from app.store.database.tables import (
    audit_entry,
    comment_tagging,
    film_failure,
    invitation,
    participant,
    recruit,
    session,
    shown_texts,
    study,
    study_image,
    trial,
    vote,
)
from app.store.trials.backup import ROWS_AT_ONCE, STUDY_FACTS, read_tables, write_rows
from app.study.languages.text import check_text
from app.study.options.options import parse_options
from app.study.options.wording import texts_digest
from app.study.trial.image import check_image

LATE = (film_failure, comment_tagging)  # they name trials, which no reference says
IMPORTED = "imported: "  # begins the names of people in entries of the audit log that another server wrote
TYPES: Mapping[type, tuple[tuple[type, ...], str]] = {  # what a column holds, and how it is called
    Boolean: ((bool,), "true or false"),
    Integer: ((int,), "a whole number of 32 bits"),
    BigInteger: ((int,), "a whole number of 64 bits"),
    Float: ((float, int), "a finite number"),
    String: ((str,), "a text that is short enough"),
    LargeBinary: ((bytes,), "bytes"),
    UtcDateTime: ((datetime,), "a time"),
}
LARGEST = {Integer: 2**31, BigInteger: 2**63}


def write_study_rows(
    connection: Connection, study_id: int, archive: ZipFile, *, has_outside: bool
) -> dict[str, dict[str, Any]]:
    """Write a study's rows into an archive, without previews; returns how many of each table, and their digests.

    Parameters
    ----------
    has_outside : also what leads to people and to a recruiting platform: outside ids, completion codes, addresses that
        lead back, and names on invitations
    """
    facts = {}
    for table in metadata.sorted_tables:
        query = _rows_of(table, study_id)
        if query is not None and (has_outside or table is not recruit):
            facts[table.name] = write_rows(connection, query, table.name, archive, _shown(table, has_outside))
    return facts


def study_tables() -> list[str]:
    """Return the names of the tables that a study's archive may hold."""
    return [table.name for table in metadata.sorted_tables if _rows_of(table, 0) is not None]


def stage_study(archive: ZipFile, url: str) -> None:
    """Put the rows of a study's archive into a database of their own, which is made.

    Raises
    ------
    ValueError
        If they are not as described, or were not written together.
    """
    database = open_database(url)
    try:
        read_tables(database, archive, before_commit=lambda _connection: None, facts_name=STUDY_FACTS)
    except (SQLAlchemyError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"its rows are not as described: {getattr(error, 'orig', None) or error}") from None
    finally:
        database.dispose()


def only_study_in(connection: Connection) -> Mapping[str, Any]:
    """Return the row of the study in a database that holds one.

    Raises
    ------
    ValueError
    """
    rows = connection.execute(select(study)).all()
    if len(rows) != 1:
        raise ValueError(f"it holds {len(rows)} studies, expected one")
    return dict(rows[0]._mapping)


def copy_study(source: Connection, target: Connection, values: Mapping[str, Any], files: Mapping[str, str]) -> int:
    """Copy the only study of one database into another and return its id there.

    Parameters
    ----------
    source : whose rows come from outside; every value is checked
    target : of a writing transaction
    values : columns of the study that are others here, such as its short name
    files : names of films here, by their names there

    Raises
    ------
    ValueError
        If a value is not what its column holds, or an image is none.
    """
    copy = _Copy(target, values, files)
    tables = [source_table for source_table in metadata.sorted_tables if _rows_of(source_table, 0) is not None]
    for table in sorted(tables, key=lambda each: (each in LATE, each is not shown_texts)):
        rows = source.execute(select(table).order_by(*table.primary_key).execution_options(yield_per=ROWS_AT_ONCE))
        try:
            copy.insert(table, (dict(row._mapping) for row in rows))
        except IntegrityError as error:
            raise ValueError(f"its rows of {table.name} do not belong together: {error.orig}") from error
    return next(iter(copy.ids["study"].values()))


def _rows_of(table: Table, study_id: int) -> Select[Any] | None:
    """Select a study's rows of a table in order, without those of previews; None for tables that no study has."""
    people = select(participant.c.id).where(participant.c.study_id == study_id)
    rows = select(table).order_by(*table.primary_key)
    if table is shown_texts:
        theirs = session.c.participant_id.in_(people.where(participant.c.is_preview.is_(False)))
        return rows.where(table.c.sha256.in_(select(session.c.texts_sha256).where(theirs)))
    if (belongs := rows_of_study(table, study_id)) is None:
        return None
    if table is invitation:
        belongs &= invitation.c.places.is_distinct_from(0)  # those of previews
    of_previews = rows_of_people(table, people.where(participant.c.is_preview.is_(True)))
    return rows.where(belongs if of_previews is None else belongs & ~of_previews)


def _shown(table: Table, has_outside: bool) -> Callable[[Mapping[str, Any]], dict[str, Any]]:
    """Return what makes of a row what is written of it: nothing that lets somebody in or go on."""

    def shown(row: Mapping[str, Any]) -> dict[str, Any]:
        if table is session:
            nobodys = f"-{row['public_id']}"
            return {**row, "token_hash": nobodys, "resume_hash": nobodys, "begin_hash": None}
        if table is invitation:
            return {**row, "code": f"-{row['id']}", "label": row["label"] if has_outside else ""}
        if table is study:
            options = parse_options(row["options"])
            kept = options if has_outside else options.but(outside=options.outside.without_codes)
            return {**row, "options": kept.as_json(), "set_folder": None}  # a place on this server
        return dict(row)

    return shown


class _Copy:
    """Rows on their way into a database, with what was put in the place of their ids and names."""

    def __init__(self, target: Connection, values: Mapping[str, Any], files: Mapping[str, str]) -> None:
        self._target, self._values, self._files = target, values, files
        self.ids: dict[str, dict[int, int]] = {table.name: {} for table in metadata.sorted_tables}
        self._names: dict[str, str] = {}  # of films and trials, made anew when first met
        self._texts: dict[str, str] = {}  # digests of texts

    def insert(self, table: Table, rows: Iterable[Mapping[str, Any]]) -> None:
        left = iter(rows)
        while some := list(islice(left, ROWS_AT_ONCE)):
            new = [self._new(table, row) for row in some]
            if table is shown_texts:
                insert_or_ignore(self._target, table, new, table.c.sha256)
                continue
            statement = insert(table).returning(table.c.id, sort_by_parameter_order=True)
            ids = self._target.scalars(statement, new).all()
            self.ids[table.name] |= {row["id"]: int(key) for row, key in zip(some, ids, strict=True)}

    def _new(self, table: Table, row: Mapping[str, Any]) -> dict[str, Any]:
        new = {column.name: _checked(table, column, row[column.name]) for column in table.columns}
        new.pop("id", None)
        for column in table.columns:
            for reference in column.foreign_keys:
                if reference.column.name == "id" and new[column.name] is not None:
                    known = self.ids[reference.column.table.name]
                    if new[column.name] not in known:
                        raise ValueError(f"a row of {table.name} refers to {column.name} {new[column.name]}, not there")
                    new[column.name] = known[new[column.name]]
        for name in ("media", "of_media"):
            if name in new:
                new[name] = self._name(new[name])
        if "file" in new:
            new["file"] = self._files[new["file"]]
        return {**new, **self._secrets(table, new)}

    def _secrets(self, table: Table, row: Mapping[str, Any]) -> dict[str, Any]:
        """Return the columns of a row that are made anew, or checked further."""
        if table is study:
            parse_options(row["options"])
            return dict(self._values)
        if table is invitation:
            return {"code": new_code()}
        if table is session:
            name = row["public_id"]
            if self._target.scalar(select(exists().where(session.c.public_id == name))):
                name = new_opaque_id()
            texts = {"texts_sha256": self._texts.get(row["texts_sha256"])}
            return {"public_id": name, "token_hash": f"-{name}", "resume_hash": f"-{name}", "begin_hash": None, **texts}
        if table is shown_texts:
            digest = texts_digest(row["language"], row["content"])
            self._texts[row["sha256"]] = digest
            return {"sha256": digest}
        if table is trial:
            return {"public_id": self._name(row["public_id"])}
        if table is vote:
            return {"client_id": str(uuid4())}
        if table is audit_entry:
            return {"actor": f"{IMPORTED}{row['actor']}"[: audit_entry.c.actor.type.length]}  # type: ignore[attr-defined]  # a String
        if table is study_image:
            check_image(row["name"], row["content"])
            return {"sha256": hashlib.sha256(row["content"]).hexdigest()}
        if table is film_failure:
            return {"trial": self._names.get(row["trial"], row["trial"])}
        if table is comment_tagging and row["source"] == "trial":
            return {"subject": self._names.get(row["subject"], row["subject"])}
        return {}

    def _name(self, name: str) -> str:
        return self._names.setdefault(name, new_opaque_id())


def _checked(table: Table, column: Any, value: Any) -> Any:
    """Return a value that a column may hold.

    Raises
    ------
    ValueError
        If it is none: SQLite, which has taken it so far, keeps values of any type.
    """
    if value is None:
        return value
    if isinstance(column.type, JSON):
        check_text(value, f"{table.name}.{column.name}")
        json.dumps(value, allow_nan=False)
        return value
    kind = next(each for each in type(column.type).__mro__ if each in TYPES)
    types, expected = TYPES[kind]
    fits = isinstance(value, types) and (kind is Boolean or not isinstance(value, bool))
    if fits and isinstance(value, str):
        fits = column.type.length is None or len(value) <= column.type.length
        check_text(value, f"{table.name}.{column.name}")
    elif fits and kind in LARGEST:
        fits = -LARGEST[kind] <= value < LARGEST[kind]
    elif fits and kind is Float:
        fits = math.isfinite(value)
    if not fits:
        raise ValueError(f"{table.name}.{column.name} is {value!r:.80}, expected {expected}")
    return value
