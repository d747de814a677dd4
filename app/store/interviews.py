"""Spoken interviews: participants' answers as an experimenter notes them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime

from sqlalchemy import Connection, insert, select, update

from app.store.tables import session, spoken_answer


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
