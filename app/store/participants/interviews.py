"""Keep interviews: answers that participants write on the page, or say to an experimenter, who notes them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from sqlalchemy import Connection, insert, select, update

from app.store.database.tables import participant, session, spoken_answer, stage_record
from app.store.participants.exclusions import COUNTING, counting, takes_part_in
from app.study.stages import INTERVIEW


def keep_spoken(
    connection: Connection, participant_id: int, answers: Mapping[str, str], experimenter: str, now: datetime
) -> None:
    """Store answers by question; an unchanged answer keeps its author and time.

    Parameters
    ----------
    answers : text by question; an empty text is stored only to replace another one
    """
    session_id = connection.execute(select(session.c.id).where(session.c.participant_id == participant_id)).scalar_one()
    before = spoken_of(connection, participant_id)
    for question, text in answers.items():
        values = {"answer": text, "experimenter": experimenter, "written_at": now}
        if question not in before and text:
            connection.execute(insert(spoken_answer).values(session_id=session_id, question=question, **values))
        elif question in before and text != before[question]:
            this = (spoken_answer.c.session_id == session_id, spoken_answer.c.question == question)
            connection.execute(update(spoken_answer).where(*this).values(**values))


def spoken_of(connection: Connection, participant_id: int) -> dict[str, str]:
    """Return what a participant said, by question."""
    rows = (
        select(spoken_answer.c.question, spoken_answer.c.answer)
        .select_from(spoken_answer.join(session))
        .where(session.c.participant_id == participant_id)
        .order_by(spoken_answer.c.id)
    )
    return {row.question: row.answer for row in connection.execute(rows)}


def questionnaire_records(connection: Connection, study_id: int) -> list[dict[str, Any]]:
    """Return a row for each participant and question: written answers first, then spoken ones."""
    takes_part = takes_part_in(study_id)
    written = connection.execute(
        select(participant.c.label, stage_record.c.data, stage_record.c.completed_at, *COUNTING)
        .select_from(stage_record.join(session).join(participant))
        .where(takes_part, stage_record.c.stage == INTERVIEW)
        .order_by(participant.c.slot)
    )
    rows: list[dict[str, Any]] = [
        {
            "participant": row.label,
            "question": question,
            "answer": answer,
            "answered_at": row.completed_at,
            "source": "written",
            "experimenter": None,
            **counting(row),
        }
        for row in written
        for question, answer in row.data.get("answers", {}).items()
    ]
    said = connection.execute(
        select(
            participant.c.label.label("participant"),
            spoken_answer.c.question,
            spoken_answer.c.answer,
            spoken_answer.c.written_at.label("answered_at"),
            spoken_answer.c.experimenter,
            *COUNTING,
        )
        .select_from(spoken_answer.join(session, spoken_answer.c.session_id == session.c.id).join(participant))
        .where(takes_part)
        .order_by(participant.c.slot, spoken_answer.c.id)
    )
    names = ("participant", "question", "answer", "answered_at", "experimenter")
    return rows + [
        {**{name: row._mapping[name] for name in names}, "source": "spoken", **counting(row)} for row in said
    ]
