"""Fill a database with a finished study of any number of votes, by bulk inserts instead of participants."""

from __future__ import annotations

import random
from collections.abc import Iterator
from datetime import timedelta
from itertools import islice
from math import exp
from typing import Any
from uuid import UUID

from sqlalchemy import Connection, Table, insert

from app.store.database.engine import Database
from app.store.database.tables import (
    assignment,
    audit_entry,
    participant,
    screening_display,
    screening_item,
    screening_test,
    session,
    stage_record,
    trial,
    vote,
)
from app.store.participants.invitations import insert_invitation, invitation_by_code
from app.store.studies.studies import study_by_id
from app.store.trials.designs import planned_pairs
from app.study.design.design import ONCE, participant_order
from app.study.stages import INTERVIEW
from tests.seeded_studies import NOW, seed_study

DATASETS = [f"scene {number}" for number in range(1, 7)]
CONDITIONS = ["id_fa", "id_fb", "dr_fa", "dr_fb", "pm_fa", "pm_fb"]  # 90 pairs in all, as in the paper
DIFFERENT_ORDERS = 240  # participants beyond repeat them: computing an order takes 7 ms
ROWS_AT_ONCE = 50_000
TIES = 0.15
TESTS = ("acuity", "colour")
ITEMS = 12  # rings or plates of a test
AUDIT_ENTRIES = 20_000
TRIALS_LAST = timedelta(seconds=20)


def fill(database: Database, n_votes: int, seed: int = 1) -> int:
    """Insert a study in which as many participants as it takes gave `n_votes` votes; return its id."""
    study_id = seed_study(database, DATASETS, CONDITIONS)
    with database.reading() as connection:
        pairs = planned_pairs(connection, study_id)
        study = study_by_id(connection, study_id)
    assert study is not None
    by_key = {pair.key: pair for pair in pairs}
    orders = [participant_order(pairs, study.seed, slot, ONCE) for slot in range(DIFFERENT_ORDERS)]
    n_people = -(-n_votes // len(pairs))
    rng = random.Random(seed)
    ability = {stimulus: (stimulus % len(CONDITIONS)) / 2 for pair in pairs for stimulus in pair.stimuli}

    def people() -> Iterator[dict[str, Any]]:
        for number in range(n_people):
            facts = {"id": number + 1, "slot": number, "order_slot": number, "label": f"P{number + 1:03d}"}
            yield {**facts, "study_id": study_id, "invitation_id": invitation_id, "created_at": NOW}

    def sessions() -> Iterator[dict[str, Any]]:
        for number in range(n_people):
            secrets = {name: f"{name}{number:050d}" for name in ("token_hash", "resume_hash")}
            last = NOW + (number % 1000) * TRIALS_LAST + len(pairs) * TRIALS_LAST
            times = {"started_at": NOW, "finished_at": last, "stage": "finished", "language": "en"}
            yield {"id": number + 1, "participant_id": number + 1, "public_id": f"s{number:015d}", **secrets, **times}

    def planned() -> Iterator[tuple[int, int, int, Any]]:
        for number in range(n_people):
            for position, shown in enumerate(orders[number % DIFFERENT_ORDERS]):
                yield number * len(pairs) + position + 1, number, position, shown

    def assignments() -> Iterator[dict[str, Any]]:
        for key, number, position, shown in planned():
            facts = {"a_half": shown.a_half, "first_shown": shown.first_shown, "role": shown.role}
            yield {"id": key, "participant_id": number + 1, "position": position, "pair_id": shown.pair, **facts}

    def trials() -> Iterator[dict[str, Any]]:
        for key, number, position, _ in planned():
            served = {"attempt": 1, "served_at": NOW + (number % 1000 + position) * TRIALS_LAST}
            yield {"id": key, "public_id": f"t{key:015d}", "session_id": number + 1, "assignment_id": key, **served}

    def votes() -> Iterator[dict[str, Any]]:
        for key, number, position, shown in islice(planned(), n_votes):
            pair = by_key[shown.pair]
            top, bottom = (ability[stimulus] for stimulus in pair.stimuli)
            p_a = 1 / (1 + exp(bottom - top if shown.a_half == "top" else top - bottom))
            choice = "none" if rng.random() < TIES else "a" if rng.random() < p_a else "b"
            viewing = _viewing(rng, shown.first_shown)
            yield {
                "id": key,
                "client_id": str(UUID(int=key)),
                "session_id": number + 1,
                "trial_id": key,
                "choice": choice,
                "first_shown": shown.first_shown,
                "n_switches": len(viewing["switches"]),
                "shown_ms": viewing["shown_ms"],
                "response_ms": viewing["response_ms"],
                "viewing": viewing,
                "received_at": NOW + (number % 1000 + position + 1) * TRIALS_LAST,
            }

    with database.writing() as connection:
        code = insert_invitation(connection, study_id, None, NOW)
        invitation = invitation_by_code(connection, code)
        assert invitation is not None
        invitation_id = invitation.id
        rows = {participant: people, session: sessions, assignment: assignments, trial: trials, vote: votes}
        for table, made in rows.items():
            _insert(connection, table, made())
        given = [stage_record, screening_display, screening_test, screening_item, audit_entry]
        fill_beside_votes(connection, study_id, n_people)
        if connection.dialect.name == "postgresql":
            for table in [*rows, *given]:  # the numbers were given, not drawn
                connection.exec_driver_sql(
                    f"SELECT setval(pg_get_serial_sequence('{table.name}', 'id'), max(id)) FROM {table.name}"
                )
            connection.exec_driver_sql("ANALYZE")  # by itself it does so within a minute
    return study_id


def fill_beside_votes(connection: Connection, study_id: int, n_people: int) -> None:
    """Insert what participants gave before and after their votes, and entries of the audit log."""
    people = range(1, n_people + 1)
    answers = {"gender": "female", "age": 31, "experience": 4, "glasses": "yes", "comment": "The hands looked flat."}
    of_test = {"setup": {"limit": 0.2}, "started_at": NOW, "finished_at": NOW, "verdict": "passed"}
    tests = [(2 * person + number, person, name) for person in people for number, name in enumerate(TESTS)]
    display = {"pixel_mm": 0.25, "height_px": 1080, "distance_mm": 600.0, "distance_source": "fixed", "measured": {}}
    item = {"content": {"gap": 2}, "served_at": NOW, "answer": 2, "answered_at": NOW, "response_ms": 900.0}
    rows: dict[Table, Iterator[dict[str, Any]]] = {
        stage_record: (
            {"id": person, "session_id": person, "stage": INTERVIEW, "data": {"answers": answers}, "completed_at": NOW}
            for person in people
        ),
        screening_display: ({"id": person, "session_id": person, "measured_at": NOW, **display} for person in people),
        screening_test: (
            {"id": key, "session_id": person, "test": name, "result": {"logmar": 0.1}, **of_test}
            for key, person, name in tests
        ),
        screening_item: (
            {"session_id": person, "screening_test_id": key, "number": number, **item}
            for key, person, _ in tests
            for number in range(1, ITEMS + 1)
        ),
        audit_entry: (
            {
                "at": NOW,
                "actor": "bench",
                "action": "looked",
                "study_id": study_id,
                "subject": str(n),
                "detail": {"n": n},
            }
            for n in range(AUDIT_ENTRIES)
        ),
    }
    for table, made in rows.items():
        _insert(connection, table, made)


def _insert(connection: Connection, table: Table, rows: Iterator[dict[str, Any]]) -> None:
    while batch := list(islice(rows, ROWS_AT_ONCE)):
        connection.execute(insert(table), batch)


def _viewing(rng: random.Random, first_shown: str) -> dict[str, Any]:
    """Return a viewing record as the page sends it, with two to five switches."""
    switches, shown, at_ms = [], first_shown, 0.0
    for _ in range(rng.randint(2, 5)):
        shown, at_ms = "b" if shown == "a" else "a", round(at_ms + rng.uniform(500, 2500), 1)
        times = {"at_ms": at_ms, "media_time_s": round(at_ms / 1000, 2), "frame": int(at_ms / 40)}
        switches.append({"to": shown, **times, "frame_ms": at_ms + 8.1, "presented_ms": round(at_ms + 24.3, 1)})
    return {
        "first_shown": first_shown,
        "shown_ms": 15003.2,
        "response_ms": round(rng.lognormvariate(7.3, 0.5), 1),
        "switches": switches,
        "n_frames": 375,
        "n_dropped": 0,
        "technique": "stacked",
        "display": {"window_width": 1920, "window_height": 1080, "device_pixel_ratio": 1.0, "full_screen": True},
    }
