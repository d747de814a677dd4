"""Delete participants' personal data at the end of the time for which a study keeps them; votes stay."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import Connection, delete, select, update

from app.store.participants import KEPT_AT_ERASURE
from app.store.schema import metadata
from app.store.studies import Study, all_studies
from app.store.tables import invitation, participant, session, study, vote
from app.study.options import parse_options
from app.study.privacy import forgets_at
from app.study.stages import ENDS, TIMED_OUT

KEPT = (*KEPT_AT_ERASURE, vote.name)  # tables of participants that say what was shown and how it was judged


def studies_to_forget(connection: Connection, now: datetime) -> list[Study]:
    """Return the studies that have kept personal data for as long as they may, since they last ended."""
    ends = [(each, forgets_at(parse_options(each.options), each.closed_at)) for each in all_studies(connection)]
    return [
        each
        for each, end in ends
        if end is not None and end <= now and (each.forgotten_at is None or each.forgotten_at < end)
    ]


def forget_people(connection: Connection, study_id: int, now: datetime) -> None:
    """Delete all that a study's participants gave but their votes, and what leads from the votes to a person.

    Answers, screening, notes and tags, outside ids and names on invitations go; labels, votes and exclusions stay.
    Nobody's link or code leads to a session any more.

    Parameters
    ----------
    connection : of a writing transaction
    study_id : whose participants are meant
    now : the time
    """
    people = select(participant.c.id).where(participant.c.study_id == study_id)
    sessions = select(session.c.id).where(session.c.participant_id.in_(people))
    for table in reversed(metadata.sorted_tables):
        if table.name in KEPT:
            continue
        if "session_id" in table.c:
            connection.execute(delete(table).where(table.c.session_id.in_(sessions)))
        elif "participant_id" in table.c:
            connection.execute(delete(table).where(table.c.participant_id.in_(people)))
    theirs = session.c.participant_id.in_(people)
    nobodys: dict[str, Any] = {"token_hash": "-" + session.c.public_id, "resume_hash": "-" + session.c.public_id}
    connection.execute(update(session).where(theirs).values(**nobodys, begin_hash=None))
    connection.execute(update(session).where(theirs, session.c.stage.not_in(ENDS)).values(stage=TIMED_OUT))
    connection.execute(update(invitation).where(invitation.c.study_id == study_id).values(label=""))
    connection.execute(update(study).where(study.c.id == study_id).values(forgotten_at=now))
