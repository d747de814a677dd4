"""Keep a screening: the measured display, the tests and their results.

A test's whole state is in its rows, so any process can continue it.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Connection, Row, func, insert, select, update

from app.errors import ConflictError, NotFoundError
from app.store.database.engine import Database
from app.store.database.tables import (
    participant,
    screening_display,
    screening_entry,
    screening_item,
    screening_test,
    session,
)
from app.store.participants.exclusions import COUNTING, counting, takes_part_in
from app.store.participants.participants import lock_unless_withdrawn
from app.study.screening.screening import (
    NOT_TAKEN,
    EnteredResult,
    Item,
    ScreeningOptions,
    TestName,
    acuity_setup,
    colour_setup,
    n_items,
    next_content,
    verdict_of,
)


@dataclass(frozen=True)
class Display:
    """A display and its viewing distance."""

    pixel_mm: float
    height_px: int
    distance_mm: float | None
    distance_source: str | None
    measured: Mapping[str, Any]

    @property
    def seat_mm(self) -> float | None:
        """From the display to where the participant sits during the study: without a step back for the rings."""
        seat = self.measured.get("seat_mm", self.distance_mm)
        return None if seat is None else float(seat)


@dataclass(frozen=True)
class ServedItem:
    """The ring or plate to show; `number` counts from 1."""

    number: int
    total: int
    setup: Mapping[str, Any]
    content: Mapping[str, Any]


@dataclass(frozen=True)
class TestState:
    """How far a test is; once the acuity test has begun, its display cannot change any more."""

    test: TestName
    has_begun: bool
    is_over: bool
    n_answered: int


def display_of(connection: Connection, session_id: int) -> Display | None:
    """Return the measured display of a session; None before it is measured."""
    columns = [screening_display.c[name] for name in Display.__dataclass_fields__]
    row = connection.execute(select(*columns).where(screening_display.c.session_id == session_id)).one_or_none()
    return Display(**row._mapping) if row else None


def keep_display(
    database: Database, session_id: int, pixel_mm: float, height_px: int, measured: Mapping[str, Any], now: datetime
) -> None:
    """Store the size of a display's pixels; a new measurement replaces the old one and its distance.

    Raises
    ------
    ConflictError
        If the acuity test has begun.
    """
    values = {"pixel_mm": pixel_mm, "height_px": height_px, "measured": {"display": dict(measured)}, "measured_at": now}
    with _screening_of(database, session_id) as connection:
        _refuse_after_begin(connection, session_id)
        changed = connection.execute(
            update(screening_display)
            .where(screening_display.c.session_id == session_id)
            .values(**values, distance_mm=None, distance_source=None)
        )
        if not changed.rowcount:
            connection.execute(insert(screening_display).values(session_id=session_id, **values))


def keep_distance(
    database: Database, session_id: int, distance_mm: float, source: str, measured: Mapping[str, Any]
) -> None:
    """Store the viewing distance; a later one replaces it, and the first one stays known as the seat.

    Raises
    ------
    ConflictError
        If the display has not been measured, or the acuity test has begun.
    """
    of_session = screening_display.c.session_id == session_id
    with _screening_of(database, session_id) as connection:
        _refuse_after_begin(connection, session_id)
        before = connection.scalar(select(screening_display.c.measured).where(of_session))
        if before is None:
            raise ConflictError("The display has not been measured yet.")
        values = {"distance_mm": distance_mm, "distance_source": source}
        facts = {**before, "seat_mm": before.get("seat_mm", distance_mm), "distance": dict(measured)}
        connection.execute(update(screening_display).where(of_session).values(**values, measured=facts))


def states_of(connection: Connection, session_id: int, options: ScreeningOptions) -> list[TestState]:
    """Return how far each test of a study is."""
    rows = {row.test: row for row in _tests(connection, session_id)}
    return [_state(connection, name, rows.get(name)) for name in options.tests]


def item_to_show(
    database: Database, session_id: int, test: TestName, options: ScreeningOptions, now: datetime
) -> ServedItem | None:
    """Return the ring or plate to answer now; the first one begins the test. None: the test is over.

    Raises
    ------
    ConflictError
        If acuity is to be tested on a display that has not been measured.
    """
    with _screening_of(database, session_id) as connection:
        row = _test(connection, session_id, test) or _begin(connection, session_id, test, options, now)
        return _advance(connection, row, now)


def answer_item(
    database: Database, session_id: int, test: TestName, number: int, answer: int, response_ms: float, now: datetime
) -> ServedItem | None:
    """Store an answer and return the next item, or None where the test is over; the same answer may be sent again.

    Raises
    ------
    NotFoundError
        If there is no such ring or plate.
    ConflictError
        If it has another answer.
    """
    with _screening_of(database, session_id) as connection:
        row, item = _served(connection, session_id, test, number)
        if item.answered_at is None and row.finished_at is None:
            given = {"answer": answer, "answered_at": now, "response_ms": response_ms}
            connection.execute(update(screening_item).where(screening_item.c.id == item.id).values(**given))
        elif item.answer not in (None, answer):
            raise ConflictError("This picture has an answer already, and it is another one.")
        return _advance(connection, row, now)


def item_of(connection: Connection, session_id: int, test: TestName, number: int) -> ServedItem:
    """Return a ring or plate that was served, to be drawn.

    Raises
    ------
    NotFoundError
        If there is none.
    """
    row, item = _served(connection, session_id, test, number)
    return ServedItem(number, n_items(test, row.setup), row.setup, item.content)


def end_test(database: Database, session_id: int, test: TestName, reason: str, now: datetime) -> None:
    """End a test that a participant skips; a finished test stays as it is."""
    with _screening_of(database, session_id) as connection:
        _end(connection, session_id, test, reason, now)


def close_screening(connection: Connection, session_id: int, options: ScreeningOptions, now: datetime) -> list[str]:
    """End a session's unfinished tests and return the verdicts that count: those entered, else those of the screen."""
    for test in options.tests:
        _end(connection, session_id, test, "the stage ended before", now)
    tested = {row.test: row.verdict for row in _tests(connection, session_id)}
    entered = connection.execute(
        select(screening_entry.c.test, screening_entry.c.verdict)
        .where(screening_entry.c.session_id == session_id)
        .order_by(screening_entry.c.id)
    )
    return list({**tested, **{row.test: row.verdict for row in entered}}.values())


def enter_result(
    connection: Connection, participant_id: int, entered: EnteredResult, experimenter: str, now: datetime
) -> None:
    """Add the result of a test beside the screen; earlier ones stay."""
    session_id = connection.execute(select(session.c.id).where(session.c.participant_id == participant_id)).scalar_one()
    values = {**asdict(entered), "experimenter": experimenter, "entered_at": now}
    connection.execute(insert(screening_entry).values(session_id=session_id, **values))


def screening_records(
    connection: Connection, study_id: int, participant_id: int | None = None
) -> Iterator[dict[str, Any]]:
    """Return a row for each participant and test on the screen, unfinished ones too; then those of entered results.

    Parameters
    ----------
    participant_id : only this participant's; None: everybody's
    """
    sought = _sought(study_id, participant_id)
    n_answered = select(func.count(screening_item.c.answer)).where(
        screening_item.c.screening_test_id == screening_test.c.id
    )
    rows = connection.execute(
        select(
            participant.c.label.label("participant"),
            session.c.public_id.label("session"),
            screening_test,
            screening_display.c.pixel_mm,
            screening_display.c.distance_mm,
            screening_display.c.distance_source,
            n_answered.scalar_subquery().label("n_answered"),
            *COUNTING,
        )
        .select_from(screening_test)
        .join(session, screening_test.c.session_id == session.c.id)
        .join(participant, session.c.participant_id == participant.c.id)
        .outerjoin(screening_display, screening_display.c.session_id == session.c.id)
        .where(sought)
        .order_by(participant.c.slot, screening_test.c.test)
    )
    for row in rows:
        yield {
            **row._mapping,
            **{key: (row.result or {}).get(key) for key in ("logmar", "low", "high")},
            "limit": row.setup.get("limit"),
            "smallest": row.setup.get("smallest"),
            "details": row.result,
            "result_source": "screen",
            "is_bound": (row.result or {}).get("is_bound"),
            "result": None,
            **counting(row),
        }
    yield from _entered_records(connection, sought)


def n_screening_records(connection: Connection, study_id: int) -> int:
    """Count the rows that `screening_records` returns of everybody."""
    counts = (
        select(func.count()).select_from(table.join(session).join(participant)).where(takes_part_in(study_id))
        for table in (screening_test, screening_entry)
    )
    return sum(connection.execute(count).scalar_one() for count in counts)


def screening_verdicts(
    connection: Connection, study_id: int, labels: Sequence[str]
) -> dict[str, dict[str, tuple[str | None, float | None]]]:
    """Return the verdicts that count of some participants: participant -> test -> verdict, and acuity in logMAR.

    A verdict is None while its test runs; the newest result entered counts instead of that of the screen.
    """
    people = (takes_part_in(study_id), participant.c.label.in_(labels))
    tested = connection.execute(
        select(participant.c.label, screening_test.c.test, screening_test.c.verdict, screening_test.c.result)
        .select_from(screening_test.join(session).join(participant))
        .where(*people)
        .order_by(screening_test.c.test)
    )
    verdicts: dict[str, dict[str, tuple[str | None, float | None]]] = {}
    for row in tested:
        verdicts.setdefault(row.label, {})[row.test] = row.verdict, (row.result or {}).get("logmar")
    entered = connection.execute(
        select(participant.c.label, screening_entry.c.test, screening_entry.c.verdict, screening_entry.c.logmar)
        .select_from(screening_entry.join(session).join(participant))
        .where(*people)
        .order_by(screening_entry.c.id)
    )
    for row in entered:
        verdicts.setdefault(row.label, {})[row.test] = row.verdict, row.logmar
    return verdicts


@contextmanager
def _screening_of(database: Database, session_id: int) -> Iterator[Connection]:
    """Hold a writing transaction that locks the session: what comes twice at once is taken one after the other."""
    with database.writing() as connection:
        lock_unless_withdrawn(connection, session_id)
        yield connection


def _sought(study_id: int, participant_id: int | None) -> ColumnElement[bool]:
    takes_part = takes_part_in(study_id)
    return takes_part if participant_id is None else takes_part & (participant.c.id == participant_id)


def _entered_records(connection: Connection, sought: ColumnElement[bool]) -> Iterator[dict[str, Any]]:
    rows = connection.execute(
        select(
            participant.c.label.label("participant"), session.c.public_id.label("session"), screening_entry, *COUNTING
        )
        .select_from(screening_entry.join(session).join(participant))
        .where(sought)
        .order_by(participant.c.slot, screening_entry.c.id)
    )
    for row in rows:
        yield {**row._mapping, "finished_at": row.entered_at, "result_source": "entered", **counting(row)}


def _refuse_after_begin(connection: Connection, session_id: int) -> None:
    if _test(connection, session_id, "acuity") is not None:
        raise ConflictError("The acuity test has begun; its display cannot change any more.")


def _begin(
    connection: Connection, session_id: int, test: TestName, options: ScreeningOptions, now: datetime
) -> Row[Any]:
    seed = secrets.randbits(63)
    if test == "colour":
        setup = colour_setup(options, seed)
    else:
        display = display_of(connection, session_id)
        if display is None or display.distance_mm is None:
            raise ConflictError("The display and its distance have not been measured yet.")
        setup = acuity_setup(options, display.pixel_mm, display.distance_mm, display.height_px, seed)
    return _insert_test(connection, session_id, test, setup, now)


def _insert_test(
    connection: Connection, session_id: int, test: TestName, setup: Mapping[str, Any], now: datetime
) -> Row[Any]:
    values = {"session_id": session_id, "test": test, "setup": setup, "started_at": now}
    return connection.execute(insert(screening_test).values(**values).returning(screening_test)).one()


def _advance(connection: Connection, row: Row[Any], now: datetime) -> ServedItem | None:
    """Return the item to answer now, drawn if all earlier ones have answers; a test without one gets its verdict."""
    if row.finished_at is not None:
        return None
    items = _items(connection, row.id)
    total = n_items(row.test, row.setup)
    if items and items[-1].answer is None:
        return ServedItem(len(items), total, row.setup, items[-1].content)
    content = next_content(row.test, row.setup, items)
    if content is None:
        verdict, result = verdict_of(row.test, row.setup, items)
        _finish(connection, row.id, verdict, result, now)
        return None
    place = {"session_id": row.session_id, "screening_test_id": row.id, "number": len(items) + 1}
    connection.execute(insert(screening_item).values(**place, content=content, served_at=now))
    return ServedItem(len(items) + 1, total, row.setup, content)


def _end(connection: Connection, session_id: int, test: TestName, reason: str, now: datetime) -> None:
    row = _test(connection, session_id, test) or _insert_test(connection, session_id, test, {}, now)
    if row.finished_at is None:
        _finish(connection, row.id, NOT_TAKEN, {"reason": reason}, now)


def _finish(connection: Connection, test_id: int, verdict: str, result: Mapping[str, Any], now: datetime) -> None:
    changes = {"verdict": verdict, "result": dict(result), "finished_at": now}
    connection.execute(update(screening_test).where(screening_test.c.id == test_id).values(**changes))


def _state(connection: Connection, test: TestName, row: Row[Any] | None) -> TestState:
    if row is None:
        return TestState(test, has_begun=False, is_over=False, n_answered=0)
    n_answered = sum(item.answer is not None for item in _items(connection, row.id))
    return TestState(test, has_begun=True, is_over=row.finished_at is not None, n_answered=n_answered)


def _tests(connection: Connection, session_id: int) -> Sequence[Row[Any]]:
    return connection.execute(select(screening_test).where(screening_test.c.session_id == session_id)).all()


def _test(connection: Connection, session_id: int, test: TestName) -> Row[Any] | None:
    this_test = (screening_test.c.session_id == session_id, screening_test.c.test == test)
    return connection.execute(select(screening_test).where(*this_test)).one_or_none()


def _items(connection: Connection, test_id: int) -> list[Item]:
    rows = select(screening_item.c.content, screening_item.c.answer).where(
        screening_item.c.screening_test_id == test_id
    )
    return [Item(row.content, row.answer) for row in connection.execute(rows.order_by(screening_item.c.number))]


def _served(connection: Connection, session_id: int, test: TestName, number: int) -> tuple[Row[Any], Row[Any]]:
    """Return a test, and a ring or plate of it that was served."""
    row = _test(connection, session_id, test)
    if row is not None:
        this_item = (screening_item.c.screening_test_id == row.id, screening_item.c.number == number)
        item = connection.execute(select(screening_item).where(*this_item)).one_or_none()
        if item is not None:
            return row, item
    raise NotFoundError("This test has no such picture.")
